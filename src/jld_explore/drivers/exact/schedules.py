"""Choose the next λ to refute, and decide when annealing interrupts the proof.

The next λ leaves the whole gap if that is small, otherwise a fraction of it. The fraction adapts to the number of
conflicts that each step needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

# Gap, relative to the bound, up to which the whole gap is tried at once. Intermediate steps would need a third more
# conflicts in total.
_WHOLE_GAP: Final = 0.2

_FIRST_FRACTION: Final = 0.5  # first step of a wider gap, as a fraction of the gap

_LAST_FRACTION: Final = 0.75  # fraction of the gap from which a step covers the whole gap

_LEAST_STEP: Final = 2e-3  # smallest step, relative to the bound

_GROWTH: Final = 1.5  # factor by which the fraction grows after a step that needed few conflicts
_QUICK_SHARE: Final = 0.25  # share of the allowed conflicts below which a step counts as quick

# Factor on the allowed conflicts of the next step after a step that exceeded them. On the 8 × 10 wall in blocks of
# three 22 thousand conflicts leave nothing above 0.723, and 26 thousand nothing above 0.70.
_MORE_CONFLICTS: Final = 4


@dataclass(frozen=True)
class ScheduledStep:
    """One λ to refute on the way to the best λ of a target.

    threshold: the λ, scene units. conflicts: number of conflicts known when the step began.
    """

    threshold: float
    conflicts: int


class TargetSchedule:
    """Sequence of λ targets from a bound down to the best λ known.

    Each step is a fraction of the remaining gap. After a step that takes too long the next one is half that fraction
    and may need more conflicts. Conflicts found on the way also hold for higher targets.

    conflicts_allowed: conflicts that a step may take at first.
    """

    def __init__(self, conflicts_allowed: int) -> None:
        self._conflicts_allowed = conflicts_allowed
        self._fraction: float | None = None

    def next_target(self, bound: float, low: float) -> float:
        """Return the next λ to refute, between `low` and `bound`; `low` covers the whole gap.

        bound: bound on λ of all labellings. low: λ that labellings must exceed in the end.
        """
        gap = bound - low
        if not math.isfinite(bound) or gap <= 0.0:
            return low
        if self._fraction is None:
            self._fraction = 1.0 if gap <= _WHOLE_GAP * abs(bound) else _FIRST_FRACTION
        return low if self._fraction >= _LAST_FRACTION else bound - self._fraction * gap

    def note_proven(self, conflicts: int) -> None:
        """Record a proven step and its number of conflicts; after few of them steps grow."""
        if self._fraction is not None and conflicts < _QUICK_SHARE * self._conflicts_allowed:
            self._fraction *= _GROWTH

    def is_stuck(self, conflicts: int, bound: float, aimed: float) -> bool:
        """Return True if the current step should be replaced by a smaller one.

        The next step is then half as wide.

        conflicts: conflicts found in the current step. bound, aimed: bound on λ, and λ of the current step.
        """
        if conflicts < self._conflicts_allowed or not bound - aimed > _LEAST_STEP * abs(bound):
            return False
        self._fraction = _FIRST_FRACTION * min(1.0 if self._fraction is None else self._fraction, 1.0)
        self._conflicts_allowed *= _MORE_CONFLICTS
        return True


_FIRST_INTERVAL: Final = 4000  # relaxations before annealing first runs during a proof; the interval then doubles

# Labellings annealed per relaxation since the last run, with and without batch solver. Annealing then takes some 10 to
# 15 % of the time.
_LABELLINGS_PER_RELAXATION: Final = (0.025, 0.15)

_LONG_PROOF: Final = 60_000  # number of relaxations from which a proof counts as long
# Least number of labellings annealed per relaxation in a long proof. There a relaxation takes half as long as the
# evaluation of a labelling (0.24 and 0.5 ms for the crushable arch), in small walls a seventh.
_LABELLINGS_IN_LONG_PROOF: Final = 0.06


class AnnealingSchedule:
    """Schedule for interleaving annealing with the proof.

    batched: whether the batch solver solves the relaxations. disabled: whether to do without annealing.
    """

    def __init__(self, *, batched: bool, disabled: bool) -> None:
        self._share = _LABELLINGS_PER_RELAXATION[not batched]
        self._interval = math.inf if disabled else _FIRST_INTERVAL
        self._last_run = 0

    def labellings_due(self, relaxations: int) -> int:
        """Return the number of labellings to anneal now, 0 if annealing is not due.

        A number above 0 starts the next interval, so anneal them. relaxations: number of relaxations solved so far.
        """
        since = relaxations - self._last_run
        if since < self._interval:
            return 0
        self._last_run, self._interval = relaxations, 2 * self._interval
        return int(since * (max(self._share, _LABELLINGS_IN_LONG_PROOF) if relaxations >= _LONG_PROOF else self._share))
