"""Defer exceptions of signal handlers while a process is being started.

A process whose parent stops halfway through the start would print an error of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class _Deferred:
    """Number of nested protected sections and the exception deferred to their end."""

    depth = 0
    error: BaseException | None = None


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Defer errors passed to `raise_deferred` until the outermost such context ends.

    A signal handler can then interrupt a process only between steps that must not be left half done. At the end the
    last deferred error is raised, if any.
    """
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
