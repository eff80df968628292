"""Worker processes of our own: tasks in, results as they finish, and an end when time is up.

joblib's workers (loky), without joblib's loop around them: that one dispatches from threads of its own, so that a run
which is given up, as every run with a time limit is, ends in warnings and tracebacks from those threads.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, Final

from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import ShutdownExecutorError, TerminatedWorkerError

from jld_core.deadline import Deadline
from jld_explore.evaluation.deferred_signals import deferred_signals

DEATHS: Final = (TerminatedWorkerError, ShutdownExecutorError, TimeoutError)
"""What is raised where a worker died or hung."""

GRACE: Final = 0.3
"""Seconds after a deadline in which evaluations that were begun may end."""

_AHEAD: Final = 2
"""Tasks for each process that are sent ahead; where a worker dies all of them are suspected."""

_THREADS: Final = ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM", "NUMEXPR", "NUMBA")
SINGLE_THREADED: Final = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
"""Environment of a worker: one BLAS thread, since the matrices are small, and jobs are what the cores are for."""


class Processes:
    """`jobs` processes. hang: seconds without any result after which they are taken to hang."""

    def __init__(self, jobs: int, hang: float) -> None:
        self.jobs, self.hang = jobs, hang
        self._executor: Any = None
        # workers that are stopped on purpose are no news; loky says so from a thread of its own
        warnings.filterwarnings("ignore", message="A worker stopped while some jobs", category=UserWarning)

    def submit(self, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Future[Any]:
        """Begin a task."""
        with deferred_signals():
            self._executor = get_reusable_executor(
                max_workers=self.jobs,
                initializer=worker_init,
                initargs=(os.getpid(),),
                env=SINGLE_THREADED,
            )
            future: Future[Any] = self._executor.submit(work, *arguments)
        return future

    def close(self) -> None:
        """Stop all processes at once, whatever they are at."""
        executor, self._executor = self._executor, None
        if executor is None:
            return
        # not shutdown(kill_workers=True): where tasks wait still, loky's own thread trips over them and says so
        for process in list((executor._processes or {}).values()):
            process.terminate()
        executor.shutdown(wait=True)


class Flight:
    """Tasks of one run, some of them sent ahead. deadline: of the run, or None."""

    def __init__(self, processes: Processes, deadline: Deadline | None) -> None:
        self._processes, self._deadline = processes, deadline
        self._left: deque[tuple[int, Callable[..., Any], tuple[Any, ...]]] = deque()
        self._flying: dict[Future[Any], int] = {}
        self.sent: list[int] = []
        self.late = False

    def begin(self, tasks: Iterator[tuple[int, Callable[..., Any], tuple[Any, ...]]]) -> None:
        """Send tasks: number, work and its arguments; the first ones at once, the others as these come back."""
        self._left = deque(tasks)
        self._send()

    def _send(self) -> None:
        while self._left and len(self._flying) < _AHEAD * self._processes.jobs:
            number, work, arguments = self._left.popleft()
            self.sent.append(number)
            self._flying[self._processes.submit(work, arguments)] = number

    def __iter__(self) -> Iterator[Any]:
        """Results as they come. Where time is up and none came for GRACE seconds it ends, and `late` says so."""
        while self._flying:
            patience = self._processes.hang
            if self._deadline is not None:
                patience = min(patience, self._deadline.remaining() + GRACE)
            finished = wait(self._flying, timeout=patience, return_when=FIRST_COMPLETED).done
            if not finished:
                if self._deadline is None or not self._deadline.passed():
                    raise TimeoutError
                self.late = True
                return
            for future in sorted(finished, key=self._flying.__getitem__):
                del self._flying[future]
                result = future.result()
                self._send()
                yield result


def worker_init(parent: int) -> None:
    """Begin a worker: leave Ctrl-C to the parent, and do not outlive it when it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with, args=(parent,), daemon=True).start()


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
