"""Triangles inside the cells of a planar assembly, conforming across every interface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.outlines import FREE, Outlines

_STRAIGHT = 1e-6  # sine of the angle below which an outline runs straight through a node


@dataclass(frozen=True)
class Edges:
    """Edges of a triangle mesh, as arrays over e edges."""

    # a, b: (e,) triangles; b = −1 on an outline or support
    a: Ints
    b: Ints
    # corner_a, corner_b: (e, 2) corners (0 to 2) of a and b at the two ends
    corner_a: Ints
    corner_b: Ints
    normal: Floats  # (e, 2) unit vector from a to b, or outward
    length: Floats  # (e,)
    tag: Ints  # (e,) as `Mesh.tag`; edges inside a cell and free ones have FREE

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True)
class Mesh:
    """Triangles over common nodes."""

    points: Floats  # (p, 2) nodes, scene units
    triangles: Ints  # (t, 3) nodes of each triangle, counter-clockwise
    cell: Ints  # (t,) element of each triangle
    root: Ints  # (t,) triangle of the coarsest mesh that contains it
    tagged: Ints  # (k, 2) nodes of the edges on interfaces and load patches, the smaller first
    tag: Ints  # (k,) tag of each of these edges: an interface, or the number of interfaces plus that of a load patch

    def __len__(self) -> int:
        return len(self.triangles)

    @cached_property
    def corners(self) -> Floats:
        """(t, 3, 2) positions of the corners of each triangle."""
        return self.points[self.triangles]

    @cached_property
    def area(self) -> Floats:
        """(t,) areas of the triangles, positive."""
        one, two = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        return np.asarray(0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]))

    @cached_property
    def gradient(self) -> Floats:
        """(t, 3, 2) gradients of the linear functions that are 1 at one corner, 0 at the others."""
        opposite = np.roll(self.corners, -2, axis=1) - np.roll(self.corners, -1, axis=1)
        turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
        return np.asarray(turned / (2.0 * self.area[:, None, None]))

    @cached_property
    def sides(self) -> tuple[Ints, Ints]:
        """Pairs of nodes (u, 2) of the u distinct edges, and the edges (t, 3) of each triangle.

        The smaller node is first. Column k is the edge from corner k to k + 1.
        """
        ends = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        unique, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
        return unique, np.asarray(number.reshape(-1, 3))

    @cached_property
    def side_tags(self) -> Ints:
        """(u,) tag of each edge of `sides`, as `Mesh.tag`; FREE without one."""
        unique, _ = self.sides
        tags = np.full(len(unique), FREE, dtype=np.int64)
        if len(self.tagged):
            count = len(self.points)
            keys = unique[:, 0] * count + unique[:, 1]
            place = np.searchsorted(keys, self.tagged[:, 0] * count + self.tagged[:, 1])
            tags[place] = self.tag
        return tags

    @cached_property
    def edges(self) -> Edges:
        """All edges with their neighbours, each once."""
        # Where two cells share an edge that is no interface, each cell has an edge of its own.
        _, number = self.sides
        flat = number.ravel()
        order = np.argsort(flat, kind="stable")
        place, start, count = np.unique(flat[order], return_index=True, return_counts=True)
        first = order[start]
        second = np.where(count == 2, order[np.minimum(start + 1, len(order) - 1)], -1)
        tags = self.side_tags[place]
        loose = (second >= 0) & (tags == FREE) & (self.cell[first // 3] != self.cell[np.maximum(second, 0) // 3])
        extra = second[loose]
        second = np.where(loose, -1, second)
        first = np.concatenate([first, extra])
        tags = np.concatenate([tags, np.full(len(extra), FREE, dtype=np.int64)])
        second = np.concatenate([second, np.full(len(extra), -1, dtype=np.int64)])
        a, k = first // 3, first % 3
        b, j = np.where(second >= 0, second // 3, -1), np.maximum(second, 0) % 3
        along = self.corners[a, (k + 1) % 3] - self.corners[a, k]
        length = np.hypot(along[:, 0], along[:, 1])
        normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
        return Edges(
            a=a,
            b=b,
            corner_a=np.column_stack([k, (k + 1) % 3]),
            corner_b=np.column_stack([(j + 1) % 3, j]),
            normal=normal,
            length=length,
            tag=tags,
        )


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
            new = [(a, b, len(points)) for a, b in zip(nodes, nodes[1:] + nodes[:1], strict=True)]
            points.append(centre)
        else:
            new = []
            chains = _chains(outlines.points, ring)
            for corners in _delaunay(outlines.points, list(chains)):
                points.append(np.mean([points[node] for node in corners], axis=0))
                for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                    chain = chains[a] if chains[a][-1] == b else [a, b]
                    new += [(p, q, len(points) - 1) for p, q in pairwise(chain)]
        triangles += new
        cells += [cell] * len(new)
    tagged = np.array(list(edges), dtype=np.int64).reshape(-1, 2)
    return Mesh(
        points=np.array(points),
        triangles=np.array(triangles, dtype=np.int64),
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
    one, two, gap = corners[2] - corners[0], corners[3] - corners[1], corners[1] - corners[0]
    share = (gap[0] * two[1] - gap[1] * two[0]) / (one[0] * two[1] - one[1] * two[0])
    return np.asarray(corners[0] + share * one)


def _chains(points: Floats, ring: Ints) -> dict[int, list[int]]:
    """Map each corner of an outline to the nodes from it to the next corner, both included.

    points: (p, 2) positions of all nodes. ring: (k,) nodes of the outline, in order.
    """
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
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return turn, np.hypot(*before.T) * np.hypot(*after.T)


def _delaunay(points: Floats, nodes: list[int]) -> list[tuple[int, int, int]]:
    """Return constrained Delaunay triangles of a simple polygon, counter-clockwise nodes."""
    number = {tuple(points[node].tolist()): node for node in nodes}
    found = shapely.constrained_delaunay_triangles(shapely.Polygon(points[nodes]))
    triangles = []
    for triangle in shapely.get_parts(found):
        a, b, c = (number[tuple(place)] for place in shapely.get_coordinates(triangle)[:3].tolist())
        one, two = points[b] - points[a], points[c] - points[a]
        triangles.append((a, b, c) if one[0] * two[1] - one[1] * two[0] > 0.0 else (a, c, b))
    return triangles


def subdivide(mesh: Mesh, parts: int) -> Mesh:
    """Return the mesh with every triangle split into parts² similar ones.

    Result: conforming as before; tags and roots are inherited.
    """
    if parts == 1:
        return mesh
    unique, number = mesh.sides
    steps = np.arange(1, parts) / parts
    ends = mesh.points[unique]
    on_sides = ends[:, :1] * (1.0 - steps[:, None]) + ends[:, 1:] * steps[:, None]
    base = len(mesh.points)
    inner = base + len(unique) * (parts - 1)
    grid = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    inside = [(i, j) for i, j in grid if i > 0 and j > 0 and i + j < parts]
    # node (i, j) of a triangle lies at corner 0 + i/parts towards corner 1 + j/parts towards corner 2
    node = np.empty((len(mesh), parts + 1, parts + 1), dtype=np.int64)
    node[:, 0, 0], node[:, parts, 0], node[:, 0, parts] = mesh.triangles.T
    for step in range(1, parts):
        for side, (i, j) in enumerate(((step, 0), (parts - step, step), (0, parts - step))):
            start = mesh.triangles[:, side]
            forward = unique[number[:, side], 0] == start
            node[:, i, j] = base + number[:, side] * (parts - 1) + np.where(forward, step, parts - step) - 1
    places = []
    for rank, (i, j) in enumerate(inside):
        node[:, i, j] = inner + np.arange(len(mesh)) * len(inside) + rank
        weights = np.array([parts - i - j, i, j]) / parts
        places.append(np.einsum("k,tkd->td", weights, mesh.corners))
    extra = np.stack(places, axis=1).reshape(-1, 2) if places else np.zeros((0, 2))
    small = [(node[:, i, j], node[:, i + 1, j], node[:, i, j + 1]) for i, j in grid if i + j < parts]
    small += [(node[:, i + 1, j], node[:, i + 1, j + 1], node[:, i, j + 1]) for i, j in grid if i + j < parts - 1]
    triangles = np.stack([np.stack(three, axis=-1) for three in small], axis=1).reshape(-1, 3)
    times = parts * parts
    tagged = np.flatnonzero(mesh.side_tags != FREE)
    chain = np.column_stack(
        [unique[tagged, 0], *(base + tagged * (parts - 1) + k for k in range(parts - 1)), unique[tagged, 1]]
    )
    pairs = np.stack([chain[:, :-1], chain[:, 1:]], axis=-1).reshape(-1, 2)
    return Mesh(
        points=np.concatenate([mesh.points, on_sides.reshape(-1, 2), extra]),
        triangles=triangles,
        cell=np.repeat(mesh.cell, times),
        root=np.repeat(mesh.root, times),
        tagged=np.sort(pairs, axis=1),
        tag=np.repeat(mesh.side_tags[tagged], parts),
    )


def refine(mesh: Mesh, marked: Bools, singular: Ints | None = None) -> Mesh:
    """Split marked triangles in four, and others as conformity requires.

    Each triangle is bisected at its longest edge before its other edges (Plaza & Carey 2000, 4T-LE), so that angles
    stay bounded away from 0; a marked one with a singular corner is bisected at that corner.

    Parameters
    ----------
    mesh : Mesh
        Any mesh.
    marked : (t,) bool array
        Triangles to split.
    singular : (t,) int array, optional
        Corner that a marked triangle is bisected at, −1 where it is the one opposite to the longest edge.

    Returns
    -------
    Mesh
        Conforming; tags and roots are inherited.
    """
    unique, number = mesh.sides
    ends = mesh.points[unique]
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    # of equal lengths the smaller number is the longest, alike for both triangles of an edge
    rank = np.empty(len(unique), dtype=np.int64)
    rank[np.lexsort((-np.arange(len(unique)), np.round(length / length.max(), 9)))] = np.arange(len(unique))
    longest = np.argmax(rank[number], axis=1)
    if singular is not None:
        longest = np.where(marked & (singular >= 0), (singular + 1) % 3, longest)
    split = np.zeros(len(unique), dtype=bool)
    split[number[marked]] = True
    while True:
        lead = number[np.arange(len(mesh)), longest]
        more = split[number].any(axis=1) & ~split[lead]
        if not more.any():
            break
        split[lead[more]] = True
    middle = np.full(len(unique), -1, dtype=np.int64)
    middle[split] = len(mesh.points) + np.arange(int(split.sum()))
    triangles, parent = _bisected(mesh, middle[number], longest)
    tagged = mesh.side_tags != FREE
    whole, halves = np.flatnonzero(tagged & ~split), np.flatnonzero(tagged & split)
    pairs = [unique[whole], *(np.column_stack([unique[halves, end], middle[halves]]) for end in (0, 1))]
    return replace(
        mesh,
        points=np.concatenate([mesh.points, ends[split].mean(axis=1)]),
        triangles=np.array(triangles, dtype=np.int64),
        cell=mesh.cell[parent],
        root=mesh.root[parent],
        tagged=np.sort(np.concatenate(pairs), axis=1),
        tag=np.concatenate([mesh.side_tags[whole], mesh.side_tags[halves], mesh.side_tags[halves]]),
    )


def _bisected(mesh: Mesh, middle: Ints, first: Ints) -> tuple[list[tuple[int, int, int]], list[int]]:
    """Split triangles at middles of edges; return new triangles, and the old one of each.

    middle: (t, 3) node in the middle of each edge, −1 for a whole edge. first: (t,) edge that is halved first.
    """
    triangles: list[tuple[int, int, int]] = []
    parent: list[int] = []
    for t, (nodes, own, k) in enumerate(zip(mesh.triangles.tolist(), middle.tolist(), first.tolist(), strict=True)):
        a, b, c = nodes[k], nodes[(k + 1) % 3], nodes[(k + 2) % 3]
        ab, bc, ca = own[k], own[(k + 1) % 3], own[(k + 2) % 3]
        if ab < 0:
            new = [(a, b, c)]
        else:
            new = [(a, ab, c)] if ca < 0 else [(a, ab, ca), (ab, c, ca)]
            new += [(ab, b, c)] if bc < 0 else [(ab, b, bc), (ab, bc, c)]
        triangles += new
        parent += [t] * len(new)
    return triangles, parent


def fanned(mesh: Mesh, ends: Sequence[Floats]) -> Mesh:
    """Bisect triangles at the ends of loads on straight outlines, until three meet there.

    Result: triangles at such a node are bisected there, at two of them split at the centroid; others are split only
    where conformity asks for it.
    """
    # The traction jumps there from its value to 0. Stresses in two triangles may differ only along their common edge,
    # which meets such a jump only where the edge is normal to the outline. With two triangles no λ but 0 would have a
    # stress field; see docs/method.md (9.5).
    if not len(ends):
        return mesh
    near = _STRAIGHT * float(np.ptp(mesh.points, axis=0).max())
    nodes = np.flatnonzero((abs(mesh.points[:, None] - np.array(ends)).max(axis=2) <= near).any(axis=1))
    corners = mesh.corners
    one, two = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    angle = np.arctan2(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0], (one * two).sum(axis=2))
    around = np.bincount(mesh.triangles.ravel(), angle.ravel(), minlength=len(mesh.points))
    count = np.bincount(mesh.triangles.ravel(), minlength=len(mesh.points))
    few = np.zeros(len(mesh.points), dtype=bool)
    few[nodes] = (abs(around[nodes] - np.pi) <= _STRAIGHT) & (count[nodes] < 3)
    at = few[mesh.triangles]
    if not at.any():
        return mesh
    # one with two such corners is split at its centroid: to choose between them would be to go by their order
    whole, both = np.flatnonzero(at.sum(axis=1) < 2), np.flatnonzero(at.sum(axis=1) > 1)
    centre = len(mesh.points) + np.repeat(np.arange(len(both)), 3)
    ends_of = np.stack([mesh.triangles[both], np.roll(mesh.triangles[both], -1, axis=1)], axis=-1).reshape(-1, 2)
    order = np.concatenate([whole, np.repeat(both, 3)])
    split = replace(
        mesh,
        points=np.concatenate([mesh.points, corners[both].mean(axis=1)]),
        triangles=np.concatenate([mesh.triangles[whole], np.column_stack([ends_of, centre])]),
        cell=mesh.cell[order],
        root=mesh.root[order],
    )
    marked = np.append(at[whole].any(axis=1), np.zeros(3 * len(both), dtype=bool))
    return refine(
        split, marked, np.where(marked, np.append(at[whole].argmax(axis=1), np.zeros(len(centre), dtype=np.int64)), -1)
    )
