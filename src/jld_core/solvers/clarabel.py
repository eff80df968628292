"""Clarabel called directly, set up once per structure and updated with new numbers; with a proximal term on request."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver

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
    """Interior point on the program as it stands; updates and rebuilds are counted.

    The equilibration that a set-up computes stays in force under updates, so a set-up is always made on the
    first program of a structure that this route is given (a template's reference): answers then do not depend
    on what was solved in between.

    tolerance: residual and gap, None for what the kind of program asks. proximal: (count, ε > 0) adds
    (ε/2)‖F − F₀‖² to what is minimised, F the first `count` columns and of order one: it picks one solution where there
    are many. options: further settings of Clarabel.
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
            # `update` needs the program kept as it was given
            "presolve_enable": False,
            "input_sparse_dropzeros": False,
            "chordal_decomposition_enable": False,
            # measured on every kind of scene: without refining linear systems answers come in two thirds of the
            # time, and are as often fit to be proven; what is left over the projection removes exactly
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
        if self._structure is not structure:
            program = reference()
            self._set_up(program, program.objective)

    def solve(self, program: ConicProgram, centre: Floats | None = None) -> RawSolution:
        """Solve; centre: F₀ (count,) of a proximal term, by default zero. Stationarity then holds up to ε(F − F₀)."""
        start = time.perf_counter()
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
        self.rebuilds += 1
        s = program.structure
        usual = tolerances.CRUSHING if s.cones else tolerances.LINEAR
        tolerance = self._tolerance or usual.residual
        for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            setattr(self._settings, key, tolerance)
        count, weight = self._proximal or (0, 0.0)
        place = np.arange(count)
        quadratic = sp.csc_matrix((np.full(count, weight), (place, place)), shape=(s.shape[1], s.shape[1]))
        matrix = sp.csc_matrix((program.data, s.indices, s.indptr), shape=s.shape)
        self._solver = clarabel.DefaultSolver(quadratic, objective, matrix, program.rhs, _cones(s), self._settings)
        self._structure = s


def _cones(structure: Structure) -> list[Any]:
    """The cones of a structure, in Clarabel's words."""
    linear = [clarabel.ZeroConeT(structure.equalities), clarabel.NonnegativeConeT(structure.linear)]
    return linear + [clarabel.SecondOrderConeT(size) for size in structure.cones]


def _raw_solution(answer: Any, start: float) -> RawSolution:
    """Clarabel's answer in the shape of every route. start: clock reading when the solve began."""
    name = str(answer.status)
    return RawSolution(
        status=_STATUS.get(name, RawStatus.FAILED),
        point=np.array(answer.x),
        dual=np.array(answer.z),
        iterations=int(answer.iterations),
        seconds=time.perf_counter() - start,
        note=name,
    )
