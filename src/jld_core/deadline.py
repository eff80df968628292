"""Deadline of a command, which binds all its phases and processes.

Long loops in lower layers call `checkpoint`, which raises `DeadlinePassed` inside `Deadline.enforced` alone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class DeadlinePassed(Exception):
    """Error raised once a deadline has passed."""


class Deadline:
    """Time at which work must end, with a start; pickled, it ends elsewhere at the same time of day.

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
        clock_offset = time.time() - time.perf_counter()
        return _at, (self.end + clock_offset, self.started + clock_offset)

    @property
    def limited(self) -> bool:
        return self.end < math.inf

    def elapsed(self) -> float:
        return time.perf_counter() - self.started

    def remaining(self) -> float:
        """Return the seconds until the end: 0 after it, inf without an end."""
        return max(self.end - time.perf_counter(), 0.0)

    def passed(self) -> bool:
        return time.perf_counter() >= self.end

    def check(self) -> None:
        """Raise DeadlinePassed if the end has been reached."""
        if self.passed():
            raise DeadlinePassed

    def earlier(self, seconds: float) -> Deadline:
        """Return a deadline with the same start that ends `seconds` earlier, if it has an end."""
        return self._ending(self.end - seconds)

    def within(self, seconds: float) -> Deadline:
        return self._ending(min(self.end, time.perf_counter() + seconds))

    def _ending(self, end: float) -> Deadline:
        deadline = Deadline(None, self.started)
        deadline.end = end
        return deadline

    @contextmanager
    def enforced(self) -> Iterator[None]:
        """Make `checkpoint` raise DeadlinePassed in this context and thread after the end.

        Of nested ones the earliest counts.
        """
        outer = _enforced.get()
        token = _enforced.set(self if outer is None or self.end < outer.end else outer)
        try:
            yield
        finally:
            _enforced.reset(token)


_enforced: ContextVar[Deadline | None] = ContextVar("enforced", default=None)


def checkpoint() -> None:
    """Raise DeadlinePassed if the deadline enforced around this call has passed; long loops call it."""
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
    clock_offset = time.time() - time.perf_counter()
    deadline = Deadline(None, started - clock_offset)
    deadline.end = end - clock_offset
    return deadline
