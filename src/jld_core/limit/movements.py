"""Movement of every face at collapse for many labellings: a search heuristic, not a proof."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import faces_of
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.reduced_rows import usable
from jld_core.limit.result import LimitAnalysisResult
from jld_core.solvers import make_solver

# Residual requested from the solver where there is no batch solver; a heuristic needs no more digits
_RESIDUAL: Final = 1e-8


class Movements:
    """Movements of all faces at collapse for many labellings: hints for searches, nothing proven."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        self.template, self._prover = analysis.template, analysis.prover
        self._batch = analysis.batch
        self._solver = make_solver("clarabel", tolerance=_RESIDUAL)

    def of(self, labellings: Bits) -> Floats:
        """Compute the jump of each face over the largest, (k, m); zero where no mechanism is found."""
        if self._batch is not None:
            velocities = self._batch.solve(labellings, vectors=True).velocities
        else:
            rows = self.template.matrix.shape[0]
            velocities = np.array([self._solver.solve(self.template.program(row)).dual[:rows] for row in labellings])
        found = np.zeros(labellings.shape)
        for k, velocity in enumerate(velocities):
            if usable(velocity):
                size = abs(self._prover.motion(velocity, labellings[k], normalise=False).jumps).max(axis=1)
                found[k] = size / max(float(size.max()), 1e-300)
        return found


def result_of_faces(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose interfaces, labels and forces are those of faces, not of members."""
    # Figures and tables of faces use it. A result without members is returned as it is.
    assembly = faces_of(result.assembly)
    if assembly is result.assembly:
        return result
    rows = slice(assembly.faces)
    forces, unbounded = (None if one is None else one[rows] for one in (result.forces, result.unbounded_forces))
    return replace(
        result,
        assembly=assembly,
        labels=result.labels[rows],
        forces=forces,
        unbounded_forces=unbounded,
        cases={name: result_of_faces(one) for name, one in result.cases.items()},
    )
