"""An interior point method for programs over products: min c·X with y_k z_l ≥ 0 or = 0 for given pairs, b_λ·u = 1.

Mehrotra's predictor and corrector with more correctors (Gondzio 1996); equations are regularised as by proximal
multipliers (Friedlander & Orban 2012). Answers are hints as everywhere; what they prove the certificate checks.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.models.zero_dilation.normal import NormalEquations
from jld_core.models.zero_dilation.product_space import Point, ProductSpace

_STEPS: Final = 120
_FIRST: Final = 0.1  # slacks and multipliers to begin with; of 0.01 and 1 walls take half as many steps again
_EQUAL: Final = 1e-6  # what equations give way by, per unit that their multipliers change
_POSITIVE: Final = 1e-8  # the same of what is not negative
_SHIFT: Final = 1e-9  # added to normal equations
_REFINED: Final = 3  # corrections of a solution by the same factor, while
_EXACT: Final = (1e-7, 1e-12)  # more than this is left of the right-hand side, far off and near the end
_CORRECTORS: Final = 2
_BACK: Final = 0.995  # share of the way to the boundary
_CENTRE: Final = 0.5  # share of it that is aimed at
_SURE: Final = 5.0  # times as much that is near enough to count
_DONE: Final = 2e-7  # residuals and complementarity at which it ends: multipliers nearer to zero are hard to make exact
_IDLE: Final = 3  # steps in a row that better nothing, once
_NEAR: Final = 1e-3  # this has been reached; ten times as many before, but
_HASTY: Final = 2  # twice as many where no more than
_ROUGH: Final = 1e-2  # this is asked: then nothing comes of it
_STATED: Final = 100.0  # times as near to zero as asked what multipliers leave of the cost must be where little is
_LITTLE: Final = 1e-3  # this or more: bounds may be low, but are to be made exact
_OPEN: Final = 0.01  # share of complementarity that counts where no more than _ROUGH is asked: a bound needs none of it
_GAINS: Final = 0.9


@dataclass(frozen=True)
class ProductProgram:
    """min cost·(Z, T) + (1 − b_λ·u)⁺.

    equal, positive: (r, modes) forms that are zero or not negative. groups: (w,) velocities of one element.
    """

    space: ProductSpace
    equal: Bools
    positive: Bools
    cost: Point
    groups: Ints


@dataclass(frozen=True)
class ProductAnswer:
    """point, and multipliers (r, modes) of the forms, positive ones ≥ 0; bound: multiplier of b_λ·u = 1, at most 1.

    left: the largest of residuals and complementarity, all of order one. steps: taken. sure: it is near what was asked.
    """

    point: Point
    multipliers: Floats
    bound: float
    left: float
    steps: int
    sure: bool


def minimise(program: ProductProgram, seconds: float = np.inf, exact: float | None = None) -> ProductAnswer | None:
    """The least, as near as it comes within some seconds of processor time; None where the arithmetic fails.

    exact: residuals and complementarity at which it ends; None: as near as multipliers can be made exact.
    """
    try:
        return _Path(program, _DONE if exact is None else exact).follow(seconds)
    except np.linalg.LinAlgError:
        return None


class _Path:
    def __init__(self, program: ProductProgram, exact: float) -> None:
        self.exact = exact
        self.space = space = program.space
        self.shape = program.equal.shape
        self.k, self.l = np.nonzero(program.positive)
        self.ke, self.le = np.nonzero(program.equal)
        self.normal = NormalEquations(space, program.equal | program.positive, program.groups)
        unit = space.unit
        self.cost = (program.cost[0] - unit, program.cost[1])
        self.x: Point = (np.zeros_like(program.cost[0]), np.zeros_like(program.cost[1]))
        # slacks of the rows, and of 1 − b_λ·u, the last of them
        self.s, self.v = np.full((2, len(self.k) + 1), _FIRST)
        self.q = np.zeros(len(self.ke))

    def rows(self, x: Point) -> tuple[Floats, Floats]:
        """Forms that are to be positive, without what is constant in the last, and those that are to be zero."""
        table = self.space.values(x)
        last = -float((self.space.unit * x[0]).sum())
        return np.append(table[self.k, self.l], last), table[self.ke, self.le]

    def back(self, v: Floats, q: Floats) -> Point:
        """Their transposed."""
        table = np.zeros(self.shape)
        table[self.k, self.l] = v[:-1]
        table[self.ke, self.le] = q
        z, t = self.space.adjoint(table)
        return z - v[-1] * self.space.unit, t

    def follow(self, seconds: float) -> ProductAnswer:
        """Steps until nothing is left or nothing is gained; the best of them."""
        end, best, idle = time.process_time() + seconds, None, 0
        for step in range(_STEPS):
            g, e = self.rows(self.x)
            g[-1] += 1.0
            rp, re = self.s - g, -e
            pulled = self.back(self.v, self.q)
            rd = (self.cost[0] - pulled[0], self.cost[1] - pulled[1])
            work = float(self.s @ self.v)
            stated = (_STATED if self.exact >= _LITTLE else 1.0) * _largest(rd)
            open_ = (_OPEN if self.exact >= _ROUGH else 1.0) * work
            left = max(open_, float(abs(rp).max()), float(abs(re).max(initial=0.0)), stated)
            if best is None or left < _GAINS * best.left:
                best, idle = self._answer(left, step), 0
            else:
                idle += 1
            patience = 1 if best.left <= _NEAR else 10 if self.exact < _ROUGH else _HASTY
            if left < self.exact or idle >= patience * _IDLE or time.process_time() > end:
                break
            self._step(rp, re, rd, work / len(self.s), _EXACT[left < _NEAR])
        assert best is not None
        return best

    def _answer(self, left: float, step: int) -> ProductAnswer:
        table = np.zeros(self.shape)
        table[self.k, self.l] = self.v[:-1]
        table[self.ke, self.le] = self.q
        return ProductAnswer(self.x, table, 1.0 - float(self.v[-1]), left, step, left <= _SURE * self.exact)

    def _step(self, rp: Floats, re: Floats, rd: Point, mu: float, exact: float) -> None:
        d = 1.0 / (self.s / self.v + _POSITIVE)
        weights = np.zeros(self.shape)
        weights[self.k, self.l] = d[:-1]
        weights[self.ke, self.le] = 1.0 / _EQUAL
        solve = self.normal.factor(weights, float(d[-1]), _SHIFT, plain=True)

        def direction(rc: Floats, times: int = _REFINED) -> tuple[Point, Floats, Floats, Floats]:
            z, t = self.back(d * (rp + rc / self.v), re / _EQUAL)
            dx = solve((z - rd[0], t - rd[1]), exact, times)
            g, e = self.rows(dx)
            dv = d * (rp + rc / self.v - g)
            return dx, (rc - self.s * dv) / self.v, dv, (re - e) / _EQUAL

        rc = -self.s * self.v
        _, ds, dv, _ = direction(rc, 0)
        a, b = _way(self.s, ds), _way(self.v, dv)
        after = float((self.s + a * ds) @ (self.v + b * dv)) / len(self.s)
        centre = max(min((after / mu) ** 3, 1.0) * mu, _CENTRE * self.exact / len(self.s))
        rc = centre - self.s * self.v - ds * dv
        dx, ds, dv, dq = direction(rc)
        a, b = _way(self.s, ds), _way(self.v, dv)
        for _ in range(_CORRECTORS):
            if min(a, b) > 0.9:
                break
            to_a, to_b = min(a + 0.1 + 0.08 * a, 1.0), min(b + 0.1 + 0.08 * b, 1.0)
            product = (self.s + to_a * ds) * (self.v + to_b * dv)
            rc2 = rc + np.maximum(np.clip(product, 0.1 * centre, 10.0 * centre) - product, -10.0 * centre)
            dx2, ds2, dv2, dq2 = direction(rc2)
            a2, b2 = _way(self.s, ds2), _way(self.v, dv2)
            if a2 + b2 < a + b + 0.02:
                break
            rc, dx, ds, dv, dq, a, b = rc2, dx2, ds2, dv2, dq2, a2, b2
        a, b = min(_BACK * a, 1.0), min(_BACK * b, 1.0)
        self.x = (self.x[0] + a * dx[0], self.x[1] + a * dx[1])
        self.s, self.v, self.q = self.s + a * ds, self.v + b * dv, self.q + b * dq


def _way(at: Floats, step: Floats) -> float:
    """How much of a step keeps all positive, at most 1 / _BACK."""
    falls = step < 0.0
    return min(1.0 / _BACK, float((-at[falls] / step[falls]).min(initial=np.inf)))


def _largest(point: Point) -> float:
    return max(float(abs(point[0]).max(initial=0.0)), float(abs(point[1]).max(initial=0.0)))
