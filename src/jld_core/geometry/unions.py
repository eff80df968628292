"""Union of the cells of one block, as one outline or one closed surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.geometry.outlines import area_of
from jld_core.geometry.polyhedra import Faces, Facets, facets_of
from jld_core.geometry.snapping import snap_polygons, straight, without_spikes
from jld_core.geometry.vectors import across
from jld_core.linalg import merged_points

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Distance within which corners of a planar block coincide, relative to the block's size. It exceeds the gap that
# contacts may have.
_NEAR: Final = 1e-6

# Distance within which corners of a spatial block coincide, relative to the block's size
_NEAR_SOLID: Final = 2.0 * tolerances.FACE


_PARALLEL: Final = 1e-8  # one less the cosine between normals up to which facets lie in one plane

_HAIR: Final = 1e-7  # relative shrinkage of holes before triangulation, so that they do not touch the shell


@dataclass(frozen=True)
class Region:
    shell: Floats  # (k, 2) outer boundary, counter-clockwise, scene units
    holes: tuple[Floats, ...] = ()  # boundaries of holes, clockwise


@dataclass(frozen=True)
class Surface:
    """Closed surface of plane faces, with a triangulation."""

    points: Floats  # (k, 3) vertices, scene units
    faces: Faces  # plane loops of vertex indices, outward
    triangles: tuple[tuple[int, int, int], ...]  # triangles of the same surface, outward


def union_outlines(outlines: Sequence[Floats]) -> list[Region]:
    """Unite polygons to connected regions, ordered by their bounding boxes from left to right."""
    size = float(np.ptp(np.concatenate(list(outlines)), axis=0).max())
    snapped = snap_polygons(outlines, _NEAR * size, keep_nodes=True)
    whole = shapely.union_all([shapely.Polygon(ring) for ring in snapped.paths])
    parts = [part for part in shapely.get_parts(whole) if part.area > _NEAR**2 * size**2]
    parts.sort(key=lambda part: part.bounds)
    return [region_of(part) for part in parts]


def region_of(part: shapely.Polygon) -> Region:
    """Convert a shapely polygon to a `Region` without corners in straight edges."""
    part = shapely.Polygon(part.exterior, part.interiors)
    shell, *holes = [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
    shell = shell if part.exterior.is_ccw else shell[::-1]
    clockwise = [hole[::-1] if ring.is_ccw else hole for hole, ring in zip(holes, part.interiors, strict=True)]
    return Region(straight(shell), tuple(straight(hole) for hole in clockwise))


def extrude(region: Region, depth: float) -> Surface:
    """Extrude a region of the x–z plane from y = 0 to y = depth: closed, with outward faces."""
    rings = (region.shell, *region.holes)
    flat = np.concatenate(rings)
    count = len(flat)
    cap = triangulate_region(flat, _number_corners(rings))
    points = np.concatenate([np.column_stack([flat[:, 0], np.full(count, y), flat[:, 1]]) for y in (0.0, depth)])
    # Seen from −y with x to the right and z up, counter-clockwise rings face outward; sides run from there along +y.
    front = [tuple(triangle) for triangle in cap]
    back = [(a + count, c + count, b + count) for a, b, c in cap]
    sides: list[tuple[int, ...]] = []
    first_corner = 0
    for ring in rings:
        size = len(ring)
        sides += [
            (
                first_corner + k,
                first_corner + count + k,
                first_corner + count + (k + 1) % size,
                first_corner + (k + 1) % size,
            )
            for k in range(size)
        ]
        first_corner += size
    caps: list[tuple[int, ...]] = [*front, *back]
    if not region.holes:
        caps = [tuple(range(count)), tuple(range(2 * count - 1, count - 1, -1))]
    side_triangles = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return Surface(points, (*caps, *sides), (*front, *back, *side_triangles))  # type: ignore[arg-type]


def union_solids(vertices: Sequence[Floats], faces: Sequence[Faces]) -> Surface:
    """Compute the outer surface of polyhedra that touch along parts of their faces."""
    all_corners = np.concatenate(list(vertices))
    size = float(np.ptp(all_corners, axis=0).max())
    corners, _ = merged_points(all_corners, _NEAR_SOLID * size)
    facets = facets_of(list(vertices), list(faces))
    pieces = [piece for plane in _planes(facets, _NEAR_SOLID * size) for piece in _outside(facets, plane, size)]
    from scipy.spatial import cKDTree  # local imports here and below: slow to import and seldom needed

    tree = cKDTree(corners)
    # loops of each piece, with corners of the solids in the place of those near them
    rings: list[list[Floats]] = []
    for _, loops in pieces:
        snapped_loops = []
        for loop in loops:
            distance, nearest = (np.asarray(values) for values in tree.query(loop))
            snapped_loops.append(np.where((distance <= _NEAR_SOLID * size)[:, None], corners[nearest], loop))
        rings.append(snapped_loops)
    loop_points = np.concatenate([loop for loops in rings for loop in loops])
    points, node = merged_points(loop_points, _NEAR_SOLID * size)
    numbers = iter(np.split(node, np.cumsum([len(loop) for loops in rings for loop in loops])[:-1]))
    surface: list[tuple[int, ...]] = []
    triangles: list[tuple[int, int, int]] = []
    points_tree = cKDTree(points)
    for (normal, _), loops in zip(pieces, rings, strict=True):
        nodes = [next(numbers).tolist() for _ in loops]
        if len(vertices) > 1:
            nodes = [_with_nodes(loop, points, points_tree, _NEAR_SOLID * size) for loop in nodes]
        closed = [loop for loop in (without_spikes(loop, closed=True) for loop in nodes) if len(loop) > 2]
        if not closed:
            continue
        flat_points = points @ -across(normal).T
        piece_triangles = triangulate_region(flat_points, closed)
        triangles += piece_triangles
        # a face with holes is stated by its triangles
        surface += [tuple(closed[0])] if len(closed) == 1 else piece_triangles
    return Surface(points, tuple(surface), tuple(triangles))


def _planes(facets: Facets, reach: float) -> list[list[int]]:
    """Group facets by the plane they lie in, regardless of the sense of their normals."""
    groups: list[list[int]] = []
    # the first facet of each group
    first = np.zeros(len(facets), dtype=np.int64)
    for k in range(len(facets)):
        origin, normal = facets.origin[first[: len(groups)]], facets.normal[first[: len(groups)]]
        distance = np.abs(np.einsum("ij,ij->i", facets.origin[k] - origin, normal))
        is_in_plane = (np.abs(normal @ facets.normal[k]) > 1.0 - _PARALLEL) & (distance <= reach)
        if is_in_plane.any():
            groups[int(np.argmax(is_in_plane))].append(k)
        else:
            first[len(groups)] = k
            groups.append([k])
    return groups


_GRID: Final = 1e-9  # grid of unions, relative to the size of the solids


def _outside(facets: Facets, plane: list[int], size: float) -> list[tuple[Floats, list[Floats]]]:
    """Compute outer regions of solids in one plane, normal and loops (k, 3); opposite facets cancel."""
    normal = facets.normal[plane[0]]
    if len(plane) == 1:
        return [(normal, list(facets.loops[plane[0]]))]
    frame, origin = -across(normal), facets.origin[plane[0]]

    def region(facet: int) -> shapely.Geometry:
        loops = [(loop - origin) @ frame.T for loop in facets.loops[facet]]
        return area_of(shapely.Polygon(loops[0], loops[1:]))

    sides = [[region(k) for k in plane if facets.normal[k] @ normal * sign > 0.0] for sign in (1.0, -1.0)]
    grid = _GRID * size
    facing, opposite = (shapely.union_all(side, grid_size=grid) if side else shapely.Polygon() for side in sides)
    regions = []
    for sign, region_up, region_down in ((1.0, facing, opposite), (-1.0, opposite, facing)):
        uncovered = shapely.difference(region_up, region_down, grid_size=grid)
        for part in shapely.get_parts(uncovered):
            if part.geom_type != "Polygon" or part.area <= (_NEAR_SOLID * size) * part.length:
                continue
            region_cleaned = region_of(part)
            loops = [ring @ frame + origin for ring in (region_cleaned.shell, *region_cleaned.holes)]
            regions.append((sign * normal, loops if sign > 0.0 else [loop[::-1] for loop in loops]))
    return regions


def _with_nodes(loop: list[int], points: Floats, tree: cKDTree, reach: float) -> list[int]:
    """Insert the points (n, 3) that lie within `reach` of the edges of a loop as its corners."""
    result: list[int] = []
    for a, b in zip(loop, [*loop[1:], loop[0]], strict=True):
        if a == b:
            continue
        result.append(a)
        edge = points[b] - points[a]
        length = float(np.linalg.norm(edge))
        candidates = [k for k in tree.query_ball_point(0.5 * (points[a] + points[b]), 0.5 * length) if k not in (a, b)]
        on_edge = []
        for k in candidates:
            share = float((points[k] - points[a]) @ edge) / length**2
            if np.linalg.norm(points[k] - points[a] - share * edge) <= reach and 0.0 < share < 1.0:
                on_edge.append((share, k))
        result += [k for _, k in sorted(on_edge)]
    return result


def _number_corners(rings: Sequence[Floats]) -> list[list[int]]:
    """Return consecutive indices for the corners of several rings, one list per ring."""
    stops = np.cumsum([0, *(len(ring) for ring in rings)])
    return [list(range(a, b)) for a, b in zip(stops[:-1].tolist(), stops[1:].tolist(), strict=True)]


def triangulate_region(points: Floats, loops: Sequence[Sequence[int]]) -> list[tuple[int, int, int]]:
    """Triangulate a shell and its holes in points (k, 2), counter-clockwise and without new points."""
    rings = [points[list(loop)] for loop in loops]
    if len(loops) == 1 and _is_strictly_convex(rings[0]):
        (loop,) = loops
        return [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
    # A hole may touch the shell in a corner, which the triangulation refuses: shrink holes slightly.
    rings[1:] = [ring + _HAIR * (ring.mean(axis=0) - ring) for ring in rings[1:]]
    number = {
        tuple(p): k for loop, ring in zip(loops, rings, strict=True) for k, p in zip(loop, ring.tolist(), strict=True)
    }
    triangles = []
    for triangle in shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:])).geoms:
        a, b, c = shapely.get_coordinates(triangle)[:3]
        if (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0] < 0.0:
            b, c = c, b
        nodes = (number[tuple(a.tolist())], number[tuple(b.tolist())], number[tuple(c.tolist())])
        if len(set(nodes)) == 3:
            triangles.append(nodes)
    return triangles


def _is_strictly_convex(ring: Floats) -> bool:
    """Return True if a counter-clockwise outline (k, 2) is strictly convex at every corner."""
    outgoing = np.roll(ring, -1, axis=0) - ring
    incoming = np.roll(outgoing, 1, axis=0)
    turn = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
    return bool((turn > 1e-9 * np.abs(turn).max()).all())
