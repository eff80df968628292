"""Prove lower bounds step by step: each program starts where the last certificate ended.

The nearer the bound is to the solution, the more modes are proven not to move, and the smaller the programs become.
Where a step gains little, more products are formed. Where all products exist, the region is split: either a mode does
not move, or its slack is zero.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core.arrays import Bools
from jld_core.models.zero_dilation.bounded_modes import BoundedModes, Region
from jld_core.models.zero_dilation.lower_bound_problem import LowerBoundProblem
from jld_core.models.zero_dilation.matrix_blocks import BlockCertifier, solve_rlt_by_matrix_blocks
from jld_core.models.zero_dilation.rlt_relaxation import RltOptions, RltSolution

# Distance from the lowest solution found, relative, below which a certificate is not refined further
_ENOUGH: Final = 4e-7

_FINE, _COARSE = 1e-8, 1e-5
"""Least and largest initial slack σ: decrease of λ per unit of cost, relative to λ or to 1."""

# Initial slack between these limits, as a fraction of the relative distance from the lowest solution found
_SHARE: Final = 1e-4

# Factor by which the slack grows where nothing is proven, or shrinks where the first program fails
_DEARER: Final = 10.0

_MOST: Final = 1e-4  # largest slack after such growth

_FIRST: Final = 1e-4  # slack of the first step of large scenes

# Fraction of the distance to the lowest solution found that the first step of large scenes tries to exclude
_PART: Final = 0.75

_FAR: Final = 0.05  # relative distance from that solution above which programs are solved with tolerance `_ROUGHLY`

_ROUGHLY: Final = 1e-3  # solver tolerance of programs that are followed by others in any case

_LESS: Final = 1e-4  # solver tolerance used after a program did not converge to full accuracy

_ROUGHEST: Final = 1e-2  # solver tolerance of the first step of large scenes

_NEAR: Final = 1e-4  # relative distance below which a certificate is refined as far as possible

_CLOSE: Final = 1e-5  # relative distance below which accuracy limits the bound, so that branching does not help

# Fraction of the distance that a step must gain; below it products are added or the region is split
_GAINS: Final = 0.5

_DEPTH: Final = 12  # maximum depth of branching


class BlockSweep:
    """Search for a lower bound on λ of one planar labelling by a sequence of proven programs.

    Each program is an RLT relaxation, solved by matrix blocks, that begins where the last certificate ended.

    bounded: complementarity problem with bounds on forces and velocities, both proven. problem: lowest solution found,
    time budget and log. stages: names and products y_k h_l of programs, in the order in which they are tried.
    """

    def __init__(self, bounded: BoundedModes, problem: LowerBoundProblem) -> None:
        self.bounded, self.problem = bounded, problem
        self.modes = modes = bounded.modes
        own = np.kron(np.eye(modes.faces, dtype=bool), np.ones((4, 4), dtype=bool))
        few = np.hstack([modes.hinges | own, np.zeros((len(own), len(modes.loops)), dtype=bool)])
        self.near_pairs = modes.near_pairs & few
        self.stages = (("all hinges", few), ("all products", np.ones_like(few)))

    def near_hinge_bound(self, low: float) -> float:
        """Prove a lower bound on λ by a program with the products of near hinges only.

        The program is solved to full accuracy. low: scaled λ up to which no solution exists. The result is scaled, and
        −inf if nothing is proven.
        """
        none = np.zeros(len(self.modes.rows), dtype=bool)
        return self._step("near hinges", self._region(low, none, none), self.near_pairs, _FINE, None)[1]

    def partial_bound(self, low: float, stage: int = 0) -> float:
        """Prove a bound that excludes only the first part of the interval of λ from `low`.

        The program takes half the steps of one that reaches up to the lowest solution found. It has enough slack that
        its multipliers prove the bound without correction. low: scaled λ up to which no solution exists. stage: index
        of the products in `stages`. The result is scaled, and `low` if nothing more is proven.
        """
        none = np.zeros(len(self.modes.rows), dtype=bool)
        region = self._region(low, none, none, low + _PART * (self.problem.load - low))
        pairs = self.stages[stage][1]
        answer, found = self._step("part of the way", region, pairs, _FIRST, _ROUGHEST)
        if answer is None and self.problem.seconds_left > 0.0:
            # The slack exceeded what mechanisms can balance: try again with less.
            found = self._step("part of the way", region, pairs, _FIRST / _DEARER, _ROUGHEST)[1]
        return max(low, found)

    def sweep(self, low: float, closed: Bools, held: Bools, stage: int = 0, depth: int = 0) -> float:
        """Prove a bound by repeated steps from `low`, with branches where steps stall.

        low: scaled λ up to which no solution exists. closed, held: (4m,) modes with z = 0, and with y = 0. stage: index
        of the products in `stages`. depth: of branching, 0 at the root. The result is scaled, and `low` if nothing more
        is proven.
        """
        slack, problem, rough = 0.0, self.problem, False
        while not problem.closes_gap(low) and problem.seconds_left > 0.0:
            name, pairs = self.stages[stage]
            slack = max(slack, self._slack(low))
            region = self._region(low, closed, held)
            tolerance = _ROUGHLY if low < problem.load_below(_FAR) else _LESS if rough else None
            answer, found = self._step(f"branch {depth}" if depth else name, region, pairs, slack, tolerance)
            if answer is not None and depth == 0:
                problem.offer_states(answer.states)
            last = stage + 1 == len(self.stages)
            won = problem.gains_enough(low, found, _GAINS)
            low = max(low, found)
            if won or problem.closes_gap(low):
                slack, rough = 0.0, False
            elif found == -math.inf and slack < _MOST and self._worth_certifying(region, answer):
                slack = min(_DEARER * slack, _MOST)
                problem.record("more slack")
            elif not last:
                stage, slack = stage + 1, 0.0
            elif answer is None and tolerance is None:
                rough = True
                problem.record("less exact")
            elif depth < _DEPTH and answer is not None and low < problem.load_below(_CLOSE):
                return self._branch(low, region, answer, stage, depth)
            else:
                break
        return low

    # --- pieces -------------------------------------------------------------------------------------------

    def _slack(self, low: float) -> float:
        """Return the slack σ, relative to max(|λ|, 1), with which a step from `low` begins."""
        return float(np.clip(_SHARE * (self.problem.load - low) / self.problem.load_unit, _FINE, _COARSE))

    def _region(self, low: float, closed: Bools, held: Bools, high: float | None = None) -> Region:
        """Return the region of solutions from `low` to `high`; see `BoundedModes.region`.

        low, high: scaled λ; without `high` the region ends a little above the lowest solution found. closed, held:
        (4m,) modes with z = 0, and with y = 0.
        """
        return self.bounded.region(low, self.problem.interval_end(low) if high is None else high, closed, held)

    def _step(
        self, name: str, region: Region, pairs: Bools, slack: float, tolerance: float | None
    ) -> tuple[RltSolution | None, float]:
        """Solve one program of a region; return its solution and the bound that it proves.

        name: for the log. pairs: products of the program. slack: σ, relative. tolerance: of the solver, None: its
        default. The solution is None, and the bound −inf, on failure.
        """
        problem, earned = self.problem, self.problem.scaled_slack(slack)
        problem.record(name, 1)
        left = max(problem.seconds_left, 1.0)
        options = RltOptions(pairs, earned, left, tolerance=tolerance)
        answer = solve_rlt_by_matrix_blocks(self.bounded, region, options)
        if answer is None:
            return None, -math.inf
        if not self._worth_certifying(region, answer):
            return answer, -math.inf
        check = BlockCertifier(self.bounded, region, earned)
        near = answer.multipliers.bound >= problem.load_below(_NEAR)
        return answer, check.bound(answer.multipliers, problem.load_below(_ENOUGH) if near else -math.inf)

    def _worth_certifying(self, region: Region, answer: RltSolution | None) -> bool:
        """Return True if the solver's bound of a region gains enough to be worth a certificate."""
        return answer is not None and self.problem.gains_enough(region.low, answer.multipliers.bound)

    def _branch(self, low: float, region: Region, answer: RltSolution, stage: int, depth: int) -> float:
        """Split a region at one mode, sweep both parts, and return the lower of their bounds.

        low: bound of the region so far, returned if no mode violates y z = 0. answer: solution whose mode violates it
        most. stage, depth: as in `sweep`.
        """
        halves = region.split(answer.rates, answer.slacks)
        if halves is None:
            return low
        found = math.inf
        for half in halves:
            if found > low:
                found = min(found, self.sweep(low, half.closed, half.held, stage, depth + 1))
        return found
