"""Multifrontal Cholesky factors of sparse matrices, and projections on the solutions of linear equations.

Source: Duff & Reid, ACM TOMS 9 (1983) 302–325; Liu, SIAM Review 34 (1992) 82–109.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import blas, lapack
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jld_core import tolerances
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
    # Depth first. A part gets its number after its children, so `parent` is filled in afterwards. An entry of the stack
    # is a part with its edges, the numbers of its children (None: not yet split), and the list that takes its number.
    stack: list[tuple[Ints, Ints, Ints, list[int] | None, list[int]]] = []
    roots: list[int] = []
    stack.append((np.arange(count), rows, columns, None, roots))
    while stack:
        nodes, a, b, children, siblings = stack.pop()
        if children is not None or len(nodes) <= leaf:
            for child in children or []:
                parent[child] = len(order)
            siblings.append(len(order))
            order.append(nodes)
            parent.append(-1)
            continue
        first, second, separator = _bisect(nodes, a, b, places, side)
        halves: list[int] = []
        stack.append((_along(separator, places), a, b, halves, siblings))
        side[separator] = 2
        side[first], side[second] = 0, 1
        for part, half in ((second, 1), (first, 0)):
            if len(part):
                inside = (side[a] == half) & (side[b] == half)
                stack.append((_along(part, places) if len(part) <= leaf else part, a[inside], b[inside], None, halves))
    start = np.concatenate([[0], np.cumsum([len(part) for part in order])]).astype(np.int64)
    return Dissection(np.concatenate(order).astype(np.int64), start, np.array(parent, dtype=np.int64))


def _bisect(nodes: Ints, a: Ints, b: Ints, places: Floats, side: np.ndarray) -> tuple[Ints, Ints, Ints]:
    """Split a part of a graph into two halves and a separator. side: work array (n,)."""
    # Each of the two longest directions gives a cut, and either set of nodes along a cut may be the separator; the
    # smallest one is taken.
    centred = places[nodes] - places[nodes].mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    cuts: list[tuple[int, Bools, Bools]] = []
    for axis in axes.T[:2]:
        distance = centred @ axis
        upper = np.zeros(len(nodes), dtype=bool)
        upper[np.argsort(distance, kind="stable")[len(nodes) // 2 :]] = True
        side[nodes] = upper
        cut = side[a] != side[b]
        cut_ends = np.concatenate([a[cut], b[cut]])
        for half in (0, 1):
            shore = np.zeros(len(side), dtype=bool)
            shore[cut_ends[side[cut_ends] == half]] = True
            in_shore = shore[nodes]
            cuts.append((int(in_shore.sum()), upper & ~in_shore, in_shore))
    _, upper, in_shore = min(cuts, key=lambda cut: cut[0])
    return nodes[~upper & ~in_shore], nodes[upper], nodes[in_shore]


def _along(nodes: Ints, places: Floats) -> Ints:
    """Sort nodes along their longest direction, so that neighbours get near numbers."""
    if len(nodes) < 3:
        return nodes
    centred = places[nodes] - places[nodes].mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    return nodes[np.argsort(np.round(centred @ axis, 9), kind="stable")]


def graph_places(rows: Ints, columns: Ints, count: int) -> Floats:
    """Return artificial coordinates (count, 3) of the nodes of a graph with edges (e,), for bisection."""
    # Coordinates follow from the numbers of edges to a few distant nodes. Connected components get separate ranges of
    # the first coordinate; the third is 0.
    both = np.concatenate([rows, columns]), np.concatenate([columns, rows])
    graph = sp.csr_array((np.ones(len(both[0])), both), shape=(count, count))
    count_components, component_of = connected_components(graph, directed=False)
    places = np.zeros((count, 3))
    for component in range(count_components):
        inside = np.flatnonzero(component_of == component)
        from_start = _distances(graph, int(inside[0]))
        first_end = int(inside[np.argmax(from_start[inside])])
        from_first = _distances(graph, first_end)
        second_end = int(inside[np.argmax(from_first[inside])])
        from_second = _distances(graph, second_end)
        third = int(inside[np.argmax((from_first + from_second)[inside])])
        from_third = _distances(graph, third)
        places[inside, 0] = (from_first - from_second)[inside] + 2.0 * count * component
        places[inside, 1] = from_third[inside]
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
    in_pivots: bool  # True if `place` counts in the parent's pivot unknowns, False if in its update matrix


class Fronts:
    """Symbolic analysis of one sparsity pattern for multifrontal Cholesky factorisation.

    rows, columns: (e,) entries of either triangle, once each. node: (n,) graph node of each unknown. order: unknowns as
    eliminated, with inverse `rank`; front k eliminates bounds[k] … bounds[k + 1] and changes the unknowns
    `passed[k]`. parent: −1 for a root. `entries` sorts matrix entries by front, pivot matrix before panel; part j of
    these 2 · fronts parts is cut[j] … cut[j + 1], at positions `target` of its array.
    """

    def __init__(self, rows: Ints, columns: Ints, node: Ints, places: Floats | None = None) -> None:
        size = len(node)
        nodes = int(node.max()) + 1
        weight = np.bincount(node, minlength=nodes)
        edges = np.unique(np.maximum(node[rows], node[columns]) * nodes + np.minimum(node[rows], node[columns]))
        a, b = edges // nodes, edges % nodes
        leaf = max(1, int(_LEAF / weight.mean()))
        tree = nested_dissection(a, b, nodes, leaf, places)
        node_rank = np.empty(nodes, dtype=np.int64)
        node_rank[tree.order] = np.arange(nodes)
        # `order` lists unknowns as they are eliminated; `rank` is its inverse.
        self.order = np.argsort(node_rank[node], kind="stable")
        self.rank = np.empty(size, dtype=np.int64)
        self.rank[self.order] = np.arange(size)
        offset = np.concatenate([[0], np.cumsum(weight[tree.order])])
        self.size = size
        self._lay_out(tree.start, tree.parent, node_rank[a], node_rank[b], offset)
        self._place_entries(self.rank[rows], self.rank[columns])

    def _lay_out(self, start: Ints, parent: Ints, a: Ints, b: Ints, offset: Ints) -> None:
        """Build the fronts, and the row ranges that receive their updates.

        a, b: (e,) edges by order of elimination. offset: (nodes + 1,) first unknown of each node.
        """
        later, sooner = np.maximum(a, b), np.minimum(a, b)
        by_sooner = np.argsort(sooner, kind="stable")
        later, sooner = later[by_sooner], sooner[by_sooner]
        first_edge = np.searchsorted(sooner, start)
        self.parent, self.bounds = parent, offset[start]
        children: list[list[int]] = [[] for _ in parent]
        passed_nodes: list[Ints] = []
        self.passed: list[Ints] = []
        self._onto: list[list[tuple[int, list[_Run]]]] = [[] for _ in parent]
        for part in range(len(parent)):
            from_edges = later[first_edge[part] : first_edge[part + 1]]
            touched = np.unique(np.concatenate([from_edges, *(passed_nodes[child] for child in children[part])]))
            passed_on = touched[touched >= start[part + 1]]
            passed_nodes.append(passed_on)
            self.passed.append(_expand(passed_on, offset))
            for child in children[part]:
                unknowns = self.passed[child]
                in_pivots = int(np.searchsorted(unknowns, self.bounds[part + 1]))
                in_update = np.searchsorted(self.passed[part], unknowns[in_pivots:])
                runs = _runs(unknowns[:in_pivots] - self.bounds[part], 0, in_pivots=True)
                runs += _runs(in_update, in_pivots, in_pivots=False)
                if runs:  # the root of a connected component has no update matrix
                    self._onto[part].append((child, runs))
            if parent[part] >= 0:
                children[parent[part]].append(part)

    def _place_entries(self, rows: Ints, columns: Ints) -> None:
        """Assign each matrix entry (e,) a position in the pivot matrix or the panel of its front."""
        row, column = np.maximum(rows, columns), np.minimum(rows, columns)
        front = np.searchsorted(self.bounds, column, side="right") - 1
        pivots = self.bounds[front + 1] - self.bounds[front]
        in_pivots = row < self.bounds[front + 1]
        # One search in the sorted pairs (front, unknown) finds the positions of all rows below pivot matrices.
        keys = np.concatenate([part * self.size + passed for part, passed in enumerate(self.passed)])
        begin = np.concatenate([[0], np.cumsum([len(passed) for passed in self.passed])])
        row_below = np.searchsorted(keys, front * self.size + row) - begin[front]
        local_column = column - self.bounds[front]
        height = np.where(in_pivots, pivots, np.diff(begin)[front])
        target = np.where(in_pivots, row - self.bounds[front], row_below) + local_column * height
        order = np.lexsort((target, ~in_pivots, front))
        cut = np.searchsorted(2 * front[order] + ~in_pivots[order], np.arange(2 * len(self.parent) + 1))
        self.entries, self.target, self.cut = order, target[order], cut
        self.diagonal = np.flatnonzero(row[order] == column[order])

    def factor(self, data: Floats) -> Factor:
        """Compute the Cholesky factor for entries (e,).

        Raise np.linalg.LinAlgError if the matrix is not positive definite.
        """
        entries, target, cut, bounds = data[self.entries], self.target, self.cut, self.bounds
        pivots: list[Floats] = []
        panels: list[Floats] = []
        updates: dict[int, Floats] = {}
        for part, passed in enumerate(self.passed):
            p, r = int(bounds[part + 1] - bounds[part]), len(passed)
            pivot, panel, update = np.zeros((p, p)), np.zeros((p, r)), np.zeros((r, r))
            middle, end = cut[2 * part + 1], cut[2 * part + 2]
            pivot.ravel()[target[cut[2 * part] : middle]] = entries[cut[2 * part] : middle]
            panel.ravel()[target[middle:end]] = entries[middle:end]
            for child, runs in self._onto[part]:
                _extend(updates.pop(child).T, runs, pivot, panel, update)
            # Transposes are passed because LAPACK reads columns: it then sees lower triangles without a copy.
            if p:
                factor, info = lapack.dpotrf(pivot.T, lower=1, clean=0, overwrite_a=1)
                if info:
                    raise np.linalg.LinAlgError("matrix is not positive definite")
                if r:
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
            if r:
                updates[part] = update
        return Factor(self, pivots, panels)


def _runs(places: Ints, first: int, in_pivots: bool) -> list[_Run]:
    """Split ascending positions into ranges; in_pivots: they count in the parent's pivot unknowns."""
    if not len(places):
        return []
    ends = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return [_Run(first + a, first + b, int(places[a]), in_pivots) for a, b in itertools.pairwise(ends)]


def _extend(child: Floats, runs: list[_Run], pivot: Floats, panel: Floats, update: Floats) -> None:
    """Add the update matrix (n, n), upper triangle, of a child front to the matrices of its parent."""
    for i, row in enumerate(runs):
        rows = slice(row.place, row.place + row.last - row.first)
        for column in runs[i:]:
            block = child[row.first : row.last, column.first : column.last]
            columns = slice(column.place, column.place + column.last - column.first)
            if not row.in_pivots:
                update[rows, columns] += block
            elif column.in_pivots:
                pivot[rows, columns] += block
            else:
                panel[rows, columns] += block


def _expand(nodes: Ints, offset: Ints) -> Ints:
    """Return the unknowns of graph nodes, one node after another."""
    count = offset[nodes + 1] - offset[nodes]
    ends = np.cumsum(count)
    counter = np.arange(int(ends[-1]) if len(ends) else 0)
    return np.asarray(counter + np.repeat(offset[nodes] - ends + count, count), dtype=np.int64)


class Factor:
    """Cholesky factorisation of a matrix.

    pivots: factor of the p unknowns that each front eliminates. panels: its rows for the r later ones.
    """

    def __init__(self, fronts: Fronts, pivots: list[Floats], panels: list[Floats]) -> None:
        self._fronts, self._pivots, self._panels = fronts, pivots, panels

    def solve(self, rhs: Floats) -> Floats:
        """Solve for right-hand sides (n,) or (n, k)."""
        fronts = self._fronts
        x = np.array(rhs[fronts.order], dtype=float)
        if x.ndim == 1:
            x = x[:, None]
        bounds = fronts.bounds.tolist()
        for front, later in enumerate(fronts.passed):
            first, last = bounds[front], bounds[front + 1]
            if last > first:
                y = blas.dtrsm(1.0, self._pivots[front], x[first:last], lower=1)
                x[first:last] = y
                if len(later):
                    x[later] -= self._panels[front] @ y
        for front in range(len(fronts.passed) - 1, -1, -1):
            first, last, later = bounds[front], bounds[front + 1], fronts.passed[front]
            if last > first:
                y = x[first:last]
                if len(later):
                    y = y - self._panels[front].T @ x[later]
                x[first:last] = blas.dtrsm(1.0, self._pivots[front], y, lower=1, trans_a=1)
        return x[fronts.rank].reshape(rhs.shape)


_FULL = 20_000  # number of entries up to which products with a dense matrix are faster
_LISTED = 256  # number of nodes and edges up to which components are found in lists
_DENSE = 200  # number of equations up to which a stored dense projector is faster than sparse triangular solves

_FEW = 1000  # number of columns up to which a dense factorisation is computed
_RANK = 1e-12  # relative size of a pivot below which its row depends on others
_DEPENDENT = 1e-10  # the same for a row without its part along other rows, relative to the largest entry
_SHIFT = 1e-10  # δ of the regularisation: far above rounding, far below the least eigenvalues of E Eᵀ
_STEPS = 12  # number of steps of regularisation


class Projector:
    """Projection of a vector F on the solutions of A F = r, with A factored once (3.9).

    places: (rows, d) coordinates for sparse Cholesky; None (LU) where a full column makes A Aᵀ full.
    """

    def __init__(self, matrix: sp.csc_array, places: Floats | None = None) -> None:
        self.matrix = matrix
        self.rows = dense_if_small(sp.csr_array(matrix))
        self._dense: Floats | None = None
        if matrix.shape[0] <= _DENSE:
            self._dense = _right_inverse(matrix.toarray())
        else:
            normal = (matrix @ matrix.T).tocsc()
            self._solve = _cholesky(normal, places) or _lu(normal)

    def correction(self, residual: Floats) -> Floats:
        """Return the least-norm change (columns,) of F that removes a residual A F − r, or of each column of some."""
        if self._dense is not None:
            return self._dense @ residual
        return np.asarray(self.matrix.T @ self._solve(residual))

    def project_onto(self, equations: sp.csr_array, y: Floats, right: Floats, others: Floats) -> Floats:
        """Return a point near y where A F = right, and few equations E F = others that may depend on A."""
        # What is left of E without its part along A has small pivots where a row depends on others.
        few = equations.toarray().T
        basis, triangle, order = la.qr(
            few - self.correction(self.matrix @ few), mode="economic", pivoting=True, check_finite=False
        )
        rank = int(np.count_nonzero(abs(np.diag(triangle)) > _DEPENDENT * abs(few).max(initial=0.0)))
        basis, triangle, order = basis[:, :rank], triangle[:rank, :rank], order[:rank]
        for _ in range(3):
            y = y - self.correction(self.matrix @ y - right)
            y = y - basis @ la.solve_triangular(triangle, (equations @ y - others)[order], trans="T")
        return y


def _cholesky(normal: sp.csc_array, places: Floats | None) -> Callable[[Floats], Floats] | None:
    """Return a multifrontal solver of A Aᵀ x = r; None without places, or if A Aᵀ is not positive definite."""
    if places is None:
        return None
    rows, columns = normal.tocoo().coords
    lower = rows >= columns
    _, node = np.unique(places, axis=0, return_inverse=True)
    first = np.unique(node, return_index=True)[1]
    try:
        fronts = Fronts(rows[lower].astype(np.int64), columns[lower].astype(np.int64), node, places[first])
        return fronts.factor(normal.tocoo().data[lower]).solve
    except np.linalg.LinAlgError:
        return None


def _lu(normal: sp.csc_array) -> Callable[[Floats], Floats]:
    """Return a solver of A Aᵀ x = r by sparse LU factors of `normal`, the matrix A Aᵀ."""
    # Rows are of order one. A shift as small as rounding admits dependent rows (no friction anywhere).
    shifted = normal + 1e-15 * sp.eye_array(normal.shape[0], format="csc")
    return spla.splu(shifted, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def _right_inverse(matrix: Floats) -> Floats:
    # Aᵀ(AAᵀ)⁻¹ of a matrix A; the pseudo-inverse serves linearly dependent rows.
    try:
        factor = np.linalg.cholesky(matrix @ matrix.T)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, rcond=1e-12), dtype=float)
    diagonal = np.diag(factor)
    if diagonal.min() < 1e-6 * diagonal.max():
        return np.asarray(np.linalg.pinv(matrix, rcond=1e-12), dtype=float)
    return la.cho_solve((factor, True), matrix).T


class ConsistentProjector:
    """Projection on the solutions of consistent equations E y = r whose rows may be dependent.

    Few unknowns take a rank-revealing QR factorisation, many iterated Tikhonov regularisation: Hanke & Groetsch,
    J. Optim. Theory Appl. 98 (1998).
    """

    def __init__(self, equations: sp.csr_array) -> None:
        self.equations = equations
        self._dense: tuple[Floats, Floats, Ints] | None = None  # basis of the row space, triangle, independent rows
        if equations.shape[1] <= _FEW:
            # a quarter of the time of a pseudo-inverse
            basis, triangle, order = la.qr(equations.toarray().T, mode="economic", pivoting=True, check_finite=False)
            pivots = abs(np.diag(triangle))
            rank = int(np.count_nonzero(pivots > _RANK * pivots.max(initial=0.0)))
            self._dense = basis[:, :rank], triangle[:rank, :rank], order[:rank]
        else:
            rows, columns = equations.shape
            # The augmented matrix stays sparse where the column of λ is full, unlike E Eᵀ.
            corners = [[sp.eye_array(columns), equations.T], [equations, -_SHIFT * sp.eye_array(rows)]]
            options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
            self._factor = spla.splu(sp.csc_array(sp.block_array(corners)), permc_spec="MMD_AT_PLUS_A", options=options)

    def project(self, y: Floats, right: Floats) -> Floats:
        """Return the solution (columns,) next to a point y, up to rounding."""
        if self._dense is not None:
            basis, triangle, rows = self._dense
            for _ in range(3):
                y = y - basis @ la.solve_triangular(triangle, (self.equations @ y - right)[rows], trans="T")
            return y
        best, best_size = y, np.inf
        for _ in range(_STEPS):
            residual = self.equations @ y - right
            size = float(abs(residual).max(initial=0.0))
            if size < best_size:
                best, best_size = y, size
            elif size > 2.0 * best_size:
                break
            # The product with Eᵀ, unlike the solver's own step, has no part along the solutions.
            y = y + self.equations.T @ self._factor.solve(np.concatenate([np.zeros(len(y)), residual]))[len(y) :]
        return best


def dense_if_small(matrix: Any) -> Any:
    """Return a sparse matrix of up to `_FULL` entries as a dense one, which multiplies vectors faster."""
    return matrix.toarray() if matrix.shape[0] * matrix.shape[1] <= _FULL else matrix


def summed(*parts: Floats) -> Floats:
    """Add arrays of one shape; entries that cancel up to rounding become exactly zero."""
    return without_rounding(np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0))


def without_rounding(total: Floats, gross: Floats) -> Floats:
    """Return sums with zero in place of those that are rounding of the summed magnitudes of their terms."""
    return np.where(abs(total) <= tolerances.ROUNDING * gross, 0.0, total)


def components(count: int, one: Ints, other: Ints) -> Ints:
    """Return the connected component of each node, numbered in the order of their first nodes.

    Parameters
    ----------
    count : int
        Number of nodes.
    one, other : (k,) int arrays
        Ends of the edges, in either direction; repetitions are allowed.

    Returns
    -------
    (count,) int array
        Component of each node.
    """
    if count + len(one) <= _LISTED:
        return _few_components(count, one.tolist(), other.tolist())
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def merged_points(places: Floats, reach: float) -> tuple[Floats, Ints]:
    """Merge places within `reach`, also by chains.

    Parameters
    ----------
    places : (k, d) array
        Points, scene units.
    reach : float
        Largest distance of two that are one, scene units.

    Returns
    -------
    points : (p, d) array
        The first place of each.
    number : (k,) int array
        The point of each place.
    """
    from scipy.spatial import cKDTree  # slow to import

    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray").reshape(-1, 2)
    number = components(len(places), pairs[:, 0], pairs[:, 1])
    return places[np.unique(number, return_index=True)[1]], number


def _few_components(count: int, one: list[int], other: list[int]) -> Ints:
    """Find components as `components` does, without a sparse graph, which takes longer for few nodes."""
    root = list(range(count))
    for edge in zip(one, other, strict=True):
        roots = []
        for node in edge:
            while root[node] != node:
                root[node] = root[root[node]]
                node = root[node]
            roots.append(node)
        root[max(roots)] = min(roots)
    for node in range(count):
        root[node] = root[root[node]]  # the roots of lower nodes are final
    return np.unique(root, return_inverse=True)[1].astype(np.int64)
