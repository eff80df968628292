"""Prove lower bounds step by step: each program starts where the last certificate ended.

The nearer the bound is to the solution, the more modes are proven not to move, and the smaller the programs become.
Where a step gains little, more products are formed. Where all products exist, the region is split: either a mode does
not move, or its slack is zero.
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

_ENOUGH: Final = 4e-7
"""Distance from the lowest solution found, relative, below which a certificate is not refined further."""

_FINE, _COARSE = 1e-8, 1e-5
"""Least and largest initial slack σ: decrease of λ per unit of cost, relative to λ or to 1."""

_SHARE: Final = 1e-4
"""Initial slack between these limits, as a fraction of the relative distance from the lowest solution found."""

_DEARER: Final = 10.0
"""Factor by which the slack grows where nothing is proven, or shrinks where the first program fails."""

_MOST: Final = 1e-4
"""Largest slack after such growth."""

_FIRST: Final = 1e-4
"""Slack of the first step of large scenes."""

_PART: Final = 0.75
"""Fraction of the distance to the lowest solution found that the first step of large scenes tries to exclude."""

_FAR: Final = 0.05
"""Relative distance from that solution above which programs are solved with tolerance `_ROUGHLY`."""

_ROUGHLY: Final = 1e-3
"""Solver tolerance of programs that are followed by others in any case."""

_LESS: Final = 1e-4
"""Solver tolerance used after a program did not converge to full accuracy."""

_ROUGHEST: Final = 1e-2
"""Solver tolerance of the first step of large scenes."""

_NEAR: Final = 1e-4
"""Relative distance below which a certificate is refined as far as possible."""

_CLOSE: Final = 1e-5
"""Relative distance below which accuracy limits the bound, so that branching does not help."""

_GAINS: Final = 0.5
"""Fraction of the distance that a step must gain; below it products are added or the region is split."""

_DEPTH: Final = 12
"""Maximum depth of branching."""


class BlockSweep:
    """Sequence of certified programs by matrix blocks, for one planar labelling.

    size, reach: see `Statics.size` and `statics.reach`.
    """

    def __init__(self, modes: Modes, size: Floats, reach: Floats, ceiling: LowerBoundProblem) -> None:
        self.modes, self.size, self.reach, self.ceiling = modes, size, reach, ceiling
        own = np.kron(np.eye(modes.faces, dtype=bool), np.ones((4, 4), dtype=bool))
        few = np.hstack([modes.hinges | own, np.zeros((len(own), len(modes.loops)), dtype=bool)])
        self.near = modes.close & few
        self.stages = (("all hinges", few), ("all products", np.ones_like(few)))

    def at_once(self, low: float) -> float:
        """Return the bound of the smallest program that closes most walls, solved accurately."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        return self._step("near hinges", self._region(low, none, none), self.near, _FINE, None)[1]

    def first(self, low: float, stage: int = 0) -> float:
        """Return the bound of a program that excludes only the first part of the interval of λ.

        The program takes half the steps of one that reaches up to the lowest solution found. It has enough slack that
        its multipliers prove the bound without correction. stage: index of the products to form.
        """
        none = np.zeros(len(self.modes.rows), dtype=bool)
        region = self._region(low, none, none, low + _PART * (self.ceiling.load - low))
        pairs = self.stages[stage][1]
        answer, found = self._step("part of the way", region, pairs, _FIRST, _ROUGHEST)
        if answer is None and self.ceiling.left > 0.0:
            # The slack exceeded what mechanisms can balance: try again with less.
            found = self._step("part of the way", region, pairs, _FIRST / _DEARER, _ROUGHEST)[1]
        return max(low, found)

    def sweep(self, low: float, closed: Bools, held: Bools, stage: int = 0, depth: int = 0) -> float:
        """Return the bound reached by steps from `low`, with closed and held modes (4m,)."""
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
        """Return the initial slack for a bound `low`."""
        return float(np.clip(_SHARE * (self.ceiling.load - low) / self.ceiling.unit, _FINE, _COARSE))

    def _region(self, low: float, closed: Bools, held: Bools, high: float | None = None) -> Region:
        """Return the region from `low`, with the modes closed that are proven not to move."""
        high = self.ceiling.above(low) if high is None else high
        return Region(low, high, closed | Statics(self.modes, low, high, held, self.size).closed(), held)

    def _step(
        self, name: str, region: Region, pairs: Bools, slack: float, exact: float | None
    ) -> tuple[BlockAnswer | None, float]:
        """Solve one program; return its answer and the bound proven by its multipliers."""
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
        """Return True if the solver's own bound gains enough to be worth certifying."""
        return answer is not None and self.ceiling.won(region.low, answer.multipliers.bound)

    def _branch(self, low: float, region: Region, answer: BlockAnswer, stage: int, depth: int) -> float:
        """Split the region at one mode and return the lower bound of both parts."""
        halves = region.halves(answer.rates, answer.slacks)
        if halves is None:
            return low
        found = math.inf
        for half in halves:
            if found > low:
                found = min(found, self.sweep(low, half.closed, half.held, stage, depth + 1))
        return found
