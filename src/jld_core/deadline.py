"""Deadline of a command: the time at which it must end, for every phase and for worker processes.

A phase that holds a `Deadline` calls `remaining` or `passed`. Long loops in lower layers do not know the command; they
call `checkpoint`. It raises `DeadlinePassed` inside `Deadline.enforced` and does nothing elsewhere.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class DeadlinePassed(Exception):
    """Error raised by `checkpoint` and `Deadline.check` when the deadline has passed."""


class Deadline:
    """Point in time, by `time.perf_counter`, at which work must end.

    Pickled for another process or machine, a deadline keeps its distance to the time of day.

    Parameters
    ----------
    seconds : float or None
        Time from `started` to the end, s; None: no end.
    started : float or None
        Start of the time, as `time.perf_counter` counts, s; None: now.
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
        """Whether the deadline has an end."""
        return self.end < math.inf

    def elapsed(self) -> float:
        """Return the seconds since the start."""
        return time.perf_counter() - self.started

    def remaining(self) -> float:
        """Return the seconds left: inf without an end, 0 after the end."""
        return max(self.end - time.perf_counter(), 0.0)

    def passed(self) -> bool:
        """Return True after the end."""
        return time.perf_counter() >= self.end

    def check(self) -> None:
        """Raise DeadlinePassed after the end."""
        if self.passed():
            raise DeadlinePassed

    def earlier(self, seconds: float) -> Deadline:
        """Return a deadline that ends this many seconds earlier."""
        return self._ending(self.end - seconds)

    def within(self, seconds: float) -> Deadline:
        """Return a deadline at most this many seconds from now, and no later than this one."""
        return self._ending(min(self.end, time.perf_counter() + seconds))

    def _ending(self, end: float) -> Deadline:
        """Return a deadline with the same start and another end."""
        made = Deadline(None, self.started)
        made.end = end
        return made

    @contextmanager
    def enforced(self) -> Iterator[None]:
        """Make `checkpoint` raise DeadlinePassed in this thread once this deadline has passed.

        A deadline enforced outside that ends earlier stays in force.
        """
        outer = _enforced.get()
        token = _enforced.set(self if outer is None or self.end < outer.end else outer)
        try:
            yield
        finally:
            _enforced.reset(token)


_enforced: ContextVar[Deadline | None] = ContextVar("enforced", default=None)


def checkpoint() -> None:
    """Raise DeadlinePassed if an enforced deadline has passed; for loops that may run long."""
    deadline = _enforced.get()
    if deadline is not None:
        deadline.check()


def time_left() -> float:
    """Return the seconds left to the enforced deadline.

    Returns
    -------
    float
        Seconds, 0 after the end; inf where no deadline is enforced.
    """
    deadline = _enforced.get()
    return math.inf if deadline is None else deadline.remaining()


def _at(end: float, started: float) -> Deadline:
    """Make a deadline from times since the epoch, s."""
    ahead = time.time() - time.perf_counter()
    made = Deadline(None, started - ahead)
    made.end = end - ahead
    return made
