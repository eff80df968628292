"""Search directions of the interior-point method: one factor per iterate, and corrections of the direction.

Directions are combined in scaled variables W⁻¹ds and W dv, in which all corrections are linear. Source: Vandenberghe,
The CVXOPT linear and quadratic cone program solvers (2010), section 7; Gondzio, Comput. Optim. Appl. 6 (1996) 137–156;
Colombo & Gondzio, Comput. Optim. Appl. 41 (2008) 277–305; docs/method.md (8.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Floats
from jld_core.solvers.schur.nesterov_todd import NesterovTodd
from jld_core.solvers.schur.system import SchurSystem

SETTLED = 1e-3  # κ/τ below which the program counts as solvable and iterations leave the embedding

_EXACT = 1e-13  # relative residual of linear systems near the solution
_COARSE = 1e-10  # relative residual of linear systems far from it, where later iterations remove what is left
_PER_GAP = 1e-9  # residual of linear systems for each unit of the relative duality gap, between the two above
_WEIGHTS = 5  # weights of a corrector that are compared
_LEAST_WEIGHT = 0.1  # smallest of them
_CENTRAL = 0.1, 10.0  # range of complementarity products, in multiples of their target, that needs no correction
_LONG = 0.9  # step from which no centrality corrector is worth its linear system
_SHORT = 0.03  # step below which an iterate is jammed at the boundary of its cones and is centred instead
_CENTRING = 0.9  # share of μ that is kept while an iterate is centred
_LONGER = 1.5, 0.1  # step for which a centrality corrector aims: factor of the step at hand, and what is added


@dataclass
class Iterate:
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

    def relative_gap(self, objective: Floats) -> float:
        """Return the duality gap over the larger of 1 and the objective, whose coefficients (columns,) are given."""
        return float(self.s @ self.v) / self.tau**2 / max(1.0, abs(float(objective @ self.x) / self.tau))

    def progress(self, objective: Floats) -> float:
        """Return the relative duality gap, or the complementarity of an iterate that tends to a ray.

        objective: coefficients (columns,). The gap of a ray is divided by a τ that vanishes, so it does not decrease.
        """
        return float(self.s @ self.v) if self.kappa > self.tau else self.relative_gap(objective)


@dataclass(frozen=True)
class Direction:
    """Search direction: dx, du, W⁻¹ds, W dv, dτ and dκ."""

    x: Floats
    u: Floats
    ws: Floats
    wv: Floats
    tau: float
    kappa: float

    def plus(self, first: float, second: float, more: Direction) -> Direction:
        """Add multiples of another direction: `first` of its x, W⁻¹ds, τ and κ, `second` of its u and W dv."""
        return Direction(
            self.x + first * more.x,
            self.u + second * more.u,
            self.ws + first * more.ws,
            self.wv + second * more.wv,
            self.tau + first * more.tau,
            self.kappa + first * more.kappa,
        )


class Newton:
    """Newton system of the central path at one iterate, factored for several right-hand sides.

    system: linear systems, with the program loaded. given: objective q (columns,), right-hand side r of the equations
    and h of the yield rows. it: the iterate. embedded: True while τ and κ are variables. apart: True if forces and
    motion may have steps of their own. In linear programs without the embedding, their residuals do not depend on each
    other; with cones this was measured to take more iterations.
    """

    def __init__(self, system: SchurSystem, given: tuple[Floats, Floats, Floats], it: Iterate) -> None:
        self.system, self.given, self.it, self.cones = system, given, it, system.blocks.cones
        q, r, h = given
        self.scaling = NesterovTodd(self.cones, it.s, it.v)
        system.factor(self.scaling)
        coarse = _COARSE if not self.cones.count else _EXACT
        system.accuracy = min(coarse, max(_EXACT, _PER_GAP * it.progress(q)))
        self.embedded = it.kappa > SETTLED * it.tau
        self.apart = not self.embedded and not self.cones.count
        more = (it.tau * it.kappa, 1) if self.embedded else (0.0, 0)
        self.mu = (float(it.s @ it.v) + more[0]) / (self.cones.degree + more[1])
        self.res_x = system.transposed(it.u, it.v) + it.tau * q
        self.res_u = system.equations(it.x) - it.tau * r
        self.res_v = system.yields(it.x) + it.s - it.tau * h
        self.res_t = it.kappa + float(q @ it.x + r @ it.u + h @ it.v)
        if self.embedded:
            x1, u1, wv1 = system.solve(-q, r, h)
            self.column = x1, u1, wv1
            self.slope = float(q @ x1 + r @ u1 + h @ self.scaling.divide(wv1)) - it.kappa / it.tau

    def direction(self, eta: float, ds: Floats, dk: float) -> Direction:
        """Return one search direction.

        eta: share of the residuals to remove. ds, dk: right-hand sides of the complementarity of s and v, and of τ and
        κ.
        """
        it, scaling = self.it, self.scaling
        comp = self.cones.quotient(scaling.point, ds)
        x2, u2, wv2 = self.system.solve(-eta * self.res_x, -eta * self.res_u, -eta * self.res_v - scaling.times(comp))
        if not self.embedded:
            return Direction(x2, u2, comp - wv2, wv2, 0.0, 0.0)
        (q, r, h), (x1, u1, wv1) = self.given, self.column
        power = float(q @ x2 + r @ u2 + h @ scaling.divide(wv2))
        dt = (-eta * self.res_t - dk / it.tau - power) / self.slope
        wv = wv2 + dt * wv1
        # Scaled slack and multiplier satisfy W⁻¹ds + W dv = λ \ ds.
        return Direction(x2 + dt * x1, u2 + dt * u1, comp - wv, wv, dt, (dk - it.kappa * dt) / it.tau)

    def lengths(self, way: Direction, share: float = 1.0) -> tuple[float, float]:
        """Return the steps of forces and of motion, at most 1: a share of the longest within slacks and multipliers."""
        alpha, beta = (share * self.cones.step(self.scaling.point, part) for part in (way.ws, way.wv))
        if self.apart:
            return min(1.0, alpha), min(1.0, beta)
        for value, change in ((self.it.tau, way.tau), (self.it.kappa, way.kappa)):
            if change < 0.0:
                alpha = min(alpha, share * -value / change)
        alpha = min(1.0, alpha, beta)
        return alpha, alpha

    def corrected(self) -> Direction:
        """Return the predictor-corrector direction of Mehrotra.

        In linear programs the corrector is scaled for the longest step, and centred where that step is still short.
        """
        it, lam, cones = self.it, self.scaling.point, self.cones
        square = cones.product(lam, lam)
        way = self.direction(1.0, -square, -it.tau * it.kappa)
        reached = self.lengths(way)
        sigma = self._centring(way, reached)
        target, eta = sigma * self.mu, sigma if self.embedded else 0.0
        ds, dk = target * cones.unit() - cones.product(way.ws, way.wv), target - way.kappa * way.tau
        if cones.count:
            return self.direction(1.0 - eta, ds - square, dk - it.tau * it.kappa)
        way, reached = self._weighted(way, self.direction(-eta, ds, dk), reached)
        if min(reached) > _LONG:
            return way
        way = self._centred(way, reached, target)
        return way if min(self.lengths(way)) > _SHORT else self._centring_direction(square)

    def _centring_direction(self, square: Floats) -> Direction:
        """Return the direction to the central path at nearly the same μ, along which a jammed iterate can move again.

        square: complementarity products of the iterate, scaled.
        """
        target, it = _CENTRING * self.mu, self.it
        return self.direction(1.0 - _CENTRING, target * self.cones.unit() - square, target - it.tau * it.kappa)

    def _centring(self, way: Direction, reached: tuple[float, float]) -> float:
        """Return the share of μ to aim at. way, reached: affine direction and its steps."""
        if not self.apart:
            return min(1.0, max(1e-6, (1.0 - reached[0]) ** 3))
        # Mehrotra's share of μ that an affine step would leave.
        lam, (alpha, beta) = self.scaling.point, reached
        left = float((lam + alpha * way.ws) @ (lam + beta * way.wv)) / float(lam @ lam)
        # Out of its cones a step leaves less than nothing, and the cube of −10¹¹⁰ is an error.
        return max(1e-6, max(0.0, min(1.0, left)) ** 3)

    def _weighted(
        self, way: Direction, more: Direction, reached: tuple[float, float]
    ) -> tuple[Direction, tuple[float, float]]:
        """Add that multiple of a corrector which allows the longest steps; return the direction and its steps.

        way, reached: direction and its steps. more: corrector.
        """
        weights = np.linspace(max(_LEAST_WEIGHT, min(reached) ** 2), 1.0, _WEIGHTS).tolist()
        found = [self.lengths(way.plus(weight, weight, more)) for weight in weights]
        # Where steps are equal, the larger weight is taken.
        first, second = (max(range(_WEIGHTS), key=lambda k: (found[k][side], k)) for side in (0, 1))
        return way.plus(weights[first], weights[second], more), (found[first][0], found[second][1])

    def _centred(self, way: Direction, reached: tuple[float, float], target: float) -> Direction:
        """Add a corrector that brings complementarity products nearer to their target, for longer steps.

        way, reached: direction and its steps. target: value of the products, scaled.
        """
        it, lam = self.it, self.scaling.point
        far, wide = (min(1.0, _LONGER[0] * length + _LONGER[1]) for length in reached)
        low, high = (factor * target for factor in _CENTRAL)

        def missing(product: Floats) -> Floats:
            return np.asarray(np.maximum(np.clip(product, low, high) - product, -high))

        ds = missing((lam + far * way.ws) * (lam + wide * way.wv))
        dk = float(missing(np.array((it.tau + far * way.tau) * (it.kappa + far * way.kappa))))
        return self._weighted(way, self.direction(0.0, ds, dk), reached)[0]
