"""Run a study of one scene with one driver and one record: ask, evaluate, tell, repeat."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.limit import load_scale, relative_width
from jld_core.limit.bounds import exceeds
from jld_core.limit.options import Status
from jld_core.models import cost_estimate
from jld_core.scene.schema import Scene
from jld_core.tolerances import GAP
from jld_explore.drivers.base import Driver
from jld_explore.drivers.choice import first_layout
from jld_explore.drivers.proof_beside import ProofBeside
from jld_explore.evaluation import EvaluatorSettings, Records, evaluator_of
from jld_explore.evaluation.cases import IncumbentFront, Standing, VoidStanding
from jld_explore.evaluation.field_evaluator import MakeCellEvaluator
from jld_explore.evaluation.protocol import Evaluation, MakeEvaluator
from jld_explore.evaluation.records import PendingEvaluations, RecordedEvaluator, RefinedRecords
from jld_explore.evaluation.workers import HANG_SECONDS, MOST_THREADS, Workers, WorkerSpec
from jld_explore.search.settings import ExploreSettings
from jld_explore.search.state import Progress, StopReason, name_of, versions
from jld_explore.space import cut, to_string, unpack
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


_ROW: Final = 1e-4  # time reserved from a limit for tables and page, s per recorded labelling; 90 000 took 9 s
PORTION: Final = 128  # largest number of labellings requested at a time if pruning thresholds can avoid solves


# Multiple of the expected time of an evaluation after which workers without a result count as hung
_HANGS: Final = 20.0


# Expected time of an evaluation, s, up to which the first one of a search is finished although a signal arrived
_SOON: Final = 1.6

# Share of the remaining time in which a driver must propose its first labelling; then another one is sought
_FIRST: Final = 0.6
_LEAST: Final = 1.0  # seconds to find a first labelling if the time limit passes before any evaluation
_NONE: Final = np.empty((0, 0), dtype=bool)  # labellings of an empty list of evaluations


class Study:
    """One search over labellings of a scene: call `run` once, then read the records."""

    def __init__(
        self,
        scene: Scene,
        assembly: Assembly,
        space: SearchSpace,
        driver: Driver,
        folder: Path,
        settings: ExploreSettings | None = None,
        *,
        total: int | None = None,
        report: Callable[[Progress], None] | None = None,
        found_first: Callable[[], None] = lambda: None,
        make: MakeEvaluator = evaluator_of,
        deadline: Deadline | None = None,
    ) -> None:
        # A study resumes by replay: the driver runs again from its seed and receives recorded results. Equal scene,
        # driver, seed and budget give equal rows for any number of jobs. found_first is called before the first
        # evaluation; until then the space may turn out to be empty.
        self.scene, self.assembly, self.space, self.driver, self.folder = scene, assembly, space, driver, folder
        self.settings, self.total, self.report = settings or ExploreSettings(), total, report
        self._make, self._found_first = make, found_first
        self.deadline = Deadline(self.settings.seconds) if deadline is None else deadline
        self._end, self._cut = self.deadline.end, False
        self._empty = False
        self.evaluated = self.asked = self.solved = 0
        self._beside: ProofBeside | None = None
        self._offered: Bits | None = None  # a layout (1, m) of the proof beside that is stronger than all evaluated
        self.bound_by: str | None = None
        self._best, self._floor = np.nan, load_scale(assembly)
        self._best_labels: Bits | None = None
        self.records = self.open_records()

    @property
    def header(self) -> dict[str, Any]:
        """Return the facts in which a record must agree with a study that resumes it."""
        model, own = self.settings.model.facts(), self.settings.own_objective
        return {
            "scene": self.scene.fingerprint,
            "driver": self.driver.name,
            "seed": self.settings.seed,
            **{f"driver's {name}": value for name, value in self.driver.settings.items()},
            **({} if own is None else {"own objective": name_of(own)}),
            "objective": model.pop("friction") + ("-floor" if self.settings.model.ranks_by_lower_bound else ""),
            "bracket width": model.pop("gap"),
            **model,
            **({"robust": True} if self.assembly.has_low_values else {}),
            "versions": versions(),
        }

    def open_records(self) -> Records:
        own = self.settings.own_objective is not None
        values = len(self.assembly.cases) + (self.assembly.has_low_values) + own
        return Records(self.folder, self.header, len(self.assembly.interfaces), values)

    @cached_property
    def standing(self) -> Standing:
        """Return what decides which layouts stand under their dead load alone."""
        if self.space.void is not None:
            real = self.space.void.real
            return VoidStanding(lambda text: cut(real, text), self.space.void.texts, self.settings.model)
        own = self.settings.own_objective is not None or self.settings.by_experiment
        options: dict[str, Any] = {"by_load_factor": not own, "threads": min(self.settings.jobs, MOST_THREADS)}
        if isinstance(self._make, MakeCellEvaluator):
            cells = self._make.cells
            return Standing(cells.fine, self.settings.model, cells.labels, **options)
        return Standing(self.assembly, self.settings.model, **options)

    def _told(self, labellings: Bits, evaluations: list[Evaluation]) -> list[Evaluation]:
        """Return evaluations of labellings (k, m) as the driver is told them, see `Standing.told`."""
        return self.standing.told(labellings, evaluations, self.deadline)

    @property
    def table_records(self) -> Records | RefinedRecords:
        return self.records

    @property
    def elapsed(self) -> float:
        return self.deadline.elapsed()

    @property
    def bound(self) -> float | None:
        """Smallest proven upper bound on λ of all layouts, scene units, of earlier runs too; None if unknown."""
        known = [bound for bound in (self._own_bound, self.records.bound) if bound is not None]
        return min(known, default=None)

    @property
    def _own_bound(self) -> float | None:
        bound = self.driver.bound
        if bound is not None and (not isinstance(bound, int | float | np.number) or not bound > -math.inf):
            where = f"driver {self.driver.name!r}"
            raise InputError(where, f"its bound is {bound!r}", "a number, or None without a proof")
        return None if bound == math.inf else bound

    @property
    def finite(self) -> bool:
        """Return True if the driver can be expected to end with a proof."""
        return self.driver.modular or (self.driver.exhaustive and self.total is not None)

    def facts(self, results: pd.DataFrame) -> dict[str, Any]:
        """Return entries that this kind of study adds to the summary."""
        return {}

    @property
    def undecided(self) -> int:
        """Return the number of layouts left out because a search for an assembly order stopped."""
        return 0 if self.space.laying is None else self.space.laying.undecided

    def _withdraw_contradicted(self, evaluations: list[Evaluation]) -> None:
        """Withdraw the proven bound if a layout provably carries more, since the proof is wrong."""
        bound = self.bound
        stands = [e.low for e in evaluations if e.status is Status.COLLAPSE]
        if bound is None or not stands or not exceeds(max(stands), bound, self._floor):
            return
        reason = (
            f"a layout carries λ ≥ {max(stands):.9g}, above the bound {bound:.9g} on record: the bound is withdrawn"
        )
        self.records.withdraw_bound(reason)
        self.driver.withdraw(reason)

    def keep_bound(self, bound: float | None, by: str | None = None) -> None:
        """Record a proven upper bound on λ of all layouts, for runs that resume this one; by: how it was found."""
        if bound is not None and (self.records.bound is None or bound < self.records.bound):
            self.records.keep_bound(bound)
            self.bound_by = by

    def run(self) -> StopReason:
        """Search until space, budget or time is exhausted, or a proof complete; return why it ended."""
        budget, driver = self.settings.budget, self.driver
        workers = self._workers()
        # Bounds on λ without dilation spare solves, unless another objective takes the place of λ.
        spare = self.settings.model.friction == "zero-dilation" and self.settings.own_objective is None
        front = IncumbentFront(self.space) if spare else None
        recorded = RecordedEvaluator(
            workers,
            self.records,
            self.space.group,
            deadline=self.deadline,
            front=front,
            finish_first=self.evaluation_seconds <= _SOON,
            report=self._count,
        )
        waiting, dry = deque[PendingEvaluations](), False
        try:
            if driver.remembers and len(self.records):
                self._restore()
            driver.set_workers(self.settings.jobs)
            driver.start(self.deadline, lambda: self._count([], _NONE), self.records)
            self._beside = self._proof_beside()
            while True:
                # Request a fixed number of portions ahead, so that the order of results is independent of the workers.
                # At least one labelling is evaluated even after the deadline.
                while not dry and len(waiting) <= driver.ahead and not (self.deadline.passed() and self._begun):
                    left = None if budget is None else budget - self.asked
                    if left is not None and left <= 0:
                        break
                    if front is not None:  # Small portions give results sooner, which prunes more solves.
                        left = PORTION if left is None else min(left, PORTION)
                    labellings = self._asked(left)
                    dry = self._cut or len(labellings) == 0
                    if len(labellings):
                        waiting.append(recorded.submit(labellings))
                if not waiting:
                    reason = self._reason(dry)
                    if reason is StopReason.UNPROVEN:
                        self._discard_proof()
                    if reason in (StopReason.BUDGET, StopReason.TIME):
                        self._look_beside(wait=True)
                    if self._offered is None:
                        return reason
                if self._offered is not None:
                    offered, self._offered = self._offered, None
                    recorded.collect(recorded.submit(offered))
                    continue
                with suppress(DeadlinePassed), plugins.guarded("jld.drivers", driver.name), self.deadline.enforced():
                    driver.prepare()
                pending = waiting.popleft()
                evaluations = recorded.collect(pending)
                self.solved = recorded.solved
                if evaluations is None:
                    return StopReason.TIME
                told = self._told(pending.labellings, evaluations)
                driver.tell(pending.labellings, told)
                if front is not None:
                    front.learn(pending.labellings, told)
        finally:
            self.solved = recorded.solved
            self._close(workers)

    def _close(self, workers: Workers) -> None:
        if self._beside is not None:
            self._beside.close()
        workers.close()
        self.driver.close()
        try:
            self.keep_bound(self._own_bound, self.driver.name)
        finally:
            self.records.close()

    def _proof_beside(self) -> ProofBeside | None:
        """Start a proof beside the search, unless the driver proves or would end before it."""
        settings, driver = self.settings, self.driver
        other = settings.own_objective is not None or settings.by_experiment or self._make is not evaluator_of
        if other or driver.modular or (driver.exhaustive and self.total is not None):
            return None
        return ProofBeside.of(self.space, settings.model, self.deadline)

    def _look_beside(self, *, wait: bool = False) -> None:
        """Record what the proof beside has found; wait: until the deadline for its first bound."""
        if self._beside is None:
            return
        found = self._beside.poll(self._best_labels, self.deadline.remaining() if wait and self._beside.first else 0.0)
        if math.isfinite(found.bound):
            self.keep_bound(found.bound, found.by)
        # a layout that is stronger by more than two brackets of the same one may differ
        if found.labels is not None and not found.low <= self._best + GAP * max(abs(self._best), self._floor):
            self._offered, self._best = canonical(found.labels[None], self.space.group), found.low

    @property
    def evaluation_seconds(self) -> float:
        """Return the expected processor time of one evaluation, s; inf where it is not known."""
        settings = self.settings
        if settings.own_objective is not None or not settings.model.supports_bounds_over_labellings:
            return math.inf
        fine = self._make.cells.fine if isinstance(self._make, MakeCellEvaluator) else self.assembly
        return cost_estimate(fine).seconds

    def _workers(self) -> Workers:
        settings, spec = EvaluatorSettings(self.settings.model), self.worker_spec
        return Workers(
            spec,
            self.settings.jobs,
            len(self.assembly.interfaces),
            hang_seconds=max(HANG_SECONDS, _HANGS * cost_estimate(self.assembly).seconds),
            batch=self._make is evaluator_of and settings.batched and spec.settles_nearly_all,
            ahead=self.driver.ahead,
            then=None if self.space.void is not None else self.standing.foresee,
        )

    @property
    def worker_spec(self) -> WorkerSpec:
        return WorkerSpec.of(self.assembly, EvaluatorSettings(self.settings.model), self._make)

    def _restore(self) -> None:
        packed = self.records.rows["labelling"]
        rows = unpack(packed, len(self.assembly.interfaces))
        known = [self.records.find(labels) for labels in rows]
        restored = self._told(rows, [evaluation for evaluation in known if evaluation is not None])
        self._withdraw_contradicted(restored)
        self.driver.restore(rows, restored)

    def _reason(self, dry: bool) -> StopReason:
        """Return why the study ends; dry: no labelling was proposed and none is being evaluated."""
        if self._empty:
            return StopReason.EXHAUSTED
        if self.driver.exhaustive and self.total is not None and len(self.records) >= self.total:
            return StopReason.EXHAUSTED
        if self.settings.budget is not None and self.asked >= self.settings.budget:
            return StopReason.BUDGET
        if not dry or self._cut:
            return StopReason.TIME
        if self.driver.finished:
            return StopReason.PROVEN
        if self.driver.checks and not self.driver.exhaustive and not self.driver.working:
            return StopReason.UNPROVEN
        if self.driver.working:  # it returned because time ran out
            return StopReason.TIME
        known = self.driver.exhaustive or (self.total is not None and len(self.records) >= self.total)
        return StopReason.EXHAUSTED if known else StopReason.DRIVER

    def _discard_proof(self) -> None:
        """Withdraw the bound and all conflicts on record, because a proof failed its check."""
        self.records.withdraw_bound(next(iter(self.driver.complaints), "the proof did not pass its check"))
        self.records.forget_conflicts()

    def _asked(self, limit: int | None) -> Bits:
        """Request labellings (k, m) as `_proposed` does, and count them."""
        labellings = self._proposed(limit)
        if len(labellings) and not self.asked:
            self._found_first()
        self.asked += len(labellings)
        return labellings

    def _proposed(self, limit: int | None) -> Bits:
        """Request labellings (k, m) from the driver; none after its time is up."""
        # If nothing has been evaluated and the driver spends most of the time without a proposal, the first layout
        # found without the driver is returned.
        begun = self._begun
        until = self.deadline if begun else self.deadline.within(_FIRST * self.deadline.remaining())
        try:
            with until.enforced():
                until.check()
                return self.driver.ask(limit)
        except DeadlinePassed:
            self._cut = True
        none = np.empty((0, len(self.space.fixed)), dtype=bool)
        if begun:
            return none
        try:
            with Deadline(max(self.deadline.remaining(), _LEAST)).enforced():
                found = first_layout(self.space, self.settings.seed)
        except DeadlinePassed:
            return none
        self._empty = not len(found)
        return found

    @property
    def _begun(self) -> bool:
        """Return True if a labelling has been evaluated or requested."""
        return self.asked > 0 or len(self.records) > 0

    def _count(self, evaluations: list[Evaluation], labellings: Bits) -> None:
        """Update counters, bounds and progress with new evaluations of labellings (k, m)."""
        self.evaluated += len(evaluations)
        evaluations = self._told(labellings, evaluations)
        # Reserve time to write the tables of all recorded labellings.
        self.deadline.end = self._end - _ROW * len(self.records)
        values = [e.load_factor if e.status is Status.COLLAPSE else np.nan for e in evaluations]
        if not np.all(np.isnan(values)):
            place = int(np.nanargmax(values))
            if not values[place] <= self._best:
                self._best, self._best_labels = float(values[place]), labellings[place]
        self._look_beside()
        self._withdraw_contradicted(evaluations)
        self.keep_bound(self._own_bound, self.driver.name)
        if self.report is not None:
            bound = np.nan if self.bound is None else self.bound
            budget, total = self.settings.budget, self.total
            total = total if budget is None else min(budget, total or budget)
            gap = relative_width(self._best, bound, self._floor)
            text = "" if self._best_labels is None else self.text_of(self._best_labels)
            left = self.deadline.remaining()
            self.report(Progress(self.evaluated, total, self.solved, self._best, self.elapsed, bound, gap, text, left))

    def text_of(self, labels: Bits) -> str:
        """Return the letters of a labelling (m,) of the search space, one per face of the structure."""
        if self.space.void is not None:
            return self.space.void.texts(labels[None])[0]
        return to_string(labels[: self.assembly.faces])
