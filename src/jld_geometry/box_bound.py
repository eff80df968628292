"""Upper bound on λ over a box of positions by one mechanism, docs/method.md (11.7)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp
import shapely

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.mechanics import scaling_of
from jld_core.solvers.highs import highs_of
from jld_core.strengths import Route
from jld_geometry.planar_rates import shape_loads
from jld_geometry.vertex_mesh import VertexMesh

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
    """Upper bound on λ over one box of positions.

    value: λ of every position in the box that stands for some λ ≥ 0 is at most this; inf where none was proven, −inf
    where no position stands. velocity: (3·free,) mechanism that proves it, scaled as `BoxProblem`. case: position of
    the load case whose mechanism it is.
    """

    value: float
    velocity: Floats | None
    case: int = 0


class BoxProblem:
    """Bounds on λ of one load case over boxes of up to four parameters.

    Positions are X = X0 + Σ y_j D_j, with the p parameters y and the positions X0 of `mesh`. All faces are dry, without
    cohesion and compressive strength.

    assembly: planar assembly at y = 0, with one load case. labels: (m,) True = dry. mesh: its vertices. directions: (p,
    v, 2) D, the movements of all vertices by each parameter. Raises InputError: a face is inner or has cohesion or
    compressive strength, or a load on an element that changes is neither fixed nor proportional to its volume.
    """

    def __init__(self, assembly: Assembly, labels: Bits, mesh: VertexMesh, directions: Floats) -> None:
        _require_dry(assembly, labels)
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
        """Return the positions (2^p, v, 2) of all vertices at the corners of a box.

        low, high: (p,) bounds on the parameters y, lengths.
        """
        ends = np.array(list(itertools.product(*zip(low.tolist(), high.tolist(), strict=True)))).reshape(-1, len(low))
        return np.asarray(self._mesh.places + np.einsum("cp,pvd->cvd", ends, self._directions))

    def require_valid(self, low: Floats, high: Floats) -> None:
        """Raise ParameterError where a box turns an element over or makes it meet itself.

        Bounds hold for boxes that pass this check alone. low, high: (p,) bounds on the parameters, lengths.
        """
        places, ids = self.corners(low, high), self._assembly.elements.ids
        area, _ = self._bernstein_moments(low, high)
        for element, loop in enumerate(self._mesh.loops):
            outlines = shapely.polygons(places[:, loop])
            turned = area[:, element].min() <= 0.0 or not shapely.is_valid(outlines).all()
            if turned or not shapely.is_ccw(shapely.linearrings(places[:, loop])).all():
                problem = f"its box turns element {ids[element]!r} over, or makes it meet itself"
                raise ParameterError("prove", problem, "a smaller box")

    def _bernstein_moments(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return areas (4^p, n) and first moments (4^p, n, 2) in Bernstein form over a box.

        low, high: (p,) bounds on the parameters, lengths. Moments are about the present centroids. Values in the box
        lie within the convex hull of the rows.
        """
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
        both = np.concatenate([area[..., None], moment], axis=-1).reshape((4,) * count + (len(self._mesh.loops), 3))
        for axis in range(count):
            both = np.moveaxis(np.tensordot(_TO_BERNSTEIN / 6.0, both, axes=(1, axis)), 0, axis)
        both = both.reshape(len(values), len(self._mesh.loops), 3)
        return both[..., 0], both[..., 1:]

    def loads(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Compute the scaled dead and live loads on free elements over a box, in Bernstein form.

        low, high: (p,) bounds on the parameters, lengths. Each result is (4^p, 3·free): force x, force y and moment of
        each free element in turn. The loads at any position in the box lie within the convex hull of the rows.
        """
        area, moment = self._bernstein_moments(low, high)
        free = self._assembly.elements.free
        whole = self._mesh_areas()
        found = []
        for load, by_volume in self._loads:
            fixed = load.copy()
            fixed[:, :2] -= by_volume
            share = by_volume / whole[:, None]
            total = np.broadcast_to(fixed, (len(area), *fixed.shape)).copy()
            total[..., :2] += area[..., None] * share
            total[..., 2] += moment[..., 0] * share[:, 1] - moment[..., 1] * share[:, 0]
            total[..., 2] /= self._length
            found.append(total[:, free].reshape(len(area), -1))
        return found[0] / self._force, found[1] * self.unit / self._force

    def _mesh_areas(self) -> Floats:
        """Return the areas (n,) of elements at y = 0."""
        areas = []
        for loop in self._mesh.loops:
            corner = self._mesh.places[loop] - self._mesh.places[loop[0]]
            after = np.roll(corner, -1, axis=0)
            areas.append(0.5 * float((corner[:, 0] * after[:, 1] - corner[:, 1] * after[:, 0]).sum()))
        return np.array(areas)

    def generators(self, low: Floats, high: Floats) -> tuple[Floats, Floats] | None:
        """Return extreme contact forces on free elements, which generate all forces in a box.

        low, high: (p,) bounds on the parameters, lengths. Both results are (g, 3·free), scaled: the forces, and the
        magnitudes of the terms that each entry sums. The magnitudes bound rounding errors. None where the force
        directions at one face span half a turn.
        """
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
        """Convert scaled velocities of free elements to velocities (n, 3) of all elements.

        velocity: (3·free,) as in `BoxBound`. Rows are (ux, uy, ω) about the centroids, 0 for supports. Their common
        scale is arbitrary.
        """
        found = np.zeros((len(self._row), 3))
        found[self._row >= 0] = velocity.reshape(-1, 3)
        found[:, 2] /= self._length
        return found

    # --- bound ------------------------------------------------------------------------------------------

    def bound(self, low: Floats, high: Floats) -> BoxBound:
        """Return a proven bound on λ, in scene units, of every position in a box.

        It is inf where no mechanism valid in the whole box is found. Check the box by `require_valid` first.
        low, high: (p,) bounds on the parameters, lengths.
        """
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
        value, velocity = self._weighed(answer, forces, sizes, dead, live, len(low))
        return BoxBound(value * self.unit if math.isfinite(value) else value, velocity)

    def _weighed(
        self, velocity: Floats, forces: Floats, sizes: Floats, dead: Floats, live: Floats, parameters: int
    ) -> tuple[float, Floats | None]:
        """Repair a mechanism over a box; return its scaled bound on λ, and the repaired mechanism.

        velocity: (3·free,) mechanism. forces, sizes: (g, 3·free) of `generators`. dead, live: (4^p, 3·free) of `loads`.
        parameters: p. Possible rounding errors count against the proof. The bound is −inf where no position stands;
        (inf, None) if no repair succeeds.
        """
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
                opening = _opening(forces)
                if opening is None:
                    return math.inf, None
            least = forces @ opening - _ROUNDED * (sizes @ abs(opening))
            if least.min() <= 0.0:
                return math.inf, None
            velocity = velocity + 1.1 * float((np.maximum(missing, 0.0) / least).max()) * opening
        return math.inf, None


def _require_dry(assembly: Assembly, labels: Bits) -> None:
    """Raise InputError for faces that are inner, or have more than friction."""
    if not labels.all():
        raise ParameterError("prove", "a bound over a box of positions knows dry joints alone", "no proof")
    assembly.strengths(_ROUTE, labels)  # refuses what it does not know


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
    """Find the mechanism (3·free,) with the least upper bound on λ over a box; unverified.

    forces: (g, 3·free) contact forces, on which it does no negative work. dead, live: (4^p, 3·free) loads. standing:
    find a mechanism under which no position stands instead. None if the solver finds none.
    """
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
    least, most = np.full(count + 1, -np.inf), np.full(count + 1, np.inf)
    least[-1] = -1.0
    return _solved(rows, objective, low, least, most, count)


def _opening(forces: Floats) -> Floats | None:
    """Find velocities (3·free,), at most 1 each, that maximise the least power of all forces.

    forces: (g, 3·free) contact forces. None if the solver fails.
    """
    count = forces.shape[1]
    rows = np.hstack([forces, -np.ones((len(forces), 1))])
    objective = np.append(np.zeros(count), -1.0)
    least, most = np.append(-np.ones(count), 0.0), np.ones(count + 1)
    return _solved(rows, objective, np.zeros(len(forces)), least, most, count)


def _solved(rows: Floats, objective: Floats, low: Floats, least: Floats, most: Floats, count: int) -> Floats | None:
    """Minimise objective·x subject to rows @ x ≥ low and least ≤ x ≤ most.

    rows: (r, c). objective, least, most: (c,). low: (r,). Returns the first `count` values of x; None unless the solver
    reports an optimum.
    """
    high = np.full(len(low), np.inf)
    highs = highs_of(sp.csc_array(rows), objective, low, high, least, most, _HIGHS)
    highs.run()
    if str(highs.modelStatusToString(highs.getModelStatus())) != "Optimal":
        return None
    return np.array(highs.getSolution().col_value)[:count]
