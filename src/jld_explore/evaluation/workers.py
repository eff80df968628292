"""Evaluate labellings in workers: `Workers` gives each task to any free thread, process or worker of a cluster."""

from __future__ import annotations

import hashlib
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import cloudpickle
import numpy as np

from jld_core._version import __version__
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.threads import one_thread
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.pool import Pool, TaskStream, client_of_cluster, is_lost, switch_interval
from jld_explore.evaluation.protocol import (
    FAILED,
    Evaluation,
    EvaluatorSettings,
    LabellingEvaluator,
    MakeEvaluator,
    SharedEvaluator,
)

_of_thread = threading.local()  # An evaluator is for one thread, but workers of a cluster may run several threads.

_of_process: Final[
    dict[str, SharedEvaluator]
] = {}  # Last evaluator of this process by digest; other threads make twins of it.
_of_search: Final[dict[str, tuple[Any, ...]]] = {}  # What the last specification of this process was made of.


@dataclass(frozen=True)
class WorkerSpec:
    content: bytes  # pickle of the function that makes the evaluator, the assembly and the settings
    digest: str  # SHA-256 of the content and the name of the batch solver
    parent: int  # process id of the process that made this specification
    version: str = __version__  # version of jld that made it; a worker of a cluster may have another one

    @classmethod
    def of(cls, assembly: Assembly, settings: EvaluatorSettings, make: MakeEvaluator = evaluator_of) -> WorkerSpec:
        content = cloudpickle.dumps((make, assembly, settings))  # pickle refuses functions defined in a program
        # Include the batch solver in the digest, since results depend on it.
        kernel = (chosen() or "none").encode()
        digest = hashlib.sha256(kernel + content).hexdigest()
        _of_search.clear()
        _of_search[digest] = make, assembly, settings
        return cls(content, digest, os.getpid())

    def evaluator(self) -> LabellingEvaluator:
        """Return the evaluator of this thread, made at the first call; InputError for another version."""
        # Another specification replaces it. If another thread of the process has one that can be shared, a twin is
        # made.
        if getattr(_of_thread, "digest", None) != self.digest:
            other = _of_process.get(self.digest)
            if other is None:
                if self.version != __version__:
                    raise ParameterError(
                        "cluster", f"a worker has jld {__version__}", f"jld {self.version} on every one"
                    )
                make, assembly, settings = _of_search.get(self.digest) or pickle.loads(self.content)
                evaluator = make(assembly, settings)
                _of_process.clear()
                if isinstance(evaluator, SharedEvaluator):
                    _of_process[self.digest] = evaluator
            else:
                evaluator = other.twin()
            _of_thread.evaluator, _of_thread.digest = evaluator, self.digest
        found: LabellingEvaluator = _of_thread.evaluator
        return found

    @property
    def settles_nearly_all(self) -> bool:
        evaluator = self.evaluator()
        return isinstance(evaluator, SharedEvaluator) and evaluator.settles_nearly_all


@one_thread()
def evaluate_batch(
    spec: WorkerSpec,
    number: int,
    labellings: Bits,
    deadline: Deadline | None = None,
    thresholds: Floats | None = None,
    required: bool = False,
) -> tuple[int, list[Evaluation]]:
    """Evaluate labellings (k, m) of one batch; return its number, and what was finished in time."""
    if os.getpid() != spec.parent and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent process handles Ctrl-C.
    evaluator = spec.evaluator()
    if required and deadline is not None:
        try:
            # Use the results known when the deadline passes.
            with deadline.enforced():
                return number, evaluator.evaluate_all(labellings, thresholds)
        except DeadlinePassed:
            deadline = None
    return number, evaluator.evaluate_all(labellings, thresholds, deadline)


HANG_SECONDS: Final = 600.0  # seconds without any result after which workers count as hung

# Smallest number of tasks into which labellings are split, so that workers finish at similar times
_FEWEST_TASKS: Final = 8

_MOST_PER_TASK: Final = 64  # largest number of labellings per task

# Largest number of faces over all labellings of a task for the batch solver, which takes about a second
_MOST_FACES_PER_TASK: Final = 200_000

# Smallest such number where a run is split: 2 ms of the batch solver, less than handing out a task and waiting for the
# interpreter gain
_LEAST_FACES_PER_TASK: Final = 2000

# Labellings of a task for the batch solver come in such numbers: others leave SIMD lanes idle
_LANES: Final = 8

# Largest useful number of threads in one process; code outside a solver waits for the interpreter lock
MOST_THREADS: Final = 2

# Time of the first thread, relative to that of all tasks, from which tasks of one process run one after another. The
# first thread then nearly fills a core, and two tasks beside it would compete for the other one: a genetic search at 88
# faces took 0.72 s on two cores with two tasks at a time, and 0.58 s with one.
_BUSY_SHARE: Final = 0.6

# Largest wait of a thread for the interpreter, s. The default of 5 ms equals the time of the batch solver for a
# generation of 48 labellings with 88 faces. With the default a search took 10 % longer in wall-clock time.
_SWITCH_SECONDS: Final = 5e-4


def _timed_batch(task: tuple[Any, ...], then: Then | None) -> tuple[tuple[int, list[Evaluation]], float]:
    """Return the result of `evaluate_batch` after what is done with it, and the processor time of its thread, s."""
    begun = time.thread_time()
    found = evaluate_batch(*task)
    if then is not None:
        _, _, labellings, deadline, *_ = task
        then(labellings[: len(found[1])], found[1], deadline)
    return found, time.thread_time() - begun


Then = Callable[[Bits, list[Evaluation], Deadline | None], None]  # work on evaluations in the thread that made them


class Workers:
    """Pool of workers for one specification: processes, a cluster, or threads of this process."""

    def __init__(
        self,
        spec: WorkerSpec,
        jobs: int,
        faces: int,
        hang_seconds: float = HANG_SECONDS,  # without any result, after which workers count as hung
        *,
        batch: bool = False,  # stay in this process: the batch solver settles nearly all labellings
        ahead: int = 0,  # runs that begin before the results of an earlier one are requested, see `Driver.ahead`
        then: Then | None = None,
    ) -> None:
        self._then = then
        self.spec, self.jobs, self.faces, self.hang_seconds = spec, jobs, faces, hang_seconds
        self.deaths = 0
        client = client_of_cluster()
        self.batch = batch and client is None
        self.in_process = self.batch or (jobs == 1 and client is None)
        self.running: list[Run] = []
        self._held: list[Run] = []
        self.threads = min(jobs, MOST_THREADS) if self.in_process else 0
        # Runs side by side keep the threads busy. Fewer, larger tasks fill the lanes and leave the first thread a core.
        self.threads_of_run = -(-self.threads // (1 + ahead))
        self._threads = Pool(self.threads, threads=True) if self.threads > 1 else None
        self._single_thread = Pool(threads=True) if self.threads > 1 and ahead else None
        self._begun_at: float | None = None
        self._seconds_of_tasks = 0.0
        self._settings = ExitStack()
        if self._threads is not None:
            self._settings.enter_context(switch_interval(_SWITCH_SECONDS))
        self.processes = Pool(jobs, cluster=True)

    def run(
        self,
        labellings: Bits,
        deadline: Deadline | None = None,
        thresholds: Floats | None = None,
        *,
        first_required: bool = False,
    ) -> Run:
        """Begin to evaluate labellings (k, m), after the runs begun before."""
        # With one job the evaluation starts when results are requested.
        thresholds = np.full(len(labellings), -np.inf) if thresholds is None else thresholds
        run = Run(self, labellings, deadline, thresholds, first_required)
        if self._threads is not None:
            run.submit()
        elif not self.in_process:
            self._held.append(run)
            if not (first_required or len(self._held) > 1):
                self.begin_held()
        return run

    def begin_held(self) -> None:
        """Begin the runs that wait for the evaluation of a first labelling in this process."""
        held, self._held = self._held, []
        for run in held:
            try:
                run.begin()
            except Exception as error:
                if not is_lost(error):
                    raise
                run.stop()  # The run starts again when its results are requested.

    def submit(self, tasks: Iterable[tuple[Any, ...]]) -> list[Callable[[], tuple[int, list[Evaluation]]]]:
        """Return one function per task that waits for its result: batch number and evaluations."""
        # With several threads the tasks start at once, otherwise when the function is called. Each task is a tuple of
        # arguments of `evaluate_batch`.
        if self._threads is None:
            return [partial(evaluate_batch, *task) for task in tasks]
        if self._begun_at is None:
            self._begun_at = time.thread_time()
        pool = self._threads
        own = time.thread_time() - self._begun_at
        known = self._seconds_of_tasks > 0.0
        if self._single_thread is not None and known and own > _BUSY_SHARE * self._seconds_of_tasks:
            pool = self._single_thread
        return [partial(self._result, pool.submit(_timed_batch, task, self._then)) for task in tasks]

    def _result(self, task: Future[tuple[tuple[int, list[Evaluation]], float]]) -> tuple[int, list[Evaluation]]:
        """Wait for a task and record its time."""
        found, seconds = task.result()
        self._seconds_of_tasks += seconds
        return found

    def abandon(self) -> None:
        """Stop all runs and local processes, which start again on demand."""
        for run in self.running:
            run.stop()
        self.running, self._held = [], []
        self.processes.close()

    def close(self) -> None:
        """Terminate all local workers at once; workers of a cluster are not stopped."""
        with self._settings:
            self.abandon()
            for pool in (self._threads, self._single_thread):
                if pool is not None:
                    pool.close()


class Run:
    """Labellings under evaluation; iterating yields (slice, evaluations) as they finish, until the deadline."""

    def __init__(
        self,
        workers: Workers,
        labellings: Bits,
        deadline: Deadline | None,
        thresholds: Floats,
        first_required: bool = False,
    ) -> None:
        self._workers, self._deadline, self._first_required = workers, deadline, first_required
        self._labellings, self._thresholds = labellings, thresholds
        # the number of labellings that a worker evaluates in one task
        size = int(np.clip(min(3000 // max(workers.faces, 1), -(-len(labellings) // _FEWEST_TASKS)), 1, _MOST_PER_TASK))
        if workers.batch:
            # Use as few tasks as threads for this run, so that threads seldom wait.
            most = max(_MOST_PER_TASK, _MOST_FACES_PER_TASK // workers.faces)
            threads = min(workers.threads_of_run, max(1, len(labellings) * workers.faces // _LEAST_FACES_PER_TASK))
            size = min(most, _LANES * -(-len(labellings) // (_LANES * threads)))
        # The labelling to be evaluated in any case is a separate task, independent of the deadline.
        starts = (
            [0, *range(1, len(labellings), size)] if self._first_required else list(range(0, len(labellings), size))
        )
        ends = [*starts[1:], len(labellings)]
        self._slices = [slice(low, high) for low, high in zip(starts, ends, strict=True)]
        self._done: set[int] = set()
        self._submitted: list[int] = []
        self._results: TaskStream | None = None
        self._results_of_threads: list[Callable[[], tuple[int, list[Evaluation]]]] | None = None

    def submit(self) -> None:
        """Submit all tasks to the threads of this process; iterating waits for their results."""
        self._results_of_threads = self._workers.submit(self._arguments(number) for number in range(len(self._slices)))

    def begin(self, numbers: list[int] | None = None) -> None:
        """Send tasks to the workers: those with the given numbers, or all unfinished ones."""
        # The labelling that is needed in any case is evaluated in this process, while the workers start.
        unfinished = [
            n for n in range(len(self._slices)) if n not in self._done and not (self._first_required and n == 0)
        ]
        numbers = unfinished if numbers is None else numbers
        self._workers.running.append(self)
        stream = TaskStream(self._workers.processes, self._workers.hang_seconds, self._deadline)
        # Set these before the first submission, which fails if a worker has died.
        self._results, self._submitted = stream, stream.submitted
        stream.begin((number, evaluate_batch, self._arguments(number)) for number in numbers)

    def stop(self) -> None:
        """Discard the results of submitted tasks; iterating evaluates those labellings again."""
        self._results = None

    def _merge_adjacent(self, results: list[tuple[int, list[Evaluation]]]) -> Iterator[tuple[slice, list[Evaluation]]]:
        """Merge results of adjacent tasks into one if the deadline cut none of them short."""
        parts = [self._slices[number] for number, _ in results]
        whole = slice(parts[0].start, parts[-1].stop)
        evaluations = [evaluation for _, found in results for evaluation in found]
        if len(evaluations) == whole.stop - whole.start:
            yield whole, evaluations
            return
        for part, (_, found) in zip(parts, results, strict=True):
            yield slice(part.start, part.start + len(found)), found

    def _arguments(self, number: int) -> tuple[Any, ...]:
        part = self._slices[number]
        required, thresholds = self._first_required and number == 0, self._thresholds[part]
        return self._workers.spec, number, self._labellings[part], self._deadline, thresholds, required

    def __iter__(self) -> Iterator[tuple[slice, list[Evaluation]]]:
        """Yield (slice, evaluations) as tasks finish; a task lost twice yields failed evaluations."""
        # Tasks of dead workers are repeated once, one at a time, and then recorded as failed.
        workers = self._workers
        if workers.in_process:
            if self._results_of_threads is None:
                self.submit()
            tasks = self._results_of_threads or []
            if self._first_required and tasks:
                yield from self._merge_adjacent([tasks.pop(0)()])
            # Wait for all threads together, so that their results are recorded in one transaction.
            for first in range(0, len(tasks), workers.threads):
                yield from self._merge_adjacent([result() for result in tasks[first : first + workers.threads]])
            return
        if self._first_required:
            evaluations = evaluate_batch(*self._arguments(0))[1]
            self._done.add(0)
            self._first_required = False
            yield self._slices[0], evaluations
        workers.begin_held()
        failures = dict.fromkeys(range(len(self._slices)), 0)
        while len(self._done) < len(self._slices):
            suspected = [number for number, count in failures.items() if count == 1 and number not in self._done]
            try:
                if suspected:  # Repeat suspected tasks one at a time, so that a second death identifies the task.
                    self.begin(suspected[:1])
                elif self._results is None:
                    self.begin()
                for number, evaluations in self._results or ():
                    self._done.add(number)
                    low = self._slices[number].start
                    yield slice(low, low + len(evaluations)), evaluations
                if self._results is not None and self._results.late:
                    workers.abandon()
                    return
                self._results = None
            except Exception as error:
                if not is_lost(error):
                    raise
                workers.deaths += 1
                workers.abandon()
                for number in self._submitted:
                    if number in self._done:
                        continue
                    failures[number] += 1
                    if failures[number] > 1:
                        self._done.add(number)
                        part = self._slices[number]
                        yield part, [FAILED] * (part.stop - part.start)
        workers.running = [run for run in workers.running if run is not self]
