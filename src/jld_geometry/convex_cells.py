"""Convex polyhedra cut by planes; vertices that elements share, and shapes that stay equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import Assembly, Bools, Floats, Ints, tolerances
from jld_core.geometry import Faces, solids
from jld_core.linalg import merged_points

_ON: Final = 1e-9  # distance from a plane, relative to the size of a cell, below which a vertex lies on the plane

# Volume between a solid and its convex hull, relative to the hull, below which the solid is convex
_CONVEX: Final = 1e-9

Plane = tuple[Floats, float]  # unit normal (3,) and offset; points x with normal·x > offset lie outside


@dataclass(frozen=True, eq=False)
class ConvexCell:
    vertices: Floats  # (k, 3) vertices, scene units
    faces: Faces  # loops of vertex indices, counter-clockwise seen from outside

    @cached_property
    def volume(self) -> float:
        return float(solids(["cell"], [self.vertices], [self.faces])[2][0])

    @cached_property
    def size(self) -> float:
        return float(np.ptp(self.vertices, axis=0).max())

    def is_convex(self) -> bool:
        """Return whether the polyhedron fills its convex hull."""
        from scipy.spatial import ConvexHull  # local imports here and below: slow to import, spatial scenes only

        hull = float(ConvexHull(self.vertices - self.vertices.mean(axis=0)).volume)
        return hull - self.volume <= _CONVEX * hull

    def cut(self, plane: Plane) -> tuple[ConvexCell | None, ConvexCell | None]:
        """Cut the polyhedron by a plane; return the parts inside and outside, None if empty."""
        normal, offset = plane
        height = self.vertices @ normal - offset
        height[abs(height) <= _ON * self.size] = 0.0
        if (height <= 0.0).all():
            return self, None
        if (height >= 0.0).all():
            return None, self
        places, crossing = self._crossings(height)
        loops_inside, loops_outside = (self._clip(height, crossing, sign) for sign in (-1.0, 1.0))
        on_plane = [*np.flatnonzero(height == 0.0).tolist(), *crossing.values()]
        cap = _around(places[on_plane], on_plane, normal)
        return _cell(places, [*loops_inside, cap]), _cell(places, [*loops_outside, cap[::-1]])

    def _crossings(self, height: Floats) -> tuple[Floats, dict[tuple[int, int], int]]:
        """Return vertices with the points in which edges cross height 0, and the number of each by its edge."""
        points, crossing = list(self.vertices), dict[tuple[int, int], int]()
        for loop in self.faces:
            for start, end in zip(loop, (*loop[1:], loop[0]), strict=True):
                low, high = edge = (min(start, end), max(start, end))
                if height[start] * height[end] < 0.0 and edge not in crossing:
                    share = height[low] / (height[low] - height[high])
                    crossing[edge] = len(points)
                    points.append((1.0 - share) * self.vertices[low] + share * self.vertices[high])
        return np.array(points), crossing

    def _clip(self, height: Floats, crossing: dict[tuple[int, int], int], sign: float) -> list[list[int]]:
        """Return the parts of faces on the side of height 0 that `sign` tells, without those that only touch it."""
        parts = []
        for loop in self.faces:
            part: list[int] = []
            for start, end in zip(loop, (*loop[1:], loop[0]), strict=True):
                if sign * height[start] >= 0.0:
                    part.append(start)
                if height[start] * height[end] < 0.0:
                    part.append(crossing[min(start, end), max(start, end)])
            beyond = any(k >= len(height) or sign * height[k] > 0.0 for k in part)
            if len(part) > 2 and beyond:
                parts.append(part)
        return parts


def _around(points: Floats, names: list[int], normal: Floats) -> list[int]:
    """Return the names of points (k, 3) of a plane, counter-clockwise seen against the normal (3,)."""
    arm = points - points.mean(axis=0)
    first = arm[int(np.argmax(np.linalg.norm(arm, axis=1)))]
    angle = np.arctan2(arm @ np.cross(normal, first), arm @ first)
    return [names[k] for k in np.argsort(angle, kind="stable").tolist()]


def _cell(places: Floats, loops: list[list[int]]) -> ConvexCell:
    """Return the polyhedron of loops, with only the vertices that they use; places: (k, 3)."""
    used = sorted({vertex for loop in loops for vertex in loop})
    number = {vertex: k for k, vertex in enumerate(used)}
    return ConvexCell(places[used], tuple(tuple(number[vertex] for vertex in loop) for loop in loops))


def inside(cell: ConvexCell, planes: Sequence[Plane]) -> ConvexCell | None:
    """Return the part of a cell inside all planes; None if it is empty."""
    remaining: ConvexCell | None = cell
    for plane in planes:
        if remaining is not None:
            remaining = remaining.cut(plane)[0]
    return remaining


def subtract(cell: ConvexCell, planes: Sequence[Plane]) -> tuple[ConvexCell | None, list[ConvexCell]]:
    """Cut a cell by successive planes; return the part inside all, and the parts cut off."""
    remaining: ConvexCell | None = cell
    parts = []
    for plane in planes:
        if remaining is None:
            break
        remaining, outside = remaining.cut(plane)
        if outside is not None:
            parts.append(outside)
    return remaining, parts


# Difference of distances of corners, relative to the larger element, up to which two elements are equal
_EQUAL: Final = 1e-6


def equal_corners(outlines: list[Ints], places: Floats, changing: Bools) -> list[tuple[Ints, Ints]]:
    """Pair equal outlines corner by corner: the first of each kind that changes with every other."""
    # Elements are equal if one is the other moved, turned or mirrored. Kinds without an element that changes are left
    # out.
    kinds: list[list[tuple[int, Ints]]] = []
    for element, outline in enumerate(outlines):
        for kind in kinds:
            match = _match_corners(places, kind[0][1], outline)
            if match is not None:
                kind.append((element, match))
                break
        else:
            kinds.append([(element, outline)])
    return [
        (kind[0][1], other) for kind in kinds if any(changing[element] for element, _ in kind) for _, other in kind[1:]
    ]


def _match_corners(places: Floats, first: Ints, second: Ints) -> Ints | None:
    """Reorder corners of the second outline to match an equal first one; None if they are not equal."""
    if len(first) != len(second):
        return None
    distances = _distances(places[first])
    for order in (second, second[::-1]):
        for shift in range(len(order)):
            turned = np.roll(order, -shift)
            if abs(_distances(places[turned]) - distances).max() <= _EQUAL * distances.max():
                return turned
    return None


def _distances(corners: Floats) -> Floats:
    return np.asarray(np.linalg.norm(corners[:, None] - corners[None], axis=2))


class EqualShapes:
    """Equations that keep pairs of outlines equal, by squared distances of corners."""

    def __init__(self, pairs: list[tuple[Ints, Ints]], places: Floats) -> None:
        # of an outline with k corners, the k edges and the k − 3 diagonals from its first corner are compared
        rows = []
        for first, second in pairs:
            ends = [(k, (k + 1) % len(first)) for k in range(len(first))] + [(0, k) for k in range(2, len(first) - 1)]
            rows += [[first[i], first[j], second[i], second[j]] for i, j in ends]
        self._rows: Ints = np.array(rows, dtype=np.int64).reshape(-1, 4)
        self._unit = np.linalg.norm(places[self._rows[:, 1]] - places[self._rows[:, 0]], axis=1) ** 2
        self._start, _ = self._differences(places)

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return the values (r,) of the equations and their derivatives (r, 2v) at places (v, 2)."""
        values, slopes = self._differences(places)
        columns = (2 * self._rows[:, :, None] + np.arange(2)).reshape(len(self._rows), 8)
        row = np.repeat(np.arange(len(self._rows)), 8)
        entries = (slopes.ravel(), (row, columns.ravel()))
        return values - self._start, sp.csr_array(entries, shape=(len(self._rows), places.size))

    def _differences(self, places: Floats) -> tuple[Floats, Floats]:
        """Compute relative differences (r,) of squared distances, and derivatives (r, 4, 2)."""
        first, second = (places[self._rows[:, k + 1]] - places[self._rows[:, k]] for k in (0, 2))
        values = ((first**2).sum(axis=1) - (second**2).sum(axis=1)) / self._unit
        slopes = 2.0 * np.stack([-first, first, second, -second], axis=1) / self._unit[:, None, None]
        return np.asarray(values), np.asarray(slopes)


# Distance of two corners that are one vertex, relative to the longest edge of the scene
_REACH: Final = 4.0 * tolerances.CONTACT

_SHARE: Final = 0.1  # the same distance relative to the shortest edge, which it never exceeds


@dataclass(frozen=True)
class VertexMesh:
    """Elements and interfaces of a planar assembly by the v vertices they share."""

    places: Floats  # (v, 2) positions of the vertices, scene units
    # vertices around each element, counter-clockwise, with the ends of interfaces that lie on its edges
    loops: tuple[Ints, ...]
    ends: Ints  # (m, 2) first and last vertex p, q of each interface; q − p points along e1

    def at(self, places: Floats) -> VertexMesh:
        return VertexMesh(places, self.loops, self.ends)

    @cached_property
    def edges(self) -> tuple[Ints, Ints]:
        """Element (k,) and vertices (k, 2) of every edge of every element."""
        owner = np.repeat(np.arange(len(self.loops)), [len(loop) for loop in self.loops])
        return owner, np.concatenate([np.column_stack([loop, np.roll(loop, -1)]) for loop in self.loops])

    @cached_property
    def on_outline(self) -> Bools:
        """True (v,) for the vertices on the boundary of the structure."""
        edges = self.edges[1]
        pairs = {(int(i), int(j)) for i, j in edges}
        on = np.zeros(len(self.places), dtype=bool)
        for i, j in sorted(pairs):
            if (j, i) not in pairs:
                on[[i, j]] = True
        return on


def vertex_mesh(assembly: Assembly) -> VertexMesh:
    """Find the vertices that the elements and interfaces of a planar assembly share."""
    # Corners and ends of interfaces that nearly coincide become one vertex. An end of an interface inside an edge of an
    # element becomes a vertex of its outline; a straight corner inside an interface is left out.
    assembly.members.refuse("a move of joints")
    shapes, faces = assembly.elements.shape, assembly.interfaces
    lines = [  # ends of each interface in the direction of e1
        line if (line[1] - line[0]) @ along > 0.0 else line[::-1]
        for line, along in zip(faces.polygon, faces.e1, strict=True)
    ]
    lengths = np.concatenate([np.linalg.norm(np.roll(s, -1, axis=0) - s, axis=1) for s in shapes])
    reach = min(_REACH * float(lengths.max()), _SHARE * float(lengths.min()))
    places, number = merged_points(np.concatenate([*shapes, *lines]), reach)
    count = np.cumsum([0, *(len(shape) for shape in shapes)])
    ends = number[count[-1] :].reshape(-1, 2)
    loops = []
    for k in range(len(shapes)):
        loop = number[count[k] : count[k + 1]]
        loop = loop[loop != np.roll(loop, 1)]
        of_element = np.flatnonzero((faces.a == k) | (faces.b == k))
        loops.append(_insert_ends(loop, ends[of_element], places, reach))
    return VertexMesh(places, tuple(loops), ends)


def _insert_ends(loop: Ints, ends: Ints, places: Floats, reach: float) -> Ints:
    """Insert interface ends (j, 2) on the edges of a loop (k,), and remove its corners inside interfaces."""
    for vertex in sorted(set(ends.ravel().tolist()) - set(loop.tolist())):
        start, edge = places[loop], places[np.roll(loop, -1)] - places[loop]
        length = np.linalg.norm(edge, axis=1)
        arm = places[vertex] - start
        share = np.einsum("ij,ij->i", arm, edge) / length**2
        off = abs(arm[:, 0] * edge[:, 1] - arm[:, 1] * edge[:, 0]) / length
        off = np.where((share > 0.0) & (share < 1.0), off, np.inf)
        nearest = int(np.argmin(off))
        if off[nearest] <= reach:
            loop = np.insert(loop, nearest + 1, vertex)
    free = sorted(set(loop.tolist()) - set(ends.ravel().tolist()))
    inside = [vertex for vertex in free if any(_between(places[vertex], places[line], reach) for line in ends)]
    return loop[~np.isin(loop, inside)]


def _between(point: Floats, line: Floats, reach: float) -> bool:
    """Return whether a point lies on a segment `line` (2, 2), ends within `reach` excluded."""
    edge, arm = line[1] - line[0], point - line[0]
    length = float(np.hypot(*edge))
    along, off = float(arm @ edge) / length, abs(float(arm[0] * edge[1] - arm[1] * edge[0])) / length
    return off <= reach and reach < along < length - reach
