"""Outlines of blocks: boundary of the union of elements, aspect ratio, re-entrant corners; cleaning of regions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.geometry import outlines as measures
from jld_core.geometry.vectors import across, area_vector, frame
from jld_core.linalg import merged_points

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


def by_corner_count(polygons: Sequence[Floats]) -> Iterator[tuple[Ints, Floats]]:
    """Yield positions (n,) and stack (n, k, d) of polygons with equally many corners, fewest first."""
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    for count in np.unique(counts):
        chosen = np.flatnonzero(counts == count)
        yield chosen, np.array([polygons[i] for i in chosen.tolist()])


def area(polygons: Floats) -> Floats:
    """Compute the signed areas (n,) of polygons (n, k, 2), positive when counter-clockwise."""
    # Coordinates relative to a corner: far from the origin, absolute ones lose digits.
    p = polygons - polygons[:, :1]
    q = np.roll(p, -1, axis=1)
    return np.asarray(0.5 * (p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]).sum(axis=1))


def centroid(polygons: Floats) -> Floats:
    """Compute the centroids (n, 2) of simple polygons (n, k, 2), of either sense."""
    p = polygons - polygons[:, :1]
    q = np.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    return np.asarray(polygons[:, 0] + ((p + q) * cross[..., None]).sum(axis=1) / (3.0 * cross.sum(axis=1))[:, None])


def second_moments(polygons: Floats) -> Floats:
    """Compute ∫ x xᵀ dA (n, 2, 2) of counter-clockwise polygons (n, k, 2) about their centroids."""
    p = polygons - centroid(polygons)[:, None]
    q = np.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    total = p + q
    outer = np.einsum("nk,nki,nkj->nij", cross, p, p) + np.einsum("nk,nki,nkj->nij", cross, q, q)
    return np.asarray((outer + np.einsum("nk,nki,nkj->nij", cross, total, total)) / 24.0)


def torsion_length(polygons: Floats) -> Floats:
    """Return the torsion length c_T (n,) of polygons (n, k, 2), the mean distance from the centroid, (1.6)."""
    p = polygons - centroid(polygons)[:, None]
    edge = np.roll(p, -1, axis=1) - p
    length = np.hypot(edge[..., 0], edge[..., 1])
    direction = edge / np.where(length > 0.0, length, 1.0)[..., None]
    distance = p[..., 0] * direction[..., 1] - p[..., 1] * direction[..., 0]
    start = p[..., 0] * direction[..., 0] + p[..., 1] * direction[..., 1]
    total = _radial(distance, start + length) - _radial(distance, start)
    return np.asarray((distance * total).sum(axis=1) / (6.0 * area(polygons)))


_VANISHES: Final = 1e-150  # distance, relative to s, below which its term is 0 in numbers


def _radial(d: Floats, s: Floats) -> Floats:
    """Evaluate s √(s² + d²) + d² asinh(s/|d|), whose limit for d → 0 is s |s|."""
    distance = np.abs(d)
    vanishes = distance <= _VANISHES * np.abs(s)
    ratio = s / np.where(vanishes | (distance == 0.0), 1.0, distance)
    return np.asarray(s * np.hypot(s, d) + np.where(vanishes, 0.0, d * d * np.arcsinh(ratio)))


def rectangle_torsion_length(l1: Floats, l2: Floats) -> Floats:
    """Compute c_T (n,) of rectangles of sides l1, l2 (n,) in closed form (1.5): 0.382598 for the unit square."""
    diagonal = np.hypot(l1, l2)
    logarithms = l1 * l1 / (12.0 * l2) * np.arcsinh(l2 / l1) + l2 * l2 / (12.0 * l1) * np.arcsinh(l1 / l2)
    return np.asarray(diagonal / 6.0 + logarithms)


def is_rectangle(polygons: Floats, tolerance: float) -> Bools:
    """Return a mask (n,) of polygons (n, k, d) with four corners and equal diagonals that halve one another."""
    if polygons.shape[1] != 4:
        return np.zeros(len(polygons), dtype=bool)
    first, second = polygons[:, 2] - polygons[:, 0], polygons[:, 3] - polygons[:, 1]
    first_length, second_length = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    misfit = np.linalg.norm(polygons[:, 0] + polygons[:, 2] - polygons[:, 1] - polygons[:, 3], axis=1)
    reach = tolerance * first_length
    return np.asarray((misfit <= reach) & (np.abs(first_length - second_length) <= reach))


def sizes(polygons: Floats) -> Floats:
    """Return the extents l1 and l2 (n, 2) of polygons (n, k, 2) along the axes e1 and e2."""
    return np.asarray(np.ptp(polygons, axis=1))


def corners(polygon: Floats, tolerance: float) -> Floats:
    """Remove the corners of a polygon (k, d) that lie in straight edges or are tips of spikes."""
    points = np.asarray(polygon)
    while len(points) > 3:
        previous, following = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        distance = np.minimum(
            _distance_from_segment(points, previous, following), _distance_from_segment(following, previous, points)
        )
        distance = np.minimum(distance, _distance_from_segment(previous, points, following))
        # Remove the corner with the smallest distance first, so that the result does not depend on the first corner.
        flattest = int(np.argmin(distance))
        if distance[flattest] > tolerance:
            break
        points = np.delete(points, flattest, axis=0)
    return points


def keyhole(shell: Floats, holes: Sequence[Floats]) -> Floats:
    """Join a polygon (k, d) and its holes to one closed outline, by bridges between nearest corners."""
    outline, remaining = shell, list(holes)
    while remaining:
        distances = [np.linalg.norm(outline[:, None] - hole[None], axis=2) for hole in remaining]
        nearest = int(np.argmin([of_hole.min() for of_hole in distances]))
        at_outline, at_hole = np.unravel_index(int(np.argmin(distances[nearest])), distances[nearest].shape)
        hole = remaining.pop(nearest)
        hole_from_bridge = np.concatenate([hole[at_hole:], hole[: at_hole + 1]])
        outline = np.concatenate([outline[: at_outline + 1], hole_from_bridge, outline[at_outline:]])
    return outline


def without_idle_corners(polygons: Sequence[Floats], tolerance: float) -> list[Floats]:
    """Remove corners in straight edges and tips of spikes from polygons (k, d)."""
    # Polygons without such corners, the common case, are recognised in stacks and returned unchanged.
    cleaned = list(polygons)
    for positions, stack in by_corner_count(polygons):
        size = np.ptp(stack, axis=1).max(axis=1)
        chord = np.roll(stack, -1, axis=1) - np.roll(stack, 1, axis=1)
        arm = stack - np.roll(stack, 1, axis=1)
        length = np.linalg.norm(chord, axis=2)
        projection = np.einsum("nkj,nkj->nk", arm, chord) / np.where(length > 0.0, length, 1.0)
        distance = np.sqrt(np.maximum(np.einsum("nkj,nkj->nk", arm, arm) - projection**2, 0.0))
        # A wide first test, so that rounding of the square root does not hide candidates of the exact test.
        for index in positions[np.any(distance <= 2.0 * max(tolerance, 1e-7) * size[:, None], axis=1)].tolist():
            cleaned[index] = corners(polygons[index], tolerance * float(np.ptp(polygons[index], axis=0).max()))
    return cleaned


def _distance_from_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Compute the distances (k,) of points (k, d) from the segments between `start` and `end`."""
    chord, arm = end - start, points - start
    length = np.einsum("ij,ij->i", chord, chord)
    share = np.clip(np.einsum("ij,ij->i", arm, chord) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(arm - share[:, None] * chord, axis=1))


def hull(polygon: Floats) -> Floats:
    """Return the convex hull (h, 2) of points (k, 2), counter-clockwise from its leftmost, lowest corner."""
    ring = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(polygon)))[:-1]
    # Distances of points from an edge below this relative limit are rounding.
    kept_corners = corners(ring if area(ring[None])[0] > 0.0 else ring[::-1], 1e-12 * float(np.ptp(ring, axis=0).max()))
    return np.roll(kept_corners, -int(np.lexsort((kept_corners[:, 1], kept_corners[:, 0]))[0]), axis=0)


def hulls(polygons: Sequence[Floats]) -> list[Floats]:
    """Return the convex hulls of counter-clockwise polygons (k, 2)."""
    # Convex polygons, the common case, are recognised in stacks and returned unchanged.
    outlines = list(polygons)
    for positions, stack in by_corner_count(polygons):
        edge = np.roll(stack, -1, axis=1) - stack
        next_edge = np.roll(edge, -1, axis=1)
        turn = edge[..., 0] * next_edge[..., 1] - edge[..., 1] * next_edge[..., 0]
        size = np.ptp(stack, axis=1).max(axis=1)
        # A star polygon also has left turns only; its turning angle exceeds one revolution.
        angle = np.arctan2(turn, np.einsum("nkj,nkj->nk", edge, next_edge)).sum(axis=1)
        convex = np.all(turn > 1e-12 * size[:, None] ** 2, axis=1) & (angle < 3.0 * np.pi)
        for index in positions[~convex].tolist():
            outlines[index] = hull(polygons[index])
    return outlines


def hull_rows(hull_: Floats) -> Floats:
    """Return rows (h, 3) on (N, M1, M2), ≥ 0 where the centre of pressure lies in a hull (h, 2)."""
    edge = np.roll(hull_, -1, axis=0) - hull_
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    distance = np.einsum("hi,hi->h", hull_, outward)
    return np.column_stack([distance, -outward[:, 1], outward[:, 0]])


def kern_rows(hull_: Floats, area_: float, moments: Floats) -> Floats:
    """Return rows (h, 3) on (N, M1, M2) of the elastic normal stress at hull corners, times the area (2.6)."""
    slope = area_ * np.linalg.solve(moments, hull_.T).T
    return np.column_stack([np.ones(len(hull_)), slope[:, 1], -slope[:, 0]])


SNAP: Final = 1e-3  # grid width for uniting the elements of a block, relative to `reach_of(assembly)`

# Offset of the rounding grid, in steps: coordinates on halves of a step would round to either side.
PLACE: Final = 0.37


def beside(points: Floats) -> tuple[Floats, Floats]:
    """Return the previous and the next corners of a ring (k, 2), five times faster than `numpy.roll`."""
    return np.concatenate((points[-1:], points[:-1])), np.concatenate((points[1:], points[:1]))


def straightened(points: Floats, reach: float) -> Floats:
    """Remove corners of a ring (k, 2) that lie within `reach` of the line of their neighbours."""
    exact = True  # corners in line up to rounding are removed together first: on a grid these are nearly all
    while len(points) > 3:
        previous, following = beside(points)
        chord = following - previous
        length = np.hypot(*chord.T)
        arm = points - previous
        distance = abs(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0]) / np.where(length > 0.0, length, 1.0)
        idle = distance <= reach
        if not idle.any():
            return points
        if exact:
            exact, in_line = False, distance <= SNAP * reach
            if 3 <= len(points) - int(in_line.sum()) < len(points):
                points = points[~in_line]
                continue
        # Neighbours may both lie in line: remove one corner at a time, the one with the smallest distance first.
        keep = np.ones(len(points), dtype=bool)
        keep[int(np.argmin(np.where(idle, distance, np.inf)))] = False
        points = points[keep]
    return points


@dataclass(frozen=True)
class Facet:
    """Face of a solid element, prepared for the union of elements."""

    ring: Floats  # (k, 3) corners in order, scene units
    middle: Floats  # (3,) their mean
    normal: Floats  # (3,) unit normal, outwards
    offset: float  # distance of the plane from the origin along the normal
    area: float  # area, scene units
    # corners in grid steps: equal for a face of a neighbour that covers this one exactly
    corners: frozenset[tuple[int, ...]]

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.ring, axis=0, append=self.ring[:1]), axis=1).sum())


def facets_of(corners: Floats, faces: tuple[tuple[int, ...], ...], step: float) -> list[Facet]:
    """Prepare the faces of a solid element.

    corners: (k, 3). faces: corners of each face in order. step: grid width to which corners are rounded.
    """
    places = [tuple(place) for place in np.floor(corners / step + PLACE).astype(np.int64).tolist()]
    facets = []
    for loop in faces:
        ring = corners[list(loop)]
        vector = area_vector(ring)
        area = float(np.linalg.norm(vector))
        normal = vector / area
        middle = ring.mean(axis=0)
        facets.append(Facet(ring, middle, normal, float(middle @ normal), area, frozenset(places[k] for k in loop)))
    return facets


def skin(facets: Sequence[Facet], reach: float) -> list[Floats]:
    """Compute the boundary loops (k, 3) of the outer faces of a union of solids."""
    unpaired: dict[frozenset[tuple[int, ...]], Facet] = {}
    for facet in facets:
        # two solids that share a whole face have it with opposite normals
        other = unpaired.get(facet.corners)
        if other is not None and other.normal @ facet.normal < 0.0:
            del unpaired[facet.corners]
        else:
            unpaired[facet.corners] = facet
    faces: list[Floats] = []
    for members in _planes(list(unpaired.values()), reach):
        if len(members) > 1:
            faces += _unite_facets(members, reach)
        elif members[0].area > reach * members[0].length:
            plane = across(members[0].normal)
            flat = straightened(members[0].ring @ plane.T, reach)
            faces.append(flat @ plane + members[0].offset * members[0].normal)
    return faces


def _planes(facets: Sequence[Facet], reach: float) -> list[list[Facet]]:
    """Group facets by the plane they lie in, with normals of either sense."""
    normals = np.array([facet.normal for facet in facets])
    middles = np.array([facet.middle for facet in facets])
    groups, ungrouped = [], np.ones(len(facets), dtype=bool)
    for k, facet in enumerate(facets):
        if not ungrouped[k]:
            continue
        parallel = abs(abs(normals @ facet.normal) - 1.0) < 1e-9
        in_plane = ungrouped & parallel & (abs(middles @ facet.normal - facet.offset) < reach)
        in_plane[k] = True
        ungrouped &= ~in_plane
        groups.append([facets[j] for j in np.flatnonzero(in_plane).tolist()])
    return groups


def _unite_facets(facets: Sequence[Facet], reach: float) -> list[Floats]:
    """Unite the facets of one plane, and return the boundary loops (k, 3) of their regions."""
    # Regions where facets of opposite normals meet lie inside the union of solids and are left out.
    normal, offset, grid = facets[0].normal, facets[0].offset, SNAP * reach
    plane = across(normal)
    flat = np.concatenate([facet.ring @ plane.T for facet in facets])
    number = np.repeat(np.arange(len(facets)), [len(facet.ring) for facet in facets])
    polygons = shapely.polygons(shapely.linearrings(flat, indices=number))
    is_reversed = np.array([facet.normal @ normal < 0.0 for facet in facets])
    outer = [shapely.union_all(polygons[~is_reversed], grid_size=grid)]
    if is_reversed.any():
        front, back = outer[0], shapely.union_all(polygons[is_reversed], grid_size=grid)
        outer = [shapely.difference(*pair, grid_size=grid) for pair in ((front, back), (back, front))]
    loops_in_space = []
    for part in [part for region in outer for part in shapely.get_parts(region)]:
        if part.geom_type != "Polygon" or part.area <= reach * part.length:
            continue
        for ring in [part.exterior, *part.interiors]:
            loop = straightened(shapely.get_coordinates(ring)[:-1], reach)
            loops_in_space.append(loop @ plane + offset * normal)
    return loops_in_space


# Distance within which corners of congruent blocks coincide, relative to the size of the structure
_REACH: Final = 1e-6


# Excess of the hull's volume over the block's volume (relative) up to which a solid block counts as convex
_FLAT: Final = 1e-5
_ANGLE: Final = 1e-6  # angle, radians, up to which two edges or faces are parallel: they are sawn with one set-up
_Corner = tuple[int, int]  # corner of a polygon, as integer coordinates in grid steps

# Edges of a polygon: the edge (start, end), the reversed edge (end, start), and its start point
_Edges = list[tuple[tuple[_Corner, _Corner], tuple[_Corner, _Corner], tuple[float, float]]]


@dataclass(frozen=True)
class Outline:
    """Boundary of one block: its corners and the middles of its edges or faces."""

    # (k + e, d) corners relative to the centroid, then middles of edges (planar) or faces (spatial), scene units
    points: Floats
    count: int  # number k of corners
    size: float  # area (planar) or volume (spatial), scene units
    aspect: float  # longest over shortest side of the smallest box around the block
    reentrant: int  # planar: number of re-entrant corners. Spatial: 1 where the block is not convex, else 0.
    lines: int = 0  # number of different lines along edges (planar) or normal to faces (spatial): parallel ones are one

    @property
    def faces(self) -> int:
        """Return the number of edges (planar) or faces (spatial)."""
        return len(self.points) - self.count


def reach_of(assembly: Assembly) -> float:
    """Return the half distance at which corners coincide: 1e-6 times the size, or four times the snapping if larger."""
    corners = np.concatenate(assembly.elements.shape)
    size = 2.0 * float(np.sqrt(((corners - corners.mean(axis=0)) ** 2).sum(axis=1).max()))
    return max(_REACH * size, 4.0 * assembly.moved)


def boundary(corners: Floats, faces: Sequence[Sequence[int]] | None = None) -> float:
    """Return the perimeter of a polygon (k, 2), or the surface area of a solid (k, 3)."""
    if faces is None:
        return float(np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).sum())
    return float(sum(np.linalg.norm(area_vector(corners[list(loop)])) for loop in faces))


def different_lines(vectors: Floats) -> int:
    """Count the lines among unit vectors (k, d), of either sense, equal within 1e-6."""
    is_parallel = abs(vectors @ vectors.T) >= 1.0 - 0.5 * _ANGLE**2 - 1e-12
    # each line takes the least number of those like it; a component of a sparse graph took six times as long
    number, lower = np.arange(len(vectors)), is_parallel.argmax(axis=1)
    while (lower != number).any():
        number, lower = lower, np.where(is_parallel, lower, len(vectors)).min(axis=1)
    return int(np.count_nonzero(number == np.arange(len(vectors))))


class Outlines:
    """Factory of the outlines of blocks of one assembly; edges of planar elements are computed once."""

    def __init__(self, assembly: Assembly) -> None:
        self._elements, self._planar, self._reach = assembly.elements, assembly.dimension == 2, reach_of(assembly)
        self._edges: dict[int, _Edges] = {}
        self._areas: dict[int, float] = {}
        self._facets: dict[int, list[Facet]] = {}

    def of(self, members: Ints) -> Outline:
        """Return the outline of the union of elements (n,)."""
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
                self._areas[e] = shapely.Polygon(elements.shape[e]).area
        edges = [self._edges[e] for e in members.tolist()]
        areas = [self._areas[e] for e in members.tolist()]
        return flat_outline([elements.shape[e] for e in members], reach, edges, areas)


def flat_outline(
    polygons: Sequence[Floats],
    reach: float,
    edges: Sequence[_Edges] | None = None,
    areas: Sequence[float] | None = None,
) -> Outline:
    """Compute the outline of a planar block from the polygons (k, 2) of its elements."""
    if edges is None:
        edges = [_edges(polygon, SNAP * reach) for polygon in polygons]
    region = shapely.Polygon(polygons[0]) if len(polygons) == 1 else _whole(edges)
    if region is None:
        region = shapely.union_all([shapely.Polygon(polygon) for polygon in polygons], grid_size=SNAP * reach)
    centre = shapely.get_coordinates(region.centroid)[0]
    corners, middles, edges_of, reentrant = [], [], [], 0
    for part in shapely.get_parts(region):
        for ring, outer in [(part.exterior, True), *((hole, False) for hole in part.interiors)]:
            points = straightened(shapely.get_coordinates(ring)[:-1], reach)
            previous, following = beside(points)
            incoming, outgoing = points - previous, following - points
            turn = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
            # at an inward corner an outline turns against its sense of rotation, a hole with it
            sense = 1.0 if ring.is_ccw == outer else -1.0
            reentrant += int(np.count_nonzero(sense * turn < 0.0))
            corners.append(points - centre)
            middles.append(points + 0.5 * outgoing - centre)
            edges_of.append(outgoing / np.hypot(*outgoing.T)[:, None])
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))
    sides = np.hypot(*(box[1:3] - box[:2]).T)
    points = np.concatenate(corners + middles)
    count = sum(len(ring) for ring in corners)
    aspect, lines = float(sides.max() / sides.min()), different_lines(np.concatenate(edges_of))
    # Elements do not overlap; the area of a union would hold the rounding of its grid.
    size = math.fsum(areas or [shapely.Polygon(polygon).area for polygon in polygons])
    return Outline(points, count, size, aspect, reentrant, lines)


def _edges(polygon: Floats, step: float) -> _Edges:
    """Return the edges of a polygon (k, 2) counter-clockwise, with corners rounded to a grid."""
    points = [(x, y) for x, y in polygon.tolist()]
    if sum(points[k - 1][0] * y - x * points[k - 1][1] for k, (x, y) in enumerate(points)) < 0.0:
        points.reverse()
    corners = [(math.floor(x / step + PLACE), math.floor(y / step + PLACE)) for x, y in points]
    return [((corners[k - 1], corner), (corner, corners[k - 1]), points[k - 1]) for k, corner in enumerate(corners)]


def _whole(polygons: Sequence[_Edges]) -> shapely.Polygon | None:
    """Unite polygons by removing the edges that two share as a whole; None where that does not suffice."""
    # A tenth of the time of a general union.
    edges: dict[tuple[_Corner, _Corner], tuple[float, float]] = {}
    for polygon in polygons:
        for edge, reverse, point in polygon:
            # An edge that two polygons share occurs in both directions.
            if edges.pop(reverse, None) is None:
                edges[edge] = point
    next_corner = {start: (end, point) for (start, end), point in edges.items()}
    if len(next_corner) < len(edges):
        return None  # the boundaries touch in a corner
    rings = []
    while next_corner:
        corner, ring = next(iter(next_corner)), []
        while corner in next_corner:
            corner, point = next_corner.pop(corner)
            ring.append(point)
        if len(ring) < 3:
            return None
        rings.append(shapely.LinearRing(ring))
    outer = [ring for ring in rings if ring.is_ccw]
    if len(outer) != 1:
        return None
    united = shapely.Polygon(outer[0], [ring for ring in rings if ring is not outer[0]])
    return united if united.is_valid else None  # some edges overlap only in part


def _solid_outline(
    corners: Floats, facets: Sequence[Facet], volumes: Floats, centroids: Floats, reach: float
) -> Outline:
    """Compute the outline of the union of solids with corners (k, 3), volumes (n,), centroids (n, 3)."""
    volume = float(volumes.sum())
    from scipy.spatial import ConvexHull  # local imports here and below: slow to import and seldom needed

    hull = ConvexHull(corners)
    convex = hull.volume <= (1.0 + _FLAT) * volume
    outline = skin(facets, reach)
    # the first of the corners that chains of steps up to `reach` connect
    corners_of_skin = np.concatenate(outline)
    unique, _ = merged_points(corners_of_skin[np.lexsort(corners_of_skin.T)], reach)
    middles = np.array([face.mean(axis=0) for face in outline])
    centre = np.average(centroids, axis=0, weights=volumes)
    points = np.concatenate([unique - centre, middles - centre])
    normals = np.array([area_vector(face) for face in outline])
    lines = different_lines(normals / np.linalg.norm(normals, axis=1)[:, None])
    return Outline(points, len(unique), volume, _box_aspect(corners[hull.vertices], hull), int(not convex), lines)


def _box_aspect(corners: Floats, hull: ConvexHull) -> float:
    """Compute longest over shortest side of the smallest box around corners with a side in a hull face."""
    least_volume, best_sides = np.inf, np.ones(3)
    for normal in np.unique(np.round(hull.equations[:, :3], 9), axis=0):
        plane = across(normal / np.linalg.norm(normal))
        height = float(np.ptp(corners @ normal))
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.multipoints(corners @ plane.T)))
        sides = np.array([height, *(float(np.hypot(*(b - a))) for a, b in pairwise(box[:3]))])
        if np.prod(sides) < least_volume:
            least_volume, best_sides = float(np.prod(sides)), sides
    return float(best_sides.max() / best_sides.min())


# Allowed difference of the moments of congruent shapes, divided by reach times radius. Corners that are each off by
# twice the reach give a difference of 4, and higher moments more.
_MOMENTS: Final = 20.0

# Distance of corners, relative to the reach, up to which outlines are copies but for rounding: one of them is kept
_SAME: Final = 1e-3

# Distance of corners, in reaches, at which they are paired before the best move is computed from all pairs
_PAIRED: Final = 8.0


class Kinds:
    """Register that numbers outlines by shape, as chains of coinciding ones count.

    rotate, flip: copies that have the same shape; without `rotate`, mirrors along the axes and their products.
    """

    def __init__(self, reach: float, *, rotate: bool = False, flip: bool = False) -> None:
        self.reach, self.rotate, self.flip = reach, rotate, flip
        self.exact = True
        self._parent: list[int] = []
        self._kinds: dict[tuple[int, int, int], list[tuple[int, Floats, Outline]]] = {}

    def number(self, outline: Outline) -> int:
        """Store an outline unless it copies one, and return its number, of which `roots` gives that of the shape."""
        square = (outline.points**2).sum(axis=1)
        # Corners of one shape are off by twice the reach at most, and so are the mean radii compared here.
        size = math.floor(math.sqrt(float(square.mean())) / (2.0 * self.reach))
        counts = outline.count, len(outline.points)
        similar = [candidate for k in (-1, 0, 1) for candidate in self._kinds.get((*counts, size + k), ())]
        moments, new = self._moments(outline.points), len(self._parent)
        linked: set[int] = set()
        if similar:
            # Moments distinguish nearly all shapes of similar size, so that few outlines need the full comparison.
            radius = float(np.sqrt(square.max()))
            difference = abs(np.array([its_moments for _, its_moments, _ in similar]) - moments).max(axis=1)
            nearest: list[int] = np.argsort(difference, kind="stable").tolist()
            for k in nearest:
                if difference[k] > _MOMENTS * self.reach * radius:
                    break
                number, _, candidate = similar[k]
                if self._root(number) in linked:
                    continue
                distance = deviation(outline, candidate, self.reach, rotate=self.rotate, flip=self.flip)
                if distance <= _SAME * self.reach:
                    return number
                if distance <= 2.0 * self.reach:
                    linked.add(self._root(number))
        self._kinds.setdefault((*counts, size), []).append((new, moments, outline))
        self._parent.append(new)
        for root in linked:
            self._parent[root] = new
            self.exact = False
        return new

    def roots(self, numbers: Sequence[int]) -> list[int]:
        """Return the shape of each outline by its `number`; later outlines may connect shapes."""
        return [self._root(number) for number in numbers]

    def _root(self, number: int) -> int:
        while self._parent[number] != number:
            self._parent[number] = self._parent[self._parent[number]]
            number = self._parent[number]
        return number

    def _moments(self, points: Floats) -> Floats:
        """Compute means of squares of coordinates of points (k, d) that no allowed move changes."""
        square = (points**2).sum(axis=1)
        moments = [square.mean(), np.sqrt((square**2).mean())]
        if not self.rotate:
            moments += (points**2).mean(axis=0).tolist()
        if not (self.rotate or self.flip):
            moments += (points * abs(points)).mean(axis=0).tolist()
        return np.array(moments)


def shape_numbers(outlines: Sequence[Outline], reach: float, *, flip: bool) -> list[int]:
    """Assign numbers to outlines by shape, from 1; rotated copies have the same shape."""
    kinds = Kinds(reach, rotate=True, flip=flip)
    roots = kinds.roots([kinds.number(outline) for outline in outlines])
    order = {root: k for k, root in enumerate(dict.fromkeys(roots), 1)}
    return [order[root] for root in roots]


def alike(a: Outline, b: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> bool:
    """Return True if two outlines coincide after an allowed move."""
    return deviation(a, b, reach, rotate=rotate, flip=flip) <= 2.0 * reach


def deviation(a: Outline, b: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> float:
    """Return the largest distance of paired corners and middles of two outlines after the best move, else inf."""
    # Shifts are always allowed; `rotate` and `flip` allow rotations and mirrors as in `Kinds`. Middles of edges or
    # faces are paired too.
    same_size = abs(a.size - b.size) <= 1e-3 * max(a.size, b.size)
    if not same_size or a.count != b.count or len(a.points) != len(b.points):
        return math.inf
    least = _distance_after_fit(a.points, a.count, b, reach, rotate=False)
    if least > _SAME * reach and (rotate or flip):
        turns = _turns(a, b, reach, flip) if rotate else _axis_mirrors(a.points.shape[1])
        for matrix in turns:
            least = min(least, _distance_after_fit(a.points @ matrix.T, a.count, b, reach, rotate=rotate))
            if least <= _SAME * reach:
                break
    return least


def _distance_after_fit(points: Floats, count: int, other: Outline, reach: float, *, rotate: bool) -> float:
    """Return the largest distance of points, `count` corners and middles, to partners on an outline; inf without."""
    from scipy.spatial import cKDTree  # local import: slow to import and seldom needed

    pairs = []
    for start, end in ((0, count), (count, len(points))):
        if start == end:
            continue
        distance, nearest = cKDTree(other.points[start:end]).query(points[start:end])
        limit = _PAIRED if rotate else 2.0
        if float(np.max(distance)) > limit * reach or len(np.unique(nearest)) != end - start:
            return math.inf
        pairs.append(start + nearest)
    partners = other.points[np.concatenate(pairs)]
    if rotate:
        # the rotation of least squares (Kabsch)
        u, _, v = np.linalg.svd(points.T @ partners)
        sign = np.ones(points.shape[1])
        sign[-1] = np.sign(np.linalg.det(u @ v))
        points = points @ (u * sign) @ v
    return float(np.sqrt(((points - partners) ** 2).sum(axis=1)).max())


def _axis_mirrors(dimension: int) -> list[Floats]:
    """Return all products of mirrors along the axes but the identity, as matrices (d, d)."""
    signs = itertools.product((1.0, -1.0), repeat=dimension)
    return [np.diag(sign) for sign in signs if min(sign) < 0.0]


def _turns(a: Outline, b: Outline, reach: float, flip: bool) -> list[Floats]:
    """Return the orthogonal matrices (d, d) that may map one outline onto the other."""
    # Rotations and, with `flip`, also rotations combined with a mirror. Each maps a far corner, in space two, onto
    # corners at the same distance from the centroid.
    d = a.points.shape[1]
    corners, images = a.points[: a.count], b.points[: b.count]
    radius, image_radius = np.linalg.norm(corners, axis=1), np.linalg.norm(images, axis=1)
    first = int(np.argmax(radius))
    slack = _PAIRED * reach
    matrices: list[Floats] = []
    signs = [1.0] + [-1.0] * flip
    if d == 2:
        for q in np.flatnonzero(abs(image_radius - radius[first]) <= slack).tolist():
            for sign in signs:
                angle = np.arctan2(images[q, 1], images[q, 0]) - sign * np.arctan2(corners[first, 1], corners[first, 0])
                c, s = np.cos(angle), np.sin(angle)
                matrices.append(np.array([[c, -s], [s, c]]) @ np.diag([1.0, sign]))
        return matrices
    offset = np.linalg.norm(np.cross(corners, corners[first]), axis=1)
    second = int(np.argmax(offset))
    gram = float(corners[first] @ corners[second])
    base = frame(corners[[first, second]])
    for p in np.flatnonzero(abs(image_radius - radius[first]) <= slack).tolist():
        for q in np.flatnonzero(abs(image_radius - radius[second]) <= slack).tolist():
            if p == q or abs(float(images[p] @ images[q]) - gram) > slack * 2.0 * radius[first]:
                continue
            for sign in signs:
                matrices.append(frame(images[[p, q]]).T @ np.diag([1.0, 1.0, sign]) @ base)
    return matrices


_GRID: Final = 1e-12  # grid width relative to the smaller region: far below the required accuracy of contacts, 1e-9

# Largest coordinate, in sizes of the smaller region, up to which the grid keeps its width. Doubles resolve 1e-12 of it;
# beyond, the grid is widened.
_MOST: Final = 500.0


def intersections(first: Sequence[shapely.Geometry], second: Sequence[shapely.Geometry]) -> Any:
    """Intersect pairs of regions (n,), each on a rounding grid about its own middle; empty where nothing is shared."""
    regions_1, regions_2 = np.asarray(first, dtype=object), np.asarray(second, dtype=object)
    boxes = np.nan_to_num(np.stack([shapely.bounds(regions_1), shapely.bounds(regions_2)])).reshape(2, -1, 2, 2)
    middle = 0.5 * (boxes[:, :, 0].max(axis=0) + boxes[:, :, 1].min(axis=0))
    size = (boxes[:, :, 1] - boxes[:, :, 0]).max(axis=2).min(axis=0)
    farthest = abs(boxes - middle[None, :, None]).max(axis=(0, 2, 3))
    unit = np.maximum(size, farthest / _MOST)
    unit[unit == 0.0] = 1.0
    scaled = [_scale_and_shift(regions, -middle / unit[:, None], 1.0 / unit) for regions in (regions_1, regions_2)]
    return _scale_and_shift(shapely.intersection(*scaled, grid_size=_GRID), middle, unit)


def area_of(region: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a region, without lines, points and bridges to holes.

    Parameters
    ----------
    region : shapely geometry
        Region, also an invalid one.

    Returns
    -------
    shapely.MultiPolygon
        Polygons with an area; empty where there are none.
    """
    parts = shapely.get_parts(shapely.get_parts(region if region.is_valid else shapely.make_valid(region)))
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon" and part.area > 0.0])


def _scale_and_shift(regions: Any, shift: Floats, factor: Floats) -> Any:
    """Scale regions (n,) by factors (n,), then shift them by (n, 2)."""
    owner = np.repeat(np.arange(len(regions)), shapely.get_num_coordinates(regions))
    return shapely.transform(regions, lambda points: points * factor[owner, None] + shift[owner])


Rings = tuple[Floats, tuple[Floats, ...]]  # shell (k, 2), counter-clockwise, and holes (k, 2) each, clockwise


def clean_parts(region: shapely.Geometry, reach: float) -> list[Rings]:
    """Split a region into parts without details narrower than `reach`: shell and holes, by mean corner."""
    parts_with_holes = []
    for part in _polygons(region):
        for piece in _without_necks(part, reach):
            shell = measures.corners(_ring(piece.exterior), reach)
            extent = float((shell.max(axis=0) - shell.min(axis=0)).max())
            if 2.0 * abs(measures.area(shell[None])[0]) <= reach * extent:
                continue
            holes = [ring for ring in piece.interiors if 2.0 * shapely.Polygon(ring).area > reach * ring.length]
            inner = tuple(_orient(measures.corners(_ring(hole), reach), -1.0) for hole in holes)
            parts_with_holes.append((_orient(shell, 1.0), inner))
    return sorted(parts_with_holes, key=lambda rings: tuple(rings[0].mean(axis=0)))


def _polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    return list(shapely.get_parts(area_of(region)))


def _without_necks(part: shapely.Polygon, reach: float) -> list[shapely.Polygon]:
    """Split a polygon at necks narrower than half of `reach`; [] if all of it is narrower."""
    wide_parts = _polygons(shapely.buffer(part, -0.25 * reach, join_style="mitre"))
    if len(wide_parts) < 2:
        return [part] if wide_parts else []
    enlarged = [shapely.buffer(wide_part, 0.5 * reach, join_style="mitre") for wide_part in wide_parts]
    candidates = [_polygons(pieces) for pieces in intersections([part] * len(enlarged), enlarged)]
    return [max(pieces, key=lambda piece: piece.area) for pieces in candidates if pieces]


def _ring(ring: shapely.LinearRing) -> Floats:
    """Return the corners (k, 2) of a closed ring, without the repeated last one."""
    corners: Floats = shapely.get_coordinates(ring)[:-1]
    return corners


def _orient(ring: Floats, sense: float) -> Floats:
    """Orient a ring (k, 2) counter-clockwise (sense 1) or clockwise (sense −1)."""
    return ring if sense * measures.area(ring[None])[0] > 0.0 else ring[::-1].copy()
