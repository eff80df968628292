"""Search by fields: race all layouts, race the best of a driver, or prove the strongest."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.limit.options import Status
from jld_core.scene.cracks import FieldCracks
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.field_exact import FieldExact
from jld_explore.evaluation.field_evaluator import (
    COARSE_RATE,
    BestAim,
    FieldPool,
    FieldRace,
    FrontAim,
    RaceAim,
    RaceResult,
    RequirementAim,
    field_evaluation,
    mesh_seconds,
)
from jld_explore.evaluation.protocol import Evaluation, front_counts, keys_of, statuses
from jld_explore.evaluation.records import RefinedRecords
from jld_explore.search.state import Progress, StopReason
from jld_explore.search.study import Study
from jld_explore.space import keys, unpack
from jld_explore.space.labelling import orbit_sizes

if TYPE_CHECKING:
    import pandas as pd

    from jld_core.arrays import Floats

_SEARCHED: Final = 0.6  # share of a time limit in which a driver proposes layouts; in the rest the best of them race

# Upper bound on λ of a layout on record that is known to fall whatever the load
_UNSTABLE: Final = -float(np.finfo(float).tiny)


class FieldStudy(Study):
    """Study of a scene whose blocks may crack anywhere."""

    race: RaceResult | None = None
    _complete = False  # whether every layout of the space is in the race
    _refined: RefinedRecords | None = None

    @property
    def gap(self) -> float:
        cracks = self.scene.cracks
        if not isinstance(cracks, FieldCracks):
            raise RuntimeError("a study by fields needs a scene that cracks by fields")
        return cracks.gap

    def _with_standing(self, labellings: Bits, evaluations: list[Evaluation]) -> list[Evaluation]:
        """Return evaluations as they are: a bound by fields is no λ at which the layout is known to stand."""
        return evaluations

    @property
    def evaluation_seconds(self) -> float:
        """Return the expected processor time of one evaluation on the coarsest mesh, s."""
        triangles = sum(len(self.assembly.elements.shape[element]) - 2 for element in self.assembly.elements.free)
        return len(self.assembly.by_case) * mesh_seconds(COARSE_RATE, triangles)

    @property
    def table_records(self) -> RefinedRecords:
        """Return the records whose evaluations have the bounds of finer meshes."""
        if self._refined is None:
            self._refined = RefinedRecords(self.records)
        return self._refined

    def run(self) -> StopReason:
        """Search by the driver, refine what matters, record all bounds; return why the search ended."""
        if isinstance(self.driver, Enumeration) and not self.settings.budget:
            return self._run_all()
        if isinstance(self.driver, FieldExact):
            return self._run_proof(self.driver)
        return self._run_search()

    def _run_all(self) -> StopReason:
        pool: FieldPool | None = None
        try:
            labellings = self._enumerate()
            pool = self._pool(labellings)
            self._race(pool)
        finally:
            try:
                if pool is not None:
                    self._record_bounds(pool)
            finally:
                self.driver.close()
                self.records.close()
        late = self.deadline.passed() or not self._complete
        return StopReason.TIME if late else StopReason.EXHAUSTED

    def _run_search(self) -> StopReason:
        """Search on the coarsest mesh, then race the layouts found."""
        deadline = self.deadline
        if deadline.limited:
            self._set_deadline(deadline.earlier((1.0 - _SEARCHED) * deadline.remaining()))
        reason = super().run()
        self._set_deadline(deadline)
        self._complete = reason is StopReason.EXHAUSTED
        self._reopen_records()
        pool = self._pool(unpack(self.records.rows["labelling"], len(self.assembly.interfaces)))
        try:
            self._race(pool)
        finally:
            self._record_bounds(pool)
            self.records.close()
        return reason

    def _run_proof(self, driver: FieldExact) -> StopReason:
        """Prove by the exact driver, then record the bounds that its fields and conflicts prove."""
        # Each layout on record gets its bounds. The result of the proof is also stored in `race`.
        try:
            return super().run()
        finally:
            self._reopen_records()
            pool = self._pool(unpack(self.records.rows["labelling"], len(self.assembly.interfaces)))
            pool.take_from(driver.pool)
            pool.cap(driver.bounds_above(pool.labellings))
            self.race = FieldRace(pool, self.gap).result()
            self._record_bounds(pool)
            self.records.close()

    def _update_progress(self, evaluations: list[Evaluation], labellings: Bits) -> None:
        """Update progress by new evaluations, and by the best bound of a proof so far."""
        if isinstance(self.driver, FieldExact) and self.driver.best >= 0.0 and not self.driver.best <= self._best:
            self._best = float(self.driver.best)  # the driver names its layout at the end
        super()._update_progress(evaluations, labellings)

    def _set_deadline(self, deadline: Any) -> None:
        self.deadline, self._search_end = deadline, deadline.end

    def _reopen_records(self) -> None:
        self.records, self._refined = self.open_records(), None

    def _race(self, pool: FieldPool) -> None:
        """Refine the layouts of a pool until the aim of the search is reached or time is up."""
        try:
            report = partial(self._report_race, pool.labellings)
            self.race = FieldRace(pool, self.gap, report, self._aim(pool.labellings)).run()
        finally:
            pool.tasks.close()

    def _aim(self, labellings: Bits) -> RaceAim:
        """Return the aim of a race of labellings (k, m): a count, the front or the strongest layout."""
        required = self.space.search.require
        if required is not None:
            return RequirementAim(required.threshold, front_counts(self.space, labellings)[:, 0])
        if self.driver.settings.get("aim") == "front":
            return FrontAim(front_counts(self.space, labellings))
        return BestAim()

    def _pool(self, labellings: Bits) -> FieldPool:
        """Return labellings with the bounds known from records, as a pool for the race."""
        rows = self.table_records.rows
        unstable = statuses(rows) == "unstable"
        high = np.where(unstable, _UNSTABLE, rows["high"])
        bounds_of = dict(zip(keys_of(rows), zip(rows["low"].tolist(), high.tolist(), strict=True), strict=True))
        unknown = (math.nan, math.nan)
        requested = keys(labellings)
        bounds = np.array([bounds_of.get(key, unknown) for key in requested]).reshape(-1, 2)
        count = len(self.assembly.cases)
        of_cases = dict(zip(keys_of(rows), rows["cases"][:, :count], strict=True))
        unbounded = np.full(count, np.nan)
        cases = np.array([of_cases.get(key, unbounded) for key in requested]).reshape(-1, count) if count else None
        pool = FieldPool(self.assembly, np.empty((0, labellings.shape[1]), dtype=bool), self.deadline)
        pool.tasks.jobs = self.settings.jobs
        pool.add(labellings, bounds[:, 0], bounds[:, 1], cases)
        return pool

    def facts(self, results: pd.DataFrame) -> dict[str, Any]:
        """Return the proven facts of the search, for the summary; empty before it has run."""
        # "bound": upper bound over all layouts. "gap": its relative distance to the best lower bound. "proven": True if
        # one layout is proven to be the strongest, or none stands. "next": sentence on how to narrow the gap. "race":
        # numbers of the race.
        race = self.race
        if race is None:
            return {}
        low, high = race.best
        bound = high if self._complete else self.bound
        gap = None
        # a lower bound below zero is no λ of a layout that stands
        if bound is not None and math.isfinite(bound) and low >= 0.0:
            gap = max((bound - low) / max(abs(bound), abs(low), 1e-300), 0.0)
        bound = bound if bound is not None and math.isfinite(bound) else None
        tied = int((results["rank"] == 1).sum())
        is_only = self._complete and bound is not None and tied == 1 and race.rivals <= 1
        falls = bound is not None and bound < 0.0
        ranked = results[results["status"] == str(Status.COLLAPSE)]
        fallen = ~ranked["stands_at_zero"].fillna(True).astype(bool)
        # the race compares λ alone: what falls under its dead load may have won it
        is_only &= not ranked.loc[fallen, "bracket_hi"].max() >= ranked["bracket_lo"].iloc[:1].max()
        return {
            "proven": bool(is_only) or falls,
            "bound": bound,
            "gap": gap,
            "next": None if is_only or falls else self._hint(race, gap),
            "race": {
                "refined": race.refined,
                "programs": race.programs,
                "decided": gap is not None and gap <= self.gap,
                "tied": tied,
            },
        }

    def _hint(self, race: RaceResult, gap: float | None) -> str | None:
        """Return a sentence on how to narrow the remaining gap, None if unknown, and on its cause."""
        # The reason is the discretisation or the search.
        finer = f"the gap is of the discretisation: --cracks fields:{0.5 * self.gap:g} refines further"
        if isinstance(self.driver, FieldExact):
            if self.driver.finished and self.space.search.require is not None:
                return self._hint_on_count()
            if self.driver.finished:
                narrow = gap is not None and gap <= self.gap
                return finer if narrow else "the gap is of the discretisation: some layouts have the finest mesh"
            return "the gap is of the search: time ended the proof; more --seconds, with --resume, narrow the bound"
        if not self._complete and (self.settings.budget or not isinstance(self.driver, Enumeration)):
            ended = "" if race.decided else " and time ended refinement of those that were"
            return f"layouts that were not evaluated have no bound{ended}: --driver exact bounds all"
        if gap is None or not self._complete:
            return "the gap is of the search: time ended it before all layouts were bounded; more --seconds bound them"
        if self.deadline.passed() and gap > self.gap:
            return "the gap is of the discretisation: time ended refinement; more --seconds narrow it"
        return finer

    def _hint_on_count(self) -> str | None:
        """Return a sentence on why the best count is not proven; None if it is."""
        if isinstance(self.driver, FieldExact) and self.driver.open_layouts:
            return "the gap is of the discretisation: some layouts of better count have the finest mesh"
        return None

    def _enumerate(self) -> Bits:
        """Return all layouts (k, m) of the driver, or those found until the deadline."""
        # The flag `_complete` becomes False if the deadline ended the enumeration.
        self.driver.start(self.deadline, lambda: None, self.records)
        parts: list[Bits] = []
        while True:
            part = self._ask(None)
            if not len(part):
                break
            parts.append(part)
        self._complete = not self._timed_out
        return np.concatenate(parts) if parts else np.empty((0, len(self.space.fixed)), dtype=bool)

    def _report_race(self, labellings: Bits, low: Floats, high: Floats) -> None:
        """Report progress of a race of labellings (k, m) with bounds low, high (k,)."""
        if self.report is None:
            return
        best, bound = float(low.max(initial=-math.inf)), float(high.max(initial=-math.inf))
        bounded = math.isfinite(best) and math.isfinite(bound)
        gap = (bound - best) / max(abs(bound), abs(best), 1e-300) if bounded else math.nan
        done = int((high < best).sum())
        ends = (best if math.isfinite(best) else math.nan, bound if math.isfinite(bound) else math.nan)
        text = self.text_of(labellings[int(low.argmax())]) if math.isfinite(best) else ""
        remaining = self.deadline.remaining()
        self.report(Progress(done, self.total, 0, ends[0], self.elapsed, ends[1], gap, text, remaining))

    def _record_bounds(self, pool: FieldPool) -> None:
        # New layouts are added to the record. If the record had evaluations before, refined bounds are kept beside
        # them.
        labellings, required = pool.labellings, self.assembly.required
        enough = self._aim(labellings).enough(pool.low())
        nominal = self._nominal(pool) if self.assembly.has_low_values else [None] * len(labellings)
        rows = zip(*pool.bounds, pool.high().tolist(), enough.tolist(), nominal, strict=True)
        evaluations: list[Evaluation] = [
            field_evaluation(low, high, required, most=most, best=best, nominal=value)
            for low, high, most, best, value in rows
        ]
        sizes = orbit_sizes(labellings, self.space.group).tolist()
        before = len(self.records)
        self.records.append(labellings, sizes, evaluations)
        if before:
            self.table_records.keep(labellings, sizes, evaluations)
        self.evaluated, self.solved = len(evaluations), max(self.solved, pool.programs)

    def _nominal(self, pool: FieldPool) -> list[float | None]:
        """Return lower bounds at nominal values, of the best layout alone; others NaN."""
        nominal: list[float | None] = [math.nan] * len(pool)
        strongest = int(np.argmax(pool.low())) if len(pool) else -1
        if strongest >= 0 and math.isfinite(pool.low()[strongest]):
            nominal_pool = FieldPool(self.assembly.at_nominal, pool.labellings[[strongest]], self.deadline)
            FieldRace(nominal_pool, self.gap).run()
            nominal[strongest] = float(nominal_pool.low()[0])
        return nominal
