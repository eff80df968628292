"""Bounds without dilation proven step by step: each program begins where the last one's certificate ended.

The nearer the bound comes, the more modes can be shown not to move, and the smaller programs get. Where a step gains
little more products are formed; where there are no more, the solutions in which a mode does not move and those in
which its slack is zero are bounded apart.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation.blocks import BlockAnswer, BlockCertifier, relax_in_blocks
from jld_core.models.zero_dilation.lower_bound_problem import LowerBoundProblem
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.rlt_relaxation import Region
from jld_core.models.zero_dilation.statics import Statics

_ENOUGH: Final = 4e-7  # distance from the lowest solution found, relative, at which a certificate is fine enough
_FINE, _COARSE = 1e-8, 1e-5  # λ that a unit of cost earns in the program, relative to λ or to 1: at the least, and most
_SHARE: Final = 1e-4  # of the distance from the lowest solution found, in between
_DEARER: Final = 10.0  # by which it grows where nothing is proven, to
_MOST: Final = 1e-4  # this at the most
_FIRST: Final = 1e-4  # the same of the first step of large scenes, and
_PART: Final = 0.75  # the share of the way to the lowest solution found on which it excludes all
_FAR: Final = 0.05  # distance from it, relative, from which other programs follow whatever this one proves, and
_ROUGHLY: Final = 1e-3  # how near to their end such programs are followed
_LESS: Final = 1e-4  # the same where they cannot be followed to their end
_ROUGHEST: Final = 1e-2  # the same of the first step
_NEAR: Final = 1e-4  # distance, relative, from which all that a certificate can prove is asked of it
_CLOSE: Final = 1e-5  # distance, relative, from which digits are lacking and not parts
_GAINS: Final = 0.5  # share of the distance that a step must win, else products are added or solutions parted
_DEPTH: Final = 12  # branches above one another


class BlockSweep:
    """One labelling. size, reach: see `Statics.size` and `statics.reach`."""

    def __init__(self, modes: Modes, size: Floats, reach: Floats, ceiling: LowerBoundProblem) -> None:
        self.modes, self.size, self.reach, self.ceiling = modes, size, reach, ceiling
        own = np.kron(np.eye(modes.faces, dtype=bool), np.ones((4, 4), dtype=bool))
        few = np.hstack([modes.hinges | own, np.zeros((len(own), len(modes.loops)), dtype=bool)])
        self.near = modes.close & few
        self.stages = (("all hinges", few), ("all products", np.ones_like(few)))

    def at_once(self, low: float) -> float:
        """What the fewest rows that close walls prove, followed to the end: most walls end here."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        return self._step("near hinges", self._region(low, none, none), self.near, _FINE, None)[1]

    def first(self, low: float, stage: int = 0) -> float:
        """What a program of one of the stages proves that excludes all on a part of the way alone: it ends in half the
        steps that one up to the lowest solution found takes, and pays for slack enough that its multipliers prove it as
        they come."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        region = self._region(low, none, none, low + _PART * (self.ceiling.load - low))
        pairs = self.stages[stage][1]
        answer, found = self._step("part of the way", region, pairs, _FIRST, _ROUGHEST)
        if answer is None and self.ceiling.left > 0.0:
            # slack was more than mechanisms can pay
            found = self._step("part of the way", region, pairs, _FIRST / _DEARER, _ROUGHEST)[1]
        return max(low, found)

    def sweep(self, low: float, closed: Bools, held: Bools, stage: int = 0, depth: int = 0) -> float:
        """The bound in which steps from `low` end, with some modes (4m,) closed and others held."""
        slack, ceiling, rough = 0.0, self.ceiling, False
        while not ceiling.met(low) and ceiling.left > 0.0:
            name, pairs = self.stages[stage]
            slack = max(slack, self._slack(low))
            region = self._region(low, closed, held)
            exact = _ROUGHLY if low < ceiling.below(_FAR) else _LESS if rough else None
            answer, found = self._step(f"branch {depth}" if depth else name, region, pairs, slack, exact)
            if answer is not None and depth == 0:
                ceiling.take(answer.states)
            last = stage + 1 == len(self.stages)
            won = ceiling.won(low, found, _GAINS)
            low = max(low, found)
            if won or ceiling.met(low):
                slack, rough = 0.0, False
            elif found == -math.inf and slack < _MOST and self._gains(region, answer):
                slack = min(_DEARER * slack, _MOST)
                ceiling.note("more slack")
            elif not last:
                stage, slack = stage + 1, 0.0
            elif answer is None and exact is None:
                rough = True
                ceiling.note("less exact")
            elif depth < _DEPTH and answer is not None and low < ceiling.below(_CLOSE):
                return self._branch(low, region, answer, stage, depth)
            else:
                break
        return low

    # --- pieces -------------------------------------------------------------------------------------------

    def _slack(self, low: float) -> float:
        return float(np.clip(_SHARE * (self.ceiling.load - low) / self.ceiling.unit, _FINE, _COARSE))

    def _region(self, low: float, closed: Bools, held: Bools, high: float | None = None) -> Region:
        high = self.ceiling.above(low) if high is None else high
        return Region(low, high, closed | Statics(self.modes, low, high, held, self.size).closed(), held)

    def _step(
        self, name: str, region: Region, pairs: Bools, slack: float, exact: float | None
    ) -> tuple[BlockAnswer | None, float]:
        """One program and what is proven by it."""
        ceiling, earned = self.ceiling, self.ceiling.earns(slack)
        ceiling.note(name, 1)
        left = max(ceiling.left, 1.0)
        answer = relax_in_blocks(self.modes, region, self.size, pairs, earned, left, exact=exact)
        if answer is None:
            return None, -math.inf
        if not self._gains(region, answer):
            return answer, -math.inf
        check = BlockCertifier(self.modes, region, earned, self.size, self.reach)
        near = answer.multipliers.bound >= ceiling.below(_NEAR)
        return answer, check.bound(answer.multipliers, ceiling.below(_ENOUGH) if near else -math.inf)

    def _gains(self, region: Region, answer: BlockAnswer | None) -> bool:
        """The solver itself says that there is something to prove."""
        return answer is not None and self.ceiling.won(region.low, answer.multipliers.bound)

    def _branch(self, low: float, region: Region, answer: BlockAnswer, stage: int, depth: int) -> float:
        halves = region.halves(answer.rates, answer.slacks)
        if halves is None:
            return low
        found = math.inf
        for half in halves:
            if found > low:
                found = min(found, self.sweep(low, half.closed, half.held, stage, depth + 1))
        return found
