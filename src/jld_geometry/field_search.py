"""Search for positions of joints with the largest λ of blocks that may crack anywhere, docs/method.md (11.9)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Unpack

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from jld_core import Assembly, Bits, Floats, InputError, Ints, Scene, one_thread
from jld_core.fields import ConeProgram, ConeSizes, WeakEquilibrium
from jld_core.fields import bounds as fields_bounds
from jld_core.fields import loads as fields_loads
from jld_core.fields import mesh as fields_mesh
from jld_core.fields import problem as fields_problem
from jld_core.models import solve_rigid
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.search import GeometrySearch, MovedJoints, MoveOptions, MoveRun, moved_result
from jld_geometry.step import Evaluated, Region
from jld_geometry.variables import SAME

_ROUNDING: Final = 1e-12  # weights below this count as zero; weights of a node add up to 1


@dataclass(frozen=True)
class FieldMesh:
    """Mesh of one load case whose nodes are affine functions of the vertices of joints."""

    setting: fields_bounds.FieldSetting  # the case at the present positions
    # mesh that every finer one was refined from, at the present positions, scene units. Loads are given over it.
    base: fields_mesh.Mesh
    mesh: fields_mesh.Mesh  # refined mesh at the present positions, scene units
    follow: sp.csr_array  # (b, v) weights by which the b nodes of the base follow the v vertices
    inside: sp.csr_array  # (p, b) weights of the p nodes of the refined mesh in triangles of the base
    loaded: Ints  # (k,) nodes of the base that are ends of loads and no vertices; they follow the loads

    @classmethod
    def of(cls, assembly: Assembly, vertices: VertexMesh) -> FieldMesh:
        # Nodes at a vertex follow it. Ends of loads that lie at no vertex are held with their load, and all other nodes
        # follow their neighbours, so that triangles deform evenly.
        setting = fields_bounds.FieldSetting.of(assembly)
        base, _ = fields_loads.loaded_mesh(assembly)
        distance, nearest = cKDTree(vertices.places).query(base.points)
        nearest = np.asarray(nearest, dtype=np.int64)
        at_vertex = np.flatnonzero(np.asarray(distance) <= SAME * assembly.size)
        ends = _ends(setting.loads.tractions)
        loaded = np.empty(0, dtype=np.int64)
        if len(ends):
            loaded = np.unique(np.asarray(cKDTree(base.points).query(ends)[1], dtype=np.int64))
            loaded = loaded[~np.isin(loaded, at_vertex)]
        follow = _weights(base, at_vertex, nearest[at_vertex], loaded, len(vertices.places))
        return cls(setting, base, setting.coarse, follow, _interpolation(base, setting.coarse), loaded)

    def refined(self, mesh: fields_mesh.Mesh) -> FieldMesh:
        return replace(self, mesh=mesh, inside=_interpolation(self.base, mesh))

    @property
    def motion(self) -> sp.csr_array:
        """(2p, 2v) derivatives of the positions of nodes by those of vertices."""
        return sp.csr_array(sp.kron(self.inside @ self.follow, sp.eye_array(2)))

    def at(self, assembly: Assembly, moved: Floats) -> FieldMesh | None:
        """Return the mesh with vertices moved by (v, 2); None where triangles turn over, or loads lose their faces."""
        old = self.setting
        points = self.base.points + self.follow @ moved
        try:
            segments, others = fields_loads.loaded_segments(assembly)
            before, ends = _ends(old.loads.tractions), _ends(segments)
            if len(ends) != len(before):
                return None
            for node in self.loaded.tolist():
                points[node] = ends[int(np.argmin(np.linalg.norm(before - self.base.points[node], axis=1)))]
            base = replace(self.base, points=points)
            loads = fields_loads.loads_on(assembly, base, segments, others)
        except InputError:  # a place that this search leaves out, as an element that turns over
            return None
        if not _covers(assembly, base):
            return None
        mesh = replace(self.mesh, points=self.inside @ points)
        setting = fields_bounds.FieldSetting(
            assembly, old.material, fields_problem.units_of(assembly, old.material), old.coarse, loads
        )
        return replace(self, setting=setting, base=base, mesh=mesh)


def _ends(tractions: Sequence[object]) -> Floats:
    """Return the ends (k, 2) of the segments among tractions; all are segments in the plane."""
    segments = [traction for traction in tractions if isinstance(traction, fields_loads.Segment)]
    return np.array([end for segment in segments for end in segment.ends]).reshape(-1, 2)


def _covers(assembly: Assembly, mesh: fields_mesh.Mesh) -> bool:
    """Return whether the triangles of each cell have the area of their element."""
    area = np.bincount(mesh.cell, mesh.volume, minlength=len(assembly.elements))
    free = assembly.elements.free
    real = assembly.elements.volume[free] / float(assembly.interfaces.l2[0])
    return bool((abs(area[free] - real) <= SAME * real).all())


def _weights(mesh: fields_mesh.Mesh, placed: Ints, vertex: Ints, loaded: Ints, count: int) -> sp.csr_array:
    """Return weights (c, v) by which nodes of a coarse mesh follow vertices; placed: (k,) nodes at `vertex` (k,)."""
    # ends of loads stay; others on outlines follow the neighbours whose edge they halve, inner ones the mean of theirs
    size = len(mesh.points)
    unique, _ = mesh.side_nodes
    # a node in the middle of an outline edge has two neighbours on the outline, and follows these alone
    edges = mesh.sides
    outer = (edges.b < 0) | (edges.tag >= 0)
    ends = mesh.simplices[edges.a[outer][:, None], edges.corner_a[outer]]
    on_outline = np.zeros(size, dtype=bool)
    on_outline[ends.ravel()] = True
    fixed = np.zeros(size, dtype=bool)
    fixed[placed] = fixed[loaded] = True
    free = np.flatnonzero(~fixed)
    pairs = np.concatenate([unique, unique[:, ::-1]])
    outline_pairs = np.unique(np.sort(ends, axis=1), axis=0)
    along = np.concatenate([outline_pairs, outline_pairs[:, ::-1]])
    inside, outside = ~on_outline[pairs[:, 0]], on_outline[along[:, 0]]
    rows = np.concatenate([pairs[inside], along[outside]])
    length = np.linalg.norm(mesh.points[rows[:, 0]] - mesh.points[rows[:, 1]], axis=1)
    near = sp.csr_array((1.0 / length, rows.T), shape=(size, size))
    total = np.asarray(near.sum(axis=1)).ravel()
    laplace = sp.csr_array(sp.diags_array(1.0 / np.where(total > 0.0, total, 1.0)) @ near)
    weights = sp.csr_array((np.ones(len(placed)), (placed, vertex)), shape=(size, count))
    if not len(free):
        return weights
    inner = sp.csc_matrix(sp.eye_array(len(free)) - laplace[free][:, free])
    of_free = splu(inner).solve((laplace[free] @ weights).toarray())
    of_free[abs(of_free) < _ROUNDING] = 0.0
    spread = sp.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(size, len(free)))
    return sp.csr_array(weights + spread @ sp.csr_array(of_free))


def _interpolation(coarse: fields_mesh.Mesh, mesh: fields_mesh.Mesh) -> sp.csr_array:
    """Return the weights (p, c) of nodes of a mesh in the triangles of its coarser mesh."""
    nodes, first = np.unique(mesh.simplices.ravel(), return_index=True)
    root = mesh.root[first // 3]
    away = mesh.points[nodes][:, None] - coarse.corners[root]
    share = 1.0 + np.einsum("nki,nki->nk", away, coarse.gradient[root])
    share[abs(share) < _ROUNDING] = 0.0
    entries = (share.ravel(), (np.repeat(nodes, 3), coarse.simplices[root].ravel()))
    weights = sp.csr_array(entries, shape=(len(mesh.points), len(coarse.points)))
    weights.eliminate_zeros()
    return weights


# Predicted gain, relative to the objective, below which a point is stationary: meshes are not more exact
_GAIN: Final = 1e-3

_LEAST: Final = 1e-4  # radius of the trust region, relative to the mean edge, below which a point is stationary


@dataclass(frozen=True)
class FieldPoint:
    """Positions of joints with stresses in weak equilibrium for each load case."""

    values: Floats  # (k,) variables z
    objective: float  # governing bound on λ / required from above on the meshes, not proven
    meshes: tuple[FieldMesh, ...]  # mesh of each load case
    forms: tuple[WeakEquilibrium, ...]  # equilibrium of each load case
    stresses: tuple[Floats, ...]  # stresses and λ of each load case, see `WeakEquilibrium`

    @property
    def stands(self) -> bool:
        """True unless the meshes refute that the dead load of some case stands alone."""
        dead = [mesh.setting.assembly.dead for mesh in self.meshes]
        first = [k for k in range(len(dead)) if not any(np.array_equal(dead[k], other) for other in dead[:k])]
        return all(self.forms[k].stands() for k in first)


class FieldSearch:
    """Search over positions of joints for the largest λ of blocks that may crack anywhere."""

    def __init__(self, search: GeometrySearch) -> None:
        # the objective is the upper bound on a coarse mesh, which is nearer to λ than lower bounds there; it proves
        # nothing
        self._search, self._labels = search, search.evaluator.labels
        self.solves = 0

    def start(self, values: Floats, parts: int = 1) -> FieldPoint | None:
        """Return the point at variables z (k,); None if it is invalid or has no stresses."""
        assembly, vertices = self._search.evaluator.assembly(values), self._search.evaluator.mesh(values)
        if assembly is None or not isinstance(vertices, VertexMesh):
            return None
        meshes = [FieldMesh.of(case, vertices) for case in assembly.by_case]
        return self._solved(
            values, assembly, tuple(mesh.refined(fields_mesh.subdivide(mesh.mesh, parts)) for mesh in meshes)
        )

    def _solved(self, values: Floats, assembly: Assembly, meshes: tuple[FieldMesh, ...]) -> FieldPoint | None:
        """Return the point at variables z (k,) on given meshes; None without stresses."""
        forms = tuple(WeakEquilibrium(mesh.setting.problem(mesh.mesh), self._labels) for mesh in meshes)
        stresses, factors = [], []
        for form, required in zip(forms, assembly.required, strict=True):
            self.solves += 1
            solved = form.solve()
            if solved is None or solved[1] <= 0.0:
                return None
            stresses.append(solved[0])
            factors.append(solved[1] * form.problem.units.load / float(required))
        return FieldPoint(values, min(factors), meshes, forms, tuple(stresses))

    def at(self, point: FieldPoint, values: Floats) -> FieldPoint | None:
        """Return the point at other variables z (k,) with the triangles of a point nearby, or None."""
        assembly = self._search.evaluator.assembly(values)
        if assembly is None:
            return None
        places = self._search.variables.places
        moved = places(values) - places(point.values)
        meshes = [one.at(case, moved) for one, case in zip(point.meshes, assembly.by_case, strict=True)]
        usable = tuple(mesh for mesh in meshes if mesh is not None)
        return self._solved(values, assembly, usable) if len(usable) == len(meshes) else None

    def bracket(self, point: FieldPoint) -> tuple[float, float]:
        """Return certified bounds on the governing factor, by the meshes of a point."""
        low, high = [], []
        for mesh, required in zip(point.meshes, self._search.required.tolist(), strict=True):
            bounds = fields_bounds.Fields.on(mesh.setting, mesh.mesh, self._labels).bounds
            low.append(bounds[0] / required)
            high.append(bounds[1] / required)
        return min(low), min(high)

    def step(self, point: FieldPoint, radius: float) -> tuple[Floats, float] | None:
        """Solve the program of a step; return it (k,), lengths, and the objective promised, or None."""
        unit = self._search.unit
        region = self._search.evaluator.region(point.values, *self._search.bounds(point.values, radius))
        step = _program(point, region, self._search.required)
        answer = step.program.solve()
        return (answer.point[step.first : -1] * unit, float(answer.point[-1]) * step.unit) if answer.usable else None

    def improve(
        self, point: FieldPoint, deadline: float, report: Callable[[FieldPoint, float, float], None] | None = None
    ) -> tuple[FieldPoint, str]:
        """Improve a point until it is "stationary", "locked", or "time" or "points" are over."""
        trust, unit = self._search.trust, self._search.unit
        radius, stood, last = trust.first * unit, point.stands, 0.0
        for _ in range(trust.points):
            if point.objective == math.inf:
                return point, "locked"
            began = time.perf_counter()
            if began + last > deadline:
                return point, "time"
            answer = self.step(point, radius)
            promise = -math.inf if answer is None else answer[1] - point.objective
            if answer is None or not promise > _GAIN * abs(point.objective) or radius < _LEAST * unit:
                return point, "stationary"
            target = self._search.restored(point.values + answer[0])
            new = None if target is None else self.at(point, target)
            last = time.perf_counter() - began
            gained = -math.inf if new is None else new.objective - point.objective
            if new is None or not gained > trust.accepted * promise or (stood and not new.stands):
                radius *= trust.shrinkage
                continue
            if gained > trust.good * promise:
                radius = min(trust.growth * radius, trust.largest * unit)
            point = new
            if report is not None:
                report(point, answer[1], radius)
        return point, "points"


@dataclass(frozen=True)
class _Step:
    """Program of a step: columns are stresses and λ of each load case, steps of the variables, and the goal."""

    program: ConeProgram
    first: int  # column of the step of the first variable
    unit: float  # unit of the goal, which is the last column: governing factor of one


class _StepRows:
    """Rows of the program of a step, in three groups: equations, inequalities and cones of three rows."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._groups: list[list[tuple[sp.csr_array, Floats]]] = [[], [], []]

    def equations(self, rows: sp.csr_array, at: int, right: Floats) -> None:
        self._add(0, rows, at, right)

    def inequalities(self, rows: sp.csr_array, at: int, right: Floats) -> None:
        self._add(1, rows, at, right)

    def cones(self, rows: sp.csr_array, at: int, right: Floats) -> None:
        self._add(2, rows, at, right)

    def _add(self, group: int, rows: sp.csr_array, at: int, right: Floats) -> None:
        """Add rows, whose columns begin at column `at` of the program, and their right-hand sides to a group."""
        entries = sp.coo_array(rows)
        shape = (rows.shape[0], self._width)
        self._groups[group].append((sp.csr_array((entries.data, (entries.row, entries.col + at)), shape=shape), right))

    def program(self) -> ConeProgram:
        objective = np.zeros(self._width)
        objective[-1] = -1.0
        matrix = sp.csr_array(sp.vstack([rows for group in self._groups for rows, _ in group]))
        right = np.concatenate([right for group in self._groups for _, right in group])
        equations, inequalities, of_cones = (sum(rows.shape[0] for rows, _ in group) for group in self._groups)
        return ConeProgram(objective, matrix, right, ConeSizes(equations, inequalities, of_cones // 3))


def _program(point: FieldPoint, region: Region, required: Floats) -> _Step:
    """Set up the program of a step within a region; required: (cases,) load factors."""
    count = region.jacobian.shape[1]
    start = np.cumsum([0, *(form.width for form in point.forms)]).tolist()  # first column of each load case
    first_step = start[-1]
    goal_column = first_step + count
    units = [form.problem.units.load / need for form, need in zip(point.forms, required.tolist(), strict=True)]
    rows = _StepRows(goal_column + 1)
    for k, (mesh, form) in enumerate(zip(point.meshes, point.forms, strict=True)):
        fixed = form.rows()
        rates = form.rates(point.stresses[k]) @ mesh.motion @ region.jacobian / form.problem.units.length
        first_inequality = fixed.sizes.zero
        first_cone = first_inequality + fixed.sizes.linear
        between = sp.csr_array((first_inequality, first_step - start[k + 1]))
        moved = sp.hstack([fixed.matrix[:first_inequality], between, rates])
        rows.equations(sp.csr_array(moved), start[k], fixed.right[:first_inequality])
        bounded = slice(first_inequality, first_cone)
        rows.inequalities(fixed.matrix[bounded], start[k], fixed.right[bounded])
        rows.cones(fixed.matrix[first_cone:], start[k], fixed.right[first_cone:])
        # the goal is at most the factor of this case; both in the unit of the first
        load = start[k + 1] - 1
        goal = sp.csr_array(
            ([-units[k] / units[0], 1.0], ([0, 0], [0, goal_column - load])), shape=(1, goal_column - load + 1)
        )
        rows.inequalities(goal, load, np.zeros(1))
    slopes = sp.csr_array(region.limits.rates @ region.jacobian)
    used, values = np.diff(slopes.indptr) > 0, region.limits.values
    equal, bounded_limits = np.flatnonzero(used & region.equal), np.flatnonzero(used & ~region.equal)
    rows.equations(slopes[equal], first_step, -values[equal])
    rows.equations(sp.csr_array(region.ties), first_step, np.zeros(len(region.ties)))
    # a limit that was missed by rounding, or by the curvature of the last step, may stay as it is
    slack = (values - np.minimum(region.least, values))[bounded_limits]
    rows.inequalities(-slopes[bounded_limits], first_step, slack)
    rows.inequalities(sp.csr_array(sp.eye_array(count)), first_step, region.high)
    rows.inequalities(-sp.csr_array(sp.eye_array(count)), first_step, -region.low)
    return _Step(rows.program(), first_step, units[0])


# Parts of each edge of the coarsest meshes, in the order of the search: a coarse optimum begins the finer search
_PARTS: Final = (1, 2)

_FIRST: Final = 0.5  # share of a limited time after which the first mesh is left: the second lies nearer to λ

# Expected time of the first step on the second mesh, over that of one solve on the first: 8 solves, each 6 times
_FINER: Final = 50.0


@one_thread()
def move_by_fields(scene: Scene, assembly: Assembly, labels: Bits, **options: Unpack[MoveOptions]) -> MovedJoints:
    """Move joints to raise λ of blocks that may crack anywhere, docs/method.md (11.9); unproven."""
    # Steps raise the bound by fields from above on a mesh that moves with the blocks. Values and brackets of the points
    # returned are those of these meshes; `before` and `after`, `start` and `value` are λ by faces.
    run = MoveRun(**options)
    _refuse(scene, assembly)
    search = GeometrySearch(scene, assembly, labels, run.trust)
    fields = FieldSearch(search)
    best: tuple[FieldPoint, str] | None = None  # with the reason of its end
    # the last point accepted: finer meshes refute what coarser ones found, so that it is the one to keep
    last: FieldPoint | None = None

    def report(number: int, point: FieldPoint, predicted: float, radius: float) -> None:
        nonlocal last
        last = point
        bracket = fields.bracket(point) if run.watched else (math.nan, math.nan)
        run.record(number, point.objective, bracket, predicted, radius, fields.solves)

    for number, values in run.each_start(search):
        if values is None:
            continue
        try:
            end = _improve(fields, search, values, run.until, partial(report, number))
        except KeyboardInterrupt:
            point = best[0] if best is not None else last
            if point is None:
                raise
            best = point, "interrupted"
            break
        if end is not None and (best is None or end[0].objective > best[0].objective):
            best, run.best = end, end[0].values
    if best is None:
        problem = "blocks that crack anywhere do not stand, nor at any position of joints that was tried"
        raise InputError("move", problem, "a scene that stands, more vertices that move, or more `starts`")
    moved = search.evaluator.assembly(best[0].values)
    result = None if moved is None else solve_rigid(moved, labels)
    before = search.first()
    value = math.nan if result is None else result.load_factor
    return moved_result(search, before, (Evaluated(best[0].values, value, result, []), best[1]), run.points)


def _refuse(scene: Scene, assembly: Assembly) -> None:
    """Raise InputError for what fields do not move."""
    if assembly.dimension != 2:
        raise InputError("cracks", "joints in space move by faces alone", '"faces"')
    if scene.move is not None and scene.move.maximise != "load_factor":
        raise InputError("move.maximise", f'"{scene.move.maximise}" is not supported by fields', '"load_factor"')
    if assembly.has_low_values:
        raise InputError("cracks", "fields take nominal values of materials alone", '"faces", or nominal values')
    fields_problem.require_planar_fields(assembly)


def _improve(
    fields: FieldSearch,
    search: GeometrySearch,
    values: Floats,
    deadline: float,
    report: Callable[[FieldPoint, float, float], None],
) -> tuple[FieldPoint, str] | None:
    """Improve variables z (k,) on coarse, then finer meshes; return last point and reason."""
    # Where blocks do not stand at z, joints first move by faces.
    point = fields.start(values, _PARTS[0])
    if point is None:
        moved = _stood(search, values, deadline)
        point = None if moved is None else fields.start(moved, _PARTS[0])
    if point is None:
        return None
    end, spent = "time", 0.0
    for parts in _PARTS:
        if time.perf_counter() + _FINER * spent > deadline:  # too late for the finer mesh: spend what is left on this
            return (point, end) if end != "time" else fields.improve(point, deadline, report)
        began = time.perf_counter()
        finer = point if parts == _PARTS[0] else fields.start(point.values, parts)
        if finer is None:  # the finer mesh refutes this position: what the coarse one found stands for nothing
            return None
        report(finer, finer.objective, search.trust.first * search.unit)
        now = time.perf_counter()
        until = now + _FIRST * (deadline - now) if parts == _PARTS[0] and deadline < math.inf else deadline
        solves = fields.solves
        point, end = fields.improve(finer, until, report)
        spent = (time.perf_counter() - began) / max(fields.solves - solves, 1)
    return point, end


def _stood(search: GeometrySearch, values: Floats, deadline: float) -> Floats | None:
    """Return variables z (k,) at which the structure stands by faces, found in half the time; or None."""
    now = time.perf_counter()
    until = now + 0.5 * (deadline - now)
    first = search.evaluate(values, None) or search.standing(values, until)
    if first is None:
        return None
    return search.improve(first, until, lambda *_: None, search.trust.coarse)[0].values
