"""Alternating linear programs: from one non-dilatant solution to lower or higher ones.

Given forces, any mechanism whose modes z vanish where y > 0 completes them to a solution. Given a mechanism, so do
any forces with y = 0 where z > 0, and the least λ among those is one linear program. The alternation never increases
λ. It ends in a solution that neither step improves: a local minimum of the problem with complementarity, found without
solving the nonlinear program. Forces that no mechanism completes are first brought to a solution in the same way: by
the mechanism of least Σ yz for the forces and the forces of least Σ yz for the mechanism, in turn.

Source: the alternation is our own; the problem is that of Ferris & Tin-Loi 2001 (docs/method.md (4.6)).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.deadline import checkpoint
from jld_core.models.zero_dilation.modes import Modes
from jld_core.solvers.linear import LinearRows

# Values of y below which a mode may move, tried in order until some mechanism exists
_CLOSED: Final = (1e-9, 1e-7, 1e-5)

_MOVING: Final = 1e-9  # value of z above which a mode counts as moving

_BETTER: Final = 1e-9  # relative gain in λ that counts

_IDLES: Final = 1e-3  # scaled weight of a mode whose slack is zero, so that few of these modes move

_SWAY: Final = 1e-3  # size of the random objective that selects another vertex of the same λ

# Random change of the weights y where the gap is closed: relative, absolute. The second is also the weight of λ.
_UNEVEN: Final = (0.2, 1e-6)

_ROUNDS: Final = 6  # maximum number of rounds to close the gap

_CLOSING: Final = 0.9  # factor by which Σ yz must decrease in each round


class AlternatingPrograms:
    """Linear programs of one planar labelling: mechanisms for forces, forces for mechanisms.

    Each of m faces has four yield slacks y ≥ 0 and four modes, rates z ≥ 0 of hinges and slides. In a solution y z = 0,
    docs/method.md (4.6). A point (3m + 1,) holds scaled forces F and λ. Solutions found here are not certified yet.

    modes: the complementarity problem. most: scaled λ above which solutions are ignored.
    """

    def __init__(self, modes: Modes, most: float) -> None:
        self.modes = modes
        count, columns = modes.rows.shape
        self._first = len(modes.dead)
        rows = np.block([[modes.matrix, modes.live[:, None]], [modes.rows, np.zeros((count, 1))]])
        low, high = np.concatenate([-modes.dead, -modes.constants]), np.full(len(rows), np.inf)
        high[: self._first] = -modes.dead
        least, largest = np.full(columns + 1, -np.inf), np.full(columns + 1, np.inf)
        least[-1], largest[-1] = 0.0, most
        self._statics = LinearRows(rows, low, high, least, largest)
        width = modes.rates.shape[1]
        unit = np.vstack([modes.rates, modes.live_rate[None]])
        free = np.full(width, np.inf)
        ends = np.append(np.full(count, np.inf), 1.0)
        self._motions = LinearRows(unit, np.append(np.zeros(count), 1.0), ends, -free, free)

    def mechanism(self, closed: Bools, weights: Floats) -> Floats | None:
        """Return the mechanism z (4m,) ≥ 0 with live work 1 that minimises weights·z.

        closed: (4m,) modes whose slack y is zero; only these may move. weights: (4m,). None if the solver finds none.
        """
        self._motions.bound(slice(0, len(closed)), np.zeros(len(closed)), np.where(closed, np.inf, 0.0))
        answer = self._motions.minimise(weights @ self.modes.rates)
        return self.modes.rates @ answer.point if answer.found else None

    def forces(self, moving: Bools, objective: Floats) -> Floats | None:
        """Minimise an objective over the forces in equilibrium that complement a mechanism.

        moving: (4m,) modes with z > 0; their slacks y are set to zero. objective: (3m + 1,) coefficients of (F, λ).
        Returns the point (F, λ), unverified; None if the solver finds none.
        """
        d = self.modes.constants
        self._statics.bound(slice(self._first, self._first + len(d)), -d, np.where(moving, -d, np.inf))
        answer = self._statics.minimise(objective)
        return answer.point if answer.found else None

    def close_gap(self, point: Floats, seed: int) -> Floats | None:
        """Find a solution by reducing the gap Σ y z from a point to zero.

        Mechanism and forces are updated in turn. point: (3m + 1,) scaled forces and λ, of any kind. seed: of the random
        weights. The result is (F, λ), or None on failure.
        """
        rng, count, last = np.random.default_rng(seed), len(self.modes.constants), np.inf
        every, none = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        for _ in range(_ROUNDS):
            checkpoint()
            slack = np.maximum(self.modes.slacks_of(point[:-1]), 0.0)
            weights = slack * (1.0 + _UNEVEN[0] * rng.random(count)) + _UNEVEN[1] * rng.random(count)
            z = self.mechanism(every, weights)
            if z is None:
                return None
            moving = z > _MOVING
            found = self.forces(moving, np.append(np.zeros(len(point) - 1), 1.0))
            gap = float(slack @ z)
            if found is not None or gap > _CLOSING * last:
                return found
            # Prefer the lowest λ among forces of equal Σ yz.
            nearest = self.forces(none, np.append(np.where(moving, z, 0.0) @ self.modes.rows, _UNEVEN[1]))
            if nearest is None:
                return None
            point, last = nearest, gap
        return None

    def mix_with_low_compression(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        """Mix a point with a state of low compression on random faces.

        The state minimises Σ w N with random weights w. point: (3m + 1,) scaled forces and λ. share: weight of that
        state, from 0 to 1. rng: draws w. The result is None if no state exists.
        """
        objective = np.zeros(len(point))
        objective[:-1:3] = rng.exponential(size=self.modes.faces)
        state = self.forces(np.zeros(len(self.modes.constants), dtype=bool), objective)
        return None if state is None else (1.0 - share) * point + share * state

    def descend(self, point: Floats, seed: int, tries: int = 24, sign: float = 1.0) -> Floats | None:
        """Search for a solution with lower λ (sign 1) or higher λ (sign −1) from a solution.

        point: (3m + 1,) the solution. seed: of random mechanisms and vertices. tries: number of tries in a row without
        gain after which the search ends. The result is the best point, or None if no mechanism completes the given one.
        """
        rng = np.random.default_rng(seed)
        count = len(self.modes.constants)
        goal = np.append(np.zeros(len(point) - 1), sign)
        closed, best = self._start(point, rng), point
        if closed is None:
            return None
        idle = 0
        while idle < tries:
            checkpoint()
            z = self.mechanism(closed, rng.exponential(size=count))
            found = None if z is None else self.forces(z > _MOVING, goal)
            if z is None or found is None:
                idle += 1
                continue
            if sign * (found[-1] - best[-1]) < -_BETTER * max(abs(best[-1]), _BETTER):
                best, point, idle = found, found, 0
            else:
                idle += 1
                if idle % 3 == 0:
                    sway = np.append(_SWAY * rng.standard_normal(len(point) - 1), sign)
                    other = self.forces(z > _MOVING, sway)
                    if other is not None and sign * (other[-1] - best[-1]) <= _BETTER * abs(best[-1]):
                        point = other
            closed = self.modes.slacks_of(point[:-1]) < _CLOSED[1]
        return best

    def random_solutions(self, seed: int, draws: int) -> list[Floats]:
        """Return the solutions (F, λ) of lowest and highest λ for each of many random mechanisms.

        seed: of the random weights. draws: number of mechanisms. Every second one has weights that are multiplied by
        the slacks of a random state. Mechanisms that no forces complete give no solutions.
        """
        rng, found = np.random.default_rng(seed), list[Floats]()
        count, columns = len(self.modes.constants), self.modes.rows.shape[1]
        none, goal = np.zeros(count, dtype=bool), np.append(np.zeros(columns), 1.0)
        for draw in range(draws):
            checkpoint()
            weights = rng.exponential(size=count)
            if draw % 2:
                # A random objective yields high compression on some faces and low compression on others.
                state = self.forces(none, np.append(rng.standard_normal(columns), rng.standard_normal()))
                if state is not None:
                    weights *= np.maximum(self.modes.slacks_of(state[:-1]), 0.0) + _IDLES
            z = self.mechanism(~none, weights)
            if z is None:
                continue
            for sign in (1.0, -1.0):
                point = self.forces(z > _MOVING, sign * goal)
                if point is not None:
                    found.append(point)
        return found

    def ascending_path(self, point: Floats, seed: int, steps: int, idle: int) -> list[Floats]:
        """Return the points of a path of solutions with increasing λ, the given one first.

        Each step maximises λ for one random mechanism. point: (3m + 1,) a solution. seed: of the mechanisms. steps:
        maximum number of mechanisms. idle: maximum number of failures in a row.
        """
        rng = np.random.default_rng(seed)
        goal = np.append(np.zeros(len(point) - 1), -1.0)
        closed, path, missed = self._start(point, rng), [point], 0
        for _ in range(steps):
            checkpoint()
            z = None if closed is None else self.mechanism(closed, rng.exponential(size=len(self.modes.constants)))
            found = None if z is None else self.forces(z > _MOVING, goal)
            if found is not None and found[-1] > path[-1][-1] + 1e-6 * abs(path[-1][-1]):
                path.append(found)
                closed, missed = self.modes.slacks_of(found[:-1]) < _CLOSED[1], 0
            else:
                missed += 1
            if missed > idle:
                break
        return path

    def _start(self, point: Floats, rng: np.random.Generator) -> Bools | None:
        """Return the modes (4m,) whose slack at a point is zero within the least useful tolerance.

        A tolerance is useful if a mechanism of these modes alone exists. None if none is. point: (3m + 1,) scaled
        forces and λ. rng: draws the weights of mechanisms.
        """
        slack = self.modes.slacks_of(point[:-1])
        for allowance in _CLOSED:
            if self.mechanism(slack < allowance, rng.exponential(size=len(slack))) is not None:
                return np.asarray(slack < allowance)
        return None
