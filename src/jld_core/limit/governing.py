"""Several load cases, one number: the governing factor, min over cases of λ / required."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from jld_core.limit.status import Status


@dataclass(frozen=True)
class Known:
    """What is known of one load case: its status, proven ends (NaN where there is none) and λ (NaN where none)."""

    status: Status
    low: float
    high: float
    load_factor: float


@dataclass(frozen=True)
class Governing:
    """What is known of the governing factor.

    case: position of the case that governs; of several whose brackets overlap the first, so that two routes to the same
    λ name the same one.
    """

    status: Status
    low: float
    high: float
    load_factor: float
    case: int


def governing(cases: Sequence[Known], required: Sequence[float]) -> Governing:
    """The governing factor of a labelling from what is known of its load cases.

    cases: at least one. required: factor of each. A labelling is unstable if any case is, and locked if all are: a case
    that carries any load governs no other. Both proven ends are the least of the cases' own: an end that one case
    lacks is lacking, unless another's is below anything it could be.
    """
    nan, inf = math.nan, math.inf
    for status in (Status.FAILED, Status.UNSTABLE):
        for position, case in enumerate(cases):
            if case.status is status:
                return Governing(status, nan, nan, nan, position)
    lows, highs, values = [], [], []
    for case, factor in zip(cases, required, strict=True):
        locked = case.status is Status.LOCKED
        lows.append(inf if locked else -inf if math.isnan(case.low) else case.low / factor)
        highs.append(inf if locked or math.isnan(case.high) else case.high / factor)
        values.append(inf if locked else nan if math.isnan(case.load_factor) else case.load_factor / factor)
    if all(case.status is Status.LOCKED for case in cases):
        least = [case.low / factor for case, factor in zip(cases, required, strict=True)]
        position = min(range(len(cases)), key=lambda k: math.inf if math.isnan(least[k]) else least[k])
        return Governing(Status.LOCKED, least[position], nan, nan, position)
    first = min(range(len(cases)), key=lambda k: (lows[k], highs[k]))
    position = min(range(len(cases)), key=lambda k: (highs[k], lows[k]))
    low, high = lows[first], highs[position]
    if cases[first].status is Status.COLLAPSE:
        # the case with the least lower end is certain to within its width, and the least upper end is no higher
        alike = (k for k, case in enumerate(cases) if case.status is Status.COLLAPSE and lows[k] <= high)
        return Governing(Status.COLLAPSE, low, high, 0.5 * (low + high), next(alike))
    known = [value for value in values if not math.isnan(value)]
    both = math.isfinite(low) and math.isfinite(high)
    guess = 0.5 * (low + high) if both else min(known, default=nan)
    if not math.isfinite(guess):
        guess = nan
    return Governing(
        Status.UNCERTIFIED, low if math.isfinite(low) else nan, high if math.isfinite(high) else nan, guess, position
    )
