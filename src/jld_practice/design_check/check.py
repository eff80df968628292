"""Design check of one layout under the worst combination of partial factors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import FIELD_SECONDS, CaseBounds, LimitAnalysisResult, Status, number
from jld_core.limit.force_range import extreme_value
from jld_core.limit.reserve import Reserve, least_share
from jld_core.limit.thrust import ResultantRange, reactions_of_supports
from jld_core.mechanics import require_materials
from jld_core.models import solve_by_fields, solve_rigid
from jld_core.models.by_fields import FieldResult, case_bounds_of, least_by_fields, stands_by
from jld_core.models.crack_models import require_cracks
from jld_core.refinement.cells import crack_cells
from jld_core.scene import Scene
from jld_core.scene.cracks import CellCracks, FieldCracks
from jld_core.scene.design import PartialFactors
from jld_core.scene.design_values import at_design_values
from jld_practice.design_check.anywhere import assess_all, loaded_cases, why_not_anywhere
from jld_practice.design_check.combinations import ROUTE, Combination, at_design_loads, combinations_of
from jld_practice.design_check.parts import worst_parts

LISTED: Final = 8
"""Number of joints and of blocks that a check lists, those nearest to their limit."""

Solution = LimitAnalysisResult | FieldResult
"""Solution of a structure under all its load cases."""


@dataclass(frozen=True)
class CaseCheck:
    """Utilisation of one load case under one combination.

    name: name of the load case; "" for a single load. required: required factor of the case, 1 if the scene states
    none. structure: the structure under the design loads of the case and the combination. bounds: status and bounds of
    λ, the factor of the design live load. stands: True if the structure stands without live load, which may be absent;
    None if undecided. place: (str, float) path of a moving load and distance of its first axle along it; None for other
    cases.
    """

    name: str
    required: float
    combination: Combination
    structure: Assembly
    bounds: CaseBounds
    stands: bool | None
    place: tuple[str, float] | None = None

    @property
    def utilisation(self) -> float:
        """Required factor over λ; 0 for a locked case, inf where permanent loads cannot stand."""
        least, most = self.range
        if least == most or not math.isfinite(self.bounds.load_factor):
            return most
        return self._over(self.bounds.load_factor)

    @property
    def range(self) -> tuple[float, float]:
        """Return the proven bounds of the utilisation: 0 and inf where nothing is proven."""
        if self.bounds.status in (Status.UNSTABLE, Status.FAILED) or self.stands is False:
            return (math.inf if self.bounds.status is not Status.FAILED else 0.0), math.inf
        if self.bounds.status is Status.LOCKED:
            return 0.0, 0.0
        low, high = self.bounds.low, self.bounds.high
        return (self._over(high) if math.isfinite(high) else 0.0), (self._over(low) if math.isfinite(low) else math.inf)

    @property
    def verified(self) -> bool | None:
        """Return True if utilisation ≤ 1 is proven, False if it is refuted, None if neither is."""
        least, most = self.range
        if self.stands is True and most <= 1.0:
            return True
        return False if least > 1.0 else None

    def _over(self, load_factor: float) -> float:
        """Return the required factor over a load factor; inf for one that is not positive."""
        return self.required / load_factor if load_factor > 0.0 else math.inf

    def to_json(self) -> dict[str, Any]:
        """Return the check of the case as plain values; None for infinite and unknown numbers."""
        return {
            "utilisation": number(self.utilisation),
            "utilisation_bracket": [number(end) for end in self.range],
            "verified": self.verified,
            "load_factor": number(self.bounds.load_factor),
            "bracket": [number(self.bounds.low), number(self.bounds.high)],
            "required": self.required,
            "status": str(self.bounds.status),
            "stands_without_live_load": self.stands,
            "combination": vars(self.combination),
        }


@dataclass(frozen=True)
class DesignCheck:
    """Design check of one layout.

    scene: scene with characteristic values. assembly: structure at characteristic values. labels: (m,) labels of the
    structure that is solved, True = dry. factors: partial factors. cases: every load case under its worst combination.
    tried: every load case under each combination. solved: solution of the governing case under its worst combination;
    None for fields. reactions: ranges of the reactions of supports under the design loads of the governing case.
    reserve: state under these loads in which faces use the least share of their capacity. anywhere: every load case
    under its worst combination where blocks may crack anywhere; empty if that is not checked. not_anywhere: why it is
    not: "rigid" without strengths of blocks, "equilibrium" for EQU, or a reason in words; "" if it is.
    """

    scene: Scene
    assembly: Assembly
    labels: Bits
    factors: PartialFactors
    cases: tuple[CaseCheck, ...]
    tried: tuple[tuple[CaseCheck, ...], ...]
    solved: LimitAnalysisResult | None
    reactions: tuple[ResultantRange, ...]
    reserve: Reserve | None
    anywhere: tuple[CaseCheck, ...] = ()
    not_anywhere: str = ""

    @property
    def governing(self) -> CaseCheck:
        """Return the load case of largest utilisation of both crack models, the first of several that are equal."""
        return _worst((*self.cases, *self.anywhere))

    @property
    def as_drawn(self) -> CaseCheck:
        """Return the governing load case by the crack model of the scene."""
        return _worst(self.cases)

    @property
    def if_anywhere(self) -> CaseCheck | None:
        """Return the governing load case where blocks may crack anywhere; None if that is not checked."""
        return _worst(self.anywhere) if self.anywhere else None

    @property
    def verified(self) -> bool | None:
        """Return True if all cases are verified by both crack models, False if one is refuted, else None."""
        found = [one.verified for one in (*self.cases, *self.anywhere)]
        return False if False in found else None if None in found else True


def design_check(
    scene: Scene,
    labels: Bits | None,
    factors: PartialFactors,
    *,
    seconds: float = FIELD_SECONDS,
    states: bool = True,
) -> DesignCheck:
    """Check one layout with partial factors.

    Where blocks may crack, the check by the faces or cells that are drawn is repeated by fields, and both must verify.

    scene: scene with characteristic values, planar or spatial. labels: (m,) labels, True = dry; None for those of the
    scene. factors: partial factors. seconds: time for the bounds of each load case where the scene's blocks crack by
    fields, else of all of them together. states: also compute reactions and the reserves of joints and blocks. Result:
    utilisation of every load case under its worst combination, reactions and reserves. Raises InputError if the scene
    cannot be solved, or its design values contradict one another.
    """
    assembly = build_assembly(scene)
    own = assembly.labels if labels is None else labels
    require_materials(assembly, own, ~own)
    if factors.by_parts and isinstance(scene.cracks, FieldCracks):
        problem = "EN 1990, 6.4.3.1(4) factors parts of the weight one by one, which fields do not"
        raise InputError("cracks", problem, '"faces" or {"kind": "cells"}')
    assembly.strengths(ROUTE)  # refuses criteria, whose parameters have no partial factors
    combinations = combinations_of(assembly, factors)
    structures = _structures(scene, own, factors, combinations)
    tried: list[list[CaseCheck]] = []
    solutions: list[Solution] = []
    for combination, (structure, cells) in zip(combinations, structures, strict=True):
        if factors.by_parts:
            tried.append(_cases_by_parts(structure, cells, factors, combination))
            continue
        solution = _solved(scene, structure, cells, seconds)
        solutions.append(solution)
        tried.append(_cases(structure, cells, combination, solution, seconds))
    by_case = tuple(zip(*tried, strict=True))
    cases = tuple(_worst(one) for one in by_case)
    first = _worst(cases)
    chosen = combinations.index(replace(first.combination, heavier=()))
    cells = structures[chosen][1]
    solved = solve_rigid(first.structure, cells) if factors.by_parts else _of_case(solutions[chosen], first)
    checked = DesignCheck(scene, assembly, cells, factors, cases, by_case, solved, (), None)
    checked = _with_cracks_anywhere(checked, own, combinations, seconds)
    if not states or isinstance(scene.cracks, FieldCracks) or checked.verified is not True:
        return checked
    at_required = first.structure.dead_loads + first.required * first.structure.live_loads
    loaded = replace(first.structure, dead_loads=at_required)
    ranges = tuple(
        ResultantRange(
            one, *(extreme_value(loaded, one.function, cells, greatest=greatest) for greatest in (False, True))
        )
        for one in reactions_of_supports(loaded)
    )
    return replace(checked, reactions=ranges, reserve=least_share(loaded, cells))


def _structures(
    scene: Scene,
    labels: Bits,
    factors: PartialFactors,
    combinations: list[Combination],
) -> list[tuple[Assembly, Bits]]:
    """Return the structure and its labels under each combination, at design values; loads of parts are characteristic.

    labels: (m,) True = dry. Where blocks crack by cells, these are the finer cells. Raises InputError for contradictory
    design values.
    """
    found: dict[float, tuple[Assembly, Bits]] = {}
    structures = []
    for combination in combinations:
        prestress = combination.factors(factors)["prestressing"]
        if prestress not in found:
            design = at_design_values(scene, factors, prestress)
            built = build_assembly(design)
            if len(built.interfaces) != len(labels):
                problem = "the design tension equals the design prestress of a member"
                raise InputError("members", problem, "a larger tension, or other factors")
            require_cracks(built)
            found[prestress] = built, labels
            if isinstance(scene.cracks, CellCracks):
                cells = crack_cells(design, built, scene.cracks.cell)
                found[prestress] = cells.fine, cells.labels(labels)
        structure, own = found[prestress]
        structures.append((structure if factors.by_parts else at_design_loads(structure, factors, combination), own))
    return structures


def _solved(scene: Scene, structure: Assembly, labels: Bits, seconds: float) -> Solution:
    """Solve a structure under all its load cases, by fields where the scene says so."""
    if isinstance(scene.cracks, FieldCracks):
        return solve_by_fields(structure, labels, gap=scene.cracks.gap, seconds=seconds)
    return solve_rigid(structure, labels)


def _cases(
    structure: Assembly, labels: Bits, combination: Combination, solution: Solution, seconds: float
) -> list[CaseCheck]:
    """Return the check of every load case under one combination."""
    names = [case.name for case in structure.cases] or [""]
    places = [case.place for case in structure.cases] or [None]
    found = []
    for k, (name, alone, required) in enumerate(zip(names, structure.by_case, structure.required, strict=True)):
        if isinstance(solution, FieldResult):
            by_fields = list(solution.cases.values())[k]
            bounds = case_bounds_of(by_fields)
            stands = stands_by(by_fields, least_by_fields(alone, labels, by_fields, seconds))
        else:
            one = solution.cases[name] if solution.cases else solution
            bounds, stands = CaseBounds(one.status, *one.bracket, one.load_factor), one.stands_at_zero
        found.append(CaseCheck(name, float(required), combination, alone, bounds, stands, places[k]))
    return found


def _with_cracks_anywhere(
    check: DesignCheck, labels: Bits, combinations: list[Combination], seconds: float
) -> DesignCheck:
    """Add the check by fields to one by faces or cells; labels: (m,) of the joint grid, True = dry."""
    scene, factors = check.scene, check.factors
    if isinstance(scene.cracks, FieldCracks):
        return check
    reason = "equilibrium" if factors.by_parts else why_not_anywhere(scene, check.assembly)
    if reason:
        return replace(check, not_anywhere=reason)
    drawn = scene.model_copy(update={"cracks": "faces"})
    structures = _structures(drawn, labels, factors, combinations)
    loaded = [
        one
        for combination, (structure, own) in zip(combinations, structures, strict=True)
        for one in loaded_cases(structure, own, combination)
    ]
    refuted = check.as_drawn
    if refuted.verified is False:  # how much less the blocks carry is of interest for the governing load alone
        name, combination = refuted.name, refuted.combination
        loaded = [k for k in loaded if (check.cases[k.number].name, k.combination) == (name, combination)]

    nothing = CaseBounds(Status.UNCERTIFIED, math.nan, math.nan, math.nan)
    every: list[CaseCheck] = []
    for one in loaded:
        plain = check.cases[one.number]
        start = CaseCheck(plain.name, one.required, one.combination, one.structure, nothing, None, plain.place)
        every.append(start)

    def assess(k: int, gap: float, patience: float) -> bool | None:
        """Bound one case by fields and keep its check."""
        one, before = loaded[k], every[k]
        result = solve_by_fields(one.structure, one.labels, gap=gap, seconds=patience)
        (found,) = _cases(one.structure, one.labels, one.combination, result, patience)
        every[k] = replace(before, bounds=found.bounds, stands=found.stands)
        return every[k].verified

    def least(k: int) -> float:
        """Return the upper bound over the required factor; what has none comes first."""
        high = every[k].bounds.high
        return high / every[k].required if math.isfinite(high) else -1.0

    assess_all(len(loaded), seconds, assess, least)
    by_case: dict[int, list[CaseCheck]] = {one.number: [] for one in loaded}
    for one, case in zip(loaded, every, strict=True):
        by_case[one.number].append(case)
    return replace(check, anywhere=tuple(_worst(tuple(group)) for group in by_case.values()))


def _cases_by_parts(
    structure: Assembly, labels: Bits, factors: PartialFactors, combination: Combination
) -> list[CaseCheck]:
    """Return the check of every load case under its worst factors of the parts of permanent loads."""
    names = [case.name for case in structure.cases] or [""]
    places = [case.place for case in structure.cases] or [None]
    found = []
    for name, alone, required, place in zip(names, structure.by_case, structure.required, places, strict=True):
        one = worst_parts(alone, labels, factors, combination)
        found.append(CaseCheck(name, float(required), one.combination, one.structure, one.bounds, one.stands, place))
    return found


def _worst(cases: tuple[CaseCheck, ...]) -> CaseCheck:
    """Return the governing case: refuted, else undecided, else of largest utilisation.

    Of several with overlapping bounds it is the first.
    """
    for verdict in (False, None):
        if group := [one for one in cases if one.verified is verdict]:
            break
    else:
        group = list(cases)
    least = max(one.range[0] for one in group)
    return next(one for one in group if one.range[1] >= least)


def _of_case(solution: Solution, case: CaseCheck) -> LimitAnalysisResult | None:
    """Return the solution of one load case, None for fields."""
    if isinstance(solution, FieldResult):
        return None
    return solution.cases[case.name] if solution.cases else solution
