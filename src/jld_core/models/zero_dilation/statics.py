"""Bounds on forces from equilibrium and yield conditions, with λ in an interval.

Each bound is checked independently of the solver. A linear program yields multipliers, and the bound is computed from
them. The residual of stationarity is charged to the largest forces possible, which are bounded first in the same way.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.models.zero_dilation.modes import LinearModes
from jld_core.solvers.linear import LinearRows

_SUMS: Final = 1e-13  # rounding error of a sum of a few hundred products, relative to the sum of their absolute values

_MOVES_NOT: Final = 1e-6  # least scaled slack that proves that a mode cannot move

_SEEN: Final = 1e-8  # slack of a known state below which a form is not tested, as its minimum cannot be positive enough


class Statics:
    """States of equilibrium and yield with λ in an interval, and proven bounds on them.

    The conditions are A F + b + λ b_λ = 0, C F + d ≥ 0, low ≤ λ ≤ high, see `LinearModes`.

    modes: complementarity problem with m faces. low, high: ends of the interval of scaled λ. held: (4m,) yield rows
    that are equations. force_bounds: (3m + 2,) the property of this name, if already known.
    """

    def __init__(
        self, modes: LinearModes, low: float, high: float, held: Bools, force_bounds: Floats | None = None
    ) -> None:
        self.modes, self.low, self.high, self.held = modes, low, high, held
        self._force_bounds = force_bounds
        count, columns = modes.rows.shape
        rows = np.block([[modes.matrix, modes.live[:, None]], [modes.rows, np.zeros((count, 1))]])
        least, most = np.full(columns + 1, -np.inf), np.full(columns + 1, np.inf)
        least[-1], most[-1] = low, high
        below = np.concatenate([-modes.dead, -modes.constants])
        above = np.concatenate([-modes.dead, np.where(held, -modes.constants, np.inf)])
        self._rows = LinearRows(rows, below, above, least, most)
        self._equations = len(modes.dead)

    def least(self, objective: Floats) -> float:
        """Prove a lower bound on a linear objective over all states; −inf if none is proven.

        objective: (3m + 2,) coefficients of (F, λ, 1).
        """
        if not np.isfinite(self.force_bounds).all():
            return -np.inf
        value, left = self._bound(objective)
        return value - float(left @ self.force_bounds[:-2])

    @cached_property
    def force_bounds(self) -> Floats:
        """Return upper bounds (3m + 2,) on |F|, |λ| and 1; inf where none is proven.

        There are none if self-stress is unbounded.
        """
        if self._force_bounds is not None:
            return self._force_bounds
        modes = self.modes
        strong = float(modes.constants.max(initial=0.0))
        total = -np.append(modes.rows.sum(axis=0), [0.0, modes.constants.sum()])
        value, left = self._bound(total)
        missed = float(left.sum())
        force_bounds = np.full(len(total), np.inf)
        force_bounds[-2:] = max(abs(self.low), abs(self.high)), 1.0
        if not np.isfinite(value) or missed > 0.5:
            return force_bounds
        # Every |F| is at most the sum of all slacks plus one strength, so this sum bounds itself.
        force_bounds[:-2] = (strong - value + missed * strong) / (1.0 - missed) + strong
        coarse = force_bounds.copy()
        for face in range(modes.faces):
            pressed = np.zeros(len(total))
            pressed[3 * face] = -1.0
            value, left = self._bound(pressed)
            most = -(value - float(left @ coarse[:-2])) + strong
            slides = modes.rows[4 * face + 2, 3 * face] * most + modes.constants[4 * face + 2]
            force_bounds[3 * face : 3 * face + 3] = np.minimum((most, slides, most), coarse[3 * face])
        return force_bounds

    def closed_modes(self) -> Bools:
        """Return a mask (4m,) of modes that are proven not to move: y > 0 in every state."""
        return self.proven_positive(self.modes.slacks, ~self.held)

    def proven_positive(self, forms: Floats, tested: Bools) -> Bools:
        """Return a mask (k,) of linear forms that are proven positive in every state.

        forms: (k, 3m + 2) of (F, λ, 1). tested: (k,) True for forms to test; the others are False.
        """
        found, seen = np.zeros(len(forms), dtype=bool), np.where(tested, np.inf, 0.0)
        for row in range(len(forms)):
            if seen[row] > _SEEN:
                answer = self._rows.minimise(forms[row, :-1])
                seen = np.minimum(seen, forms @ np.append(answer.point, 1.0)) if answer.found else seen
                found[row] = answer.found and seen[row] > _MOVES_NOT and self.least(forms[row]) > _MOVES_NOT / 2
        return found

    def _bound(self, objective: Floats) -> tuple[float, Floats]:
        """Prove a lower bound on a linear objective, as a constant and a residual.

        objective: (3m + 2,) coefficients of (F, λ, 1). Every state satisfies objective ≥ value − r·|F|. Returns the
        value and the residual r (3m,); the value is −inf if the solver fails.
        """
        modes = self.modes
        answer = self._rows.minimise(objective[:-1])
        if not answer.found:
            return -np.inf, np.zeros(modes.rows.shape[1])
        q, p = answer.dual[: self._equations], answer.dual[self._equations :]
        p = np.where(self.held, p, np.maximum(p, 0.0))
        left = objective[:-2] - modes.matrix.T @ q - modes.rows.T @ p
        noise = abs(objective[:-2]) + abs(modes.matrix).T @ abs(q) + abs(modes.rows).T @ abs(p)
        price = float(objective[-2] - modes.live @ q)
        blur = abs(objective[-2]) + float(abs(modes.live) @ abs(q))
        value = float(objective[-1] - modes.constants @ p - modes.dead @ q) + min(price * self.low, price * self.high)
        total = abs(objective[-1]) + float(modes.constants @ abs(p) + abs(modes.dead) @ abs(q))
        total += blur * max(abs(self.low), abs(self.high))
        return value - _SUMS * total, abs(left) + _SUMS * noise


def bound_velocities(statics: Statics) -> Floats | None:
    """Bound velocities |u| and slides t of any mechanism per unit of its cost, (3n + m,).

    statics: states of the region, whose least friction is used. The result is None if no bound is proven. The cost is
    Σ_hinges z + Σ_faces capacity · |s|, docs/method.md (4.8). Hinges bound openings and rotations, and these bound
    velocities except for a few ways to slide without opening. Such a way is bounded if the faces that slide together
    carry some friction in every state.
    """
    modes, m = statics.modes, statics.modes.faces
    width = len(modes.dead)
    jumps = modes.matrix.T.reshape(m, 3, width)
    openings = np.concatenate([jumps[:, 0], jumps[:, 2]])
    _, values, basis = np.linalg.svd(openings)
    rank = int((values > 1e-9 * values.max(initial=0.0)).sum())
    loose = basis[rank:].T
    inverse = np.linalg.pinv(openings, rcond=1e-10)
    rows, shares = [openings], [np.full(2 * m, 1.0)]
    sizes, drift = statics.force_bounds, 0.0
    if not np.isfinite(sizes).all():
        return None
    capacity = abs(modes.capacities) @ sizes
    taken = np.zeros((0, loose.shape[1]))
    for face in _by_weight(jumps[:, 1] @ loose):
        if len(taken) == loose.shape[1]:
            break
        way = jumps[face, 1] @ loose
        if np.linalg.matrix_rank(np.vstack([taken, way]), tol=1e-9) == len(taken):
            continue
        others = jumps[:, 1] @ loose
        sign = np.where(others @ way >= 0.0, 1.0, -1.0)
        together = np.abs(others - sign[:, None] * way).max(axis=1) <= 1e-9
        least = statics.least(modes.capacities[together].sum(axis=0))
        if not least > 1e-6:
            continue
        apart = jumps[together, 1] - sign[together, None] * jumps[face, 1]
        rest = apart @ inverse
        drift = max(drift, float(capacity[together].sum() * abs(apart - rest @ openings).sum(axis=1).max() / least))
        spread = float(capacity[together].sum() * abs(rest).max(initial=0.0))
        taken = np.vstack([taken, way])
        rows.append(jumps[face, 1][None])
        shares.append(np.array([(1.0 + spread) / least]))
    if len(taken) < loose.shape[1]:
        return None
    stacked, per_cost = np.vstack(rows), np.concatenate(shares)
    back = np.linalg.pinv(stacked, rcond=1e-12)
    if abs(back @ stacked - np.eye(width)).sum(axis=1).max() > 1e-6:
        return None
    # The openings and rotations of all faces together cost at most one. The factor 2 covers rounding, which the test
    # below keeps small.
    velocity = 2.0 * (abs(back[:, : 2 * m]).max(axis=1) + abs(back[:, 2 * m :]) @ per_cost[2 * m :])
    if drift * float(velocity.max(initial=0.0)) > 1e-3:
        return None
    slips = abs(jumps[:, 1]) @ velocity
    return np.asarray(np.concatenate([velocity, slips]))


def _by_weight(ways: Floats) -> list[int]:
    """Sort faces by the size of their slip in motions without opening, largest first.

    ways: (m, k) slip of each face in k such motions. Returns the indices of the faces.
    """
    return [int(face) for face in np.argsort(-np.linalg.norm(ways, axis=1), kind="stable")]
