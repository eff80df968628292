"""Evaluation of many labellings in worker processes; each owns its template and solver.

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
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import joblib
import numpy as np

from jld_core import __version__
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.threads import one_thread
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.evaluation import FAILED, Evaluation
from jld_explore.evaluation.evaluator import EvaluatorSettings
from jld_explore.evaluation.processes import DEATHS, Flight, Processes

HANG: Final = 600.0
"""Seconds without any result after which the workers are taken to hang."""

_TASKS: Final = 8
"""Tasks that labellings asked together are cut into at the least, so that workers finish together."""

_MOST: Final = 64
"""Labellings of a task at the most."""

_IN_LANES: Final = 200_000
"""Faces of the labellings of a task at the most, where the batch solver solves them, many at once: within a second."""

_FEWEST: Final = 32
"""Labellings of such a task at the least: with fewer lanes stand idle, and another portion is under way anyhow."""

_THREADS: Final = 2
"""Threads of one process that are of use: what is not within a solver waits for its turn."""

_TURN: Final = 5e-4
"""Seconds a thread waits for the interpreter at the most: the usual 5 ms are as long as the batch solver takes for a
generation of 48 labellings of 88 faces, and a search took a tenth longer by the clock."""

_own = threading.local()  # a cluster's workers may run several threads, and an evaluator has one
_last: Final[
    dict[str, Any]
] = {}  # the evaluator of this process made last, by its recipe, for threads to make theirs of


MakeEvaluator = Callable[[Assembly, EvaluatorSettings], Any]
"""Makes what evaluates labellings in a worker; of a module's own names, so that it can be sent there."""


@dataclass(frozen=True)
class WorkerSpec:
    """What a worker needs to make its evaluator: a pickle of its maker, assembly and settings, and its digest.

    version: of the program that made it; a worker of a cluster that joins later may have another.
    """

    content: bytes
    digest: str
    parent: int
    version: str = __version__

    @classmethod
    def of(cls, assembly: Assembly, settings: EvaluatorSettings, make: MakeEvaluator = evaluator_of) -> WorkerSpec:
        content = pickle.dumps((make, assembly, settings))
        # what an evaluator answers with is part of what it is
        kernel = (chosen() or "none").encode()
        return cls(content, hashlib.sha256(kernel + content).hexdigest(), os.getpid())

    def evaluator(self) -> Any:
        """The evaluator that this thread keeps: a twin of one that this process has already, where there can be one."""
        if getattr(_own, "digest", None) != self.digest:
            known = _last.get(self.digest)
            if known is None:
                if self.version != __version__:
                    raise InputError("--cluster", f"a worker has jld {__version__}", f"jld {self.version} on every one")
                make, assembly, settings = pickle.loads(self.content)
                made = make(assembly, settings)
                _last.clear()
                if hasattr(made, "twin"):
                    _last[self.digest] = made
            else:
                made = known.twin()
            _own.evaluator, _own.digest = made, self.digest
        return _own.evaluator


def batch_size(faces: int, asked: int) -> int:
    """Labellings per task, for scenes of so many faces and so many labellings asked together."""
    return int(np.clip(min(3000 // max(faces, 1), -(-asked // _TASKS)), 1, _MOST))


@one_thread()
def evaluate_batch(
    recipe: WorkerSpec,
    number: int,
    labellings: Bits,
    deadline: Deadline | None = None,
    floors: Floats | None = None,
    waiting: Bits | None = None,
    owed: bool = False,
) -> tuple[int, list[Evaluation]]:
    """Evaluate one batch in this process, with the evaluator this thread keeps.

    labellings: (k, m). deadline: after which no further labelling is begun. floors (k,)
    and waiting (j, m): see `Evaluator.evaluate`. Returns the batch's number and the evaluations, k or those up to
    the deadline. owed: all are evaluated, a search without dilation as far as it gets by the deadline.
    """
    if os.getpid() != recipe.parent and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    evaluator = recipe.evaluator()
    if owed and deadline is not None:
        try:
            # what is known of them when time is up is taken
            with deadline.enforced():
                return number, evaluator.evaluate_all(labellings, floors, waiting)
        except DeadlinePassed:
            deadline = None
    return number, evaluator.evaluate_all(labellings, floors, waiting, deadline)


class Workers:
    """A pool of `jobs` processes for one recipe; with one job everything runs in this process.

    hang: seconds without any result after which the workers are taken to hang. quick: labellings are solved sooner
    than they are sent, so stay in this process, in as many threads as are of use. lanes: the same, since the batch
    solver
    solves them. deaths: how often workers died or
    hung.
    """

    def __init__(
        self, recipe: WorkerSpec, jobs: int, faces: int, hang: float = HANG, *, quick: bool = False, batch: bool = False
    ) -> None:
        self.recipe, self.jobs, self.faces, self.hang = recipe, jobs, faces, hang
        self.deaths = 0
        self.outside = joblib.parallel.get_active_backend()[0].__class__.__name__ != "LokyBackend"
        self.batch = batch and not self.outside
        self.quick = (quick or batch) and not self.outside
        self.here = self.quick or (jobs == 1 and not self.outside)
        self.begun: list[Run] = []
        self.threads = min(jobs, _THREADS) if self.here else 0
        self._threads = ThreadPoolExecutor(self.threads) if self.threads > 1 else None
        self._turn = sys.getswitchinterval()
        if self._threads is not None:
            sys.setswitchinterval(min(_TURN, self._turn))
        self.processes = Processes(jobs, hang)
        if self.outside:
            # tasks given up at the end of a run are no news
            warnings.filterwarnings("ignore", message=r"\d+ tasks (which were|have been)", module="joblib")

    def run(
        self,
        labellings: Bits,
        deadline: Deadline | None = None,
        floors: Floats | None = None,
        waiting: Bits | None = None,
        *,
        owed: bool = False,
    ) -> Run:
        """Begin to evaluate (k, m) labellings, behind those that were begun before.

        deadline: what was not begun by then is left out. floors (k,) and waiting (j, m):
        see `Evaluator.evaluate`. owed: the first labelling is evaluated however late it
        is. With one job, and on a cluster, evaluation waits until results are asked for.
        """
        floors = np.full(len(labellings), -np.inf) if floors is None else floors
        run = Run(self, labellings, deadline, floors, waiting, owed)
        if self._threads is not None:
            run.submit()
        elif not self.here and not self.outside:
            try:
                run.begin()
            except _deaths():
                run.stop()  # it begins again when its turn comes
        return run

    def submit(self, tasks: Iterable[tuple[Any, ...]]) -> list[Callable[[], tuple[int, list[Evaluation]]]]:
        """What waits for the result of each task, arguments of `evaluate_batch`: by threads at once, where there are
        several, so that they go on while this one looks at results and asks for more; else when it is called."""
        if self._threads is None:
            return [partial(evaluate_batch, *task) for task in tasks]
        return [self._threads.submit(evaluate_batch, *task).result for task in tasks]

    def parallel(self, tasks: Iterator[Any]) -> Iterator[tuple[int, list[Evaluation]]]:
        """Results of tasks from a cluster as they finish; tasks are taken at once, and more when some are done."""
        how: dict[str, Any] = {
            "return_as": "generator_unordered",
            "batch_size": 1,
            "pre_dispatch": "2 * n_jobs",
            "timeout": self.hang,
        }
        return iter(joblib.Parallel(**how)(tasks))

    def close(self) -> None:
        """Stop all worker processes at once, whatever they are at; a cluster's are not ours to stop."""
        for run in self.begun:
            run.stop()
        self.begun = []
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
            sys.setswitchinterval(self._turn)
        self.processes.close()


class Run:
    """Labellings under evaluation; to iterate is to wait for (where they stand, their evaluations).

    Several may be begun, so that workers go on while the results of an earlier one are looked at. Where workers
    die, those of the run that is waited for are suspected; the other runs begin again when their turn comes.
    """

    def __init__(
        self,
        workers: Workers,
        labellings: Bits,
        deadline: Deadline | None,
        floors: Floats,
        waiting: Bits | None,
        owed: bool = False,
    ) -> None:
        self._workers, self._deadline, self._owed = (
            workers,
            deadline,
            owed and deadline is not None and deadline.limited,
        )
        self._labellings, self._floors, self._waiting = labellings, floors, waiting
        size = batch_size(workers.faces, len(labellings))
        if workers.quick:
            # as few tasks as there are threads, so that these seldom wait
            most = max(_MOST, _IN_LANES // workers.faces) if workers.batch else _MOST
            least = _FEWEST if workers.batch else 1
            size = max(least, min(most, -(-len(labellings) // workers.threads)))
        # what is owed is a task of its own, which no deadline cuts short
        starts = [0, *range(1, len(labellings), size)] if self._owed else list(range(0, len(labellings), size))
        ends = [*starts[1:], len(labellings)]
        self._slices = [slice(low, high) for low, high in zip(starts, ends, strict=True)]
        self._done: set[int] = set()
        self._sent: list[int] = []
        self._results: Iterable[tuple[int, list[Evaluation]]] | None = None
        self._here: list[Callable[[], tuple[int, list[Evaluation]]]] | None = None

    def submit(self) -> None:
        """Hand all tasks to the threads of this process."""
        self._here = self._workers.submit(self._arguments(number) for number in range(len(self._slices)))

    def begin(self, numbers: list[int] | None = None) -> None:
        """Send tasks to the workers; numbers: of those to send, None for all that are not done."""
        # what is owed is evaluated here, while the workers start
        waiting = [n for n in range(len(self._slices)) if n not in self._done and not (self._owed and n == 0)]
        numbers = waiting if numbers is None else numbers
        self._workers.begun.append(self)
        if self._workers.outside:
            self._sent = []
            self._results = self._workers.parallel(self._tasks(numbers))
            return
        flight = Flight(self._workers.processes, self._deadline)
        # known before the first is sent, which fails where a worker has died meanwhile
        self._results, self._sent = flight, flight.sent
        flight.begin((number, evaluate_batch, self._arguments(number)) for number in numbers)

    def stop(self) -> None:
        """Forget what was sent; what it would have given is evaluated again."""
        self._results = None

    def _joined(self, results: list[tuple[int, list[Evaluation]]]) -> Iterator[tuple[slice, list[Evaluation]]]:
        """Results of tasks side by side, as one where none is cut short by the deadline."""
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
        owed, floors = self._owed and number == 0, self._floors[part]
        return self._workers.recipe, number, self._labellings[part], self._deadline, floors, self._waiting, owed

    def _tasks(self, numbers: list[int]) -> Iterator[Any]:
        for number in numbers:
            self._sent.append(number)
            yield joblib.delayed(evaluate_batch)(*self._arguments(number))

    def __iter__(self) -> Iterator[tuple[slice, list[Evaluation]]]:
        workers = self._workers
        if workers.here:
            if self._here is None:
                self.submit()
            tasks = self._here or []
            # all threads are waited for together, and what they found is recorded at once
            for first in range(0, len(tasks), workers.threads):
                yield from self._joined([result() for result in tasks[first : first + workers.threads]])
            return
        if self._owed:
            begun = evaluate_batch(*self._arguments(0))[1]
            self._done.add(0)
            self._owed = False
            yield self._slices[0], begun
        strikes = dict.fromkeys(range(len(self._slices)), 0)
        while len(self._done) < len(self._slices):
            suspects = [number for number, count in strikes.items() if count == 1 and number not in self._done]
            try:
                if suspects:  # one at a time, so that a second death has one culprit
                    self.begin(suspects[:1])
                elif self._results is None:
                    self.begin()
                for number, evaluations in self._results or ():
                    self._done.add(number)
                    low = self._slices[number].start
                    yield slice(low, low + len(evaluations)), evaluations
                if isinstance(self._results, Flight) and self._results.late:
                    workers.close()
                    return
                self._results = None
            except _deaths():
                workers.deaths += 1
                workers.close()
                for number in self._sent:
                    if number in self._done:
                        continue
                    strikes[number] += 1
                    if strikes[number] > 1:
                        self._done.add(number)
                        part = self._slices[number]
                        yield part, [FAILED] * (part.stop - part.start)
        workers.begun = [run for run in workers.begun if run is not self]


def _deaths() -> tuple[type[BaseException], ...]:
    """What is raised where a worker died or hung; a cluster's own words for it where one is in use."""
    known: tuple[type[BaseException], ...] = (*DEATHS, multiprocessing.TimeoutError)
    distributed = sys.modules.get("distributed")
    if distributed is not None:
        known += (distributed.scheduler.KilledWorker, distributed.comm.CommClosedError)
    return known
