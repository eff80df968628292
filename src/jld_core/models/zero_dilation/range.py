"""Compute the range of collapse loads without dilation: lowest, highest and lower bound."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.deadline import DeadlinePassed
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Proof, Status, number, result_of
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.lower_bound import LowerBoundSearch
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.proof import pair_proof

_TRIED: Final = 3  # number of states of a relaxation from which the search for solutions continues

BoundSearch = Callable[[LimitAnalysis, Bits, MultiStartSearch, float], LowerBound | None]
"""Search for a lower bound: analysis, labels, solutions found so far, processor time in seconds; None without one."""


@dataclass(frozen=True)
class RangeOptions:
    """Parameters of the search for the range of collapse loads without dilation.

    seconds: processor time in seconds after which no further step of the lower bound begins; 0 omits the bound.
    sufficient_load: λ in scene units. The search ends once a solution at or below this value is found. bound: function
    that searches for the lower bound. Default: that of planar scenes; it gives no bound for spatial scenes and with
    crushing.
    """

    seconds: float
    sufficient_load: float = -math.inf
    bound: BoundSearch | None = None


def load_range(
    analysis: LimitAnalysis, labels: Bits, proximal: ProximalOptions, associative: Proof, options: RangeOptions
) -> Proof:
    """Find the lowest and the highest certified solution, and a lower bound on all solutions.

    The search ends early at the deadline of the command; solutions found until then are reported.

    labels: (m,) True = dry. proximal: parameters of the fixed-point search. associative: associative proof for these
    labels. options: time of the lower bound, and when the search ends. Result: proof of the lowest solution found.
    `extra` also holds `lowest_found` and `highest_found` (λ, None if no solution was certified), `solutions_found`,
    `highest` (evidence for the highest solution: λ, violation, dilation, gap, forces, mechanism), and the entries of
    the bound: - `lowest_proven`: no solution with λ ≥ 0 has a smaller λ, by certificates checked in exact arithmetic;
    None if no bound above zero is proven. - `lowest_bound`, `bound_tolerance`: the highest bound, and the relative
    tolerance to which it depends on a solver. - `proven`: `lowest_bound` equals `lowest_proven`. `closed`:
    `lowest_bound` meets `lowest_found` within 1e-6. - `floor_route`, `floor_programs`, `floor_seconds`: steps, number
    of programs, and processor time in seconds.

    The bound requires a planar scene without crushing, effective areas, cohesion of dry faces and friction of inner
    faces.
    """
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
        none = _proof_without_solution(pair_proof(associative, analysis, found.best, search.fixed_point.solves))
        # If time was up before any pair was tried, the associative status does not apply.
        return none if found.best is not None else replace(none, status=Status.UNCERTIFIED)
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
    """Compute a lower bound on λ of all solutions by the function `bound`.

    If a solution at λ = 0 is known, the bound is 0 without a search. The result is None without any solution, without
    time, with effective areas, and where dry faces have cohesion or inner faces friction. labels: (m,) True = dry.
    search: solutions found so far. seconds: of processor time.
    """
    found = search.found
    if found.lowest is None or not seconds > 0.0 or search.fixed_point.options.effective_area:
        return None
    if search.fixed_point.base.has_inner_friction or search.fixed_point.base.has_dry_cohesion:
        return None  # The certificates require friction of dry faces only.
    if found.lowest_load <= tolerances.GAP * search.fixed_point.load_scale:
        return LowerBound(0.0, 0.0, 0.0, closed=True, programs=0, seconds=0.0, solve_log=("a solution at zero",))
    return bound(analysis, labels, search, seconds)


def _planar_bound(analysis: LimitAnalysis, labels: Bits, search: MultiStartSearch, seconds: float) -> LowerBound | None:
    """Compute the lower bound of a planar scene; None for spatial scenes and with crushing.

    labels: (m,) True = dry. search: solutions found so far. seconds: of processor time.
    """
    found, modes = search.found, search.modes
    if modes is None:
        return None

    def offer(states: Floats) -> float:
        """Search for solutions from states of a relaxation; return the lowest λ found."""
        for state in states[:_TRIED]:
            search.search_from(state[:-1], thorough=False)
        return found.lowest_load

    return LowerBoundSearch(analysis, labels, modes, LowerBoundProblem(found.lowest_load, seconds, offer)).search()


def _bound_entries(lower_bound: LowerBound | None, load: float) -> dict[str, Any]:
    """Return the entries of `Proof.extra` that state the lower bound on λ, in scene units.

    lower_bound: None without one. load: λ in scene units per scaled λ; λ is rounded down. See `load_range` for the
    keys.
    """
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
