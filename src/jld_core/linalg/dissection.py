"""Nested dissection: elimination order of a graph, and the tree of its separators.

A line of elements cuts the graph in two, then each half again, down to small parts. Separators are eliminated after the
parts that they separate. Cuts are perpendicular to the longest directions of a part, because contacts are local in
space. Where coordinates are unknown, distances in the graph replace them.
Source: George, SIAM J. Numer. Anal. 10 (1973) 345–363; Liu, SIAM Review 34 (1992) 82–109 (multifrontal tree).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jld_core.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Dissection:
    """Parts of a graph of n nodes in the order of elimination, children before their parents.

    order: (n,) nodes in order of elimination. start: (parts + 1,) part p is order[start[p] : start[p + 1]]; it may be
    empty. parent: (parts,) parent of each part in the tree of separators, −1 for a root.
    """

    order: Ints
    start: Ints
    parent: Ints


def nested_dissection(rows: Ints, columns: Ints, count: int, leaf: int, places: Floats | None = None) -> Dissection:
    """Order the nodes of a graph for sparse elimination, by recursive bisection.

    rows, columns: (e,) ends of the edges, each edge at least once; loops are ignored. count: number of nodes. leaf:
    number of nodes up to which a part is not bisected. places: (count, d) coordinates of the nodes; default: computed
    from distances in the graph. Result: order of elimination, its parts (separators and leaves), and their tree.
    """
    proper = rows != columns
    rows, columns = rows[proper], columns[proper]
    if places is None:
        places = graph_places(rows, columns, count)
    order: list[Ints] = []
    parent: list[int] = []
    side = np.zeros(count, dtype=np.int8)
    # Depth first. A part gets its number after its children, so `parent` is filled in afterwards.
    work: list[tuple[Ints, Ints, Ints, list[int] | None, list[int]]] = []
    roots: list[int] = []
    work.append((np.arange(count), rows, columns, None, roots))
    while work:
        nodes, a, b, children, siblings = work.pop()
        if children is not None or len(nodes) <= leaf:
            for child in children or []:
                parent[child] = len(order)
            siblings.append(len(order))
            order.append(nodes)
            parent.append(-1)
            continue
        low, high, separator = _bisect(nodes, a, b, places, side)
        below: list[int] = []
        work.append((_along(separator, places), a, b, below, siblings))
        side[separator] = 2
        side[low], side[high] = 0, 1
        for part, value in ((high, 1), (low, 0)):
            if len(part):
                inside = (side[a] == value) & (side[b] == value)
                work.append((_along(part, places) if len(part) <= leaf else part, a[inside], b[inside], None, below))
    start = np.concatenate([[0], np.cumsum([len(part) for part in order])]).astype(np.int64)
    return Dissection(np.concatenate(order).astype(np.int64), start, np.array(parent, dtype=np.int64))


def _bisect(nodes: Ints, a: Ints, b: Ints, places: Floats, side: np.ndarray) -> tuple[Ints, Ints, Ints]:
    """Split a part of a graph into two halves and a separator, and return all three.

    Each of the two longest directions gives a cut, and either set of nodes along a cut may be the separator; the
    smallest one is taken. nodes: nodes of the part. a, b: ends of the edges. places: (n, d) coordinates of all nodes.
    side: work array (n,), overwritten at the nodes of the part.
    """
    middle = places[nodes] - places[nodes].mean(axis=0)
    axes = np.linalg.eigh(middle.T @ middle)[1][:, ::-1]
    cuts: list[tuple[int, Bools, Bools]] = []
    for axis in axes.T[:2]:
        along = middle @ axis
        upper = np.zeros(len(nodes), dtype=bool)
        upper[np.argsort(along, kind="stable")[len(nodes) // 2 :]] = True
        side[nodes] = upper
        cut = side[a] != side[b]
        ends = np.concatenate([a[cut], b[cut]])
        for value in (0, 1):
            shore = np.zeros(len(side), dtype=bool)
            shore[ends[side[ends] == value]] = True
            here = shore[nodes]
            cuts.append((int(here.sum()), upper & ~here, here))
    _, upper, here = min(cuts, key=lambda cut: cut[0])
    return nodes[~upper & ~here], nodes[upper], nodes[here]


def _along(nodes: Ints, places: Floats) -> Ints:
    """Sort nodes along their longest direction, so that neighbours get near numbers.

    places: (n, d) coordinates of all nodes.
    """
    if len(nodes) < 3:
        return nodes
    middle = places[nodes] - places[nodes].mean(axis=0)
    axis = np.linalg.eigh(middle.T @ middle)[1][:, -1]
    return nodes[np.argsort(np.round(middle @ axis, 9), kind="stable")]


def graph_places(rows: Ints, columns: Ints, count: int) -> Floats:
    """Return artificial coordinates (count, 3) of the nodes of a graph, for bisection.

    They follow from the numbers of edges to a few distant nodes. Connected components get separate ranges of the first
    coordinate; the third is 0. rows, columns: (e,) ends of the edges. count: number of nodes.
    """
    both = np.concatenate([rows, columns]), np.concatenate([columns, rows])
    graph = sp.csr_array((np.ones(len(both[0])), both), shape=(count, count))
    parts, part = connected_components(graph, directed=False)
    places = np.zeros((count, 3))
    for k in range(parts):
        inside = np.flatnonzero(part == k)
        first = _distances(graph, int(inside[0]))
        one = int(inside[np.argmax(first[inside])])
        from_one = _distances(graph, one)
        two = int(inside[np.argmax(from_one[inside])])
        from_two = _distances(graph, two)
        three = int(inside[np.argmax((from_one + from_two)[inside])])
        from_three = _distances(graph, three)
        places[inside, 0] = (from_one - from_two)[inside] + 2.0 * count * k
        places[inside, 1] = from_three[inside]
    return places


def _distances(graph: sp.csr_array, root: int) -> Floats:
    """Return the number of edges (n,) from a root to each node of a graph.

    It is 0 for nodes out of reach.
    """
    order, before = breadth_first_order(graph, root, directed=False)
    distance = np.zeros(graph.shape[0])
    for node in order[1:].tolist():
        distance[node] = distance[before[node]] + 1.0
    return distance
