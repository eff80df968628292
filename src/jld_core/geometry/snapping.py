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
    place = corners[np.unique(node_of, return_index=True)[1]]
    rings = [without_spikes(node_of[first[k] : first[k + 1]].tolist(), closed=closed[k]) for k in range(len(paths))]
    place, rings, node_of = _onto_edges(place, rings, node_of, closed, tolerance)
    rings, originals = _with_hanging(place, rings, closed, tolerance)
    if not keep_nodes:
        rings = [
            _without_straight(place, ring, mask, closed=shut)
            for ring, mask, shut in zip(rings, originals, closed, strict=True)
        ]
    rings = [without_spikes(ring, closed=shut) for ring, shut in zip(rings, closed, strict=True)]
    shift = np.linalg.norm(place[node_of] - corners, axis=1)
    lost = tuple(k for k, ring in enumerate(rings) if len(ring) < (3 if closed[k] else 2))
    return Snapped([place[ring] for ring in rings], float(shift.max()), int(np.count_nonzero(shift)), lost)


def _edges(rings: Sequence[Sequence[int]], closed: Sequence[bool]) -> Ints:
    """Return the distinct edges (e, 2) of all rings, smaller node first, sorted."""
    edges = [
        (min(i, j), max(i, j))
        for ring, shut in zip(rings, closed, strict=True)
        for i, j in zip(ring, [*ring[1:], ring[0]] if shut and ring else ring[1:], strict=False)
        if i != j
    ]
    return np.unique(np.array(edges, dtype=np.int64).reshape(-1, 2), axis=0)


def _hits(place: Floats, edges: Ints, tolerance: float) -> tuple[Ints, Ints, Floats, Floats]:
    """Find nodes (n, 2) near edges (e, 2) of others: node, edge, distance, share of length, (h,) each, sorted."""
    if not len(edges):
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0), np.zeros(0)
    tree = shapely.STRtree(shapely.linestrings(place[edges]))
    node, edge = tree.query(shapely.points(place), predicate="dwithin", distance=tolerance)
    start, along = place[edges[edge, 0]], place[edges[edge, 1]] - place[edges[edge, 0]]
    length = np.linalg.norm(along, axis=1)
    share = np.einsum("ij,ij->i", place[node] - start, along) / length**2
    off = np.linalg.norm(place[node] - start - share[:, None] * along, axis=1)
    inside = (share > 0.0) & (share < 1.0) & (edges[edge, 0] != node) & (edges[edge, 1] != node)
    if tolerance > 0.0:
        # a node this close to an end of the edge has already merged with that end
        for end in (0, 1):
            inside &= np.linalg.norm(place[node] - place[edges[edge, end]], axis=1) > tolerance
    order = np.lexsort((edge[inside], off[inside], node[inside]))
    return node[inside][order], edge[inside][order], off[inside][order], share[inside][order]


_RESTS: Final = 1e-15  # distance from an edge, relative to the size of all, up to which a node lies on it


def _onto_edges(
    place: Floats, rings: list[list[int]], node_of: Ints, closed: Sequence[bool], tolerance: float
) -> tuple[Floats, list[list[int]], Ints]:
    """Move nodes onto the nearest edge within the tolerance, repeatedly; places, rings, nodes of corners."""
    # The repetition ends when nothing moves, or after `_ROUNDS` rounds. Where joints cross, corners may be further
    # apart than the tolerance, along both joints; they meet on an edge.
    place, size = place.copy(), float(np.ptp(place, axis=0).max())
    for _ in range(_ROUNDS if tolerance > 0.0 else 0):
        edges = _edges(rings, closed)
        node, edge, off, share = _hits(place, edges, tolerance)
        node, nearest = np.unique(node, return_index=True)
        edge, off, share = edge[nearest], off[nearest], share[nearest]
        if not np.any(off > _RESTS * size):
            break
        alone = _without_swaps(place, node, edges[edge], tolerance)
        node, edge, share = node[alone], edge[alone], share[alone]
        ends = place[edges[edge]]
        place[node] = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
        into = _meeting(place, rings, tolerance)
        place, node_of = place[into], into[node_of]
        rings = [
            without_spikes(into[np.array(ring, dtype=np.int64)].tolist(), closed=shut)
            for ring, shut in zip(rings, closed, strict=True)
        ]
    return place, rings, node_of


def _without_swaps(place: Floats, node: Ints, ends: Ints, tolerance: float) -> Bools:
    """Return a mask (k,) of moves without those in which two near nodes would swap places."""
    goal = dict(zip(node.tolist(), ends.tolist(), strict=True))

    def passes(n: int, m: int) -> bool:
        return n < m and n in goal.get(m, ()) and bool(np.linalg.norm(place[n] - place[m]) <= 2.0 * tolerance)

    return np.array([not any(passes(n, m) for m in goal[n]) for n in node.tolist()], dtype=bool)


def _meeting(place: Floats, rings: Sequence[Sequence[int]], tolerance: float) -> Ints:
    """Return the node (n,) into which each node merges, itself if into none."""
    # Two nodes merge if they lie within the tolerance and no path contains both.
    into = np.arange(len(place))
    owners: dict[int, set[int]] = {}
    for number, ring in enumerate(rings):
        for node in ring:
            owners.setdefault(node, set()).add(number)
    used = np.array(sorted(owners), dtype=np.int64)
    if not len(used):
        return into
    from scipy.spatial import cKDTree  # Imported here because it is slow to import and seldom needed.

    pairs = used[cKDTree(place[used]).query_pairs(tolerance, output_type="ndarray")]
    for first, second in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if into[first] == first and into[second] == second and not owners[first] & owners[second]:
            into[second] = first
            owners[first] |= owners[second]
    return into


def _with_hanging(
    place: Floats, rings: Sequence[Sequence[int]], closed: Sequence[bool], tolerance: float
) -> tuple[list[list[int]], list[list[bool]]]:
    """Insert nodes on edges as corners of paths; return paths, and True for each original corner."""
    edges = _edges(rings, closed)
    size = float(np.ptp(place, axis=0).max()) if len(place) else 0.0
    node, edge, _, share = _hits(place, edges, max(tolerance, 1e-12 * size))
    between: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for n, e, s in zip(node.tolist(), edge.tolist(), share.tolist(), strict=True):
        between.setdefault((int(edges[e, 0]), int(edges[e, 1])), []).append((s, n))
    paths, masks = [], []
    for ring, shut in zip(rings, closed, strict=True):
        corners: list[int] = []
        mask: list[bool] = []
        edge_count = len(ring) if shut else len(ring) - 1
        present = set(ring)
        for position, i in enumerate(ring):
            corners.append(i)
            mask.append(True)
            if position < edge_count:
                j = ring[(position + 1) % len(ring)]
                on = sorted(between.get((min(i, j), max(i, j)), ()), reverse=i > j)
                # a second visit to a corner of the same ring would make the ring touch itself
                extra = [n for _, n in on if n not in present]
                corners += extra
                mask += [False] * len(extra)
        paths.append(corners)
        masks.append(mask)
    return paths, masks


def _without_straight(place: Floats, ring: list[int], originals: list[bool], *, closed: bool) -> list[int]:
    """Remove inserted nodes of a path that lie in a straight edge; `originals` marks original corners."""
    if all(originals):
        return ring
    points, original = place[ring], np.array(originals)
    kept: Bools = original.copy()
    count = len(ring)
    for k in np.flatnonzero(~original).tolist():
        before, after = k - 1, k + 1
        while not original[before % count]:
            before -= 1
        while not original[after % count]:
            after += 1
        chord = points[after % count] - points[before % count]
        arm = points[k] - points[before % count]
        kept[k] = abs(chord[0] * arm[1] - chord[1] * arm[0]) > _STRAIGHT * float(chord @ chord)
    return [node for node, keep in zip(ring, kept, strict=True) if keep]


def straight(outline: Floats) -> Floats:
    """Remove corners (k, 2) in straight edges; keep the whole outline where fewer than three would remain."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    onward = np.einsum("ij,ij->i", before, after) > 0.0
    kept = ~(onward & (cross <= _STRAIGHT * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)))
    return outline[kept] if np.count_nonzero(kept) > 2 else outline


def without_spikes(ring: Sequence[int], *, closed: bool) -> list[int]:
    """Remove repeated nodes from a path of node indices, and spikes from a closed one."""
    # A spike is a run from a node to another and back.
    kept: list[int] = []
    for node in ring:
        if kept and kept[-1] == node:
            continue
        if closed and len(kept) > 1 and kept[-2] == node:
            kept.pop()
            continue
        kept.append(node)
    while closed and len(kept) > 1 and (kept[0] == kept[-1] or (len(kept) > 2 and kept[1] == kept[-1])):
        kept = kept[:-1] if kept[0] == kept[-1] else kept[1:]
    if closed and len(kept) > 2 and kept[0] == kept[-2]:
        kept = kept[:-1]
    return kept


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
    place = points[np.unique(node, return_index=True)[1]]
    loops = _Loops(node[surface.vertex], surface.start, surface.count)
    group, normal, origin = _planes(place, loops, surface.element, tolerance)
    place = _onto_planes(place, loops, group, normal, origin, tolerance)
    moved = place[node]
    shift = np.linalg.norm(moved - points, axis=1)
    solids = [moved[a:b] for a, b in itertools.pairwise(start)]
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
        chosen = [(np.flatnonzero(self.count == corners), corners) for corners in np.unique(self.count).tolist()]
        return [(which, self.node[self.start[which, None] + np.arange(corners)]) for which, corners in chosen]


class _FacePlanes:
    """Mean planes of faces, and distances of corners from them."""

    def __init__(self, place: Floats, loops: _Loops) -> None:
        count = len(loops)
        self._place, self._stacks = place, loops.stacks()
        vector, self.middle = np.zeros((count, 3)), np.zeros((count, 3))
        self.lower, self.upper = np.zeros((count, 3)), np.zeros((count, 3))
        # number of the stack of each face, and its row there
        self._stack, self._row = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        for number, (which, stack) in enumerate(self._stacks):
            corners = place[stack]
            vector[which], self.middle[which] = area_vector(corners), corners.mean(axis=1)
            self.lower[which], self.upper[which] = corners.min(axis=1), corners.max(axis=1)
            self._stack[which], self._row[which] = number, np.arange(len(which))
        self.area = np.linalg.norm(vector, axis=1)
        self.normal = vector / np.where(self.area == 0.0, 1.0, self.area)[:, None]

    def farthest(self, faces: Ints, planes: Ints) -> Floats:
        """Return the largest distance (p,) of corners of faces from planes of other faces."""
        distance = np.zeros(len(faces))
        for number, (_, stack) in enumerate(self._stacks):
            of_stack = np.flatnonzero(self._stack[faces] == number)
            plane = planes[of_stack]
            arm = self._place[stack[self._row[faces[of_stack]]]] - self.middle[plane, None]
            heights = np.abs(np.einsum("nki,ni->nk", arm, self.normal[plane]))
            distance[of_stack] = heights.max(axis=1, initial=0.0)
        return distance


def _planes(place: Floats, loops: _Loops, solid: Ints, tolerance: float) -> tuple[Ints, Floats, Floats]:
    """Group faces in one plane within the tolerance: plane (faces,), −1 if not plane; normal, point (p, 3)."""
    faces = _FacePlanes(place, loops)
    area, normal = faces.area, faces.normal
    every = np.arange(len(loops))
    bulge = faces.farthest(every, every)  # of each face from its own plane

    def parallel(one: Ints, two: Ints) -> Bools:
        cosine = np.einsum("ij,ij->i", normal[one], normal[two])
        # Faces of two solids are opposite or continue one another; faces of one solid continue one another.
        return np.asarray(np.where(solid[one] == solid[two], cosine, np.abs(cosine)) > _FLAT)

    one, two = near_pairs(faces.lower, faces.upper, np.full(len(loops), tolerance), parallel)
    swap = area[one] < area[two]
    larger, smaller = np.where(swap, two, one), np.where(swap, one, two)
    plane = (area[smaller] > 0.0) & (bulge[larger] <= tolerance)
    larger, smaller = larger[plane], smaller[plane]
    joined = faces.farthest(smaller, larger) <= tolerance
    # from the largest face to the smallest
    order = np.argsort(-area, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = every
    leader = _leaders(order, rank, larger[joined], smaller[joined], faces.farthest, tolerance)
    first, group = np.unique(rank[leader], return_inverse=True)
    # faces that are themselves not plane within the tolerance move no corner
    group[bulge > tolerance] = -1
    return group, normal[order[first]], faces.middle[order[first]]


def _leaders(
    order: Ints, rank: Ints, a: Ints, b: Ints, farthest: Callable[[Ints, Ints], Floats], tolerance: float
) -> Ints:
    """Return for each face (n,) that whose plane it joins: the first in `order`, reached by coplanar pairs (a, b).

    rank: (n,) places in `order`. farthest: largest distance of faces from planes of others.
    """
    count = len(order)
    part = components(count, a, b)
    first_rank = np.full(int(part.max(initial=-1)) + 1, count, dtype=np.int64)  # of each part
    np.minimum.at(first_rank, part, rank)
    leader = order[first_rank[part]]
    # Where all faces joined by pairs lie in the plane of their first one, they are one group. A part that drifts away
    # from it, pair by pair, is divided: every face is compared with the leader, not with its neighbour.
    drifts = np.zeros(len(first_rank), dtype=bool)
    drifts[part[farthest(np.arange(count), leader) > tolerance]] = True
    in_drifting = drifts[part[a]]
    partners: dict[int, list[int]] = {}
    for one, two in zip(a[in_drifting].tolist(), b[in_drifting].tolist(), strict=True):
        partners.setdefault(one, []).append(two)
        partners.setdefault(two, []).append(one)
    undivided = order[drifts[part[order]]].tolist()
    leader[undivided] = -1
    for first in undivided:
        if leader[first] >= 0:
            continue
        leader[first] = first
        pending = [first]
        while pending:
            near = [face for face in partners.get(pending.pop(), ()) if leader[face] < 0]
            faces = np.array(near, dtype=np.int64)
            joined = faces[farthest(faces, np.full(len(faces), first)) <= tolerance]
            leader[joined] = first
            pending += joined.tolist()
    return leader


def _onto_planes(place: Floats, loops: _Loops, group: Ints, normal: Floats, origin: Floats, tolerance: float) -> Floats:
    """Move every node by the least distance onto the planes of its faces; group: −1 for none."""
    # One number for a node and a plane: sorting it is many times faster than sorting rows.
    base = len(normal) + 1
    pairs = np.unique(loops.node * base + np.repeat(group, loops.count) + 1)
    pairs = pairs[pairs % base > 0]
    node, plane = pairs // base, pairs % base - 1
    planes_of_node = np.bincount(node, minlength=len(place))
    first = np.concatenate([[0], np.cumsum(planes_of_node)])[:-1]
    moved = place.copy()
    for count in np.unique(planes_of_node[planes_of_node > 0]).tolist():
        nodes = np.flatnonzero(planes_of_node == count)
        planes = plane[first[nodes, None] + np.arange(count)]
        rows = normal[planes]
        distances = np.einsum("nki,nki->nk", origin[planes] - place[nodes, None], rows)
        step = np.einsum("nik,nk->ni", np.linalg.pinv(rows, rcond=_RANK), distances)
        near = np.linalg.norm(step, axis=1) <= _FAR * tolerance  # others stay
        moved[nodes[near]] += step[near]
    return moved
