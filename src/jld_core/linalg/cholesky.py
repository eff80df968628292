"""Multifrontal Cholesky factorisation of sparse matrices, in numpy and LAPACK.

Source: Duff & Reid, ACM TOMS 9 (1983) 302–325; Liu, SIAM Review 34 (1992) 82–109.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import blas, lapack
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jld_core.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Dissection:
    """Parts of a graph in the order of elimination, children before their parents."""

    order: Ints  # (n,) nodes in order of elimination
    start: Ints  # (parts + 1,) part p is order[start[p] : start[p + 1]]; it may be empty
    parent: Ints  # (parts,) parent of each part in the tree of separators, −1 for a root


def nested_dissection(rows: Ints, columns: Ints, count: int, leaf: int, places: Floats | None = None) -> Dissection:
    """Order the nodes of a graph for sparse elimination, by recursive bisection.

    rows, columns: (e,) ends of edges. places: (count, d) coordinates; None: from distances in the graph.
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
    """Split a part of a graph into two halves and a separator. side: work array (n,)."""
    # Each of the two longest directions gives a cut, and either set of nodes along a cut may be the separator; the
    # smallest one is taken.
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
    """Sort nodes along their longest direction, so that neighbours get near numbers."""
    if len(nodes) < 3:
        return nodes
    middle = places[nodes] - places[nodes].mean(axis=0)
    axis = np.linalg.eigh(middle.T @ middle)[1][:, -1]
    return nodes[np.argsort(np.round(middle @ axis, 9), kind="stable")]


def graph_places(rows: Ints, columns: Ints, count: int) -> Floats:
    """Return artificial coordinates (count, 3) of the nodes of a graph with edges (e,), for bisection."""
    # Coordinates follow from the numbers of edges to a few distant nodes. Connected components get separate ranges of
    # the first coordinate; the third is 0.
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
    """Return the number of edges (n,) from a root to each node, 0 where out of reach."""
    order, before = breadth_first_order(graph, root, directed=False)
    distance = np.zeros(graph.shape[0])
    for node in order[1:].tolist():
        distance[node] = distance[before[node]] + 1.0
    return distance


_LEAF = 100  # number of unknowns up to which a part of the graph is one dense front


def columns_of_factor(a: Ints, b: Ints, count: int) -> list[list[int]]:
    """Return the rows below the diagonal of each column of a factor, fill included.

    a, b: (k,) ends of the entries of the matrix (count, count), in order of elimination; those on the diagonal count
    for nothing.
    """
    below: list[set[int]] = [set() for _ in range(count)]
    proper = a != b
    for row, column in zip(np.maximum(a, b)[proper].tolist(), np.minimum(a, b)[proper].tolist(), strict=True):
        below[column].add(row)
    columns = []
    for column in range(count):
        rows = sorted(below[column])
        columns.append(rows)
        # the first row is the parent of the column in the elimination tree, and fills with its other rows
        if rows:
            below[rows[0]].update(rows[1:])
    return columns


class _Run(NamedTuple):
    """Range of update-matrix rows of a child front that are consecutive rows of its parent."""

    # first, last: range among the unknowns of the child's update matrix
    first: int
    last: int
    place: int  # first row in the parent
    own: bool  # True if `place` counts in the parent's pivot unknowns, False if in its update matrix


class Fronts:
    """Symbolic analysis of one sparsity pattern for multifrontal Cholesky factorisation.

    rows, columns: (e,) entries of either triangle, once each. node: (n,) graph node of each unknown. order: unknowns as
    eliminated, with positions `place`; front k eliminates bounds[k] … bounds[k + 1] and changes the unknowns
    `passed[k]`. parent: −1 for a root.
    """

    def __init__(self, rows: Ints, columns: Ints, node: Ints, places: Floats | None = None) -> None:
        size = len(node)
        nodes = int(node.max()) + 1
        weight = np.bincount(node, minlength=nodes)
        ends = np.unique(np.maximum(node[rows], node[columns]) * nodes + np.minimum(node[rows], node[columns]))
        a, b = ends // nodes, ends % nodes
        leaf = max(1, int(_LEAF / weight.mean()))
        tree = nested_dissection(a, b, nodes, leaf, places)
        rank = np.empty(nodes, dtype=np.int64)
        rank[tree.order] = np.arange(nodes)
        # `order` lists unknowns as they are eliminated; `place` is its inverse.
        self.order = np.argsort(rank[node], kind="stable")
        self.place = np.empty(size, dtype=np.int64)
        self.place[self.order] = np.arange(size)
        offset = np.concatenate([[0], np.cumsum(weight[tree.order])])
        self.size = size
        self._lay_out(tree.start, tree.parent, rank[a], rank[b], offset)
        self._place_entries(self.place[rows], self.place[columns])

    def _lay_out(self, start: Ints, parent: Ints, a: Ints, b: Ints, offset: Ints) -> None:
        """Build the fronts, and the row ranges that receive their updates.

        a, b: (e,) edges by order of elimination. offset: (nodes + 1,) first unknown of each node.
        """
        later, sooner = np.maximum(a, b), np.minimum(a, b)
        by_sooner = np.argsort(sooner, kind="stable")
        later, sooner = later[by_sooner], sooner[by_sooner]
        edge = np.searchsorted(sooner, start)
        self.parent, self.bounds = parent, offset[start]
        children: list[list[int]] = [[] for _ in parent]
        passed_nodes: list[Ints] = []
        self.passed: list[Ints] = []
        self._onto: list[list[tuple[int, list[_Run]]]] = [[] for _ in parent]
        for part in range(len(parent)):
            reached = [later[edge[part] : edge[part + 1]], *(passed_nodes[child] for child in children[part])]
            every = np.unique(np.concatenate(reached))
            mine = every[every >= start[part + 1]]
            passed_nodes.append(mine)
            self.passed.append(_expand(mine, offset))
            for child in children[part]:
                unknowns = self.passed[child]
                own = int(np.searchsorted(unknowns, self.bounds[part + 1]))
                rest = np.searchsorted(self.passed[part], unknowns[own:])
                runs = [*_runs(unknowns[:own] - self.bounds[part], 0, True), *_runs(rest, own, False)]
                if runs:  # the root of a connected component has no update matrix
                    self._onto[part].append((child, runs))
            if parent[part] >= 0:
                children[parent[part]].append(part)

    def _place_entries(self, rows: Ints, columns: Ints) -> None:
        """Assign each matrix entry (e,) a position in the arrays of its front."""
        # The arrays are the pivot matrix and the panel below it.
        row, column = np.maximum(rows, columns), np.minimum(rows, columns)
        front = np.searchsorted(self.bounds, column, side="right") - 1
        own = self.bounds[front + 1] - self.bounds[front]
        inside = row < self.bounds[front + 1]
        # One search in the sorted pairs (front, unknown) finds the positions of all rows below pivot matrices.
        keys = np.concatenate([part * self.size + passed for part, passed in enumerate(self.passed)])
        begin = np.concatenate([[0], np.cumsum([len(passed) for passed in self.passed])])
        found = np.searchsorted(keys, front * self.size + row) - begin[front]
        local = column - self.bounds[front]
        height = np.where(inside, own, np.diff(begin)[front])
        place = np.where(inside, row - self.bounds[front], found) + local * height
        order = np.lexsort((place, ~inside, front))
        cut = np.searchsorted(2 * front[order] + ~inside[order], np.arange(2 * len(self.parent) + 1))
        self.entries, self.where, self.cut = order, place[order], cut
        self.diagonal = np.flatnonzero(row[order] == column[order])

    def factor(self, data: Floats) -> Factor:
        """Compute the Cholesky factor for entries (e,).

        Raise np.linalg.LinAlgError if the matrix is not positive definite.
        """
        values, where, cut, bounds = data[self.entries], self.where, self.cut, self.bounds
        pivots: list[Floats] = []
        panels: list[Floats] = []
        updates: dict[int, Floats] = {}
        for part, passed in enumerate(self.passed):
            own, rest = int(bounds[part + 1] - bounds[part]), len(passed)
            pivot, panel, update = np.zeros((own, own)), np.zeros((own, rest)), np.zeros((rest, rest))
            middle, end = cut[2 * part + 1], cut[2 * part + 2]
            pivot.ravel()[where[cut[2 * part] : middle]] = values[cut[2 * part] : middle]
            panel.ravel()[where[middle:end]] = values[middle:end]
            for child, runs in self._onto[part]:
                _extend(updates.pop(child).T, runs, pivot, panel, update)
            # Transposes are passed because LAPACK reads columns: it then sees lower triangles without a copy.
            if own:
                factor, info = lapack.dpotrf(pivot.T, lower=1, clean=0, overwrite_a=1)
                if info:
                    raise np.linalg.LinAlgError("matrix is not positive definite")
                if rest:
                    panel = blas.dtrsm(1.0, factor, panel.T, side=1, lower=1, trans_a=1, overwrite_b=1)
                    update = blas.dsyrk(-1.0, panel, beta=1.0, c=update.T, lower=1, overwrite_c=1)
                else:
                    panel = panel.T
                pivots.append(factor)
                panels.append(panel)
            else:
                pivots.append(pivot)
                panels.append(panel.T)
                update = update.T
            if rest:
                updates[part] = update
        return Factor(self, pivots, panels)


def _runs(places: Ints, first: int, own: bool) -> list[_Run]:
    """Split ascending positions into ranges; own: they count in the parent's pivot unknowns."""
    if not len(places):
        return []
    cuts = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return [_Run(first + a, first + b, int(places[a]), own) for a, b in itertools.pairwise(cuts)]


def _extend(table: Floats, runs: list[_Run], pivot: Floats, panel: Floats, target: Floats) -> None:
    """Add the update matrix (n, n), upper triangle, of a child front to the matrices of its parent."""
    for i, row in enumerate(runs):
        rows = slice(row.place, row.place + row.last - row.first)
        for column in runs[i:]:
            block = table[row.first : row.last, column.first : column.last]
            columns = slice(column.place, column.place + column.last - column.first)
            if not row.own:
                target[rows, columns] += block
            elif column.own:
                pivot[rows, columns] += block
            else:
                panel[rows, columns] += block


def _expand(nodes: Ints, offset: Ints) -> Ints:
    """Return the unknowns of graph nodes, one node after another."""
    count = offset[nodes + 1] - offset[nodes]
    ends = np.cumsum(count)
    onward = np.arange(int(ends[-1]) if len(ends) else 0)
    return np.asarray(onward + np.repeat(offset[nodes] - ends + count, count), dtype=np.int64)


class Factor:
    """Cholesky factorisation of a matrix.

    pivots: factor of the p unknowns that each front eliminates. panels: its rows for the r later ones.
    """

    def __init__(self, fronts: Fronts, pivots: list[Floats], panels: list[Floats]) -> None:
        self._fronts, self._pivots, self._panels = fronts, pivots, panels

    def solve(self, rhs: Floats) -> Floats:
        fronts = self._fronts
        x = np.array(rhs[fronts.order], dtype=float)
        if x.ndim == 1:
            x = x[:, None]
        bounds = fronts.bounds.tolist()
        for part, passed in enumerate(fronts.passed):
            first, last = bounds[part], bounds[part + 1]
            if last > first:
                y = blas.dtrsm(1.0, self._pivots[part], x[first:last], lower=1)
                x[first:last] = y
                if len(passed):
                    x[passed] -= self._panels[part] @ y
        for part in range(len(fronts.passed) - 1, -1, -1):
            first, last, passed = bounds[part], bounds[part + 1], fronts.passed[part]
            if last > first:
                y = x[first:last]
                if len(passed):
                    y = y - self._panels[part].T @ x[passed]
                x[first:last] = blas.dtrsm(1.0, self._pivots[part], y, lower=1, trans_a=1)
        return x[fronts.place].reshape(rhs.shape)
