"""Snapping: merge corners that nearly meet, and close gaps and overlaps up to a tolerance.

In the plane, nodes move onto near edges; in space, near faces move into one plane.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import InputError
from jld_core.geometry.polyhedra import Faces, lay_out
from jld_core.geometry.spatial_contacts import merge_points, near_pairs
from jld_core.geometry.vectors import area_vector
from jld_core.linalg import components

_ROUNDS: Final = 4  # number of rounds that move nodes onto edges: ends of an edge may move after a node was put on it

_STRAIGHT: Final = 1e-9  # kink, relative to the edge, below which a node inserted into an edge is removed again


@dataclass(frozen=True)
class Snapped:
    paths: list[Floats]  # corners of each path; empty where the path vanished
    largest: float  # largest displacement of a corner, length
    moved: int  # number of corners that moved
    # indices of closed paths with fewer than three corners and of open paths with fewer than two
    collapsed: tuple[int, ...]


def snap_polygons(outlines: Sequence[Floats], tolerance: float, *, keep_nodes: bool = False) -> Snapped:
    """Close gaps and overlaps between polygons up to a tolerance, a length."""
    return snap_paths(outlines, [True] * len(outlines), tolerance, keep_nodes=keep_nodes)


def snap_paths(
    paths: Sequence[Floats], closed: Sequence[bool], tolerance: float, *, keep_nodes: bool = False
) -> Snapped:
    """Close gaps and overlaps between open and closed paths up to a tolerance, a length."""
    if not (tolerance >= 0.0 and np.isfinite(tolerance)):
        raise InputError("tolerance", f"{tolerance:g} is no length", "a length of at least 0")
    if not len(paths):
        return Snapped([], 0.0, 0, ())
    corners = np.concatenate([np.asarray(path, dtype=float) for path in paths])
    first = np.concatenate([[0], np.cumsum([len(path) for path in paths])])
    node_of = merge_points(corners, tolerance)
    positions = corners[np.unique(node_of, return_index=True)[1]]
    rings = [without_spikes(node_of[first[k] : first[k + 1]].tolist(), closed=closed[k]) for k in range(len(paths))]
    positions, rings, node_of = _onto_edges(positions, rings, node_of, closed, tolerance)
    rings, is_original = _with_hanging(positions, rings, closed, tolerance)
    if not keep_nodes:
        rings = [
            _without_straight(positions, ring, mask, closed=is_closed)
            for ring, mask, is_closed in zip(rings, is_original, closed, strict=True)
        ]
    rings = [without_spikes(ring, closed=is_closed) for ring, is_closed in zip(rings, closed, strict=True)]
    shift = np.linalg.norm(positions[node_of] - corners, axis=1)
    collapsed = tuple(k for k, ring in enumerate(rings) if len(ring) < (3 if closed[k] else 2))
    return Snapped([positions[ring] for ring in rings], float(shift.max()), int(np.count_nonzero(shift)), collapsed)


def _edges(rings: Sequence[Sequence[int]], closed: Sequence[bool]) -> Ints:
    """Return the distinct edges (e, 2) of all rings, smaller node first, sorted."""
    edges = [
        (min(i, j), max(i, j))
        for ring, is_closed in zip(rings, closed, strict=True)
        for i, j in zip(ring, [*ring[1:], ring[0]] if is_closed and ring else ring[1:], strict=False)
        if i != j
    ]
    return np.unique(np.array(edges, dtype=np.int64).reshape(-1, 2), axis=0)


def _nodes_near_edges(positions: Floats, edges: Ints, tolerance: float) -> tuple[Ints, Ints, Floats, Floats]:
    """Find nodes (n, 2) near edges (e, 2) of others: node, edge, distance, share of length, (h,) each, sorted."""
    if not len(edges):
        nothing = np.zeros(0, dtype=np.int64)
        return nothing, nothing, np.zeros(0), np.zeros(0)
    tree = shapely.STRtree(shapely.linestrings(positions[edges]))
    node, edge = tree.query(shapely.points(positions), predicate="dwithin", distance=tolerance)
    start, direction = positions[edges[edge, 0]], positions[edges[edge, 1]] - positions[edges[edge, 0]]
    length = np.linalg.norm(direction, axis=1)
    share = np.einsum("ij,ij->i", positions[node] - start, direction) / length**2
    distance = np.linalg.norm(positions[node] - start - share[:, None] * direction, axis=1)
    is_hit = (share > 0.0) & (share < 1.0) & (edges[edge, 0] != node) & (edges[edge, 1] != node)
    if tolerance > 0.0:
        # a node this close to an end of the edge has already merged with that end
        for end in (0, 1):
            is_hit &= np.linalg.norm(positions[node] - positions[edges[edge, end]], axis=1) > tolerance
    order = np.lexsort((edge[is_hit], distance[is_hit], node[is_hit]))
    return node[is_hit][order], edge[is_hit][order], distance[is_hit][order], share[is_hit][order]


_RESTS: Final = 1e-15  # distance from an edge, relative to the size of all, up to which a node lies on it


def _onto_edges(
    positions: Floats, rings: list[list[int]], node_of: Ints, closed: Sequence[bool], tolerance: float
) -> tuple[Floats, list[list[int]], Ints]:
    """Move nodes onto the nearest edge within the tolerance, repeatedly; places, rings, nodes of corners."""
    # The repetition ends when nothing moves, or after `_ROUNDS` rounds. Where joints cross, corners may be further
    # apart than the tolerance, along both joints; they meet on an edge.
    positions, size = positions.copy(), float(np.ptp(positions, axis=0).max())
    for _ in range(_ROUNDS if tolerance > 0.0 else 0):
        edges = _edges(rings, closed)
        node, edge, distance, share = _nodes_near_edges(positions, edges, tolerance)
        node, nearest = np.unique(node, return_index=True)
        edge, distance, share = edge[nearest], distance[nearest], share[nearest]
        if not np.any(distance > _RESTS * size):
            break
        movable = _without_swaps(positions, node, edges[edge], tolerance)
        node, edge, share = node[movable], edge[movable], share[movable]
        ends = positions[edges[edge]]
        positions[node] = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
        merged_into = _merged_nodes(positions, rings, tolerance)
        positions, node_of = positions[merged_into], merged_into[node_of]
        rings = [
            without_spikes(merged_into[np.array(ring, dtype=np.int64)].tolist(), closed=is_closed)
            for ring, is_closed in zip(rings, closed, strict=True)
        ]
    return positions, rings, node_of


def _without_swaps(positions: Floats, node: Ints, ends: Ints, tolerance: float) -> Bools:
    """Return a mask (k,) of moves without those in which two near nodes would swap places."""
    edge_of = dict(zip(node.tolist(), ends.tolist(), strict=True))

    def passes(n: int, m: int) -> bool:
        is_edge = n < m and n in edge_of.get(m, ())
        return is_edge and bool(np.linalg.norm(positions[n] - positions[m]) <= 2.0 * tolerance)

    return np.array([not any(passes(n, m) for m in edge_of[n]) for n in node.tolist()], dtype=bool)


def _merged_nodes(positions: Floats, rings: Sequence[Sequence[int]], tolerance: float) -> Ints:
    """Return the node (n,) into which each node merges, itself if into none."""
    # Two nodes merge if they lie within the tolerance and no path contains both.
    merged_into = np.arange(len(positions))
    owners: dict[int, set[int]] = {}
    for number, ring in enumerate(rings):
        for node in ring:
            owners.setdefault(node, set()).add(number)
    used = np.array(sorted(owners), dtype=np.int64)
    if not len(used):
        return merged_into
    from scipy.spatial import cKDTree  # Imported here because it is slow to import and seldom needed.

    pairs = used[cKDTree(positions[used]).query_pairs(tolerance, output_type="ndarray")]
    for first, second in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if merged_into[first] == first and merged_into[second] == second and not owners[first] & owners[second]:
            merged_into[second] = first
            owners[first] |= owners[second]
    return merged_into


def _with_hanging(
    positions: Floats, rings: Sequence[Sequence[int]], closed: Sequence[bool], tolerance: float
) -> tuple[list[list[int]], list[list[bool]]]:
    """Insert nodes on edges as corners of paths; return paths, and True for each original corner."""
    edges = _edges(rings, closed)
    size = float(np.ptp(positions, axis=0).max()) if len(positions) else 0.0
    node, edge, _, share = _nodes_near_edges(positions, edges, max(tolerance, 1e-12 * size))
    nodes_on_edge: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for n, e, s in zip(node.tolist(), edge.tolist(), share.tolist(), strict=True):
        nodes_on_edge.setdefault((int(edges[e, 0]), int(edges[e, 1])), []).append((s, n))
    paths, masks = [], []
    for ring, is_closed in zip(rings, closed, strict=True):
        corners: list[int] = []
        mask: list[bool] = []
        edge_count = len(ring) if is_closed else len(ring) - 1
        present = set(ring)
        for position, i in enumerate(ring):
            corners.append(i)
            mask.append(True)
            if position < edge_count:
                j = ring[(position + 1) % len(ring)]
                on_edge = sorted(nodes_on_edge.get((min(i, j), max(i, j)), ()), reverse=i > j)
                # a second visit to a corner of the same ring would make the ring touch itself
                inserted = [n for _, n in on_edge if n not in present]
                corners += inserted
                mask += [False] * len(inserted)
        paths.append(corners)
        masks.append(mask)
    return paths, masks


def _without_straight(positions: Floats, ring: list[int], originals: list[bool], *, closed: bool) -> list[int]:
    """Remove inserted nodes of a path that lie in a straight edge; `originals` marks original corners."""
    if all(originals):
        return ring
    points, original = positions[ring], np.array(originals)
    keep: Bools = original.copy()
    count = len(ring)
    for k in np.flatnonzero(~original).tolist():
        previous, following = k - 1, k + 1
        while not original[previous % count]:
            previous -= 1
        while not original[following % count]:
            following += 1
        chord = points[following % count] - points[previous % count]
        arm = points[k] - points[previous % count]
        keep[k] = abs(chord[0] * arm[1] - chord[1] * arm[0]) > _STRAIGHT * float(chord @ chord)
    return [node for node, is_kept in zip(ring, keep, strict=True) if is_kept]


def straight(outline: Floats) -> Floats:
    """Remove corners (k, 2) in straight edges; keep the whole outline where fewer than three would remain."""
    incoming, outgoing = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = np.abs(incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0])
    forward = np.einsum("ij,ij->i", incoming, outgoing) > 0.0
    keep = ~(forward & (cross <= _STRAIGHT * np.linalg.norm(incoming, axis=1) * np.linalg.norm(outgoing, axis=1)))
    return outline[keep] if np.count_nonzero(keep) > 2 else outline


def without_spikes(ring: Sequence[int], *, closed: bool) -> list[int]:
    """Remove repeated nodes from a path of node indices, and spikes from a closed one."""
    # A spike is a run from a node to another and back.
    path: list[int] = []
    for node in ring:
        if path and path[-1] == node:
            continue
        if closed and len(path) > 1 and path[-2] == node:
            path.pop()
            continue
        path.append(node)
    while closed and len(path) > 1 and (path[0] == path[-1] or (len(path) > 2 and path[1] == path[-1])):
        path = path[:-1] if path[0] == path[-1] else path[1:]
    if closed and len(path) > 2 and path[0] == path[-2]:
        path = path[:-1]
    return path


_FLAT: Final = 0.995  # cosine between normals below which two faces are not merged into one plane, whatever their size

_RANK: Final = 0.05  # relative singular value of the unit normals at a corner below which a direction stays free

# Largest displacement of a corner, in tolerances. Beyond, the corner stays in place: its planes meet at too flat an
# angle to define their intersection.
_FAR: Final = 4.0


@dataclass(frozen=True)
class SnappedSolids:
    """Solids after snapping; faces keep their vertex indices."""

    vertices: list[Floats]  # (k, 3) of each solid
    largest: float  # largest displacement of a vertex, length
    moved: int  # number of moved vertices


def snap_solids(vertices: Sequence[Floats], faces: Sequence[Faces], tolerance: float) -> SnappedSolids:
    """Close gaps between polyhedra, by vertices (k, 3) and faces, and make their faces plane, up to a tolerance."""
    if not (tolerance >= 0.0 and np.isfinite(tolerance)):
        raise InputError("tolerance", f"{tolerance:g} is no length", "a length of at least 0")
    if not len(vertices):
        return SnappedSolids([], 0.0, 0)
    surface = lay_out([np.asarray(v, dtype=float) for v in vertices], list(faces))
    points = surface.points
    start = np.concatenate([[0], np.cumsum([len(v) for v in vertices])]).astype(np.int64)
    node = merge_points(points, tolerance)
    positions = points[np.unique(node, return_index=True)[1]]
    loops = _Loops(node[surface.vertex], surface.start, surface.count)
    group, normal, origin = _planes(positions, loops, surface.element, tolerance)
    positions = _onto_planes(positions, loops, group, normal, origin, tolerance)
    snapped = positions[node]
    shift = np.linalg.norm(snapped - points, axis=1)
    solids = [snapped[a:b] for a, b in itertools.pairwise(start)]
    return SnappedSolids(solids, float(shift.max(initial=0.0)), int(np.count_nonzero(shift)))


@dataclass(frozen=True)
class _Loops:
    """Nodes of all faces in one array, face after face."""

    node: Ints  # (c,) node of each corner
    # start, count: (faces,) first corner and number of corners of each face
    start: Ints
    count: Ints

    def __len__(self) -> int:
        return len(self.count)

    def of(self, face: int) -> Ints:
        return self.node[self.start[face] : self.start[face] + self.count[face]]

    def stacks(self) -> list[tuple[Ints, Ints]]:
        by_count = [(np.flatnonzero(self.count == count), count) for count in np.unique(self.count).tolist()]
        return [(faces, self.node[self.start[faces, None] + np.arange(count)]) for faces, count in by_count]


class _FacePlanes:
    """Mean planes of faces, and distances of corners from them."""

    def __init__(self, points: Floats, loops: _Loops) -> None:
        count = len(loops)
        self._points, self._stacks = points, loops.stacks()
        vector, self.middle = np.zeros((count, 3)), np.zeros((count, 3))
        self.lower, self.upper = np.zeros((count, 3)), np.zeros((count, 3))
        # number of the stack of each face, and its row there
        self._stack, self._row = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        for number, (faces, stack) in enumerate(self._stacks):
            corners = points[stack]
            vector[faces], self.middle[faces] = area_vector(corners), corners.mean(axis=1)
            self.lower[faces], self.upper[faces] = corners.min(axis=1), corners.max(axis=1)
            self._stack[faces], self._row[faces] = number, np.arange(len(faces))
        self.area = np.linalg.norm(vector, axis=1)
        self.normal = vector / np.where(self.area == 0.0, 1.0, self.area)[:, None]

    def farthest(self, faces: Ints, planes: Ints) -> Floats:
        """Return the largest distance (p,) of corners of faces from planes of other faces."""
        distance = np.zeros(len(faces))
        for number, (_, stack) in enumerate(self._stacks):
            of_stack = np.flatnonzero(self._stack[faces] == number)
            plane = planes[of_stack]
            arm = self._points[stack[self._row[faces[of_stack]]]] - self.middle[plane, None]
            heights = np.abs(np.einsum("nki,ni->nk", arm, self.normal[plane]))
            distance[of_stack] = heights.max(axis=1, initial=0.0)
        return distance


def _planes(positions: Floats, loops: _Loops, solid: Ints, tolerance: float) -> tuple[Ints, Floats, Floats]:
    """Group faces in one plane within the tolerance: plane (faces,), −1 if not plane; normal, point (p, 3)."""
    faces = _FacePlanes(positions, loops)
    area, normal = faces.area, faces.normal
    all_faces = np.arange(len(loops))
    bulge = faces.farthest(all_faces, all_faces)  # of each face from its own plane

    def parallel(first: Ints, second: Ints) -> Bools:
        cosine = np.einsum("ij,ij->i", normal[first], normal[second])
        # Faces of two solids are opposite or continue one another; faces of one solid continue one another.
        return np.asarray(np.where(solid[first] == solid[second], cosine, np.abs(cosine)) > _FLAT)

    first, second = near_pairs(faces.lower, faces.upper, np.full(len(loops), tolerance), parallel)
    swap = area[first] < area[second]
    larger, smaller = np.where(swap, second, first), np.where(swap, first, second)
    comparable = (area[smaller] > 0.0) & (bulge[larger] <= tolerance)
    larger, smaller = larger[comparable], smaller[comparable]
    coplanar = faces.farthest(smaller, larger) <= tolerance
    # from the largest face to the smallest
    order = np.argsort(-area, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = all_faces
    leader = _leaders(order, rank, larger[coplanar], smaller[coplanar], faces.farthest, tolerance)
    first_ranks, group = np.unique(rank[leader], return_inverse=True)
    # faces that are themselves not plane within the tolerance move no corner
    group[bulge > tolerance] = -1
    return group, normal[order[first_ranks]], faces.middle[order[first_ranks]]


def _leaders(
    order: Ints, rank: Ints, a: Ints, b: Ints, farthest: Callable[[Ints, Ints], Floats], tolerance: float
) -> Ints:
    """Return for each face (n,) that whose plane it joins: the first in `order`, reached by coplanar pairs (a, b).

    rank: (n,) places in `order`. farthest: largest distance of faces from planes of others.
    """
    count = len(order)
    component = components(count, a, b)
    first_rank = np.full(int(component.max(initial=-1)) + 1, count, dtype=np.int64)  # of each part
    np.minimum.at(first_rank, component, rank)
    leader = order[first_rank[component]]
    # Where all faces joined by pairs lie in the plane of their first one, they are one group. A part that drifts away
    # from it, pair by pair, is divided: every face is compared with the leader, not with its neighbour.
    drifts = np.zeros(len(first_rank), dtype=bool)
    drifts[component[farthest(np.arange(count), leader) > tolerance]] = True
    in_drifting = drifts[component[a]]
    partners: dict[int, list[int]] = {}
    for first, second in zip(a[in_drifting].tolist(), b[in_drifting].tolist(), strict=True):
        partners.setdefault(first, []).append(second)
        partners.setdefault(second, []).append(first)
    undivided = order[drifts[component[order]]].tolist()
    leader[undivided] = -1
    for leading in undivided:
        if leader[leading] >= 0:
            continue
        leader[leading] = leading
        pending = [leading]
        while pending:
            unassigned = [face for face in partners.get(pending.pop(), ()) if leader[face] < 0]
            faces = np.array(unassigned, dtype=np.int64)
            coplanar = faces[farthest(faces, np.full(len(faces), leading)) <= tolerance]
            leader[coplanar] = leading
            pending += coplanar.tolist()
    return leader


def _onto_planes(
    points: Floats, loops: _Loops, group: Ints, normal: Floats, origin: Floats, tolerance: float
) -> Floats:
    """Move every node by the least distance onto the planes of its faces; group: −1 for none."""
    # One number for a node and a plane: sorting it is many times faster than sorting rows.
    base = len(normal) + 1
    pairs = np.unique(loops.node * base + np.repeat(group, loops.count) + 1)
    pairs = pairs[pairs % base > 0]
    node, plane = pairs // base, pairs % base - 1
    planes_of_node = np.bincount(node, minlength=len(points))
    first = np.concatenate([[0], np.cumsum(planes_of_node)])[:-1]
    moved = points.copy()
    for count in np.unique(planes_of_node[planes_of_node > 0]).tolist():
        nodes = np.flatnonzero(planes_of_node == count)
        planes = plane[first[nodes, None] + np.arange(count)]
        rows = normal[planes]
        distances = np.einsum("nki,nki->nk", origin[planes] - points[nodes, None], rows)
        step = np.einsum("nik,nk->ni", np.linalg.pinv(rows, rcond=_RANK), distances)
        is_near = np.linalg.norm(step, axis=1) <= _FAR * tolerance  # others stay
        moved[nodes[is_near]] += step[is_near]
    return moved
