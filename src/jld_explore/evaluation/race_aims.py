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
    """Aim of a race over k layouts with bounds on their governing factors: what to refine, and when it ends."""

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        """Return the layouts (k,) to refine, by bounds (k,) and those closed to a gap; all False at the end."""
        ...

    def order(self, rows: Ints, high: Floats) -> Ints:
        """Return the indices `rows` of open layouts in the order in which they are refined."""
        ...

    def enough(self, low: Floats) -> Floats:
        """Return the factor (k,) of each layout below which its lower bound does not matter."""
        ...


class BestAim:
    """Aim of a race for the strongest layout: refine until no other layout can be stronger."""

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        best, most = low.max(initial=-np.inf), high.max(initial=-np.inf)
        if _near(np.asarray(best), np.asarray(most), gap):
            return np.zeros(len(low), dtype=bool)
        return np.asarray(~closed & (high > best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        return rows[np.argsort(-high[rows], kind="stable")]

    def enough(self, low: Floats) -> Floats:
        return np.full(len(low), low.max(initial=-np.inf))


class FrontAim(BestAim):
    """Aim to find the strongest layout for every combination of counts, where less is better."""

    def __init__(self, counts: Floats) -> None:
        self._counts = counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        return np.asarray(~closed & ~_near(self.enough(low), high, gap) & (high > self.enough(low)))

    def enough(self, low: Floats) -> Floats:
        envelope = Envelope(self._counts.shape[1])
        known = np.isfinite(low)
        envelope.learn(low[known], self._counts[known])
        return envelope.best(self._counts)


class RequirementAim:
    """Aim to find the best count among layouts that carry a required factor."""

    def __init__(self, required: float, counts: Floats) -> None:
        self._required, self._counts = required, counts

    def open(self, low: Floats, high: Floats, closed: Bools, gap: float) -> Bools:
        met = low >= self._required
        best = self._counts[met].min(initial=np.inf)
        return np.asarray(~met & (high >= self._required) & (self._counts < best))

    def order(self, rows: Ints, high: Floats) -> Ints:
        return rows[np.lexsort((-high[rows], self._counts[rows]))]

    def enough(self, low: Floats) -> Floats:
        return np.full(len(low), self._required)


def _near(best: Floats, most: Floats, gap: float) -> Bools:
    """Return where both bounds are finite and differ by at most a relative gap."""
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
    """Race of the layouts of a pool: those that may still be the strongest get finer meshes."""

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
        """Race until the aim is reached to the gap, nothing can be refined, or time is up."""
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
        """Bound from below, on the coarsest mesh, the layouts that may be the strongest."""
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
