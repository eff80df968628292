"""Aims of a race of layouts, which select the layouts to refine next."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_explore.evaluation.ranking import Envelope


class RaceAim(Protocol):
    """Aim of a race: it selects the layouts to refine next, and says when the race is decided.

    All arrays are over its k layouts; `low` and `high` are their proven bounds on the governing factor.
    """

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return a mask (k,) of the layouts to refine; all False once the race is decided.

        low, high: (k,) bounds. closed: (k,) True where both bounds of a layout lie within the relative `gap`.
        """
        ...

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return the indices `rows` of open layouts in the order in which they are refined.

        high: (k,) upper bounds.
        """
        ...

    def enough(self, low: Floats) -> Floats:
        """Return the factor (k,) of each layout below which its lower bound does not matter.

        A layout whose upper bound is below its factor needs no lower bound.
        """
        ...


class BestAim:
    """Aim of a race for the strongest layout: refine until no other layout can be stronger.

    Implements `RaceAim`; layouts are refined in order of their upper bounds.
    """

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return a mask (k,) of the layouts that may be stronger than the best lower bound.

        See `RaceAim.open`.
        """
        best, most = low.max(initial=-np.inf), high.max(initial=-np.inf)
        if _near(np.asarray(best), np.asarray(most), gap):
            return np.zeros(len(low), dtype=bool)
        return np.asarray(~closed & (high > best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return `rows` sorted by upper bound, the greatest first; see `RaceAim.order`."""
        return rows[np.argsort(-high[rows], kind="stable")]

    def enough(self, low: Floats) -> Floats:
        """Return the best lower bound, the same for all layouts; see `RaceAim.enough`."""
        return np.full(len(low), low.max(initial=-np.inf))


class FrontAim(BestAim):
    """Aim to find the strongest layout for every combination of counts.

    counts: (k, c) counts of the layouts, less is better.
    """

    def __init__(self, counts: Floats) -> None:
        self._counts = counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return a mask (k,) of layouts that may be stronger than all of equal or better counts.

        See `RaceAim.open`.
        """
        return np.asarray(~closed & ~_near(self.enough(low), high, gap) & (high > self.enough(low)))

    def enough(self, low: Floats) -> Floats:
        """Return, for each layout, the best lower bound among equal or better counts.

        See `RaceAim.enough`.
        """
        envelope = Envelope(self._counts.shape[1])
        known = np.isfinite(low)
        envelope.learn(low[known], self._counts[known])
        return envelope.best(self._counts)


class RequirementAim:
    """Aim to find the best count among layouts that carry a required factor.

    required: required governing factor. counts: (k,) count of each layout, less is better.
    """

    def __init__(self, required: float, counts: Floats) -> None:
        self._required, self._counts = required, counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return a mask (k,) of layouts that may carry the factor and would improve the count.

        The factor is not proven for them yet, and their counts are better than the best proven one. See `RaceAim.open`.
        """
        met = low >= self._required
        best = self._counts[met].min(initial=np.inf)
        return np.asarray(~met & (high >= self._required) & (self._counts < best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return `rows` sorted by count, then by upper bound, the best first.

        See `RaceAim.order`.
        """
        return rows[np.lexsort((-high[rows], self._counts[rows]))]

    def enough(self, low: Floats) -> Floats:
        """Return the required factor for all layouts; see `RaceAim.enough`."""
        return np.full(len(low), self._required)


def _near(best: Floats, most: Floats, gap: float) -> Bools:
    """Return True where both bounds are finite and differ by at most a relative gap.

    best, most: lower and upper bounds, arrays of equal or broadcastable shapes.
    """
    known = np.isfinite(best) & np.isfinite(most)
    low, high = np.where(known, best, 0.0), np.where(known, most, 0.0)
    return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))
