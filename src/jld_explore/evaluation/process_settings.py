"""Change settings of the process while a pool of workers exists, then restore them."""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import Any, Final

_CHANGING: Final = Lock()  # lock of the bookkeeping, since pools may be opened and closed by several threads


class _OpenContexts:
    """Bookkeeping of the open contexts, so that the last one to close restores the setting."""

    intervals: Final[list[float]] = []
    before: float = 0.0
    filters: Final[Counter[Any]] = Counter()


@contextmanager
def switch_interval(seconds: float) -> Iterator[None]:
    """Set the interval after which threads release the interpreter, while a context is open.

    seconds: longest interval. Contexts may overlap; the shortest interval counts, and the last context to close
    restores the first value.
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
    """Ignore a warning in all threads while a context is open.

    `warnings.catch_warnings` would also drop filters that others add meanwhile, in any thread.
    message, module: regular expressions. Contexts may overlap; the last one to close removes the filter.
    """
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
