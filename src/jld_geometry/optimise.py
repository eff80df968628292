"""Optimise joints by programs over forces and positions, and derive λ by vertices; every point is proven."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, Unpack

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
from jld_geometry.convex_cells import VertexMesh, vertex_mesh
from jld_geometry.evaluation import Evaluated
from jld_geometry.search import GeometrySearch, MoveOptions, MoveRun, Point
from jld_geometry.spatial_rates import face_rates, length_rates, load_rates, residual_rates, spatial_rates


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
def move_joints(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    **options: Unpack[MoveOptions],
) -> MovedJoints:
    """Move joints to optimise the objective of the key "move", docs/method.md (11.6).

    An interrupt after the first accepted point ends the search with the best so far.
    """
    # The objective is the largest λ, or the least friction or thickness at which the dead load stands. docs/method.md
    # (11.6).
    run = MoveRun(**options)
    search = GeometrySearch(scene, assembly, labels, run.trust)
    before = search.first()
    # the strongest point so far, for an interrupt
    kept: list[Evaluated] = []
    try:
        best = _best_of_starts(search, before, run, kept)
    except KeyboardInterrupt:
        if not kept:
            raise
        best = kept[0], "interrupted"
    return moved_result(search, before, best, run.points)


def _best_of_starts(
    search: GeometrySearch, before: Evaluated | None, run: MoveRun, kept: list[Evaluated]
) -> tuple[Evaluated, str]:
    """Optimise from every start, then from the best end; return best point and reason."""
    best: tuple[Evaluated, str] | None = None  # with the reason of its end

    def report(number: int, point: Evaluated, predicted: float, radius: float) -> None:
        bracket = (math.nan, math.nan) if point.result is None else point.result.bracket
        if search.goal != "load_factor":
            bracket = (math.nan, math.nan)
        if not kept or point.objective > kept[0].objective:
            kept[:] = [point]
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
        end = search.improve(first, run.until, report_start, search.trust.coarse)
        # a geometry as strong as one before, up to the width of brackets, is no reason to move farther
        needed = -math.inf if best is None else best[0].objective + tolerances.GAP * abs(best[0].objective)
        if best is None or end[0].objective > needed:
            best, report_best, run.best = end, report_start, end[0].values
        if end[1] == "locked":
            break  # no load is too large: nothing is left to find
    if best is None:
        problem = "it does not stand under its dead load, nor does any position of its joints that was tried"
        raise InputError("move", problem, "a scene that stands, more vertices that move, or more `starts`")
    if best[1] == "stationary" or (best[1] == "time" and run.until < run.deadline):
        return search.improve(best[0], run.deadline, report_best, search.trust.gain)
    return best


def moved_result(
    search: GeometrySearch, before: Evaluated | None, best: tuple[Evaluated, str], points: list[Point]
) -> MovedJoints:
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
    again = solve_rigid(
        build_robust(unstated) if result.assembly.has_low_values else build_assembly(unstated)
    ).load_factor
    if abs(again - result.load_factor) <= tolerances.GAP * abs(result.load_factor):
        return []
    return [f"contacts found anew give λ = {again:.6g}: joints touch where none did before, or no longer do"]


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
    plain = result.model.supports_bounds_over_labellings and result.model.inner_bending == "uncoupled"
    plain = plain and not result.assembly.pressed and not result.assembly.members
    plain = plain and result.assembly.members.bond is None
    if result.status is not Status.COLLAPSE or not plain or result.forces is None or result.mechanism is None:
        return None
    if result.assembly.dimension == 3:
        of_vertices = spatial_rates(result, result.forces, result.mechanism)
        return None if of_vertices is None else GeometrySensitivities(of_vertices[0], *[of_vertices[1]] * 3)
    return _planar(result, result.forces, result.mechanism, one_sided)


def _planar(result: LimitAnalysisResult, forces: Floats, mechanism: Floats, sided: bool) -> GeometrySensitivities:
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
