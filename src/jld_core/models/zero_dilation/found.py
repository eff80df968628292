"""The lowest and the highest collapse load without dilation that a search from every side finds, each certified."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.limit import LimitAnalysis, Proof
from jld_core.models.zero_dilation.modes import Modes, modes_of
from jld_core.models.zero_dilation.pivots import Pivots
from jld_core.models.zero_dilation.search import FixedPointSearch, PrimalDualPair, ProximalOptions
from jld_core.models.zero_dilation.starts import certified, low_compression_states, starts

_DRAWS: Final = 8  # mechanisms in the plane at a time,
_ENOUGH: Final = 4  # and after the first so often as long as some go with forces; until any solution is known
_TURNS: Final = 25  # so often at the most
_LITTLE: Final = 24  # states of little pressure that are started from in space,
_IDLE: Final = 8  # so many in a row without a lower solution
_LOWER: Final = 1e-6  # relative, that counts
_CLOSES: Final = 2  # mechanisms drawn where the gap of a pair is to be closed
_SHARES: Final = (0.05, 0.2, 0.5)  # of states of little pressure in mixtures with the lowest,
_TRIES: Final = 6  # in a row without gain on the way down from those


@dataclass
class Found:
    """Certified solutions of one labelling, kept as they come, scaled.

    width: relative, of a solution's bracket. nothing: λ that is rounding of zero. lowest, highest: pairs of forces and
    mechanism; of a load that grows from zero, so that one with λ < 0 is the lowest
    only where there is none with λ ≥ 0. loads: λ of all that were certified. best: the pair that comes
    nearest, where none is certified.
    """

    width: float
    nothing: float
    lowest: PrimalDualPair | None = None
    highest: PrimalDualPair | None = None
    best: PrimalDualPair | None = None
    loads: list[float] = field(default_factory=list)

    @property
    def low(self) -> float:
        """λ of the lowest, +inf where there is none."""
        return math.inf if self.lowest is None else self.lowest.state.load

    def offer(self, pair: PrimalDualPair) -> bool:
        """Keep a pair that is a solution; say whether it is."""
        if self.best is None or (pair.state.admissible, -pair.gap) > (self.best.state.admissible, -self.best.gap):
            self.best = pair
        if not pair.solves(self.width):
            return False
        load = pair.state.load
        self.loads.append(load)
        if self.lowest is None or self._order(load) < self._order(self.lowest.state.load):
            self.lowest = pair
        if self.highest is None or load > self.highest.state.load:
            self.highest = pair
        return True

    def _order(self, load: float) -> tuple[bool, float]:
        return load < -self.nothing, load


class MultiStartSearch:
    """The search of one labelling; further starts may be handed in as they turn up."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, scheme: ProximalOptions, associative: Proof) -> None:
        self.pairs = FixedPointSearch(analysis, labels, scheme)
        self.associative = associative
        self.found = Found(analysis.gap, tolerances.GAP * self.pairs.floor)
        self.modes: Modes | None = None if scheme.effective_area else modes_of(analysis.template, labels)
        load = associative.bracket[1]
        most = load if math.isfinite(load) else np.inf
        self.pivots = None if self.modes is None else Pivots(self.modes, most * (1.0 + 1e-9))
        self._seed = 0
        self._ends = list[float]()  # λ of all ways down, scaled

    def search(self, thorough: bool = True, enough: float = -math.inf) -> Found:
        """Search from all starts; not further once a λ at or below `enough`, scaled, is certified."""
        for forces in starts(self.pairs, self.associative, thorough):
            self.search_from(forces)
            if self.found.low <= enough:
                return self.found
        if thorough and self.pivots is not None:
            self.seek()
            self.draw()
            self.mix(enough)
        elif thorough and not self.pairs.scheme.effective_area:
            self.press_little(enough)
        return self.found

    def seek(self) -> None:
        """Where nothing has led to a solution yet, search from states of little pressure until one does."""
        rng, nothing = np.random.default_rng(0), np.zeros(self.pairs.count + 1)
        for _ in range(_LITTLE if self.pivots is not None else 0):
            if self.found.lowest is not None:
                break
            closed = self.close(self._mixed(nothing, 1.0, rng))
            if closed is not None:
                self.improve(closed)

    def draw(self) -> None:
        """Search from solutions of mechanisms drawn at random, planar scenes only: proximal steps miss those whose
        faces are pressed otherwise than in any state they begin with."""
        pivots, found = self.pivots, self.found
        for turn in range(_TURNS if pivots is not None else 0):
            assert pivots is not None
            points = sorted(pivots.drawn(turn, _DRAWS), key=lambda point: float(point[-1]))
            before = found.low, -_low(found.highest)
            self.check(points)
            for end, sign, known in zip(points[:1] + points[-1:], (1.0, -1.0), before, strict=False):
                if not sign * float(end[-1]) >= known:
                    self.improve(end, 1)
            # of a wall's many mechanisms hardly any drawn one goes with forces
            if found.lowest is not None and (not points or turn >= _ENOUGH):
                break

    def mix(self, enough: float = -math.inf) -> None:
        """Where ways down end apart, go down from the lowest mixed with states of little pressure, while that gains.

        Where all end alike, hundreds of mixtures have found nothing lower on walls of 83 to 141 faces.
        """
        apart = max(self._ends, default=0.0) - min(self._ends, default=0.0)
        if self.pivots is None or apart <= _LOWER * max(self._ends, default=0.0):
            return
        rng, idle = np.random.default_rng(0), 0
        while idle < _IDLE and self.found.lowest is not None and self.found.low > enough:
            low, state = self.found.low, self.found.lowest.state
            point = self._mixed(np.append(state.forces.ravel(), low), float(rng.choice(_SHARES)), rng)
            closed = None if point is None else self.pivots.close(point, self._seed)
            end = None if closed is None else self.pivots.descend(closed, self._seed, _TRIES)
            if end is not None:
                self.check([end])
            self._seed += 1
            idle = 0 if self.found.low < low - _LOWER * abs(low) else idle + 1

    def _mixed(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        return None if self.pivots is None else self.pivots.mixed(point, share, rng)

    def close(self, point: Floats | None) -> Floats | None:
        """The lowest solution that closing the gap from forces and λ (q·m + 1,) leads to."""
        if self.pivots is None or point is None:
            return None
        ends = [end for k in range(_CLOSES) if (end := self.pivots.close(point, self._seed + k)) is not None]
        self._seed += _CLOSES
        self.check(ends)
        return min(ends, key=lambda end: float(end[-1]), default=None)

    def press_little(self, enough: float = -math.inf) -> None:
        """Search from states below the lowest that press little on faces drawn at random, while that finds lower ones.

        In the plane pivots have found what this finds; in space, where torsion takes friction off a joint, the lowest
        solutions often are such (benchmarks/zero_dilation_space.py).
        """
        rng, idle = np.random.default_rng(0), 0
        for _ in range(_LITTLE):
            low = self.found.low
            most = min(low, self.associative.bracket[1])
            pair = low_compression_states(self.pairs, rng.random() * most if 0.0 < most < math.inf else 0.0, rng)
            if pair is not None:
                self.found.offer(pair)
            idle = idle + 1 if math.isclose(self.found.low, low, rel_tol=_LOWER) else 0
            if idle == _IDLE or self.found.low <= enough:
                break

    def search_from(self, forces: Floats, thorough: bool = True) -> None:
        """Proximal steps from scaled forces (q·m,) to a solution, and from there down, and up where thorough."""
        for pair in self.pairs.attempts(forces):
            point = np.append(pair.state.forces.ravel(), pair.state.load)
            if self.found.offer(pair) or pair.locked:
                continue
            closed = self.close(point)
            if closed is not None:
                point = closed
                break
        self.improve(point, 2 if thorough else 1, thorough)

    def improve(self, point: Floats, seeds: int = 2, up: bool = True) -> None:
        """Down, and up, from forces and λ (q·m + 1,) of a solution, planar scenes only."""
        if self.pivots is None:
            return
        for sign in (1.0, -1.0) if up else (1.0,):
            ends = [self.pivots.descend(point, self._seed + k, sign=sign) for k in range(seeds)]
            self.check(end for end in ends if end is not None)
            self._ends += [float(end[-1]) for end in ends if end is not None and sign > 0.0]
        self._seed += seeds

    def check(self, points: Iterable[Floats]) -> None:
        """Certify points (q·m + 1,) that are worth it: lower than the lowest or higher than the highest."""
        lowest, highest = self.found.lowest, self.found.highest
        ends = sorted(points, key=lambda point: float(point[-1]))
        for point in ends[:1] + ends[1:][-1:]:
            load, least = float(point[-1]), 1e-9 * max(abs(float(point[-1])), self.pairs.floor)
            known = lowest is not None and highest is not None
            if known and _low(lowest) - least <= load <= _low(highest) + least:
                continue
            self.found.offer(certified(self.pairs, point))


def _low(pair: PrimalDualPair | None) -> float:
    return math.nan if pair is None else pair.state.load
