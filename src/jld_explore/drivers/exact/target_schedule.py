"""Which λ is refuted next: all of a gap that is not wide, or else parts of it, as large as proofs are quick."""

from __future__ import annotations

import math
from typing import Final

_NEAR: Final = 0.2
"""Gap, beside the bound, up to which all of it is tried at once: steps on the way are a third more conflicts in all."""

_HALF: Final = 0.5
"""First step of a wider gap, beside the gap."""

_LAST: Final = 0.75
"""A step of this part of the gap or more goes all the way."""

_LEAST: Final = 2e-3
"""Smallest step, beside the bound."""

_WIDER: Final = 1.5
_QUICK: Final = 0.25
"""A step that took less than this part of its patience is followed by one as much wider."""

_LONGER: Final = 4
"""How many times as many conflicts the next step may take after one that took too many: on the 8 × 10 wall in blocks of
three 22 thousand leave nothing above 0.723, and 26 thousand nothing above 0.70."""


class TargetSchedule:
    """Steps from a bound down to the λ of the best labelling known. patience: conflicts a step may take at first.

    A step is a part of the gap that is left. Where it takes too long the next is half of that part, and may take more:
    what was found on the way is as true higher up.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._part: float | None = None

    def aim(self, bound: float, low: float) -> float:
        """λ to be refuted next. bound: above all λ; low: to be exceeded in the end."""
        gap = bound - low
        if not math.isfinite(bound) or gap <= 0.0:
            return low
        if self._part is None:
            self._part = 1.0 if gap <= _NEAR * abs(bound) else _HALF
        return low if self._part >= _LAST else bound - self._part * gap

    def proven(self, conflicts: int) -> None:
        """Take note of a step that was proven, and of the conflicts it took."""
        if self._part is not None and conflicts < _QUICK * self._patience:
            self._part *= _WIDER

    def stuck(self, conflicts: int, bound: float, aimed: float) -> bool:
        """Whether to step less far instead of going on; the next step is then half as wide."""
        if conflicts < self._patience or not bound - aimed > _LEAST * abs(bound):
            return False
        self._part = _HALF * min(1.0 if self._part is None else self._part, 1.0)
        self._patience *= _LONGER
        return True
