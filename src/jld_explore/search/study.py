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
_NO_LABELLINGS: Final = np.empty((0, 0), dtype=bool)  # labellings of an empty list of evaluations


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
        before_first_evaluation: Callable[[], None] = lambda: None,
        make: MakeEvaluator = evaluator_of,
        deadline: Deadline | None = None,
    ) -> None:
        # A study resumes by replay: the driver runs again from its seed and receives recorded results. Equal scene,
        # driver, seed and budget give equal rows for any number of jobs. Until `before_first_evaluation` is called the
        # space may turn out to be empty.
        self.scene, self.assembly, self.space, self.driver, self.folder = scene, assembly, space, driver, folder
        self.settings, self.total, self.report = settings or ExploreSettings(), total, report
        self._make, self._before_first_evaluation = make, before_first_evaluation
        self.deadline = Deadline(self.settings.seconds) if deadline is None else deadline
        self._search_end = self.deadline.end  # with the time for tables
        self._timed_out = self._space_is_empty = False
        self.evaluated = self.asked = self.solved = 0
        self._proof: ProofBeside | None = None
        self._stronger: Bits | None = None  # a layout (1, m) of the proof beside that is stronger than all evaluated
        self.bound_by: str | None = None
        self._best, self._load_scale = np.nan, load_scale(assembly)
        self._best_labels: Bits | None = None
        self.records = self.open_records()

    @property
    def header(self) -> dict[str, Any]:
        """Return the facts in which a record must agree with a study that resumes it."""
        model, objective = self.settings.model.facts(), self.settings.own_objective
        return {
            "scene": self.scene.fingerprint,
            "driver": self.driver.name,
            "seed": self.settings.seed,
            **{f"driver's {name}": value for name, value in self.driver.settings.items()},
            **({} if objective is None else {"own objective": name_of(objective)}),
            "objective": model.pop("friction") + ("-floor" if self.settings.model.ranks_by_lower_bound else ""),
            "bracket width": model.pop("gap"),
            **model,
            **({"robust": True} if self.assembly.has_low_values else {}),
            "versions": versions(),
        }

    def open_records(self) -> Records:
        with_objective = self.settings.own_objective is not None
        values = len(self.assembly.cases) + (self.assembly.has_low_values) + with_objective
        return Records(self.folder, self.header, len(self.assembly.interfaces), values)

    @cached_property
    def standing(self) -> Standing:
        """Return what decides which layouts stand under their dead load alone."""
        if self.space.void is not None:
            real = self.space.void.real
            return VoidStanding(lambda text: cut(real, text), self.space.void.texts, self.settings.model)
        other = self.settings.own_objective is not None or self.settings.by_experiment
        options: dict[str, Any] = {"by_load_factor": not other, "threads": min(self.settings.jobs, MOST_THREADS)}
        if isinstance(self._make, MakeCellEvaluator):
            cells = self._make.cells
            return Standing(cells.fine, self.settings.model, cells.labels, **options)
        return Standing(self.assembly, self.settings.model, **options)

    def _with_standing(self, labellings: Bits, evaluations: list[Evaluation]) -> list[Evaluation]:
        """Return evaluations of labellings (k, m); what falls under its dead load alone is unstable."""
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
        bounds = [bound for bound in (self._driver_bound, self.records.bound) if bound is not None]
        return min(bounds, default=None)

    @property
    def _driver_bound(self) -> float | None:
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
        lows = [e.low for e in evaluations if e.status is Status.COLLAPSE]
        if bound is None or not lows or not exceeds(max(lows), bound, self._load_scale):
            return
        reason = f"a layout carries λ ≥ {max(lows):.9g}, above the bound {bound:.9g} on record: the bound is withdrawn"
        self.records.withdraw_bound(reason)
        self.driver.withdraw(reason)

    def keep_bound(self, bound: float | None, by: str | None = None) -> None:
        """Record a proven upper bound on λ of all layouts, for runs that resume this one; by: how it was found."""
        if bound is not None and (self.records.bound is None or bound < self.records.bound):
            self.records.keep_bound(bound)
            self.bound_by = by

    def run(self) -> StopReason:
        """Search until space, budget or time is exhausted, or a proof complete; return why it ended."""
        driver, workers = self.driver, self._workers()
        # Bounds on λ without dilation spare solves, unless another objective takes the place of λ.
        may_prune = self.settings.model.friction == "zero-dilation" and self.settings.own_objective is None
        front = IncumbentFront(self.space) if may_prune else None
        recorded = RecordedEvaluator(
            workers,
            self.records,
            self.space.group,
            deadline=self.deadline,
            front=front,
            finish_first=self.evaluation_seconds <= _SOON,
            report=self._update_progress,
        )
        submitted, no_proposal = deque[PendingEvaluations](), False
        try:
            if driver.remembers and len(self.records):
                self._restore()
            driver.set_workers(self.settings.jobs)
            driver.start(self.deadline, lambda: self._update_progress([], _NO_LABELLINGS), self.records)
            self._proof = self._start_proof()
            while True:
                # small portions give results sooner, which prunes more solves
                most = math.inf if front is None else PORTION
                no_proposal = no_proposal or self._submit_ahead(recorded, submitted, most)
                if not submitted:
                    reason = self._reason(no_proposal)
                    if reason is StopReason.UNPROVEN:
                        self._discard_proof()
                    if reason in (StopReason.BUDGET, StopReason.TIME):
                        self._poll_proof(wait=True)
                    if self._stronger is None:
                        return reason
                if self._stronger is not None:
                    stronger, self._stronger = self._stronger, None
                    recorded.collect(recorded.submit(stronger))
                    continue
                with suppress(DeadlinePassed), plugins.guarded("jld.drivers", driver.name), self.deadline.enforced():
                    driver.prepare()
                pending = submitted.popleft()
                evaluations = recorded.collect(pending)
                self.solved = recorded.solved
                if evaluations is None:
                    return StopReason.TIME
                judged = self._with_standing(pending.labellings, evaluations)
                driver.tell(pending.labellings, judged)
                if front is not None:
                    front.learn(pending.labellings, judged)
        finally:
            self.solved = recorded.solved
            self._close(workers)

    def _submit_ahead(self, recorded: RecordedEvaluator, submitted: deque[PendingEvaluations], most: float) -> bool:
        """Submit portions of at most `most` labellings; return True if the driver proposes none any more."""
        # A fixed number of portions ahead makes the order of results independent of the workers. At least one labelling
        # is evaluated even after the deadline.
        budget = math.inf if self.settings.budget is None else self.settings.budget
        while len(submitted) <= self.driver.ahead and not (self.deadline.passed() and self._has_layouts):
            limit = min(budget - self.asked, most)
            if limit <= 0:
                return False
            labellings = self._ask(int(limit) if math.isfinite(limit) else None)
            if len(labellings):
                submitted.append(recorded.submit(labellings))
            if self._timed_out or len(labellings) == 0:
                return True
        return False

    def _close(self, workers: Workers) -> None:
        if self._proof is not None:
            self._proof.close()
        workers.close()
        self.driver.close()
        try:
            self.keep_bound(self._driver_bound, self.driver.name)
        finally:
            self.records.close()

    def _start_proof(self) -> ProofBeside | None:
        """Start a proof beside the search, unless the driver proves or would end before it."""
        settings, driver = self.settings, self.driver
        other = settings.own_objective is not None or settings.by_experiment or self._make is not evaluator_of
        if other or driver.modular or (driver.exhaustive and self.total is not None):
            return None
        return ProofBeside.of(self.space, settings.model, self.deadline)

    def _poll_proof(self, *, wait: bool = False) -> None:
        """Take over bound and layout of the proof beside; wait: until the deadline for its first bound."""
        if self._proof is None:
            return
        status = self._proof.poll(self._best_labels, self.deadline.remaining() if wait and self._proof.first else 0.0)
        if math.isfinite(status.bound):
            self.keep_bound(status.bound, status.by)
        # a layout that is stronger by more than two brackets of the same one may differ
        if status.labels is not None and not status.low <= self._best + GAP * max(abs(self._best), self._load_scale):
            self._stronger, self._best = canonical(status.labels[None], self.space.group), status.low

    @property
    def evaluation_seconds(self) -> float:
        """Return the expected processor time of one evaluation, s; inf where it is not known."""
        settings = self.settings
        if settings.own_objective is not None or not settings.model.supports_bounds_over_labellings:
            return math.inf
        cells = self._make.cells.fine if isinstance(self._make, MakeCellEvaluator) else self.assembly
        return cost_estimate(cells).seconds

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
        rows = self.records.rows["labelling"]
        labellings = unpack(rows, len(self.assembly.interfaces))
        evaluations = [self.records.find(labels) for labels in labellings]
        restored = self._with_standing(labellings, [evaluation for evaluation in evaluations if evaluation is not None])
        self._withdraw_contradicted(restored)
        self.driver.restore(labellings, restored)

    def _reason(self, no_proposal: bool) -> StopReason:
        """Return why the study ends; dry: no labelling was proposed and none is being evaluated."""
        if self._space_is_empty:
            return StopReason.EXHAUSTED
        if self.driver.exhaustive and self.total is not None and len(self.records) >= self.total:
            return StopReason.EXHAUSTED
        if self.settings.budget is not None and self.asked >= self.settings.budget:
            return StopReason.BUDGET
        if not no_proposal or self._timed_out:
            return StopReason.TIME
        if self.driver.finished:
            return StopReason.PROVEN
        if self.driver.checks and not self.driver.exhaustive and not self.driver.working:
            return StopReason.UNPROVEN
        if self.driver.working:  # it returned because time ran out
            return StopReason.TIME
        complete = self.driver.exhaustive or (self.total is not None and len(self.records) >= self.total)
        return StopReason.EXHAUSTED if complete else StopReason.DRIVER

    def _discard_proof(self) -> None:
        """Withdraw the bound and all conflicts on record, because a proof failed its check."""
        self.records.withdraw_bound(next(iter(self.driver.complaints), "the proof did not pass its check"))
        self.records.forget_conflicts()

    def _ask(self, limit: int | None) -> Bits:
        """Request labellings (k, m) and count them."""
        labellings = self._propose(limit)
        if len(labellings) and not self.asked:
            self._before_first_evaluation()
        self.asked += len(labellings)
        return labellings

    def _propose(self, limit: int | None) -> Bits:
        """Request labellings (k, m) from the driver; none after its time is up."""
        # If nothing has been evaluated and the driver spends most of the time without a proposal, the first layout
        # found without the driver is returned.
        has_layouts = self._has_layouts
        deadline = self.deadline if has_layouts else self.deadline.within(_FIRST * self.deadline.remaining())
        try:
            with deadline.enforced():
                deadline.check()
                return self.driver.ask(limit)
        except DeadlinePassed:
            self._timed_out = True
        nothing = np.empty((0, len(self.space.fixed)), dtype=bool)
        if has_layouts:
            return nothing
        try:
            with Deadline(max(self.deadline.remaining(), _LEAST)).enforced():
                layout = first_layout(self.space, self.settings.seed)
        except DeadlinePassed:
            return nothing
        self._space_is_empty = not len(layout)
        return layout

    @property
    def _has_layouts(self) -> bool:
        """Return True if a labelling has been evaluated or requested."""
        return self.asked > 0 or len(self.records) > 0

    def _update_progress(self, evaluations: list[Evaluation], labellings: Bits) -> None:
        """Update counters, bounds and progress with new evaluations of labellings (k, m)."""
        self.evaluated += len(evaluations)
        evaluations = self._with_standing(labellings, evaluations)
        # Reserve time to write the tables of all recorded labellings.
        self.deadline.end = self._search_end - _ROW * len(self.records)
        values = [e.load_factor if e.status is Status.COLLAPSE else np.nan for e in evaluations]
        if not np.all(np.isnan(values)):
            index = int(np.nanargmax(values))
            if not values[index] <= self._best:
                self._best, self._best_labels = float(values[index]), labellings[index]
        self._poll_proof()
        self._withdraw_contradicted(evaluations)
        self.keep_bound(self._driver_bound, self.driver.name)
        if self.report is not None:
            bound = np.nan if self.bound is None else self.bound
            budget, total = self.settings.budget, self.total
            total = total if budget is None else min(budget, total or budget)
            gap = relative_width(self._best, bound, self._load_scale)
            text = "" if self._best_labels is None else self.text_of(self._best_labels)
            remaining = self.deadline.remaining()
            self.report(
                Progress(self.evaluated, total, self.solved, self._best, self.elapsed, bound, gap, text, remaining)
            )

    def text_of(self, labels: Bits) -> str:
        """Return the letters of a labelling (m,) of the search space, one per face of the structure."""
        if self.space.void is not None:
            return self.space.void.texts(labels[None])[0]
        return to_string(labels[: self.assembly.faces])
