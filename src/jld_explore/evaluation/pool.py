"""Pools that run tasks: threads or processes of this machine, or the workers of a cluster."""

from __future__ import annotations

import math
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import uuid
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    ALL_COMPLETED,
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from enum import Enum
from threading import Lock
from typing import Any, Final, Self, TypeVar

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
    """Set the interval, s, after which threads release the interpreter; the least open one counts."""
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


_client: Final[ContextVar[Any]] = ContextVar("client of the cluster in use", default=None)

_ANSWER: Final = 10.0  # seconds in which a scheduler must answer

_WORKERS: Final = 60.0  # seconds in which a first worker must join


@contextmanager
def on_cluster(url: str | None) -> Iterator[None]:
    """Use the workers of a dask scheduler for all `Workers` made within this context."""
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
    token = _client.set(client)
    try:
        try:
            client.wait_for_workers(1, timeout=_WORKERS)
        except TimeoutError:
            problem = f"the scheduler at {url!r} has no workers"
            raise ParameterError("cluster", problem, f"at least one within {_WORKERS:g} s: dask worker URL") from None
        _require_version(client)
        yield
    finally:
        _client.reset(token)
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
    return _client.get()


class _Deferred:
    """Number of nested protected sections and the exception deferred to their end."""

    depth = 0
    error: BaseException | None = None


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Defer errors passed to `raise_deferred` until the outermost such context ends."""
    # A signal handler can then interrupt a process only between steps that must not be left half done. At the end the
    # last deferred error is raised, if any.
    if threading.current_thread() is not threading.main_thread():  # no handler runs there, nor may its error end there
        yield
        return
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
        Of several deferred errors only the last one is raised.

    Raises
    ------
    BaseException
        `error`.
    """
    if not _Deferred.depth:
        raise error
    _Deferred.error = error


_GLANCE: Final = 0.05  # longest time that a signal waits for a wait, s


def done_in(futures: Iterable[Future[Any]], seconds: float, *, all_done: bool = False) -> set[Future[Any]]:
    # those that are done once one is, or all are, or after so many seconds; a signal between the locks that `wait`
    # takes would leave them taken, and the thread of the executor would never end
    end, futures = time.monotonic() + seconds, list(futures)
    until = ALL_COMPLETED if all_done else FIRST_COMPLETED
    while True:
        with deferred_signals():
            left = max(0.0, end - time.monotonic())
            found = wait(futures, timeout=min(left, _GLANCE), return_when=until)
        if not found.not_done or (found.done and not all_done) or left <= _GLANCE:
            return found.done


# Exceptions of a task whose worker died, left or hung; a cluster has its own ones
_LOSSES: Final = (BrokenExecutor, CancelledError, TimeoutError, multiprocessing.TimeoutError)

GRACE: Final = 0.3  # seconds after a deadline in which evaluations already begun may finish

_TASKS_PER_PROCESS: Final = 2  # tasks per process that are submitted ahead; if a worker dies, all of them are suspected

_THREADS: Final = ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM", "NUMEXPR", "NUMBA")
# environment of a worker: one BLAS thread, since matrices are small and the jobs use the cores
SINGLE_THREADED: Final = {f"{name}_NUM_THREADS": "1" for name in _THREADS}


Result = TypeVar("Result")  # of a task


class Pool:
    """Threads, processes or workers of a cluster for tasks; they start with the first one.

    Parameters
    ----------
    jobs : int
        Number of threads or processes; it may change while the pool is closed.
    threads, cluster : bool
        Whether threads of this process do the work, or workers of the cluster in use.
    address : str, optional
        The one worker of the cluster that does.

    Attributes
    ----------
    name : str
        Unique name, never reused.
    """

    def __init__(
        self, jobs: int = 1, *, threads: bool = False, cluster: bool = False, address: str | None = None
    ) -> None:
        self.jobs, self.address, self.name = jobs, address, uuid.uuid4().hex
        self._threads = threads
        self._client = client_of_cluster() if cluster or address is not None else None
        self._executor: Executor | None = None
        self._settings = ExitStack()

    @property
    def started(self) -> bool:
        """Return True if the pool has had a task since it was closed."""
        return self._executor is not None

    @property
    def width(self) -> int:
        """Return the number of tasks that may be in progress at a time."""
        return self.jobs if self._client is None else max(1, sum(self._client.ncores().values()))

    def submit(self, function: Callable[..., Result], *arguments: Any) -> Future[Result]:
        """Submit a function that other processes can import; an error of a dead one is raised here or in the future."""
        with deferred_signals(), ExitStack() as starting:
            if self._executor is None:
                self._settings.enter_context(ignored_warning("A worker stopped while some jobs", UserWarning))
                if self._client is not None:
                    one = {} if self.address is None else {"workers": [self.address], "allow_other_workers": False}
                    self._executor = self._client.get_executor(pure=False, **one)
                else:
                    self._executor = ThreadPoolExecutor(self.jobs) if self._threads else make_executor(self.jobs)
            if self._client is None and not self._threads:
                starting.enter_context(_without_interrupts())
            return self._executor.submit(function, *arguments)

    def run(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Yield results of a function for each task, in order; what a dying process leaves runs in this one."""
        if self.width == 1 or len(tasks) < 2:
            yield from (work(*task) for task in tasks)
            return
        futures = [self.submit(work, *task) for task in tasks]
        for future, task in zip(futures, tasks, strict=True):
            try:
                found = future.result()
            except Exception as error:
                if not is_lost(error):
                    raise
                self.close()
                found = work(*task)
            yield found

    def close(self) -> None:
        """Stop all processes at once, also those with unfinished tasks, and threads after theirs; release a cluster."""
        executor, self._executor = self._executor, None
        with self._settings:
            if executor is None:
                return
            # shutdown(kill_workers=True) would let loky's thread print errors about tasks that still wait.
            for process in list((getattr(executor, "_processes", None) or {}).values()):
                process.terminate()
            with suppress(*(() if self._client is None else (Exception,))):  # a cluster may exist no longer
                executor.shutdown(wait=self._client is None, **({"cancel_futures": True} if self._threads else {}))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def make_executor(jobs: int) -> Executor:
    """Return a new executor of `jobs` local processes; tests replace it by one of threads."""
    from joblib.externals.loky import ProcessPoolExecutor  # slow to import, and most searches stay in one process

    executor: Executor = ProcessPoolExecutor(
        max_workers=jobs, initializer=_init_process, initargs=(os.getpid(),), env=SINGLE_THREADED
    )
    return executor


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach; before `_init_process` it would end them with a traceback."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, which is that of the first process, would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def beside(work: Callable[[], Result]) -> Iterator[Callable[[], Result]]:
    """Begin work in a copy of this process on another core; yield the function that waits for its result.

    The copy ends with the context. Without `fork`, a second core, or where other threads run, the work is done when its
    result is asked for; so it is where the copy fails.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if not hasattr(os, "fork") or cores < 2 or threading.active_count() > 1:
        yield work
        return
    sys.stdout.flush()
    sys.stderr.flush()
    here, there = os.pipe()
    child = os.fork()
    if child == 0:
        with suppress(BaseException):  # whatever happens, the copy must not go on as this process would
            os.close(here)
            with os.fdopen(there, "wb") as pipe:
                pickle.dump(work(), pipe)
            os._exit(0)
        os._exit(1)
    os.close(there)
    ended: list[int] = []

    def result() -> Result:
        with os.fdopen(os.dup(here), "rb") as pipe:
            sent = pipe.read()
        ended.append(os.waitpid(child, 0)[1])
        return pickle.loads(sent) if ended == [0] else work()

    try:
        yield result
    finally:
        os.close(here)
        if not ended:
            os.kill(child, signal.SIGKILL)  # it holds nothing; SIGTERM before its first line is lost
            os.waitpid(child, 0)


class TaskStream:
    """Tasks of one run, submitted in part; iterating yields their results as they finish."""

    def __init__(self, pool: Pool, hang_seconds: float, deadline: Deadline | None) -> None:
        self._pool, self._hang_seconds, self._deadline = pool, hang_seconds, deadline
        self._waiting: deque[tuple[int, Callable[..., Any], tuple[Any, ...]]] = deque()
        self._in_progress: dict[Future[Any], int] = {}
        self.submitted: list[int] = []
        self.late = False

    def begin(self, tasks: Iterator[tuple[int, Callable[..., Any], tuple[Any, ...]]]) -> None:
        """Submit tasks (number, function, arguments): some at once, others as results arrive."""
        self._waiting = deque(tasks)
        self._submit_waiting()

    def _submit_waiting(self) -> None:
        most = _TASKS_PER_PROCESS * self._pool.width
        while self._waiting and len(self._in_progress) < most:
            number, function, arguments = self._waiting.popleft()
            self.submitted.append(number)
            self._in_progress[self._pool.submit(function, *arguments)] = number

    def __iter__(self) -> Iterator[Any]:
        """Yield results; set `late` at the deadline; TimeoutError if none comes within `hang_seconds`."""
        while self._in_progress:
            longest_wait = self._hang_seconds
            if self._deadline is not None:
                longest_wait = min(longest_wait, self._deadline.remaining() + GRACE)
            finished = done_in(self._in_progress, longest_wait)
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


def is_lost(error: BaseException) -> bool:
    """Return whether a task failed because its worker died, left or hung: another may succeed."""
    return isinstance(error, _LOSSES) or type(error).__module__.startswith(("distributed", "joblib"))


def _init_process(parent: int) -> None:
    """Initialise a local process and disable loky's check for memory leaks."""
    from joblib.externals.loky import process_executor

    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize  # loky would restart the process, as if memory leaked
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _exit_after(parent: int) -> None:
    """Exit this process when its parent is no longer the given process; check every 0.5 s."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


# Number of local processes that may replace dead ones; more deaths than this are not accidental
_SPARE_STARTS: Final = 10

_QUERY_SECONDS: Final = 0.5  # seconds between queries of a cluster for its present workers


class Lost(Enum):
    """Type of `LOST`, the result of a task whose worker died or left."""

    LOST = "lost"


LOST: Final = Lost.LOST  # value in place of a result where the worker died or left


class WorkerPool:
    """Workers that keep state between tasks: one `Pool` per job, or per worker of the cluster in use."""

    # a worker that dies loses its state, and another replaces it: users receive None or `LOST`

    def __init__(self, jobs: int) -> None:
        self._client = client_of_cluster()
        self._jobs, self._starts_left = jobs, jobs + _SPARE_STARTS
        self._queried_at = -math.inf
        self._workers: list[Pool] = []

    def __iter__(self) -> Iterator[Pool]:
        return iter(self._workers)

    def __len__(self) -> int:
        return len(self._workers)

    def fill(self) -> list[Pool]:
        """Add missing workers; return the cluster workers that have left."""
        if self._client is None:
            while len(self._workers) < self._jobs and self._starts_left > 0:
                self._starts_left -= 1
                self._workers.append(Pool())
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
        self._workers += [Pool(address=one) for one in present if one not in addresses]
        return departed

    def first(self) -> Pool | None:
        """Return the first worker, started if necessary; None if the cluster has none."""
        self.fill()
        return next(iter(self), None)

    def submit(self, worker: Pool, function: Callable[..., Result], *arguments: Any) -> Future[Result] | None:
        """Submit a task to one worker; None if the worker has died, which is then removed."""
        try:
            return worker.submit(function, *arguments)
        except Exception:  # the exception of an executor whose process died depends on its kind
            self.remove(worker)
            return None

    def result(self, worker: Pool, future: Future[Result]) -> Lost | Result:
        """Wait for a task; return its result, or `LOST` if its worker died, which is then removed."""
        try:
            return future.result()
        except Exception as error:
            # A lost connection to a worker of a cluster is an OSError.
            if not (is_lost(error) or (worker.address is not None and isinstance(error, OSError))):
                raise
            self.remove(worker)
            return LOST

    def remove(self, worker: Pool) -> None:
        """Stop and remove a worker, which `fill` replaces; no effect if it was removed before."""
        if worker in self._workers:
            self._workers.remove(worker)
            worker.close()

    def close(self) -> None:
        for worker in list(self._workers):
            self.remove(worker)
