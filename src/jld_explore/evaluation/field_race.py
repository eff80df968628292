"""Race layouts by fields: refine only those that may still be the strongest.

Every velocity field bounds λ of all layouts from above, every stress field λ of many from below. The layout with the
greatest upper bound is refined next; once its own bracket is closed, no other layout has a greater upper bound, and the
race is decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Floats
from jld_explore.evaluation.field_pool import TOGETHER, FieldPool
from jld_explore.evaluation.race_aims import BestAim, RaceAim


@dataclass(frozen=True)
class RaceResult:
    """Bounds on the governing factor of raced layouts.

    low, high: (k, c) bounds on λ of each layout under each load case, scene units; infinite where there is none. gap:
    relative distance between the best lower and the greatest upper bound on the governing factor. refined: number of
    layouts that were refined. programs: number of cone programs solved. decided: True if the aim asks for no further
    refinement. best: (float, float) greatest lower and greatest upper bound on the governing factor. rivals: number of
    layouts whose upper bound is at least the best lower bound, the best layout included.
    """

    low: Floats
    high: Floats
    gap: float
    refined: int
    programs: int
    decided: bool
    best: tuple[float, float]
    rivals: int


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
