"""Provide workers that keep state between tasks: local processes or workers of a cluster.

`Workers` gives each task to any free worker.
A `PoolWorker` is one process that receives task after task, so that each task needs to contain new data only.
If its process dies or its cluster worker leaves, its state is lost and another worker replaces it.
"""

from __future__ import annotations

import math
import os
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, suppress
from typing import Any, Final

from joblib.externals.loky import ProcessPoolExecutor, process_executor

from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.evaluation.deferred_signals import deferred_signals
from jld_explore.evaluation.processes import SINGLE_THREADED, stopping_on_purpose, worker_init

_LIVES: Final = 10
"""Number of local processes that may replace dead ones; more deaths than this are not accidental."""


_DEATHS: Final = (BrokenExecutor, CancelledError, OSError)
"""Exceptions that a dead worker process raises; a cluster has its own ones."""

_LOOK: Final = 0.5
"""Seconds between queries of a cluster for its present workers."""


class PoolWorker:
    """Local process or cluster worker that keeps state between tasks.

    Parameters
    ----------
    executor : Executor
        Executor with this single worker.
    place : str, optional
        Address of the worker on a cluster; None for a local process.

    Attributes
    ----------
    name : str
        Unique name, never reused.
    """

    def __init__(self, executor: Any, place: str | None = None) -> None:
        self.name, self.place = uuid.uuid4().hex, place
        self._executor: Executor = executor

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a task; its future raises an error if the process has died."""
        with deferred_signals():
            return self._executor.submit(work, *arguments)

    def close(self) -> None:
        """Terminate a local process at once; release a worker of a cluster."""
        processes: dict[int, Any] = getattr(self._executor, "_processes", None) or {}
        for process in list(processes.values()):
            process.terminate()
        # Ignore errors of a cluster that no longer exists.
        with suppress(Exception):
            self._executor.shutdown(wait=self.place is None)


class WorkerPool:
    """Pool of one `PoolWorker` per job, or per worker of the cluster in use.

    Parameters
    ----------
    jobs : int
        Number of local processes; ignored on a cluster.
    """

    def __init__(self, jobs: int) -> None:
        self._client = client_of_cluster()
        self._jobs, self._left = jobs, jobs + _LIVES
        self._looked = -math.inf
        self._seats: list[PoolWorker] = []
        self._settings = ExitStack()
        self._settings.enter_context(stopping_on_purpose())

    def __iter__(self) -> Iterator[PoolWorker]:
        """Iterate over the workers."""
        return iter(self._seats)

    def __len__(self) -> int:
        """Return the number of workers."""
        return len(self._seats)

    def fill(self) -> list[PoolWorker]:
        """Add missing workers and return the cluster workers that have left.

        Returns
        -------
        list of PoolWorker
            Workers removed from the pool; always empty for local processes.
        """
        if self._client is None:
            while len(self._seats) < self._jobs and self._left > 0:
                self._left -= 1
                self._seats.append(PoolWorker(local_processes(1)))
            return []
        if time.monotonic() - self._looked < _LOOK:
            return []
        self._looked = time.monotonic()
        try:
            present = list(self._client.ncores())
        except (OSError, RuntimeError):  # A scheduler that has stopped has no workers.
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
        """Remove a worker whose process has died; `fill` replaces it."""
        self._seats.remove(seat)
        seat.close()

    def close(self) -> None:
        """Remove and close all workers."""
        with self._settings:
            for seat in list(self._seats):
                self.lose(seat)


def is_lost(error: BaseException) -> bool:
    """Return whether a task failed because its worker died or left, not by an error of its own.

    Parameters
    ----------
    error : BaseException
        Exception of the task's future.

    Returns
    -------
    bool
        True if another worker may succeed.
    """
    return isinstance(error, _DEATHS) or type(error).__module__.startswith("distributed")


def local_processes(count: int) -> ProcessPoolExecutor:
    """Return an executor of local processes, which start with its first task."""
    return ProcessPoolExecutor(max_workers=count, initializer=_begin, initargs=(os.getpid(),), env=SINGLE_THREADED)


def _begin(parent: int) -> None:
    """Initialise a local process and disable loky's check for memory leaks."""
    worker_init(parent)
    # State grows on purpose; loky would treat it as a memory leak and replace the process.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
