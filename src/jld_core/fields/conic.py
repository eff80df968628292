"""Conic programs by Clarabel, set up once and updated where labels change rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints

_RESIDUAL = 1e-9


@dataclass
class Rows:
    """Rows of a cone program under construction: entries by row, column and value, and right-hand sides."""

    count: int = 0
    row: list[Ints] = field(default_factory=list)
    column: list[Ints] = field(default_factory=list)
    value: list[Floats] = field(default_factory=list)
    rhs: list[Floats] = field(default_factory=list)

    def add(self, entries: Sequence[tuple[Ints, Floats | float]], rhs: Floats | float, count: int) -> Ints:
        """Append `count` rows; entries: pairs of (count,) or (count, j) columns and values. Return their numbers."""
        place = self.count + np.arange(count)
        if not count:
            return place
        for columns, values in entries:
            wide = np.asarray(columns).reshape(count, -1)
            self.row.append(np.repeat(place, wide.shape[1]))
            self.column.append(wide.ravel())
            filled = np.broadcast_to(np.asarray(values, dtype=float), np.shape(columns)) if np.ndim(values) else values
            self.value.append(np.broadcast_to(filled, np.shape(columns)).reshape(-1).astype(float))
        self.rhs.append(np.broadcast_to(np.asarray(rhs, dtype=float), (count,)).copy())
        self.count += count
        return place

    def matrix(self, width: int) -> sp.csr_array:
        """Return the rows as a matrix."""
        return sp.csr_array(
            (np.concatenate(self.value), (np.concatenate(self.row), np.concatenate(self.column))),
            shape=(self.count, width),
        )

    @property
    def right(self) -> Floats:
        """(count,) right-hand sides."""
        return np.concatenate(self.rhs)


@dataclass(frozen=True)
class Answer:
    """What the solver returned: point (columns,), multipliers (rows,), whether it is of use, status, objective."""

    point: Floats
    dual: Floats
    usable: bool
    status: str
    value: float = np.nan


class ConeProgram:
    """Minimise q x where A x + s = b, s in zero, non-negative and second-order cones of size 3, in that order.

    Rows that are switched off have zero coefficients and a right-hand side inside their cone, so that the structure
    of the program never changes.
    """

    def __init__(self, objective: Floats, matrix: sp.csr_array, rhs: Floats, sizes: tuple[int, int, int]) -> None:
        self._objective, self._rhs = objective, rhs
        self._matrix = sp.csc_matrix(matrix)
        self._matrix.sort_indices()
        self._row = self._matrix.indices.copy()
        self._data = self._matrix.data.copy()
        zero, linear, cones = sizes
        self._cones = [clarabel.ZeroConeT(zero), clarabel.NonnegativeConeT(linear)]
        self._cones += [clarabel.SecondOrderConeT(3)] * cones
        self._idle = np.ones(len(rhs))
        head = zero + linear + np.arange(3 * cones).reshape(-1, 3)
        self._idle[head[:, 1:]] = 0.0
        self._solver: Any = None

    def solve(self, off: Bools | None = None, objective: Floats | None = None) -> Answer:
        """Solve; off: (rows,) True for rows switched off, whole cones only; objective: another q (columns,)."""
        data, rhs = self._data, self._rhs
        if off is not None:
            data = np.where(off[self._row], 0.0, data)
            rhs = np.where(off, self._idle, rhs)
        if self._solver is None:
            width = len(self._objective)
            matrix = sp.csc_matrix((self._data, self._matrix.indices, self._matrix.indptr), shape=self._matrix.shape)
            settings = _settings()
            self._solver = clarabel.DefaultSolver(
                sp.csc_matrix((width, width)), self._objective, matrix, self._rhs, self._cones, settings
            )
        if off is not None:
            self._solver.update(A=data, b=rhs)
        if objective is not None:
            self._solver.update(q=objective)
        answer = self._solver.solve()
        status = str(answer.status)
        usable = status in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations")
        return Answer(np.array(answer.x), np.array(answer.z), usable, status, float(answer.obj_val))


def _settings() -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.input_sparse_dropzeros = False
    settings.chordal_decomposition_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _RESIDUAL
    return settings
