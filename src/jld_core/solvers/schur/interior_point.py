"""Schur-complement interior-point method for large assemblies, with sparse Cholesky.

The method is the Nesterov–Todd predictor–corrector on the homogeneous self-dual embedding, so that infeasible and
unbounded programs end in a ray. Once τ is stable and κ vanishes, the iterations continue without the embedding. They
then meet equations and stationarity to rounding, so that point and multipliers can be proven directly.
Source: Vandenberghe, The CVXOPT linear and quadratic cone program solvers (2010), section 7; Domahidi, Chu & Boyd,
ECOS: an SOCP solver for embedded systems, ECC 2013; docs/method.md (8.4).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import EARLY, RawSolution, RawStatus, Solver, Suffices
from jld_core.solvers.schur.block_equations import BlockEquations
from jld_core.solvers.schur.nesterov_todd import Cones, NesterovTodd
from jld_core.solvers.schur.system import SchurSystem

_SETTLED = 1e-3  # κ/τ below which the program counts as solvable and iterations leave the embedding


@dataclass
class _Iterate:
    """Iterate of the homogeneous self-dual embedding of a program.

    x: values of the columns. u: multipliers of the equations. s, v: slacks and multipliers of the yield rows. tau,
    kappa: the scalars τ and κ of the embedding.
    """

    x: Floats
    u: Floats
    s: Floats
    v: Floats
    tau: float = 1.0
    kappa: float = 1.0


class SchurSolver(Solver):
    """Schur-complement interior-point solver for large assemblies.

    The analysis of a structure is kept for later programs. Columns of a program must separate into faces, and its cones
    must have one size, as in every template. `solve` raises SolverError for other programs.

    Parameters
    ----------
    tolerance : float, optional
        Relative residuals to reach; None: the precision of the kind of program.
    gap : float
        Relative duality gap to reach.
    most : int
        Largest number of iterations.
    """

    name = "schur"

    def __init__(self, tolerance: float | None = None, gap: float = 1e-8, most: int = 100) -> None:
        self._tolerance, self._gap, self._most = tolerance, gap, most
        self._structure: Structure | None = None
        self._system: SchurSystem | None = None
        self._equations: BlockEquations | None = None

    def solve(self, program: ConicProgram) -> RawSolution:
        """Solve a program by the Schur-complement interior-point method.

        The structure is analysed if it is not that of the previous program. The status is FAILED where the iterations
        break down. Raises SolverError for a structure that does not separate into faces, or cones of several sizes.
        """
        return self.solve_until(program, None)

    def solve_until(self, program: ConicProgram, suffices: Suffices | None) -> RawSolution:
        """Solve a program, or stop at the first iterate that suffices; see `Solver.solve_until`.

        An iterate is offered once its relative duality gap is at most `EARLY`. The structure is analysed if it is new.
        Raises SolverError as `solve`.
        """
        start = time.perf_counter()
        equations = self._block_equations(program)
        if equations is not None:
            program = equations.changed(program)
        program = program.rounded
        if self._system is None or self._structure is not program.structure:
            self._system = SchurSystem(program.structure)
            self._structure = program.structure
        self._system.load(program)
        usual = tolerances.FRICTION_CONES if program.structure.cones else tolerances.LINEAR
        run = _Iteration(program, self._system, self._tolerance or usual.residual, self._gap)
        # Breakdown shows as values that are not finite, so floating-point warnings add nothing.
        with np.errstate(all="ignore"):
            restored = equations.multipliers if equations is not None else np.asarray
            if suffices is not None:
                run.suffices = lambda point, dual: suffices(point, restored(dual))
            status, iterate, iterations = run.to_the_end(self._most)
            point, dual = run.answer(status, iterate)
            dual = restored(dual)
        return RawSolution(status, point, dual, iterations, time.perf_counter() - start, note=run.note)

    def _block_equations(self, program: ConicProgram) -> BlockEquations | None:
        """Return the change to equations of whole blocks, for the labelling of a program.

        None for a program without `bodies`, and where every block is one element. The last change is kept and reused if
        it fits.
        """
        bodies, known = program.bodies, self._equations
        if bodies is None:
            return None
        if known is None or not known.fits(program):
            sums = bodies.sums(program.structure.equalities)
            known = None if sums is None else BlockEquations(program, sums)
            self._equations = known
        return known


class _Iteration:
    """State of the interior-point iterations for one program."""

    def __init__(self, program: ConicProgram, system: SchurSystem, tolerance: float, gap: float) -> None:
        edge = program.structure.equalities
        self.system, self.tolerance, self.gap = system, tolerance, gap
        self.cones: Cones = system.blocks.cones
        self.q, self.r, self.h = program.objective, program.rhs[:edge], program.rhs[edge:]
        self.unit = self.cones.unit()
        self.note = ""
        self.suffices: Suffices | None = None

    def to_the_end(self, most: int) -> tuple[RawStatus, _Iterate, int]:
        """Iterate until convergence, a ray or stagnation; return status, iterate and count.

        Without convergence the best iterate is returned. most: largest number of iterations.
        """
        try:
            now = self._start()
        except np.linalg.LinAlgError:
            self.note = "singular"
            nothing = _Iterate(np.zeros(len(self.q)), np.zeros(len(self.r)), self.unit.copy(), self.unit.copy())
            return RawStatus.FAILED, nothing, 0
        best, least, stalled = now, np.inf, 0
        for iteration in range(most):
            status, merit = self._status_of(now)
            if status is not None:
                return status, now, iteration
            if self._is_enough(now):
                self.note = "bounds narrow enough"
                return RawStatus.OPTIMAL, now, iteration
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

    def _is_enough(self, it: _Iterate) -> bool:
        """Return True if the caller accepts an iterate as sufficient.

        It is asked only once the relative duality gap is at most `EARLY` and κ is small against τ.
        """
        if self.suffices is None or it.kappa > _SETTLED * it.tau:
            return False
        gap = float(it.s @ it.v) / it.tau**2 / max(1.0, abs(float(self.q @ it.x) / it.tau))
        return gap <= EARLY and self.suffices(*self.answer(RawStatus.OPTIMAL, it))

    def answer(self, status: RawStatus, it: _Iterate) -> tuple[Floats, Floats]:
        """Return point (columns,) and multipliers (rows,) of an iterate, or a ray by its status."""
        dual = np.concatenate([it.u, it.v])
        if status is RawStatus.INFEASIBLE:
            return it.x, dual / -(self.r @ it.u + self.h @ it.v)
        if status is RawStatus.UNBOUNDED:
            return it.x / -(self.q @ it.x), dual
        return it.x / it.tau, dual / it.tau

    def _start(self) -> _Iterate:
        """Return the first iterate: least-squares points, shifted into the cones."""
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

    def _status_of(self, it: _Iterate) -> tuple[RawStatus | None, float]:
        """Return the final status of an iterate, or None to continue, and its error.

        The error is relative to the tolerances.
        """
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
        """Take one predictor–corrector step; None if no step is possible."""
        cones = self.cones
        step = _Newton(self, it)
        lam, mu = step.scaling.point, step.mu
        square = cones.product(lam, lam)
        _, _, ws, wv, dt, dk = step.direction(1.0, -square, -it.tau * it.kappa)
        if step.apart:
            alpha, beta = (min(1.0, cones.step(lam, way)) for way in (ws, wv))
            # Mehrotra's share of μ that an affine step would leave.
            left = float((lam + alpha * ws) @ (lam + beta * wv)) / float(lam @ lam)
            # Out of its cones a step leaves less than nothing, and the cube of −10¹¹⁰ is an error.
            sigma = max(1e-6, max(0.0, min(1.0, left)) ** 3)
        else:
            sigma = min(1.0, max(1e-6, (1.0 - min(1.0, step.longest(ws, wv, dt, dk))) ** 3))
        corrector = -square - cones.product(ws, wv) + sigma * mu * self.unit
        eta = 1.0 - sigma if step.embedded else 1.0
        dx, du, ws, wv, dt, dk = step.direction(eta, corrector, -it.tau * it.kappa - dk * dt + sigma * mu)
        if step.apart:
            alpha, beta = (min(1.0, 0.99 * cones.step(lam, way)) for way in (ws, wv))
        else:
            alpha = beta = min(1.0, 0.99 * step.longest(ws, wv, dt, dk))
        least = min(alpha, beta)
        if not (np.isfinite(alpha) and np.isfinite(beta) and least > 1e-8 and np.all(np.isfinite(dx))):
            return None
        s, v = it.s + alpha * step.scaling.times(ws), it.v + beta * step.scaling.divide(wv)
        if cones.slack(s) <= 0.0 or cones.slack(v) <= 0.0:
            return None
        # τ may become zero at breakdown; numpy's float then gives inf or nan where Python's float would raise.
        tau = np.float64(it.tau + alpha * dt)
        made = _Iterate(it.x + alpha * dx, it.u + beta * du, s, v, tau, np.float64(it.kappa + alpha * dk))
        size = 1.0 / max(made.tau, made.kappa)
        return _Iterate(made.x * size, made.u * size, made.s * size, made.v * size, made.tau * size, made.kappa * size)


class _Newton:
    """Newton system of the central path at one iterate, factored for several right-hand sides.

    embedded: True while τ and κ are variables. apart: True if forces and motion may have steps of their own. In linear
    programs without the embedding, their residuals do not depend on each other; with cones this was measured to take
    more iterations.
    """

    def __init__(self, run: _Iteration, it: _Iterate) -> None:
        self.run, self.it = run, it
        system, cones = run.system, run.cones
        self.scaling = NesterovTodd(cones, it.s, it.v)
        system.factor(self.scaling)
        self.embedded = it.kappa > _SETTLED * it.tau
        self.apart = not self.embedded and not cones.count
        more = (it.tau * it.kappa, 1) if self.embedded else (0.0, 0)
        self.mu = (float(it.s @ it.v) + more[0]) / (cones.degree + more[1])
        self.res_x = system.transposed(it.u, it.v) + it.tau * run.q
        self.res_u = system.equations(it.x) - it.tau * run.r
        self.res_v = system.yields(it.x) + it.s - it.tau * run.h
        self.res_t = it.kappa + float(run.q @ it.x + run.r @ it.u + run.h @ it.v)
        if self.embedded:
            x1, u1, wv1 = system.solve(-run.q, run.r, run.h)
            self.column = x1, u1, wv1
            self.slope = float(run.q @ x1 + run.r @ u1 + run.h @ self.scaling.divide(wv1)) - it.kappa / it.tau

    def direction(self, eta: float, ds: Floats, dk: float) -> tuple[Floats, Floats, Floats, Floats, float, float]:
        """Return one search direction: dx, du, W⁻¹ds, W dv, dτ and dκ.

        eta: share of the residuals to remove. ds, dk: right-hand sides of the complementarity of s and v, and of τ and
        κ.
        """
        run, it, scaling = self.run, self.it, self.scaling
        comp = run.cones.quotient(scaling.point, ds)
        x2, u2, wv2 = run.system.solve(-eta * self.res_x, -eta * self.res_u, -eta * self.res_v - scaling.times(comp))
        if not self.embedded:
            return x2, u2, comp - wv2, wv2, 0.0, 0.0
        x1, u1, wv1 = self.column
        power = float(run.q @ x2 + run.r @ u2 + run.h @ scaling.divide(wv2))
        dt = (-eta * self.res_t - dk / it.tau - power) / self.slope
        wv = wv2 + dt * wv1
        # Scaled slack and multiplier satisfy W⁻¹ds + W dv = λ \ ds.
        return x2 + dt * x1, u2 + dt * u1, comp - wv, wv, dt, (dk - it.kappa * dt) / it.tau

    def longest(self, ws: Floats, wv: Floats, dt: float, dk: float) -> float:
        """Return the largest step that keeps slacks, multipliers, τ and κ in their cones.

        ws, wv: scaled directions W⁻¹ds and W dv. dt, dk: directions of τ and κ.
        """
        cones, lam = self.run.cones, self.scaling.point
        alpha = min(cones.step(lam, ws), cones.step(lam, wv))
        for value, change in ((self.it.tau, dt), (self.it.kappa, dk)):
            if change < 0.0:
                alpha = min(alpha, -value / change)
        return alpha


def _largest(vector: Floats) -> float:
    """Return the largest absolute value of a vector, 0 if it is empty."""
    return float(abs(vector).max(initial=0.0))
