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
from jld_explore.evaluation.processes import SINGLE_THREADED, warning_of_stops_ignored, worker_init

_SPARE_STARTS: Final = 10
"""Number of local processes that may replace dead ones; more deaths than this are not accidental."""


_DEATHS: Final = (BrokenExecutor, CancelledError, OSError)
"""Exceptions that a dead worker process raises; a cluster has its own ones."""

_QUERY_SECONDS: Final = 0.5
"""Seconds between queries of a cluster for its present workers."""


class PoolWorker:
    """Local process or cluster worker that keeps state between tasks.

    Parameters
    ----------
    executor : Executor
        Executor with this single worker.
    address : str, optional
        Address of the worker on a cluster; None for a local process.

    Attributes
    ----------
    name : str
        Unique name, never reused.
    """

    def __init__(self, executor: Any, address: str | None = None) -> None:
        self.name, self.address = uuid.uuid4().hex, address
        self._executor: Executor = executor

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a task; its future raises an error if the process has died."""
        with deferred_signals():
            return self._executor.submit(function, *arguments)

    def close(self) -> None:
        """Terminate a local process at once; release a worker of a cluster."""
        processes: dict[int, Any] = getattr(self._executor, "_processes", None) or {}
        for process in list(processes.values()):
            process.terminate()
        # Ignore errors of a cluster that no longer exists.
        with suppress(Exception):
            self._executor.shutdown(wait=self.address is None)


class WorkerPool:
    """Pool of one `PoolWorker` per job, or per worker of the cluster in use.

    Parameters
    ----------
    jobs : int
        Number of local processes; ignored on a cluster.
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

        Returns
        -------
        list of PoolWorker
            Workers removed from the pool; always empty for local processes.
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

    def remove(self, worker: PoolWorker) -> None:
        """Remove a worker whose process has died; `fill` replaces it."""
        self._workers.remove(worker)
        worker.close()

    def close(self) -> None:
        """Remove and close all workers."""
        with self._process_settings:
            for worker in list(self._workers):
                self.remove(worker)


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


def _start_process() -> ProcessPoolExecutor:
    """Start the executor of one local process."""
    return ProcessPoolExecutor(max_workers=1, initializer=_init_process, initargs=(os.getpid(),), env=SINGLE_THREADED)


def _init_process(parent: int) -> None:
    """Initialise a local process and disable loky's check for memory leaks."""
    worker_init(parent)
    # State grows on purpose; loky would treat it as a memory leak and replace the process.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
