"""How low and how high collapse without dilation can be: the ends of what a search from every side finds."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.deadline import DeadlinePassed
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Proof, Status, number, result_of
from jld_core.models.zero_dilation.found import MultiStartSearch
from jld_core.models.zero_dilation.lower_bound import FloorSearch
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.proof import proof_of
from jld_core.models.zero_dilation.search import ProximalOptions
from jld_core.models.zero_dilation.spatial_lower_bound import SpaceFloorSearch
from jld_core.models.zero_dilation.spatial_modes import space_modes_of
from jld_core.models.zero_dilation.starts import certified

_TRIED: Final = 3  # states of the relaxation that are walked on from


def load_range(
    analysis: LimitAnalysis,
    labels: Bits,
    scheme: ProximalOptions,
    associative: Proof,
    seconds: float,
    enough: float = -math.inf,
) -> Proof:
    """The lowest certified solution of one labelling, with the highest beside it and a bound below.

    analysis, labels, scheme, associative: as for `prove_zero_dilation`. seconds: of processor time after which no
    further step of the bound begins; 0 leaves the bound out. enough: λ, scene units: once a solution is found at or
    below it the search ends. The proof is that of the lowest solution found; `extra` also holds `lowest_found` and
    `highest_found` (λ, None where no solution was certified), `solutions_found`, `highest` (the evidence of the
    highest: λ, violation, dilation, gap, forces, mechanism) and of the bound, of scenes without crushing, effective
    areas, cohesion of dry faces or friction of inner ones:

    - `lowest_proven`: no solution with λ ≥ 0 has a smaller λ, by certificates checked in exact arithmetic; None where
      there is none above zero.
    - `lowest_bound`, `bound_tolerance`: the highest bound there is, and how far, relative, it rests on a solver.
    - `proven`: `lowest_bound` is `lowest_proven`. `closed`: it meets `lowest_found` within 1e-6.
    - `floor_route`, `floor_programs`, `floor_seconds`: what was done.
    """
    if associative.status is Status.UNSTABLE:
        return _without_range(proof_of(associative, analysis, None, 0))
    if associative.status is Status.LOCKED:
        scheme = replace(scheme, alpha=0.0)
    side = MultiStartSearch(analysis, labels, scheme, associative)
    unit = analysis.template.scaling.load
    found, floor = side.found, None
    with suppress(DeadlinePassed):  # what was found by then stands
        side.search(enough=enough / unit)
        floor = _floor(analysis, labels, side, seconds if found.low > enough / unit else 0.0)
    lowest, highest = found.lowest, found.highest
    if lowest is None or highest is None:
        none = _without_range(proof_of(associative, analysis, found.best, side.pairs.solves))
        # where time was up before anything was tried, associative friction decides nothing
        return none if found.best is not None else replace(none, status=Status.UNCERTIFIED)
    proof = proof_of(associative, analysis, lowest, side.pairs.solves)
    above = proof_of(associative, analysis, highest, side.pairs.solves)
    options = replace(analysis.options, friction="zero-dilation", effective_area=scheme.effective_area)
    ends = {
        "lowest_found": number(proof.load_factor * unit),
        "highest_found": number(above.load_factor * unit),
        "solutions_found": len(found.loads),
        "highest": _evidence(result_of(analysis.template, labels, options, above, elapsed=0.0)),
        **_of_floor(floor, unit),
    }
    return replace(proof, extra={**proof.extra, **ends})


def _floor(analysis: LimitAnalysis, labels: Bits, side: MultiStartSearch, seconds: float) -> LowerBound | None:
    """The bound; solutions that its relaxations lead to are taken in."""
    found, modes = side.found, side.modes
    if found.lowest is None or not seconds > 0.0 or side.pairs.scheme.effective_area:
        return None
    if side.pairs.base.rough or side.pairs.base.cohesive:
        return None  # its certificates were derived for friction of dry faces alone
    if found.low <= tolerances.GAP * side.pairs.floor:
        return LowerBound(0.0, 0.0, 0.0, closed=True, programs=0, seconds=0.0, route=("a solution at zero",))
    if modes is None:
        return _space_floor(analysis, labels, side, seconds)

    def offer(states: Floats) -> float:
        for state in states[:_TRIED]:
            side.search_from(state[:-1], thorough=False)
        return found.low

    return FloorSearch(analysis, labels, modes, LowerBoundProblem(found.low, seconds, offer)).search()


def _space_floor(analysis: LimitAnalysis, labels: Bits, side: MultiStartSearch, seconds: float) -> LowerBound | None:
    """The same in space, where states of the relaxation often are solutions that no other start leads to."""
    found, modes = side.found, space_modes_of(analysis.template, labels)
    if modes is None:
        return None

    def offer(states: Floats) -> float:
        for state in states[:_TRIED]:
            found.offer(certified(side.pairs, state))
        for state in states[:1]:
            side.search_from(state[:-1], thorough=False)
        return found.low

    return SpaceFloorSearch(analysis, labels, modes, LowerBoundProblem(found.low, seconds, offer)).search()


def _of_floor(floor: LowerBound | None, load: float) -> dict[str, Any]:
    if floor is None:
        none: dict[str, Any] = dict.fromkeys(("lowest_proven", "lowest_bound", "bound_tolerance"))
        return {**none, "proven": False, "closed": False, "floor_route": [], "floor_programs": 0, "floor_seconds": 0.0}
    down = load * (1.0 - 4.0 * np.finfo(float).eps)  # scene units, rounded down
    return {
        "lowest_proven": float(floor.proven * down) if floor.proven > 0.0 else None,
        "lowest_bound": float(floor.bound * down),
        "bound_tolerance": floor.tolerance,
        "proven": floor.proven > 0.0 and floor.tolerance == 0.0,
        "closed": floor.closed,
        "floor_route": list(floor.route),
        "floor_programs": floor.programs,
        "floor_seconds": floor.seconds,
    }


def _without_range(proof: Proof) -> Proof:
    none = {"lowest_found": None, "highest_found": None, "solutions_found": 0, "highest": None}
    return replace(proof, extra={**proof.extra, **none, **_of_floor(None, 1.0)})


def _evidence(result: LimitAnalysisResult) -> dict[str, Any]:
    """What a solution is known by, as in the JSON of a result."""
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
