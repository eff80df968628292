"""Closed polyhedra: orientation, volume, centroid and plane facets.

A **facet** is a whole plane piece of a surface; a **face** is a loop of vertices in a scene, perhaps part of a facet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.errors import InputError
from jld_core.geometry import outlines as measures
from jld_core.geometry.outlines import area_of
from jld_core.geometry.vectors import area_vector
from jld_core.linalg import components

Faces = tuple[tuple[int, ...], ...]
"""Faces of one polyhedron: loops of vertex indices."""


@dataclass(frozen=True)
class Facets:
    """Plane facets of all elements, in the order of the elements."""

    element: Ints  # (f,) index of the element that owns the facet
    normal: Floats  # (f, 3) outward unit normal
    origin: Floats  # (f, 3) point of the plane: the mean of the outer corners, scene units
    size: Floats  # (f,) largest extent of the bounding box, scene units
    # lower, upper: (f, 3) corners of the bounding box, scene units
    lower: Floats
    upper: Floats
    # per facet its boundary, counter-clockwise about the normal, then the boundaries of its holes, clockwise
    loops: tuple[tuple[Floats, ...], ...]

    def __len__(self) -> int:
        return len(self.element)

    @cached_property
    def four(self) -> tuple[Ints, Floats]:
        """Facets with four corners and no hole: row (f,) or −1, and corners (q, 4, 3) by row."""
        simple = [index for index, loops in enumerate(self.loops) if len(loops) == 1 and len(loops[0]) == 4]
        row = np.full(len(self), -1, dtype=np.int64)
        row[simple] = np.arange(len(simple))
        return row, np.array([self.loops[index][0] for index in simple]).reshape(-1, 4, 3)


def spread(start: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Concatenate index ranges start[i] … start[i] + count[i] − 1; return range and index of every entry."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.concatenate([[0], np.cumsum(count)])[:-1]
    return owner, start[owner] + np.arange(len(owner)) - first[owner]


@dataclass(frozen=True)
class Surface:
    """Loops of all faces of all elements in flat arrays, with c corners."""

    points: Floats  # (v, 3) vertices of all elements
    # vertex, after: (c,) vertex of each corner and the next vertex along its loop
    vertex: Ints
    after: Ints
    face: Ints  # (c,) face of each corner
    # start, count: (faces,) first corner and number of corners of each face
    start: Ints
    count: Ints
    element: Ints  # (faces,) element of each face


def lay_out(vertices: list[Floats], faces: list[Faces]) -> Surface:
    """Put the faces of all elements into flat arrays."""
    shift = np.concatenate([[0], np.cumsum([len(v) for v in vertices])])[:-1].astype(np.int64)
    element = np.repeat(np.arange(len(faces)), [len(f) for f in faces])
    count = np.array([len(loop) for loops in faces for loop in loops], dtype=np.int64)
    local = np.array([index for loops in faces for loop in loops for index in loop], dtype=np.int64)
    start = np.concatenate([[0], np.cumsum(count)])[:-1].astype(np.int64)
    face = np.repeat(np.arange(len(count)), count)
    vertex = local + shift[element[face]]
    following = np.arange(len(vertex)) + 1
    last = start + count - 1
    following[last] = start
    return Surface(np.concatenate(vertices), vertex, vertex[following], face, start, count, element)


def solids(
    ids: list[str], vertices: list[Floats], faces: list[Faces]
) -> tuple[list[Floats], list[Faces], Floats, Floats]:
    """Orient the faces of polyhedra outward and compute volumes and centroids.

    Parameters
    ----------
    ids : list of str
        Names of the n elements, for error messages.
    vertices, faces : list of (k, 3) arrays, list of Faces
        Vertices of each element, and its loops of indices in any sense of rotation.

    Returns
    -------
    vertices, faces : list of (k, 3) arrays, list of Faces
        Loops outward; they name coinciding vertices as one where the surface would be open otherwise.
    volume, centroid : (n,) and (n, 3) array
        By the divergence theorem on triangles about the mean corner of each face, which need not be plane.

    Raises
    ------
    InputError
        The surface of an element is not closed, or encloses no volume.
    """
    vertices, faces = list(vertices), list(faces)
    surface = lay_out(vertices, faces)
    open_elements = np.flatnonzero(~_is_closed(surface, len(ids)))
    for index in open_elements:
        faces[index] = _close_surface(ids[index], vertices[index], faces[index])
    if open_elements.size:
        surface = lay_out(vertices, faces)
    volume, centroid = _divergence(surface, vertices)
    spans = np.array([np.ptp(v, axis=0).max() for v in vertices])
    empty = np.flatnonzero(~(np.abs(volume) > 1e-12 * spans**3))
    if empty.size:
        raise InputError(f"element {ids[empty[0]]!r}", "its faces enclose no volume", "a polyhedron with a volume")
    for index in np.flatnonzero(volume < 0.0):
        faces[index] = tuple(loop[::-1] for loop in faces[index])
    return vertices, faces, np.abs(volume), centroid


def _is_closed(surface: Surface, count: int) -> Bools:
    """Return a mask (n,) of elements whose surface is closed and consistently oriented."""
    # Each edge of such an element occurs equally often in both senses, and none joins a vertex to itself.
    width = len(surface.points)
    low, high = np.minimum(surface.vertex, surface.after), np.maximum(surface.vertex, surface.after)
    _, edge = np.unique(low * width + high, return_inverse=True)
    balance = np.bincount(edge, weights=np.where(surface.vertex < surface.after, 1.0, -1.0))
    closed = np.ones(count, dtype=bool)
    element = surface.element[surface.face]
    closed[element[(balance[edge] != 0.0) | (low == high)]] = False
    return closed


_SAME: Final = 1e-2  # share of `tolerances.FACE` of the size of an element up to which its vertices coincide


def _close_surface(name: str, vertices: Floats, faces: Faces) -> Faces:
    """Return the faces of an element with coinciding vertices as one, oriented alike; InputError if they are open."""
    loops = _weld_vertices(vertices, faces)
    refusal = InputError(f"element {name!r}", "its faces do not close", "faces that meet in pairs along every edge")
    oriented = _oriented_alike(loops)
    if oriented is None or not _is_closed(lay_out([vertices], [oriented]), 1)[0]:
        raise refusal
    return oriented


def _weld_vertices(vertices: Floats, faces: Faces) -> list[tuple[int, ...]]:
    """Return the loops of faces with the first of each group of coinciding vertices in the place of all."""
    from scipy.spatial import cKDTree  # local imports here and below: slow to import, and used by spatial scenes only

    tree = cKDTree(vertices)
    pairs = tree.query_pairs(_SAME * tolerances.FACE * float(np.ptp(vertices, axis=0).max()), output_type="ndarray")
    group = components(len(vertices), pairs[:, 0], pairs[:, 1])
    first = np.full(len(vertices), len(vertices), dtype=np.int64)
    np.minimum.at(first, group, np.arange(len(vertices)))
    loops = []
    for loop in faces:
        welded_loop = [int(first[group[index]]) for index in loop]
        welded = tuple(index for position, index in enumerate(welded_loop) if index != welded_loop[position - 1])
        if len(welded) > 2:
            loops.append(welded)
    return loops


def _oriented_alike(loops: list[tuple[int, ...]]) -> Faces | None:
    """Turn loops until neighbours agree; None if they do not meet in pairs along every edge."""
    users: dict[tuple[int, int], list[tuple[int, bool]]] = {}  # position of each loop, and whether it runs upwards
    for position, loop in enumerate(loops):
        for u, v in zip(loop, loop[1:] + loop[:1], strict=True):
            users.setdefault((min(u, v), max(u, v)), []).append((position, u < v))
    if not loops or any(len(pair) != 2 for pair in users.values()):
        return None
    pairs = np.array([[first[0], second[0]] for first, second in users.values()])
    # two faces agree if they run along their edge in opposite senses
    agree = {(first[0], second[0]): first[1] != second[1] for first, second in users.values()}
    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(loops), len(loops)))
    _, shell = connected_components(graph, directed=False)
    is_reversed = np.zeros(len(loops), dtype=bool)
    for root in np.unique(shell, return_index=True)[1]:
        order, parent = breadth_first_order(graph, int(root), directed=False)
        for child in order[1:]:
            parent_loop = int(parent[child])
            agrees = agree.get((parent_loop, int(child)), agree.get((int(child), parent_loop)))
            is_reversed[child] = is_reversed[parent_loop] if agrees else not is_reversed[parent_loop]
    return tuple(loop[::-1] if reverse else loop for loop, reverse in zip(loops, is_reversed, strict=True))


def _divergence(surface: Surface, vertices: list[Floats]) -> tuple[Floats, Floats]:
    """Compute signed volumes (n,) and centroids (n, 3) by the divergence theorem."""
    base = np.array([v[0] for v in vertices])
    owner = surface.element[surface.face]
    origin = base[owner]
    # the mean of its corners, so that a warped face bounds both its elements alike, wherever its loops begin
    middle = np.add.reduceat(surface.points[surface.vertex], surface.start) / surface.count[:, None]
    first = middle[surface.face] - origin
    start, end = surface.points[surface.vertex] - origin, surface.points[surface.after] - origin
    share = np.einsum("ij,ij->i", first, np.cross(start, end)) / 6.0
    count = len(vertices)
    volume = np.bincount(owner, weights=share, minlength=count)
    moment = 0.25 * share[:, None] * (first + start + end)
    total = np.column_stack([np.bincount(owner, weights=moment[:, k], minlength=count) for k in range(3)])
    safe = np.where(volume == 0.0, 1.0, volume)
    return np.asarray(volume), np.asarray(base + total / safe[:, None])


def facets_of(vertices: list[Floats], faces: list[Faces]) -> Facets:
    """Compute the plane facets of polyhedra, joining neighbouring faces that lie in one plane.

    Parameters
    ----------
    vertices : list of (k, 3) arrays
        Vertices of each element, scene units.
    faces : list of Faces
        Outward loops of each element, as `solids` returns them.

    Returns
    -------
    Facets
        Facets with an area, in the order of the elements.
    """
    surface = lay_out(vertices, faces)
    corner = surface.points[surface.vertex]
    # Coordinates relative to a corner of the face: far from the origin, absolute ones lose digits.
    arm = corner - corner[surface.start[surface.face]]
    doubled = np.cross(arm, surface.points[surface.after] - corner[surface.start[surface.face]])
    count = len(surface.count)
    vector = np.zeros((count, 3))
    np.add.at(vector, surface.face, 0.5 * doubled)
    extent = np.maximum.reduceat(corner, surface.start) - np.minimum.reduceat(corner, surface.start)
    group, is_single = _join_coplanar(surface, vector, np.asarray(extent.max(axis=1)))
    # A face that repeats a vertex has a hole, joined to its outline by an edge that occurs in both directions.
    is_single &= ~_repeats(surface)
    total = np.zeros((int(group.max()) + 1, 3))
    np.add.at(total, group, vector)
    has_area = np.linalg.norm(total, axis=1) > 0.0
    loops = _loops_of_groups(surface, group, is_single, total)
    element = np.zeros(len(total), dtype=np.int64)
    element[group] = surface.element
    facet_groups = [index for index in range(len(loops)) if has_area[index] and loops[index]]
    outer = np.concatenate([loops[index][0] for index in facet_groups])
    counts = np.array([len(loops[index][0]) for index in facet_groups])
    first_corner = np.concatenate([[0], np.cumsum(counts)])[:-1]
    lower, upper = np.minimum.reduceat(outer, first_corner), np.maximum.reduceat(outer, first_corner)
    return Facets(
        element=element[facet_groups],
        normal=total[facet_groups] / np.linalg.norm(total[facet_groups], axis=1)[:, None],
        origin=np.add.reduceat(outer, first_corner) / counts[:, None],
        size=(upper - lower).max(axis=1),
        lower=lower,
        upper=upper,
        loops=tuple(loops[index] for index in facet_groups),
    )


def _loops_of_groups(surface: Surface, group: Ints, is_single: Bools, area: Floats) -> list[tuple[Floats, ...]]:
    """Return the loops (k, 3) of joined faces, group by group; area: (groups, 3) area vectors."""
    corner = surface.points[surface.vertex]
    members = np.argsort(group, kind="stable")
    first = np.searchsorted(group[members], np.arange(len(area) + 1))
    loops: list[tuple[Floats, ...]] = []
    for index, (begin, end) in enumerate(pairwise(first.tolist())):
        face = members[begin]
        if is_single[face]:
            loops.append((corner[surface.start[face] : surface.start[face] + surface.count[face]],))
        else:
            loops.append(_boundary(surface, members[begin:end], area[index]))
    return loops


def _repeats(surface: Surface) -> Bools:
    """Return a mask of faces that contain a vertex more than once."""
    order = np.lexsort((surface.vertex, surface.face))
    face, vertex = surface.face[order], surface.vertex[order]
    repeated = np.flatnonzero((face[1:] == face[:-1]) & (vertex[1:] == vertex[:-1]))
    repeats = np.zeros(len(surface.count), dtype=bool)
    repeats[face[repeated]] = True
    return repeats


_STRAIGHT: Final = 0.99  # cosine between neighbouring faces below which they are not compared further


def _join_coplanar(surface: Surface, vector: Floats, size: Floats) -> tuple[Ints, Bools]:
    """Join neighbouring faces in one plane: facet (faces,) of each, and a mask of faces left alone."""
    width = len(surface.points)
    low, high = np.minimum(surface.vertex, surface.after), np.maximum(surface.vertex, surface.after)
    key = low * width + high
    order = np.argsort(key, kind="stable")
    neighbours = np.flatnonzero(key[order][1:] == key[order][:-1])
    face, neighbour = surface.face[order[neighbours]], surface.face[order[neighbours + 1]]
    norm = np.linalg.norm(vector, axis=1)
    # Test coplanarity with the normal of the larger face: its rounding error is smaller.
    swap = norm[face] < norm[neighbour]
    larger, smaller = np.where(swap, neighbour, face), np.where(swap, face, neighbour)
    cosine = np.einsum("ij,ij->i", vector[larger], vector[smaller])
    straight = cosine > _STRAIGHT * norm[larger] * norm[smaller]
    larger, smaller = larger[straight], smaller[straight]
    count = len(norm)
    if len(larger):
        owner, position = spread(surface.start[smaller], surface.count[smaller])
        base = larger[owner]
        arm = surface.points[surface.vertex[position]] - surface.points[surface.vertex[surface.start[base]]]
        height = np.abs(np.einsum("ij,ij->i", arm, vector[base])) / norm[base]
        distance = np.maximum.reduceat(height, np.concatenate([[0], np.cumsum(surface.count[smaller])])[:-1])
        in_plane = distance <= tolerances.FACE * np.maximum(size[larger], size[smaller])
        larger, smaller = larger[in_plane], smaller[in_plane]
    group = components(count, larger, smaller)
    return group, np.bincount(group)[group] == 1


def _boundary(surface: Surface, members: Ints, vector: Floats) -> tuple[Floats, ...]:
    """Return the boundary loops (k, 3) of joined faces, the outer one first; vector: (3,) area."""
    # Edges that occur in both senses are inside and left out.
    _, position = spread(surface.start[members], surface.count[members])
    edges = list(zip(surface.vertex[position].tolist(), surface.after[position].tolist(), strict=True))
    inside = set(edges)
    followers: dict[int, list[int]] = {}
    for u, v in edges:
        if (v, u) not in inside:
            followers.setdefault(u, []).append(v)
    loops_by_area: list[tuple[float, Floats]] = []
    for begin in list(followers):
        while followers[begin]:
            loop, node = [begin], followers[begin].pop()
            while node != begin:
                loop.append(node)
                node = followers[node].pop()
            points = surface.points[loop]
            loops_by_area.append((float(area_vector(points) @ vector), points))
    loops_by_area.sort(key=lambda entry: -entry[0])
    return tuple(points for _, points in loops_by_area)


PARALLEL: Final = 1e-9  # tolerance for parallel sides (sine of the angle) and for rectangles (share of the diagonals)


@dataclass(frozen=True)
class FacetFrames:
    """Two axes in the plane of each of f facets, and which facets are rectangles."""

    e1: Floats  # (f, 3) unit vectors along the longest edge
    e2: Floats  # (f, 3) normal × e1
    rectangle: Bools  # (f,) True for rectangles without holes, within the tolerance `PARALLEL`

    @classmethod
    def on(cls, facets: Facets) -> FacetFrames:
        e1 = np.empty((len(facets), 3))
        rectangle = np.zeros(len(facets), dtype=bool)
        for chosen, stack in measures.by_corner_count([loops[0] for loops in facets.loops]):
            e1[chosen] = longest_edge(stack)
            simple = np.array([len(facets.loops[index]) == 1 for index in chosen])
            rectangle[chosen] = simple & measures.is_rectangle(stack, PARALLEL)
        e1 = unit_vectors(e1 - np.einsum("ij,ij->i", e1, facets.normal)[:, None] * facets.normal)
        return cls(e1, np.cross(facets.normal, e1), rectangle)


def unit_vectors(vectors: Floats) -> Floats:
    """Scale vectors (…, d) to unit length; none of them may be zero."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def longest_edge(polygons: Floats) -> Floats:
    """Return the unit direction (n, 3) of the first longest edge of each polygon (n, k, 3)."""
    edge = np.roll(polygons, -1, axis=1) - polygons
    length = np.linalg.norm(edge, axis=2)
    first = np.argmax(length >= (1.0 - 1e-9) * length.max(axis=1)[:, None], axis=1)
    return unit_vectors(edge[np.arange(len(edge)), first])


def regions_in_planes(facets: Facets, frames: FacetFrames, chosen: Ints, plane: Ints) -> Sequence[shapely.Geometry]:
    """Return the facets `chosen` (k,) as valid polygons in the planes of facets `plane` (k,)."""
    shells = [facets.loops[index][0] for index in chosen]
    count = np.array([len(shell) for shell in shells])
    owner = np.repeat(np.arange(len(chosen)), count)
    flat = project(np.concatenate(shells), facets, frames, plane[owner])
    regions = shapely.polygons(shapely.linearrings(flat, indices=owner))
    for position in [k for k, index in enumerate(chosen) if len(facets.loops[index]) > 1]:
        facet = plane[position]
        rings = [project(loop, facets, frames, np.full(len(loop), facet)) for loop in facets.loops[chosen[position]]]
        regions[position] = shapely.Polygon(rings[0], rings[1:])
    for position in np.flatnonzero(~shapely.is_valid(regions)).tolist():
        # Remaining lines and points have no area, and shapely does not intersect them together with polygons.
        regions[position] = area_of(regions[position])
    return regions  # type: ignore[no-any-return]


def project(points: Floats, facets: Facets, frames: FacetFrames, plane: Ints) -> Floats:
    """Project points (k, 3) to coordinates (k, 2) in the planes of facets `plane` (k,)."""
    arm = points - facets.origin[plane]
    return np.column_stack([np.einsum("ij,ij->i", arm, frames.e1[plane]), np.einsum("ij,ij->i", arm, frames.e2[plane])])


_Loops = tuple[tuple[int, ...], ...]


def contains(shape: Floats, faces: _Loops, point: Floats, reach: float) -> bool:
    """Return True if a point (d,) lies in a polygon or polyhedron, or near its boundary."""
    return distance_to(shape, faces, point) <= reach


def distance_to(shape: Floats, faces: _Loops, point: Floats) -> float:
    """Return the distance of a point (d,) from an outline (k, 2) or a solid (k, 3), 0 inside."""
    if shape.shape[1] == 2:
        ends = np.roll(shape, -1, axis=0)
        p, q = shape - point, ends - point
        angles = np.arctan2(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0], np.einsum("ij,ij->i", p, q))
        return 0.0 if abs(angles.sum()) > np.pi else float(_distances_from_segments(point, shape, ends).min())
    corners = np.array([[loop[0], *pair] for loop in faces for pair in pairwise(loop[1:])])
    triangles = shape[corners] - point
    # Solid angle of each triangle seen from the point; see van Oosterom and Strackee 1983, eq. (8).
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    denominator = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    angle = 2.0 * np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), denominator)
    return 0.0 if abs(angle.sum()) > 2.0 * np.pi else min(_distance_from_triangle(triangle) for triangle in triangles)


def point_in_face(faces: Interfaces, face: int) -> Floats:
    """Return a point (d,) inside a face; its centroid may lie outside."""
    if faces.origin.shape[1] == 2:
        return np.asarray(faces.origin[face])
    flat = shapely.get_coordinates(shapely.point_on_surface(_region(faces, face)))[0]
    return np.asarray(faces.origin[face] + flat @ np.array([faces.e1[face], faces.e2[face]]))


def distance_from_face(faces: Interfaces, face: int, point: Floats) -> float:
    """Return the distance of a point (d,) from a face, 0 inside it."""
    if len(point) == 2:
        return float(shapely.LineString(faces.polygon[face]).distance(shapely.Point(point)))
    arm = point - faces.origin[face]
    flat = shapely.Point(float(arm @ faces.e1[face]), float(arm @ faces.e2[face]))
    return float(np.hypot(_region(faces, face).distance(flat), arm @ faces.normal[face]))


def _region(faces: Interfaces, face: int) -> shapely.MultiPolygon:
    arm = np.asarray(faces.polygon[face], dtype=float) - faces.origin[face]
    return area_of(shapely.Polygon(arm @ np.array([faces.e1[face], faces.e2[face]]).T))


def _distances_from_segments(point: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distances (k,) of a point from segments with ends (k, d)."""
    edge = end - start
    length = np.maximum(np.einsum("ij,ij->i", edge, edge), np.finfo(float).tiny)
    share = np.clip(np.einsum("ij,ij->i", point - start, edge) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[:, None] * edge - point, axis=1))


def _distance_from_triangle(triangle: Floats) -> float:
    """Return the distance of the origin from a triangle (3, 3)."""
    from_edges = float(_distances_from_segments(np.zeros(3), triangle, np.roll(triangle, -1, axis=0)).min())
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    size = float(np.linalg.norm(normal))
    if size == 0.0:
        return from_edges
    projection = (triangle[0] @ normal) / size**2 * normal
    turns = [np.cross(triangle[k - 2] - triangle[k], projection - triangle[k]) @ normal for k in range(3)]
    return min(from_edges, abs(float(triangle[0] @ normal)) / size) if min(turns) >= 0.0 else from_edges
