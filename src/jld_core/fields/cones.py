"""Symbolic factorisation of the linear systems of many cone programs, computed once.

The reduced system is docs/method.md (9.17). Cones are eliminated first, so that only variables and equations remain.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import clarabel
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import chosen, interface
from jld_core.batch.library import Cones, ConeTask, library, pointers, require_success
from jld_core.deadline import time_left
from jld_core.linalg.factors import columns_of_factor

# Pivot of an equation over the largest below which it depends on others; independent ones have 1e-4 and more
_DEPENDENT = 1e-7
_SMALL = 1e-10  # added to the diagonal where dependent equations are looked for


@dataclass(frozen=True)
class ConeSizes:
    """Numbers of cones of a program, in the order of its rows.

    Attributes
    ----------
    zero, linear : int
        Equations, and inequalities s ≥ 0.
    threes, fours : int
        Second-order cones of 3 and of 4 rows.
    tensors : int
        Cones of 6 rows: positive semidefinite tensors as vectors (see `forms.tensors`).
    """

    zero: int
    linear: int
    threes: int
    fours: int = 0
    tensors: int = 0


@dataclass(frozen=True)
class Factor:
    """Pattern of the factor L D Lᵀ of the reduced system of N unknowns: variables, then equations."""

    rank: Ints  # (N,) position in the order of elimination of each variable, then of each equation
    # start, row: (N + 1,) rows of L below the diagonal, column by column
    start: Ints
    row: Ints
    # left_start, left_column, left_entry: (N + 1,) entries of each row of L: their columns, and their numbers among the
    # entries of all columns
    left_start: Ints
    left_column: Ints
    left_entry: Ints


@dataclass(frozen=True)
class Terms:
    """Entries (e,) of the reduced system as sums over weights of rows."""

    fixed: Floats  # (e,) part without weights: diagonal entries, then those of `Factor.row`
    start: Ints  # (e + 1,) first term of each entry
    weight: Ints  # (t,) weights: those of linear rows, then six of each cone, its upper triangle row by row
    coefficient: Floats  # (t,)


def independent_rows(matrix: sp.csr_array) -> Bools:
    """Return a mask (rows,) of independent rows that span all rows."""
    square = sp.csc_matrix(matrix @ matrix.T)
    size = float(square.diagonal().max())
    square = sp.csc_matrix(square + _SMALL * size * sp.eye_array(square.shape[0]))
    factor = splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    pivots = np.asarray(factor.U.diagonal())[factor.perm_c]
    return np.asarray(abs(pivots) > _DEPENDENT * size)


def symbolic_factor(matrix: sp.csr_array, sizes: ConeSizes) -> Factor:
    """Find the pattern of the factor of the reduced system of a program with rows `matrix`."""
    equations, width = sizes.zero, matrix.shape[1]
    hessian = _hessian_pattern(matrix, sizes)
    constrained = np.flatnonzero(hessian.diagonal() > 0)  # variables in a linear row or cone
    unconstrained = np.flatnonzero(hessian.diagonal() == 0)
    rank = np.empty(width + equations, dtype=np.int64)
    rank[constrained] = _minimum_degree(sp.csr_array(hessian[constrained][:, constrained]))
    if equations:
        # variables that are connected fill each other
        count, group = connected_components(hessian[constrained][:, constrained], directed=False)
        n = len(constrained)
        membership = sp.csr_array((np.ones(n), (np.arange(n), group)), shape=(n, count))
        touched = abs(sp.csr_array(matrix[:equations][:, constrained])) @ membership
        rank[width:] = len(constrained) + _minimum_degree(sp.csr_array(touched @ touched.T))
    # their pivot is 0 until the equations are eliminated, so they come last
    rank[unconstrained] = len(constrained) + equations + np.arange(len(unconstrained))
    hessian_entries, equation_entries = sp.coo_array(hessian), sp.coo_array(sp.csr_array(matrix[:equations]))
    row = rank[np.concatenate([hessian_entries.coords[0], width + equation_entries.coords[0]])]
    column = rank[np.concatenate([hessian_entries.coords[1], equation_entries.coords[1]])]
    return _factor_by_columns(rank, columns_of_factor(row, column, len(rank)))


def _hessian_pattern(matrix: sp.csr_array, sizes: ConeSizes) -> sp.csr_array:
    """Return a matrix (n, n) with entries where variables share a linear row or a cone."""
    equations, linear, cones = sizes.zero, sizes.linear, sizes.threes
    group = np.concatenate([np.arange(linear), linear + np.repeat(np.arange(cones), 3)])
    rows = len(group)
    membership = sp.csr_array((np.ones(rows), (group, np.arange(rows))), shape=(linear + cones, rows))
    pattern = sp.csr_array(matrix[equations:]).copy()
    pattern.data = (pattern.data != 0.0).astype(float)
    shared = membership @ pattern
    return sp.csr_array(shared.T @ shared)


def _minimum_degree(pattern: sp.csr_array) -> Ints:
    """Return the position (k,) of each unknown in a minimum-degree elimination order."""
    negative = pattern.copy()
    negative.data = np.full(len(negative.data), -1.0)
    dominant = sp.csc_matrix(negative + (2.0 + np.diff(pattern.indptr).max(initial=0)) * sp.eye_array(pattern.shape[0]))
    factor = splu(dominant, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factor.perm_c, dtype=np.int64)


def _factor_by_columns(rank: Ints, columns: list[list[int]]) -> Factor:
    """Lay out a factor by columns and by rows, from the rows of each column."""
    count = len(rank)
    start = np.concatenate([[0], np.cumsum([len(rows) for rows in columns])]).astype(np.int64)
    row = np.array([r for rows in columns for r in rows], dtype=np.int64)
    column = np.repeat(np.arange(count), np.diff(start))
    order = np.lexsort((column, row))
    left_start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))]).astype(np.int64)
    return Factor(rank, start, row, left_start, column[order], order)


def terms_of(factor: Factor, matrix: sp.csr_array, sizes: ConeSizes) -> Terms:
    """Compute the entries of the reduced system as sums over weights of rows."""
    equations, linear, cones = sizes.zero, sizes.linear, sizes.threes
    width, count = matrix.shape[1], len(factor.rank)
    # entries on the diagonal, then those below it, found again by their key: column · N + row
    column = np.repeat(np.arange(count), np.diff(factor.start))
    keys = np.concatenate([np.arange(count) * (count + 1), column * count + factor.row])
    order = np.argsort(keys)

    def entry(a: Ints, b: Ints) -> Ints:
        key = np.minimum(a, b) * count + np.maximum(a, b)
        return np.asarray(order[np.searchsorted(keys[order], key)])

    fixed = np.zeros(len(keys))
    equation_entries = sp.coo_array(sp.csr_array(matrix[:equations]))
    position = entry(factor.rank[width + equation_entries.coords[0]], factor.rank[equation_entries.coords[1]])
    fixed[position] = equation_entries.data
    linear_rows = equations + np.arange(linear)
    products = [_products(matrix, linear_rows, linear_rows, np.arange(linear))]
    head = equations + linear + 3 * np.arange(cones)
    for entry_number, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        weight = linear + 6 * np.arange(cones) + entry_number
        products.append(_products(matrix, head + i, head + j, weight))
        if i != j:
            products.append(_products(matrix, head + j, head + i, weight))
    a, b, weight, product = (np.concatenate(parts) for parts in zip(*products, strict=True))
    # the matrix is symmetric: one half of it
    lower_half = factor.rank[a] >= factor.rank[b]
    a, b, weight, product = a[lower_half], b[lower_half], weight[lower_half], product[lower_half]
    shape = (len(keys), linear + 6 * cones)
    sums = sp.csr_array((product, (entry(factor.rank[a], factor.rank[b]), weight)), shape=shape)
    sums.sum_duplicates()
    return Terms(fixed, sums.indptr.astype(np.int64), sums.indices.astype(np.int64), sums.data)


def _products(matrix: sp.csr_array, rows: Ints, partners: Ints, weight: Ints) -> tuple[Ints, Ints, Ints, Floats]:
    """Multiply all pairs of entries of rows[k] and others[k]: both columns, number of the weight, product."""
    start, length = matrix.indptr, np.diff(matrix.indptr)
    count = length[rows] * length[partners]
    pair = np.repeat(np.arange(len(rows)), count)
    # number of each product within its pair of rows, which counts the entries of the second row fastest
    number = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    first = start[rows[pair]] + number // length[partners][pair]
    second = start[partners[pair]] + number % length[partners][pair]
    return matrix.indices[first], matrix.indices[second], weight[pair], matrix.data[first] * matrix.data[second]


STATUS: Final = {  # names of `JldConeState`, those of Clarabel; "Open" is a program without result
    code: {"OPEN": "Open", "SOLVED": "Solved", "INFEASIBLE": "PrimalInfeasible", "UNBOUNDED": "DualInfeasible"}[
        name.removeprefix("CONES_")
    ]
    for name, code in interface.codes("JldConeState").items()
}


@dataclass(frozen=True)
class Regularisation:
    """Regularisation of the interior-point method's systems, for numbers of order one."""

    regular: float = 1e-8  # added to every pivot with its sign
    # least_pivot, new_pivot: pivots below the first are replaced by the second
    least_pivot: float = 1e-13
    new_pivot: float = 2e-7
    # added to the squared scaling of cones, whose small eigenvalues rounding would eat. Of 64 upper bounds of the
    # flagship 1e-12 leaves four open, 1e-8 none.
    bound: float = 1e-8
    refined: float = 1e-3  # complementarity below which solutions are refined; above it refinement changes nothing


@dataclass(frozen=True)
class Stopping:
    # gap, residual: absolute or relative duality gap, and relative residual, at which a program counts as solved
    gap: float = 1e-9
    residual: float = 1e-9
    ray: float = 1e-8  # relative residual of a ray that shows a program to be infeasible or unbounded
    share: float = 0.99  # share that is taken of the longest step to the boundary of the cones
    least_step: float = 1e-4  # step below which iterations end without result
    iterations: int = 60  # largest number of iterations


@dataclass(frozen=True)
class ConeAnswers:
    """Unproven answers to k programs."""

    status: list[str]  # (k,) values of `STATUS`
    iterations: Ints  # (k,)
    point: Floats  # (k, n) variables, or a ray
    dual: Floats  # (k, m) multipliers
    objective: Floats  # (k,) values


class ConeBatch:
    """Compiled solver of cone programs that differ in costs and in rows that are switched off.

    Rows of A (m, n): equations, which are never off, inequalities, cones of three. idle: (m,) right-hand sides of rows
    that are off. ValueError: no compiled solver, see `is_installed`.
    """

    def __init__(self, matrix: sp.csr_array, rhs: Floats, idle: Floats, sizes: ConeSizes) -> None:
        variant = chosen()
        if variant is None:
            raise ValueError("no compiled solver is installed; test is_installed()")
        self._library = library(variant)
        rows, equations = sp.csr_array(matrix), sizes.zero
        independent = np.ones(len(rhs), dtype=bool)
        if equations > 1:
            # around nodes equations of equilibrium depend on each other
            independent[:equations] = independent_rows(sp.csr_array(rows[:equations]))
        self._independent, self._rows, self._width = np.flatnonzero(independent), len(rhs), rows.shape[1]
        independent_matrix = sp.csr_array(rows[self._independent])
        independent_matrix.eliminate_zeros()
        independent_matrix.sort_indices()
        sizes = replace(sizes, zero=int(independent[:equations].sum()))
        self._arrays = _arrays(independent_matrix, sizes, rhs[self._independent], idle[self._independent])
        numbers = {"columns": self._width, "equations": sizes.zero, "linear": sizes.linear, "cones": sizes.threes}
        self._problem = Cones(**numbers, **asdict(Regularisation()), **pointers(**self._arrays))

    def solve(self, off: Bits, objective: Floats) -> ConeAnswers:
        """Solve k programs with rows `off` (k, m) and costs (k, n), each alone to the last digit."""
        k = len(off)
        state, iterations = np.zeros(k, dtype=np.int32), np.zeros(k, dtype=np.int32)
        point, dual, value = np.zeros((k, self._width)), np.zeros((k, len(self._independent))), np.zeros(k)
        # numpy keeps these arrays while the call runs
        arrays = {
            "off": np.ascontiguousarray(off[:, self._independent], dtype=np.uint8),
            "objective": np.ascontiguousarray(objective, dtype=float),
            "x": point,
            "z": dual,
            "value": value,
            "state": state,
            "used": iterations,
        }
        task = ConeTask(count=k, **asdict(Stopping()), **pointers(**arrays))
        require_success(self._library.jld_solve_cones(ctypes.byref(self._problem), ctypes.byref(task)))
        # equations that were left out have multiplier 0
        multipliers = np.zeros((k, self._rows))
        multipliers[:, self._independent] = dual
        status = [STATUS[int(code)] for code in state]
        return ConeAnswers(status, iterations.astype(np.int64), point, multipliers, value)


def is_installed() -> bool:
    """Return True if there is a compiled solver for this processor; JLD_KERNEL=off hides it."""
    return chosen() is not None


def _arrays(matrix: sp.csr_array, sizes: ConeSizes, rhs: Floats, idle: Floats) -> dict[str, Any]:
    """Compute the arrays of `JldCones` by name, with the factor pattern; see `ConeBatch`."""
    factor = symbolic_factor(matrix, sizes)
    terms = terms_of(factor, matrix, sizes)
    sign = np.ones(len(factor.rank))
    sign[factor.rank[matrix.shape[1] :]] = -1.0
    return {
        "row_start": matrix.indptr.astype(np.int64),
        "column": matrix.indices.astype(np.int32),
        "value": np.ascontiguousarray(matrix.data),
        "rhs": np.ascontiguousarray(rhs),
        "idle": np.ascontiguousarray(idle),
        "place": factor.rank.astype(np.int32),
        "factor_start": factor.start,
        "factor_row": factor.row.astype(np.int32),
        "left_start": factor.left_start,
        "left_column": factor.left_column.astype(np.int32),
        "left_place": factor.left_entry.astype(np.int64),
        "sign": sign,
        "fixed": terms.fixed,
        "term_start": terms.start,
        "term": terms.weight.astype(np.int32),
        "coefficient": np.ascontiguousarray(terms.coefficient),
    }


_RESIDUAL = 1e-9  # residuals and duality gap that the solver is asked to reach, absolute and relative

# Statuses after which a second attempt with iterative refinement would change nothing
_ENDED = ("Solved", "PrimalInfeasible", "DualInfeasible")
_NEAR = 1e-7  # largest residual or relative gap at which an answer of status AlmostSolved needs no second attempt


@dataclass
class Rows:
    """Rows of a cone program A x + s = b under construction, one array per part; duplicates are summed."""

    count: int = 0
    row: list[Ints] = field(default_factory=list)
    column: list[Ints] = field(default_factory=list)
    value: list[Floats] = field(default_factory=list)
    rhs: list[Floats] = field(default_factory=list)

    def add(self, entries: Sequence[tuple[Ints, Floats | float]], rhs: Floats | float, count: int) -> Ints:
        """Append `count` rows of (columns, values), (count,) or (count, j), and return their numbers."""
        numbers = self.count + np.arange(count)
        if not count:
            return numbers
        for columns, values in entries:
            by_row = np.asarray(columns).reshape(count, -1)
            self.row.append(np.repeat(numbers, by_row.shape[1]))
            self.column.append(by_row.ravel())
            self.value.append(np.broadcast_to(values, np.shape(columns)).reshape(-1).astype(float))
        self.rhs.append(np.broadcast_to(np.asarray(rhs, dtype=float), (count,)).copy())
        self.count += count
        return numbers

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
    """Unproven answer of the solver to one cone program."""

    point: Floats  # (columns,) variables
    dual: Floats  # (rows,) multipliers
    objective: float  # value of the objective
    usable: bool  # True where the point is worth repairing; False where the program was infeasible, unbounded or failed
    status: str  # name of the status by the solver


class ConeProgram:
    """Cone program: minimise q x where A x + s = b and s lies in a product of cones.

    The solver is set up once, for programs that differ in few rows. Rows that are switched off get zero coefficients
    and a right-hand side inside their cone, so the sparsity never changes.

    Parameters
    ----------
    objective : (columns,) array
        q.
    matrix : (rows, columns) sparse array
        A.
    rhs : (rows,) array
        b.
    sizes : ConeSizes
        Equations, inequalities and second-order cones of 3 rows; no others.
    many : bool
        Hundreds of programs are solved: by `ConeBatch`, which takes its time to set up, and by Clarabel where that
        leaves them open or is not installed.
    """

    def __init__(
        self, objective: Floats, matrix: sp.csr_array, rhs: Floats, sizes: ConeSizes, many: bool = False
    ) -> None:
        self._objective, self._rhs, self._sizes, self._many = objective, rhs, sizes, many
        self._matrix = sp.csc_matrix(matrix)
        self._matrix.sort_indices()
        self._row = self._matrix.indices.copy()
        self._data = self._matrix.data.copy()
        self._cones = _clarabel_cones(sizes)
        # right-hand sides of rows that are off, inside of their cones: 1, and 0 in the tails of cones
        self._idle = np.ones(len(rhs))
        rows_of_cones = sizes.zero + sizes.linear + np.arange(3 * sizes.threes).reshape(-1, 3)
        self._idle[rows_of_cones[:, 1:]] = 0.0
        self._solvers: dict[bool, Any] = {}
        self._batch: ConeBatch | None = None

    def solve(self, off: Bools | None = None, objective: Floats | None = None) -> Answer:
        """Solve with rows `off` (rows,), cones whole, or another q; give each argument at every call, or at none.

        A failure shows in `Answer.usable` alone.
        """
        # Refined iteratively only in a second attempt, where the first did not converge: it costs a third of the time.
        if self._many and off is not None:
            return self.solve_all(off[None], None if objective is None else objective[None])[0]
        return self._by_clarabel(off, objective)

    def solve_all(self, off: Bools, objective: Floats | None = None) -> list[Answer]:
        """Solve k programs, `off` (k, rows), costs (k, columns), each independent of the others."""
        costs = None if objective is None else list(objective)
        if not (self._many and is_installed()):
            return [self._by_clarabel(rows, None if costs is None else costs[k]) for k, rows in enumerate(off)]
        if self._batch is None:
            self._batch = ConeBatch(sp.csr_array(self._matrix), self._rhs, self._idle, self._sizes)
        unchanged = np.broadcast_to(self._objective, (len(off), len(self._objective)))
        batch, answers = self._batch.solve(off, unchanged if objective is None else objective), list[Answer]()
        for k, status in enumerate(batch.status):
            if status == "Open":
                answers.append(self._by_clarabel(off[k], None if costs is None else costs[k]))
            else:
                value = float(batch.objective[k])
                answers.append(Answer(batch.point[k], batch.dual[k], value, status == "Solved", status))
        return answers

    def _by_clarabel(self, off: Bools | None, objective: Floats | None) -> Answer:
        """Solve by Clarabel, a second time with refined linear systems where it did not converge."""
        answer = self._solve(off, objective, careful=False)
        ended = time_left() <= 0.0 or answer.status in _ENDED
        if ended or (answer.status == "AlmostSolved" and self._residual(False) <= _NEAR):
            return answer
        return self._solve(off, objective, careful=True)

    def _residual(self, careful: bool) -> float:
        """Return the larger of primal residual and relative duality gap of a solver's last answer."""
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
            settings = _settings(
                iterative_refinement_enable=careful, tol_gap_abs=_RESIDUAL, tol_gap_rel=_RESIDUAL, tol_feas=_RESIDUAL
            )
            self._solvers[careful] = clarabel.DefaultSolver(
                sp.csc_matrix((width, width)), self._objective, matrix, self._rhs, self._cones, settings
            )
        solver = self._solvers[careful]
        if off is not None:
            solver.update(A=data, b=rhs)
        if objective is not None:
            solver.update(q=objective)
        if time_left() < np.inf:
            solver.set_termination_callback(lambda info: time_left() <= 0.0)
        else:
            solver.unset_termination_callback()
        answer = solver.solve()
        status = str(answer.status)
        usable = status in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations")
        return Answer(np.array(answer.x), np.array(answer.z), float(answer.obj_val), usable, status)


def _clarabel_cones(sizes: ConeSizes) -> list[Any]:
    cones: list[Any] = [clarabel.ZeroConeT(sizes.zero), clarabel.NonnegativeConeT(sizes.linear)]
    cones += [clarabel.SecondOrderConeT(3)] * sizes.threes
    cones += [clarabel.SecondOrderConeT(4)] * sizes.fours
    return cones + [clarabel.PSDTriangleConeT(3)] * sizes.tensors


def _settings(**choices: Any) -> Any:
    """Return settings of Clarabel: silent, one thread, the program as given, and what is chosen."""
    settings = clarabel.DefaultSettings()
    as_given = dict.fromkeys(("presolve_enable", "input_sparse_dropzeros", "chordal_decomposition_enable"), False)
    for name, value in {"verbose": False, "max_threads": 1, **as_given, **choices}.items():
        setattr(settings, name, value)
    return settings


_FEASIBILITY = 1e-9  # residual that the solver is asked for: below the margins to flow rules and yield in its programs
_GAP = 1e-5  # relative duality gap that the solver is asked for: far below the relative gap of two meshes
_MOST_STEPS = 100  # largest number of iterations of the interior-point method

# Regularisation of the solver's linear systems. With its default 1e-8 it fails half way, because rows of equilibrium
# depend on each other around edges.
_ROUGH_REGULAR = 1e-7


def solve_cones(objective: Floats, matrix: sp.csr_array, rhs: Floats, sizes: ConeSizes) -> Answer:
    """Minimise q x where A x + s = b and s lies in cones, until an enforced deadline; the answer is not verified."""
    width, seconds_left = len(objective), time_left()
    if seconds_left <= 0.0:
        return Answer(np.zeros(width), np.zeros(len(rhs)), np.nan, False, "MaxTime")
    settings = _settings(
        input_sparse_dropzeros=True,
        **({"time_limit": seconds_left} if seconds_left < np.inf else {}),
        max_iter=_MOST_STEPS,
        direct_solve_method="qdldl",
        static_regularization_constant=_ROUGH_REGULAR,
        tol_feas=_FEASIBILITY,
        tol_gap_abs=_GAP,
        tol_gap_rel=_GAP,
    )
    solver: Any = clarabel.DefaultSolver(
        sp.csc_matrix((width, width)), objective, sp.csc_matrix(matrix), rhs, _clarabel_cones(sizes), settings
    )
    answer = solver.solve()
    status = str(answer.status)
    usable = status in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations", "NumericalError")
    point = np.array(answer.x)
    usable = usable and bool(np.isfinite(point).all())
    return Answer(point, np.array(answer.z), float(answer.obj_val), usable, status)
