"""Upper bound on λ over a box of positions by one mechanism, docs/method.md (11.7), and its certificate."""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
import scipy.sparse as sp
import shapely

import jld_core
from jld_core import (
    Assembly,
    Bits,
    Floats,
    InputError,
    LimitAnalysisResult,
    ParameterError,
    Route,
    Scene,
    Status,
    build_assembly,
    one_thread,
)
from jld_core.mechanics import scaling_of
from jld_core.models import solve_rigid
from jld_core.scene import move as scene_move
from jld_core.solvers import highs_of
from jld_geometry.boxes import BoxClaim, Leaf, Node, Split, check_boxes, write
from jld_geometry.convex_cells import VertexMesh, vertex_mesh
from jld_geometry.limits import loads_that_move
from jld_geometry.moved_scene import MovedScene
from jld_geometry.spatial_rates import shape_loads
from jld_geometry.variables import Variables, variables_of

_ROUTE: Final = Route("a bound over a box of positions", frozenset({"friction"}))

# Six times the coefficients of a cubic in Bernstein form by its values at 0, 1/3, 2/3 and 1
_TO_BERNSTEIN: Final = np.array(
    [[6.0, 0.0, 0.0, 0.0], [-5.0, 18.0, -9.0, 2.0], [2.0, -9.0, 18.0, -5.0], [0.0, 0.0, 0.0, 6.0]]
)

# Rounding error of a sum of at most some forty products, relative to the sum of their magnitudes
_ROUNDED: Final = 64.0 * float(np.finfo(float).eps)

_GROWTH: Final = 6.0  # largest growth of a rounding error by the conversion to Bernstein form, for each parameter

_REPAIRS: Final = 4  # number of times that an opening motion is added to a mechanism before its box has no bound

# Tolerances of the linear programs; their answers are repaired and weighed
_HIGHS: Final = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


@dataclass(frozen=True)
class BoxBound:
    # λ of every position in the box that stands for some λ ≥ 0 is at most this; inf where none was proven, −inf where
    # no position stands
    value: float
    velocity: Floats | None  # (3·free,) mechanism that proves it, scaled as `BoxProblem`
    case: int = 0  # position of the load case whose mechanism it is


_MORE: Final = 1.1  # factor on the opening that a mechanism lacks: a little more is added


class BoxProblem:
    """Bounds on λ of one planar case of dry faces, over boxes of up to four parameters."""

    def __init__(self, assembly: Assembly, labels: Bits, mesh: VertexMesh, directions: Floats) -> None:
        # positions are X0 + Σ y_j D_j, with the places of the mesh and the directions D (p, v, 2)
        if not labels.all():
            raise ParameterError("prove", "a bound over a box of positions knows dry joints alone", "no proof")
        assembly.strengths(_ROUTE, labels)  # refuses what it does not know
        self._assembly, self._mesh, self._directions = assembly, mesh, directions
        scaling = scaling_of(assembly)
        self.unit = scaling.load
        elements = assembly.elements
        self._row = np.full(len(elements), -1, dtype=np.int64)
        self._row[elements.free] = np.arange(len(elements.free))
        self._length, self._force = assembly.size, scaling.force
        moving = np.asarray(abs(directions).max(axis=(0, 2)) > 0.0)
        changing = np.array([moving[loop].any() for loop in mesh.loops])
        parts = []
        for load, acting in ((assembly.dead, assembly.dead_loads), (assembly.live, assembly.live_loads)):
            by_volume, by_centroid = shape_loads(acting, elements)
            odd = np.flatnonzero(changing & (by_volume != by_centroid).any(axis=1))
            if odd.size:
                name = elements.ids[int(odd[0])]
                problem = f"the load of element {name!r} is not proportional to its volume"
                raise InputError("move", problem, 'weights by density, and forces with "at", on elements that change')
            parts.append((load, by_volume))
        self._loads = parts

    # --- geometry over a box ----------------------------------------------------------------------------

    def corners(self, low: Floats, high: Floats) -> Floats:
        """Return the positions (2^p, v, 2) of all vertices at the corners of a box."""
        ends = np.array(list(itertools.product(*zip(low.tolist(), high.tolist(), strict=True)))).reshape(-1, len(low))
        return np.asarray(self._mesh.places + np.einsum("cp,pvd->cvd", ends, self._directions))

    def require_valid(self, low: Floats, high: Floats) -> None:
        """Raise ParameterError where a box turns an element over or makes it meet itself."""
        # Bounds hold for boxes that pass this check alone.
        places, ids = self.corners(low, high), self._assembly.elements.ids
        area, _ = self._bernstein_moments(low, high)
        for element, loop in enumerate(self._mesh.loops):
            outlines = shapely.polygons(places[:, loop])
            turned = area[:, element].min() <= 0.0 or not shapely.is_valid(outlines).all()
            if turned or not shapely.is_ccw(shapely.linearrings(places[:, loop])).all():
                problem = f"its box turns element {ids[element]!r} over, or makes it meet itself"
                raise ParameterError("prove", problem, "a smaller box")

    def _bernstein_moments(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return areas (4^p, n) and first moments (4^p, n, 2) in Bernstein form over a box."""
        # moments are about the present centroids; values in the box lie within the hull of the rows
        count = len(low)
        shares = np.array(list(itertools.product(*[(0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)] * count))).reshape(-1, count)
        values = low + shares * (high - low)
        places = self._mesh.places + np.einsum("cp,pvd->cvd", values, self._directions)
        area, moment = np.empty((len(values), len(self._mesh.loops))), np.empty((len(values), len(self._mesh.loops), 2))
        for element, loop in enumerate(self._mesh.loops):
            corner = places[:, loop] - self._assembly.elements.centroid[element]
            after = np.roll(corner, -1, axis=1)
            turn = corner[..., 0] * after[..., 1] - corner[..., 1] * after[..., 0]
            area[:, element] = 0.5 * turn.sum(axis=1)
            moment[:, element] = ((corner + after) * turn[..., None]).sum(axis=1) / 6.0
        # area and moments at the points, then as Bernstein coefficients, axis by axis
        moments = np.concatenate([area[..., None], moment], axis=-1).reshape((4,) * count + (len(self._mesh.loops), 3))
        for axis in range(count):
            moments = np.moveaxis(np.tensordot(_TO_BERNSTEIN / 6.0, moments, axes=(1, axis)), 0, axis)
        moments = moments.reshape(len(values), len(self._mesh.loops), 3)
        return moments[..., 0], moments[..., 1:]

    def loads(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Compute scaled dead and live loads on free elements over a box: (4^p, 3·free) in Bernstein form."""
        area, moment = self._bernstein_moments(low, high)
        free = self._assembly.elements.free
        areas = self._mesh_areas()
        dead_and_live = []
        for load, by_volume in self._loads:
            fixed = load.copy()
            fixed[:, :2] -= by_volume
            share = by_volume / areas[:, None]
            total = np.broadcast_to(fixed, (len(area), *fixed.shape)).copy()
            total[..., :2] += area[..., None] * share
            total[..., 2] += moment[..., 0] * share[:, 1] - moment[..., 1] * share[:, 0]
            total[..., 2] /= self._length
            dead_and_live.append(total[:, free].reshape(len(area), -1))
        dead, live = dead_and_live
        return dead / self._force, live * self.unit / self._force

    def _mesh_areas(self) -> Floats:
        areas = []
        for loop in self._mesh.loops:
            corner = self._mesh.places[loop] - self._mesh.places[loop[0]]
            after = np.roll(corner, -1, axis=0)
            areas.append(0.5 * float((corner[:, 0] * after[:, 1] - corner[:, 1] * after[:, 0]).sum()))
        return np.array(areas)

    def generators(self, low: Floats, high: Floats) -> tuple[Floats, Floats] | None:
        """Return forces (g, 3·free) that generate all contact forces in a box, and their magnitudes.

        None where the force directions at one face span half a turn.
        """
        # magnitudes bound the rounding errors
        places = self.corners(low, high)
        faces, elements = self._assembly.interfaces, self._assembly.elements
        friction = self._assembly.strengths(_ROUTE, np.ones_like(self._assembly.labels)).friction
        rows, sizes = [], []
        for face in range(len(faces)):
            ends = places[:, self._mesh.ends[face]]
            edge = np.unique(ends[:, 1] - ends[:, 0], axis=0)
            normal = np.column_stack([edge[:, 1], -edge[:, 0]])
            force = np.concatenate([normal - friction[face] * edge, normal + friction[face] * edge])
            extremes = _extremes(force / np.linalg.norm(force, axis=1)[:, None])
            if extremes is None:
                return None
            force = extremes
            point = np.unique(ends.reshape(-1, 2), axis=0)
            at, along = np.repeat(point, len(force), axis=0), np.tile(force, (len(point), 1))
            row, size = np.zeros((len(at), 3 * len(elements.free))), np.zeros((len(at), 3 * len(elements.free)))
            for element, sign in ((int(faces.a[face]), -1.0), (int(faces.b[face]), 1.0)):
                start = 3 * int(self._row[element])
                if start < 0:
                    continue
                arm = at - elements.centroid[element]
                row[:, start : start + 2] = sign * along
                row[:, start + 2] = sign * (arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0]) / self._length
                size[:, start : start + 2] = 1.0
                size[:, start + 2] = (abs(at).max() + abs(elements.centroid[element]).max()) / self._length * 2.0
            rows.append(row)
            sizes.append(size)
        return np.concatenate(rows), np.concatenate(sizes)

    def motion(self, velocity: Floats) -> Floats:
        """Convert scaled velocities (3·free,) to velocities (n, 3) about the centroids, up to a factor."""
        motion = np.zeros((len(self._row), 3))
        motion[self._row >= 0] = velocity.reshape(-1, 3)
        motion[:, 2] /= self._length
        return motion

    # --- bound ------------------------------------------------------------------------------------------

    def bound(self, low: Floats, high: Floats) -> BoxBound:
        """Return a proven bound on λ, scene units, of every position in a valid box; inf without one."""
        cone = self.generators(low, high)
        if cone is None:
            return BoxBound(math.inf, None)
        forces, sizes = cone
        dead, live = self.loads(low, high)
        answer = _mechanism(forces, dead, live)
        if answer is None:
            answer = _mechanism(forces, dead, live, standing=True)
        if answer is None:
            return BoxBound(math.inf, None)
        value, velocity = self._weigh(answer, forces, sizes, dead, live, len(low))
        return BoxBound(value * self.unit if math.isfinite(value) else value, velocity)

    def _weigh(
        self, velocity: Floats, forces: Floats, sizes: Floats, dead: Floats, live: Floats, parameters: int
    ) -> tuple[float, Floats | None]:
        """Repair a mechanism (3·free,) over a box; return its scaled bound on λ, and the mechanism."""
        # possible rounding errors count against the proof; −inf where no position stands, inf without a repair
        # coordinates far from the origin have lost digits before areas and moments are formed
        growth = _ROUNDED * _GROWTH**parameters * (1.0 + float(abs(self._mesh.places).max()) / self._length)
        opening: Floats | None = None
        for _ in range(_REPAIRS):
            missing = _ROUNDED * (sizes @ abs(velocity)) - forces @ velocity
            if missing.max(initial=-1.0) <= 0.0:
                speed = abs(velocity)
                work = float((live @ velocity - growth * (abs(live).max(axis=0) @ speed)).min())
                weight = float((-(dead @ velocity)).max() + growth * (abs(dead).max(axis=0) @ speed))
                if weight < 0.0 <= work:
                    return -math.inf, velocity
                return (weight / work, velocity) if work > 0.0 else (math.inf, None)
            if opening is None:
                # velocities (3·free,), at most 1 each, that maximise the least power of all contact forces
                count = forces.shape[1]
                rows = np.hstack([forces, -np.ones((len(forces), 1))])
                objective = np.append(np.zeros(count), -1.0)
                least, most = np.append(-np.ones(count), 0.0), np.ones(count + 1)
                opening = _minimise(rows, objective, np.zeros(len(forces)), least, most, count)
                if opening is None:
                    return math.inf, None
            room = forces @ opening - _ROUNDED * (sizes @ abs(opening))
            if room.min() <= 0.0:
                return math.inf, None
            velocity = velocity + _MORE * float((np.maximum(missing, 0.0) / room).max()) * opening
        return math.inf, None


def _extremes(force: Floats) -> Floats | None:
    """Return the two outermost (2, 2) of unit vectors (k, 2); None if they span half a turn."""
    middle = force.sum(axis=0)
    angle = np.arctan2(middle[0] * force[:, 1] - middle[1] * force[:, 0], force @ middle)
    first, last = int(np.argmin(angle)), int(np.argmax(angle))
    # unit vectors within a right angle of their sum span less than half a turn
    if not (force @ middle > 0.0).all() or angle[last] - angle[first] >= np.pi * (1.0 - 1e-9):
        return None
    return force[[first, last]]


def _mechanism(forces: Floats, dead: Floats, live: Floats, *, standing: bool = False) -> Floats | None:
    """Find the mechanism (3·free,) of least bound on λ over a box, by contact forces (g, 3·free); unverified."""
    count = forces.shape[1]
    rows = np.zeros((len(forces) + len(live) + len(dead), count + 1))
    rows[:, :-1] = np.vstack([forces, live, dead])
    low = np.zeros(len(rows))
    first = len(forces) + len(live)
    if standing:
        low[first:] = 1.0
    else:
        low[len(forces) : first] = 1.0
        rows[first:, -1] = 1.0
    objective = np.zeros(count + 1)
    objective[-1] = 0.0 if standing else 1.0
    x_low, x_high = np.full(count + 1, -np.inf), np.full(count + 1, np.inf)
    x_low[-1] = -1.0
    return _minimise(rows, objective, low, x_low, x_high, count)


def _minimise(rows: Floats, objective: Floats, low: Floats, least: Floats, most: Floats, count: int) -> Floats | None:
    """Minimise objective·x subject to rows @ x ≥ low and bounds; return `count` values of x, or None."""
    high = np.full(len(low), np.inf)
    highs = highs_of(sp.csc_array(rows), objective, low, high, least, most, _HIGHS)
    highs.run()
    if str(highs.modelStatusToString(highs.getModelStatus())) != "Optimal":
        return None
    return np.array(highs.getSolution().col_value)[:count]


_WIDE: Final = 0.25  # width of a box along a parameter, over the largest, from which it may be halved there

_MOST: Final = 4  # largest number of parameters of a box

_NARROW: Final = 1e-6  # width of a box, relative to the whole, below which it is not split again


@dataclass
class BoxNode:
    """Node of the tree of a branch and bound over positions."""

    bound: float  # bound on λ of all positions in its box; inf where none was proven, −inf where no position stands
    # (n, 3) velocities (ux, uy, ω) of all elements about their centroids, in a mechanism that proves it
    motion: Floats | None
    case: int  # position of the load case of the mechanism
    # axis, at: parameter along which the box is split, and where; axis −1 for a leaf
    axis: int = -1
    at: float = 0.0
    halves: list[BoxNode] = field(default_factory=list)  # lower and upper half; empty for a leaf


@dataclass(frozen=True)
class ProvenBox:
    """Best geometry in a box of positions, with bounds on λ of all of them."""

    scene: Scene  # scene at the best position found
    before: LimitAnalysisResult  # analysis of the scene as it is
    after: LimitAnalysisResult  # analysis at the best position
    load_factor: float  # proven lower bound on λ at the best position; with load cases the governing factor
    bound: float  # proven upper bound on λ of every position in the box; inf where none was proven
    proven: bool  # True if `load_factor` and `bound` agree within the gap asked for
    gap: float  # relative distance of `load_factor` and `bound`
    boxes: int  # number of boxes bounded
    seconds: float  # time, s
    parameters: Floats  # (p,) best position in the box, lengths from the start
    # low, high: (p,) least and greatest parameters of the box, lengths
    low: Floats
    high: Floats
    places: Floats  # (v, 2) positions of all vertices at the best position
    moved: Floats  # (v, 2) displacements of all vertices from the start
    tree: BoxNode  # tree of boxes with the mechanisms that prove `bound`
    stated: Scene  # scene at the start, with stated interfaces
    directions: Floats  # (p, v, 2) movements of all vertices by each parameter
    centroids: Floats  # (n, 2) points about which the motions of the tree turn, length


class _Search:
    """Branch and bound over the positions of one structure; keeps the best position tried."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits) -> None:
        if assembly.dimension != 2:
            raise ParameterError("prove", "it bounds planar structures alone", "a planar scene")
        assembly.members.refuse("a bound over positions")
        loads_that_move(scene)
        if scene.cracks != "faces":
            raise ParameterError("prove", "it bounds λ of blocks that crack along faces alone", '"cracks": "faces"')
        if assembly.has_low_values:
            raise ParameterError("prove", "it bounds λ at nominal values of materials", "no `robust` layout")
        move = scene.move or scene_move.Move()
        mesh = vertex_mesh(assembly)
        variables = variables_of(assembly, labels, mesh, move, named=True)
        _require_linear(move, variables)
        basis = variables.basis
        jacobian = variables.jacobian(np.zeros(variables.count))
        self.count = basis.shape[1]
        self.directions = np.asarray((jacobian @ basis).T.reshape(self.count, -1, 2))
        self.mesh, self.labels = mesh, labels
        self.moved = MovedScene(scene, assembly, labels, mesh)
        self.problems = [BoxProblem(case, labels, mesh, self.directions) for case in assembly.by_case]
        self.required = assembly.required
        self.boxes = 0
        self.best: tuple[float, Floats, LimitAnalysisResult] | None = None

    def bound(self, low: Floats, high: Floats) -> BoxBound:
        """Bound the governing load factor over a box: the least bound of all load cases."""
        self.boxes += 1
        bounds = [problem.bound(low, high) for problem in self.problems]
        values = [bound.value / factor for bound, factor in zip(bounds, self.required, strict=True)]
        case = int(np.argmin(values))
        return BoxBound(values[case], bounds[case].velocity, case)

    def node(self, bound: BoxBound) -> BoxNode:
        """Make a leaf of the tree from a bound, with the velocities of all elements."""
        motion = None if bound.velocity is None else self.problems[bound.case].motion(bound.velocity)
        return BoxNode(bound.value, motion, bound.case)

    def places(self, parameters: Floats) -> Floats:
        """Return the positions (v, 2) of all vertices at parameters (p,), lengths."""
        return np.asarray(self.mesh.places + np.einsum("p,pvd->vd", parameters, self.directions))

    def try_position(self, parameters: Floats) -> LimitAnalysisResult | None:
        """Analyse the scene at parameters (p,), and keep the position if its λ is the best so far."""
        try:
            assembly = build_assembly(self.moved.at(self.places(parameters)))
        except InputError:
            return None
        result = solve_rigid(assembly, self.labels)
        low = math.inf if result.status is Status.LOCKED else result.bracket[0]
        if result.status in (Status.COLLAPSE, Status.LOCKED) and (self.best is None or low > self.best[0]):
            self.best = (low, parameters, result)
        return result

    def split(self, low: Floats, high: Floats, sides: Floats) -> tuple[int, list[tuple[BoxBound, Floats, Floats]]]:
        """Halve a box where the larger bound of both halves is least; return parameter and halves."""
        # Each half has bound, low and high (p,). sides: (p,) size of the first box.
        choices = []
        width = (high - low) / sides
        for axis in np.flatnonzero(width >= _WIDE * width.max()).tolist():
            middle = 0.5 * (low[axis] + high[axis])
            halves = []
            for start, end in ((low[axis], middle), (middle, high[axis])):
                half_low, half_high = low.copy(), high.copy()
                half_low[axis], half_high[axis] = start, end
                halves.append((self.bound(half_low, half_high), half_low, half_high))
            values = sorted(half[0].value for half in halves)
            choices.append((values[1], values[0], axis, halves))
        return min(choices, key=lambda choice: choice[:3])[2:]


def _require_linear(move: scene_move.Move, variables: Variables) -> None:
    """Raise ParameterError unless positions are linear in few parameters, and λ is the objective."""
    if move.ties == "equal-shapes":
        problem = 'the ties "equal-shapes" are not linear in the positions'
        raise ParameterError("prove", problem, '"mirror-x" or lists of points')
    if move.maximise != "load_factor":
        raise ParameterError("prove", f'it bounds λ, not "{move.maximise}"', '"maximise": "load_factor"')
    if not np.isnan(variables.centre).all():
        raise ParameterError("prove", "vertices on circles do not move along lines", '"along" with directions')
    count = variables.basis.shape[1]
    if count > _MOST:
        problem = f"{count} parameters are too many to bound"
        raise ParameterError("prove", problem, f'at most {_MOST}: name vertices in "along", or tie them')


@one_thread()
def prove_box(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    box: tuple[Floats, Floats] | float,
    *,
    gap: float = 1e-3,
    seconds: float = math.inf,
    progress: Callable[[float, float, int], None] | None = None,
) -> ProvenBox:
    """Find the best geometry in a box of positions, and prove a bound on λ of all of them."""
    # docs/method.md (11.7).
    began = time.perf_counter()
    search = _Search(scene, assembly, labels)
    low, high = _ends(box, search.count)
    for problem in search.problems:
        problem.require_valid(low, high)
    before = search.try_position(np.zeros(search.count)) if ((low <= 0.0) & (high >= 0.0)).all() else None
    before = before or solve_rigid(assembly, labels)
    tree = search.node(search.bound(low, high))
    bound = _branch(search, tree, low, high, gap, began + seconds, progress)
    if search.best is None:
        raise InputError("move", "no position in the box that was tried stands", "another box, or a scene that stands")
    value, parameters, after = search.best
    bound = float(max(bound, value))
    width = _gap(value, bound)
    places = search.places(parameters)
    return ProvenBox(
        scene=search.moved.at(places),
        before=before,
        after=after,
        load_factor=value,
        bound=bound,
        proven=bool(width <= gap),
        gap=width,
        boxes=search.boxes,
        seconds=time.perf_counter() - began,
        parameters=parameters,
        low=low,
        high=high,
        places=places,
        moved=places - search.mesh.places,
        tree=tree,
        stated=search.moved.at(search.mesh.places),
        directions=search.directions,
        centroids=assembly.elements.centroid,
    )


def _ends(box: tuple[Floats, Floats] | float, count: int) -> tuple[Floats, Floats]:
    """Return the ends low and high (p,) of a box; raise ParameterError for a wrong box."""
    if isinstance(box, tuple):
        low, high = (np.asarray(end, dtype=float) for end in box)
        if len(low) != count or len(high) != count:
            problem = f"{len(low)} pairs of ends are given for {count} parameters"
            raise ParameterError("prove", problem, f"{count} pairs low,high, or one length for all")
    else:
        low, high = np.full(count, -float(box)), np.full(count, float(box))
    if not (low < high).all():
        raise ParameterError("prove", "the box has no width", "ends low,high with low < high, or a length above 0")
    return low, high


def _gap(value: float, bound: float) -> float:
    """Return the distance of `bound` from `value`, relative to the larger; 0 if not above."""
    if bound <= value:
        return 0.0
    return math.inf if not math.isfinite(bound) else (bound - value) / max(abs(value), abs(bound))


def _branch(
    search: _Search,
    tree: BoxNode,
    low: Floats,
    high: Floats,
    gap: float,
    deadline: float,
    progress: Callable[[float, float, int], None] | None,
) -> float:
    """Split the box of largest bound until gap or time end; return a bound on all positions."""
    sides = high - low
    heap = [(-tree.bound, 0, low, high, tree)]
    number, closed = 0, -math.inf
    while heap:
        value, _, start, end, node = heap[0]
        best = -math.inf if search.best is None else search.best[0]
        bound = max(-value, closed)
        if progress is not None:
            progress(best, bound, search.boxes)
        if (search.best is not None and _gap(best, bound) <= gap) or time.perf_counter() > deadline:
            return bound
        heapq.heappop(heap)
        search.try_position(0.5 * (start + end))
        if ((end - start) / sides).max() < _NARROW:
            closed = max(closed, -value)
            continue
        node.axis, halves = search.split(start, end, sides)
        node.at = float(halves[1][1][node.axis])
        for half, half_start, half_end in halves:
            # a bound of the whole holds for its parts
            child = search.node(half) if half.value <= node.bound else BoxNode(node.bound, node.motion, node.case)
            node.halves.append(child)
            if child.bound > -math.inf:
                number += 1
                heapq.heappush(heap, (-child.bound, number, half_start, half_end, child))
        node.motion = None  # its halves have their own
    return closed


# Claimed bound above the one of the search, relative: rounding of its sums and of the load factors required
_RELATIVE_SLACK: Final = 1e-9


def box_claim(done: ProvenBox) -> tuple[BoxClaim, list[Node]]:
    """Return the claim of a certificate, its bound raised for rounding, and its nodes, each before its halves."""
    nodes = list(_nodes(done.tree, done))
    places = done.places - done.moved
    directions = tuple(
        tuple(
            (tuple(place.tolist()), tuple(way.tolist())) for place, way in zip(places, motion, strict=True) if way.any()
        )
        for motion in done.directions
    )
    claim = BoxClaim(
        scene=done.stated.model_dump(mode="json", exclude_defaults=True),
        bound=done.bound + _RELATIVE_SLACK * abs(done.bound),
        box=tuple(zip(done.low.tolist(), done.high.tolist(), strict=True)),
        directions=directions,
        parameters=tuple(done.parameters.tolist()),
        load_factor=done.load_factor,
        made_by=f"jld {jld_core.__version__}",
    )
    return claim, nodes


def _nodes(tree: BoxNode, done: ProvenBox) -> list[Node]:
    """Return the nodes of a tree, each before its halves; InputError without a finite bound."""
    nodes: list[Node] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if node.halves:
            nodes.append(Split(node.axis, node.at))
            waiting += node.halves[::-1]
            continue
        if node.motion is None or not math.isfinite(done.bound):
            raise InputError("certificate", "no bound was proven", "a smaller box, or more time")
        nodes.append(_leaf(node, done))
    return nodes


def _leaf(node: BoxNode, done: ProvenBox) -> Leaf:
    """Return the leaf of a certificate for a node with a mechanism, without rounding."""
    # Velocities are about the origin, as integers over a power of two.
    assert node.motion is not None
    exact = {}
    for element, (motion, centre) in enumerate(zip(node.motion.tolist(), done.centroids.tolist(), strict=True)):
        if any(motion):
            ux, uy, turn = (Fraction(value) for value in motion)
            x, y = (Fraction(value) for value in centre)
            exact[element] = (ux + turn * y, uy - turn * x, turn)
    values = [value for velocity in exact.values() for value in velocity]
    digits = max((value.denominator.bit_length() - 1 for value in values), default=0)
    moves = {k: tuple(int(value * (1 << digits)) for value in velocity) for k, velocity in exact.items()}
    return Leaf(node.case, digits, moves)


def write_box_certificate(done: ProvenBox, path: Path) -> None:
    """Write the certificate of a proof over a box of positions, for `jld verify`."""
    claim, nodes = box_claim(done)
    write(path, claim, nodes)


def check_proof(done: ProvenBox) -> tuple[bool | None, float, str]:
    """Check a proof by exact arithmetic: whether it holds, None without one; seconds; and a reason."""
    start = time.perf_counter()
    try:
        claim, nodes = box_claim(done)
    except InputError as error:
        return None, time.perf_counter() - start, error.problem
    try:
        check_boxes(done.stated, claim, nodes)
    except InputError as error:
        return False, time.perf_counter() - start, f"{error.where}: {error.problem}"
    return True, time.perf_counter() - start, ""
