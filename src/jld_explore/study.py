"""A study: one scene, one driver, one record; ask → evaluate → tell, until there is a reason to stop.

The driver proposes and never evaluates, workers evaluate and never write; this process alone writes the record,
tells the driver and reports progress. To resume is to replay: the driver runs again from its seed, and what is on
record is told without being evaluated.
"""

from __future__ import annotations

import platform
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core._version import __version__
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit import SolveOptions, Status, exceeds, load_scale, relative_width
from jld_core.models import cost_estimate
from jld_core.program import Template
from jld_core.scene import Scene
from jld_explore.drivers import Driver, first_layout
from jld_explore.evaluation import (
    HANG,
    CertificateEvaluator,
    Evaluating,
    Evaluation,
    EvaluatorSettings,
    IncumbentFront,
    MakeEvaluator,
    Pool,
    RecordedEvaluator,
    Records,
    Sent,
    Workers,
    WorkerSpec,
    evaluator_of,
    is_small,
)
from jld_explore.space import SearchSpace, unpack

_ROW: Final = 4e-5
"""Seconds that tables and page take for each labelling on record; they are kept back from a time limit."""

PORTION: Final = 128
"""Labellings asked together at the most where what is known spares solves."""


SMALL: Final = 20_000
"""Classes up to which a space is enumerated when no driver is named, as `ExploreSettings.small`."""


_HANGS: Final = 20.0
"""Times of an evaluation, as expected, after which workers without any result are taken to hang."""


_FIRST: Final = 0.6
"""Share of the time left in which a driver must name its first labelling, before one is drawn in its place."""

_LEAST: Final = 1.0
"""Seconds for the first labelling where the time is up before anything was evaluated."""


class StopReason(StrEnum):
    """Why a study ended."""

    EXHAUSTED = "exhausted"
    PROVEN = "proven"
    UNPROVEN = "unproven"
    BUDGET = "budget"
    TIME = "time"
    INTERRUPTED = "interrupted"


class Interrupted(BaseException):
    """Raised by the signal handlers of the command line: everything finished is on disk.

    done: the Exploration of what was finished, once that is written.
    """

    done: Any = None


@dataclass(frozen=True)
class Progress:
    """Where a running study stands.

    total: None where it is not known. best: λ so far, bound: proven of all layouts, gap: between the two; NaN where
    there is none.
    """

    done: int
    total: int | None
    solved: int
    best: float
    seconds: float
    bound: float = np.nan
    gap: float = np.nan


@dataclass(frozen=True)
class ExploreSettings:
    """How to search. driver: a name, or one of your own, or None to choose. budget: classes; seconds: time limit; seed,
    jobs as said.

    model: what is modelled, whose λ is maximised. resume: go on with a folder that holds a study. certificates: let
    past solves settle labellings, where the model is one that bounds speak of. pictures: draw what was found at the
    end. strict: take what is possible but hardly meant as an error. experiment: how many of the best by λ are put to
    the virtual experiment at the end. by_experiment: search by it then, with as many experiments in all (default 500),
    seeded by the best by λ. robust: rank by λ at the low values of materials. small: classes up to which a space is
    counted beforehand, and enumerated where no driver is named; 0: not counted. certificate: file for the proof of the
    exact driver. cluster: URL of a dask scheduler, whose workers evaluate. options: of a driver that is
    named.
    """

    driver: str | Driver | None = None
    model: SolveOptions = field(default_factory=SolveOptions)
    budget: int | None = None
    seconds: float | None = None
    jobs: int = 1
    seed: int = 0
    resume: bool = False
    certificates: bool = False
    experiment: int | None = None
    by_experiment: bool = False
    pictures: bool = True
    strict: bool = False
    robust: bool = False
    small: int = SMALL
    certificate: Path | None = None
    cluster: str | None = None
    options: dict[str, Any] = field(default_factory=dict)


class Study:
    """One search over labellings of a scene.

    scene, assembly, space, driver: they belong together. total: classes there are, where that is known. report: called
    after every batch. make: makes what evaluates labellings in each worker. deadline: when it ends; default: after
    the seconds of the settings from now on. The same scene, driver, seed and budget give the same rows on record
    whatever `jobs` is.
    """

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
        make: MakeEvaluator = evaluator_of,
        deadline: Deadline | None = None,
    ) -> None:
        self.scene, self.assembly, self.space, self.driver, self.folder = scene, assembly, space, driver, folder
        self.settings, self.total, self.report = settings or ExploreSettings(), total, report
        self._make = make
        self.certificates = self.settings.certificates and self.settings.model.modular
        self.deadline = Deadline(self.settings.seconds) if deadline is None else deadline
        self._end, self._cut = self.deadline.end, False
        self.evaluated = self.asked = self.solved = 0
        self._best, self._floor = np.nan, load_scale(assembly)
        self.records = self.open_records()

    @property
    def header(self) -> dict[str, Any]:
        """What a record must agree with to be gone on with."""
        model = self.settings.model.facts()
        return {
            "scene": self.scene.fingerprint,
            "driver": self.driver.name,
            "seed": self.settings.seed,
            **{f"driver's {name}": value for name, value in self.driver.settings.items()},
            "objective": model.pop("friction") + ("-floor" if self.settings.model.by_floor else ""),
            "bracket width": model.pop("gap"),
            **model,
            "certificates": self.certificates,
            **({"robust": True} if self.assembly.nominal is not None else {}),
            "versions": versions(),
        }

    def open_records(self) -> Records:
        """The record in the folder, gone on with where there is one."""
        values = len(self.assembly.cases) + (self.assembly.nominal is not None)
        return Records(self.folder, self.header, len(self.assembly.interfaces), values)

    @property
    def elapsed(self) -> float:
        """Seconds since the study began."""
        return self.deadline.elapsed()

    @property
    def bound(self) -> float | None:
        """The best proven upper bound on λ over the whole space, scene units, of this run and of those before it."""
        known = [bound for bound in (self.driver.bound, self.records.bound) if bound is not None]
        return min(known, default=None)

    @property
    def finite(self) -> bool:
        """Whether the driver comes to an end that is worth waiting for, with a proof."""
        return self.driver.modular or (self.driver.exhaustive and self.total is not None)

    @property
    def complaints(self) -> list[str]:
        """What went wrong with the record and with proofs of this study, one line each."""
        anew = f"{self.records.path.name} was empty: nothing had been finished, and the search began anew"
        return [
            *([anew] if self.records.began_anew else []),
            *self.records.withdrawn,
            *(one for one in self.driver.complaints if one not in self.records.withdrawn),
        ]

    def _withdraw_contradicted(self, evaluations: list[Evaluation]) -> None:
        """Withdraw the bound where a layout is proven to carry more: what was proven is wrong, and is begun again."""
        bound = self.bound
        stands = [e.low for e in evaluations if e.status is Status.COLLAPSE]
        if bound is None or not stands or not exceeds(max(stands), bound, self._floor):
            return
        reason = (
            f"a layout carries λ ≥ {max(stands):.9g}, above the bound {bound:.9g} on record: the bound is withdrawn"
        )
        self.records.withdraw_bound(reason)
        self.driver.withdraw(reason)

    def keep_bound(self, bound: float | None) -> None:
        """Put a proven upper bound over the whole space on record, for runs that go on with this one."""
        if bound is not None:
            self.records.keep_bound(bound)

    def run(self) -> StopReason:
        """Search until the space, the budget or the time is used up; Interrupted passes through."""
        faces, budget, driver = len(self.assembly.interfaces), self.settings.budget, self.driver
        template = Template(self.assembly) if self.certificates else None
        settings = EvaluatorSettings(self.settings.model, prove=self.certificates)
        recipe = WorkerSpec.of(self.assembly, settings, self._make)
        workers = Workers(
            recipe,
            self.settings.jobs,
            faces,
            hang=max(HANG, _HANGS * cost_estimate(self.assembly).seconds),
            quick=template is not None and is_small(template),
            batch=self._make is evaluator_of and settings.batched and recipe.evaluator().settles,
        )
        front = IncumbentFront(self.space) if self.settings.model.friction == "zero-dilation" else None
        recorded = RecordedEvaluator(
            workers,
            self.records,
            self.space.group,
            deadline=self.deadline,
            front=front,
            proofs=self.certificates,
            report=self._count,
        )
        evaluator: Evaluating = recorded
        if template is not None:
            pool = Pool(faces, self.space.group)
            evaluator = CertificateEvaluator(recorded, pool, template, self.settings.model.gap)
        waiting: deque[Sent] = deque()
        dry = False
        try:
            if driver.remembers and len(self.records):
                rows = unpack(self.records.rows["labelling"], faces)
                known = [self.records.find(labels) for labels in rows]
                restored = [evaluation for evaluation in known if evaluation is not None]
                self._withdraw_contradicted(restored)
                driver.restore(rows, restored)
            driver.set_workers(self.settings.jobs)
            driver.start(self.deadline, lambda: self._count([]), self.records)
            while True:
                # the same number of portions are asked ahead whatever the workers do, so answers come in one order
                # one labelling is evaluated however late it is by now
                while not dry and len(waiting) <= driver.ahead and not (self.deadline.passed() and self._begun):
                    left = None if budget is None else budget - self.asked
                    if left is not None and left <= 0:
                        break
                    if front is not None:  # the sooner answers are known the more they spare
                        left = PORTION if left is None else min(left, PORTION)
                    labellings = self._asked(left)
                    dry = self._cut or len(labellings) == 0
                    if len(labellings):
                        self.asked += len(labellings)
                        waiting.append(evaluator.send(labellings))
                if not waiting:
                    return self._reason(dry)
                sent = waiting.popleft()
                evaluations = evaluator.take(sent)
                self.solved = recorded.solved
                if evaluations is None:
                    return StopReason.TIME
                driver.tell(sent.labellings, evaluations)
                if front is not None:
                    front.learn(sent.labellings, evaluations)
        finally:
            self.solved = recorded.solved
            workers.close()
            driver.close()
            try:
                self.keep_bound(driver.bound)
            finally:
                self.records.close()

    def _reason(self, dry: bool) -> StopReason:
        """Why nothing is asked or waited for any more."""
        if self.driver.exhaustive and self.total is not None and len(self.records) >= self.total:
            return StopReason.EXHAUSTED
        if self.settings.budget is not None and self.asked >= self.settings.budget:
            return StopReason.BUDGET
        if not dry or self._cut:
            return StopReason.TIME
        if self.driver.finished:
            return StopReason.PROVEN
        if self.driver.checks and not self.driver.exhaustive and not self.driver.working:
            # the proof ended, and did not pass its check: nothing of it may be gone on with
            self.records.withdraw_bound(next(iter(self.driver.complaints), "the proof did not pass its check"))
            self.records.forget_conflicts()
            return StopReason.UNPROVEN
        # a driver that was still at work came back for lack of time
        return StopReason.TIME if self.driver.working else StopReason.EXHAUSTED

    def _asked(self, limit: int | None) -> Bits:
        """Labellings (k, m) from the driver; where its time ends first it is not asked again.

        A driver that names none in most of the time gives way to one labelling drawn at random, so that there is
        something to show.
        """
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
                return first_layout(self.space, self.settings.seed)
        except DeadlinePassed:
            return none

    @property
    def _begun(self) -> bool:
        """Whether anything is evaluated or about to be."""
        return self.asked > 0 or len(self.records) > 0

    def _count(self, evaluations: list[Evaluation]) -> None:
        self.evaluated += len(evaluations)
        # what is on record must be written too before the time is up
        self.deadline.end = self._end - _ROW * len(self.records)
        values = [e.load_factor for e in evaluations if e.status is Status.COLLAPSE]
        self._best = float(np.fmax(self._best, max(values, default=np.nan)))
        self._withdraw_contradicted(evaluations)
        self.keep_bound(self.driver.bound)
        if self.report is not None:
            bound = np.nan if self.bound is None else self.bound
            budget, total = self.settings.budget, self.total
            total = total if budget is None else min(budget, total or budget)
            gap = relative_width(self._best, bound, self._floor)
            self.report(Progress(self.evaluated, total, self.solved, self._best, self.elapsed, bound, gap))


def versions() -> dict[str, str]:
    """Versions that numbers may depend on."""
    return {
        "jld": __version__,
        "python": platform.python_version(),
        "kernel": chosen() or "none",
        **{name: version(name) for name in ("numpy", "scipy", "clarabel", "highspy")},
    }
