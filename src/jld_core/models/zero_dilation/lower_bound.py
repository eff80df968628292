"""Lower bound on λ over all non-dilatant planar solutions, by relaxation and branching.

The relaxations are linear programs over products (RLT). Every step excludes an interval [L, p) of λ, given that [0, L)
is excluded already. Where progress stalls on a mode, the solutions are split: either the mode does not move, or its
slack is zero. Every solution belongs to one of the two parts. A step counts as proven if its certificate is valid, see
`certificate`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation.bounded_modes import BoundedModes, Region
from jld_core.models.zero_dilation.certificate import Certifier
from jld_core.models.zero_dilation.frozen_friction import frozen_friction_bound
from jld_core.models.zero_dilation.loops import has_opening
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.rlt_relaxation import RltOptions, RltSolution, solve_rlt
from jld_core.models.zero_dilation.sweep import BlockSweep

FACES: Final = 60
"""Number of faces up to which products are formed; larger scenes have only cheap bounds, unless given more time."""

# Distance from the lowest solution found, relative, below which a certificate is not refined further
_ENOUGH: Final = 2e-7

_SLACK: Final = 1e-8  # least slack σ: decrease of λ per unit of cost in the program, relative to λ or to 1

# Slack σ while the bound is far from the solution: the bound is lower, but its certificate is exact at once
_MORE: Final = 1e-6

_FINER: Final = 0.1  # factor by which the slack decreases again near the solution, and the inverse by which it grows

# Relative distance from the lowest solution found up to which the slack, not the rows, limits the bound
_FAR: Final = 1e-4

_BLOCKS: Final = 25  # number of faces from which programs are solved by matrix blocks

_AT_ONCE: Final = 45  # number of faces up to which the first program by matrix blocks is solved to full accuracy

_DEPTH: Final = 6  # maximum depth of branching


@dataclass(frozen=True)
class _Bounds:
    """Lower bounds on scaled λ of the solutions in one region.

    proven: by certificates. believed: the highest one, which may rely on the solver.
    """

    proven: float
    believed: float

    def with_(self, proven: float, believed: float) -> _Bounds:
        """Return a copy with each bound raised to the given value, if that is higher."""
        return _Bounds(max(self.proven, proven), max(self.believed, believed, proven))

    def least(self, other: _Bounds) -> _Bounds:
        """Return the lower bounds of the union of two regions: the lower one of each kind."""
        return _Bounds(min(self.proven, other.proven), min(self.believed, other.believed))


class LowerBoundSearch:
    """Search for a lower bound on λ over all non-dilatant solutions of one planar labelling.

    analysis: of the assembly. labels: (m,) True = dry. modes: complementarity problem of these labels. problem: lowest
    solution found, time budget and log; the search updates it.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: Modes, problem: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.problem = analysis, labels, modes, problem
        self._bounded = BoundedModes.up_to(modes, problem.interval_end(0.0))

    def search(self) -> LowerBound:
        """Compute the lower bound: by frozen friction, then RLT relaxations, then branches.

        The search ends where the bound meets the lowest solution found, or at the time limit. Without a proof the bound
        is 0.
        """
        modes, problem, none = self.modes, self.problem, np.zeros(len(self.modes.rows), dtype=bool)
        force_bounds, velocity_bounds = self._bounded.force_bounds, self._bounded.velocity_bounds
        if velocity_bounds is None:
            problem.record("no certificate: velocities are not bounded")
        normals = np.arange(0, modes.matrix.shape[1], 3)
        low = frozen_friction_bound(self.analysis, self.labels, modes, normals, force_bounds, problem)
        bounds = _Bounds(low, low)
        if problem.allows_products(modes.faces, FACES, force_bounds):
            if velocity_bounds is not None and modes.faces >= _BLOCKS and not problem.closes_gap(low):
                # Programs by matrix blocks count only if proven; walls usually end here.
                steps = BlockSweep(self._bounded, problem)
                # Around openings, products with hinges alone prove nothing.
                stage = len(steps.stages) - 1 if has_opening(modes.assembly) else 0
                if modes.faces <= _AT_ONCE and stage == 0:
                    low = max(low, steps.near_hinge_bound(low))
                if modes.faces > FACES:
                    low = steps.partial_bound(low, stage)
                low = steps.sweep(low, none, none, stage)
            bounds = self._sweep(_Bounds(low, low), none, none, modes.near_pairs, 0)
        return problem.result(bounds.proven, bounds.believed)

    # --- pieces -------------------------------------------------------------------------------------------

    def _sweep(self, bounds: _Bounds, closed: Bools, held: Bools, pairs: Bools, depth: int) -> _Bounds:
        """Solve relaxations of one region, each from the last bound; branch where they stall.

        bounds: known of the region. closed, held: (4m,) modes with z = 0, and with y = 0. pairs: mask of product rows.
        depth: of branching, 0 at the root.
        """
        name, slack, problem = "products" if depth == 0 else f"branch {depth}", _SLACK, self.problem
        while not problem.closes_gap(bounds.believed) and problem.seconds_left > 0.0:
            low = bounds.believed
            region = self._bounded.region(low, problem.interval_end(low), closed, held)
            bounded = self._bounded.velocity_bounds is not None
            earned = problem.scaled_slack(slack) if bounded else 0.0
            relaxed = solve_rlt(self._bounded, region, RltOptions(pairs, earned, max(problem.seconds_left, 1.0)))
            problem.record(name if relaxed is not None else f"{name}: no answer", 1)
            if relaxed is None:
                return bounds
            certifies = bounded and bounds.proven >= low * (1.0 - tolerances.GAP)
            if certifies and slack < _MORE and relaxed.multipliers.bound < problem.load_below(_FAR):
                # Another step follows in any case, so its certificate may use more slack.
                slack = _MORE
                problem.record("more slack")
                continue
            found = self._proven(region, relaxed, slack) if certifies else -math.inf
            if certifies and found == -math.inf and slack < _MORE:
                slack = min(slack / _FINER, _MORE)
                problem.record("more slack")
                continue
            bounds = bounds.with_(
                found, problem.less_solver_tolerance(relaxed.multipliers.bound) if relaxed.accurate else -math.inf
            )
            if depth == 0:
                problem.offer_states(relaxed.states)
            if problem.gains_enough(low, bounds.believed) or problem.closes_gap(bounds.believed):
                continue
            if slack > _SLACK and bounds.believed >= problem.load_below(_FAR):
                slack = max(slack * _FINER, _SLACK)
                problem.record("less slack")
                continue
            fresh = None if relaxed.violated is None else relaxed.violated & ~pairs
            if fresh is not None and fresh.any():
                pairs = pairs | fresh
                problem.record("rows added")
                continue
            halves = region.split(relaxed.rates, relaxed.slacks) if depth < _DEPTH else None
            if halves is None:
                break
            first, second = (self._sweep(bounds, half.closed, half.held, pairs, depth + 1) for half in halves)
            return first.least(second)
        return bounds

    def _proven(self, region: Region, relaxed: RltSolution, slack: float) -> float:
        """Return the lower bound on scaled λ that a certificate proves for a region; −inf if none.

        region: part of the solutions. relaxed: solution of its relaxation. slack: σ, relative.
        """
        # With more than the least slack another step follows, so the first valid certificate is sufficient.
        sufficient_bound = self.problem.load_below(_ENOUGH) if slack == _SLACK else -math.inf
        check = Certifier(self._bounded, region, self.problem.scaled_slack(slack))
        return check.bound(relaxed.multipliers, sufficient_bound)
