"""Moments at which a signal must wait: a process that is being started and loses its parent halfway says so itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class _Held:
    """How many blocks are undisturbed, one in the other, and what waits for their end."""

    depth = 0
    waiting: BaseException | None = None


@contextmanager
def deferred_signals() -> Iterator[None]:
    """What `raise_deferred` is asked to raise inside is raised at the end."""
    _Held.depth += 1
    try:
        yield
    finally:
        _Held.depth -= 1
        waiting = _Held.waiting
        if waiting is not None and _Held.depth == 0:
            _Held.waiting = None
            raise waiting


def raise_deferred(error: BaseException) -> None:
    """Raise an error, for handlers of signals: at once, or at the end of what is undisturbed."""
    if not _Held.depth:
        raise error
    _Held.waiting = error
