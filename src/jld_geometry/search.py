"""Trust region search for positions of joints, and derivatives of λ by vertices; every point is proven."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, TypedDict, Unpack

import numpy as np
import scipy.sparse as sp

from jld_core import (
    Assembly,
    Bits,
    Bools,
    Floats,
    InputError,
    LimitAnalysis,
    LimitAnalysisResult,
    Route,
    Scene,
    Status,
    build_assembly,
    one_thread,
    parse_scene,
    tolerances,
)
from jld_core import parameters as core_parameters
from jld_core.build import build_robust
from jld_core.limit import face_jumps
from jld_core.models import GeometrySensitivities, SolvedProgram, solve_rigid
from jld_core.program import Template
from jld_core.scene import move
from jld_geometry.convex_cells import VertexMesh, vertex_mesh
from jld_geometry.limits import Limits, SpatialLimits, require_spatial, spatial_variables
from jld_geometry.moved_scene import MovedScene, SpatialMesh, SpatialMovedScene, spatial_mesh
from jld_geometry.spatial_rates import face_rates, length_rates, load_rates, residual_rates, spatial_rates
from jld_geometry.step import Evaluated, Evaluator, Goal, StepAnswer
from jld_geometry.variables import Variables, variables_of

_ROUTE: Final = Route("joints that move")


@dataclass(frozen=True)
class TrustRegion:
    """Parameters of the trust region, lengths relative to the mean edge of the structure."""

    # first, largest, least: radius at the start, largest radius, and radius at which a search ends
    first: float = 0.1
    largest: float = 1.0
    least: float = 1e-6
    accepted: float = 0.1  # share of the predicted gain that a point must keep to be accepted
    good: float = 0.7  # share of the predicted gain above which the radius grows
    # growth, shrinkage: factors on the radius
    growth: float = 2.0
    shrinkage: float = 0.3
    # coarse, gain: predicted gain, relative to the objective, below which a search from one start ends, and below which
    # the best point of all starts is stationary
    coarse: float = 1e-4
    gain: float = 1e-6
    kicks: int = 1  # number of times that a stationary point is tried with other optimal forces
    corrections: int = 0  # largest number of corrections of second order of one step
    points: int = 120  # largest number of points of one search


_RESTORED: Final = 1e-9  # violation of a dimensionless limit that counts as none

_RESTORATIONS: Final = 6  # largest number of Newton steps back into the limits

_STARTING: Final = 0.9  # share of a time limit for starts, where as many are made as it allows

_SHAKE: Final = 0.15  # standard deviation of the variables of further starts, relative to the mean edge


_NEARLY: Final = 0.1  # share of `_RESTORED` from which a limit is held by further steps

_SHAKEN: Final = (1.0, 0.5, 0.25, 0.1)  # shares of a random step, tried in turn


class GeometrySearch:
    """Search for the best positions of the joints of one structure, by variables z (k,)."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits, trust: TrustRegion | None = None) -> None:
        self.move, self.trust = scene.move or move.Move(), trust or TrustRegion()
        robust = assembly.has_low_values
        if robust and self.goal == "friction":
            problem = '"least_friction" has no low values, since friction is what it seeks'
            raise InputError("move.maximise", problem, '"load_factor", or nominal values')
        mesh: VertexMesh | SpatialMesh
        if assembly.dimension == 3:
            require_spatial(assembly, labels, self.move)
            mesh = solid_mesh = spatial_mesh(assembly)
            self.variables: Variables = spatial_variables(assembly, solid_mesh, self.move)
        else:
            mesh = planar_mesh = vertex_mesh(assembly)
            self.variables = variables_of(assembly, labels, planar_mesh, self.move)
        moving = np.zeros(len(mesh.places), dtype=bool)
        moving[self.variables.vertex] = True
        if self.variables.scaled:
            moving |= self.variables.rings != 0.0
        owner, edges = mesh.edges
        free = ~assembly.elements.support[owner]
        # trust region and tolerances are relative to the mean edge of free elements
        self.unit = float(np.linalg.norm(mesh.places[edges[:, 1]] - mesh.places[edges[:, 0]], axis=1)[free].mean())
        limits: Limits | SpatialLimits
        if isinstance(mesh, SpatialMesh):
            limits = SpatialLimits(assembly, labels, mesh, moving, self.move)
            self.moved: MovedScene | SpatialMovedScene = SpatialMovedScene(scene, assembly, labels, mesh, moving)
        else:
            limits = Limits(scene, assembly, labels, mesh, moving, self.move)
            self.moved = MovedScene(scene, assembly, labels, mesh)
        self.evaluator = Evaluator(self.moved, mesh, labels, self.variables, limits, self.unit, robust)
        self.required = assembly.required
        self._friction = float(np.nan_to_num(assembly.strengths(_ROUTE).friction[labels]).max(initial=0.0))

    # --- points -----------------------------------------------------------------------------------------

    @property
    def goal(self) -> Goal:
        """Objective of the programs of steps, from the key "maximise" of the scene."""
        goals: dict[str, Goal] = {"least_friction": "friction", "least_thickness": "thickness"}
        return goals.get(self.move.maximise, "load_factor")

    def evaluate(self, values: Floats, near: Evaluated | None) -> Evaluated | None:
        """Evaluate the objective at variables z with a proof; None where none is found."""
        if self.goal == "friction":
            return self.evaluator.friction(values, 1.0 if near is None else near.friction)
        if self.goal == "thickness":
            return self.evaluator.thickness(values)
        return self.evaluator.load_factor(values, near)

    def value_of(self, point: Evaluated) -> float:
        """Convert an objective to λ, the largest friction coefficient, or the thickness."""
        if self.goal == "friction":
            return -point.objective * self._friction
        return point.objective if self.goal == "load_factor" else -point.objective

    def restored(self, values: Floats) -> Floats | None:
        """Return variables near z that keep all limits and ties, by a few Newton steps, or None."""
        variables, limits = self.variables, self.evaluator.limits
        active = limits.equal.copy()
        for _ in range(_RESTORATIONS):
            present = limits.at(variables.places(values))
            lacks = np.where(limits.equal, abs(present.values), limits.least - present.values)
            active |= lacks > _NEARLY * _RESTORED
            rows = np.flatnonzero(active)
            if lacks.max(initial=0.0) <= _RESTORED:
                return values
            target = np.where(limits.equal, 0.0, limits.least)[rows]
            slopes = (present.rates[rows] @ variables.jacobian(values)).toarray()
            matrix = np.vstack([slopes, variables.ties])
            right = np.concatenate([target - present.values[rows], np.zeros(len(variables.ties))])
            values = values + np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
        return None

    def bounds(self, values: Floats, radius: float) -> tuple[Floats, Floats]:
        """Return bounds low, high (k,) on a step from z by trust region and user's box."""
        low, high = np.full(len(values), -radius), np.full(len(values), radius)
        box = self.move.box
        if box is not None:
            lines = len(self.variables.vertex)  # the thickness of an arch has no box
            low[:lines] = np.maximum(low[:lines], np.minimum(0.0, -box - values[:lines]))
            high[:lines] = np.minimum(high[:lines], np.maximum(0.0, box - values[:lines]))
        return low, high

    # --- search -----------------------------------------------------------------------------------------

    def first(self) -> Evaluated | None:
        """Return the point of the scene as it is, with its proven value, or None."""
        return self.evaluate(np.zeros(self.variables.count), None)

    def standing(self, values: Floats, deadline: float) -> Evaluated | None:
        """Move joints from variables z until the structure stands (phase one), or None."""
        point, radius = self.evaluator.missing(values), self.trust.first * self.unit
        for _ in range(self.trust.points):
            if point is None or radius < self.trust.least * self.unit or time.perf_counter() > deadline:
                return None
            answer = self.evaluator.step(point, *self.bounds(point.values, radius), "slack")
            target = None if answer is None else self.restored(point.values + answer.change)
            new = None if target is None else self.evaluator.missing(target)
            if answer is None or new is None or new.objective <= point.objective:
                radius *= self.trust.shrinkage
                continue
            point, radius = new, min(self.trust.growth * radius, self.trust.largest * self.unit)
            if point.objective > 0.0:
                standing = self.evaluate(point.values, None)
                if standing is not None:
                    return standing
        return None

    def improve(
        self, point: Evaluated, deadline: float, report: Callable[[Evaluated, float, float], None], gain: float
    ) -> tuple[Evaluated, str]:
        """Improve a point until it is "stationary" or "locked", or "time" or "points" are over."""
        # A step is the best of a linear program within a trust region, accepted if it keeps a share of its promise.
        # Derivatives rest on the forces of the point. Where the forces are not unique those found may promise nothing
        # though others would, so a point is called stationary only after `trust.kicks` other choices of forces.
        trust, radius = self.trust, self.trust.first * self.unit
        random, kicks = np.random.default_rng(0), 0
        for _ in range(trust.points):
            if point.locked:
                return point, "locked"
            if time.perf_counter() > deadline:
                return point, "time"
            new, predicted = self._try(point, radius)
            promise = predicted - point.objective
            if not promise > gain * abs(point.objective) or radius < trust.least * self.unit:
                if kicks == trust.kicks or self.goal != "load_factor":
                    return point, "stationary"
                kicks += 1
                point, radius = self._with_other_forces(point, random), trust.first * self.unit
                continue
            if new is None or not new.objective - point.objective > trust.accepted * promise:
                radius *= trust.shrinkage
                continue
            if new.objective - point.objective > trust.good * promise:
                radius = min(trust.growth * radius, trust.largest * self.unit)
            point = new
            report(point, predicted, radius)
        return point, "points"

    def _try(self, point: Evaluated, radius: float) -> tuple[Evaluated | None, float]:
        """Take one step; return the best point found or None, and the predicted objective."""
        low, high = self.bounds(point.values, radius)
        answer = self.evaluator.step(point, low, high, self.goal)
        if answer is None:
            return None, math.inf
        predicted = self._predicted(point, answer)
        needed = point.objective + self.trust.accepted * (predicted - point.objective)
        best: Evaluated | None = None
        trial = point
        for _ in range(1 + self.trust.corrections):
            target = self.restored(trial.values + answer.change)
            if target is None:
                break
            new = self.evaluate(target, self.evaluator.with_forces(point, answer))
            if new is not None and (best is None or new.objective > best.objective):
                best = new
            if self.goal != "load_factor" or (best is not None and best.objective >= needed):
                break
            frozen = self.evaluator.frozen(target, answer, trial.states)
            if frozen is None:
                break
            trial = frozen
            corrected = self.evaluator.step(trial, low + point.values - target, high + point.values - target, self.goal)
            if corrected is None:
                break
            answer = corrected
        return best, predicted

    def _predicted(self, point: Evaluated, answer: StepAnswer) -> float:
        if self.goal == "friction":
            return -point.friction * (1.0 + answer.value)
        if self.goal == "thickness":
            return point.objective - float(answer.change[-1])
        return answer.value

    def _with_other_forces(self, point: Evaluated, random: np.random.Generator) -> Evaluated:
        """Return a point with other, randomly chosen optimal forces, to look for an ascent."""
        still = np.zeros(self.variables.count)
        objective = random.normal(size=point.states[0].forces.size)
        answer = self.evaluator.step(point, still, still, self.goal, objective)
        if answer is None:
            return point
        states = [replace(state, forces=forces) for state, forces in zip(point.states, answer.forces, strict=True)]
        return replace(point, states=states)

    def shaken(self, number: int, best: Floats | None) -> Floats | None:
        """Draw random variables z for a further start, around `best` for odd numbers; or None."""
        random = np.random.default_rng(number)
        basis = self.variables.basis
        step = basis @ random.normal(size=basis.shape[1]) * _SHAKE * self.unit
        if self.variables.scaled:
            step[-1] = 0.0
        centre = np.zeros(len(step)) if best is None or number % 2 == 0 else best
        low, high = self.bounds(np.zeros(len(step)), math.inf)
        for share in _SHAKEN:
            moved = centre + share * step
            values = self.restored(np.clip(moved, low, high))
            if values is not None and self.evaluator.assembly(values) is not None:
                return values
        return None


@dataclass(frozen=True)
class Point:
    start: int  # number of the start, from 0
    step: int  # number of the point within its search; 0 is the start itself
    value: float  # λ, least friction coefficient factor, or least thickness
    bracket: tuple[float, float]  # proven bounds on λ; NaN where λ is not the objective or not bounded
    predicted: float  # value that the program of the step promised
    radius: float  # radius of the trust region, length
    solves: int  # number of proven solves so far
    seconds: float  # time since the search began, s


class MoveOptions(TypedDict, total=False):
    """Options that every optimisation of joints takes by keyword."""

    seconds: float  # time limit, s. The point in work is finished. Default: none.
    starts: int | None  # the scene itself, and shaken ones; None: as many as the time allows. Default: 1.
    trust: TrustRegion | None  # parameters of the search. Default: those of `TrustRegion`.
    progress: Callable[[Point], None] | None  # called with every accepted point. Default: none.


class MoveRun:
    """Starts of an optimisation under one time limit, and the record of their points."""

    def __init__(
        self,
        *,
        seconds: float = math.inf,
        starts: int | None = 1,
        trust: TrustRegion | None = None,
        progress: Callable[[Point], None] | None = None,
    ) -> None:
        self._began, self._progress = time.perf_counter(), progress
        # without a limit, as many as the time allows would never end
        self._starts = starts if starts is not None or seconds < math.inf else 1
        self.deadline, self.trust, self.watched = self._began + seconds, trust, progress is not None
        self.until = self._began + (_STARTING if starts is None else 1.0) * seconds
        self.points: list[Point] = []
        self.best: Floats | None = None
        self._taken: Counter[int] = Counter()

    def each_start(self, search: GeometrySearch) -> Iterator[tuple[int, Floats | None]]:
        """Yield number and variables (k,), None where none was found, of each start in time."""
        for number in itertools.count() if self._starts is None else range(self._starts):
            if number and time.perf_counter() > self.until:
                return
            yield number, np.zeros(search.variables.count) if number == 0 else search.shaken(number, self.best)

    def record(
        self, start: int, value: float, bracket: tuple[float, float], predicted: float, radius: float, solves: int
    ) -> None:
        spent = time.perf_counter() - self._began
        point = Point(start, self._taken[start], value, bracket, predicted, radius, solves, spent)
        self._taken[start] += 1
        self.points.append(point)
        if self._progress is not None:
            self._progress(point)


@dataclass(frozen=True)
class MovedJoints:
    scene: Scene  # scene with the joints at the best positions found
    # before, after: analyses at start and end; None where the start does not stand
    before: LimitAnalysisResult | None
    after: LimitAnalysisResult | None
    objective: str  # the objective, as in the key "maximise"
    # start, value: objective at start and end; NaN for a start that does not stand, inf for a locked end
    start: float
    value: float
    # why the best search ended: "stationary", "locked", "time", "points", or "interrupted" by KeyboardInterrupt
    end: str
    points: list[Point]  # all accepted points of all starts
    places: Floats  # (v, d) positions of the vertices at the end
    moved: Floats  # (v, d) displacement of each vertex from the start, scene units
    parameters: int  # number of independent variables
    warnings: list[str] = field(default_factory=list)  # reservations about the value, one line each


@one_thread()
def move_joints(scene: Scene, assembly: Assembly, labels: Bits, **options: Unpack[MoveOptions]) -> MovedJoints:
    """Move joints to optimise the objective of the key "move", docs/method.md (11.6).

    An interrupt after the first accepted point ends the search with the best so far.
    """
    # The objective is the largest λ, or the least friction or thickness at which the dead load stands. docs/method.md
    # (11.6).
    run = MoveRun(**options)
    search = GeometrySearch(scene, assembly, labels, run.trust)
    before = search.first()
    best_so_far: list[Evaluated] = []  # the strongest point, for an interrupt; empty without any
    try:
        best = _best_of_starts(search, before, run, best_so_far)
    except KeyboardInterrupt:
        if not best_so_far:
            raise
        best = best_so_far[0], "interrupted"
    return moved_result(search, before, best, run.points)


def _best_of_starts(
    search: GeometrySearch, before: Evaluated | None, run: MoveRun, best_so_far: list[Evaluated]
) -> tuple[Evaluated, str]:
    """Optimise from every start, then from the best end; return best point and reason."""
    best: Evaluated | None = None

    def report(number: int, point: Evaluated, predicted: float, radius: float) -> None:
        bracket = (math.nan, math.nan) if point.result is None else point.result.bracket
        if search.goal != "load_factor":
            bracket = (math.nan, math.nan)
        if not best_so_far or point.objective > best_so_far[0].objective:
            best_so_far[:] = [point]
        promised = search.value_of(replace(point, objective=predicted))
        run.record(number, search.value_of(point), bracket, promised, radius, search.evaluator.solves)

    for number, start in run.each_start(search):
        first = before if number == 0 else None if start is None else search.evaluate(start, before)
        if first is None and start is not None:
            first = search.standing(start, run.deadline)
        if first is None:
            continue
        report_start = partial(report, number)
        report_start(first, first.objective, search.trust.first * search.unit)
        point, reason = search.improve(first, run.until, report_start, search.trust.coarse)
        # a geometry as strong as one before, up to the width of brackets, is no reason to move farther
        if best is None or point.objective > best.objective + tolerances.GAP * abs(best.objective):
            best, reason_of_best, report_best, run.best = point, reason, report_start, point.values
        if reason == "locked":
            break  # no load is too large: nothing is left to find
    if best is None:
        problem = "it does not stand under its dead load, nor does any position of its joints that was tried"
        raise InputError("move", problem, "a scene that stands, more vertices that move, or more `starts`")
    if reason_of_best == "stationary" or (reason_of_best == "time" and run.until < run.deadline):
        return search.improve(best, run.deadline, report_best, search.trust.gain)
    return best, reason_of_best


def moved_result(
    search: GeometrySearch, before: Evaluated | None, best: tuple[Evaluated, str], points: list[Point]
) -> MovedJoints:
    """Return the result of an optimisation that ended at a point."""
    point, end = best
    places = search.variables.places(point.values)
    scene = search.moved.at(places, point.friction)
    return MovedJoints(
        scene=scene,
        before=None if before is None else before.result,
        after=point.result,
        objective=search.move.maximise,
        start=math.nan if before is None else search.value_of(before),
        value=search.value_of(point),
        end=end,
        points=points,
        places=places,
        moved=places - search.variables.start,
        parameters=search.variables.basis.shape[1],
        warnings=_contacts_found(search, scene, point),
    )


def _contacts_found(search: GeometrySearch, scene: Scene, point: Evaluated) -> list[str]:
    """Return a warning (list of one) if contacts found anew give another λ; else no warning."""
    # Only results with λ as objective, dry joints alone and no strengths of single interfaces are compared.
    result = point.result
    if search.goal != "load_factor" or result is None or result.status is not Status.COLLAPSE:
        return []
    if not search.evaluator.labels.all():
        return []
    document = scene.model_dump(mode="json", exclude_defaults=True)
    if any(set(entry) > {"elements", "polygon", "label"} for entry in document.pop("interfaces")):
        return []  # stated strengths of single interfaces would be lost
    unstated = parse_scene({**document, "labels": {"default": "dry"}})
    solved_again = solve_rigid(
        build_robust(unstated) if result.assembly.has_low_values else build_assembly(unstated)
    ).load_factor
    if abs(solved_again - result.load_factor) <= tolerances.GAP * abs(result.load_factor):
        return []
    return [f"contacts found anew give λ = {solved_again:.6g}: joints touch where none did before, or no longer do"]


_NULL: Final = 1e-8  # singular value, relative to the largest, below which a direction belongs to a null space

# Change of a rate over the optimal forces or mechanisms, relative to the largest rate, that makes a kink possible
_VARIES: Final = 1e-5

# Number of columns of a program up to which kinks are looked for; null spaces are found by dense algebra
_COLUMNS: Final = 900

_ALIKE: Final = 1e-6  # difference of both rates, relative to the largest rate, below which they count as equal


def one_sided(result: LimitAnalysisResult, mesh: VertexMesh, rates: Floats) -> tuple[Floats, Floats]:
    """Compute the rates (2v,) of λ for a decrease and an increase of each coordinate, from `rates` (2v,)."""
    # both are `rates` where forces and mechanism leave them unique, in large programs, and in those with cones
    analysis = LimitAnalysis(result.assembly)
    structure = analysis.template.structure
    if structure.cones or structure.shape[1] > _COLUMNS:
        return rates, rates
    solved = SolvedProgram(analysis, result.labels)
    data = _ProgramRates(analysis.template, solved, mesh)
    left, right = rates.copy(), rates.copy()
    largest = float(abs(rates).max(initial=0.0))
    for column in np.flatnonzero(_may_jump(result, mesh, data, largest)).tolist():
        matrix, rhs = data.of(column)
        low, high = data.scale * solved.side(-matrix, -rhs), -data.scale * solved.side(matrix, rhs)
        if abs(high - low) <= _ALIKE * largest:
            low = high = rates[column] if abs(low - rates[column]) <= _ALIKE * largest else 0.5 * (low + high)
        left[column], right[column] = low, high
    return left, right


class _ProgramRates:
    """Derivatives of the data of one linear program by the coordinates of vertices."""

    def __init__(self, template: Template, solved: SolvedProgram, mesh: VertexMesh) -> None:
        self.template, self.solved, self.mesh = template, solved, mesh
        self.scale = template.scaling.load
        assembly = template.assembly
        unit = np.eye(3)
        self._faces = [face_rates(assembly, mesh, np.tile(unit[j], (len(mesh.ends), 1))) for j in range(3)]
        self._dead = load_rates(assembly, mesh, 0.0).tocsc()
        self._live = (load_rates(assembly, mesh, 1.0) - self._dead).tocsc()
        self._row = template.scaling.row.ravel()
        lengths = length_rates(mesh).tocsc()
        self.of_face = template.yield_set.pattern.row_face
        self._rhs = solved.program.rhs
        self._stretch = sp.diags_array(1.0 / assembly.interfaces.l1) @ lengths

    def of(self, column: int) -> tuple[sp.csr_array, Floats]:
        """Return the derivatives of matrix and right-hand side by one vertex coordinate."""
        structure = self.solved.program.structure
        rows, columns, values = [], [], []
        active = self.template.yield_set.active(self.solved.labels)
        for j, entries in enumerate(self._faces):
            moved = np.flatnonzero((entries.column == column) & active[entries.face, j])
            rows.append(entries.row[moved])
            columns.append(3 * entries.face[moved] + j)
            factor = self.template.scaling.face[entries.face[moved], j] / self._row[entries.row[moved]]
            values.append(factor * entries.value[moved])
        live = self._live[:, [column]].toarray().ravel() * self.template.scaling.load / self._row
        touched = np.flatnonzero(live)
        rows.append(touched)
        columns.append(np.full(len(touched), structure.shape[1] - 1))
        values.append(live[touched])
        located = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        matrix = sp.csr_array(located, shape=structure.shape)
        stretch = np.asarray(self._stretch[:, [column]].todense()).ravel()
        rhs = np.zeros(structure.shape[0])
        rhs[: structure.equalities] = -self._dead[:, [column]].toarray().ravel() / self._row
        first = structure.equalities + 1  # after the row that bounds λ
        rhs[first:] = self._rhs[first:] * stretch[self.of_face]
        return matrix, rhs


def _may_jump(result: LimitAnalysisResult, mesh: VertexMesh, data: _ProgramRates, largest: float) -> Bools:
    """Mark the coordinates (2v,) whose rate of λ varies over optimal forces or multipliers."""
    template, solved = data.template, data.solved
    structure = solved.program.structure
    held = solved.held.copy()
    held[: structure.equalities] = True
    tight = solved.program.matrix.tocsr()[np.flatnonzero(held)].toarray()
    # right null vectors change the optimal forces, left ones the multipliers
    left, values, right = np.linalg.svd(tight)
    rank = int(np.sum(values > _NULL * values.max(initial=1.0)))
    assembly, columns = template.assembly, 3 * len(mesh.ends)
    factor = data.scale
    jumps = np.zeros(mesh.places.size, dtype=bool)
    velocity = factor * solved.dual[: structure.equalities] / template.scaling.row.ravel()
    for direction in right[rank:]:
        forces = direction[:columns].reshape(-1, 3) * template.scaling.face
        change = velocity @ (residual_rates(assembly, mesh, forces, 0.0) - load_rates(assembly, mesh, 0.0))
        jumps |= abs(change) > _VARIES * largest * _size(direction, solved.point)
    point = solved.point
    forces = point[:columns].reshape(-1, 3) * template.scaling.face
    rates = residual_rates(assembly, mesh, forces, float(point[-1]) * template.scaling.load)
    lengths = sp.diags_array(1.0 / assembly.interfaces.l1) @ length_rates(mesh)
    for direction in left.T[rank:]:
        dual = np.zeros(len(held))
        dual[held] = direction
        change = -factor * dual[: structure.equalities] / template.scaling.row.ravel() @ rates
        worth = dual[structure.equalities + 1 :] * solved.program.rhs[structure.equalities + 1 :]
        change = change + factor * np.bincount(data.of_face, weights=worth, minlength=len(mesh.ends)) @ lengths
        jumps |= abs(change) > _VARIES * largest * _size(direction, solved.dual)
    return jumps


def _size(direction: Floats, values: Floats) -> float:
    """Return the Euclidean norm of a direction over the largest absolute entry of `values`."""
    return float(np.linalg.norm(direction)) / max(float(abs(values).max(initial=0.0)), tolerances.ROUNDING)


@core_parameters.typed
@one_thread()
def geometry_sensitivities(result: LimitAnalysisResult, *, one_sided: bool = True) -> GeometrySensitivities | None:
    """Compute the derivatives of the governing λ by the positions of all vertices, or None."""
    core_parameters.require_kind("result", result, LimitAnalysisResult)
    if result.cases:
        names = [case.name for case in result.assembly.cases]
        if result.governing is None or result.status is not Status.COLLAPSE:
            return None
        required = float(result.assembly.required[names.index(result.governing)])
        of_case = geometry_sensitivities(result.cases[result.governing], one_sided=one_sided)
        if of_case is None:
            return None
        rates = (values / required for values in (of_case.derivative, of_case.left, of_case.right))
        return GeometrySensitivities(of_case.vertices, *rates)
    model, assembly = result.model, result.assembly
    is_supported = model.supports_bounds_over_labellings and model.inner_bending == "uncoupled"
    is_supported = is_supported and not assembly.pressed and not assembly.members and assembly.members.bond is None
    if result.status is not Status.COLLAPSE or not is_supported or result.forces is None or result.mechanism is None:
        return None
    if result.assembly.dimension == 3:
        of_vertices = spatial_rates(result, result.forces, result.mechanism)
        return None if of_vertices is None else GeometrySensitivities(of_vertices[0], *[of_vertices[1]] * 3)
    return _planar(result, result.forces, result.mechanism, one_sided)


def _planar(result: LimitAnalysisResult, forces: Floats, mechanism: Floats, sided: bool) -> GeometrySensitivities:
    """Return derivatives of λ by vertices; sided: on either side."""
    assembly = result.assembly
    mesh = vertex_mesh(assembly)
    velocity = mechanism[assembly.elements.free].ravel()
    rates = -(velocity @ residual_rates(assembly, mesh, forces, result.load_factor))
    dissipation = -np.einsum("ij,ij->i", forces, face_jumps(assembly, mechanism))
    rates = rates + (dissipation / assembly.interfaces.l1) @ length_rates(mesh)
    if sided:
        left, right = one_sided(result, mesh, rates)
        derivative = np.where(left == right, left, np.nan)
    else:
        left, right, derivative = np.full_like(rates, np.nan), np.full_like(rates, np.nan), rates
    shape = mesh.places.shape
    return GeometrySensitivities(mesh.places, *(values.reshape(shape) for values in (derivative, left, right)))
