"""What a race of layouts is to find out, and so which of them are refined next."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_explore.evaluation.ranking import Envelope


class RaceAim(Protocol):
    """Aim of a race: which layouts are refined next, and when the race is decided.

    All arrays are over its k layouts; `low` and `high` are their proven bounds on the governing factor.
    """

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return (k,) True for the layouts to refine before the race is decided, none once it is.

        closed: (k,) True where the bounds of a layout lie within the relative `gap` of the race.
        """
        ...

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return `rows`, the numbers of the open layouts, in the order in which they are refined."""
        ...

    def enough(self, low: Floats) -> Floats:
        """Return (k,) factors below which the lower bound of a layout does not matter.

        A layout whose upper bound is below its factor needs no lower bound.
        """
        ...


class BestAim:
    """Find the strongest layout."""

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return the layouts that may be stronger than the best; see `RaceAim`."""
        best, most = low.max(initial=-np.inf), high.max(initial=-np.inf)
        if _near(np.asarray(best), np.asarray(most), gap):
            return np.zeros(len(low), dtype=bool)
        return np.asarray(~closed & (high > best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return the layout with the greatest upper bound first; see `RaceAim`."""
        return rows[np.argsort(-high[rows], kind="stable")]

    def enough(self, low: Floats) -> Floats:
        """Return the best lower bound, alike for all; see `RaceAim`."""
        return np.full(len(low), low.max(initial=-np.inf))


class FrontAim(BestAim):
    """Find the strongest layout for every count.

    Parameters
    ----------
    counts : (k, c) float array
        Counts of the layouts, less is better.
    """

    def __init__(self, counts: Floats) -> None:
        self._counts = counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return the layouts that may be stronger than all of equal or better counts.

        See `RaceAim.open`.
        """
        return np.asarray(~closed & ~_near(self.enough(low), high, gap) & (high > self.enough(low)))

    def enough(self, low: Floats) -> Floats:
        """Return the best lower bound among equal or better counts; see `RaceAim`."""
        envelope = Envelope(self._counts.shape[1])
        known = np.isfinite(low)
        envelope.learn(low[known], self._counts[known])
        return envelope.best(self._counts)


class RequirementAim:
    """Find the best count among layouts that carry a required factor.

    Parameters
    ----------
    required : float
        Required governing factor.
    counts : (k,) float array
        Count of each layout, less is better.
    """

    def __init__(self, required: float, counts: Floats) -> None:
        self._required, self._counts = required, counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return the layouts of better count that may carry the factor and are not known to.

        See `RaceAim.open`.
        """
        met = low >= self._required
        best = self._counts[met].min(initial=np.inf)
        return np.asarray(~met & (high >= self._required) & (self._counts < best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return the layouts by count, best first, and by upper bound where counts are equal.

        See `RaceAim.order`.
        """
        return rows[np.lexsort((-high[rows], self._counts[rows]))]

    def enough(self, low: Floats) -> Floats:
        """Return the required factor; see `RaceAim`."""
        return np.full(len(low), self._required)


def _near(best: Floats, most: Floats, gap: float) -> Bools:
    """Return where both bounds are finite and differ by at most a relative gap."""
    known = np.isfinite(best) & np.isfinite(most)
    low, high = np.where(known, best, 0.0), np.where(known, most, 0.0)
    return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))
