"""A solver that cannot be believed, for proofs that must not need it to be."""

from __future__ import annotations

import numpy as np

from jld_core import LimitAnalysis
from jld_core.arrays import Bits
from jld_core.limit import Proof
from jld_core.limit.proof_attempt import ProofAttempt
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, RawSolution, Solver


class Noisy(Solver):
    """A route that spoils the answer of another."""

    name = "noisy"

    def __init__(self, level: float, seed: int) -> None:
        self._route, self._level, self._rng = ClarabelSolver(), level, np.random.default_rng(seed)

    def solve(self, program: ConicProgram) -> RawSolution:
        raw = self._route.solve(program)
        spoil = [v * (1.0 + self._level * self._rng.standard_normal(len(v))) for v in (raw.point, raw.dual)]
        spoil = [v + self._level * self._rng.standard_normal(len(v)) for v in spoil]
        return RawSolution(raw.status, spoil[0], spoil[1], raw.iterations, raw.seconds)


def noisy(analysis: LimitAnalysis, labels: Bits, level: float, seed: int) -> Proof:
    """What is proven of a labelling by a spoilt answer and its repair."""
    attempt = ProofAttempt(analysis, labels)
    attempt.solve_by(Noisy(level, seed), analysis.margin)
    attempt.repair_answer()
    return attempt.proof
