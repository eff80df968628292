"""Interior-point method for programs over products of forces and velocities.

The program is min c·X with y_k z_l ≥ 0 or = 0 for given pairs, and b_λ·u = 1. The method is Mehrotra's predictor and
corrector with more correctors (Gondzio 1996). Equations are regularised as by proximal multipliers (Friedlander & Orban
2012). Its answers are not trusted: the certificate checks what they prove.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import Bools, Floats, Ints
from jld_dilation.normal_equations import NormalEquations
from jld_dilation.product_space import Point, ProductSpace

_STEPS: Final = 120  # maximum number of steps

_FIRST: Final = 0.1  # initial slacks and multipliers; with 0.01 or 1, walls take half as many steps again

_EQUAL: Final = 1e-6  # regularisation of equations: residual per unit change of the multiplier

_POSITIVE: Final = 1e-8  # regularisation of inequalities: residual per unit change of the multiplier

_SHIFT: Final = 1e-9  # shift of the diagonal of the normal equations

_REFINED: Final = 3  # maximum number of corrections of a solution by the same factor

_EXACT: Final = (1e-7, 1e-12)  # relative residual at which such corrections end: far from the optimum, and near to it

_CORRECTORS: Final = 2  # maximum number of additional correctors per step

_BACK: Final = 0.995  # fraction of the distance to the boundary that a step takes

_CENTRE: Final = 0.5  # lower limit of the centring target, as a fraction of the tolerance

_SURE: Final = 5.0  # multiple of the tolerance up to which an answer counts as accurate

# Default tolerance of residuals and complementarity. Multipliers nearer to zero are hard to make exact.
_DONE: Final = 2e-7

_IDLE: Final = 3  # number of consecutive steps without improvement at which the method ends, once `_NEAR` is reached

_NEAR: Final = 1e-3  # error from which `_IDLE` applies as it is; before, ten times as many steps are allowed

# Multiple of `_IDLE` that replaces ten if the tolerance is `_ROUGH` or larger: further steps then gain nothing
_HASTY: Final = 2

_ROUGH: Final = 1e-2  # tolerance from which `_HASTY` and `_OPEN` apply

_STATED: Final = 100.0  # weight of the dual residual in the error, for tolerances of `_LITTLE` or more

# Tolerance from which `_STATED` applies: the bound may be low, but its multipliers must be easy to make exact
_LITTLE: Final = 1e-3

# Weight of complementarity in the error, for tolerances of `_ROUGH` or more: a bound does not require it
_OPEN: Final = 0.01

_GAINS: Final = 0.9  # factor by which the error must decrease to count as an improvement


@dataclass(frozen=True)
class ProductProgram:
    """Program min cost·(Z, T) + (1 − b_λ·u)⁺; masked products y_k z_l are zero, or not negative."""

    space: ProductSpace  # map from the unknowns (Z, T) to the products (r, forms)
    # equal, positive: (r, forms) products that are zero, and products that are not negative
    equal: Bools
    positive: Bools
    cost: Point  # (Z, T) coefficients of the objective, in the shape of a point
    groups: Ints  # (w,) number of the group in which each velocity is eliminated


@dataclass(frozen=True)
class ProductSolution:
    """Result of the interior-point method for one program over products."""

    point: Point  # (Z, T) best point found
    multipliers: Floats  # (r, forms) multipliers of the products, ≥ 0 for positive ones, 0 for those not in the program
    bound: float  # multiplier of b_λ·u = 1, at most 1
    error: float  # largest one of residuals and complementarity, all of order one
    steps: int  # number of steps taken
    accurate: bool  # True if `error` is near the tolerance


def minimise_product_program(
    program: ProductProgram, seconds: float = np.inf, tolerance: float | None = None
) -> ProductSolution | None:
    """Minimise a program over products: the best iterate, or None if a factorisation fails."""
    try:
        return _InteriorPointMethod(program, _DONE if tolerance is None else tolerance).run(seconds)
    except np.linalg.LinAlgError:
        return None


class _InteriorPointMethod:
    """State of the interior-point iterations for one program over products."""

    def __init__(self, program: ProductProgram, tolerance: float) -> None:
        self.tolerance = tolerance
        self.space = space = program.space
        self.shape = program.equal.shape
        self.k, self.l = np.nonzero(program.positive)
        self.ke, self.le = np.nonzero(program.equal)
        self.normal = NormalEquations(space, program.equal | program.positive, program.groups)
        unit = space.unit
        self.cost = (program.cost[0] - unit, program.cost[1])
        self.x: Point = (np.zeros_like(program.cost[0]), np.zeros_like(program.cost[1]))
        # Slacks of the rows; the last one is 1 − b_λ·u.
        self.s, self.v = np.full((2, len(self.k) + 1), _FIRST)
        self.q = np.zeros(len(self.ke))

    def rows(self, x: Point) -> tuple[Floats, Floats]:
        """Return the rows at a point (Z, T): positive ones, the last −b_λ·u, then zero ones."""
        table = self.space.values(x)
        last = -float((self.space.unit * x[0]).sum())
        return np.append(table[self.k, self.l], last), table[self.ke, self.le]

    def apply_transpose(self, v: Floats, q: Floats) -> Point:
        """Return the rows weighted by v and q, as a form of (Z, T): the transpose of `rows`."""
        table = np.zeros(self.shape)
        table[self.k, self.l] = v[:-1]
        table[self.ke, self.le] = q
        z, t = self.space.adjoint(table)
        return z - v[-1] * self.space.unit, t

    def run(self, seconds: float) -> ProductSolution:
        """Take steps until the tolerance is met or progress ends; return the best iterate."""
        end, best, idle = time.process_time() + seconds, None, 0
        for step in range(_STEPS):
            g, e = self.rows(self.x)
            g[-1] += 1.0
            rp, re = self.s - g, -e
            pulled = self.apply_transpose(self.v, self.q)
            rd = (self.cost[0] - pulled[0], self.cost[1] - pulled[1])
            work = float(self.s @ self.v)
            stated = (_STATED if self.tolerance >= _LITTLE else 1.0) * _largest(rd)
            open_ = (_OPEN if self.tolerance >= _ROUGH else 1.0) * work
            error = max(open_, float(abs(rp).max()), float(abs(re).max(initial=0.0)), stated)
            if best is None or error < _GAINS * best.error:
                best, idle = self._answer(error, step), 0
            else:
                idle += 1
            patience = 1 if best.error <= _NEAR else 10 if self.tolerance < _ROUGH else _HASTY
            if error < self.tolerance or idle >= patience * _IDLE or time.process_time() > end:
                break
            self._step(rp, re, rd, work / len(self.s), _EXACT[error < _NEAR])
        assert best is not None
        return best

    def _answer(self, error: float, step: int) -> ProductSolution:
        """Return the current iterate as a solution with a given error and number of steps."""
        table = np.zeros(self.shape)
        table[self.k, self.l] = self.v[:-1]
        table[self.ke, self.le] = self.q
        return ProductSolution(self.x, table, 1.0 - float(self.v[-1]), error, step, error <= _SURE * self.tolerance)

    def _step(self, rp: Floats, re: Floats, rd: Point, mu: float, tolerance: float) -> None:
        """Take one predictor-corrector step from residuals of positive rows, zero rows and dual equations."""
        d = 1.0 / (self.s / self.v + _POSITIVE)
        weights = np.zeros(self.shape)
        weights[self.k, self.l] = d[:-1]
        weights[self.ke, self.le] = 1.0 / _EQUAL
        solve = self.normal.factor(weights, float(d[-1]), _SHIFT, plain=True)

        def direction(rc: Floats, times: int = _REFINED) -> tuple[Point, Floats, Floats, Floats]:
            """Return the changes of point, slacks, and both kinds of multipliers in one direction."""
            z, t = self.apply_transpose(d * (rp + rc / self.v), re / _EQUAL)
            dx = solve((z - rd[0], t - rd[1]), tolerance, times)
            g, e = self.rows(dx)
            dv = d * (rp + rc / self.v - g)
            return dx, (rc - self.s * dv) / self.v, dv, (re - e) / _EQUAL

        rc = -self.s * self.v
        _, ds, dv, _ = direction(rc, 0)
        a, b = _step_length(self.s, ds), _step_length(self.v, dv)
        after = float((self.s + a * ds) @ (self.v + b * dv)) / len(self.s)
        centre = max(min((after / mu) ** 3, 1.0) * mu, _CENTRE * self.tolerance / len(self.s))
        rc = centre - self.s * self.v - ds * dv
        dx, ds, dv, dq = direction(rc)
        a, b = _step_length(self.s, ds), _step_length(self.v, dv)
        for _ in range(_CORRECTORS):
            if min(a, b) > 0.9:
                break
            to_a, to_b = min(a + 0.1 + 0.08 * a, 1.0), min(b + 0.1 + 0.08 * b, 1.0)
            product = (self.s + to_a * ds) * (self.v + to_b * dv)
            rc2 = rc + np.maximum(np.clip(product, 0.1 * centre, 10.0 * centre) - product, -10.0 * centre)
            dx2, ds2, dv2, dq2 = direction(rc2)
            a2, b2 = _step_length(self.s, ds2), _step_length(self.v, dv2)
            if a2 + b2 < a + b + 0.02:
                break
            rc, dx, ds, dv, dq, a, b = rc2, dx2, ds2, dv2, dq2, a2, b2
        a, b = min(_BACK * a, 1.0), min(_BACK * b, 1.0)
        self.x = (self.x[0] + a * dx[0], self.x[1] + a * dx[1])
        self.s, self.v, self.q = self.s + a * ds, self.v + b * dv, self.q + b * dq


def _step_length(at: Floats, step: Floats) -> float:
    """Return the largest fraction of a step, at most 1 / _BACK, that keeps a vector ≥ 0."""
    falls = step < 0.0
    return min(1.0 / _BACK, float((-at[falls] / step[falls]).min(initial=np.inf)))


def _largest(point: Point) -> float:
    """Return the largest absolute entry of a point (Z, T), see `ProductSpace`."""
    return max(float(abs(point[0]).max(initial=0.0)), float(abs(point[1]).max(initial=0.0)))
