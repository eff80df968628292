"""Restrict matrix products to one thread, whatever the environment variables set.

The matrices of one labelling are small, and threads inside one product cost more than the product. Searches with
threads in products were measured to take 4 to 5 times as long, on a busy machine up to 17 times. Labellings are
distributed over the cores instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock

from threadpoolctl import ThreadpoolController

_LOCK = Lock()  # protects `_limited` and `_inside`
_limited = ExitStack()  # holds the present limit on threads
_inside = 0  # number of contexts that are open in all threads


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the loaded BLAS libraries, created once."""
    import scipy.linalg  # noqa: F401 – brings a library of its own

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_thread() -> Iterator[None]:
    """Restrict matrix products to one thread inside the context, also as a decorator.

    Yields
    ------
    None
        Nothing.
    """
    # Nested contexts and contexts in several threads cost little. The first one to enter sets the limit, and the last
    # one to leave restores the previous number of threads.
    global _inside
    with _LOCK:
        # Reading the limit takes a tenth of the time of setting it.
        if _inside == 0 and any(found.num_threads > 1 for found in _controller().lib_controllers):
            _limited.enter_context(_controller().limit(limits=1))
        _inside += 1
    try:
        yield
    finally:
        with _LOCK:
            _inside -= 1
            if _inside == 0:
                _limited.close()
