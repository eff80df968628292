"""Places at which work goes on that keeps something from task to task: processes of our own, or workers of a cluster.

`Workers` hands each task to whoever is free; a **seat** is one process that is given task after task, so that it is
told only what is new. A seat whose process dies, or whose worker leaves, is lost with what it kept, and
another takes its place.
"""

from __future__ import annotations

import math
import os
import sys
import time
import uuid
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any, Final

from joblib.externals.loky import ProcessPoolExecutor, process_executor

from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.evaluation.deferred_signals import deferred_signals
from jld_explore.evaluation.processes import SINGLE_THREADED, worker_init

_LIVES: Final = 10
"""Processes of our own that may be begun in the place of dead ones; what kills so many is no accident."""


_LOOK: Final = 0.5
"""Seconds after which a cluster is asked again which workers it has."""


class PoolWorker:
    """One process, or one worker of a cluster. name: not another's, ever. place: its address on a cluster."""

    def __init__(self, executor: Any, place: str | None = None) -> None:
        self.name, self.place = uuid.uuid4().hex, place
        self._executor: Executor = executor

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Begin a task; the future raises where the process died meanwhile."""
        with deferred_signals():
            return self._executor.submit(work, *arguments)

    def close(self) -> None:
        """Stop a process of our own at once, whatever it is at; a worker of a cluster is let go."""
        processes: dict[int, Any] = getattr(self._executor, "_processes", None) or {}
        for process in list(processes.values()):
            process.terminate()
        # a cluster that has gone away cannot be told
        with suppress(Exception):
            self._executor.shutdown(wait=self.place is None)


class WorkerPool:
    """As many seats as there are jobs, or workers where a study is on a cluster."""

    def __init__(self, jobs: int) -> None:
        self._client = client_of_cluster()
        self._jobs, self._left = jobs, jobs + _LIVES
        self._looked = -math.inf
        self._seats: list[PoolWorker] = []
        # workers that are stopped on purpose are no news; loky says so from a thread of its own
        warnings.filterwarnings("ignore", message="A worker stopped while some jobs", category=UserWarning)

    def __iter__(self) -> Iterator[PoolWorker]:
        return iter(self._seats)

    def __len__(self) -> int:
        return len(self._seats)

    def fill(self) -> list[PoolWorker]:
        """Have a seat for every job, or for every worker that is there; those whose workers have left are returned."""
        if self._client is None:
            while len(self._seats) < self._jobs and self._left > 0:
                self._left -= 1
                self._seats.append(PoolWorker(_process()))
            return []
        if time.monotonic() - self._looked < _LOOK:
            return []
        self._looked = time.monotonic()
        try:
            present = list(self._client.ncores())
        except (OSError, RuntimeError):  # a scheduler that has gone has no workers
            present = []
        gone = [seat for seat in self._seats if seat.place not in present]
        for seat in gone:
            self.lose(seat)
        taken = {seat.place for seat in self._seats}
        for place in present:
            if place not in taken:
                executor = self._client.get_executor(workers=[place], pure=False, allow_other_workers=False)
                self._seats.append(PoolWorker(executor, place))
        return gone

    def lose(self, seat: PoolWorker) -> None:
        """Give a seat up, whose process has died; `fill` puts another in its place."""
        self._seats.remove(seat)
        seat.close()

    def close(self) -> None:
        """Give all up."""
        for seat in list(self._seats):
            self.lose(seat)


def _process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(max_workers=1, initializer=_begin, initargs=(os.getpid(),), env=SINGLE_THREADED)


def _begin(parent: int) -> None:
    worker_init(parent)
    # what grows here is kept on purpose; loky would take it for a leak, and the process for one to be replaced
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
