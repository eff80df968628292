"""Schur-complement interior-point method for large assemblies, with sparse Cholesky.

The method is the Nesterov–Todd predictor–corrector on the homogeneous self-dual embedding, so that infeasible and
unbounded programs end in a ray. Once τ is stable and κ vanishes, the iterations continue without the embedding. They
then meet equations and stationarity to rounding, so that point and multipliers can be proven directly.
Source: Vandenberghe, The CVXOPT linear and quadratic cone program solvers (2010), section 7; Domahidi, Chu & Boyd,
ECOS: an SOCP solver for embedded systems, ECC 2013; docs/method.md (8.4).
"""

from __future__ import annotations

import time

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import EARLY, RawSolution, RawStatus, Solver, Suffices
from jld_core.solvers.schur.block_equations import BlockEquations
from jld_core.solvers.schur.nesterov_todd import Cones, NesterovTodd
from jld_core.solvers.schur.newton import SETTLED, Iterate, Newton
from jld_core.solvers.schur.system import SchurSystem

_VANISHED = 1e-14  # τ/κ below which no further iterate can be a point; rays are reached to tolerance well above it


class SchurSolver(Solver):
    """Schur-complement interior-point solver for large assemblies.

    The analysis of a structure is kept for later programs. Columns of a program must separate into faces, and its cones
    must have one size, as in every template. `solve` raises SolverError for other programs.

    tolerance: relative residuals to reach; None: the precision of the kind of program. gap: relative duality gap to
    reach. most: largest number of iterations.
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
        """Return the transformation of a program to equilibrium of whole blocks.

        None for a program without `bodies`, and where every block is one element. The last transformation is stored and
        reused if it fits the program.
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

    def to_the_end(self, most: int) -> tuple[RawStatus, Iterate, int]:
        """Iterate until convergence, a ray or stagnation; return status, iterate and count.

        Without convergence the best iterate is returned. most: largest number of iterations.
        """
        try:
            now = self._start()
        except np.linalg.LinAlgError:
            self.note = "singular"
            nothing = Iterate(np.zeros(len(self.q)), np.zeros(len(self.r)), self.unit.copy(), self.unit.copy())
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

    def _is_enough(self, it: Iterate) -> bool:
        """Return True if the caller accepts an iterate as sufficient.

        It is asked only once the relative duality gap is at most `EARLY` and κ is small against τ.
        """
        if self.suffices is None or it.kappa > SETTLED * it.tau:
            return False
        return it.relative_gap(self.q) <= EARLY and self.suffices(*self.answer(RawStatus.OPTIMAL, it))

    def answer(self, status: RawStatus, it: Iterate) -> tuple[Floats, Floats]:
        """Return point (columns,) and multipliers (rows,) of an iterate, or a ray by its status."""
        dual = np.concatenate([it.u, it.v])
        if status in (RawStatus.INFEASIBLE, RawStatus.NEARLY_INFEASIBLE):
            return it.x, dual / -(self.r @ it.u + self.h @ it.v)
        if status is RawStatus.UNBOUNDED:
            return it.x / -(self.q @ it.x), dual
        return it.x / it.tau, dual / it.tau

    def _start(self) -> Iterate:
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
        return Iterate(x, u, s, v)

    def _status_of(self, it: Iterate) -> tuple[RawStatus | None, float]:
        """Return the final status of an iterate, or None to continue, and its error.

        The error is relative to the tolerances.
        """
        system, q, r, h = self.system, self.q, self.r, self.h
        gradient = system.transposed(it.u, it.v)
        left_u, left_v = system.equations(it.x), system.yields(it.x) + it.s
        cost, value = float(q @ it.x), float(r @ it.u + h @ it.v)
        primal = max(_largest(left_u - it.tau * r), _largest(left_v - it.tau * h)) / it.tau
        dual = _largest(gradient + it.tau * q) / it.tau
        merit = max(primal / self.tolerance, dual / self.tolerance, it.relative_gap(self.q) / self.gap)
        if merit <= 1.0:
            return RawStatus.OPTIMAL, merit
        if it.kappa > it.tau:
            ray = 10.0 * self.tolerance
            if value < 0.0 and _largest(gradient) <= ray * -value:
                return RawStatus.INFEASIBLE, merit
            if cost < 0.0 and max(_largest(left_u), _largest(left_v)) <= ray * -cost:
                return RawStatus.UNBOUNDED, merit
            if value < 0.0 and it.tau < _VANISHED * it.kappa:
                return RawStatus.NEARLY_INFEASIBLE, merit
        return None, merit

    def _advance(self, it: Iterate) -> Iterate | None:
        """Take one predictor–corrector step; None if no step is possible."""
        cones = self.cones
        step = Newton(self.system, (self.q, self.r, self.h), it)
        way = step.corrected()
        alpha, beta = step.lengths(way, 0.99)
        least = min(alpha, beta)
        if not (np.isfinite(alpha) and np.isfinite(beta) and least > 1e-8 and np.all(np.isfinite(way.x))):
            return None
        s, v = it.s + alpha * step.scaling.times(way.ws), it.v + beta * step.scaling.divide(way.wv)
        if cones.slack(s) <= 0.0 or cones.slack(v) <= 0.0:
            return None
        # τ may become zero at breakdown; numpy's float then gives inf or nan where Python's float would raise.
        tau, kappa = np.float64(it.tau + alpha * way.tau), np.float64(it.kappa + alpha * way.kappa)
        x, u, size = it.x + alpha * way.x, it.u + beta * way.u, 1.0 / max(tau, kappa)
        return Iterate(x * size, u * size, s * size, v * size, tau * size, kappa * size)


def _largest(vector: Floats) -> float:
    """Return the largest absolute value of a vector, 0 if it is empty."""
    return float(abs(vector).max(initial=0.0))
