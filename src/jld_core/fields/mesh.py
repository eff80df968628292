"""Meshes of simplices inside the cells of an assembly: triangles in the plane, tetrahedra in space.

They are conforming across every interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.linalg import merged_points

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


FREE = -1  # tag of an outline edge that belongs to no interface


@dataclass(frozen=True)
class Outlines:
    """Outlines of all free cells over common nodes."""

    points: Floats  # (p, 2) nodes
    cells: Ints  # element of each outline
    rings: tuple[Ints, ...]  # (k,) nodes of each outline, counter-clockwise
    tags: tuple[Ints, ...]  # (k,) interface on its edge from node i to i + 1, or FREE


def outlines_of(assembly: Assembly, extra: Floats | None = None) -> Outlines:
    """Return the outlines of free cells, with nodes at ends of interfaces and at `extra` (k, 2) points."""
    from scipy.spatial import cKDTree  # slow to import, and most searches have no fields

    cells = assembly.elements.free
    shapes = [assembly.elements.shape[cell] for cell in cells]
    ends = np.concatenate([np.asarray(ends, dtype=float) for ends in assembly.interfaces.polygon])
    corners = np.concatenate(shapes)
    places = np.concatenate([ends, corners, np.zeros((0, 2)) if extra is None else extra])
    reach = tolerances.ON_OUTLINE * assembly.size
    points, node = merged_points(places, reach)
    rings, start, tree = [], len(ends), cKDTree(points)
    for shape in shapes:
        rings.append(ring_of(points, tree, node[start : start + len(shape)], reach))
        start += len(shape)
    face_ends = node[: len(ends)].reshape(-1, 2)
    faces_of_cell: list[list[int]] = [[] for _ in assembly.elements.ids]
    for face, pair in enumerate(zip(assembly.interfaces.a.tolist(), assembly.interfaces.b.tolist(), strict=True)):
        for cell in pair:
            faces_of_cell[cell].append(face)
    tags = [
        _tags(points, faces_of_cell[cell], ring, face_ends, reach)
        for cell, ring in zip(cells.tolist(), rings, strict=True)
    ]
    return Outlines(points, cells, tuple(rings), tuple(tags))


def ring_of(points: Floats, tree: cKDTree, corners: Ints, reach: float) -> Ints:
    """Return the nodes of a closed polygon: its corners (k,), and all nodes within `reach` of its edges, in order."""
    corners = corners[corners != np.roll(corners, 1)]
    following = np.roll(corners, -1)
    middle = 0.5 * (points[corners] + points[following])
    half_length = 0.5 * np.linalg.norm(points[following] - points[corners], axis=1)
    nodes_near_edge = tree.query_ball_point(middle, half_length + reach, return_sorted=True)
    nodes: list[int] = []
    for a, b, near_nodes in zip(corners.tolist(), following.tolist(), nodes_near_edge, strict=True):
        direction = points[b] - points[a]
        length = float(np.linalg.norm(direction))
        direction = direction / length
        candidates = np.array(near_nodes, dtype=np.int64)
        offset = points[candidates] - points[a]
        distance = offset @ direction
        height = np.linalg.norm(offset - distance[:, None] * direction, axis=1)
        between = np.flatnonzero((height <= reach) & (distance > reach) & (distance < length - reach))
        nodes += [a, *candidates[between[np.argsort(distance[between])]].tolist()]
    return np.array(nodes, dtype=np.int64)


def _tags(points: Floats, faces: list[int], ring: Ints, face_ends: Ints, reach: float) -> Ints:
    """Return the interface (k,) that covers each edge of an outline, FREE where none does."""
    tags = np.full(len(ring), FREE, dtype=np.int64)
    middle = 0.5 * (points[ring] + points[np.roll(ring, -1)])
    for face in faces:
        a, b = points[face_ends[face]]
        direction = b - a
        length = float(np.hypot(*direction))
        direction = direction / length
        offset = middle - a
        distance = offset @ direction
        height = abs(offset[:, 0] * direction[1] - offset[:, 1] * direction[0])
        tags[(height <= reach) & (distance > 0.0) & (distance < length)] = face
    return tags


_STRAIGHT = 1e-6  # sine of the angle below which an outline runs straight through a node

# Local corners of the sides of a triangle and of a tetrahedron, counter-clockwise seen from outside; side k lacks
# corner k
_SIDES = {2: np.array([[1, 2], [2, 0], [0, 1]]), 3: np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])}

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])  # local corners of the six edges of a tetrahedron

# Weight of the length alone in the choice of an edge. Layers end at an aspect ratio of half its inverse.
_ASPECT = 0.05
_DIGITS = 9  # decimal digits to which lengths of edges are compared; edges of equal length are ordered by number


def patch_tag(patch: int) -> int:
    return -2 - patch


def _outward(corners: Floats) -> Floats:
    """Return normals (..., d), of length (d − 1)! times the size, of sides with corners (..., d, d)."""
    edge = corners[..., 1:, :] - corners[..., :1, :]
    if corners.shape[-1] == 2:
        return np.stack([edge[..., 0, 1], -edge[..., 0, 0]], axis=-1)
    return np.cross(edge[..., 0, :], edge[..., 1, :])


@dataclass(frozen=True)
class Sides:
    # a, b: (f,) simplices; b = −1 on an outline, surface or support
    a: Ints
    b: Ints
    # corner_a, corner_b: (f, d) which corners of a and b the same d nodes are
    corner_a: Ints
    corner_b: Ints
    normal: Floats  # (f, d) unit vector from a to b, or outward
    area: Floats  # (f,) length in the plane
    tag: Ints  # (f,) as `Mesh.tag`; sides inside a cell and free ones have FREE

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True)
class Mesh:
    """Simplices over common nodes, in dimension d = 2 or 3."""

    points: Floats  # (p, d) nodes, scene units
    simplices: Ints  # (t, d + 1) nodes of each simplex, of positive volume
    cell: Ints  # (t,) element of each simplex
    root: Ints  # (t,) simplex of the coarsest mesh that contains it
    tagged: Ints  # (k, d) nodes of the sides on interfaces and load patches, in ascending order
    tag: Ints  # (k,) tag of each of these sides: an interface, or `patch_tag` of a load patch

    def __len__(self) -> int:
        return len(self.simplices)

    @property
    def dimension(self) -> int:
        return int(self.points.shape[1])

    @cached_property
    def corners(self) -> Floats:
        """(t, d + 1, d) positions of the corners of each simplex."""
        return self.points[self.simplices]

    @cached_property
    def volume(self) -> Floats:
        """(t,) volumes of the simplices, areas in the plane, positive."""
        corners = self.corners
        arm, normal = corners[:, 1] - corners[:, 0], _outward(np.delete(corners, 1, axis=1))
        if self.dimension == 2:
            return np.asarray(0.5 * (arm * normal).sum(axis=1))
        return np.asarray(np.einsum("ti,ti->t", arm, normal) / 6.0)

    @cached_property
    def gradient(self) -> Floats:
        """(t, d + 1, d) gradients of the linear functions that are 1 at one corner, 0 at the others."""
        normal = _outward(self.corners[:, _SIDES[self.dimension]])
        return np.asarray(-normal / ((2.0 if self.dimension == 2 else 6.0) * self.volume[:, None, None]))

    @cached_property
    def side_nodes(self) -> tuple[Ints, Ints]:
        """Nodes (u, d) of the distinct sides, in ascending order, and the sides (t, d + 1) of each simplex."""
        of_simplices = np.sort(self.simplices[:, _SIDES[self.dimension]].reshape(-1, self.dimension), axis=1)
        _, first_use, number = np.unique(self._keys(of_simplices), return_index=True, return_inverse=True)
        return of_simplices[first_use], np.asarray(number.reshape(len(self), -1))

    def _keys(self, nodes: Ints) -> Ints:
        """Return one number (k,) for each row of nodes (k, d), in lexicographic order."""
        keys = nodes[:, 0]
        for column in nodes.T[1:]:
            keys = keys * len(self.points) + column
        return keys

    @cached_property
    def side_tags(self) -> Ints:
        """(u,) tag of each side of `side_nodes`, as `Mesh.tag`; FREE without one."""
        unique, _ = self.side_nodes
        tags = np.full(len(unique), FREE, dtype=np.int64)
        if len(self.tagged):
            tags[np.searchsorted(self._keys(unique), self._keys(self.tagged))] = self.tag
        return tags

    @cached_property
    def sides(self) -> Sides:
        # Where two cells share a side that is on no interface, each cell has one of its own.
        _, number = self.side_nodes
        side_of_use, per_simplex = number.ravel(), number.shape[1]
        order = np.argsort(side_of_use, kind="stable")
        side, start, count = np.unique(side_of_use[order], return_index=True, return_counts=True)
        # the first and the second use of each side, as simplex · per_simplex + side of it; −1 without a second
        first = order[start]
        second = np.where(count == 2, order[np.minimum(start + 1, len(order) - 1)], -1)
        tags = self.side_tags[side]
        split = self.cell[first // per_simplex] != self.cell[np.maximum(second, 0) // per_simplex]
        split &= (second >= 0) & (tags < 0)
        second_uses = second[split]
        second = np.concatenate([np.where(split, -1, second), np.full(len(second_uses), -1, dtype=np.int64)])
        tags = np.concatenate([tags, tags[split]])
        first = np.concatenate([first, second_uses])
        a, corner_a = first // per_simplex, _SIDES[self.dimension][first % per_simplex]
        b = np.where(second >= 0, second // per_simplex, -1)
        nodes = self.simplices[a[:, None], corner_a]
        corner_b = (self.simplices[np.maximum(b, 0)][:, None, :] == nodes[:, :, None]).argmax(axis=2)
        outward = _outward(self.points[nodes])
        size = np.hypot(*outward.T) if self.dimension == 2 else np.linalg.norm(outward, axis=1)
        area = size if self.dimension == 2 else 0.5 * size
        return Sides(a, b, corner_a, corner_b, outward / size[:, None], area, tags)


def coarse_mesh(outlines: Outlines) -> Mesh:
    """Fill the outlines of cells with triangles: the coarsest mesh."""
    # Convex cells are fans about an inner node: the intersection of the diagonals of a quadrilateral, otherwise the
    # mean of the corners. Other cells are triangulated by constrained Delaunay, and each triangle is split at its
    # centroid.
    points = [*outlines.points]
    triangles: list[tuple[int, int, int]] = []
    cells: list[int] = []
    edges: dict[tuple[int, int], int] = {}
    for cell, ring, tags in zip(outlines.cells.tolist(), outlines.rings, outlines.tags, strict=True):
        nodes = ring.tolist()
        for a, b, tag in zip(nodes, nodes[1:] + nodes[:1], tags.tolist(), strict=True):
            if tag != FREE:
                edges[min(a, b), max(a, b)] = tag
        centre = _centre(outlines.points[ring])
        if centre is not None:
            triangles_of_cell = [(a, b, len(points)) for a, b in zip(nodes, nodes[1:] + nodes[:1], strict=True)]
            points.append(centre)
        else:
            triangles_of_cell = []
            chains = _chains(outlines.points, ring)
            for corners in _delaunay(outlines.points, list(chains)):
                points.append(np.mean([points[node] for node in corners], axis=0))
                for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                    chain = chains[a] if chains[a][-1] == b else [a, b]
                    triangles_of_cell += [(p, q, len(points) - 1) for p, q in pairwise(chain)]
        triangles += triangles_of_cell
        cells += [cell] * len(triangles_of_cell)
    tagged = np.array(list(edges), dtype=np.int64).reshape(-1, 2)
    return Mesh(
        points=np.array(points),
        simplices=np.array(triangles, dtype=np.int64),
        cell=np.array(cells, dtype=np.int64),
        root=np.arange(len(triangles)),
        tagged=tagged,
        tag=np.array(list(edges.values()), dtype=np.int64),
    )


def _centre(ring: Floats) -> Floats | None:
    """Return the inner node (2,) of a fan over a convex ring (k, 2); None for any other ring."""
    turn, size = _turns(ring)
    if (turn < -_STRAIGHT * size).any():
        return None
    corners = ring[turn > _STRAIGHT * size]
    if len(corners) != 4:
        return np.asarray(corners.mean(axis=0))
    # intersection of the diagonals p and q
    p, q, edge = corners[2] - corners[0], corners[3] - corners[1], corners[1] - corners[0]
    share = (edge[0] * q[1] - edge[1] * q[0]) / (p[0] * q[1] - p[1] * q[0])
    return np.asarray(corners[0] + share * p)


def _chains(points: Floats, ring: Ints) -> dict[int, list[int]]:
    """Map each corner of an outline to the nodes from it to the next corner, both included."""
    turn, size = _turns(points[ring])
    corners = np.flatnonzero(abs(turn) > _STRAIGHT * size)
    nodes = ring.tolist()
    chains = {}
    for start, end in zip(corners.tolist(), np.roll(corners, -1).tolist(), strict=True):
        stop = end if end > start else end + len(nodes)
        chains[nodes[start]] = [nodes[k % len(nodes)] for k in range(start, stop + 1)]
    return chains


def _turns(ring: Floats) -> tuple[Floats, Floats]:
    """Return cross products (k,) of successive edges of a ring (k, 2), and length products."""
    incoming, outgoing = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
    return turn, np.hypot(*incoming.T) * np.hypot(*outgoing.T)


def _delaunay(points: Floats, nodes: list[int]) -> list[tuple[int, int, int]]:
    """Return constrained Delaunay triangles of a simple polygon, counter-clockwise nodes."""
    node_at = {tuple(points[node].tolist()): node for node in nodes}
    parts = shapely.constrained_delaunay_triangles(shapely.Polygon(points[nodes]))
    triangles = []
    for triangle in shapely.get_parts(parts):
        a, b, c = (node_at[tuple(place)] for place in shapely.get_coordinates(triangle)[:3].tolist())
        ab, ac = points[b] - points[a], points[c] - points[a]
        triangles.append((a, b, c) if ab[0] * ac[1] - ab[1] * ac[0] > 0.0 else (a, c, b))
    return triangles


def subdivide(mesh: Mesh, parts: int) -> Mesh:
    """Split every triangle into parts² similar ones; tags and roots are inherited."""
    if parts == 1:
        return mesh
    # new nodes: those on edges, edge by edge from its lower node on, then those inside triangles
    unique, _ = mesh.side_nodes
    steps = np.arange(1, parts) / parts
    ends = mesh.points[unique]
    on_sides = ends[:, :1] * (1.0 - steps[:, None]) + ends[:, 1:] * steps[:, None]
    node = _grid_nodes(mesh, parts)
    grid = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    weights = np.array([[parts - i - j, i, j] for i, j in grid if i > 0 and j > 0 and i + j < parts]) / parts
    interior = np.einsum("gk,tkd->tgd", weights.reshape(-1, 3), mesh.corners)
    children = [(node[:, i, j], node[:, i + 1, j], node[:, i, j + 1]) for i, j in grid if i + j < parts]
    children += [(node[:, i + 1, j], node[:, i + 1, j + 1], node[:, i, j + 1]) for i, j in grid if i + j < parts - 1]
    triangles = np.stack([np.stack(corners, axis=-1) for corners in children], axis=1).reshape(-1, 3)
    tagged = np.flatnonzero(mesh.side_tags != FREE)
    new_nodes = len(mesh.points) + tagged[:, None] * (parts - 1) + np.arange(parts - 1)
    chain = np.column_stack([unique[tagged, 0], new_nodes, unique[tagged, 1]])
    return Mesh(
        points=np.concatenate([mesh.points, on_sides.reshape(-1, 2), interior.reshape(-1, 2)]),
        simplices=triangles,
        cell=np.repeat(mesh.cell, parts * parts),
        root=np.repeat(mesh.root, parts * parts),
        tagged=np.sort(np.stack([chain[:, :-1], chain[:, 1:]], axis=-1).reshape(-1, 2), axis=1),
        tag=np.repeat(mesh.side_tags[tagged], parts),
    )


def _grid_nodes(mesh: Mesh, parts: int) -> Ints:
    """Return the nodes (t, parts + 1, parts + 1) of triangles that `subdivide` splits; i + j > parts is unused.

    Node (i, j) lies at corner 0 + i/parts towards corner 1 + j/parts towards corner 2.
    """
    unique, number = mesh.side_nodes
    number = np.roll(number, 1, axis=1)  # column k is the edge from corner k to k + 1
    node = np.empty((len(mesh), parts + 1, parts + 1), dtype=np.int64)
    node[:, 0, 0], node[:, parts, 0], node[:, 0, parts] = mesh.simplices.T
    for step in range(1, parts):
        for side, (i, j) in enumerate(((step, 0), (parts - step, step), (0, parts - step))):
            forward = unique[number[:, side], 0] == mesh.simplices[:, side]
            position = np.where(forward, step, parts - step) - 1
            node[:, i, j] = len(mesh.points) + number[:, side] * (parts - 1) + position
    interior = [(i, j) for i in range(1, parts) for j in range(1, parts - i)]
    first = len(mesh.points) + len(unique) * (parts - 1)
    for rank, (i, j) in enumerate(interior):
        node[:, i, j] = first + np.arange(len(mesh)) * len(interior) + rank
    return node


def refine(mesh: Mesh, marked: Bools, singular: Ints | None = None) -> Mesh:
    """Split marked triangles (t,) in four, and others as conformity requires; tags and roots are inherited.

    Each triangle is bisected at its longest edge before its other edges (Plaza & Carey 2000, 4T-LE), so that angles
    stay bounded away from 0; a marked one with a corner `singular` (t,), not −1, is bisected at that corner.
    """
    edges, edge_of = mesh.side_nodes
    edge_of = np.roll(edge_of, 1, axis=1)  # column k is the edge from corner k to k + 1
    ends = mesh.points[edges]
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    # of equal lengths the smaller number is the longest, alike for both triangles of an edge
    rank = np.empty(len(edges), dtype=np.int64)
    rank[np.lexsort((-np.arange(len(edges)), np.round(length / length.max(), 9)))] = np.arange(len(edges))
    longest = np.argmax(rank[edge_of], axis=1)
    if singular is not None:
        longest = np.where(marked & (singular >= 0), (singular + 1) % 3, longest)
    split = np.zeros(len(edges), dtype=bool)
    split[edge_of[marked]] = True
    # a triangle with any split edge is split at its longest one too
    while True:
        longest_edge = edge_of[np.arange(len(mesh)), longest]
        nonconforming = split[edge_of].any(axis=1) & ~split[longest_edge]
        if not nonconforming.any():
            break
        split[longest_edge[nonconforming]] = True
    middle = np.full(len(edges), -1, dtype=np.int64)
    middle[split] = len(mesh.points) + np.arange(int(split.sum()))
    triangles, parent = _bisect(mesh, middle[edge_of], longest)
    tagged = mesh.side_tags != FREE
    unsplit, halves = np.flatnonzero(tagged & ~split), np.flatnonzero(tagged & split)
    pairs = [edges[unsplit], *(np.column_stack([edges[halves, end], middle[halves]]) for end in (0, 1))]
    return replace(
        mesh,
        points=np.concatenate([mesh.points, ends[split].mean(axis=1)]),
        simplices=np.array(triangles, dtype=np.int64),
        cell=mesh.cell[parent],
        root=mesh.root[parent],
        tagged=np.sort(np.concatenate(pairs), axis=1),
        tag=np.concatenate([mesh.side_tags[unsplit], mesh.side_tags[halves], mesh.side_tags[halves]]),
    )


def _bisect(mesh: Mesh, middle: Ints, first: Ints) -> tuple[list[tuple[int, int, int]], list[int]]:
    """Split triangles at middles (t, 3), −1 for none, edge `first` first; also the old triangle of each."""
    triangles: list[tuple[int, int, int]] = []
    parent: list[int] = []
    rows = zip(mesh.simplices.tolist(), middle.tolist(), first.tolist(), strict=True)
    for t, (nodes, middles, k) in enumerate(rows):
        a, b, c = nodes[k], nodes[(k + 1) % 3], nodes[(k + 2) % 3]
        ab, bc, ca = middles[k], middles[(k + 1) % 3], middles[(k + 2) % 3]
        if ab < 0:
            new = [(a, b, c)]
        else:
            new = [(a, ab, c)] if ca < 0 else [(a, ab, ca), (ab, c, ca)]
            new += [(ab, b, c)] if bc < 0 else [(ab, b, bc), (ab, bc, c)]
        triangles += new
        parent += [t] * len(new)
    return triangles, parent


def corner_angles(corners: Floats) -> Floats:
    """Return the angles (t, 3) of triangles with corners (t, 3, 2)."""
    following, preceding = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    cross = following[..., 0] * preceding[..., 1] - following[..., 1] * preceding[..., 0]
    return np.asarray(np.arctan2(cross, (following * preceding).sum(axis=2)))


def fanned(mesh: Mesh, ends: Sequence[Floats]) -> Mesh:
    """Bisect triangles at the ends of loads on straight outlines, until three meet there."""
    # The traction jumps there from its value to 0. Stresses in two triangles may differ only along their common edge,
    # which meets such a jump only where the edge is normal to the outline. With two triangles no λ but 0 would have a
    # stress field; see docs/method.md (9.5).
    if not len(ends):
        return mesh
    reach = _STRAIGHT * float(np.ptp(mesh.points, axis=0).max())
    nodes = np.flatnonzero((abs(mesh.points[:, None] - np.array(ends)).max(axis=2) <= reach).any(axis=1))
    corners = mesh.corners
    angle = corner_angles(corners)
    angle_sum = np.bincount(mesh.simplices.ravel(), angle.ravel(), minlength=len(mesh.points))
    count = np.bincount(mesh.simplices.ravel(), minlength=len(mesh.points))
    # nodes on straight outlines with fewer than three triangles
    deficient = np.zeros(len(mesh.points), dtype=bool)
    deficient[nodes] = (abs(angle_sum[nodes] - np.pi) <= _STRAIGHT) & (count[nodes] < 3)
    at_corner = deficient[mesh.simplices]
    if not at_corner.any():
        return mesh
    # a triangle with two such corners is split at its centroid: to choose between them would be to go by their order
    several = at_corner.sum(axis=1) > 1
    whole, centred = np.flatnonzero(~several), np.flatnonzero(several)
    centre = len(mesh.points) + np.repeat(np.arange(len(centred)), 3)
    triangles = mesh.simplices[centred]
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    parents = np.concatenate([whole, np.repeat(centred, 3)])
    split = replace(
        mesh,
        points=np.concatenate([mesh.points, corners[centred].mean(axis=1)]),
        simplices=np.concatenate([mesh.simplices[whole], np.column_stack([edges, centre])]),
        cell=mesh.cell[parents],
        root=mesh.root[parents],
    )
    marked, singular = np.zeros(len(split), dtype=bool), np.full(len(split), -1)
    marked[: len(whole)] = at_corner[whole].any(axis=1)
    singular[: len(whole)] = np.where(marked[: len(whole)], at_corner[whole].argmax(axis=1), -1)
    return refine(split, marked, singular)


def bisect(mesh: Mesh, marked: Bools, weight: Floats | None = None) -> Mesh:
    """Halve one edge of each marked tetrahedron (t,), and others where quality asks for it (Rivara 1991).

    weight: (t, 4) of corners; layers then grow along edges where weights are great. Conforming; tags and roots are
    inherited.
    """
    ends = np.sort(mesh.simplices[:, _EDGES], axis=2)
    edges, edge_of = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    edge_of = edge_of.reshape(-1, 6)
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    rank = np.empty(len(edges), dtype=np.int64)
    # of equal lengths the smaller number is the longest, alike for all tetrahedra of an edge
    order = np.lexsort((-np.arange(len(edges)), np.round(length / length.max(), _DIGITS)))
    rank[order] = np.arange(len(edges))
    split = np.zeros(len(edges), dtype=bool)
    tetrahedron = np.arange(len(mesh))
    if weight is not None:
        steep = _ASPECT + abs(weight[:, _EDGES[:, 0]] - weight[:, _EDGES[:, 1]])
        # the rank decides only between edges that are equal up to rounding
        merit = np.round(length[edge_of] * steep / length.max(), _DIGITS) + 1e-12 * rank[edge_of]
        split[edge_of[tetrahedron, np.argmax(merit, axis=1)][marked]] = True
        return halve_edges(mesh, edges[[edge for edge in order[::-1].tolist() if split[edge]]])
    longest = edge_of[tetrahedron, np.argmax(rank[edge_of], axis=1)]
    split[longest[marked]] = True
    while True:
        nonconforming = split[edge_of].any(axis=1) & ~split[longest]
        if not nonconforming.any():
            break
        split[longest[nonconforming]] = True
    return halve_edges(mesh, edges[[edge for edge in order[::-1].tolist() if split[edge]]])


def split_at_centroids(mesh: Mesh) -> Mesh:
    """Split every tetrahedron in four (Alfeld 1984): part k of i is number 4 i + k, its corner k the centroid."""
    parts = np.repeat(mesh.simplices[:, None], 4, axis=1)
    parts[:, np.arange(4), np.arange(4)] = len(mesh.points) + np.arange(len(mesh))[:, None]
    return Mesh(
        points=np.concatenate([mesh.points, mesh.corners.mean(axis=1)]),
        simplices=parts.reshape(-1, 4),
        cell=np.repeat(mesh.cell, 4),
        root=np.repeat(mesh.root, 4),
        tagged=mesh.tagged,
        tag=mesh.tag,
    )


def halve_edges(mesh: Mesh, edges: Ints) -> Mesh:
    """Halve edges (k, 2) one after another, each in all tetrahedra and tagged triangles around it."""
    tetrahedra = [tuple(nodes) for nodes in mesh.simplices.tolist()]
    parent = list(range(len(tetrahedra)))
    tetrahedra_at: dict[int, set[int]] = {}  # tetrahedra at each node
    for index, nodes in enumerate(tetrahedra):
        for node in nodes:
            tetrahedra_at.setdefault(node, set()).add(index)
    tagged = _TaggedTriangles(mesh)
    points = mesh.points.tolist()
    for i, j in edges.tolist():
        middle = len(points)
        points.append([0.5 * (p + q) for p, q in zip(points[i], points[j], strict=True)])
        tetrahedra_at[middle] = set()
        for index in sorted(tetrahedra_at[i] & tetrahedra_at[j]):
            # the half at i keeps the number, the half at j has a new one
            nodes = tetrahedra[index]
            tetrahedra[index] = tuple(middle if node == j else node for node in nodes)
            second_half = tuple(middle if node == i else node for node in nodes)
            tetrahedra_at[j].discard(index)
            for node in second_half:
                tetrahedra_at[node].add(len(tetrahedra))
            tetrahedra_at[middle].add(index)
            tetrahedra.append(second_half)
            parent.append(parent[index])
        tagged.halve(i, j, middle)
    return Mesh(
        points=np.array(points),
        simplices=np.array(tetrahedra, dtype=np.int64),
        cell=mesh.cell[parent],
        root=mesh.root[parent],
        tagged=np.array(list(tagged.tags), dtype=np.int64).reshape(-1, mesh.dimension),
        tag=np.array(list(tagged.tags.values()), dtype=np.int64),
    )


class _TaggedTriangles:
    """Tags of triangles by their sorted nodes, while edges are halved."""

    def __init__(self, mesh: Mesh) -> None:
        self.tags = {tuple(nodes): tag for nodes, tag in zip(mesh.tagged.tolist(), mesh.tag.tolist(), strict=True)}
        self._at: dict[int, set[tuple[int, ...]]] = {}  # triangles at each node
        for triangle in self.tags:
            self._register(triangle)

    def _register(self, triangle: tuple[int, ...]) -> None:
        for node in triangle:
            self._at.setdefault(node, set()).add(triangle)

    def halve(self, i: int, j: int, middle: int) -> None:
        """Split the triangles at edge (i, j) at its new node."""
        for triangle in sorted(self._at.get(i, set()) & self._at.get(j, set())):
            tag = self.tags.pop(triangle)
            for node in triangle:
                self._at[node].discard(triangle)
            for replaced in (i, j):
                half = tuple(sorted(middle if node == replaced else node for node in triangle))
                self.tags[half] = tag
                self._register(half)
