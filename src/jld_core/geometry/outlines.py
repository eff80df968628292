"""Outlines of blocks: boundary of the union of elements, aspect ratio, re-entrant corners."""

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
from jld_core.geometry.rings import PLACE, SNAP, beside, straightened
from jld_core.geometry.skin import Facet, facets_of, skin
from jld_core.geometry.vectors import across, area_vector
from jld_core.linalg import components

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_REACH: Final = 1e-6
"""Distance within which corners of congruent blocks coincide, relative to the size of the structure."""


_FLAT: Final = 1e-5
"""Excess of the hull's volume over the block's volume (relative) up to which a solid block counts as convex."""


_ANGLE: Final = 1e-6
"""Angle, radians, up to which two edges or faces are parallel: they are sawn with one set-up."""

_Corner = tuple[int, int]
"""Corner of a polygon, as integer coordinates in grid steps."""

_Edges = list[tuple[tuple[_Corner, _Corner], tuple[_Corner, _Corner], tuple[float, float]]]
"""Edges of a polygon: the edge (start, end), the reversed edge (end, start), and its start point."""


@dataclass(frozen=True)
class Outline:
    """Boundary of one block, described by its corners and the middles of its edges or faces.

    Attributes
    ----------
    points : (k + e, d) array
        Corners relative to the centroid, then middles of edges (planar) or faces (spatial), scene units.
    count : int
        Number k of corners.
    size : float
        Area (planar) or volume (spatial), scene units.
    aspect : float
        Longest over shortest side of the smallest box around the block.
    reentrant : int
        Planar: number of re-entrant corners. Spatial: 1 where the block is not convex, else 0.
    lines : int
        Number of different lines along edges (planar) or normal to faces (spatial): parallel ones are one.
    """

    points: Floats
    count: int
    size: float
    aspect: float
    reentrant: int
    lines: int = 0

    @property
    def faces(self) -> int:
        """Return the number of edges (planar) or faces (spatial)."""
        return len(self.points) - self.count


def reach_of(assembly: Assembly) -> float:
    """Return half the largest distance at which two corners of blocks coincide.

    Parameters
    ----------
    assembly : Assembly
        Assembly with its size and its largest snapping displacement.

    Returns
    -------
    float
        Larger of 1e-6 times the size and four times the displacement, scene units. The size is twice the distance of
        the farthest corner from the mean of all, which no turn changes.
    """
    corners = np.concatenate(assembly.elements.shape)
    size = 2.0 * float(np.sqrt(((corners - corners.mean(axis=0)) ** 2).sum(axis=1).max()))
    return max(_REACH * size, 4.0 * assembly.moved)


def boundary(corners: Floats, faces: Sequence[Sequence[int]] | None = None) -> float:
    """Return the perimeter of a polygon (k, 2), or the surface area of a solid (k, 3).

    faces: corners of each face of the solid, in order; None for a polygon.
    """
    if faces is None:
        return float(np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).sum())
    return float(sum(np.linalg.norm(area_vector(corners[list(loop)])) for loop in faces))


def different_lines(vectors: Floats) -> int:
    """Count the different lines among unit vectors (k, d); opposite vectors are one line.

    Lines are equal if their angle is at most 1e-6, and so are all that a chain of such lines connects.
    """
    alike = abs(vectors @ vectors.T) >= 1.0 - 0.5 * _ANGLE**2 - 1e-12
    return len(np.unique(components(len(vectors), *np.nonzero(alike))))


class Outlines:
    """Factory of the outlines of blocks of one assembly.

    Edges of planar elements are computed once and stored.

    Parameters
    ----------
    assembly : Assembly
        Assembly whose elements form the blocks.
    """

    def __init__(self, assembly: Assembly) -> None:
        self._elements, self._planar, self._reach = assembly.elements, assembly.dimension == 2, reach_of(assembly)
        self._edges: dict[int, _Edges] = {}
        self._facets: dict[int, list[Facet]] = {}

    def of(self, members: Ints) -> Outline:
        """Return the outline of the union of some elements.

        Parameters
        ----------
        members : (n,) int array
            Indices of the elements.

        Returns
        -------
        Outline
            Boundary of the block.
        """
        elements, reach = self._elements, self._reach
        if not self._planar:
            for e in members.tolist():
                if e not in self._facets:
                    self._facets[e] = facets_of(elements.shape[e], elements.faces[e], SNAP * reach)
            corners = np.concatenate([elements.shape[e] for e in members])
            facets = [facet for e in members.tolist() for facet in self._facets[e]]
            volumes = np.abs(elements.volume[members])
            return _solid_outline(corners, facets, volumes, elements.centroid[members], reach)
        for e in members.tolist():
            if e not in self._edges:
                self._edges[e] = _edges(elements.shape[e], SNAP * reach)
        known = [self._edges[e] for e in members.tolist()]
        return flat_outline([elements.shape[e] for e in members], reach, known)


def flat_outline(polygons: Sequence[Floats], reach: float, edges: Sequence[_Edges] | None = None) -> Outline:
    """Compute the outline of a planar block from the polygons of its elements.

    polygons: corners (k, 2) of each element, scene units. reach: distance from the line of its neighbours within which
    a corner is left out; a share of it is the grid of the union. edges: edges of each polygon, where already computed.
    """
    if edges is None:
        edges = [_edges(polygon, SNAP * reach) for polygon in polygons]
    region = shapely.Polygon(polygons[0]) if len(polygons) == 1 else _whole(edges)
    if region is None:
        region = shapely.union_all([shapely.Polygon(polygon) for polygon in polygons], grid_size=SNAP * reach)
    centre = shapely.get_coordinates(region.centroid)[0]
    corners, middles, edges_of, inwards = [], [], [], 0
    for part in shapely.get_parts(region):
        for ring, outer in [(part.exterior, True), *((hole, False) for hole in part.interiors)]:
            points = straightened(shapely.get_coordinates(ring)[:-1], reach)
            last, following = beside(points)
            before, after = points - last, following - points
            turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            way = 1.0 if ring.is_ccw else -1.0
            inwards += int(np.count_nonzero(way * turn < 0.0 if outer else way * turn > 0.0))
            corners.append(points - centre)
            middles.append(points + 0.5 * after - centre)
            edges_of.append(after / np.hypot(*after.T)[:, None])
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))
    sides = np.hypot(*(box[1:3] - box[:2]).T)
    points = np.concatenate(corners + middles)
    count = sum(len(ring) for ring in corners)
    aspect, lines = float(sides.max() / sides.min()), different_lines(np.concatenate(edges_of))
    # Elements do not overlap; the area of a union would hold the rounding of its grid.
    size = math.fsum(shapely.Polygon(polygon).area for polygon in polygons)
    return Outline(points, count, size, aspect, inwards, lines)


def _edges(polygon: Floats, step: float) -> _Edges:
    """Return the edges of a polygon (k, 2) counter-clockwise, with corners rounded to a grid.

    step: grid width. Each entry holds the edge, the reversed edge and the unrounded start point, see `_Edges`.
    """
    points = [(x, y) for x, y in polygon.tolist()]
    if sum(points[k - 1][0] * y - x * points[k - 1][1] for k, (x, y) in enumerate(points)) < 0.0:
        points.reverse()
    names = [(math.floor(x / step + PLACE), math.floor(y / step + PLACE)) for x, y in points]
    return [((names[k - 1], name), (name, names[k - 1]), points[k - 1]) for k, name in enumerate(names)]


def _whole(polygons: Sequence[_Edges]) -> shapely.Polygon | None:
    """Unite polygons by removing the edges that two of them share as a whole.

    It takes a tenth of the time of a general union. None if boundaries touch in a corner, edges overlap only in part,
    or the union is not one region.
    """
    edges: dict[tuple[_Corner, _Corner], tuple[float, float]] = {}
    for polygon in polygons:
        for there, back, point in polygon:
            # An edge that two polygons share occurs in both directions.
            if edges.pop(back, None) is None:
                edges[there] = point
    after = {start: (end, point) for (start, end), point in edges.items()}
    if len(after) < len(edges):
        return None  # the boundaries touch in a corner
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
    return found if found.is_valid else None  # some edges overlap only in part


def _solid_outline(
    corners: Floats, facets: Sequence[Facet], volumes: Floats, centroids: Floats, reach: float
) -> Outline:
    """Compute the outline of the union of solids.

    corners: (k, 3) of all solids. facets: faces of all solids. volumes: (n,). centroids: (n, 3). reach: see `skin`.
    """
    volume = float(volumes.sum())
    from scipy.spatial import ConvexHull  # local imports here and below: slow to import and seldom needed

    hull = ConvexHull(corners)
    convex = hull.volume <= (1.0 + _FLAT) * volume
    outline = skin(facets, reach)
    unique = _merged(np.concatenate(outline), reach)
    middles = np.array([face.mean(axis=0) for face in outline])
    centre = np.average(centroids, axis=0, weights=volumes)
    points = np.concatenate([unique - centre, middles - centre])
    normals = np.array([area_vector(face) for face in outline])
    lines = different_lines(normals / np.linalg.norm(normals, axis=1)[:, None])
    return Outline(points, len(unique), volume, _box_aspect(corners[hull.vertices], hull), int(not convex), lines)


def _merged(points: Floats, reach: float) -> Floats:
    """Return one of the points (k, d) that a chain of steps up to `reach` connects: the first by its coordinates."""
    from scipy.spatial import cKDTree

    points = points[np.lexsort(points.T)]
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    group = components(len(points), pairs[:, 0], pairs[:, 1])
    return points[np.unique(group, return_index=True)[1]]


def _box_aspect(corners: Floats, hull: ConvexHull) -> float:
    """Compute longest over shortest side of the smallest box with a side in a hull face.

    corners: (k, 3) of the block. hull: convex hull of these.
    """
    best, sides_of = np.inf, np.ones(3)
    for normal in np.unique(np.round(hull.equations[:, :3], 9), axis=0):
        plane = across(normal / np.linalg.norm(normal))
        high = float(np.ptp(corners @ normal))
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.multipoints(corners @ plane.T)))
        sides = np.array([high, *(float(np.hypot(*(b - a))) for a, b in pairwise(box[:3]))])
        if np.prod(sides) < best:
            best, sides_of = float(np.prod(sides)), sides
    return float(sides_of.max() / sides_of.min())
