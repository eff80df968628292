"""Conic programs with a proximal term −(ε/2)‖F − F₀‖², which picks one solution where there are many."""

from __future__ import annotations

import time
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import RawSolution
from jld_core.solvers.clarabel import cones_of, raw_solution


class ProximalSolver:
    """Clarabel on min q·y + (ε/2)‖F − F₀‖², F the first `count` columns; set up once per structure.

    count: columns under the proximal term. weight: ε > 0, for scaled forces of order one. tolerance: residual
    and gap.
    """

    name = "clarabel (proximal)"

    def __init__(self, count: int, weight: float, tolerance: float) -> None:
        self._count, self._weight = count, weight
        self._settings = clarabel.DefaultSettings()
        choices = {
            "verbose": False,
            "max_threads": 1,
            # `update` needs the program kept as it was given
            "presolve_enable": False,
            "input_sparse_dropzeros": False,
            "chordal_decomposition_enable": False,
            "tol_gap_abs": tolerance,
            "tol_gap_rel": tolerance,
            "tol_feas": tolerance,
        }
        for key, value in choices.items():
            setattr(self._settings, key, value)
        self._structure: Structure | None = None
        self._solver: Any = None

    def solve(self, program: ConicProgram, centre: Floats) -> RawSolution:
        """Solve near a centre F₀ (count,); multipliers as for any route, up to ε(F − F₀) in stationarity."""
        start = time.perf_counter()
        objective = program.objective.copy()
        objective[: self._count] -= self._weight * centre
        if self._structure is program.structure:
            self._solver.update(A=program.data, b=program.rhs, q=objective)
        else:
            self._set_up(program, objective)
        return raw_solution(self._solver.solve(), start)

    def _set_up(self, program: ConicProgram, objective: Floats) -> None:
        s = program.structure
        place = np.arange(self._count)
        quadratic = sp.csc_matrix((np.full(self._count, self._weight), (place, place)), shape=(s.shape[1], s.shape[1]))
        matrix = sp.csc_matrix((program.data, s.indices, s.indptr), shape=s.shape)
        self._solver = clarabel.DefaultSolver(quadratic, objective, matrix, program.rhs, cones_of(s), self._settings)
        self._structure = s
