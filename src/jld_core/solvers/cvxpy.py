"""CVXPY: a slow reference solver, for comparison."""

from __future__ import annotations

import time
import warnings
from typing import Any

import cvxpy as cp
import numpy as np

from jld_core.program import ConicProgram
from jld_core.solvers.base import RawSolution, RawStatus, Solver

# Status for each status that CVXPY reports; others count as failed
_STATUS = {
    "optimal": RawStatus.OPTIMAL,
    "optimal_inaccurate": RawStatus.ALMOST,
    "infeasible": RawStatus.INFEASIBLE,
    "infeasible_inaccurate": RawStatus.INFEASIBLE,
    "unbounded": RawStatus.UNBOUNDED,
    "unbounded_inaccurate": RawStatus.UNBOUNDED,
    "user_limit": RawStatus.LIMIT,
}


class CvxpySolver(Solver):
    """Reference solver that states each program anew in CVXPY.

    solver, **options: the solver that CVXPY calls, and its settings; default: tolerances of 1e-11 for CLARABEL.
    """

    name = "cvxpy"

    def __init__(self, solver: str = "CLARABEL", **options: float) -> None:
        self._solver = solver
        tight = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}
        self._options = options or (tight if solver == "CLARABEL" else {})

    def solve(self, program: ConicProgram) -> RawSolution:
        """Solve a program; point and dual are zero where CVXPY gives none."""
        start = time.perf_counter()
        structure = program.structure
        matrix: Any = program.matrix.tocsr()  # CVXPY's operators have no types
        y = cp.Variable(structure.shape[1])
        first_cone = structure.equalities + structure.linear
        constraints = [
            matrix[: structure.equalities] @ y == program.rhs[: structure.equalities],
            matrix[structure.equalities : first_cone] @ y <= program.rhs[structure.equalities : first_cone],
        ]
        for first, size in zip(structure.heads, structure.cones, strict=True):
            slacks = program.rhs[first : first + size] - matrix[first : first + size] @ y
            constraints.append(cp.SOC(slacks[0], slacks[1:]))
        problem: Any = cp.Problem(cp.Minimize(program.objective @ y), constraints)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate solution shows in the proven bounds
            problem.solve(solver=self._solver, **self._options)
        status = _STATUS.get(problem.status, RawStatus.FAILED)
        point = np.zeros(structure.shape[1]) if y.value is None else np.array(y.value)
        duals = []
        for constraint in constraints:
            value = constraint.dual_value
            parts = value if isinstance(value, list) else [np.zeros(constraint.size) if value is None else value]
            duals.append(np.concatenate([np.ravel(part) for part in parts]))
        iterations = int(problem.solver_stats.num_iters or 0) if problem.solver_stats else 0
        return RawSolution(status, point, np.concatenate(duals), iterations, time.perf_counter() - start)
