"""Governing factor of several load cases: the minimum over cases of λ / required factor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from jld_core import tolerances
from jld_core.limit.status import Status


@dataclass(frozen=True)
class CaseBounds:
    """Status and bounds of one load case.

    Attributes
    ----------
    status : Status
        Outcome of the case.
    low, high : float
        Proven bounds on λ; NaN where a bound is missing.
    load_factor : float
        λ of the case; NaN where there is none.
    """

    status: Status
    low: float
    high: float
    load_factor: float


@dataclass(frozen=True)
class Governing:
    """Status and bounds of the governing factor of a structure.

    Attributes
    ----------
    status : Status
        Outcome of the structure.
    low, high : float
        Proven bounds on the governing factor; NaN where a bound is missing.
    load_factor : float
        Governing factor; NaN where there is none.
    case : int
        Index of the governing case: the one of least upper bound. Of several with the same, as far as brackets tell, it
        is the first. Two solution methods that find the same λ thus name the same case.
    """

    status: Status
    low: float
    high: float
    load_factor: float
    case: int


def governing(cases: Sequence[CaseBounds], required: Sequence[float]) -> Governing:
    """Compute the governing factor of a labelling from the bounds of its load cases.

    The first of these statuses that applies counts: failed if any case is, unstable if any case is, locked if all cases
    are, collapse if both bounds are known and the case of least lower bound has this status or lacks an upper bound,
    uncertified. A locked case carries any load and never governs. The lower bound is the least of all cases,
    missing if one case has none. The upper bound is the least of those that are known.

    Parameters
    ----------
    cases : sequence of CaseBounds
        Status and bounds of each case; at least one.
    required : sequence of float
        Required factor of each case.

    Returns
    -------
    Governing
        Status, bounds, value and index of the governing case.
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
    proven = [case.status is Status.COLLAPSE or math.isnan(case.high) for case in cases]
    if proven[first] and math.isfinite(low) and math.isfinite(high):
        near = high + (high - low) + tolerances.GAP * abs(high)
        alike = (k for k in range(len(cases)) if proven[k] and lows[k] <= high and highs[k] <= near)
        value = min((value for value in values if not math.isnan(value)), default=low)
        return Governing(Status.COLLAPSE, low, high, min(max(value, low), high), next(alike, first))
    known = [value for value in values if not math.isnan(value)]
    both = math.isfinite(low) and math.isfinite(high)
    guess = 0.5 * (low + high) if both else min(known, default=nan)
    if not math.isfinite(guess):
        guess = nan
    return Governing(
        Status.UNCERTIFIED, low if math.isfinite(low) else nan, high if math.isfinite(high) else nan, guess, position
    )
