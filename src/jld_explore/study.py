"""A study: one scene, one driver, one store; ask → evaluate → tell, until there is a reason to stop.

The driver proposes and never evaluates, workers evaluate and never write, this loop alone writes the store,
tells the driver and reports progress. To resume is to replay: the driver runs again from its seed, and what
the store knows is told without being evaluated.
"""

from __future__ import annotations

import platform
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core._version import __version__
from jld_core.arrays import Bits, Ints
from jld_core.assembly import Assembly
from jld_core.lanes import chosen
from jld_core.limit import Status
from jld_core.program import Template
from jld_core.scene import Scene
from jld_explore.drivers import Driver
from jld_explore.evaluation import (
    Archive,
    CertificateEvaluator,
    Evaluation,
    EvaluatorSettings,
    IncumbentFront,
    Pool,
    Proofs,
    Run,
    Store,
    Workers,
    WorkerSpec,
    kernel_settles,
)
from jld_explore.space import SearchSpace, orbit_sizes, unpack

PORTION: Final = 128
"""Labellings asked together at the most where what is known spares solves."""


class StopReason(StrEnum):
    """Why a study ended."""

    EXHAUSTED = "exhausted"
    PROVEN = "proven"
    BUDGET = "budget"
    TIME = "time"
    INTERRUPTED = "interrupted"


class Interrupted(BaseException):
    """Raised by the signal handlers of the command line: everything finished is on disk."""


@dataclass(frozen=True)
class Progress:
    """Where a running study stands. total: None where it is not known. best: λ so far, NaN where none."""

    done: int
    total: int | None
    solved: int
    best: float
    seconds: float
    bound: float = np.nan


@dataclass(frozen=True)
class Sent:
    """Labellings (k, m), what is found of them so far, the positions of those the workers have, and their run."""

    labellings: Bits
    found: list[Evaluation | None]
    missing: Ints
    run: Run | None


@dataclass(frozen=True)
class Asked:
    """Labellings (k, m) a driver was asked; sent: None where certificates are to be asked first."""

    labellings: Bits
    sent: Sent | None


@dataclass
class Study:
    """One search over labellings of a scene.

    budget: distinct classes evaluated at the most. seconds: time limit. jobs: worker processes. certificates: ask
    what past solves prove before solving (associative friction only). report: called after every batch. The same
    scene, driver, seed and budget give the same store rows whatever `jobs` is.
    """

    scene: Scene
    assembly: Assembly
    space: SearchSpace
    driver: Driver
    folder: Path
    seed: int = 0
    jobs: int = 1
    budget: int | None = None
    seconds: float | None = None
    settings: EvaluatorSettings = field(default_factory=EvaluatorSettings)
    certificates: bool = False
    total: int | None = None
    report: Callable[[Progress], None] | None = None

    def __post_init__(self) -> None:
        self.started = time.perf_counter()
        self.solved = 0
        self.evaluated = self.asked = 0
        self._best = np.nan
        faces = len(self.assembly.interfaces)
        self.store = Store(self.folder, self.header, faces)
        self._consultant: CertificateEvaluator | None = None
        self._floor = IncumbentFront(self.space) if self.settings.model.friction == "zero-dilation" else None
        if self.certificates:
            template = Template(self.assembly)
            archive = Archive(self.folder, faces)
            gap = self.settings.model.gap
            self._consultant = CertificateEvaluator(Pool(faces, self.space.group), template, gap, archive)
            self.store.first = archive.sync
            self.store.keep_proven(archive.holds)

    @property
    def header(self) -> dict[str, Any]:
        """What a store must agree with to be gone on with."""
        model = self.settings.model.facts()
        return {
            "scene": self.scene.fingerprint,
            "driver": self.driver.name,
            "seed": self.seed,
            **{f"driver's {name}": value for name, value in self.driver.settings.items()},
            "objective": model.pop("friction") + ("-floor" if self.settings.model.by_floor else ""),
            "bracket width": model.pop("gap"),
            **model,
            "certificates": self.certificates,
            "versions": versions(),
        }

    @property
    def elapsed(self) -> float:
        """Seconds since the study began."""
        return time.perf_counter() - self.started

    def run(self) -> StopReason:
        """Search until the space, the budget or the time is used up; Interrupted passes through."""
        settings = replace(self.settings, prove=self.certificates)
        quick = self._consultant is not None and self._consultant.small
        workers = Workers(
            WorkerSpec.of(self.assembly, settings),
            self.jobs,
            len(self.assembly.interfaces),
            quick=quick,
            lanes=kernel_settles(self.assembly, settings),
        )
        if self.driver.remembers and len(self.store):
            rows = unpack(self.store.rows["labelling"], self.store.faces)
            known = [self.store.find(labels) for labels in rows]
            self.driver.recall(rows, [evaluation for evaluation in known if evaluation is not None])
        deadline = None if self.seconds is None else self.started + self.seconds
        self.driver.attend(deadline, lambda: self._count([]), self.folder)
        waiting: deque[Asked] = deque()
        dry = False
        try:
            while True:
                # the same number of portions are asked ahead whatever the workers do, so answers come in one order
                while not dry and len(waiting) <= self.driver.ahead and not self._late:
                    left = None if self.budget is None else self.budget - self.asked
                    if left is not None and left <= 0:
                        break
                    if self._floor is not None:  # the sooner answers are known the more they spare
                        left = PORTION if left is None else min(left, PORTION)
                    labellings = self.driver.ask(left)
                    dry = len(labellings) == 0
                    if not dry:
                        self.asked += len(labellings)
                        waiting.append(self._begin(workers, labellings))
                if not waiting:
                    return self._reason(dry)
                asked = waiting.popleft()
                evaluations = self._evaluate(workers, asked)
                if evaluations is None:
                    return StopReason.TIME
                self.driver.tell(asked.labellings, evaluations)
                if self._floor is not None:
                    self._floor.learn(asked.labellings, evaluations)
        finally:
            workers.close()
            self.store.close()
            self.driver.release()
            if self._consultant is not None:
                self._consultant.archive.close()

    def _reason(self, dry: bool) -> StopReason:
        """Why nothing is asked or waited for any more."""
        if self.budget is not None and self.asked >= self.budget:
            return StopReason.BUDGET
        if not dry:
            return StopReason.TIME
        if self.driver.finished:
            return StopReason.PROVEN
        # a driver that was still at work came back for lack of time
        return StopReason.TIME if self.driver.working else StopReason.EXHAUSTED

    @property
    def _late(self) -> bool:
        return self.seconds is not None and self.elapsed >= self.seconds

    def _begin(self, workers: Workers, labellings: Bits) -> Asked:
        """Look up what is on record and send the rest to the workers; with certificates, when its turn comes."""
        return Asked(labellings, None if self._consultant is not None else self._send(workers, labellings))

    def _evaluate(self, workers: Workers, asked: Asked) -> list[Evaluation] | None:
        """Evaluations in the order asked, by certificates where they settle one; None where time ran out."""
        if asked.sent is not None:
            return self._take(asked.sent)
        assert self._consultant is not None

        def solve(labellings: Bits, company: Bits | None) -> list[Evaluation] | None:
            return self._take(self._send(workers, labellings, company))

        return self._consultant.evaluate(asked.labellings, solve, self._settle)

    def _settle(self, labellings: Bits, evaluations: list[Evaluation]) -> list[Evaluation]:
        """Record what certificates settled; of labellings that are on record, what the record says."""
        stored = [self.store.find(labels) for labels in labellings]
        new = np.array([n for n, evaluation in enumerate(stored) if evaluation is None], dtype=np.int64)
        if new.size:
            weights = orbit_sizes(labellings[new], self.space.group)
            self.store.append(labellings[new], weights.tolist(), [evaluations[n] for n in new])
        told = [old or made for old, made in zip(stored, evaluations, strict=True)]
        self._count(told)
        return told

    def _recall(self, labels: Bits) -> Evaluation | None:
        """What is on record of a labelling, with its proofs where the pool needs them."""
        found = self.store.find(labels)
        if found is None or self._consultant is None:
            return found
        return replace(found, proofs=self._consultant.archive.find(labels))

    def _send(self, workers: Workers, labellings: Bits, company: Bits | None = None) -> Sent:
        """Begin to evaluate what the store does not have."""
        found: list[Evaluation | None] = [self._recall(labels) for labels in labellings]
        missing = np.array([n for n, evaluation in enumerate(found) if evaluation is None], dtype=np.int64)
        run = None
        if missing.size:
            deadline = None if self.seconds is None else time.time() + self.seconds - self.elapsed
            floors = None if self._floor is None else self._floor.below(labellings[missing])
            run = workers.run(labellings[missing], deadline, floors, company)
        return Sent(labellings, found, missing, run)

    def _take(self, sent: Sent) -> list[Evaluation] | None:
        """Evaluations in the order asked, recorded as they come; None where time ran out."""
        found, labellings, missing = sent.found, sent.labellings, sent.missing
        self._count([evaluation for evaluation in found if evaluation is not None])
        if sent.run is not None:
            weights = orbit_sizes(labellings[missing], self.space.group)
            for part, evaluations in sent.run:
                if self._consultant is not None:
                    proofs = [evaluation.proofs or Proofs() for evaluation in evaluations]
                    self._consultant.archive.append(labellings[missing[part]], proofs)
                self.store.append(labellings[missing[part]], weights[part].tolist(), evaluations)
                self.solved += len(evaluations)
                for position, evaluation in zip(missing[part], evaluations, strict=True):
                    found[position] = evaluation
                self._count(evaluations)
                if self._late:
                    break
        complete = [evaluation for evaluation in found if evaluation is not None]
        return complete if len(complete) == len(found) else None

    def _count(self, evaluations: list[Evaluation]) -> None:
        self.evaluated += len(evaluations)
        values = [e.load_factor for e in evaluations if e.status is Status.COLLAPSE]
        self._best = float(np.fmax(self._best, max(values, default=np.nan)))
        if self.report is not None:
            bound = np.nan if self.driver.bound is None else self.driver.bound
            total = self.total if self.budget is None else min(self.budget, self.total or self.budget)
            self.report(Progress(self.evaluated, total, self.solved, self._best, self.elapsed, bound))


def versions() -> dict[str, str]:
    """Versions that numbers may depend on."""
    return {
        "jld": __version__,
        "python": platform.python_version(),
        "kernel": chosen() or "none",
        **{name: version(name) for name in ("numpy", "scipy", "clarabel", "highspy")},
    }
