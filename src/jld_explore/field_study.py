"""Search a space whose layouts can be enumerated by a race of bounds by fields."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jld_core.arrays import Bits
from jld_core.scene.cracks import FieldCracks
from jld_explore.evaluation.field_evaluator import field_evaluation
from jld_explore.evaluation.field_race import FieldRace, RaceResult
from jld_explore.space.labelling import orbit_sizes
from jld_explore.study import Study
from jld_explore.study_state import Progress, StopReason

if TYPE_CHECKING:
    import pandas as pd

    from jld_core.arrays import Floats


class FieldStudy(Study):
    """Study whose layouts race: all are bounded together, and only what may be the strongest is refined.

    Parameters and attributes are those of `Study`; the driver is exhaustive and the scene cracks by fields.
    """

    race: RaceResult | None = None
    _complete = False

    def run(self) -> StopReason:
        """Enumerate all layouts, race them, and record the bounds of each.

        Returns
        -------
        StopReason
            Exhausted where all layouts were enumerated and the race came to its end, else time.

        Raises
        ------
        Interrupted
            If a signal arrives; bounds known by then are recorded first.
        """
        cracks = self.scene.cracks
        assert isinstance(cracks, FieldCracks)
        race: FieldRace | None = None
        try:
            labellings = self._enumerated()
            race = FieldRace(self.assembly, labellings, cracks.gap, self.deadline, self.settings.jobs, self._shown)
            self.race = race.run()
        finally:
            try:
                if race is not None:
                    self._record(race)
            finally:
                self.driver.close()
                self.records.close()
        late = self.deadline.passed() or not self._complete
        return StopReason.TIME if late else StopReason.EXHAUSTED

    def facts(self, results: pd.DataFrame) -> dict[str, Any]:
        """Return what the race proves: the bound over all layouts, its gap, and whether one layout is the strongest."""
        race = self.race
        if race is None:
            return {}
        bound = _finite(float((race.high / self.assembly.required).min(axis=1).max(initial=-math.inf)))
        bound = bound if self._complete else None
        gap = _finite(race.gap) if self._complete else None
        first = results[results["rank"] == 1]
        alone = bound is not None and len(first) == 1 and not self._tied(race, first)
        cracks = self.scene.cracks
        assert isinstance(cracks, FieldCracks)
        return {
            "proven": bool(alone),
            "bound": bound,
            "gap": gap,
            "next": None if alone else self._next(gap, cracks.gap),
            "race": {
                "refined": race.refined,
                "programs": race.programs,
                "decided": gap is not None and gap <= cracks.gap,
                "tied": int((results["rank"] == 1).sum()),
            },
        }

    def _tied(self, race: RaceResult, first: pd.DataFrame) -> bool:
        """Return whether another layout may carry more than the first row is proven to."""
        high = (race.high / self.assembly.required).min(axis=1)
        return int((high >= float(first["bracket_lo"].iloc[0])).sum()) > 1

    def _next(self, gap: float | None, wanted: float) -> str:
        """Say whether the gap that is left is of the discretisation or of the search, and what narrows it."""
        if gap is None:
            return "the gap is of the search: time ended it before all layouts were bounded; more --seconds bound them"
        if self.deadline.passed() and gap > wanted:
            return "the gap is of the discretisation: time ended refinement; more --seconds narrow it"
        return f"the gap is of the discretisation: --cracks fields:{0.5 * wanted:g} refines further"

    def _enumerated(self) -> Bits:
        """Return all layouts (k, m), those found in time where there are too many."""
        self.driver.start(self.deadline, lambda: None, self.records)
        parts: list[Bits] = []
        while True:
            part = self._asked(None)
            if not len(part):
                break
            self.asked += len(part)
            parts.append(part)
        self._complete = not self._cut
        return np.concatenate(parts) if parts else np.empty((0, len(self.space.fixed)), dtype=bool)

    def _shown(self, low: Floats, high: Floats) -> None:
        """Report progress: layouts that are known to be weaker than the best, and the bracket."""
        if self.report is None:
            return
        best, bound = float(low.max(initial=-math.inf)), float(high.max(initial=-math.inf))
        known = math.isfinite(best) and math.isfinite(bound)
        gap = (bound - best) / max(abs(bound), abs(best), 1e-300) if known else math.nan
        done = int((high < best).sum())
        ends = (best if math.isfinite(best) else math.nan, bound if math.isfinite(bound) else math.nan)
        self.report(Progress(done, self.total, 0, ends[0], self.elapsed, ends[1], gap))

    def _record(self, race: FieldRace) -> None:
        """Record the bounds of all layouts."""
        labellings, required = race.labellings, self.assembly.required
        best = float(race.low().max(initial=-math.inf))
        low, high = race.bounds
        found = [field_evaluation(*ends, required, best=best) for ends in zip(low, high, strict=True)]
        self.records.append(labellings, orbit_sizes(labellings, self.space.group).tolist(), found)
        self.evaluated, self.solved = len(found), race.programs


def _finite(value: float) -> float | None:
    """Return a number for JSON, None for one that is not finite."""
    return value if math.isfinite(value) else None
