"""Bounds without dilation proven step by step: each program begins where the last one's certificate ended.

The nearer the bound comes, the more modes can be shown not to move, and the smaller programs get. Where a step gains
little more products are formed; where there are no more, the solutions in which a mode does not move and those in
which its slack is zero are bounded apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation_blocks import BlockAnswer, BlockCertifier, relax_in_blocks
from jld_core.models.zero_dilation_modes import Modes
from jld_core.models.zero_dilation_products import Region
from jld_core.models.zero_dilation_statics import Statics

_ENOUGH: Final = 4e-7  # distance from the lowest solution found, relative, at which a certificate is fine enough
_ROOM: Final = 0.02  # room above the lowest solution found, relative to what is not excluded, and
_LEAST_ROOM: Final = 1e-3  # to λ itself: an interval of no width leaves an interior point no interior
_FINE, _COARSE = 1e-8, 1e-5  # λ that a unit of cost earns in the program, relative to λ or to 1: at the least, and most
_SHARE: Final = 1e-4  # of the distance from the lowest solution found, in between
_DEARER: Final = 10.0  # by which it grows where nothing is proven
_FAR: Final = 0.05  # distance from it, relative, from which other programs follow whatever this one proves, and
_ROUGHLY: Final = 1e-3  # how near to their end such programs are followed
_NEAR: Final = 1e-4  # distance, relative, from which all that a certificate can prove is asked of it
_GAINS: Final = 0.5  # share of the distance that a step must win while there are products to add, and
_STALL: Final = 0.05  # after that, to be followed by another
_DEPTH: Final = 6  # branches above one another


class BlockSweep:
    """One labelling. size, reach: see `Statics.size` and `zero_dilation_statics.reach`. ceiling: λ of the lowest
    solution found. left: seconds of processor time there are. note: is told each step. offer: as for `FloorSearch`."""

    def __init__(
        self,
        modes: Modes,
        size: Floats,
        reach: Floats,
        ceiling: float,
        left: Callable[[], float],
        note: Callable[[str], None],
        offer: Callable[[Floats], float] | None = None,
    ) -> None:
        self.modes, self.size, self.reach, self.ceiling = modes, size, reach, ceiling
        self.left, self.note, self.offer = left, note, offer
        own = np.kron(np.eye(modes.faces, dtype=bool), np.ones((4, 4), dtype=bool))
        everything = np.ones_like(own)
        near = modes.near.astype(int)
        self.near = np.kron((near @ near) > 0, np.ones((4, 4), dtype=bool)) & (modes.hinges | own)
        self.stages = (("all hinges", everything & (modes.hinges | own)), ("all products", everything))

    def at_once(self, low: float) -> float:
        """What the fewest rows that close walls prove, followed to the end: most walls end here."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        return self._step("near hinges", self._region(low, none, none), self.near, _FINE, None)[1]

    def sweep(self, low: float, closed: Bools, held: Bools, stage: int = 0, depth: int = 0) -> float:
        """The bound in which steps from `low` end, with some modes (4m,) closed and others held."""
        slack = 0.0
        while not self.met(low) and self.left() > 0.0:
            name, pairs = self.stages[stage]
            slack = max(slack, self._slack(low))
            region = self._region(low, closed, held)
            exact = _ROUGHLY if self.ceiling - low > _FAR * self._unit else None
            answer, found = self._step(f"branch {depth}" if depth else name, region, pairs, slack, exact)
            if answer is not None and self.offer is not None and depth == 0:
                self.ceiling = min(self.ceiling, self.offer(answer.states))
            gained, before = found - low, self.ceiling - low
            low = max(low, found)
            if gained > (_STALL if stage + 1 == len(self.stages) else _GAINS) * before or self.met(low):
                slack = 0.0
            elif answer is not None and found == -math.inf and slack < _COARSE:
                slack = min(_DEARER * slack, _COARSE)
                self.note("more slack")
            elif stage + 1 < len(self.stages):
                stage, slack = stage + 1, 0.0
            elif depth < _DEPTH and answer is not None:
                return self._branch(low, region, answer, stage, depth)
            else:
                break
        return low

    def met(self, bound: float) -> bool:
        """A bound meets the lowest solution found."""
        return bound >= self.ceiling - tolerances.GAP * self._unit

    # --- pieces -------------------------------------------------------------------------------------------

    @property
    def _unit(self) -> float:
        return max(abs(self.ceiling), _FINE)

    def _slack(self, low: float) -> float:
        return float(np.clip(_SHARE * (self.ceiling - low) / self._unit, _FINE, _COARSE))

    def _region(self, low: float, closed: Bools, held: Bools) -> Region:
        high = self.ceiling + _ROOM * (self.ceiling - low) + _LEAST_ROOM * self._unit
        return Region(low, high, closed | Statics(self.modes, low, high, held, self.size).closed(), held)

    def _step(
        self, name: str, region: Region, pairs: Bools, slack: float, exact: float | None
    ) -> tuple[BlockAnswer | None, float]:
        """One program and what is proven by it."""
        earned = slack * max(abs(self.ceiling), 1.0)
        self.note(name)
        left = max(self.left(), 1.0)
        answer = relax_in_blocks(self.modes, region, self.size, pairs, earned, left, exact=exact)
        if answer is None:
            return None, -math.inf
        check = BlockCertifier(self.modes, region, earned, self.size, self.reach)
        near = answer.multipliers.bound >= self.ceiling - _NEAR * self._unit
        enough = self.ceiling - _ENOUGH * self._unit if near else -math.inf
        return answer, check.bound(answer.multipliers, enough)

    def _branch(self, low: float, region: Region, answer: BlockAnswer, stage: int, depth: int) -> float:
        """Both sides of the mode that disagrees most with itself: on the mean it moves, and has slack."""
        apart = np.where(region.closed | region.held, 0.0, np.minimum(answer.rates, 1.0) * answer.slacks)
        mode = int(np.argmax(apart))
        if not apart[mode] > 0.0:
            return low
        one = np.arange(len(apart)) == mode
        still = self.sweep(low, region.closed | one, region.held, stage, depth + 1)
        if still <= low:
            return low
        return min(still, self.sweep(low, region.closed, region.held | one, stage, depth + 1))
