"""An interior-point method of our own for large assemblies: Schur complement, sparse Cholesky, numpy alone.

Nesterov–Todd predictor–corrector on the homogeneous self-dual embedding, so that infeasible and unbounded
programs end in a ray; once τ stays and κ vanishes the plain method goes on from there. That meets equations and
stationarity to rounding, and so ends in a point and multipliers that prove themselves.
Source: Vandenberghe, The CVXOPT linear and quadratic cone program solvers (2010), section 7; Domahidi, Chu &
Boyd, ECOS: an SOCP solver for embedded systems, ECC 2013; docs/method.md (8.4).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver
from jld_core.solvers.schur.nesterov_todd import Cones, NesterovTodd
from jld_core.solvers.schur.system import SchurSystem

_SETTLED = 1e-3  # κ/τ below which a program is taken to have a solution, and the embedding is left


@dataclass
class _Iterate:
    """x, u, s, v of the embedding with its scalars τ and κ."""

    x: Floats
    u: Floats
    s: Floats
    v: Floats
    tau: float = 1.0
    kappa: float = 1.0


class SchurSolver(Solver):
    """Schur-complement interior point; the analysis of a structure is kept for the programs that follow.

    tolerance: relative residuals; None leaves it to the kind of program. gap: relative duality gap. most:
    iterations. Takes programs whose columns fall apart into faces, all cones of one size (every template's), and
    raises SolverError for others.
    """

    name = "schur"

    def __init__(self, tolerance: float | None = None, gap: float = 1e-8, most: int = 100) -> None:
        self._tolerance, self._gap, self._most = tolerance, gap, most
        self._structure: Structure | None = None
        self._system: SchurSystem | None = None

    def solve(self, program: ConicProgram) -> RawSolution:
        start = time.perf_counter()
        if self._system is None or self._structure is not program.structure:
            self._system = SchurSystem(program.structure)
            self._structure = program.structure
        self._system.load(program)
        usual = tolerances.FRICTION_CONES if program.structure.cones else tolerances.LINEAR
        run = _Iteration(program, self._system, self._tolerance or usual.residual, self._gap)
        # a run that breaks down says so by numbers that are not finite
        with np.errstate(all="ignore"):
            status, iterate, iterations = run.to_the_end(self._most)
            point, dual = run.answer(status, iterate)
        return RawSolution(status, point, dual, iterations, time.perf_counter() - start, note=run.note)


class _Iteration:
    """One solution process."""

    def __init__(self, program: ConicProgram, system: SchurSystem, tolerance: float, gap: float) -> None:
        edge = program.structure.equalities
        self.system, self.tolerance, self.gap = system, tolerance, gap
        self.cones: Cones = system.blocks.cones
        self.q, self.r, self.h = program.objective, program.rhs[:edge], program.rhs[edge:]
        self.unit = self.cones.unit()
        self.note = ""

    def to_the_end(self, most: int) -> tuple[RawStatus, _Iterate, int]:
        """Iterate to the tolerance, to a ray, or for as long as it helps; the best iterate."""
        try:
            now = self._start()
        except np.linalg.LinAlgError:
            self.note = "singular"
            nothing = _Iterate(np.zeros(len(self.q)), np.zeros(len(self.r)), self.unit.copy(), self.unit.copy())
            return RawStatus.FAILED, nothing, 0
        best, least, stalled = now, np.inf, 0
        for iteration in range(most):
            status, merit = self._judge(now)
            if status is not None:
                return status, now, iteration
            stalled = 0 if merit < 0.9 * least else stalled + 1
            if merit < least:
                best, least = now, merit
            if stalled >= 6 and least < 1e6:
                self.note = "no further progress"
                return RawStatus.ALMOST, best, iteration
            try:
                following = self._advance(now)
            except np.linalg.LinAlgError:
                following = None
            if following is None:
                self.note = "breakdown"
                return RawStatus.ALMOST, best, iteration
            now = following
        return RawStatus.LIMIT, best, most

    def answer(self, status: RawStatus, it: _Iterate) -> tuple[Floats, Floats]:
        """Point and multipliers, or the ray that a status names."""
        dual = np.concatenate([it.u, it.v])
        if status is RawStatus.INFEASIBLE:
            return it.x, dual / -(self.r @ it.u + self.h @ it.v)
        if status is RawStatus.UNBOUNDED:
            return it.x / -(self.q @ it.x), dual
        return it.x / it.tau, dual / it.tau

    def _start(self) -> _Iterate:
        """Least-squares points, shifted into the cones."""
        system, nothing = self.system, np.zeros(len(self.q))
        system.factor(NesterovTodd(self.cones, self.unit, self.unit))
        x, _, minus_s = system.solve(nothing, self.r, self.h)
        _, u, v = system.solve(-self.q, np.zeros(len(self.r)), np.zeros(len(self.h)))
        s = -minus_s
        for vector in (s, v):
            slack = self.cones.slack(vector)
            if slack < 1e-3:
                vector += (1.0 - slack) * self.unit
        return _Iterate(x, u, s, v)

    def _judge(self, it: _Iterate) -> tuple[RawStatus | None, float]:
        """Is this the end, and how far is it?"""
        system, q, r, h = self.system, self.q, self.r, self.h
        gradient = system.transposed(it.u, it.v)
        left_u, left_v = system.equations(it.x), system.yields(it.x) + it.s
        cost, value = float(q @ it.x), float(r @ it.u + h @ it.v)
        primal = max(_largest(left_u - it.tau * r), _largest(left_v - it.tau * h)) / it.tau
        dual = _largest(gradient + it.tau * q) / it.tau
        gap = float(it.s @ it.v) / it.tau**2 / max(1.0, abs(cost / it.tau))
        merit = max(primal / self.tolerance, dual / self.tolerance, gap / self.gap)
        if merit <= 1.0:
            return RawStatus.OPTIMAL, merit
        if it.kappa > it.tau:
            ray = 10.0 * self.tolerance
            if value < 0.0 and _largest(gradient) <= ray * -value:
                return RawStatus.INFEASIBLE, merit
            if cost < 0.0 and max(_largest(left_u), _largest(left_v)) <= ray * -cost:
                return RawStatus.UNBOUNDED, merit
        return None, merit

    def _advance(self, it: _Iterate) -> _Iterate | None:
        """One predictor–corrector step; None where none can be made."""
        system, cones = self.system, self.cones
        scaling = NesterovTodd(cones, it.s, it.v)
        system.factor(scaling)
        lam = scaling.point
        embedded = it.kappa > _SETTLED * it.tau
        if embedded:
            mu = (float(it.s @ it.v) + it.tau * it.kappa) / (cones.degree + 1)
        else:
            mu = float(it.s @ it.v) / cones.degree
        res_x = system.transposed(it.u, it.v) + it.tau * self.q
        res_u = system.equations(it.x) - it.tau * self.r
        res_v = system.yields(it.x) + it.s - it.tau * self.h
        res_t = it.kappa + float(self.q @ it.x + self.r @ it.u + self.h @ it.v)
        if embedded:
            x1, u1, wv1 = system.solve(-self.q, self.r, self.h)
            v1 = scaling.divide(wv1)
            slope = float(self.q @ x1 + self.r @ u1 + self.h @ v1) - it.kappa / it.tau

        def direction(eta: float, ds: Floats, dk: float) -> tuple[Floats, Floats, Floats, Floats, float, float]:
            comp = cones.quotient(lam, ds)
            x2, u2, wv2 = system.solve(-eta * res_x, -eta * res_u, -eta * res_v - scaling.times(comp))
            if not embedded:
                return x2, u2, comp - wv2, wv2, 0.0, 0.0
            v2 = scaling.divide(wv2)
            dt = (-eta * res_t - dk / it.tau - float(self.q @ x2 + self.r @ u2 + self.h @ v2)) / slope
            wv = wv2 + dt * wv1
            # scaled slack and multiplier: W⁻¹ds + W dv = λ \ ds
            return x2 + dt * x1, u2 + dt * u1, comp - wv, wv, dt, (dk - it.kappa * dt) / it.tau

        def longest(ws: Floats, wv: Floats, dt: float, dk: float) -> float:
            alpha = min(cones.step(lam, ws), cones.step(lam, wv))
            for value, change in ((it.tau, dt), (it.kappa, dk)):
                if change < 0.0:
                    alpha = min(alpha, -value / change)
            return alpha

        square = cones.product(lam, lam)
        _, _, ws, wv, dt, dk = direction(1.0, -square, -it.tau * it.kappa)
        alpha = min(1.0, longest(ws, wv, dt, dk))
        sigma = min(1.0, max(1e-6, (1.0 - alpha) ** 3))
        corrector = -square - cones.product(ws, wv) + sigma * mu * self.unit
        dx, du, ws, wv, dt, dk = direction(
            1.0 - sigma if embedded else 1.0, corrector, -it.tau * it.kappa - dk * dt + sigma * mu
        )
        alpha = min(1.0, 0.99 * longest(ws, wv, dt, dk))
        if not (np.isfinite(alpha) and alpha > 1e-8 and np.all(np.isfinite(dx))):
            return None
        s, v = it.s + alpha * scaling.times(ws), it.v + alpha * scaling.divide(wv)
        if cones.slack(s) <= 0.0 or cones.slack(v) <= 0.0:
            return None
        # a run that breaks down may leave nothing of τ, and a division by it must say so as numpy's do
        tau = np.float64(it.tau + alpha * dt)
        made = _Iterate(it.x + alpha * dx, it.u + alpha * du, s, v, tau, np.float64(it.kappa + alpha * dk))
        size = 1.0 / max(made.tau, made.kappa)
        return _Iterate(made.x * size, made.u * size, made.s * size, made.v * size, made.tau * size, made.kappa * size)


def _largest(vector: Floats) -> float:
    return float(abs(vector).max(initial=0.0))
