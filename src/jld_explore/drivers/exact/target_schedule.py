"""Choose the next λ to refute: the whole gap if small, otherwise a fraction of the gap.

The fraction adapts to the number of conflicts that each step needs.
"""

from __future__ import annotations

import math
from typing import Final

_NEAR: Final = 0.2
"""Gap, relative to the bound, up to which the whole gap is tried at once.

Intermediate steps would need a third more conflicts in total.
"""

_HALF: Final = 0.5
"""First step of a wider gap, as a fraction of the gap."""

_LAST: Final = 0.75
"""Fraction of the gap from which a step covers the whole gap."""

_LEAST: Final = 2e-3
"""Smallest step, relative to the bound."""

_WIDER: Final = 1.5
"""Factor by which the fraction grows after a step that needed few conflicts."""
_QUICK: Final = 0.25
"""Share of the allowed conflicts below which a step counts as quick."""

_LONGER: Final = 4
"""Factor on the allowed conflicts of the next step after a step that exceeded them.

On the 8 × 10 wall in blocks of three 22 thousand conflicts leave nothing above 0.723, and 26 thousand nothing above
0.70.
"""


class TargetSchedule:
    """Sequence of λ targets from a bound down to the best λ known.

    Each step is a fraction of the remaining gap. After a step that takes too long the next one is half that fraction
    and may need more conflicts. Conflicts found on the way also hold for higher targets.

    Parameters
    ----------
    patience : int
        Conflicts that a step may take at first.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._part: float | None = None

    def aim(self, bound: float, low: float) -> float:
        """Return the next λ to refute.

        Parameters
        ----------
        bound : float
            Bound on λ of all labellings.
        low : float
            λ that labellings must exceed in the end.
        """
        gap = bound - low
        if not math.isfinite(bound) or gap <= 0.0:
            return low
        if self._part is None:
            self._part = 1.0 if gap <= _NEAR * abs(bound) else _HALF
        return low if self._part >= _LAST else bound - self._part * gap

    def proven(self, conflicts: int) -> None:
        """Record a proven step and the number of conflicts it took."""
        if self._part is not None and conflicts < _QUICK * self._patience:
            self._part *= _WIDER

    def stuck(self, conflicts: int, bound: float, aimed: float) -> bool:
        """Return True if the current step should be replaced by a smaller one.

        The next step is then half as wide.

        Parameters
        ----------
        conflicts : int
            Conflicts found in the current step.
        bound, aimed : float
            Bound on λ, and λ of the current step.
        """
        if conflicts < self._patience or not bound - aimed > _LEAST * abs(bound):
            return False
        self._part = _HALF * min(1.0 if self._part is None else self._part, 1.0)
        self._patience *= _LONGER
        return True
