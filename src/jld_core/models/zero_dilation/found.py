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
from jld_core.models.zero_dilation.search import Pair, PairSearch, Scheme
from jld_core.models.zero_dilation.starts import certified, of_little_pressure, starts

_DRAWS: Final = 8  # mechanisms in the plane at a time,
_ENOUGH: Final = 4  # and after the first so often as long as some go with forces; until any solution is known
_TURNS: Final = 25  # so often at the most
_LITTLE: Final = 24  # states of little pressure that are started from in space,
_IDLE: Final = 8  # so many in a row without a lower solution
_LOWER: Final = 1e-6  # relative, that counts


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
    lowest: Pair | None = None
    highest: Pair | None = None
    best: Pair | None = None
    loads: list[float] = field(default_factory=list)

    @property
    def low(self) -> float:
        """λ of the lowest, +inf where there is none."""
        return math.inf if self.lowest is None else self.lowest.state.load

    def offer(self, pair: Pair) -> bool:
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


class FromEverySide:
    """The search of one labelling; further starts may be handed in as they turn up."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, scheme: Scheme, associative: Proof) -> None:
        self.pairs = PairSearch(analysis, labels, scheme)
        self.associative = associative
        self.found = Found(analysis.gap, tolerances.GAP * self.pairs.floor)
        self.modes: Modes | None = None if scheme.effective_area else modes_of(analysis.template, labels)
        load = associative.bracket[1]
        most = load if math.isfinite(load) else np.inf
        self.pivots = None if self.modes is None else Pivots(self.modes, most * (1.0 + 1e-9))
        self._seed = 0

    def search(self, thorough: bool = True, enough: float = -math.inf) -> Found:
        """Search from all starts; not further once a λ at or below `enough`, scaled, is certified."""
        for forces in starts(self.pairs, self.associative, thorough):
            self.search_from(forces)
            if self.found.low <= enough:
                return self.found
        if thorough:
            self.draw()
        if thorough and self.pivots is None and not self.pairs.scheme.effective_area:
            self.press_little(enough)
        return self.found

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

    def press_little(self, enough: float = -math.inf) -> None:
        """Search from states below the lowest that press little on faces drawn at random, while that finds lower ones.

        In the plane pivots have found what this finds; in space, where torsion takes friction off a joint, the lowest
        solutions often are such (benchmarks/zero_dilation_space.py).
        """
        rng, idle = np.random.default_rng(0), 0
        for _ in range(_LITTLE):
            low = self.found.low
            most = min(low, self.associative.bracket[1])
            pair = of_little_pressure(self.pairs, rng.random() * most if 0.0 < most < math.inf else 0.0, rng)
            if pair is not None:
                self.found.offer(pair)
            idle = idle + 1 if math.isclose(self.found.low, low, rel_tol=_LOWER) else 0
            if idle == _IDLE or self.found.low <= enough:
                break

    def search_from(self, forces: Floats, thorough: bool = True) -> None:
        """Proximal steps from scaled forces (q·m,) to a solution, and from there down, and up where thorough."""
        pair = self.pairs.pair_from(forces)
        self.found.offer(pair)
        self.improve(np.append(pair.state.forces.ravel(), pair.state.load), 2 if thorough else 1, thorough)

    def improve(self, point: Floats, seeds: int = 2, up: bool = True) -> None:
        """Down, and up, from forces and λ (q·m + 1,), planar scenes only."""
        if self.pivots is None:
            return
        for sign in (1.0, -1.0) if up else (1.0,):
            ends = [self.pivots.descend(point, self._seed + k, sign=sign) for k in range(seeds)]
            self.check(end for end in ends if end is not None)
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


def _low(pair: Pair | None) -> float:
    return math.nan if pair is None else pair.state.load
