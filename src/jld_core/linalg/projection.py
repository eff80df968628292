"""Projection on the solutions of linear equations, by a factorisation computed once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.linalg.cholesky import Fronts

_FULL = 20_000  # number of entries up to which products with a dense matrix are faster
_LISTED = 256  # number of nodes and edges up to which components are found in lists
_DENSE = 200  # number of equations up to which a stored dense projector is faster than sparse triangular solves

_FEW = 1000  # number of columns up to which a pseudo-inverse is computed
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
        """Return the least-norm change (columns,) of F that removes a residual A F − r."""
        if self._dense is not None:
            return self._dense @ residual
        return np.asarray(self.matrix.T @ self._solve(residual))


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
    # The pseudo-inverse serves linearly dependent rows.
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

    Few equations take a pseudo-inverse, many iterated Tikhonov regularisation. Source: Hanke & Groetsch, J. Optim.
    Theory Appl. 98 (1998).
    """

    def __init__(self, equations: sp.csr_array) -> None:
        self.equations = equations
        self._inverse: Floats | None = None
        if equations.shape[1] <= _FEW:
            self._inverse = np.linalg.pinv(equations.toarray(), rcond=1e-12)
        else:
            rows, columns = equations.shape
            # The augmented matrix stays sparse where the column of λ is full, unlike E Eᵀ.
            corners = [[sp.eye_array(columns), equations.T], [equations, -_SHIFT * sp.eye_array(rows)]]
            options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
            self._factor = spla.splu(sp.csc_array(sp.block_array(corners)), permc_spec="MMD_AT_PLUS_A", options=options)

    def project(self, y: Floats, right: Floats) -> Floats:
        """Return the solution (columns,) next to a point y, up to rounding."""
        if self._inverse is not None:
            for _ in range(3):
                y = y - self._inverse @ (self.equations @ y - right)
            return y
        best, least = y, np.inf
        for _ in range(_STEPS):
            left = self.equations @ y - right
            size = float(abs(left).max(initial=0.0))
            if size < least:
                best, least = y, size
            elif size > 2.0 * least:
                break
            # The product with Eᵀ, unlike the solver's own step, has no part along the solutions.
            y = y + self.equations.T @ self._factor.solve(np.concatenate([np.zeros(len(y)), left]))[len(y) :]
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


def _few_components(count: int, one: list[int], other: list[int]) -> Ints:
    """Find components as `components` does, without a sparse graph, which takes longer for few nodes."""
    root = list(range(count))
    for pair in zip(one, other, strict=True):
        ends = []
        for node in pair:
            while root[node] != node:
                root[node] = root[root[node]]
                node = root[node]
            ends.append(node)
        root[max(ends)] = min(ends)
    for node in range(count):
        root[node] = root[root[node]]  # the roots of lower nodes are final
    return np.unique(root, return_inverse=True)[1].astype(np.int64)
