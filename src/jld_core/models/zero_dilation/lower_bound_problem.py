"""Shared state of a lower-bound search: lowest solution found, time budget, log."""

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
"""Processor time in seconds from which products are formed for any number of faces."""

_LEAST: Final = 1e-8  # lower limit of the scaled |λ| to which relative distances refer

_ROOM: Final = 0.02  # margin above the lowest solution found, relative to the interval of λ not yet excluded

# Additional margin relative to λ; an interval of zero width leaves the interior-point method no interior
_LEAST_ROOM: Final = 1e-3

# Fraction of the remaining distance that a step must gain; below it rows are added or the region is split
_STALL: Final = 0.05

_TRUSTED: Final = 1e-7  # relative reduction of an unproven bound; it exceeds the tolerance of the solver


@dataclass(frozen=True)
class LowerBound:
    """Lower bounds on λ of all non-dilatant solutions with λ ≥ 0, scaled.

    proven: bound by certificates only. bound: highest bound, valid within `tolerance`. tolerance: relative; 0 if
    `bound` is proven, otherwise it covers the error of the solver. closed: True if `bound` meets the lowest solution
    found. programs: number of programs solved. seconds: processor time, s. solve_log: steps in order.
    """

    proven: float
    bound: float
    tolerance: float
    closed: bool
    programs: int
    seconds: float
    solve_log: tuple[str, ...]


class LowerBoundProblem:
    """Shared state of a lower-bound search: lowest solution found, time budget, log.

    load: scaled λ of the lowest solution found. seconds: processor time from now, s, after which no further program
    begins. offer: function that takes forces and λ of states (k, q + 1), which may lead to a lower solution. It returns
    the scaled λ of the lowest solution found. load: as above, updated by `offer_states`. programs: number of programs
    solved. solve_log: steps in order.
    """

    def __init__(self, load: float, seconds: float, offer: Callable[[Floats], float] | None = None) -> None:
        self.load = load
        self.programs, self.solve_log = 0, list[str]()
        self._start, self._seconds, self._offer = time.process_time(), seconds, offer

    def record(self, step: str, programs: int = 0) -> None:
        """Append a step to the log, and add its number of programs to the count."""
        self.solve_log.append(step)
        self.programs += programs

    @property
    def seconds_used(self) -> float:
        """Return the processor time used so far, in seconds."""
        return time.process_time() - self._start

    @property
    def seconds_left(self) -> float:
        """Return the remaining processor time in seconds, limited by the deadline of the command."""
        return min(self._seconds - self.seconds_used, time_left())

    @property
    def load_unit(self) -> float:
        """Return the scaled load to which relative distances of λ refer: |load|, at least 1e-8."""
        return max(abs(self.load), _LEAST)

    def scaled_slack(self, slack: float) -> float:
        """Convert a relative slack σ to scaled λ per unit of the cost of a mechanism.

        slack: σ relative to max(|λ|, 1), where λ is that of the lowest solution found. For the cost see docs/method.md
        (4.8).
        """
        return slack * max(abs(self.load), 1.0)

    def interval_end(self, low: float) -> float:
        """Return the upper end of the next interval of λ to exclude, which begins at `low`.

        It lies a little above the lowest solution found. Both ends are scaled.
        """
        return self.load + _ROOM * (self.load - low) + _LEAST_ROOM * self.load_unit

    def load_below(self, share: float) -> float:
        """Return the scaled λ of the lowest solution found, reduced by a relative share."""
        return self.load - share * self.load_unit

    def closes_gap(self, bound: float) -> bool:
        """Return True if a bound meets the lowest solution found within the gap tolerance."""
        return bound >= self.load_below(tolerances.GAP)

    def gains_enough(self, low: float, bound: float, share: float = _STALL) -> bool:
        """Return True if a step that raises the bound from `low` to `bound` gains enough.

        share: fraction of the distance from `low` to the lowest solution found that the step must exceed.
        """
        return bound - low > share * (self.load - low)

    def less_solver_tolerance(self, bound: float) -> float:
        """Reduce a scaled bound that the solver claims by the solver's tolerance on λ.

        The bound is first limited to the lowest solution found.
        """
        return min(bound, self.load) - _TRUSTED * self.load_unit

    def offer_states(self, states: Floats) -> None:
        """Search for solutions from given states, and update the lowest λ found.

        states: (k, q + 1) scaled forces and λ. Nothing happens without the function `offer` of the constructor.
        """
        if self._offer is not None:
            self.load = min(self.load, self._offer(states))

    def allows_products(self, faces: int, most: int, force_bounds: Floats) -> bool:
        """Return True if the RLT relaxation may be formed; otherwise log the reason.

        faces: number of faces. most: limit of this number, unless the time budget reaches `PATIENT`. force_bounds: (q +
        2,) bounds on forces, which must be finite.
        """
        if faces > most and self._seconds < PATIENT:
            self.record(f"no products: {faces} faces")
        elif not np.isfinite(force_bounds).all():
            self.record("no products: self-stress is not bounded")
        else:
            return True
        return False

    def result(self, proven: float, believed: float) -> LowerBound:
        """Build the result of the search from the proven bound and the believed one.

        proven: by certificates. believed: may rely on the solver. Both are scaled. The proven bound is taken if it is
        as high as the believed one, up to the gap tolerance.
        """
        sure = proven >= believed - tolerances.GAP * self.load_unit
        bound = proven if sure else believed
        return LowerBound(
            proven=proven,
            bound=bound,
            tolerance=0.0 if sure else _TRUSTED,
            closed=self.closes_gap(bound),
            programs=self.programs,
            seconds=self.seconds_used,
            solve_log=tuple(self.solve_log),
        )
