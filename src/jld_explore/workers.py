"""Evaluation of many labellings in joblib workers; each owns its template and solver.

A worker that dies or hangs costs its batch, not the run: what was in flight is tried once more, alone, and
recorded as failed if that ends the same way. Inside `joblib.parallel_config(backend=...)` with another backend
than joblib's own processes (a dask or ray cluster) that backend does the work, whatever `jobs` is.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import joblib
import numpy as np
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from jld_core.assembly import Assembly, Bits, Floats
from jld_explore.evaluator import FAILED, Evaluation, Evaluator, EvaluatorSettings

HANG: Final = 600.0
"""Seconds without any result after which the workers are taken to hang."""

_TASKS: Final = 16
"""Tasks that labellings asked together are cut into at the least, so that workers finish together."""

_own = threading.local()  # a cluster's workers may run several threads, and an evaluator has one


@dataclass(frozen=True)
class Recipe:
    """What a worker needs to make its evaluator: a pickle of assembly and settings, and its digest."""

    content: bytes
    digest: str
    parent: int

    @classmethod
    def of(cls, assembly: Assembly, settings: EvaluatorSettings) -> Recipe:
        content = pickle.dumps((assembly, settings))
        return cls(content, hashlib.sha256(content).hexdigest(), os.getpid())


def batch_size(faces: int, asked: int) -> int:
    """Labellings per task, for scenes of so many faces and so many labellings asked together."""
    return int(np.clip(min(3000 // max(faces, 1), -(-asked // _TASKS)), 1, 64))


def evaluate_batch(
    recipe: Recipe,
    number: int,
    labellings: Bits,
    deadline: float | None = None,
    likely: Floats | None = None,
) -> tuple[int, list[Evaluation]]:
    """Evaluate one batch in this process, with the evaluator this thread keeps.

    labellings: (k, m). deadline: time since the epoch, s, after which no further labelling is begun. likely:
    (k,) see `Evaluator.evaluate`. Returns the batch's number and the evaluations, k or those up to the deadline.
    """
    if os.getpid() != recipe.parent and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    if getattr(_own, "digest", None) != recipe.digest:
        assembly, settings = pickle.loads(recipe.content)
        _own.evaluator, _own.digest = Evaluator(assembly, settings), recipe.digest
    found: list[Evaluation] = []
    bounds = np.full(len(labellings), np.inf) if likely is None else likely
    for labels, bound in zip(labellings, bounds.tolist(), strict=True):
        if deadline is not None and time.time() >= deadline:
            break
        found.append(_own.evaluator.evaluate(labels, bound))
    return number, found


class Workers:
    """A pool of `jobs` processes for one recipe; with one job everything runs in this process.

    hang: seconds without any result after which the workers are taken to hang. deaths: how often workers
    died or hung.
    """

    def __init__(self, recipe: Recipe, jobs: int, faces: int, hang: float = HANG) -> None:
        self.recipe, self.jobs, self.faces, self.hang = recipe, jobs, faces, hang
        self.deaths = 0
        self._outside = joblib.parallel.get_active_backend()[0].__class__.__name__ != "LokyBackend"

    def run(
        self, labellings: Bits, deadline: float | None = None, likely: Floats | None = None
    ) -> Iterator[tuple[slice, list[Evaluation]]]:
        """Evaluate (k, m) labellings; yields (where they stand, their evaluations) as batches finish.

        deadline: time since the epoch, s; what was not begun by then is left out. likely: (k,) see
        `Evaluator.evaluate`.
        """
        likely = np.full(len(labellings), np.inf) if likely is None else likely
        size = batch_size(self.faces, len(labellings))
        starts = range(0, len(labellings), size)
        slices = [slice(low, min(low + size, len(labellings))) for low in starts]
        if self.jobs == 1 and not self._outside:
            for number, part in enumerate(slices):
                evaluations = evaluate_batch(self.recipe, number, labellings[part], deadline, likely[part])[1]
                yield slice(part.start, part.start + len(evaluations)), evaluations
            return
        done: set[int] = set()
        strikes = dict.fromkeys(range(len(slices)), 0)
        while len(done) < len(slices):
            waiting = [number for number in range(len(slices)) if number not in done]
            suspects = [number for number in waiting if strikes[number] == 1]
            if suspects:  # one at a time, so that a second death has one culprit
                waiting = suspects[:1]
            sent: list[int] = []
            try:
                for number, evaluations in self._parallel(waiting, slices, (labellings, likely), sent, deadline):
                    done.add(number)
                    low = slices[number].start
                    yield slice(low, low + len(evaluations)), evaluations
            except _deaths():
                self.deaths += 1
                self.close()
                for number in sent:
                    if number in done:
                        continue
                    strikes[number] += 1
                    if strikes[number] > 1:
                        done.add(number)
                        yield slices[number], [FAILED] * (slices[number].stop - slices[number].start)

    def _parallel(
        self,
        numbers: list[int],
        slices: list[slice],
        asked: tuple[Bits, Floats],
        sent: list[int],
        deadline: float | None,
    ) -> Iterator[tuple[int, list[Evaluation]]]:
        def tasks() -> Iterator[Any]:
            for number in numbers:
                sent.append(number)
                labellings, likely = (part[slices[number]] for part in asked)
                yield joblib.delayed(evaluate_batch)(self.recipe, number, labellings, deadline, likely)

        how: dict[str, Any] = {
            "return_as": "generator_unordered",
            "batch_size": 1,
            "pre_dispatch": "2 * n_jobs",
            "timeout": self.hang,
        }
        if self._outside:
            yield from joblib.Parallel(**how)(tasks())
            return
        # one BLAS thread per worker: the matrices are small, and jobs are what the cores are for
        with joblib.parallel_config(
            inner_max_num_threads=1,
            backend="loky",
            n_jobs=self.jobs,
            initializer=_attend,
            initargs=(os.getpid(),),
        ):
            pool = joblib.Parallel(**how)
            yield from pool(tasks())

    def close(self) -> None:
        """Stop all worker processes at once; a cluster's are not ours to stop."""
        if self.jobs > 1 and not self._outside:
            get_reusable_executor().shutdown(wait=True, kill_workers=True)


def _attend(parent: int) -> None:
    """Begin a worker: leave Ctrl-C to the parent, and do not outlive it when it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with, args=(parent,), daemon=True).start()


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _deaths() -> tuple[type[BaseException], ...]:
    """What is raised where a worker died or hung; a cluster's own words for it where one is in use."""
    known: tuple[type[BaseException], ...] = (TerminatedWorkerError, TimeoutError, multiprocessing.TimeoutError)
    distributed = sys.modules.get("distributed")
    if distributed is not None:
        known += (distributed.scheduler.KilledWorker, distributed.comm.CommClosedError)
    return known
