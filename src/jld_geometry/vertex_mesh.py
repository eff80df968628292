"""Vertices that outlines of elements and interfaces share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.linalg import components

# Distance of two corners that are one vertex, relative to the longest edge of the scene
_REACH: Final = 4.0 * tolerances.CONTACT

_SHARE: Final = 0.1  # the same distance relative to the shortest edge, which it never exceeds


@dataclass(frozen=True)
class VertexMesh:
    """Elements and interfaces of a planar assembly by the v vertices they share.

    places: (v, 2) positions of the vertices, scene units. loops: vertices around each element, counter-clockwise, with
    the ends of interfaces that lie on its edges. ends: (m, 2) first and last vertex p, q of each interface; q − p
    points along e1.
    """

    places: Floats
    loops: tuple[Ints, ...]
    ends: Ints

    def at(self, places: Floats) -> VertexMesh:
        """Return the mesh with its vertices at the places (v, 2)."""
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
        known = {(int(i), int(j)) for i, j in edges}
        found = np.zeros(len(self.places), dtype=bool)
        for i, j in sorted(known):
            if (j, i) not in known:
                found[[i, j]] = True
        return found


def vertex_mesh(assembly: Assembly) -> VertexMesh:
    """Find the vertices that the elements and interfaces of a planar assembly share.

    Corners and ends of interfaces that nearly coincide become one vertex. An end of an interface inside an edge of an
    element becomes a vertex of its outline; a straight corner inside an interface is left out. Raises InputError for
    an assembly with members, since nothing says how their points move.
    """
    assembly.members.refuse("a move of joints")
    shapes, faces = assembly.elements.shape, assembly.interfaces
    lines = [_directed(polygon, faces.e1[k]) for k, polygon in enumerate(faces.polygon)]
    lengths = np.concatenate([np.linalg.norm(np.roll(s, -1, axis=0) - s, axis=1) for s in shapes])
    reach = min(_REACH * float(lengths.max()), _SHARE * float(lengths.min()))
    number, places = merged_points([*shapes, *lines], reach)
    count = np.cumsum([0, *(len(shape) for shape in shapes)])
    ends = number[count[-1] :].reshape(-1, 2)
    loops = []
    for k in range(len(shapes)):
        loop = number[count[k] : count[k + 1]]
        loop = loop[loop != np.roll(loop, 1)]
        own = np.flatnonzero((faces.a == k) | (faces.b == k))
        loops.append(_refined(loop, ends[own], places, reach))
    return VertexMesh(places, tuple(loops), ends)


def _directed(polygon: Floats, along: Floats) -> Floats:
    """Return the two ends (2, 2) of an interface in the direction of e1, `along`."""
    return polygon if (polygon[1] - polygon[0]) @ along > 0.0 else polygon[::-1]


def merged_points(groups: Sequence[Floats], reach: float) -> tuple[Ints, Floats]:
    """Merge points within a distance `reach`, also by chains of such points, to vertices.

    The result is the vertex (k,) of each of the k points of all groups in turn, and the places (v, d) of the vertices.
    A vertex lies at the first of its points.
    """
    points = np.concatenate(groups)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray").reshape(-1, 2)
    number = components(len(points), pairs[:, 0], pairs[:, 1])
    _, first = np.unique(number, return_index=True)
    return number, points[first]


def _refined(loop: Ints, ends: Ints, places: Floats, reach: float) -> Ints:
    """Insert interface ends on a loop's edges, and remove its corners inside interfaces.

    loop: (k,) vertices of an element. ends: (j, 2) vertices of its interfaces. places: (v, 2) positions. reach:
    distance within which a vertex lies on an edge.
    """
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
    """Return True if a point lies on a segment `line` (2, 2), ends within `reach` excluded."""
    edge, arm = line[1] - line[0], point - line[0]
    length = float(np.hypot(*edge))
    along, off = float(arm @ edge) / length, abs(float(arm[0] * edge[1] - arm[1] * edge[0])) / length
    return off <= reach and reach < along < length - reach
