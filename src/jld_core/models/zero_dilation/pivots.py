"""From one solution without dilation to lower ones (or higher), by linear programs in turn.

For given forces, any mechanism whose modes z are free only where y = 0 completes them to a solution; for a given
mechanism, so do any forces with y = 0 where z > 0, and the least λ among those is one linear program. Going from one
to the other and back never loses, and ends in a solution that neither step betters: a local minimum of the problem
with complementarity, found without its nonlinear program. Forces that nothing completes are first brought to a solution
in the same way: by the mechanism of least Σ yz for the forces and the forces of least Σ yz for the mechanism, in turn.
Source: the alternation is our own; the problem is that of Ferris & Tin-Loi 2001 (docs/method.md (4.6)).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.deadline import checkpoint
from jld_core.models.zero_dilation.modes import Modes
from jld_core.solvers import LinearRows

_CLOSED: Final = (1e-9, 1e-7, 1e-5)  # y below which a mode may move, as small as lets any mechanism through
_MOVING: Final = 1e-9  # z above which a mode moves
_BETTER: Final = 1e-9  # gain in λ, relative, that counts
_IDLES: Final = 1e-3  # scaled price of a mode that works against nothing, so that few of them move
_SWAY: Final = 1e-3  # weight of a random direction when another vertex of the same λ is sought
_UNEVEN: Final = (0.2, 1e-6)  # by how much y is weighed at random, relative and absolute, where the gap is closed,
_ROUNDS: Final = 6  # times at the most
_CLOSING: Final = 0.9  # share of Σ yz that a round must come down to


class Pivots:
    """The two linear programs of one labelling. most: λ above which nothing is of interest, scaled."""

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
        """z (4m,) ≥ 0 of least weighted sum that moves closed modes alone, b_λ·u = 1; None where there is none."""
        self._motions.bound(slice(0, len(closed)), np.zeros(len(closed)), np.where(closed, np.inf, 0.0))
        answer = self._motions.minimise(weights @ self.modes.rates)
        return self.modes.rates @ answer.point if answer.found else None

    def forces(self, moving: Bools, objective: Floats) -> Floats | None:
        """(F, λ) with y = 0 on moving modes that minimises an objective (3m + 1,); None where there is none."""
        d = self.modes.constants
        self._statics.bound(slice(self._first, self._first + len(d)), -d, np.where(moving, -d, np.inf))
        answer = self._statics.minimise(objective)
        return answer.point if answer.found else None

    def close(self, point: Floats, seed: int) -> Floats | None:
        """A solution (F, λ) that forces lead to, Σ yz made less for mechanism and forces in turn; None if none is met.

        point: (3m + 1,) scaled forces and λ, of which nothing is asked. seed: of the mechanisms drawn.
        """
        rng, count, last = np.random.default_rng(seed), len(self.modes.constants), np.inf
        every, none = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        for _ in range(_ROUNDS):
            checkpoint()
            slack = np.maximum(self.modes.of(point[:-1]), 0.0)
            weights = slack * (1.0 + _UNEVEN[0] * rng.random(count)) + _UNEVEN[1] * rng.random(count)
            z = self.mechanism(every, weights)
            if z is None:
                return None
            moving = z > _MOVING
            found = self.forces(moving, np.append(np.zeros(len(point) - 1), 1.0))
            gap = float(slack @ z)
            if found is not None or gap > _CLOSING * last:
                return found
            # of forces with the same Σ yz the lowest
            nearest = self.forces(none, np.append(np.where(moving, z, 0.0) @ self.modes.rows, _UNEVEN[1]))
            if nearest is None:
                return None
            point, last = nearest, gap
        return None

    def mixed(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        """Forces and λ (3m + 1,) with a share of a state that presses little on faces drawn at random."""
        objective = np.zeros(len(point))
        objective[:-1:3] = rng.exponential(size=self.modes.faces)
        state = self.forces(np.zeros(len(self.modes.constants), dtype=bool), objective)
        return None if state is None else (1.0 - share) * point + share * state

    def descend(self, point: Floats, seed: int, tries: int = 24, sign: float = 1.0) -> Floats | None:
        """A solution (F, λ) of λ no higher (sign 1) or no lower (sign −1) than a given one; None if it is none.

        point: (3m + 1,) scaled forces and λ. seed: of the mechanisms and vertices drawn. tries: in a row without gain.
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
            closed = self.modes.of(point[:-1]) < _CLOSED[1]
        return best

    def drawn(self, seed: int, draws: int) -> list[Floats]:
        """Solutions (F, λ) of mechanisms drawn at random, the lowest and the highest of each that any forces go with.

        draws: of a state and of the mechanism that works least against it, but for weights that are drawn as well;
        every other mechanism is of drawn weights alone. Where few faces leave few mechanisms these are most of them.
        """
        rng, found = np.random.default_rng(seed), list[Floats]()
        count, columns = len(self.modes.constants), self.modes.rows.shape[1]
        none, goal = np.zeros(count, dtype=bool), np.append(np.zeros(columns), 1.0)
        for draw in range(draws):
            checkpoint()
            weights = rng.exponential(size=count)
            if draw % 2:
                # states of much pressure on some faces and little on others
                state = self.forces(none, np.append(rng.standard_normal(columns), rng.standard_normal()))
                if state is not None:
                    weights *= np.maximum(self.modes.of(state[:-1]), 0.0) + _IDLES
            z = self.mechanism(~none, weights)
            if z is None:
                continue
            for sign in (1.0, -1.0):
                point = self.forces(z > _MOVING, sign * goal)
                if point is not None:
                    found.append(point)
        return found

    def climb(self, point: Floats, seed: int, legs: int, idle: int) -> list[Floats]:
        """Corners (F, λ) of a path upwards: each leg keeps one mechanism and ends where it carries most.

        point: (3m + 1,) of a solution. legs: mechanisms tried at the most; idle: of them in a row to no avail.
        """
        rng = np.random.default_rng(seed)
        goal = np.append(np.zeros(len(point) - 1), -1.0)
        closed, path, missed = self._start(point, rng), [point], 0
        for _ in range(legs):
            checkpoint()
            z = None if closed is None else self.mechanism(closed, rng.exponential(size=len(self.modes.constants)))
            found = None if z is None else self.forces(z > _MOVING, goal)
            if found is not None and found[-1] > path[-1][-1] + 1e-6 * abs(path[-1][-1]):
                path.append(found)
                closed, missed = self.modes.of(found[:-1]) < _CLOSED[1], 0
            else:
                missed += 1
            if missed > idle:
                break
        return path

    def _start(self, point: Floats, rng: np.random.Generator) -> Bools | None:
        """Modes that may move at a point, with the least allowance for rounding that any mechanism needs."""
        slack = self.modes.of(point[:-1])
        for allowance in _CLOSED:
            if self.mechanism(slack < allowance, rng.exponential(size=len(slack))) is not None:
                return np.asarray(slack < allowance)
        return None
