"""The nearest solution of linear equations, by a factor that is made once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from jld_core.arrays import Floats
from jld_core.linalg.cholesky import Fronts

_FULL = 20_000  # entries up to which products with a full matrix are the quicker ones
_DENSE = 200  # equations up to which a stored dense projector beats sparse triangular solves


class Projector:
    """Nearest solution of A F = r: F − Aᵀ(A Aᵀ)⁻¹(A F − r), with A restricted to the active resultants.

    places: (rows, d) where the element of each row is; None where a column is full, and A Aᵀ with it.
    """

    def __init__(self, matrix: sp.csc_array, places: Floats | None = None) -> None:
        self.matrix = matrix
        self.rows = quick(sp.csr_array(matrix))
        self._dense: Floats | None = None
        if matrix.shape[0] <= _DENSE:
            self._dense = _right_inverse(matrix.toarray())
        else:
            normal = (matrix @ matrix.T).tocsc()
            self._solve = _cholesky(normal, places) or _lu(normal)

    def correction(self, residual: Floats) -> Floats:
        """Least change of F that removes a residual (q·free,); shape (q·m,)."""
        if self._dense is not None:
            return self._dense @ residual
        return np.asarray(self.matrix.T @ self._solve(residual))


def _cholesky(normal: sp.csc_array, places: Floats | None) -> Callable[[Floats], Floats] | None:
    """Solver by multifrontal Cholesky; None where the matrix is full or not positive definite."""
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
    # rows of order one: a shift of rounding size lets dependent rows (no friction anywhere) pass
    shifted = normal + 1e-15 * sp.eye_array(normal.shape[0], format="csc")
    return spla.splu(shifted, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def _right_inverse(matrix: Floats) -> Floats:
    """Aᵀ(A Aᵀ)⁻¹; the pseudo-inverse where rows depend on one another."""
    try:
        factor = np.linalg.cholesky(matrix @ matrix.T)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, rcond=1e-12), dtype=float)
    diagonal = np.diag(factor)
    if diagonal.min() < 1e-6 * diagonal.max():
        return np.asarray(np.linalg.pinv(matrix, rcond=1e-12), dtype=float)
    return la.cho_solve((factor, True), matrix).T


def quick(matrix: Any) -> Any:
    """A sparse matrix for products with vectors: small ones in full, where looking up what is not zero takes longer."""
    return matrix.toarray() if matrix.shape[0] * matrix.shape[1] <= _FULL else matrix
