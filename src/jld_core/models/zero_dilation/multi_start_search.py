"""Search for the lowest and the highest collapse load without dilation, from many starts.

Every solution reported is certified.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.limit import LimitAnalysis, Proof
from jld_core.models.zero_dilation.alternating_programs import AlternatingPrograms
from jld_core.models.zero_dilation.fixed_point_search import FixedPointSearch, ProximalOptions
from jld_core.models.zero_dilation.modes import Modes, modes_of
from jld_core.models.zero_dilation.primal_dual_pair import PrimalDualPair
from jld_core.models.zero_dilation.starts import low_compression_states, repair_and_evaluate, starts

_DRAWS: Final = 8  # number of random mechanisms per round, planar scenes

# Number of further rounds of random mechanisms once a solution is known, while some mechanism has forces
_ENOUGH: Final = 4

_TURNS: Final = 25  # maximum number of rounds of random mechanisms while no solution is known

_LITTLE: Final = 24  # maximum number of states of low compression used as starts

_IDLE: Final = 8  # number of consecutive starts or mixtures without a lower solution after which the search stops

_LOWER: Final = 1e-6  # relative decrease of λ that counts as a lower solution

_CLOSES: Final = 2  # number of random seeds for which the gap of a pair is closed

_SHARES: Final = (0.05, 0.2, 0.5)  # shares of a state of low compression in a mixture with the lowest solution

_TRIES: Final = 6  # number of consecutive tries without gain in a descent from a mixture


@dataclass
class Found:
    """Certified solutions of one labelling found so far, scaled.

    width: relative width of the bracket up to which a pair counts as a solution. zero_load: λ below which λ is rounding
    of zero. lowest: solution of least λ ≥ 0, as the load grows from zero. A solution with λ < 0 only if there is no
    other. highest: solution of largest λ. best: best pair offered, certified or not. loads: λ of all certified
    solutions.
    """

    width: float
    zero_load: float
    lowest: PrimalDualPair | None = None
    highest: PrimalDualPair | None = None
    best: PrimalDualPair | None = None
    loads: list[float] = field(default_factory=list)

    @property
    def lowest_load(self) -> float:
        """Return the scaled λ of the lowest solution, +inf if there is none."""
        return math.inf if self.lowest is None else self.lowest.state.load

    def offer(self, pair: PrimalDualPair) -> bool:
        """Store a pair if it is a new best, lowest or highest solution.

        The result is True if the pair is a certified solution.
        """
        if self.best is None or (pair.state.admissible, -pair.gap) > (self.best.state.admissible, -self.best.gap):
            self.best = pair
        if not pair.is_solution(self.width):
            return False
        load = pair.state.load
        self.loads.append(load)
        if self.lowest is None or self._order(load) < self._order(self.lowest.state.load):
            self.lowest = pair
        if self.highest is None or load > self.highest.state.load:
            self.highest = pair
        return True

    def _order(self, load: float) -> tuple[bool, float]:
        """Return the sort key of a scaled λ that puts λ ≥ 0 before λ < 0."""
        return load < -self.zero_load, load


class MultiStartSearch:
    """Multi-start search for the lowest and the highest solution of one labelling.

    A point (q·m + 1,) holds scaled forces and λ. `found` collects the certified solutions. Callers may add starts with
    `search_from` at any time. Methods that use linear programs do nothing in space.

    analysis: analysis of associative friction. labels: (m,) True = dry. options: parameters of the fixed-point search
    from each start. associative: associative proof of these labels.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits, options: ProximalOptions, associative: Proof) -> None:
        self.fixed_point = FixedPointSearch(analysis, labels, options)
        self.associative = associative
        self.found = Found(analysis.gap, tolerances.GAP * self.fixed_point.load_scale)
        self.modes: Modes | None = None if options.effective_area else modes_of(analysis.template, labels)
        load = associative.bracket[1]
        most = load if math.isfinite(load) else np.inf
        self.alternation = None if self.modes is None else AlternatingPrograms(self.modes, most * (1.0 + 1e-9))
        self._seed = 0
        self._ends = list[float]()  # Scaled λ at the end of each descent.

    def search(self, thorough: bool = True, sufficient_load: float = -math.inf) -> Found:
        """Search for solutions from all starts, and return the solutions found.

        thorough: use all starts and directions, else only the first ones. sufficient_load: scaled λ; the search stops
        once a solution at or below this value is certified.
        """
        for forces in starts(self.fixed_point, self.associative, thorough):
            self.search_from(forces)
            if self.found.lowest_load <= sufficient_load:
                return self.found
        if thorough and self.alternation is not None:
            self.search_first_solution()
            self.search_random_mechanisms()
            self.search_mixtures(sufficient_load)
        elif thorough and not self.fixed_point.options.effective_area:
            self.search_low_compression(sufficient_load)
        return self.found

    def search_first_solution(self) -> None:
        """Search from states of low compression until one solution is found (planar scenes)."""
        rng, nothing = np.random.default_rng(0), np.zeros(self.fixed_point.count + 1)
        for _ in range(_LITTLE if self.alternation is not None else 0):
            if self.found.lowest is not None:
                break
            closed = self.close_gap(self._mixed(nothing, 1.0, rng))
            if closed is not None:
                self.improve(closed)

    def search_random_mechanisms(self) -> None:
        """Search for solutions whose mechanism is drawn at random, in planar scenes only.

        Proximal steps miss solutions whose compressed faces differ from those of every start.
        """
        alternation, found = self.alternation, self.found
        for turn in range(_TURNS if alternation is not None else 0):
            assert alternation is not None
            points = sorted(alternation.random_solutions(turn, _DRAWS), key=lambda point: float(point[-1]))
            before = found.lowest_load, -_load_of(found.highest)
            self.certify_extremes(points)
            for end, sign, known in zip(points[:1] + points[-1:], (1.0, -1.0), before, strict=False):
                if not sign * float(end[-1]) >= known:
                    self.improve(end, 1)
            # Hardly any random mechanism of a wall has admissible forces.
            if found.lowest is not None and (not points or turn >= _ENOUGH):
                break

    def search_mixtures(self, sufficient_load: float = -math.inf) -> None:
        """Descend from mixtures of the lowest solution with states of low compression.

        It runs only if earlier descents ended at different λ, and stops after several mixtures in a row without gain.
        If all descents end at the same λ, hundreds of mixtures found nothing lower on walls of 83 to 141 faces.
        sufficient_load: as in `search`.
        """
        apart = max(self._ends, default=0.0) - min(self._ends, default=0.0)
        if self.alternation is None or apart <= _LOWER * max(self._ends, default=0.0):
            return
        rng, idle = np.random.default_rng(0), 0
        while idle < _IDLE and self.found.lowest is not None and self.found.lowest_load > sufficient_load:
            low, state = self.found.lowest_load, self.found.lowest.state
            point = self._mixed(np.append(state.forces.ravel(), low), float(rng.choice(_SHARES)), rng)
            closed = None if point is None else self.alternation.close_gap(point, self._seed)
            end = None if closed is None else self.alternation.descend(closed, self._seed, _TRIES)
            if end is not None:
                self.certify_extremes([end])
            self._seed += 1
            idle = 0 if self.found.lowest_load < low - _LOWER * abs(low) else idle + 1

    def _mixed(self, point: Floats, share: float, rng: np.random.Generator) -> Floats | None:
        """Mix a point with a random state of low compression; None if there is none, or in space.

        point: (q·m + 1,) scaled forces and λ. share: weight of that state, from 0 to 1. rng: draws the state.
        """
        return None if self.alternation is None else self.alternation.mix_with_low_compression(point, share, rng)

    def close_gap(self, point: Floats | None) -> Floats | None:
        """Find solutions by closing the complementarity gap from a point, and certify them.

        The search runs from the point with several random seeds. It returns the point of least λ reached, which need
        not be certified. The result is None if no solution is reached, if the point is None, and in space.
        """
        if self.alternation is None or point is None:
            return None
        ends = [end for k in range(_CLOSES) if (end := self.alternation.close_gap(point, self._seed + k)) is not None]
        self._seed += _CLOSES
        self.certify_extremes(ends)
        return min(ends, key=lambda end: float(end[-1]), default=None)

    def search_low_compression(self, sufficient_load: float = -math.inf) -> None:
        """Search from states of low compression on random faces, while λ decreases.

        The states have a λ below the lowest solution. In the plane, the descent by linear programs finds the same
        solutions. In space, torsion reduces the friction of a joint, and the lowest solutions often have low
        compression (docs/notes/tried.md). sufficient_load: as in `search`.
        """
        rng, idle = np.random.default_rng(0), 0
        for _ in range(_LITTLE):
            low = self.found.lowest_load
            most = min(low, self.associative.bracket[1])
            pair = low_compression_states(self.fixed_point, rng.random() * most if 0.0 < most < math.inf else 0.0, rng)
            if pair is not None:
                self.found.offer(pair)
            idle = idle + 1 if math.isclose(self.found.lowest_load, low, rel_tol=_LOWER) else 0
            if idle == _IDLE or self.found.lowest_load <= sufficient_load:
                break

    def search_from(self, forces: Floats, thorough: bool = True) -> None:
        """Search by proximal steps from scaled forces (q·m,), then improve the solution.

        thorough: also search upwards, and use two seeds instead of one.
        """
        for pair in self.fixed_point.attempts(forces):
            point = np.append(pair.state.forces.ravel(), pair.state.load)
            if self.found.offer(pair) or pair.locked:
                continue
            closed = self.close_gap(point)
            if closed is not None:
                point = closed
                break
        self.improve(point, 2 if thorough else 1, thorough)

    def improve(self, point: Floats, seeds: int = 2, ascend: bool = True) -> None:
        """Search for solutions of lower and higher λ by linear programs from one solution.

        point: (q·m + 1,) the solution. seeds: number of random seeds. ascend: also search for higher solutions.
        """
        if self.alternation is None:
            return
        for sign in (1.0, -1.0) if ascend else (1.0,):
            ends = [self.alternation.descend(point, self._seed + k, sign=sign) for k in range(seeds)]
            self.certify_extremes(end for end in ends if end is not None)
            self._ends += [float(end[-1]) for end in ends if end is not None and sign > 0.0]
        self._seed += seeds

    def certify_extremes(self, points: Iterable[Floats]) -> None:
        """Certify the points of least and of largest λ, each unless inside the known range.

        points: each (q·m + 1,) scaled forces and λ. They are repaired first. Certified solutions are kept in `found`.
        """
        lowest, highest = self.found.lowest, self.found.highest
        ends = sorted(points, key=lambda point: float(point[-1]))
        for point in ends[:1] + ends[1:][-1:]:
            load, least = float(point[-1]), 1e-9 * max(abs(float(point[-1])), self.fixed_point.load_scale)
            known = lowest is not None and highest is not None
            if known and _load_of(lowest) - least <= load <= _load_of(highest) + least:
                continue
            self.found.offer(repair_and_evaluate(self.fixed_point, point))


def _load_of(pair: PrimalDualPair | None) -> float:
    """Return the scaled λ of a pair, NaN without a pair."""
    return math.nan if pair is None else pair.state.load
