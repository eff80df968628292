"""Aims of a race of layouts, which select the layouts to refine next."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_explore.evaluation.field_pool import TOGETHER, FieldPool
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
        """Return `rows` sorted by upper bound, the greatest first."""
        return rows[np.argsort(-high[rows], kind="stable")]

    def enough(self, low: Floats) -> Floats:
        """Return the best lower bound, the same for all layouts."""
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
        """Return the required factor for all layouts."""
        return np.full(len(low), self._required)


def _near(best: Floats, most: Floats, gap: float) -> Bools:
    """Return True where both bounds are finite and differ by at most a relative gap."""
    known = np.isfinite(best) & np.isfinite(most)
    low, high = np.where(known, best, 0.0), np.where(known, most, 0.0)
    return np.asarray(known & (high - low <= gap * np.maximum(abs(high), abs(low))))


@dataclass(frozen=True)
class RaceResult:
    """Bounds on the governing factor of raced layouts."""

    # low, high: (k, c) bounds on λ of each layout under each load case, scene units; infinite where there is none
    low: Floats
    high: Floats
    gap: float  # relative distance between the best lower and the greatest upper bound on the governing factor
    refined: int  # number of layouts that were refined
    programs: int  # number of cone programs solved
    decided: bool  # True if the aim asks for no further refinement
    best: tuple[float, float]  # greatest lower and greatest upper bound on the governing factor
    rivals: int  # number of layouts whose upper bound is at least the best lower bound, the best layout included


class FieldRace:
    """Race of the layouts of a pool: those that may still be the strongest get finer meshes.

    pool: layouts with the bounds that are known. gap: relative distance between the best lower and the greatest upper
    bound at which the race is decided. report: function called with the bounds (k,) on the governing factor while the
    race goes on. aim: aim of the race. Default: to find the strongest layout.
    """

    def __init__(
        self,
        pool: FieldPool,
        gap: float,
        report: Callable[[Floats, Floats], None] | None = None,
        aim: RaceAim | None = None,
    ) -> None:
        self.pool, self._gap, self._report = pool, gap, report
        self._aim: RaceAim = BestAim() if aim is None else aim

    def run(self) -> RaceResult:
        """Race until the aim is reached to the gap, nothing can be refined, or time is up.

        Result: bounds of all layouts, each proven.
        """
        pool, begun = self.pool, False
        # one layout is bounded however short the time is
        while len(pool) and (not begun or not pool.deadline.passed()):
            low, high = pool.low(), pool.high()
            if self._report is not None:
                self._report(low, high)
            begun |= bool(np.isfinite(high).any())
            left = ~pool.given_up & self._aim.open(low, high, pool.closed(self._gap), self._gap)
            if not left.any():
                break
            order = self._aim.order(np.flatnonzero(left), high)
            if not pool.bounded[order[0]]:
                pool.bound_above(int(order[0]))
            else:
                pool.refine(order[pool.bounded[order]][:TOGETHER].tolist(), self._aim.enough(low))
        self._place()
        return self.result()

    def _place(self) -> None:
        """Bound from below, on the coarsest mesh, the layouts that may be the strongest.

        These are layouts without a lower bound whose upper bound is at least the best lower bound. Layouts with the
        greatest upper bounds come first. At the deadline the method returns early if some layout has a lower bound.
        """
        pool = self.pool
        low, high = pool.low(), pool.high()
        rows = np.flatnonzero((high >= low.max(initial=-np.inf)) & ~np.isfinite(low))
        for row in rows[np.argsort(-high[rows], kind="stable")].tolist():
            if pool.deadline.passed() and math.isfinite(pool.low().max()):
                return
            pool.bound_below(row)

    def result(self) -> RaceResult:
        """Return the bounds of all layouts as they are known, also before the race has ended."""
        pool = self.pool
        low, high = pool.low(), pool.high()
        best, most = float(low.max(initial=-np.inf)), float(high.max(initial=-np.inf))
        gap = (most - best) / max(abs(most), abs(best), 1e-300) if math.isfinite(best) else math.inf
        decided = not self._aim.open(low, high, pool.closed(self._gap), self._gap).any() and math.isfinite(best)
        rivals = int((high >= best).sum())
        bounds, least = pool.bounds, max(gap, 0.0)
        return RaceResult(*bounds, least, pool.refined, pool.programs, decided, (best, most), rivals)
