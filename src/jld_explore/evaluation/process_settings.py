"""Change settings of the process while a pool of workers exists, then restore them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from threading import Lock
from typing import Any, Final

import joblib
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import ShutdownExecutorError

from jld_core._version import __version__
from jld_core.deadline import Deadline
from jld_core.errors import ParameterError

_CHANGING: Final = Lock()  # lock of the bookkeeping, since pools may be opened and closed by several threads


class _OpenContexts:
    """Bookkeeping of the open contexts, so that the last one to close restores the setting."""

    intervals: Final[list[float]] = []
    before: float = 0.0
    filters: Final[Counter[Any]] = Counter()


@contextmanager
def switch_interval(seconds: float) -> Iterator[None]:
    """Set the interval after which threads release the interpreter, s, while a context is open.

    Of several open contexts, in any threads, the least interval counts.
    """
    with _CHANGING:
        if not _OpenContexts.intervals:
            _OpenContexts.before = sys.getswitchinterval()
        _OpenContexts.intervals.append(seconds)
        sys.setswitchinterval(min(_OpenContexts.before, *_OpenContexts.intervals))
    try:
        yield
    finally:
        with _CHANGING:
            _OpenContexts.intervals.remove(seconds)
            sys.setswitchinterval(min([_OpenContexts.before, *_OpenContexts.intervals]))


@contextmanager
def ignored_warning(message: str, category: type[Warning] = Warning, module: str = "") -> Iterator[None]:
    """Ignore a warning in all threads while a context is open."""
    # `warnings.catch_warnings` would also drop filters that others add meanwhile, in any thread.
    with _CHANGING:
        warnings.filterwarnings("ignore", message, category, module)
        entry = warnings.filters[0]
        _OpenContexts.filters[entry] += 1
    try:
        yield
    finally:
        with _CHANGING:
            _OpenContexts.filters[entry] -= 1
            if not _OpenContexts.filters[entry]:
                del _OpenContexts.filters[entry]
                # The filter is missing where a caller has restored its own list in the meantime.
                with suppress(ValueError):
                    warnings.filters.remove(entry)  # type: ignore[attr-defined]


_ANSWER: Final = 10.0  # seconds in which a scheduler must answer

_WORKERS: Final = 60.0  # seconds in which a first worker must join, and a new one after all workers have left


@contextmanager
def on_cluster(url: str | None) -> Iterator[None]:
    """Use the workers of a dask scheduler for all `Workers` made within this context.

    Yields: the context has no value. Raises InputError if the extra `cluster` is not installed, no scheduler answers,
    it has no workers, or their version differs.
    """
    if url is None:
        yield
        return
    try:
        import distributed  # An optional dependency that is slow to import.
    except ImportError:
        raise ParameterError(
            "cluster", "distributed is not installed", 'the extra: pip install "jld[cluster]"'
        ) from None
    library: Any = distributed  # The library has no type hints.
    try:
        client = library.Client(url, timeout=_ANSWER)
    except (OSError, ValueError, TypeError):
        problem = f"no scheduler answers at {url!r}"
        raise ParameterError("cluster", problem, "the address of a running one, tcp://host:8786") from None
    try:
        try:
            client.wait_for_workers(1, timeout=_WORKERS)
        except TimeoutError:
            problem = f"the scheduler at {url!r} has no workers"
            raise ParameterError("cluster", problem, f"at least one within {_WORKERS:g} s: dask worker URL") from None
        _require_version(client)
        with joblib.parallel_config(backend="dask", wait_for_workers_timeout=_WORKERS):
            yield
    finally:
        client.close()


def _require_version(client: Any) -> None:
    """Raise InputError if a worker runs another version of jld, whose λ may differ."""
    # A lambda is sent as code, so that workers with any version of jld can answer.
    found = client.run(lambda: str(__import__("jld_core").__version__), on_error="return")
    for worker, version in sorted(found.items()):
        if version != __version__:
            has = f"jld {version}" if isinstance(version, str) else f"no jld ({type(version).__name__})"
            raise ParameterError("cluster", f"the worker {worker} has {has}", f"jld {__version__} on every worker")


def client_of_cluster() -> Any | None:
    """Return the dask client in use, None outside `on_cluster` with a URL."""
    return getattr(joblib.parallel.get_active_backend()[0], "client", None)


class _Deferred:
    """Number of nested protected sections and the exception deferred to their end."""

    depth = 0
    error: BaseException | None = None


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Defer errors passed to `raise_deferred` until the outermost such context ends."""
    # A signal handler can then interrupt a process only between steps that must not be left half done. At the end the
    # last deferred error is raised, if any.
    _Deferred.depth += 1
    try:
        yield
    finally:
        _Deferred.depth -= 1
        error = _Deferred.error
        if error is not None and _Deferred.depth == 0:
            _Deferred.error = None
            raise error


def raise_deferred(error: BaseException) -> None:
    """Raise an error from a signal handler, now or at the end of `deferred_signals`.

    Parameters
    ----------
    error : BaseException
        Error to raise. If several errors are deferred, only the last one is raised.

    Raises
    ------
    BaseException
        `error`, at once outside `deferred_signals`, else when the outermost context ends.
    """
    if not _Deferred.depth:
        raise error
    _Deferred.error = error


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
        """Submit a task and return its future; the first call starts the processes."""
        # The function must be importable in other processes. If a process has died, the future raises.
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

        Raises TimeoutError if no result arrives within `hang_seconds` and the deadline has not passed. The wait for one
        result lasts at most until `GRACE` seconds after the deadline.
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
    """Terminate the processes of an executor at once, including those with unfinished tasks."""
    # shutdown(kill_workers=True) would let loky's thread print errors about tasks that still wait.
    for process in list((getattr(executor, "_processes", None) or {}).values()):
        process.terminate()
    executor.shutdown(wait=True)


def is_lost(error: BaseException) -> bool:
    """Return True if a task failed because its worker died, left or hung.

    Result: True if another worker may succeed, False for an error of the task itself.
    """
    return isinstance(error, _LOSSES) or type(error).__module__.startswith("distributed")


def worker_init(parent: int) -> None:
    """Initialise a worker process: ignore Ctrl-C, and exit when the parent process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(parent: int) -> None:
    """Exit this process when its parent is no longer the given process; check every 0.5 s."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
