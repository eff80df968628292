"""Edges of a planar outline along which a load acts: a side, the stretch between two points, or the extrados."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError
from jld_core.geometry.unions import union_outlines
from jld_core.refinement.voussoirs import find_arcs

SIDES: Final = ("top", "bottom", "left", "right")
"""Sides by name."""

EXTRADOS: Final = "extrados"
"""Name of the largest arc of an outline that is round outwards."""

_FACING: Final = 0.3  # least component of the normal of an edge towards the side on which it lies

# Share of a load below which its part on a piece is left to the neighbours; meshes would be fine around it
_SLIVER: Final = 0.1

_ON: Final = 1e-6  # distance from a line, circle or support, relative to the structure, up to which a point lies on it


@dataclass(frozen=True)
class Edge:
    """Edge of a free element that carries a load."""

    element: int  # index of the element
    # low, high: places of both ends along the side or line, length
    low: float
    high: float
    # p, q: (2,) its corners at these places
    p: Floats
    q: Floats


@dataclass(frozen=True)
class LoadedLine:
    """Edges along which a load acts, with the direction in which the outermost one counts."""

    edges: list[Edge]  # all edges that face the side, element by element
    facing: Floats  # (2,) unit vector out of the structure; 0 where edges do not cover one another

    @property
    def ends(self) -> tuple[float, float]:
        """Return the first and the last place."""
        return min(edge.low for edge in self.edges), max(edge.high for edge in self.edges)

    def spread(self, low: float, high: float) -> list[tuple[Edge, float, float]]:
        """Return the outermost edges between two places, each with its interval."""
        # Slivers, and stretches without an edge, are left out.
        stops = sorted({low, high, *(end for edge in self.edges for end in (edge.low, edge.high) if low < end < high)})
        parts: list[tuple[Edge, float, float]] = []
        for a, b in itertools.pairwise(stops):
            if b - a <= _SLIVER * (high - low):
                continue
            middle = 0.5 * (a + b)
            over = [edge for edge in self.edges if edge.low <= middle <= edge.high]
            if not over:
                continue
            edge = max(over, key=lambda one: self._level(one, middle))
            if parts and parts[-1][0] is edge and parts[-1][2] == a:
                parts[-1] = (edge, parts[-1][1], b)
            else:
                parts.append((edge, a, b))
        return parts

    def _level(self, edge: Edge, place: float) -> float:
        """Return how far out an edge lies at a place."""
        point = edge.p + (place - edge.low) / (edge.high - edge.low) * (edge.q - edge.p)
        return float(point @ self.facing)


def points_of(along: str) -> tuple[Floats, Floats] | None:
    """Return the two points that a text X,Y,X,Y states; None for any other text."""
    try:
        numbers = np.array([float(part) for part in along.split(",")])
    except ValueError:
        return None
    if len(numbers) != 4 or not np.isfinite(numbers).all() or np.array_equal(numbers[:2], numbers[2:]):
        return None
    return numbers[:2], numbers[2:]


def loaded_line(assembly: Assembly, along: str, down: Floats) -> LoadedLine:
    """Return the edges of a planar structure along which a load acts.

    down: (2,) unit vector of weight. Raises ParameterError if there is no such edge.
    """
    # Edges on supports carry no load.
    points = points_of(along)
    if points is not None:
        return _between(assembly, *points)
    if along == EXTRADOS:
        return _extrados(assembly, down)
    right = np.array([-down[1], down[0]])
    facing = {"top": -down, "bottom": down, "left": -right, "right": right}[along]
    # places are counted from the left, and from below
    edges = _facing_edges(assembly, np.asarray(facing), right if along in ("top", "bottom") else -down)
    if not edges:
        where = {"top": "upwards", "bottom": "downwards"}.get(along, f"to the {along}")
        problem = f"no free edge of the outline faces {where}"
        raise ParameterError("along", problem, "another side, or two points of its outline")
    return LoadedLine(edges, np.asarray(facing))


def _free_edges(assembly: Assembly) -> list[tuple[int, Floats, Floats]]:
    """Return element and ends (2,) of the edges of free elements that do not lie on a support."""
    # Elements are counter-clockwise, so that material lies to the left of an edge.
    elements = assembly.elements
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    supports = shapely.union_all([shapely.Polygon(elements.shape[k]) for k in np.flatnonzero(elements.support)])
    every = [
        (int(k), p, q)
        for k in elements.free.tolist()
        for p, q in zip(elements.shape[k], np.roll(elements.shape[k], -1, axis=0), strict=True)
    ]
    middles = shapely.points([0.5 * (p + q) for _, p, q in every])
    apart = ~shapely.dwithin(middles, supports, _ON * size) if not supports.is_empty else np.ones(len(every), bool)
    return [edge for edge, free in zip(every, apart.tolist(), strict=True) if free]


def _facing_edges(assembly: Assembly, facing: Floats, axis: Floats) -> list[Edge]:
    """Return the edges of free elements that face a direction (2,), element by element.

    axis: (2,) unit vector at right angles to it, along which places are counted.
    """
    found = []
    for element, p, q in _outer_edges(assembly):
        outward = np.array([q[1] - p[1], p[0] - q[0]])
        if float(outward @ facing) > _FACING * float(np.hypot(*outward)):
            a, b = (p, q) if float(p @ axis) < float(q @ axis) else (q, p)
            found.append(Edge(element, float(a @ axis), float(b @ axis), a, b))
    return found


def _between(assembly: Assembly, first: Floats, last: Floats) -> LoadedLine:
    """Return the edges on the straight line between two points (2,); places are distances from the first one."""
    elements = assembly.elements
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    length = float(np.hypot(*(last - first)))
    axis = (last - first) / length
    normal = np.array([-axis[1], axis[0]])
    found = []
    for element, p, q in _outer_edges(assembly):
        level, along = np.array([p - first, q - first]) @ normal, np.array([p - first, q - first]) @ axis
        if (abs(level) > _ON * size).any() or along.max() <= 0.0 or along.min() >= length:
            continue
        a, b = (p, q) if along[0] < along[1] else (q, p)
        low, high = float(along.min()), float(along.max())
        ends = np.clip([low, high], 0.0, length)
        p, q = (a + (end - low) / (high - low) * (b - a) for end in ends)
        found.append(Edge(element, float(ends[0]), float(ends[1]), p, q))
    covered = sum(edge.high - edge.low for edge in found)
    if covered < (1.0 - 1e-3) * length:
        named = "({:.6g}, {:.6g}) and ({:.6g}, {:.6g})".format(*first, *last)
        problem = f"no free straight edge of the outline joins {named}"
        raise ParameterError("along", problem, "two points of one edge, in the unit of the outline")
    return LoadedLine(found, np.zeros(2))


def _extrados(assembly: Assembly, down: Floats) -> LoadedLine:
    """Return the edges on the largest arc that is round outwards and upwards; places are lengths along it.

    down: (2,) unit vector of weight. Raises ParameterError without such an arc.
    """
    elements = assembly.elements
    parts = union_outlines([elements.shape[k] for k in elements.free])
    arcs = [arc for part in parts for arc in find_arcs(part.shell) if not arc.hollow]
    arcs = [arc for arc in arcs if float((arc.point(0.5 * (arc.angles[0] + arc.angles[-1])) - arc.centre) @ down) < 0.0]
    if not arcs:
        problem = "no arc of the outline is round upwards"
        raise ParameterError("along", problem, "a side, or two points of its outline")
    arc = max(arcs, key=lambda one: (one.sweep * one.radius, one.radius))
    corners = np.array([arc.point(angle) for angle in arc.angles])
    line = shapely.LineString(corners)
    found = []
    for element, p, q in _outer_edges(assembly):
        if (shapely.distance(shapely.points([p, q]), line) > 2.0 * _ON * arc.radius).any():
            continue
        # counter-clockwise, the angle grows along an edge; places run from the left
        ends = [line.length - float(line.project(shapely.Point(point))) for point in (q, p)]
        if ends[1] > ends[0]:
            found.append(Edge(element, ends[0], ends[1], q, p))
    if not found:
        raise ParameterError("along", "the extrados lies on supports", "a side, or two points of its outline")
    return LoadedLine(found, np.zeros(2))


def _outer_edges(assembly: Assembly) -> list[tuple[int, Floats, Floats]]:
    """Return the free edges that no other free element touches."""
    elements = assembly.elements
    parts = union_outlines([elements.shape[k] for k in elements.free])
    rings = [shapely.LinearRing(ring) for part in parts for ring in (part.shell, *part.holes)]
    outline = shapely.MultiLineString(rings)
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    edges = _free_edges(assembly)
    near = shapely.dwithin(shapely.points([0.5 * (p + q) for _, p, q in edges]), outline, _ON * size)
    return [edge for edge, outer in zip(edges, near.tolist(), strict=True) if outer]
