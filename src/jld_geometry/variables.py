"""Variables of a geometry optimisation: sliding vertices, and ties between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import Assembly, Bits, Bools, Floats, InputError, Ints
from jld_core.scene import move as scene_move
from jld_geometry.convex_cells import VertexMesh

SAME: Final = 1e-6  # distance of a stated point from its vertex, and of mirrored vertices, relative to the structure

_STRAIGHT: Final = 1e-6  # sine of the angle between two edges of the outline that form a straight line

_NULL: Final = 1e-9  # entry of a reduced tie below which it counts as zero; ties have entries of order one


@dataclass(frozen=True)
class Variables:
    """Positions of vertices as functions of k variables z, lengths along lines and circles."""

    start: Floats  # (v, d) positions at z = 0, scene units; d = 2, or 3 in space
    vertex: Ints  # (k,) vertex of each variable
    direction: Floats  # (k, d) unit direction of each variable at z = 0
    centre: Floats  # (k, d) centre of its circle; NaN for a line
    ties: Floats  # (t, k) ties between variables: ties @ z = 0
    # (v,) signed distance of each vertex from the middle circle of an arch whose thickness is the last variable. Empty
    # where no thickness is a variable.
    rings: Floats = field(default_factory=lambda: np.empty(0))
    middle: Floats = field(default_factory=lambda: np.zeros(2))  # (2,) centre of that arch
    thickness: float = 0.0  # its thickness at z = 0

    @property
    def count(self) -> int:
        """Number k of variables, with the thickness."""
        return len(self.vertex) + self.scaled

    @property
    def scaled(self) -> bool:
        """True if the last variable is the increase of an arch's thickness."""
        return self.rings.size > 0

    def places(self, values: Floats) -> Floats:
        """Return the positions (v, d) of all vertices, scene units, at variables z (k,)."""
        places = self.start.copy()
        number = len(self.vertex)
        straight = np.isnan(self.centre[:, 0])
        np.add.at(places, self.vertex[straight], values[:number][straight, None] * self.direction[straight])
        for k in np.flatnonzero(~straight).tolist():
            arm = self.start[self.vertex[k]] - self.centre[k]
            radius = float(np.hypot(*arm))
            turn = float(arm[0] * self.direction[k, 1] - arm[1] * self.direction[k, 0])
            angle = np.sign(turn) * values[k] / radius
            cos, sin = np.cos(angle), np.sin(angle)
            places[self.vertex[k]] = self.centre[k] + np.array([[cos, -sin], [sin, cos]]) @ arm
        if self.scaled:
            places += (values[-1] / self.thickness * self.rings)[:, None] * self._radial(places)
        return places

    def _radial(self, places: Floats) -> Floats:
        """Return unit vectors (v, 2) away from the middle of the arch."""
        arm = places - self.middle
        length = np.linalg.norm(arm, axis=1)[:, None]
        return np.asarray(arm / np.where(length > 0.0, length, 1.0))

    def jacobian(self, values: Floats) -> sp.csr_array:
        """Return the derivatives (d·v, k) of the positions by z, at z (k,); row d·vertex + axis."""
        places = self.places(values)
        directions = self.direction.copy()
        for k in np.flatnonzero(~np.isnan(self.centre[:, 0])).tolist():
            arm, first = places[self.vertex[k]] - self.centre[k], self.start[self.vertex[k]] - self.centre[k]
            turn = np.sign(first[0] * self.direction[k, 1] - first[1] * self.direction[k, 0])
            # a scaled arch carries the vertex along a larger or smaller circle
            directions[k] = turn * np.array([-arm[1], arm[0]]) / np.hypot(*first)
        number, axes = len(self.vertex), self.start.shape[1]
        rows = (axes * self.vertex[:, None] + np.arange(axes)).ravel()
        entries = (directions.ravel(), (rows, np.repeat(np.arange(number), axes)))
        matrix = sp.csr_array(entries, shape=(places.size, number))
        if not self.scaled:
            return matrix
        stretch = (self.rings / self.thickness)[:, None] * self._radial(places)
        return sp.csr_array(sp.hstack([matrix, sp.csr_array(stretch.reshape(-1, 1))]))

    @property
    def basis(self) -> Floats:
        """Basis (k, p) of the variables that keep all ties: z = basis @ parameters (p,)."""
        return null_space(self.ties, self.count)


def null_space(rows: Floats, count: int) -> Floats:
    """Return a basis (count, p) of the vectors x with rows (t, count) @ x = 0."""
    # Each column has an entry 1 in a position of its own, where all others are 0. Entries below 1e-9 count as 0.
    matrix = rows.copy()
    pivots: list[int] = []
    for column in range(count - 1, -1, -1):
        rank = len(pivots)
        if rank == len(matrix):
            break
        best = rank + int(np.argmax(abs(matrix[rank:, column])))
        if abs(matrix[best, column]) <= _NULL:
            continue
        matrix[[rank, best]] = matrix[[best, rank]]
        matrix[rank] /= matrix[rank, column]
        others = np.arange(len(matrix)) != rank
        matrix[others] -= np.outer(matrix[others, column], matrix[rank])
        pivots.append(column)
    free = [column for column in range(count) if column not in pivots]
    basis = np.zeros((count, len(free)))
    for k, column in enumerate(free):
        basis[column, k] = 1.0
        for row, pivot in enumerate(pivots):
            basis[pivot, k] = -matrix[row, column]
    return basis


def variables_of(
    assembly: Assembly, labels: Bits, mesh: VertexMesh, move: scene_move.Move, *, named: bool = False
) -> Variables:
    """Find the variables that the key "move" asks for; InputError if they do not fit."""
    finder = _Finder(assembly, labels, mesh, move)
    chosen: list[tuple[int, Floats, Floats]] = finder.named()
    circles = [path for path in move.along if path.circle is not None]
    if move.vertices == "joints" and not (named and chosen):
        chosen += finder.joints(circles, {vertex for vertex, _, _ in chosen})
    elif circles:
        chosen += [
            joint for joint in finder.joints(circles, {vertex for vertex, _, _ in chosen}) if joint[2][0] == joint[2][0]
        ]
    vertex = np.array([entry[0] for entry in chosen], dtype=np.int64)
    direction = np.array([entry[1] for entry in chosen]).reshape(-1, 2)
    centre = np.array([entry[2] for entry in chosen]).reshape(-1, 2)
    variables = Variables(mesh.places, vertex, direction, centre, np.zeros((0, len(vertex))))
    if move.maximise == "least_thickness":
        variables = _with_thickness(variables, assembly, circles)
    ties = np.concatenate([ties_of(variables, assembly, move), _following(variables, mesh, finder.followers)])
    variables = Variables(**{**vars(variables), "ties": ties})
    if not variables.basis.shape[1]:
        problem = "no vertex of a joint can move"
        raise InputError(
            "move", problem, 'dry joints with ends inside the structure or on straight outlines, or "along"'
        )
    return variables


def vertex_at(places: Floats, point: list[float], size: float, where: str) -> int:
    """Return the vertex at a stated point; raise InputError if there is none."""
    if len(point) != places.shape[1]:
        raise InputError(where, f"it has {len(point)} numbers", f"{places.shape[1]} in this scene")
    distance = np.linalg.norm(places - np.array(point, dtype=float), axis=1)
    vertex = int(np.argmin(distance))
    if distance[vertex] > SAME * size:
        raise InputError(where, f"no vertex lies at {point}", f"a vertex; the nearest is {_words(places[vertex])}")
    return vertex


def _words(point: Floats) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in point) + "]"


class _Finder:
    """Search for the vertices that may move, with their directions or circles."""

    def __init__(self, assembly: Assembly, labels: Bits, mesh: VertexMesh, move: scene_move.Move) -> None:
        self._mesh, self._move, self._size = mesh, move, assembly.size
        count = len(mesh.places)
        self._held = np.zeros(count, dtype=bool)
        for element in np.flatnonzero(assembly.elements.support).tolist():
            self._held[mesh.loops[element]] = True
        inner = np.zeros(count, dtype=bool)
        inner[mesh.ends[~labels].ravel()] = True
        self._dry: Bools = np.zeros(count, dtype=bool)
        self._dry[mesh.ends[labels].ravel()] = True
        follow = move.inner == "follow"
        self.followers: Bools = inner & ~self._dry & ~self._held if follow else np.zeros(count, dtype=bool)
        if not follow:
            self._dry &= ~inner
        self._outline = mesh.on_outline
        edges = mesh.edges[1]
        directed = {(int(i), int(j)) for i, j in edges}
        self._before: dict[int, list[int]] = {}
        self._after: dict[int, list[int]] = {}
        for i, j in sorted(directed):
            if (j, i) not in directed:
                self._after.setdefault(i, []).append(j)
                self._before.setdefault(j, []).append(i)

    def named(self) -> list[tuple[int, Floats, Floats]]:
        """Return vertex, unit direction (2,) and centre (NaN) for each vertex that "along" names."""
        paths = []
        for position, path in enumerate(self._move.along):
            if path.at is None or path.direction is None:
                continue
            where = f"move.along[{position}].at"
            vertex = vertex_at(self._mesh.places, path.at, self._size, where)
            if self._held[vertex]:
                raise InputError(where, f"{path.at} is a vertex of a support", "a vertex between free elements")
            if len(path.direction) != 2:
                raise InputError(f"move.along[{position}].direction", "it has 3 numbers", "2 in a planar scene")
            direction = np.array(path.direction, dtype=float)
            paths.append((vertex, direction / np.hypot(*direction), np.full(2, np.nan)))
        return paths

    def joints(self, circles: list[scene_move.Path], named: set[int]) -> list[tuple[int, Floats, Floats]]:
        """Return vertex, unit direction (2,) and centre (2,) of each way to move a joint's vertex."""
        # Centres are NaN for lines. A vertex inside the structure has both axes as ways.
        paths: list[tuple[int, Floats, Floats]] = []
        for vertex in np.flatnonzero(self._dry | self.followers).tolist():
            if vertex in named:
                continue
            if not self._outline[vertex]:
                if not self._held[vertex]:
                    paths += [(vertex, axis, np.full(2, np.nan)) for axis in np.eye(2)]
                continue
            around = [*self._before.get(vertex, []), *self._after.get(vertex, [])]
            circle = self._circle(vertex, around, circles)
            if circle is not None and (circle[1] or not self._held[vertex]):
                arm = self._mesh.places[vertex] - circle[0]
                paths.append((vertex, np.array([-arm[1], arm[0]]) / np.hypot(*arm), circle[0]))
            elif not self._held[vertex] and len(around) == 2 and (line := self._line(vertex, around)) is not None:
                paths.append((vertex, line, np.full(2, np.nan)))
        return paths

    def _circle(self, vertex: int, around: list[int], circles: list[scene_move.Path]) -> tuple[Floats, bool] | None:
        """Return the centre (2,) of a circle through a vertex and its neighbours, and whether supports slide."""
        for path in circles:
            centre = np.array(path.circle, dtype=float)
            radii = np.linalg.norm(self._mesh.places[[vertex, *around]] - centre, axis=1)
            like = abs(radii[1:] - radii[0]) <= SAME * self._size
            if radii[0] > 0.0 and (like.all() or (path.supports and self._held[vertex] and like.any())):
                return centre, path.supports
        return None

    def _line(self, vertex: int, around: list[int]) -> Floats | None:
        """Return the unit direction (2,) of a straight outline at a vertex; None at a corner."""
        before, after = self._mesh.places[around] - self._mesh.places[vertex]
        lengths = np.hypot(*before) * np.hypot(*after)
        if abs(before[0] * after[1] - before[1] * after[0]) > _STRAIGHT * lengths or before @ after > 0.0:
            return None
        edge = after - before
        return np.asarray(edge / np.hypot(*edge))


def _with_thickness(variables: Variables, assembly: Assembly, circles: list[scene_move.Path]) -> Variables:
    """Return variables with the thickness of an arch, whose rings move apart."""
    if not circles:
        problem = "the thickness is that of an arch on circles"
        raise InputError("move.maximise", problem, '"along": [{"circle": [x, y]}] with its centre')
    middle = np.array(circles[0].circle, dtype=float)
    free = np.concatenate([assembly.elements.shape[k] for k in assembly.elements.free])
    radii = np.linalg.norm(free - middle, axis=1)
    inner, outer = float(radii.min()), float(radii.max())
    rings = np.linalg.norm(variables.start - middle, axis=1) - 0.5 * (inner + outer)
    # vertices beyond the arch belong to supports and stay
    rings = np.where(abs(rings) <= (0.5 + SAME) * (outer - inner), rings, 0.0)
    return Variables(**{**vars(variables), "rings": rings, "middle": middle, "thickness": outer - inner})


def _following(variables: Variables, mesh: VertexMesh, followers: Bools) -> Floats:
    """Return the ties (t, k) by which vertices without joints, followers (v,), follow their neighbours."""
    # Each follower moves by the mean of its neighbours' movements, weighted by inverse distance.
    followed = np.flatnonzero(followers[variables.vertex])
    if not len(followed):
        return np.zeros((0, variables.count))
    edges = mesh.edges[1]
    # two elements state an edge between them, one states an edge of the outline: each is taken once
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    lengths = np.linalg.norm(variables.start[edges[:, 0]] - variables.start[edges[:, 1]], axis=1)
    pairs = np.concatenate([edges, edges[:, ::-1]]).T
    near = sp.csr_array((1.0 / np.tile(lengths, 2), (pairs[0], pairs[1])), shape=(len(variables.start),) * 2)
    jacobian = variables.jacobian(np.zeros(variables.count)).toarray().reshape(len(variables.start), 2, -1)
    if variables.scaled:
        jacobian[:, :, -1] = 0.0  # the thickness is common to all
    rows = []
    for k in followed.tolist():
        vertex, direction = int(variables.vertex[k]), variables.direction[k]
        start, end = near.indptr[vertex], near.indptr[vertex + 1]
        share = near.data[start:end] / near.data[start:end].sum()
        mean = np.einsum("w,wik->ik", share, jacobian[near.indices[start:end]])
        rows.append(direction @ (jacobian[vertex] - mean))
    return np.array(rows)


def ties_of(variables: Variables, assembly: Assembly, move: scene_move.Move) -> Floats:
    """Return the ties (t, k) between variables that the key "ties" states, as ties @ z = 0."""
    # There are no rows for "none" and "equal-shapes".
    if move.ties == "none" or move.ties == "equal-shapes":  # equal shapes are equations of the limits
        return np.zeros((0, variables.count))
    jacobian = variables.jacobian(np.zeros(variables.count)).toarray().reshape(*variables.start.shape, -1)
    if variables.scaled:
        jacobian[:, :, -1] = 0.0  # the thickness is common to all
    rows = []
    if move.ties == "mirror-x":
        partner = mirrored(variables, assembly)
        for vertex in sorted(set(variables.vertex.tolist())):
            other = int(partner[vertex])
            free = [bool(jacobian[k].any()) for k in (vertex, other)]
            if free[0] != free[1]:
                problem = f"the vertex {_words(variables.start[vertex])} moves and its mirror image does not"
                raise InputError("move.ties", problem, 'a symmetric structure, or "none"')
            rows += [jacobian[vertex, 0] + jacobian[other, 0], *(jacobian[vertex, 1:] - jacobian[other, 1:])]
        return np.array(rows)
    for position, group in enumerate(move.ties):
        of_group = [
            vertex_at(variables.start, point, assembly.size, f"move.ties[{position}][{k}]")
            for k, point in enumerate(group)
        ]
        for other in of_group[1:]:
            rows += list(jacobian[of_group[0]] - jacobian[other])
        basis = null_space(np.array(rows), variables.count)
        for point, vertex in zip(group, of_group, strict=True):
            if not (jacobian[vertex] @ basis).any():
                problem = f"they leave the vertex {point} no direction to move in"
                raise InputError("move.ties", problem, "ties of vertices that slide along the same directions")
    return np.array(rows)


def mirrored(variables: Variables, assembly: Assembly) -> Ints:
    """Return for each vertex (v,) the one nearest its mirror image about the middle vertical."""
    # The axis is vertical, in the middle of the free elements.
    free = np.concatenate([assembly.elements.shape[k] for k in assembly.elements.free])
    axis = float(free[:, 0].min() + free[:, 0].max())
    image = variables.start.copy()
    image[:, 0] = axis - image[:, 0]
    distance = np.linalg.norm(image[:, None] - variables.start[None], axis=2)
    nearest = np.argmin(distance, axis=1)
    for vertex in sorted(set(variables.vertex.tolist())):
        if distance[vertex, nearest[vertex]] > SAME * assembly.size:
            problem = f"nothing mirrors the vertex {_words(variables.start[vertex])} about x = {0.5 * axis:.6g}"
            raise InputError("move.ties", problem, 'a symmetric structure, or "none"')
    return np.asarray(nearest)
