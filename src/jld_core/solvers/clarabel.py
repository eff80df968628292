"""Clarabel, set up once per structure and updated with new numbers, with an optional proximal term."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.program import ConicProgram
from jld_core.program.template import Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver

# Status for each status that Clarabel reports; others count as failed
_STATUS = {
    "Solved": RawStatus.OPTIMAL,
    "AlmostSolved": RawStatus.ALMOST,
    "PrimalInfeasible": RawStatus.INFEASIBLE,
    "AlmostPrimalInfeasible": RawStatus.INFEASIBLE,
    "DualInfeasible": RawStatus.UNBOUNDED,
    "AlmostDualInfeasible": RawStatus.UNBOUNDED,
    "MaxIterations": RawStatus.LIMIT,
    "MaxTime": RawStatus.LIMIT,
}


class ClarabelSolver(Solver):
    """Clarabel's interior-point method on the program as given.

    The equilibration computed in a set-up stays in use under updates. `prepare` therefore sets up on the reference
    program of a structure, so that solutions do not depend on the programs solved before.

    Parameters
    ----------
    tolerance : float, optional
        Residual and gap to reach; None: the precision of the kind of program.
    threads : int
        Largest number of threads.
    proximal : (int, float), optional
        (count, ε > 0) adds (ε/2)‖F − F₀‖² to the objective, where F is the first `count` columns, of order one. The
        term selects one of many solutions.
    **options
        Further settings of Clarabel.

    Attributes
    ----------
    updates, rebuilds : int
        Number of solves that updated the numbers, and number of set-ups.

    Raises
    ------
    AttributeError
        Clarabel has no setting of a name in `options`.
    """

    name = "clarabel"

    def __init__(
        self,
        tolerance: float | None = None,
        threads: int = 1,
        proximal: tuple[int, float] | None = None,
        **options: Any,
    ) -> None:
        self._tolerance, self._proximal = tolerance, proximal
        self._settings = clarabel.DefaultSettings()
        choices = {
            "verbose": False,
            "max_threads": threads,
            # `update` requires that Clarabel keeps the program as given.
            "presolve_enable": False,
            "input_sparse_dropzeros": False,
            "chordal_decomposition_enable": False,
            # Without iterative refinement solves take two thirds of the time, measured on every kind of scene. As many
            # solutions can be proven, because the projection removes the residual exactly.
            "iterative_refinement_enable": proximal is not None,
            **options,
        }
        for key, value in choices.items():
            if not hasattr(self._settings, key):
                raise AttributeError(f"clarabel has no setting {key!r}")
            setattr(self._settings, key, value)
        self._structure: Structure | None = None
        self._solver: Any = None
        self.updates = self.rebuilds = 0

    def prepare(self, structure: Structure, reference: Callable[[], ConicProgram]) -> None:
        """Set up the solver on the reference program of a structure, if that structure is new."""
        if self._structure is not structure:
            program = reference().rounded
            self._set_up(program, program.objective)

    def solve(self, program: ConicProgram, centre: Floats | None = None) -> RawSolution:
        """Solve a program, with a proximal term about F₀, ε(F − F₀), if `centre` (count,) is given."""
        start = time.perf_counter()
        program = program.rounded
        objective = program.objective
        if self._proximal is not None and centre is not None:
            count, weight = self._proximal
            objective = objective.copy()
            objective[:count] -= weight * centre
        if self._structure is program.structure:
            self._solver.update(A=program.data, b=program.rhs, q=objective)
            self.updates += 1
        else:
            self._set_up(program, objective)
        return _raw_solution(self._solver.solve(), start)

    def _set_up(self, program: ConicProgram, objective: Floats) -> None:
        """Make a new Clarabel instance for the structure of a program, with this objective."""
        self.rebuilds += 1
        structure = program.structure
        defaults = tolerances.CRUSHING if structure.cones else tolerances.LINEAR
        tolerance = self._tolerance or defaults.residual
        for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            setattr(self._settings, key, tolerance)
        count, weight = self._proximal or (0, 0.0)
        column = np.arange(count)
        quadratic = sp.csc_matrix(
            (np.full(count, weight), (column, column)), shape=(structure.shape[1], structure.shape[1])
        )
        matrix = sp.csc_matrix((program.data, structure.indices, structure.indptr), shape=structure.shape)
        self._solver = clarabel.DefaultSolver(
            quadratic, objective, matrix, program.rhs, _cones(structure), self._settings
        )
        self._structure = structure


def _cones(structure: Structure) -> list[Any]:
    linear = [clarabel.ZeroConeT(structure.equalities), clarabel.NonnegativeConeT(structure.linear)]
    return linear + [clarabel.SecondOrderConeT(size) for size in structure.cones]


def _raw_solution(answer: Any, start: float) -> RawSolution:
    name = str(answer.status)
    return RawSolution(
        status=_STATUS.get(name, RawStatus.FAILED),
        point=np.array(answer.x),
        dual=np.array(answer.z),
        iterations=int(answer.iterations),
        seconds=time.perf_counter() - start,
        note=name,
    )
