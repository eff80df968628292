"""Design check of one layout under the worst combination of partial factors."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, Final, Literal

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import (
    Assembly,
    Bits,
    Deadline,
    DeadlinePassed,
    Floats,
    InputError,
    LimitAnalysisResult,
    LoadCase,
    Loads,
    Route,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    one_thread,
    parse_scene,
    tolerances,
)
from jld_core.limit import FIELD_SECONDS, CaseBounds, number
from jld_core.mechanics import require_materials
from jld_core.models import by_fields as models_by_fields
from jld_core.models import limit_analysis, require_cracks, solve_by_fields, solve_rigid
from jld_core.program import ConicProgram, Template
from jld_core.refinement import crack_cells
from jld_core.scene import cracks, design, standard, uncertain
from jld_core.scene import design as scene_design
from jld_core.solvers import make_solver
from jld_practice.reactions import reactions_of_supports
from jld_practice.reactions.thrust import Reserve, ResultantRange, extreme_value, least_share
from jld_practice.reliability import LimitFunction, SampleBounds, Variables
from jld_practice.reliability.structure import Growth, RandomStructure

_CAPACITIES: Final = ("tension", "compression", "shear")  # keys of members that their factor divides
LOW_FRACTILE: Final = 0.05  # probability of values below the characteristic one of a strength, EN 1990, 4.2(3)
HIGH_FRACTILE: Final = 0.98
"""Probability of values below the characteristic one of a live load, EN 1990, 4.1.2(7) with note 2."""

SMALL_VARIATION: Final = 0.1
"""Largest coefficient of variation at which permanent actions count by their means, EN 1990, 4.1.2(3) with note."""


def at_design_values(scene: Scene, factors: design.PartialFactors, prestress: float) -> Scene:
    """Return the scene with design values of strengths, friction, capacities and prestress.

    A tendon without a stated capacity keeps its prestress alone.
    """
    # Loads and weights become characteristic values.
    if scene.fill is not None:
        raise InputError("fill", "the design check has no partial factors of soil", "loads in the place of it")
    document = scene.model_dump(mode="json", exclude_defaults=True)
    materials = document.get("materials", {})
    parts = [materials, *materials.get("faces", [])]
    values = [part[key] for part in parts for key in ("dry", "inner") if part.get(key)]
    entries = [
        value.get("criterion", standard.SURFACE)
        for value in values
        if "criterion" in value or standard.SURFACE in value
    ]
    if entries:
        problem = f'the design check has no partial factors of the criterion "{entries[0]}"'
        raise InputError("materials", problem, "standard strengths in place of it")
    for entry in [*values, *document.get("interfaces", [])]:
        for key in standard.STRESS_KEYS:
            _apply(entry, key, lambda value: value / factors.strength)
        for name in ("friction", "inner_friction"):
            _apply(entry, f"{name}_coefficient", lambda value: value / factors.friction)
            _apply(entry, f"{name}_angle", lambda value: _angle(value, factors.friction))
    for member in document.get("members", []):
        for key in _CAPACITIES:
            _apply(member, key, lambda value: value / factors.members)
        _apply(member, "prestress", lambda value: value * prestress)
    _put_loads(document, scene)
    return parse_scene(document, f"the scene at design values of {factors.name}")


def _apply(entry: dict[str, Any], key: str, change: Callable[[float], float]) -> None:
    value = entry.get(key)
    if value is not None:
        entry[key] = change(characteristic(value) if isinstance(value, dict) else value)


def _put_loads(document: dict[str, Any], scene: Scene) -> None:
    """Replace loads and weights with uncertainty by their characteristic values; a permanent action may vary little."""
    for path, value in list(uncertain.uncertain_values(scene)):
        if path[0] not in ("loads", "elements") and path[-1] != "density":
            continue
        size = value.size if isinstance(value, uncertain.UncertainVector) else value
        live = "live" in path or "moving" in path or "pushes" in path
        if not live and size.cov > SMALL_VARIATION:
            problem = f"its coefficient of variation is {size.cov:g}, and EN 1990, 4.1.2(2) asks for two values"
            raise InputError(uncertain.in_words(path), problem, f"at most {SMALL_VARIATION:g}, or a number alone")
        share = fractile(size, HIGH_FRACTILE) / float(size) if live else 1.0
        owner: Any = document
        for key in path[:-1]:
            owner = owner[key]
        owner[path[-1]] = (
            [share * component for component in value]
            if isinstance(value, uncertain.UncertainVector)
            else share * float(value)
        )


def characteristic(value: dict[str, Any]) -> float:
    """Return the characteristic value of a strength, EN 1990, 4.2(3)."""
    if not uncertain.is_uncertain(value):
        return float(value["low"])
    return max(
        0.0, fractile(uncertain.Uncertain(float(value["mean"]), float(value["cov"]), value["kind"]), LOW_FRACTILE)
    )


def fractile(value: uncertain.Uncertain, probability: float) -> float:
    """Return the value whose size is not exceeded with a probability; its sign is that of the mean."""
    score = NormalDist().inv_cdf(probability)
    if value.kind == "normal":
        return float(value) * (1.0 + score * value.cov)
    spread = math.sqrt(math.log1p(value.cov**2))
    return float(value) * math.exp(score * spread - 0.5 * spread**2)


def _angle(degrees: float, factor: float) -> float:
    """Return the angle, degrees, whose tangent is that of an angle over a factor."""
    return math.degrees(math.atan(math.tan(math.radians(degrees)) / factor))


ROUTE: Final = Route("the design check")  # reader of strengths: partial factors are known for the standard ones alone

# which factor of a permanent action counts; "parts" where each of its parts has its own
Effect = Literal["unfavourable", "favourable", "parts"]
_BOTH: Final[tuple[Effect, Effect]] = ("unfavourable", "favourable")

# Stated dead load over all dead load on an element up to which it is rounding of the self-weight
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class Combination:
    # self_weight, dead, prestressing: factors that are taken for self-weight, stated dead loads and prestress
    self_weight: Effect
    dead: Effect
    prestressing: Effect
    # parts of permanent loads with the unfavourable factor, where parts are individual actions; others have the
    # favourable one
    heavier: tuple[str, ...] = ()

    def factors(self, partial: scene_design.PartialFactors) -> dict[str, float]:
        names = ("self_weight", "dead", "prestressing")
        return {name: getattr(partial, name)[getattr(self, name) == "unfavourable"] for name in names}


def combinations_of(assembly: Assembly, factors: scene_design.PartialFactors) -> list[Combination]:
    """Return the combinations that differ for a structure, all actions unfavourable first."""
    # An action that is absent, or whose two factors are equal, is not varied. λ is a concave function of dead loads, so
    # that no factor between both ends gives a smaller λ. Stated dead loads of all load cases are one action.
    cases = assembly.cases or (LoadCase("", assembly.dead_loads, assembly.live_loads),)
    weights = bool(np.any(assembly.elements.weight[assembly.elements.free]))
    has_dead_load = any(_stated_dead_load(assembly, case.dead_loads) for case in cases)
    present = {"self_weight": weights, "dead": has_dead_load, "prestressing": bool(np.any(assembly.members.prestress))}
    if factors.by_parts:
        effects = _BOTH if present["prestressing"] and len(set(factors.prestressing)) > 1 else _BOTH[:1]
        return [Combination("parts", "parts", effect) for effect in effects]
    varied = {name: there and len(set(getattr(factors, name))) > 1 for name, there in present.items()}
    choices = [_BOTH if varied[name] else _BOTH[:1] for name in present]
    return [
        Combination(self_weight, dead, prestressing) for self_weight, dead, prestressing in itertools.product(*choices)
    ]


def at_design_loads(assembly: Assembly, factors: scene_design.PartialFactors, combination: Combination) -> Assembly:
    """Return the assembly under a combination of loads with its partial factors."""
    chosen = combination.factors(factors)

    def dead_of(dead: Loads) -> Loads:
        dead_load = chosen["dead"] * _stated_dead_load(assembly, dead)
        return replace(dead_load, body=dead_load.body + chosen["self_weight"] * _weights(assembly))

    cases = tuple(
        replace(case, dead_loads=dead_of(case.dead_loads), live_loads=factors.live * case.live_loads)
        for case in assembly.cases
    )
    return replace(
        assembly,
        elements=replace(assembly.elements, weight=chosen["self_weight"] * assembly.elements.weight),
        dead_loads=dead_of(assembly.dead_loads),
        live_loads=factors.live * assembly.live_loads,
        cases=cases,
    )


def _weights(assembly: Assembly) -> Floats:
    return np.where(assembly.elements.support[:, None], 0.0, assembly.elements.weight)


def _stated_dead_load(assembly: Assembly, dead: Loads) -> Loads:
    """Return a dead load without self-weight and its rounding errors."""
    weight = _weights(assembly)
    body = dead.body - weight
    body[np.abs(body) <= _ROUNDING * np.abs(weight)] = 0.0
    return replace(dead, body=body)


COARSE: Final = 0.9  # gap of the first bounds of every load case: one mesh
FINER: Final = (0.4, 0.15, 0.05)  # gaps of the bounds of load cases that the first ones leave open, one after the other
_REFUTED: Final = 0.1  # share of the time that may be spent on the utilisation of a case that is refuted anyway
Assess = Callable[[int, float, float], bool | None]  # assess the case of a number to a gap within seconds


@dataclass(frozen=True)
class Loaded:
    """Structure under one load case and one combination, at design values."""

    number: int  # position of the case
    structure: Assembly
    labels: Bits
    required: float  # its required factor
    combination: Combination


def why_not_anywhere(scene: Scene, assembly: Assembly) -> str:
    """Return why cracks anywhere in the blocks are not checked; "" where they are."""
    if scene.materials.inner is None and not any(face.inner for face in scene.materials.faces or []):
        return "rigid"
    try:
        require_cracks(replace(assembly, cracks=cracks.FieldCracks(kind="fields", gap=FINER[-1])))
    except InputError as error:
        return error.problem
    return ""


def assess_all(count: int, seconds: float, assess: Assess, least: Callable[[int], float]) -> None:
    """Assess load cases until each is settled, one is refuted, or the time is over."""
    # assess: whether a case verifies, None if undecided, for a gap and a time, s. least: sort key for refinement.
    end = time.perf_counter() + seconds
    verdicts: dict[int, bool | None] = {}
    for case in range(count):
        if case and time.perf_counter() > end:
            break
        verdicts[case] = assess(case, COARSE, 0.0)
    refuted = [case for case, verdict in verdicts.items() if verdict is False]
    if refuted:
        # The answer is known. Of the worst case, the utilisation is reported: its bounds are refined for a short time.
        refined, share_of_time = [min(refuted, key=least)], _REFUTED
    else:
        refined, share_of_time = sorted((case for case in verdicts if verdicts[case] is None), key=least), 1.0
    for case in refined:
        for gap in FINER:
            seconds_left = end - time.perf_counter()
            if seconds_left <= 0.0:
                return
            verdict = assess(case, gap, min(seconds_left, share_of_time * seconds))
            if verdict is True or (verdict is False and not refuted):
                break
        if verdict is False:
            return


_ALL: Final = 10  # largest number of parts of which all assignments are bounded
_STEPS: Final = 12  # largest number of mechanisms that lead to a bad assignment
_ROUNDS: Final = 6  # rounds in which forces that answer each part follow the room that the last state leaves

# Stated dead load over all dead load on an element up to which it is rounding of the self-weight

_SAFE: Final = 1e-6  # relative share of a lower bound from affine forces that is left for rounding


@dataclass(frozen=True)
class WorstParts:
    """Worst assignment found for one load case, and proven bounds of all assignments."""

    combination: Combination
    structure: Assembly
    bounds: CaseBounds
    stands: bool | None  # True if every assignment stands without live load, False if one does not, None if undecided


def worst_parts(
    structure: Assembly, labels: Bits, factors: scene_design.PartialFactors, combination: Combination
) -> WorstParts:
    """Bound λ of one load case over all assignments of factors to parts of permanent loads."""
    search = _Search(structure, labels, factors, combination)
    all_tried = len(search.names) <= _ALL
    (low, high, worst), stands = search.all_assignments() if all_tried else search.by_mechanisms()
    heavier = tuple(name for name, up in zip(search.names, worst > search.middle, strict=True) if up)
    chosen, loaded = replace(combination, heavier=heavier), search.loaded(worst)
    if low == high == -math.inf:
        return WorstParts(chosen, loaded, CaseBounds(Status.UNSTABLE, math.nan, math.nan, math.nan), stands=False)
    if low == math.inf:
        return WorstParts(chosen, loaded, CaseBounds(Status.LOCKED, math.inf, math.inf, math.nan), stands)
    ends = [end if math.isfinite(end) else math.nan for end in (low, high)]
    status = Status.COLLAPSE if all(map(math.isfinite, ends)) else Status.UNCERTIFIED
    value = solve_rigid(loaded, labels).load_factor
    return WorstParts(chosen, loaded, CaseBounds(status, ends[0], ends[1], value), stands)


def parts_of(
    structure: Assembly, factors: scene_design.PartialFactors
) -> tuple[tuple[str, ...], Floats, Floats, Floats]:
    """Return parts of permanent loads: names (k,), loads (k, n, q), factors (k, 2); and loads beside them (n, q)."""
    # Parts are the weights of free elements, and stated dead loads on elements. Beside them are prestress and loads
    # whose factors are equal.
    elements, stress = structure.elements, structure.members.self_stress
    weight = np.zeros_like(structure.dead)
    weight[elements.free, : structure.dimension] = elements.weight[elements.free]
    dead_loads = structure.dead - weight - (0.0 if stress is None else stress)
    size = np.abs(structure.dead) + np.abs(weight)
    dead_loads[np.abs(dead_loads) <= _ROUNDING * np.maximum(size, size.max(axis=1, keepdims=True))] = 0.0
    names: list[str] = []
    loads, ends, unchanged = [], [], np.zeros_like(weight) if stress is None else np.array(stress)
    for title, load, pair in (("", weight, factors.self_weight), ("dead load on ", dead_loads, factors.dead)):
        if pair[0] == pair[1]:
            unchanged += pair[0] * load
            continue
        for element in np.flatnonzero(load.any(axis=1) & ~elements.support).tolist():
            part = np.zeros_like(load)
            part[element] = load[element]
            names.append(title + elements.ids[element])
            loads.append(part)
            ends.append(pair)
    shape = (len(names), *structure.dead.shape)
    return tuple(names), np.array(loads).reshape(shape), np.array(ends).reshape(-1, 2), unchanged


class _Search:
    """Assignments of one load case; factors (parts,) are values of random variables that its loads follow."""

    def __init__(
        self, structure: Assembly, labels: Bits, factors: scene_design.PartialFactors, combination: Combination
    ) -> None:
        self.labels = labels
        self.names, self.loads, self.ends, self.rest = parts_of(structure, factors)
        self.middle = self.ends.mean(axis=1)
        # live loads at design values; permanent loads follow by parts
        self.base = at_design_loads(structure, factors, combination)

    def loaded(self, values: Floats, direction: float = 1.0) -> Assembly:
        """Return the structure with factors (parts,); direction: −1 to reverse its live load."""
        dead, stress = self.rest + np.tensordot(values, self.loads, 1), self.base.members.self_stress
        loads = Loads.of_resultants(dead if stress is None else dead - stress)
        base = self.base.with_strengths(self.base.strengths(ROUTE))
        return replace(base, dead_loads=loads, live_loads=direction * base.live_loads)

    def bounds(self, direction: float = 1.0) -> SampleBounds:
        """Return bounds on the factor of the live load, or its opposite, for factors of the parts."""
        base, count = self.loaded(self.middle, direction), len(self.names)
        variables = Variables(self.names, self.middle, np.ones(count), np.zeros(count, dtype=bool))
        growths = tuple(Growth((k,), load, np.zeros_like(base.live)) for k, load in enumerate(self.loads))
        return SampleBounds(RandomStructure(base, variables, (), (growths,)), self.labels)

    def all_assignments(self) -> tuple[tuple[float, float, Floats], bool | None]:
        """Return least bounds of all assignments with the worst, and whether all stand without live load."""
        grid = np.array(list(itertools.product(*self.ends))).reshape(2 ** len(self.names), -1)
        forwards, backwards = self.bounds().of(grid), self.bounds(-1.0).of(grid)
        worst = _first_least(np.where(np.isnan(forwards.high), np.inf, forwards.high))
        falls = np.isneginf(backwards.high) | np.isneginf(forwards.high)
        bounded = ~np.isneginf(backwards.low) & ~np.isneginf(forwards.low)
        if falls.any() and not np.isneginf(forwards.high).any():
            worst = int(np.flatnonzero(falls)[0])
        stands = False if falls.any() else True if bounded.all() else None
        return (float(forwards.low.min()), float(forwards.high.min()), grid[worst]), stands

    def by_mechanisms(self) -> tuple[tuple[float, float, Floats], bool | None]:
        """Return a lower bound of all assignments, the least λ of those met, and its assignment."""
        function = LimitFunction(self.bounds(), 1.0)
        best, worst = math.inf, self.ends[:, 1]
        for start in (self.middle, self.ends[:, 0], self.ends[:, 1]):
            values = start
            for _ in range(_STEPS):
                limit = function.at_values(values)
                if np.isin(values, self.ends).all() and _first_least(np.array([best, limit.value])):
                    best, worst = limit.value, values
                if limit.gradient is None:
                    break
                # The power of a part in the mechanism is minus the rate of λ with its factor.
                rate = limit.gradient
                idle = tolerances.GAP * abs(rate).max(initial=0.0)
                following = self.ends[np.arange(len(rate)), np.where(rate < -idle, 1, 0)]
                if np.array_equal(following, values):
                    break
                values = following
        bracket = self.bounds().proven(worst[None])
        back = self.bounds(-1.0).proven(worst[None])
        low, stands = self._affine(), None
        if np.isneginf(bracket.high[0]) or np.isneginf(back.high[0]):
            stands = False
        elif math.isfinite(low) and math.isfinite(self._affine(-1.0)):
            stands = True
        high = float(bracket.high[0])
        return (-math.inf if high == -math.inf else min(low, high), high, worst), stands

    @one_thread()
    def _affine(self, direction: float = 1.0) -> float:
        """Return a factor λ ≥ 0 that affine forces carry under all factors; −inf where none is found."""
        base = self.bounds(direction).structure.assembly
        template = limit_analysis(base, SolveOptions(), reference=self.labels, single_labelling=True).template
        free = base.elements.free
        half = 0.5 * (self.ends[:, 1] - self.ends[:, 0])
        parts = (half[:, None, None] * self.loads[:, free]).reshape(len(half), -1) / template.scaling.row.ravel()
        return template.scaling.load * robust_factor(template, self.labels, parts)


def _first_least(values: Floats) -> int:
    """Return the place of the first value within a bracket of the least: which of those alike is least is rounding."""
    least = values.min()
    return int(np.argmax(values <= (least + tolerances.GAP * abs(least) if np.isfinite(least) else least)))


def robust_factor(template: Template, labels: Bits, parts: Floats) -> float:
    """Return a scaled λ ≥ 0 at which forces affine in ξ carry dead load plus ξ·parts, all |ξ| ≤ 1, or −inf."""
    # parts (k, q·free) are carried by forces of least norm, weighted by the room of faces; yield sets shrink by what
    # these take
    program = template.program(labels)
    resultants, equations = template.matrix.shape[1], program.structure.equalities
    matrix = program.matrix.tocsr()
    equilibrium, rows = matrix[:equations, :resultants], matrix[equations:, :resultants]
    weight, best = np.ones(resultants // template.assembly.freedoms), -math.inf
    for _ in range(_ROUNDS):
        spread = np.repeat(weight**2, template.assembly.freedoms)
        stiffness = sp.csc_array(equilibrium @ sp.diags_array(spread) @ equilibrium.T)
        more = 1e-13 * float(stiffness.diagonal().max()) * sp.eye_array(equations, format="csc")
        system = sp.csc_array(stiffness + more)
        answer = spread[:, None] * (equilibrium.T @ splu(system).solve(np.asfortranarray(-parts.T)))
        if not np.isfinite(answer).all() or abs(equilibrium @ answer + parts.T).max() > _SAFE * abs(parts).max():
            break
        losses = _largest_losses(program, np.asarray(rows @ answer))
        robust = replace(program, rhs=program.rhs - np.concatenate([np.zeros(equations), losses]))
        point = make_solver("clarabel").solve(robust).point
        slack = robust.rhs - robust.matrix @ point
        # the least slack of inequalities and cones of a point; slack: (rows,)
        shape = program.structure
        values = [float(slack[shape.equalities : shape.equalities + shape.linear].min(initial=math.inf))]
        for head, size in zip(shape.heads.tolist(), shape.cones, strict=True):
            values.append(float(slack[head] - np.linalg.norm(slack[head + 1 : head + size])))
        least = min(values)
        if abs(slack[:equations]).max() < _SAFE * abs(program.rhs[:equations]).max() and least > -_SAFE:
            best = max(best, float(point[-1]) - _SAFE * max(1.0, abs(float(point[-1]))))
        # Faces that are pressed, or strong, have room for more.
        weight = np.maximum(
            abs(point[:resultants].reshape(len(weight), -1)[:, 0]), 1e-3 * abs(point[:resultants]).max()
        )
    return best if best >= 0.0 else -math.inf


def _largest_losses(program: ConicProgram, change: Floats) -> Floats:
    """Return what changes (rows, k) of slacks, each of either sign, take of a row at the most."""
    # of a cone the tip must give what its body may grow by
    linear, sizes = program.structure.linear, program.structure.cones
    losses = np.zeros(len(change))
    losses[:linear] = abs(change[:linear]).sum(axis=1)
    first = linear
    for size in sizes:
        tip, body = abs(change[first]), np.linalg.norm(change[first + 1 : first + size], axis=0)
        losses[first] = float((tip + body).sum())
        first += size
    return losses


LISTED: Final = 8  # joints and blocks that a check lists, those nearest to their limit
Solution = LimitAnalysisResult | models_by_fields.FieldResult  # solution of a structure under all its load cases


@dataclass(frozen=True)
class CaseCheck:
    name: str  # name of the load case; "" for a single load
    required: float  # required factor of the case, 1 if the scene states none
    combination: Combination
    structure: Assembly  # the structure under the design loads of the case and the combination
    bounds: CaseBounds  # status and bounds of λ, the factor of the design live load
    stands: bool | None  # True if the structure stands without live load, which may be absent; None if undecided
    # path of a moving load and distance of its first axle along it; None for other cases
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
        """Proven bounds of the utilisation: 0 and inf where nothing is proven."""
        if self.bounds.status in (Status.UNSTABLE, Status.FAILED) or self.stands is False:
            return (math.inf if self.bounds.status is not Status.FAILED else 0.0), math.inf
        if self.bounds.status is Status.LOCKED:
            return 0.0, 0.0
        low, high = self.bounds.low, self.bounds.high
        return (self._over(high) if math.isfinite(high) else 0.0), (self._over(low) if math.isfinite(low) else math.inf)

    @property
    def verified(self) -> bool | None:
        """True if utilisation ≤ 1 is proven, False if it is refuted, else None."""
        least, most = self.range
        if self.stands is True and most <= 1.0:
            return True
        return False if least > 1.0 else None

    def _over(self, load_factor: float) -> float:
        return self.required / load_factor if load_factor > 0.0 else math.inf

    def to_json(self) -> dict[str, Any]:
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
    scene: Scene  # scene with characteristic values
    assembly: Assembly  # structure at characteristic values
    labels: Bits  # (m,) labels of the structure that is solved, True = dry
    factors: scene_design.PartialFactors  # partial factors
    cases: tuple[CaseCheck, ...]  # every load case under its worst combination
    tried: tuple[tuple[CaseCheck, ...], ...]  # every load case under each combination
    solved: LimitAnalysisResult | None  # solution of the governing case under its worst combination; None for fields
    # ranges of the reactions of supports under the design loads of the governing case
    reactions: tuple[ResultantRange, ...]
    reserve: Reserve | None  # state under these loads in which faces use the least share of their capacity
    # every load case under its worst combination where blocks may crack anywhere; empty if that is not checked
    anywhere: tuple[CaseCheck, ...] = ()
    # why it is not: "rigid" without strengths of blocks, "equilibrium" for EQU, or a reason in words; "" if it is
    not_anywhere: str = ""

    @property
    def governing(self) -> CaseCheck:
        """Load case of largest utilisation of both crack models, the first of equal ones."""
        return _worst((*self.cases, *self.anywhere))

    @property
    def as_drawn(self) -> CaseCheck:
        """Governing load case by the crack model of the scene."""
        return _worst(self.cases)

    @property
    def if_anywhere(self) -> CaseCheck | None:
        """Governing load case where blocks may crack anywhere; None if that is not checked."""
        return _worst(self.anywhere) if self.anywhere else None

    @property
    def verified(self) -> bool | None:
        """True if all cases are verified by both crack models, False if one is refuted, else None."""
        verdicts = [case.verified for case in (*self.cases, *self.anywhere)]
        return False if False in verdicts else None if None in verdicts else True


def design_check(
    scene: Scene,
    labels: Bits | None,
    factors: scene_design.PartialFactors,
    *,
    seconds: float = FIELD_SECONDS,
    states: bool = True,
) -> DesignCheck:
    """Check one layout with partial factors, by the scene's labels unless labels (m,) are given."""
    # Where blocks may crack, the check by the faces or cells that are drawn is repeated by fields, and both must
    # verify.
    assembly = build_assembly(scene)
    layout_labels = assembly.labels if labels is None else labels
    require_materials(assembly, layout_labels, ~layout_labels)
    if factors.by_parts and isinstance(scene.cracks, cracks.FieldCracks):
        problem = "EN 1990, 6.4.3.1(4) factors parts of the weight one by one, which fields do not"
        raise InputError("cracks", problem, '"faces" or {"kind": "cells"}')
    assembly.strengths(ROUTE)  # refuses criteria, whose parameters have no partial factors
    combinations = combinations_of(assembly, factors)
    structures = _structures(scene, layout_labels, factors, combinations)
    tried: list[list[CaseCheck]] = []
    solutions: list[Solution] = []
    for combination, (structure, cells) in zip(combinations, structures, strict=True):
        if factors.by_parts:
            tried.append(_cases_by_parts(structure, cells, factors, combination))
            continue
        solution = _solve(scene, structure, cells, seconds)
        solutions.append(solution)
        tried.append(_cases(structure, cells, combination, solution, seconds))
    by_case = tuple(zip(*tried, strict=True))
    cases = tuple(_worst(group) for group in by_case)
    first = _worst(cases)
    chosen = combinations.index(replace(first.combination, heavier=()))
    cells = structures[chosen][1]
    solved = solve_rigid(first.structure, cells) if factors.by_parts else _of_case(solutions[chosen], first)
    checked = DesignCheck(scene, assembly, cells, factors, cases, by_case, solved, (), None)
    checked = _with_cracks_anywhere(checked, layout_labels, combinations, seconds)
    if not states or isinstance(scene.cracks, cracks.FieldCracks) or checked.verified is not True:
        return checked
    at_required = first.structure.dead_loads + first.required * first.structure.live_loads
    loaded = replace(first.structure, dead_loads=at_required)
    ranges = tuple(
        ResultantRange(
            resultant,
            *(extreme_value(loaded, resultant.function, cells, greatest=greatest) for greatest in (False, True)),
        )
        for resultant in reactions_of_supports(loaded)
    )
    return replace(checked, reactions=ranges, reserve=least_share(loaded, cells))


def _structures(
    scene: Scene, labels: Bits, factors: scene_design.PartialFactors, combinations: list[Combination]
) -> list[tuple[Assembly, Bits]]:
    """Return structure and labels under each combination, at design values; loads of parts are characteristic."""
    by_prestress: dict[float, tuple[Assembly, Bits]] = {}
    structures = []
    for combination in combinations:
        prestress = combination.factors(factors)["prestressing"]
        if prestress not in by_prestress:
            design = at_design_values(scene, factors, prestress)
            built = build_assembly(design)
            if len(built.interfaces) != len(labels):
                problem = "the design tension equals the design prestress of a member"
                raise InputError("members", problem, "a larger tension, or other factors")
            require_cracks(built)
            by_prestress[prestress] = built, labels
            if isinstance(scene.cracks, cracks.CellCracks):
                cells = crack_cells(design, built, scene.cracks.cell)
                by_prestress[prestress] = cells.fine, cells.labels(labels)
        structure, labels_built = by_prestress[prestress]
        structures.append(
            (structure if factors.by_parts else at_design_loads(structure, factors, combination), labels_built)
        )
    return structures


_LEAST_SECONDS: Final = 5.0  # for bounds by fields on the first mesh of each load case, however short the time is


def _solve(scene: Scene, structure: Assembly, labels: Bits, seconds: float) -> Solution:
    """Solve a structure under all its load cases, by fields where the scene says so."""
    if isinstance(scene.cracks, cracks.FieldCracks):
        return solve_by_fields(structure, labels, gap=scene.cracks.gap, seconds=seconds)
    return solve_rigid(structure, labels)


def _cases(
    structure: Assembly, labels: Bits, combination: Combination, solution: Solution, seconds: float
) -> list[CaseCheck]:
    names = [case.name for case in structure.cases] or [""]
    positions = [case.place for case in structure.cases] or [None]
    checks = []
    for k, (name, single, required) in enumerate(zip(names, structure.by_case, structure.required, strict=True)):
        if isinstance(solution, models_by_fields.FieldResult):
            by_fields = list(solution.cases.values())[k]
            bounds = models_by_fields.case_bounds_of(by_fields)
            stands = models_by_fields.stands_by(
                by_fields, models_by_fields.least_by_fields(single, labels, by_fields, seconds)
            )
        else:
            result = solution.cases[name] if solution.cases else solution
            bounds, stands = CaseBounds(result.status, *result.bracket, result.load_factor), result.stands_at_zero
        checks.append(CaseCheck(name, float(required), combination, single, bounds, stands, positions[k]))
    return checks


def _with_cracks_anywhere(
    check: DesignCheck, labels: Bits, combinations: list[Combination], seconds: float
) -> DesignCheck:
    """Add the check by fields to one by faces or cells; labels: (m,) of the joint grid."""
    scene, factors = check.scene, check.factors
    if isinstance(scene.cracks, cracks.FieldCracks):
        return check
    reason = "equilibrium" if factors.by_parts else why_not_anywhere(scene, check.assembly)
    if reason:
        return replace(check, not_anywhere=reason)
    uncracked = scene.model_copy(update={"cracks": "faces"})
    structures = _structures(uncracked, labels, factors, combinations)
    loaded: list[Loaded] = []
    for combination, (structure, own_labels) in zip(combinations, structures, strict=True):
        for position, (case, required) in enumerate(zip(structure.by_case, structure.required, strict=True)):
            single = case.with_strengths(case.strengths(ROUTE))
            loaded.append(Loaded(position, single, own_labels, float(required), combination))
    refuted = check.as_drawn
    if refuted.verified is False:  # how much less the blocks carry is of interest for the governing load alone
        name, combination = refuted.name, refuted.combination
        loaded = [k for k in loaded if (check.cases[k.number].name, k.combination) == (name, combination)]

    nothing = CaseBounds(Status.UNCERTIFIED, math.nan, math.nan, math.nan)
    checks: list[CaseCheck] = []
    for loading in loaded:
        drawn_check = check.cases[loading.number]
        start = CaseCheck(
            drawn_check.name, loading.required, loading.combination, loading.structure, nothing, None, drawn_check.place
        )
        checks.append(start)

    def assess(k: int, gap: float, patience: float) -> bool | None:
        """Bound one case by fields and keep its check."""
        loading, before = loaded[k], checks[k]
        result = solve_by_fields(loading.structure, loading.labels, gap=gap, seconds=patience)
        (checked,) = _cases(loading.structure, loading.labels, loading.combination, result, patience)
        checks[k] = replace(before, bounds=checked.bounds, stands=checked.stands)
        return checks[k].verified

    def least(k: int) -> float:
        """Return the upper bound over the required factor; what has none comes first."""
        high = checks[k].bounds.high
        return high / checks[k].required if math.isfinite(high) else -1.0

    # in space the first mesh alone may take minutes
    with suppress(DeadlinePassed), Deadline(max(seconds, _LEAST_SECONDS)).enforced():
        assess_all(len(loaded), seconds, assess, least)
    by_case: dict[int, list[CaseCheck]] = {loading.number: [] for loading in loaded}
    for loading, checks_of in zip(loaded, checks, strict=True):
        by_case[loading.number].append(checks_of)
    return replace(check, anywhere=tuple(_worst(tuple(group)) for group in by_case.values()))


def _cases_by_parts(
    structure: Assembly, labels: Bits, factors: scene_design.PartialFactors, combination: Combination
) -> list[CaseCheck]:
    """Return the check of every load case under its worst factors of the parts of permanent loads."""
    names = [case.name for case in structure.cases] or [""]
    positions = [case.place for case in structure.cases] or [None]
    checks = []
    for name, single, required, position in zip(names, structure.by_case, structure.required, positions, strict=True):
        worst = worst_parts(single, labels, factors, combination)
        checks.append(
            CaseCheck(name, float(required), worst.combination, worst.structure, worst.bounds, worst.stands, position)
        )
    return checks


def _worst(cases: tuple[CaseCheck, ...]) -> CaseCheck:
    """Return the first governing case: refuted, else undecided, else of largest utilisation."""
    for verdict in (False, None):
        if group := [case for case in cases if case.verified is verdict]:
            break
    else:
        group = list(cases)
    least = max(assessment.range[0] for assessment in group)
    # of those alike the first
    return next(assessment for assessment in group if assessment.range[1] >= least * (1.0 - tolerances.GAP))


def _of_case(solution: Solution, case: CaseCheck) -> LimitAnalysisResult | None:
    if isinstance(solution, models_by_fields.FieldResult):
        return None
    return solution.cases[case.name] if solution.cases else solution
