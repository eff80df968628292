"""Drawings are not exact: corners that nearly meet are made to meet, and gaps and overlaps up to a tolerance vanish.

In the plane, corners within the tolerance of one another become one node, and a node within the tolerance of an edge
comes to lie on it; since the ends of every gap and every overlap between two edges are such nodes, both close. Long
edges stay straight: it is the node that moves. In space, corners within the tolerance become one, and faces within it
of one plane come to lie in that plane. Nothing moves that is further away than the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import InputError

_ROUNDS: Final = 4
"""Rounds of moving nodes onto edges: the ends of an edge may move after a node was put on it."""

_STRAIGHT: Final = 1e-9
"""Kink, relative to the edge, below which a node put into an edge is left out again."""


@dataclass(frozen=True)
class Snapped:
    """Paths after snapping, in the order they came.

    paths: (k, 2) corners each; empty where nothing was left. largest: farthest that any corner moved, length.
    moved: corners that moved. collapsed: indices of paths that are no longer an area (closed, fewer than three corners)
    or a line (open, fewer than two).
    """

    paths: list[Floats]
    largest: float
    moved: int
    collapsed: tuple[int, ...]


def snap_polygons(outlines: Sequence[Floats], tolerance: float, *, keep_nodes: bool = False) -> Snapped:
    """Close gaps and overlaps between polygons up to a tolerance.

    outlines: closed (k, 2) polygons, the first corner not repeated. tolerance: length. keep_nodes: keep corners of
    neighbours as corners in straight edges, so that the polygons share whole edges (a coverage).
    Raises InputError for a tolerance that is no length.
    """
    return snap_paths(outlines, [True] * len(outlines), tolerance, keep_nodes=keep_nodes)


def snap_paths(
    paths: Sequence[Floats], closed: Sequence[bool], tolerance: float, *, keep_nodes: bool = False
) -> Snapped:
    """The same for closed and open paths together; arguments and errors as for `snap_polygons`."""
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
    rings, own = _with_hanging(place, rings, closed, tolerance)
    if not keep_nodes:
        rings = [
            _without_straight(place, ring, mask, closed=shut)
            for ring, mask, shut in zip(rings, own, closed, strict=True)
        ]
    rings = [without_spikes(ring, closed=shut) for ring, shut in zip(rings, closed, strict=True)]
    shift = np.linalg.norm(place[node_of] - corners, axis=1)
    lost = tuple(k for k, ring in enumerate(rings) if len(ring) < (3 if closed[k] else 2))
    return Snapped([place[ring] for ring in rings], float(shift.max()), int(np.count_nonzero(shift)), lost)


def merge_points(points: Floats, tolerance: float) -> Ints:
    """(n,) node of each point (n, d): numbered by first appearance, a point joins the first node within the tolerance.

    Nodes are more than the tolerance apart, and none is further than that from its points: there are no chains.
    """
    width = max(tolerance, 1e-300)
    unique, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.reshape(-1)
    if tolerance <= 0.0:
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first, kind="stable")] = np.arange(len(first))
        return rank[inverse]
    # a node to a box of the tolerance at the most where boxes are cut by its diagonal: looked up, never searched
    boxes: dict[tuple[int, ...], list[int]] = {}
    nodes: list[Floats] = []
    node = np.empty(len(unique), dtype=np.int64)
    around = np.array(np.meshgrid(*[[-1, 0, 1]] * points.shape[1])).reshape(points.shape[1], -1).T
    for index in np.argsort(first, kind="stable").tolist():
        point = unique[index]
        with np.errstate(over="ignore"):
            box = np.floor(point / width)
        near = [k for step in around for k in boxes.get(tuple(box + step), ())]
        close = [k for k in near if np.linalg.norm(nodes[k] - point) <= tolerance]
        if close:
            node[index] = min(close)
            continue
        node[index] = len(nodes)
        boxes.setdefault(tuple(box), []).append(len(nodes))
        nodes.append(point)
    return node[inverse]


def _edges(rings: Sequence[Sequence[int]], closed: Sequence[bool]) -> Ints:
    """(e, 2) different edges of all rings, the smaller node first, sorted."""
    found = [
        (min(i, j), max(i, j))
        for ring, shut in zip(rings, closed, strict=True)
        for i, j in zip(ring, [*ring[1:], ring[0]] if shut and ring else ring[1:], strict=False)
        if i != j
    ]
    return np.unique(np.array(found, dtype=np.int64).reshape(-1, 2), axis=0)


def _hits(place: Floats, edges: Ints, tolerance: float) -> tuple[Ints, Ints, Floats, Floats]:
    """Nodes near the inside of edges they are no end of: node, edge, distance, foot as a share of the edge."""
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
        # what is no further than that from an end has met it already
        for end in (0, 1):
            inside &= np.linalg.norm(place[node] - place[edges[edge, end]], axis=1) > tolerance
    order = np.lexsort((edge[inside], off[inside], node[inside]))
    return node[inside][order], edge[inside][order], off[inside][order], share[inside][order]


def _onto_edges(
    place: Floats, rings: list[list[int]], node_of: Ints, closed: Sequence[bool], tolerance: float
) -> tuple[Floats, list[list[int]], Ints]:
    """Nodes near an edge put onto it, each onto the nearest one, until nothing moves any more.

    Where joints cross, corners that are apart along both are further apart than the tolerance: on an edge they meet.
    """
    place, size = place.copy(), float(np.ptp(place, axis=0).max())
    for _ in range(_ROUNDS if tolerance > 0.0 else 0):
        edges = _edges(rings, closed)
        node, edge, off, share = _hits(place, edges, tolerance)
        node, nearest = np.unique(node, return_index=True)
        edge, off, share = edge[nearest], off[nearest], share[nearest]
        if not np.any(off > 1e-15 * size):
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
    """(k,) which nodes to move: of two near one another that would go past each other, the second alone.

    ends: (k, 2) of the edge that each goes onto.
    """
    goal = dict(zip(node.tolist(), ends.tolist(), strict=True))

    def passes(n: int, m: int) -> bool:
        return n < m and n in goal.get(m, ()) and bool(np.linalg.norm(place[n] - place[m]) <= 2.0 * tolerance)

    return np.array([not any(passes(n, m) for m in goal[n]) for n in node.tolist()], dtype=bool)


def _meeting(place: Floats, rings: Sequence[Sequence[int]], tolerance: float) -> Ints:
    """(n,) node that each becomes: what came within the tolerance of one of another ring is one with it."""
    into = np.arange(len(place))
    owners: dict[int, set[int]] = {}
    for number, ring in enumerate(rings):
        for node in ring:
            owners.setdefault(node, set()).add(number)
    used = np.array(sorted(owners), dtype=np.int64)
    if not len(used):
        return into
    pairs = used[cKDTree(place[used]).query_pairs(tolerance, output_type="ndarray")]
    for first, second in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if into[first] == first and into[second] == second and not owners[first] & owners[second]:
            into[second] = first
            owners[first] |= owners[second]
    return into


def _with_hanging(
    place: Floats, rings: Sequence[Sequence[int]], closed: Sequence[bool], tolerance: float
) -> tuple[list[list[int]], list[list[bool]]]:
    """Rings with the nodes that lie on their edges as corners, and for every corner whether it is the ring's own."""
    edges = _edges(rings, closed)
    size = float(np.ptp(place, axis=0).max()) if len(place) else 0.0
    node, edge, _, share = _hits(place, edges, max(tolerance, 1e-12 * size))
    between: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for n, e, s in zip(node.tolist(), edge.tolist(), share.tolist(), strict=True):
        between.setdefault((int(edges[e, 0]), int(edges[e, 1])), []).append((s, n))
    full, own = [], []
    for ring, shut in zip(rings, closed, strict=True):
        corners: list[int] = []
        mask: list[bool] = []
        last = len(ring) if shut else len(ring) - 1
        present = set(ring)
        for position, i in enumerate(ring):
            corners.append(i)
            mask.append(True)
            if position < last:
                j = ring[(position + 1) % len(ring)]
                on = sorted(between.get((min(i, j), max(i, j)), ()), reverse=i > j)
                # a corner of the ring itself would make it touch itself
                extra = [n for _, n in on if n not in present]
                corners += extra
                mask += [False] * len(extra)
        full.append(corners)
        own.append(mask)
    return full, own


def _without_straight(place: Floats, ring: list[int], own: list[bool], *, closed: bool) -> list[int]:
    """A ring less the nodes put into it that leave it as straight as it was."""
    if not any(not mine for mine in own):
        return ring
    points, mine = place[ring], np.array(own)
    kept: Bools = mine.copy()
    count = len(ring)
    for k in np.flatnonzero(~mine).tolist():
        before, after = k - 1, k + 1
        while not mine[before % count]:
            before -= 1
        while not mine[after % count]:
            after += 1
        chord = points[after % count] - points[before % count]
        arm = points[k] - points[before % count]
        kept[k] = abs(chord[0] * arm[1] - chord[1] * arm[0]) > _STRAIGHT * float(chord @ chord)
    return [node for node, keep in zip(ring, kept, strict=True) if keep]


def straight(outline: Floats) -> Floats:
    """A closed outline (k, 2) without the corners that lie in straight edges."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    onward = np.einsum("ij,ij->i", before, after) > 0.0
    kept = ~(onward & (cross <= _STRAIGHT * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)))
    return outline[kept] if np.count_nonzero(kept) > 2 else outline


def without_spikes(ring: Sequence[int], *, closed: bool) -> list[int]:
    """A ring of nodes without repeats and without runs there and back again."""
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
