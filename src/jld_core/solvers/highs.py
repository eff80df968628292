"""HiGHS: solver of linear programs by dual simplex, or by an interior-point method with crossover."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from threading import Lock
from typing import Any

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.errors import SolverError
from jld_core.program import ConicProgram
from jld_core.program.template import Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver

# Status for each name of a status that HiGHS reports; others count as failed
_STATUS = {
    "kOptimal": RawStatus.OPTIMAL,
    "kInfeasible": RawStatus.INFEASIBLE,
    "kUnbounded": RawStatus.UNBOUNDED,
    "kUnboundedOrInfeasible": RawStatus.UNBOUNDED,
    "kIterationLimit": RawStatus.LIMIT,
    "kTimeLimit": RawStatus.LIMIT,
}


class HighsSolver(Solver):
    """HiGHS solver for linear programs, independent of Clarabel and schur.

    Every program gets a fresh model, so that solutions do not depend on the programs solved before.

    Parameters
    ----------
    name : str
        "highs" (dual simplex) or "highs-ipm" (interior-point method with crossover).
    threads : int
        Number of threads.
    tolerance : float
        Primal and dual feasibility tolerance, and optimality tolerance of the interior-point method.
    """

    def __init__(self, name: str = "highs", threads: int = 1, tolerance: float = 1e-10) -> None:
        self.name = name
        self._options = {
            "threads": threads,
            "solver": "ipm" if name == "highs-ipm" else "simplex",
            "primal_feasibility_tolerance": tolerance,
            "dual_feasibility_tolerance": tolerance,
            "ipm_optimality_tolerance": tolerance,
            # Presolve would hide the rays that prove `locked` and `unstable`.
            "presolve": "off",
        }

    def require(self, structure: Structure) -> None:
        if structure.cones:
            raise SolverError(f"{self.name} takes linear programs only; this scene needs second-order cones")

    def solve(self, program: ConicProgram) -> RawSolution:
        """Solve a linear program; `point` or `dual` is a ray of an unbounded or infeasible one if HiGHS has one."""
        structure = program.structure
        self.require(structure)
        start = time.perf_counter()
        program = program.rounded
        free = np.full(structure.shape[1], np.inf)
        lower = np.full(structure.shape[0], -np.inf)
        lower[: structure.equalities] = program.rhs[: structure.equalities]
        matrix = sp.csc_array((program.data, structure.indices, structure.indptr), shape=structure.shape)
        highs = highs_of(matrix, program.objective, lower, program.rhs, -free, free, self._options)
        highs.run()
        status = _STATUS.get(highs.getModelStatus().name, RawStatus.FAILED)
        solution = highs.getSolution()
        point = np.array(solution.col_value)
        dual = -np.array(solution.row_dual)
        if status is RawStatus.UNBOUNDED:
            _, has_ray, ray = highs.getPrimalRay()
            point = np.array(ray) if has_ray else point
        elif status is RawStatus.INFEASIBLE:
            _, has_ray, ray = highs.getDualRay()
            # HiGHS' dual ray improves Σ ray·rhs over the rows; a ray in the dual cones must decrease the sum.
            dual = np.array(ray) if has_ray else dual
            if program.rhs @ dual > 0.0:
                dual = -dual
        info = highs.getInfo()
        iterations = int(info.simplex_iteration_count if self.name == "highs" else info.ipm_iteration_count)
        return RawSolution(status, point, dual, max(iterations, 0), time.perf_counter() - start)


def highs_of(
    rows: Any, objective: Floats, low: Floats, high: Floats, least: Floats, most: Floats, options: Mapping[str, Any]
) -> Any:
    """Make a silent, single-threaded HiGHS instance of a linear program, ready to run.

    Parameters
    ----------
    rows : (rows, columns) sparse array
        Matrix R.
    objective : (columns,) array
        Coefficients of the objective.
    low, high : (rows,) array
        Bounds on R x.
    least, most : (columns,) array
        Bounds on x.
    options : Mapping of str to Any
        Options of HiGHS.

    Returns
    -------
    Highs
        Instance; its method `run` solves the program.
    """
    # The program is: minimise objective·x subject to low ≤ R x ≤ high and least ≤ x ≤ most. Bounds may be infinite.
    import highspy  # local imports here and below: most labellings are solved without it

    matrix = sp.csc_array(rows)
    model = highspy.HighsLp()
    model.num_row_, model.num_col_ = matrix.shape
    model.col_cost_ = objective
    model.col_lower_, model.col_upper_ = highs_ends(least), highs_ends(most)
    model.row_lower_, model.row_upper_ = highs_ends(low), highs_ends(high)
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_ = matrix.indptr.astype(np.int32)
    model.a_matrix_.index_ = matrix.indices.astype(np.int32)
    model.a_matrix_.value_ = matrix.data
    highs: Any = _new()
    for key, value in {"output_flag": False, "threads": 1, **options}.items():
        highs.setOptionValue(key, value)
    highs.passModel(model)
    return highs


_GREETING = Lock()
_greeted = False


def _new() -> Any:
    # The first one of a process prints a banner to stdout since version 1.16, whatever `output_flag` says later. It is
    # made while stdout leads nowhere, as that is where results go.
    import highspy

    global _greeted
    with _GREETING:
        if not _greeted:
            _greeted = True
            with suppress(OSError):  # without a stdout there is nothing to keep free
                stdout = os.dup(1)
                devnull = os.open(os.devnull, os.O_WRONLY)
                try:
                    if sys.stdout is not None:
                        sys.stdout.flush()
                    _flush()
                    os.dup2(devnull, 1)
                    highspy.Highs()  # type: ignore[no-untyped-call]
                    _flush()
                finally:
                    os.dup2(stdout, 1)
                    os.close(stdout)
                    os.close(devnull)
    return highspy.Highs()  # type: ignore[no-untyped-call]


def _flush() -> None:
    """Write what the C library holds back for stdout."""
    library = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    library.fflush(None)


def highs_ends(values: Floats) -> Floats:
    """Return bounds with ±inf replaced by the infinity of HiGHS.

    Parameters
    ----------
    values : array
        Bounds.

    Returns
    -------
    array
        Bounds for HiGHS.
    """
    import highspy

    return np.clip(values, -highspy.kHighsInf, highspy.kHighsInf)
