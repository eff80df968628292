"""Run tasks in local worker processes and return results as they finish, up to a deadline.

The processes are those of joblib (loky), without joblib's own dispatch loop.
That loop dispatches from its own threads, which print warnings and tracebacks when a run is stopped early.
Every run with a time limit is stopped early.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Final

from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import ShutdownExecutorError

from jld_core.deadline import Deadline
from jld_explore.evaluation.deferred_signals import deferred_signals
from jld_explore.evaluation.process_settings import ignored_warning

# Exceptions of a task whose worker died, left or hung; a cluster has its own ones
_LOSSES: Final = (BrokenExecutor, ShutdownExecutorError, CancelledError, TimeoutError, multiprocessing.TimeoutError)

GRACE: Final = 0.3
"""Seconds after a deadline in which evaluations already begun may finish."""

_TASKS_PER_PROCESS: Final = 2  # tasks per process that are submitted ahead; if a worker dies, all of them are suspected

_THREADS: Final = ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM", "NUMEXPR", "NUMBA")
SINGLE_THREADED: Final = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
"""Environment of a worker: one BLAS thread, since matrices are small and the jobs use the cores."""


def warning_of_stops_ignored() -> AbstractContextManager[None]:
    """Ignore loky's warning about terminated workers (context manager)."""
    return ignored_warning("A worker stopped while some jobs", UserWarning)


class Processes:
    """Pool of local worker processes, started on first use.

    jobs: number of processes. hang_seconds: seconds without any result after which the processes count as hung.
    """

    def __init__(self, jobs: int, hang_seconds: float) -> None:
        self.jobs, self.hang_seconds = jobs, hang_seconds
        self._executor: Any = None
        self._settings = ExitStack()

    def submit(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Future[Any]:
        """Submit a task and return its future; the first call starts the processes.

        The function must be importable in other processes. If a process has died, the future raises.
        """
        if self._executor is None:
            self._settings.enter_context(warning_of_stops_ignored())
        with deferred_signals():
            self._executor = get_reusable_executor(
                max_workers=self.jobs,
                initializer=worker_init,
                initargs=(os.getpid(),),
                env=SINGLE_THREADED,
            )
            future: Future[Any] = self._executor.submit(function, *arguments)
        return future

    def close(self) -> None:
        """Terminate all processes at once, including those with unfinished tasks.

        Another `submit` starts new ones.
        """
        executor, self._executor = self._executor, None
        with self._settings:
            if executor is not None:
                stop_processes(executor)


class TaskStream:
    """Tasks of one run, submitted in part; iterating yields their results as they finish.

    Iteration raises TimeoutError if no result arrives within `hang_seconds`, and the error of a task that failed.

    processes: pool that runs the tasks. submitted: numbers of the tasks submitted so far. late: True if the iteration
    ended because the deadline passed.
    """

    def __init__(self, processes: Processes, deadline: Deadline | None) -> None:
        self._processes, self._deadline = processes, deadline
        self._waiting: deque[tuple[int, Callable[..., Any], tuple[Any, ...]]] = deque()
        self._in_progress: dict[Future[Any], int] = {}
        self.submitted: list[int] = []
        self.late = False

    def begin(self, tasks: Iterator[tuple[int, Callable[..., Any], tuple[Any, ...]]]) -> None:
        """Submit tasks (number, function, arguments): some at once, others as results arrive.

        Iterate over the stream to get the results.
        """
        self._waiting = deque(tasks)
        self._submit_waiting()

    def _submit_waiting(self) -> None:
        """Submit tasks until `_TASKS_PER_PROCESS` tasks per process are in progress."""
        while self._waiting and len(self._in_progress) < _TASKS_PER_PROCESS * self._processes.jobs:
            number, function, arguments = self._waiting.popleft()
            self.submitted.append(number)
            self._in_progress[self._processes.submit(function, arguments)] = number

    def __iter__(self) -> Iterator[Any]:
        """Yield results as they finish; stop and set `late` if the deadline ends the wait.

        Raises TimeoutError if no result arrives within `hang_seconds` and the deadline has not passed.
        The wait for one result lasts at most until `GRACE` seconds after the deadline.
        """
        while self._in_progress:
            longest_wait = self._processes.hang_seconds
            if self._deadline is not None:
                longest_wait = min(longest_wait, self._deadline.remaining() + GRACE)
            finished = wait(self._in_progress, timeout=longest_wait, return_when=FIRST_COMPLETED).done
            if not finished:
                if self._deadline is None or not self._deadline.passed():
                    raise TimeoutError
                self.late = True
                return
            for future in sorted(finished, key=self._in_progress.__getitem__):
                del self._in_progress[future]
                result = future.result()
                self._submit_waiting()
                yield result


def stop_processes(executor: Any) -> None:
    """Terminate the processes of an executor at once, including those with unfinished tasks.

    executor: executor of loky; one without processes is only shut down.
    """
    # shutdown(kill_workers=True) would let loky's thread print errors about tasks that still wait.
    for process in list((getattr(executor, "_processes", None) or {}).values()):
        process.terminate()
    executor.shutdown(wait=True)


def is_lost(error: BaseException) -> bool:
    """Return True if a task failed because its worker died, left or hung.

    error: exception of the task. Result: True if another worker may succeed, False for an error of the task itself.
    """
    return isinstance(error, _LOSSES) or type(error).__module__.startswith("distributed")


def worker_init(parent: int) -> None:
    """Initialise a worker process: ignore Ctrl-C, and exit when the parent process has ended.

    parent: process id of the parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(parent: int) -> None:
    """Exit this process when its parent is no longer the given process; check every 0.5 s."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
