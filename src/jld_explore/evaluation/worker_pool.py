"""Provide workers that keep state between tasks: local processes or workers of a cluster.

`Workers` gives each task to any free worker.
A `PoolWorker` is one process that receives task after task, so that each task needs to contain new data only.
If its process dies or its cluster worker leaves, its state is lost and another worker replaces it. `WorkerPool` is the
one place that finds this out; its users receive None or `LOST` in place of a future or a result.
"""

from __future__ import annotations

import math
import os
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import ExitStack, suppress
from enum import Enum
from typing import Any, Final, TypeVar

from joblib.externals.loky import ProcessPoolExecutor, process_executor

from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.evaluation.deferred_signals import deferred_signals
from jld_explore.evaluation.processes import (
    SINGLE_THREADED,
    is_lost,
    stop_processes,
    warning_of_stops_ignored,
    worker_init,
)

# Number of local processes that may replace dead ones; more deaths than this are not accidental
_SPARE_STARTS: Final = 10


_QUERY_SECONDS: Final = 0.5  # seconds between queries of a cluster for its present workers


Result = TypeVar("Result")
"""Type of the result of a task."""


class Lost(Enum):
    """Type of `LOST`, the result of a task whose worker died or left."""

    LOST = "lost"


LOST: Final = Lost.LOST
"""Value in place of a result where the worker died or left."""


class PoolWorker:
    """Local process or cluster worker that keeps state between tasks.

    executor: executor with this single worker. address: address of the worker on a cluster; None for a local process.
    name: unique name, never reused.
    """

    def __init__(self, executor: Any, address: str | None = None) -> None:
        self.name, self.address = uuid.uuid4().hex, address
        self._executor: Executor = executor

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Submit a task; raise an error, now or in its future, if the process has died."""
        with deferred_signals():
            return self._executor.submit(function, *arguments)

    def close(self) -> None:
        """Terminate a local process at once; release a worker of a cluster."""
        if self.address is None:
            stop_processes(self._executor)
            return
        # Ignore errors of a cluster that no longer exists.
        with suppress(Exception):
            self._executor.shutdown(wait=False)


class WorkerPool:
    """Pool of one `PoolWorker` per job, or per worker of the cluster in use.

    jobs: number of local processes; ignored on a cluster.
    """

    def __init__(self, jobs: int) -> None:
        self._client = client_of_cluster()
        self._jobs, self._starts_left = jobs, jobs + _SPARE_STARTS
        self._queried_at = -math.inf
        self._workers: list[PoolWorker] = []
        self._process_settings = ExitStack()
        self._process_settings.enter_context(warning_of_stops_ignored())

    def __iter__(self) -> Iterator[PoolWorker]:
        """Iterate over the workers."""
        return iter(self._workers)

    def __len__(self) -> int:
        """Return the number of workers."""
        return len(self._workers)

    def fill(self) -> list[PoolWorker]:
        """Add missing workers and return the cluster workers that have left.

        Result: workers removed from the pool; always empty for local processes.
        """
        if self._client is None:
            while len(self._workers) < self._jobs and self._starts_left > 0:
                self._starts_left -= 1
                self._workers.append(PoolWorker(_start_process()))
            return []
        if time.monotonic() - self._queried_at < _QUERY_SECONDS:
            return []
        self._queried_at = time.monotonic()
        try:
            present = list(self._client.ncores())
        except (OSError, RuntimeError):  # A scheduler that has stopped has no workers.
            present = []
        departed = [worker for worker in self._workers if worker.address not in present]
        for worker in departed:
            self.remove(worker)
        addresses = {worker.address for worker in self._workers}
        for address in present:
            if address not in addresses:
                executor = self._client.get_executor(workers=[address], pure=False, allow_other_workers=False)
                self._workers.append(PoolWorker(executor, address))
        return departed

    def first(self) -> PoolWorker | None:
        """Return the first worker, started if necessary; None if the cluster has none."""
        self.fill()
        return next(iter(self), None)

    def submit(self, worker: PoolWorker, function: Callable[..., Result], *arguments: Any) -> Future[Result] | None:
        """Submit a task to one worker.

        worker: a worker of this pool. function: function of the task, defined at module level. *arguments: arguments of
        the function. Result: result of the task. None if the worker has died; the worker is then removed.
        """
        try:
            return worker.submit(function, *arguments)
        except Exception:  # the exception of an executor whose process died depends on its kind
            self.remove(worker)
            return None

    def result(self, worker: PoolWorker, future: Future[Result]) -> Lost | Result:
        """Return the result of a task, waiting for it.

        worker: worker that the task was submitted to. future: the task. Result: result of the task. `LOST` if its
        worker died or left; the worker is then removed. Raises Exception: an error of the task itself, which another
        worker would repeat.
        """
        try:
            return future.result()
        except Exception as error:
            # A lost connection to a worker of a cluster is an OSError.
            if not (is_lost(error) or (worker.address is not None and isinstance(error, OSError))):
                raise
            self.remove(worker)
            return LOST

    def remove(self, worker: PoolWorker) -> None:
        """Stop and remove a worker, which `fill` replaces; no effect if it was removed before."""
        if worker in self._workers:
            self._workers.remove(worker)
            worker.close()

    def close(self) -> None:
        """Remove and close all workers."""
        with self._process_settings:
            for worker in list(self._workers):
                self.remove(worker)


def _start_process() -> ProcessPoolExecutor:
    """Start the executor of one local process."""
    return local_processes(1)


def local_processes(count: int) -> ProcessPoolExecutor:
    """Return an executor of local processes, which start with its first task."""
    return ProcessPoolExecutor(
        max_workers=count, initializer=_init_process, initargs=(os.getpid(),), env=SINGLE_THREADED
    )


def _init_process(parent: int) -> None:
    """Initialise a local process and disable loky's check for memory leaks."""
    worker_init(parent)
    # State grows on purpose; loky would treat it as a memory leak and replace the process.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
