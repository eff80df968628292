"""Evaluation of many labellings in joblib workers; each owns its template and solver.

A worker that dies or hangs costs its batch, not the run: what was in flight is tried once more, alone, and
recorded as failed if that ends the same way.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import joblib
import numpy as np
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from jld_core.assembly import Assembly, Bits
from jld_explore.evaluator import FAILED, Evaluation, Evaluator, EvaluatorSettings

_HANG = 600.0
"""Seconds without any result after which the workers are taken to hang."""

_own: dict[str, Evaluator] = {}


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


def batch_size(faces: int) -> int:
    """Labellings per task: by the size of the scene alone, so that results never depend on clocks or jobs."""
    return int(np.clip(3000 // max(faces, 1), 1, 64))


def evaluate_batch(recipe: Recipe, number: int, labellings: Bits) -> tuple[int, list[Evaluation]]:
    """Evaluate one batch in this process, with the evaluator this process keeps.

    labellings: (k, m). Returns the batch's number and k evaluations.
    """
    if os.getpid() != recipe.parent:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    if recipe.digest not in _own:
        _own.clear()
        assembly, settings = pickle.loads(recipe.content)
        _own[recipe.digest] = Evaluator(assembly, settings)
    return number, [_own[recipe.digest].evaluate(labels) for labels in labellings]


class Workers:
    """A pool of `jobs` processes for one recipe; with one job everything runs in this process."""

    def __init__(self, recipe: Recipe, jobs: int, faces: int) -> None:
        self.recipe, self.jobs = recipe, jobs
        self.size = batch_size(faces)
        self.deaths = 0

    def run(self, labellings: Bits) -> Iterator[tuple[slice, list[Evaluation]]]:
        """Evaluate (k, m) labellings; yields (where they stand, their evaluations) as batches finish."""
        slices = [
            slice(low, min(low + self.size, len(labellings))) for low in range(0, len(labellings), self.size)
        ]
        if self.jobs == 1:
            for number, part in enumerate(slices):
                yield part, evaluate_batch(self.recipe, number, labellings[part])[1]
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
                for number, evaluations in self._parallel(waiting, slices, labellings, sent):
                    done.add(number)
                    yield slices[number], evaluations
            except (TerminatedWorkerError, TimeoutError):
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
        self, numbers: list[int], slices: list[slice], labellings: Bits, sent: list[int]
    ) -> Iterator[tuple[int, list[Evaluation]]]:
        def tasks() -> Iterator[Any]:
            for number in numbers:
                sent.append(number)
                yield joblib.delayed(evaluate_batch)(self.recipe, number, labellings[slices[number]])

        # one BLAS thread per worker: the matrices are small, and jobs are what the cores are for
        with joblib.parallel_config(inner_max_num_threads=1, backend="loky", n_jobs=self.jobs):
            pool = joblib.Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="2 * n_jobs", timeout=_HANG
            )
            yield from pool(tasks())

    def close(self) -> None:
        """Stop all worker processes at once."""
        if self.jobs > 1:
            get_reusable_executor().shutdown(wait=True, kill_workers=True)
