"""The outline of a block: the boundary of the union of its elements, how slender it is, where it turns inwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely

from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.geometry.vectors import across, area_vector

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_REACH: Final = 1e-6
"""Distance, relative to the structure, within which corners of congruent blocks fall on one another."""

_SNAP: Final = 1e-3
"""Part of that distance within which corners are one before any shape is known."""

_PLACE: Final = 0.37
"""Where corners are rounded: off the halves, which rounding would throw to either side."""

_FLAT: Final = 1e-5
"""Share of its hull's area or volume that a block may lack and still count as convex."""


_Corner = tuple[int, int]
"""A corner by its place, in steps."""

_Edges = list[tuple[tuple[_Corner, _Corner], tuple[_Corner, _Corner], tuple[float, float]]]
"""Edges of a polygon: each from where to where, the same the other way, and the point it starts at."""


@dataclass(frozen=True)
class Outline:
    """One block's boundary.

    points: (k + e, d) corners about its centroid, then middles of edges or faces. count: k. size: area or volume.
    aspect: longest over shortest side of the smallest box around it. reentrant: corners that turn inwards (planar);
    spatial: 1 where it is not convex, else 0.
    """

    points: Floats
    count: int
    size: float
    aspect: float
    reentrant: int


def reach_of(assembly: Assembly) -> float:
    """Distance within which corners of blocks of an assembly are one."""
    return max(_REACH * assembly.size, 4.0 * assembly.moved)


class Outlines:
    """Outlines of blocks of one assembly; of planar elements the edges are found once."""

    def __init__(self, assembly: Assembly) -> None:
        self._elements, self._planar, self._reach = assembly.elements, assembly.dimension == 2, reach_of(assembly)
        self._edges: dict[int, _Edges] = {}

    def of(self, members: Ints) -> Outline:
        """Of the union of some elements."""
        elements, reach = self._elements, self._reach
        if not self._planar:
            solids = [(elements.shape[e], elements.faces[e]) for e in members]
            return solid_outline(solids, np.abs(elements.volume[members]), elements.centroid[members], reach)
        for e in members.tolist():
            if e not in self._edges:
                self._edges[e] = _edges(elements.shape[e], _SNAP * reach)
        known = [self._edges[e] for e in members.tolist()]
        return flat_outline([elements.shape[e] for e in members], reach, known)


def flat_outline(polygons: Sequence[Floats], reach: float, edges: Sequence[_Edges] | None = None) -> Outline:
    """Of the union of polygons (k, 2). reach: distance within which corners are one. edges: of each, where known."""
    if edges is None:
        edges = [_edges(polygon, _SNAP * reach) for polygon in polygons]
    region = shapely.Polygon(polygons[0]) if len(polygons) == 1 else _whole(edges)
    if region is None:
        region = shapely.union_all([shapely.Polygon(polygon) for polygon in polygons], grid_size=_SNAP * reach)
    centre = shapely.get_coordinates(region.centroid)[0]
    corners, middles, inwards = [], [], 0
    for part in shapely.get_parts(region):
        for ring, outer in [(part.exterior, True), *((hole, False) for hole in part.interiors)]:
            points = _straightened(shapely.get_coordinates(ring)[:-1], reach)
            last, following = _beside(points)
            before, after = points - last, following - points
            turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            way = 1.0 if ring.is_ccw else -1.0
            inwards += int(np.count_nonzero(way * turn < 0.0 if outer else way * turn > 0.0))
            corners.append(points - centre)
            middles.append(points + 0.5 * after - centre)
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))
    sides = np.hypot(*(box[1:3] - box[:2]).T)
    points = np.concatenate(corners + middles)
    count = sum(len(ring) for ring in corners)
    return Outline(points, count, float(region.area), float(sides.max() / sides.min()), inwards)


def _edges(polygon: Floats, step: float) -> _Edges:
    """The edges of a polygon (k, 2), run along anticlockwise. step: distance within which corners are one."""
    points = [(x, y) for x, y in polygon.tolist()]
    if sum(points[k - 1][0] * y - x * points[k - 1][1] for k, (x, y) in enumerate(points)) < 0.0:
        points.reverse()
    names = [(math.floor(x / step + _PLACE), math.floor(y / step + _PLACE)) for x, y in points]
    return [((names[k - 1], name), (name, names[k - 1]), points[k - 1]) for k, name in enumerate(names)]


def _whole(polygons: Sequence[_Edges]) -> shapely.Polygon | None:
    """The union of polygons that share whole edges, a tenth of the time of any union; None for others."""
    edges: dict[tuple[_Corner, _Corner], tuple[float, float]] = {}
    for polygon in polygons:
        for there, back, point in polygon:
            # an edge that two polygons share is run along both ways
            if edges.pop(back, None) is None:
                edges[there] = point
    after = {start: (end, point) for (start, end), point in edges.items()}
    if len(after) < len(edges):
        return None  # boundaries that touch in a corner
    rings = []
    while after:
        at, ring = next(iter(after)), []
        while at in after:
            at, point = after.pop(at)
            ring.append(point)
        if len(ring) < 3:
            return None
        rings.append(shapely.LinearRing(ring))
    outer = [ring for ring in rings if ring.is_ccw]
    if len(outer) != 1:
        return None
    found = shapely.Polygon(outer[0], [ring for ring in rings if ring is not outer[0]])
    return found if found.is_valid else None  # edges that lie on one another in part


def solid_outline(
    solids: Sequence[tuple[Floats, tuple[tuple[int, ...], ...]]], volumes: Floats, centroids: Floats, reach: float
) -> Outline:
    """Of the union of solids, each its corners (k, 3) and faces; volumes: (n,), centroids: (n, 3)."""
    corners = np.concatenate([points for points, _ in solids])
    volume = float(volumes.sum())
    from scipy.spatial import ConvexHull  # here and below: slow to import, and seldom needed

    hull = ConvexHull(corners)
    convex = hull.volume <= (1.0 + _FLAT) * volume
    outline = _skin(solids, reach)
    unique = _merged(np.concatenate(outline), reach)
    middles = np.array([face.mean(axis=0) for face in outline])
    centre = np.average(centroids, axis=0, weights=volumes)
    points = np.concatenate([unique - centre, middles - centre])
    return Outline(points, len(unique), volume, _box_aspect(corners, hull), int(not convex))


def _beside(points: Floats) -> tuple[Floats, Floats]:
    """Of every corner of a ring (k, 2) the one before and the one after; a fifth of the time of `numpy.roll`."""
    return np.concatenate((points[-1:], points[:-1])), np.concatenate((points[1:], points[:1]))


def _straightened(points: Floats, reach: float) -> Floats:
    """A ring (k, 2) without corners that lie on the line of their neighbours within the reach."""
    exact = True  # those on it to rounding go together, as on a grid nearly all do
    while len(points) > 3:
        before, after = _beside(points)
        chord = after - before
        length = np.hypot(*chord.T)
        arm = points - before
        off = abs(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0]) / np.where(length > 0.0, length, 1.0)
        idle = off <= reach
        if not idle.any():
            return points
        if exact:
            exact, told = False, off <= _SNAP * reach
            if 3 <= len(points) - int(told.sum()) < len(points):
                points = points[~told]
                continue
        # one at a time where neighbours are idle both, the flattest first
        kept = np.ones(len(points), dtype=bool)
        kept[int(np.argmin(np.where(idle, off, np.inf)))] = False
        points = points[kept]
    return points


def _merged(points: Floats, reach: float) -> Floats:
    """Points without those that repeat one before within the reach."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    kept = np.ones(len(points), dtype=bool)
    kept[pairs[:, 1]] = False
    return points[kept]


def _skin(solids: Sequence[tuple[Floats, tuple[tuple[int, ...], ...]]], reach: float) -> list[Floats]:
    """Outlines of the faces of a union of solids, idle corners left out: what two of them share is inside."""
    planes: list[tuple[Floats, float, list[tuple[float, Floats]]]] = []
    for corners, faces in solids:
        for loop in faces:
            ring = corners[list(loop)]
            vector = area_vector(ring)
            normal = vector / np.linalg.norm(vector)
            for other, offset, members in planes:
                sign = float(np.sign(normal @ other))
                if abs(abs(normal @ other) - 1.0) < 1e-9 and abs(float(ring.mean(axis=0) @ other) - offset) < reach:
                    members.append((sign, ring))
                    break
            else:
                planes.append((normal, float(ring.mean(axis=0) @ normal), [(1.0, ring)]))
    found, grid = [], _SNAP * reach
    for normal, offset, members in planes:
        plane = across(normal)
        sides = [
            shapely.union_all(
                [shapely.Polygon(ring @ plane.T) for sign, ring in members if sign == side], grid_size=grid
            )
            for side in (1.0, -1.0)
        ]
        for here, there in (sides, sides[::-1]):
            for part in shapely.get_parts(shapely.difference(here, there, grid_size=grid)):
                if part.geom_type != "Polygon" or part.area <= reach * part.length:
                    continue
                for ring in [part.exterior, *part.interiors]:
                    flat = _straightened(shapely.get_coordinates(ring)[:-1], reach)
                    found.append(flat @ plane + offset * normal)
    return found


def _box_aspect(corners: Floats, hull: ConvexHull) -> float:
    """Longest over shortest side of the smallest box with a side in a face of the hull."""
    best, sides_of = np.inf, np.ones(3)
    for normal in np.unique(np.round(hull.equations[:, :3], 9), axis=0):
        plane = across(normal / np.linalg.norm(normal))
        high = float(np.ptp(corners @ normal))
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.multipoints(corners @ plane.T)))
        sides = np.array([high, *(float(np.hypot(*(b - a))) for a, b in pairwise(box[:3]))])
        if np.prod(sides) < best:
            best, sides_of = float(np.prod(sides)), sides
    return float(sides_of.max() / sides_of.min())
