"""What every search for a bound without dilation climbs under: the lowest solution found, the clock, what was done."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.deadline import time_left

PATIENT: Final = 600.0
"""Seconds of processor time from which products are tried on any number of faces."""

_LEAST: Final = 1e-8  # λ, scaled, of which shares are taken where λ is less
_ROOM: Final = 0.02  # room above the lowest solution found, relative to what is not excluded, and
_LEAST_ROOM: Final = 1e-3  # to λ itself: an interval of no width leaves an interior point no interior
_STALL: Final = 0.05  # share of the distance that a step must win, else rows are added or solutions parted
_TRUSTED: Final = 1e-7  # what an unproven bound is lowered by, relative: more than the solver's own tolerance


@dataclass(frozen=True)
class LowerBound:
    """Bounds on λ ≥ 0 of every solution, scaled.

    proven: with certificates throughout. bound: the highest there is, true within `tolerance`, relative: 0 where it is
    the proven one, else what a solver's word is trusted to. closed: it meets the lowest solution found. programs:
    solved. seconds: of processor time. route: what was done.
    """

    proven: float
    bound: float
    tolerance: float
    closed: bool
    programs: int
    seconds: float
    route: tuple[str, ...]


class LowerBoundProblem:
    """load: λ of the lowest solution found, scaled. seconds: of processor time from now, after which no further program
    begins. offer: takes forces and λ (k, q + 1) that may lead lower, and returns λ of the lowest then."""

    def __init__(self, load: float, seconds: float, offer: Callable[[Floats], float] | None = None) -> None:
        self.load = load
        self.programs, self.route = 0, list[str]()
        self._start, self._seconds, self._offer = time.process_time(), seconds, offer

    def note(self, step: str, programs: int = 0) -> None:
        """A step done, and how many programs it took."""
        self.route.append(step)
        self.programs += programs

    @property
    def spent(self) -> float:
        """Seconds of processor time."""
        return time.process_time() - self._start

    @property
    def left(self) -> float:
        """Seconds of processor time, no more than are left to the deadline of the command."""
        return min(self._seconds - self.spent, time_left())

    @property
    def unit(self) -> float:
        """What relative distances of λ are relative to."""
        return max(abs(self.load), _LEAST)

    def earns(self, slack: float) -> float:
        """λ that a unit of cost earns in a program, from a share of λ or of 1."""
        return slack * max(abs(self.load), 1.0)

    def above(self, low: float) -> float:
        """Up to where solutions are sought, where none is below `low`."""
        return self.load + _ROOM * (self.load - low) + _LEAST_ROOM * self.unit

    def below(self, share: float) -> float:
        """λ, less a share of it."""
        return self.load - share * self.unit

    def met(self, bound: float) -> bool:
        """A bound meets the lowest solution found."""
        return bound >= self.below(tolerances.GAP)

    def won(self, low: float, bound: float, share: float = _STALL) -> bool:
        """From `low` to a bound is more than a share of the distance there was."""
        return bound - low > share * (self.load - low)

    def trusted(self, bound: float) -> float:
        """What is believed of a bound that a solver calls optimal."""
        return min(bound, self.load) - _TRUSTED * self.unit

    def take(self, states: Floats) -> None:
        """Forces and λ (k, q + 1) that a relaxation mixes may lead to a lower solution."""
        if self._offer is not None:
            self.load = min(self.load, self._offer(states))

    def allows(self, faces: int, most: int, size: Floats) -> bool:
        """Products may be formed: of at most so many faces unless there is time, and of bounded forces `size`."""
        if faces > most and self._seconds < PATIENT:
            self.note(f"no products: {faces} faces")
        elif not np.isfinite(size).all():
            self.note("no products: self-stress is not bounded")
        else:
            return True
        return False

    def floor(self, proven: float, believed: float) -> LowerBound:
        """What it has come to."""
        sure = proven >= believed - tolerances.GAP * self.unit
        bound = proven if sure else believed
        return LowerBound(
            proven=proven,
            bound=bound,
            tolerance=0.0 if sure else _TRUSTED,
            closed=self.met(bound),
            programs=self.programs,
            seconds=self.spent,
            route=tuple(self.route),
        )
