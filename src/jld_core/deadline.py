"""Deadline of a command: the time at which it must end, in all phases and processes.

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
    """Time at which work must end, with a start from which elapsed time counts.

    A deadline pickled for another process or machine ends there at the same time of day.

    Parameters
    ----------
    seconds : float, optional
        Time from `started` to the end, s; None: no end.
    started : float, optional
        Start, a value of `time.perf_counter` in this process, s; None: now.
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
        """Return True if the deadline has an end."""
        return self.end < math.inf

    def elapsed(self) -> float:
        """Return the time since the start, s."""
        return time.perf_counter() - self.started

    def remaining(self) -> float:
        """Return the time left until the end, s: 0 after the end, inf without an end."""
        return max(self.end - time.perf_counter(), 0.0)

    def passed(self) -> bool:
        """Return True if the end has been reached; False without an end."""
        return time.perf_counter() >= self.end

    def check(self) -> None:
        """Raise DeadlinePassed if the end has been reached; otherwise do nothing."""
        if self.passed():
            raise DeadlinePassed

    def earlier(self, seconds: float) -> Deadline:
        """Return a deadline with the same start that ends `seconds` earlier, if it has an end."""
        return self._ending(self.end - seconds)

    def within(self, seconds: float) -> Deadline:
        """Return a deadline that ends `seconds` from now, or with this one if that is earlier."""
        return self._ending(min(self.end, time.perf_counter() + seconds))

    def _ending(self, end: float) -> Deadline:
        """Return a deadline with the same start and another end."""
        made = Deadline(None, self.started)
        made.end = end
        return made

    @contextmanager
    def enforced(self) -> Iterator[None]:
        """Make `checkpoint` raise DeadlinePassed inside this context once the deadline has passed.

        Contexts may be nested: the earliest of their deadlines counts. Other threads are not affected.
        """
        outer = _enforced.get()
        token = _enforced.set(self if outer is None or self.end < outer.end else outer)
        try:
            yield
        finally:
            _enforced.reset(token)


_enforced: ContextVar[Deadline | None] = ContextVar("enforced", default=None)


def checkpoint() -> None:
    """Raise DeadlinePassed if the deadline enforced around this call has passed.

    Loops that may run long call it. It does nothing where no deadline is enforced (`Deadline.enforced`).
    """
    deadline = _enforced.get()
    if deadline is not None:
        deadline.check()


def time_left() -> float:
    """Return the time left until the enforced deadline ends.

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
