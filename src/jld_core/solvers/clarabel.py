"""Clarabel called directly, set up once per structure and updated with new numbers."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
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
    """

    name = "clarabel"

    def __init__(self, tolerance: float | None = None, threads: int = 1, **options: Any) -> None:
        self._tolerance = tolerance
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
            "iterative_refinement_enable": False,
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
            self._set_up(reference())

    def solve(self, program: ConicProgram) -> RawSolution:
        start = time.perf_counter()
        if self._structure is program.structure:
            self._solver.update(A=program.data, b=program.rhs, q=program.objective)
            self.updates += 1
        else:
            self._set_up(program)
        return raw_solution(self._solver.solve(), start)

    def _set_up(self, program: ConicProgram) -> None:
        self.rebuilds += 1
        s = program.structure
        usual = tolerances.CRUSHING if s.cones else tolerances.LINEAR
        tolerance = self._tolerance or usual.residual
        for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            setattr(self._settings, key, tolerance)
        nothing = sp.csc_matrix((s.shape[1], s.shape[1]))
        matrix = sp.csc_matrix((program.data, s.indices, s.indptr), shape=s.shape)
        self._solver = clarabel.DefaultSolver(
            nothing, program.objective, matrix, program.rhs, cones_of(s), self._settings
        )
        self._structure = s


def cones_of(structure: Structure) -> list[Any]:
    """The cones of a structure, in Clarabel's words."""
    linear = [clarabel.ZeroConeT(structure.equalities), clarabel.NonnegativeConeT(structure.linear)]
    return linear + [clarabel.SecondOrderConeT(size) for size in structure.cones]


def raw_solution(answer: Any, start: float) -> RawSolution:
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
