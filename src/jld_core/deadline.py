"""The one clock of a command: when it must end, asked by every phase and passed on to worker processes.

A phase that holds a `Deadline` asks `remaining` or `passed`. Loops far below it, which may run long and know nothing of
commands, call `checkpoint`: it raises `DeadlinePassed` inside `Deadline.enforced`, and does nothing elsewhere.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class DeadlinePassed(Exception):
    """Raised by `checkpoint` and `Deadline.check` when the time is up."""


class Deadline:
    """A point in time, by `time.perf_counter`, at which work must end.

    Pickled for another process or machine, it keeps its distance to the time of day.

    Parameters
    ----------
    seconds : float or None
        Time from `started` to the end, s; None: no end.
    started : float or None
        When the time began, as `time.perf_counter` counts, s; None: now.
    """

    __slots__ = ("end", "started")

    def __init__(self, seconds: float | None = None, started: float | None = None) -> None:
        self.started = time.perf_counter() if started is None else started
        self.end = math.inf if seconds is None else self.started + seconds

    def __repr__(self) -> str:
        return f"Deadline({self.remaining():.3g} s left)"

    def __reduce__(self) -> tuple[Callable[[float, float], Deadline], tuple[float, float]]:
        ahead = time.time() - time.perf_counter()
        return _at, (self.end + ahead, self.started + ahead)

    @property
    def limited(self) -> bool:
        """Whether there is an end at all."""
        return self.end < math.inf

    def elapsed(self) -> float:
        """Return the seconds since the time began."""
        return time.perf_counter() - self.started

    def remaining(self) -> float:
        """Return the seconds left: inf without an end, 0 once it has passed."""
        return max(self.end - time.perf_counter(), 0.0)

    def passed(self) -> bool:
        """Return True once the end has passed."""
        return time.perf_counter() >= self.end

    def check(self) -> None:
        """Raise DeadlinePassed once the end has passed."""
        if self.passed():
            raise DeadlinePassed

    def earlier(self, seconds: float) -> Deadline:
        """Return the same deadline with its end so many seconds earlier."""
        return self._ending(self.end - seconds)

    def within(self, seconds: float) -> Deadline:
        """Return a deadline at most so many seconds from now, and never after this one."""
        return self._ending(min(self.end, time.perf_counter() + seconds))

    def _ending(self, end: float) -> Deadline:
        made = Deadline(None, self.started)
        made.end = end
        return made

    @contextmanager
    def enforced(self) -> Iterator[None]:
        """Let `checkpoint` raise DeadlinePassed in this thread once the end has passed, or an outer one has."""
        outer = _enforced.get()
        token = _enforced.set(self if outer is None or self.end < outer.end else outer)
        try:
            yield
        finally:
            _enforced.reset(token)


_enforced: ContextVar[Deadline | None] = ContextVar("enforced", default=None)


def checkpoint() -> None:
    """Raise DeadlinePassed where an enforced deadline has passed; for loops that may run long."""
    deadline = _enforced.get()
    if deadline is not None:
        deadline.check()


def time_left() -> float:
    """Return the seconds left to the enforced deadline; inf where there is none."""
    deadline = _enforced.get()
    return math.inf if deadline is None else deadline.remaining()


def _at(end: float, started: float) -> Deadline:
    """Make a deadline from times since the epoch, s."""
    ahead = time.time() - time.perf_counter()
    made = Deadline(None, started - ahead)
    made.end = end - ahead
    return made
