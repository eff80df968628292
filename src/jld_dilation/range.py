"""Compute the range of collapse loads without dilation: lowest, highest and lower bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import (
    Bits,
    Bools,
    DeadlinePassed,
    Floats,
    LimitAnalysis,
    LimitAnalysisResult,
    ParameterError,
    Status,
    tolerances,
)
from jld_core.limit import Proof, number, result_of
from jld_core.models import effective_area
from jld_dilation.certificate import Certifier, pair_proof
from jld_dilation.fixed_point_search import FixedPointSearch, ProximalOptions, frozen_friction_bound
from jld_dilation.modes import BoundedModes, Modes, Region, has_opening
from jld_dilation.rlt_relaxation import LowerBound, LowerBoundProblem, RltOptions, RltSolution, solve_rlt
from jld_dilation.sweep import BlockSweep, MultiStartSearch, initial_forces

# Number of faces up to which products are formed; larger scenes have only cheap bounds, unless given more time.
FACES: Final = 60

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
    """Lower bounds on scaled λ of the solutions in one region."""

    proven: float  # by certificates
    believed: float  # the highest one, which may rely on the solver

    def with_(self, proven: float, believed: float) -> _Bounds:
        """Return a copy with each bound raised to the given value, if that is higher."""
        return _Bounds(max(self.proven, proven), max(self.believed, believed, proven))

    def least(self, other: _Bounds) -> _Bounds:
        """Return the lower bounds of the union of two regions: the lower one of each kind."""
        return _Bounds(min(self.proven, other.proven), min(self.believed, other.believed))


class LowerBoundSearch:
    """Search for a lower bound on λ over all solutions of one planar labelling; updates `problem`."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: Modes, problem: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.problem = analysis, labels, modes, problem
        self._bounded = BoundedModes.up_to(modes, problem.interval_end(0.0))

    def search(self) -> LowerBound:
        """Compute the lower bound: by frozen friction, then RLT relaxations, then branches."""
        # The search ends where the bound meets the lowest solution found, or at the time limit. Without a proof the
        # bound is 0.
        modes, problem, force_bounds = self.modes, self.problem, self._bounded.force_bounds
        certifies = self._bounded.velocity_bounds is not None
        if not certifies:
            problem.record("no certificate: velocities are not bounded")
        normals = np.arange(0, modes.matrix.shape[1], 3)
        low = frozen_friction_bound(self.analysis, self.labels, modes, normals, force_bounds, problem)
        if not problem.allows_products(modes.faces, FACES, force_bounds):
            return problem.result(low, low)
        # Programs by matrix blocks count only if proven; walls usually end here.
        if certifies and modes.faces >= _BLOCKS and not problem.closes_gap(low):
            low = self._bound_by_matrix_blocks(low)
        none = np.zeros(len(modes.rows), dtype=bool)  # the region of all solutions: no mode is closed or held
        bounds = self._sweep(_Bounds(low, low), none, none, modes.near_pairs, 0)
        return problem.result(bounds.proven, bounds.believed)

    # --- pieces -------------------------------------------------------------------------------------------

    def _bound_by_matrix_blocks(self, low: float) -> float:
        """Raise the proven bound `low` by programs by matrix blocks, over all solutions."""
        modes, steps = self.modes, BlockSweep(self._bounded, self.problem)
        # Around openings, products with hinges alone prove nothing: begin with the last stage.
        stage = len(steps.stages) - 1 if has_opening(modes.assembly) else 0
        if modes.faces <= _AT_ONCE and stage == 0:
            low = max(low, steps.near_hinge_bound(low))
        if modes.faces > FACES:
            low = steps.partial_bound(low, stage)
        none = np.zeros(len(modes.rows), dtype=bool)
        return steps.sweep(low, none, none, stage)

    def _sweep(self, bounds: _Bounds, closed: Bools, held: Bools, pairs: Bools, depth: int) -> _Bounds:
        """Solve relaxations of one region, each from the last bound; branch where they stall."""
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
            proven = self._proven(region, relaxed, slack) if certifies else -math.inf
            if certifies and proven == -math.inf and slack < _MORE:
                slack = min(slack / _FINER, _MORE)
                problem.record("more slack")
                continue
            bounds = bounds.with_(
                proven, problem.less_solver_tolerance(relaxed.multipliers.bound) if relaxed.accurate else -math.inf
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
        """Return the scaled bound that a certificate proves for a region; −inf if none."""
        # With more than the least slack another step follows, so the first valid certificate is sufficient.
        sufficient_bound = self.problem.load_below(_ENOUGH) if slack == _SLACK else -math.inf
        check = Certifier(self._bounded, region, self.problem.scaled_slack(slack))
        return check.bound(relaxed.multipliers, sufficient_bound)


_TRIED: Final = 3  # number of states of a relaxation from which the search for solutions continues

# Search for a lower bound: analysis, labels, solutions found so far, processor time in seconds; None without one.
BoundSearch = Callable[[LimitAnalysis, Bits, MultiStartSearch, float], LowerBound | None]


@dataclass(frozen=True)
class RangeOptions:
    """Parameters of the search for the range of collapse loads without dilation."""

    seconds: float  # processor time in seconds after which no further step of the lower bound begins; 0 omits the bound
    # λ in scene units. The search ends once a solution at or below this value is found.
    sufficient_load: float = -math.inf
    # function that searches for the lower bound. Default: that of planar scenes; it gives no bound for spatial scenes
    # and with crushing.
    bound: BoundSearch | None = None


def load_range(
    analysis: LimitAnalysis, labels: Bits, proximal: ProximalOptions, associative: Proof, options: RangeOptions
) -> Proof:
    """Find the lowest and highest certified solution, and a lower bound on all: proof of the lowest one found."""
    # `lowest_proven`: exact bound on all solutions with λ ≥ 0, or None. `lowest_bound`, `bound_tolerance`: highest
    # bound, and what depends on a solver. `proven`: both are equal. `closed`: it meets `lowest_found` within 1e-6.
    # `highest`: evidence. `floor_*`: steps, programs, seconds.
    # The search ends early at the deadline of the command; solutions found until then are reported. The bound requires
    # a planar scene without crushing, effective areas, shear strength of dry faces and friction of inner faces.
    if associative.status is Status.UNSTABLE:
        return _proof_without_solution(pair_proof(associative, analysis, None, 0))
    if associative.status is Status.LOCKED:
        proximal = replace(proximal, alpha=0.0)
    search = MultiStartSearch(analysis, labels, proximal, associative)
    unit = analysis.template.scaling.load
    sufficient = options.sufficient_load / unit
    found, lower_bound = search.found, None
    with suppress(DeadlinePassed):  # Keep the solutions found before the deadline.
        search.search(sufficient_load=sufficient)
        lower_bound = _lower_bound(
            analysis,
            labels,
            search,
            options.seconds if found.lowest_load > sufficient else 0.0,
            options.bound or _planar_bound,
        )
    lowest, highest = found.lowest, found.highest
    if lowest is None or highest is None:
        unsolved = _proof_without_solution(pair_proof(associative, analysis, found.best, search.fixed_point.solves))
        # If time was up before any pair was tried, the associative status does not apply.
        return unsolved if found.best is not None else replace(unsolved, status=Status.UNCERTIFIED)
    proof = pair_proof(associative, analysis, lowest, search.fixed_point.solves)
    above = pair_proof(associative, analysis, highest, search.fixed_point.solves)
    solve_options = replace(analysis.options, friction="zero-dilation", effective_area=proximal.effective_area)
    ends = {
        "lowest_found": number(proof.load_factor * unit),
        "highest_found": number(above.load_factor * unit),
        "solutions_found": len(found.loads),
        "highest": _evidence(result_of(analysis.template, labels, solve_options, above, elapsed=0.0)),
        **_bound_entries(lower_bound, unit),
    }
    return replace(proof, extra={**proof.extra, **ends})


def _lower_bound(
    analysis: LimitAnalysis, labels: Bits, search: MultiStartSearch, seconds: float, bound: BoundSearch
) -> LowerBound | None:
    # If a solution at λ = 0 is known, the bound is 0 without a search.
    # None without any solution or time, with effective areas, dry shear strength or inner friction.
    ends = search.found
    if ends.lowest is None or not seconds > 0.0 or search.fixed_point.options.effective_area:
        return None
    if search.fixed_point.base.has_inner_friction or search.fixed_point.base.has_dry_shear:
        return None  # The certificates require friction of dry faces only.
    if ends.lowest_load <= tolerances.GAP * search.fixed_point.load_scale:
        return LowerBound(0.0, 0.0, 0.0, closed=True, programs=0, seconds=0.0, solve_log=("a solution at zero",))
    return bound(analysis, labels, search, seconds)


def _planar_bound(analysis: LimitAnalysis, labels: Bits, search: MultiStartSearch, seconds: float) -> LowerBound | None:
    """Return the lower bound of planar scenes, None without compression modes."""
    ends, modes = search.found, search.modes
    if modes is None:
        return None

    def offer(states: Floats) -> float:
        """Search for solutions from states of a relaxation; return the lowest λ found."""
        for state in states[:_TRIED]:
            search.search_from(state[:-1], thorough=False)
        return ends.lowest_load

    return LowerBoundSearch(analysis, labels, modes, LowerBoundProblem(ends.lowest_load, seconds, offer)).search()


def _bound_entries(lower_bound: LowerBound | None, load: float) -> dict[str, Any]:
    """Return the entries of `Proof.extra` that state the lower bound on λ, in scene units."""
    if lower_bound is None:
        none: dict[str, Any] = dict.fromkeys(("lowest_proven", "lowest_bound", "bound_tolerance"))
        return {**none, "proven": False, "closed": False, "floor_route": [], "floor_programs": 0, "floor_seconds": 0.0}
    down = load * (1.0 - 4.0 * np.finfo(float).eps)  # Scene units, rounded down.
    return {
        "lowest_proven": float(lower_bound.proven * down) if lower_bound.proven > 0.0 else None,
        "lowest_bound": float(lower_bound.bound * down),
        "bound_tolerance": lower_bound.tolerance,
        "proven": lower_bound.proven > 0.0 and lower_bound.tolerance == 0.0,
        "closed": lower_bound.closed,
        "floor_route": list(lower_bound.solve_log),
        "floor_programs": lower_bound.programs,
        "floor_seconds": lower_bound.seconds,
    }


def _proof_without_solution(proof: Proof) -> Proof:
    """Return a copy of a proof whose `extra` says that no solution and no bound were found."""
    none = {"lowest_found": None, "highest_found": None, "solutions_found": 0, "highest": None}
    return replace(proof, extra={**proof.extra, **none, **_bound_entries(None, 1.0)})


def _evidence(result: LimitAnalysisResult) -> dict[str, Any]:
    """Return λ, status, gaps, violations, forces and mechanism of a result, in JSON form."""
    printed = result.to_json()
    keys = (
        "load_factor",
        "status",
        "gap",
        "friction_violation",
        "dilation",
        "complementarity_gap",
        "forces",
        "mechanism",
    )
    return {key: printed[key] for key in keys}


# Largest number of faces for which linear programs in turn are tried after proximal steps did not converge
_SEVERAL: Final = 1000


def prove_zero_dilation(
    analysis: LimitAnalysis,
    labels: Bits,
    options: ProximalOptions | None = None,
    *,
    associative: Proof | None = None,
    stands: bool = False,
    pruning_threshold: float = -math.inf,
    range: float | None = None,
) -> Proof:
    """Prove the load factor of one labelling under friction without dilation.

    labels: (m,) True = dry. Result: λ and the forces `found` are those of an exactly admissible state, and the motion
    does not dilate. The bracket is [λ of the state, bound of the mechanism] for the problem with friction frozen at μN
    of that state. Its width is Γ. The bracket does not bound other zero-dilation solutions, which exist. The upper
    bound on all solutions is `extra["associative_load_factor"]`. `extra` also holds `friction_violation` (max(|V| −
    μN)⁺ / max N), `complementarity_gap` (Γ / dissipation), `converged`, `dilation` (of pressed faces / largest slip),
    `bracket_of` and `zero_dilation_iterations`. The status is `uncertified` if the search did not converge, or if the
    bracket is wider than the gap of the analysis. Raises InputError if a material is missing, for the start "vertex" on
    a program with cones, or for effective areas where they do not apply.
    """
    # If the associative problem is locked, the search starts from the state of least forces. Source: Gilbert,
    # Casapulla, Ahmed 2006; Iannuzzo et al. 2024, §2.4; docs/method.md (4.3).
    start = time.perf_counter()
    options = options or ProximalOptions()
    if options.effective_area:
        effective_area.require_rectangles(analysis.assembly, labels)
    if options.start == "vertex" and analysis.template.structure.cones:
        raise ParameterError("start", "'vertex' on a program with cones", "'associative' or 'gravity'")
    associative = associative or analysis.prove(labels, stands=stands)
    collapses = associative.status is Status.COLLAPSE
    if collapses and associative.bracket[1] * analysis.template.scaling.load <= pruning_threshold:
        upper = associative.load_factor
        return replace(associative, status=Status.UNCERTIFIED, state=None, associative=upper, outbid=True)
    if range is not None:
        proof = load_range(analysis, labels, options, associative, RangeOptions(range, pruning_threshold))
    elif associative.status is Status.UNSTABLE or associative.state is None:
        proof = pair_proof(associative, analysis, None, 0)
    else:
        if associative.status is Status.LOCKED:
            # With alpha > 0, friction grows with the present N and self-stress grows without limit.
            options = replace(options, alpha=0.0)
        search = FixedPointSearch(analysis, labels, options)
        pair = search.pair_from(initial_forces(search, associative, options.start))
        solves = search.solves
        if not pair.is_solution(analysis.gap) and len(labels) <= _SEVERAL:
            multi_start = MultiStartSearch(analysis, labels, options, associative)
            multi_start.close_gap(np.append(pair.state.forces.ravel(), pair.state.load))
            if multi_start.found.lowest is None:
                multi_start.search_random_mechanisms()
            pair, solves = multi_start.found.lowest or pair, solves + multi_start.fixed_point.solves
        proof = pair_proof(associative, analysis, pair, solves)
    proof.seconds = time.perf_counter() - start
    return proof
