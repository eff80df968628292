"""Cone programs for Clarabel or a compiled solver, updated where labels change rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.cone_batch import ConeBatch, is_installed

_RESIDUAL = 1e-9  # residuals and duality gap that the solver is asked to reach, absolute and relative

# Statuses after which a second attempt with iterative refinement would change nothing
_ENDED = ("Solved", "PrimalInfeasible", "DualInfeasible")

_NEAR = 1e-7  # largest residual or relative gap at which an answer of status AlmostSolved needs no second attempt


@dataclass
class Rows:
    """Rows of a cone program A x + s = b under construction.

    count: number of rows so far. row, column, value: entries of A, one array per part added. rhs: parts of b. Duplicate
    entries are summed.
    """

    count: int = 0
    row: list[Ints] = field(default_factory=list)
    column: list[Ints] = field(default_factory=list)
    value: list[Floats] = field(default_factory=list)
    rhs: list[Floats] = field(default_factory=list)

    def add(self, entries: Sequence[tuple[Ints, Floats | float]], rhs: Floats | float, count: int) -> Ints:
        """Append `count` rows, and return their numbers (count,).

        entries: pairs (columns, values). Columns are (count,) or (count, j) ints, whose first axis is the row; values
        have that shape or are one number. rhs: (count,) or one number. Without rows nothing is added.
        """
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
        """Return A as a sparse matrix (count, width); at least one row must have been added."""
        return sp.csr_array(
            (np.concatenate(self.value), (np.concatenate(self.row), np.concatenate(self.column))),
            shape=(self.count, width),
        )

    @property
    def right(self) -> Floats:
        """(count,) right-hand sides b; at least one row must have been added."""
        return np.concatenate(self.rhs)


@dataclass(frozen=True)
class Answer:
    """Unproven answer of the solver to one cone program.

    point: (columns,) variables. dual: (rows,) multipliers. objective: value of the objective. usable: True where the
    point is worth repairing; False where the program was infeasible, unbounded or failed. status: name of the status by
    the solver.
    """

    point: Floats
    dual: Floats
    objective: float
    usable: bool
    status: str


class ConeProgram:
    """Cone program: minimise q x where A x + s = b and s lies in a product of cones.

    The solver is set up once, for programs that differ in few rows. Rows that are switched off get zero coefficients
    and a right-hand side inside their cone, so the sparsity never changes.

    objective: (columns,) q. matrix: (rows, columns) a. rhs: (rows,) b. sizes: numbers of equations, of inequalities s ≥
    0, and of second-order cones of 3 rows; A has them in this order. many: True where hundreds of programs are solved.
    They are solved by `ConeBatch`, which takes its time to set up, and by Clarabel where that leaves them open or is
    not installed.
    """

    def __init__(
        self, objective: Floats, matrix: sp.csr_array, rhs: Floats, sizes: tuple[int, int, int], many: bool = False
    ) -> None:
        self._objective, self._rhs, self._sizes, self._many = objective, rhs, sizes, many
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
        self._solvers: dict[bool, Any] = {}
        self._batch: ConeBatch | None = None

    def solve(self, off: Bools | None = None, objective: Floats | None = None) -> Answer:
        """Solve the program, with some rows switched off or with another objective.

        off: (rows,) True for rows switched off; a second-order cone only with all of its rows. objective: (columns,)
        another q. None keeps the rows or q of the call before: give each argument at every call, or at none.

        Linear systems are refined iteratively only in a second attempt, where the first did not converge: refinement
        costs a third of the time. A failure shows in `Answer.usable` alone; no exception is raised.
        """
        if self._many and off is not None:
            return self.solve_all(off[None], None if objective is None else objective[None])[0]
        return self._by_clarabel(off, objective)

    def solve_all(self, off: Bools, objective: Floats | None = None) -> list[Answer]:
        """Solve k programs; see `solve`. The answer to each does not depend on the others.

        off: (k, rows) True for rows switched off. objective: (k, columns) costs, None for those of the constructor.
        """
        costs = None if objective is None else list(objective)
        if not (self._many and is_installed()):
            return [self._by_clarabel(rows, None if costs is None else costs[k]) for k, rows in enumerate(off)]
        if self._batch is None:
            self._batch = ConeBatch(sp.csr_array(self._matrix), self._rhs, self._idle, self._sizes)
        wide = np.broadcast_to(self._objective, (len(off), len(self._objective))) if objective is None else objective
        found, answers = self._batch.solve(off, wide), list[Answer]()
        for k, status in enumerate(found.status):
            if status == "Open":
                answers.append(self._by_clarabel(off[k], None if costs is None else costs[k]))
            else:
                value = float(found.objective[k])
                answers.append(Answer(found.point[k], found.dual[k], value, status == "Solved", status))
        return answers

    def _by_clarabel(self, off: Bools | None, objective: Floats | None) -> Answer:
        """Solve by Clarabel, a second time with refined linear systems where it did not converge."""
        answer = self._solve(off, objective, careful=False)
        if answer.status in _ENDED or (answer.status == "AlmostSolved" and self._residual(False) <= _NEAR):
            return answer
        return self._solve(off, objective, careful=True)

    def _residual(self, careful: bool) -> float:
        """Return the larger of primal residual and relative duality gap of a solver's last answer.

        careful: which of the two solvers, as for `_solve`. The dual residual moves no bound: it belongs to the
        multipliers, which only steer refinement.
        """
        info = self._solvers[careful].get_info()
        return max(float(info.res_primal), float(info.gap_rel))

    def _solve(self, off: Bools | None, objective: Floats | None, careful: bool) -> Answer:
        """Solve once; off, objective: as for `solve`; careful: refine linear systems iteratively."""
        data, rhs = self._data, self._rhs
        if off is not None:
            data = np.where(off[self._row], 0.0, data)
            rhs = np.where(off, self._idle, rhs)
        if careful not in self._solvers:
            width = len(self._objective)
            matrix = sp.csc_matrix((self._data, self._matrix.indices, self._matrix.indptr), shape=self._matrix.shape)
            self._solvers[careful] = clarabel.DefaultSolver(
                sp.csc_matrix((width, width)), self._objective, matrix, self._rhs, self._cones, _settings(careful)
            )
        solver = self._solvers[careful]
        if off is not None:
            solver.update(A=data, b=rhs)
        if objective is not None:
            solver.update(q=objective)
        answer = solver.solve()
        status = str(answer.status)
        usable = status in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations")
        return Answer(np.array(answer.x), np.array(answer.z), float(answer.obj_val), usable, status)


def _settings(careful: bool) -> Any:
    """Return the settings of Clarabel; careful: with iterative refinement of linear systems."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.iterative_refinement_enable = careful
    settings.input_sparse_dropzeros = False
    settings.chordal_decomposition_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _RESIDUAL
    return settings
