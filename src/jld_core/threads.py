"""One thread in products of matrices, whatever the environment says.

The matrices of one labelling are small, and threads inside one product cost more than the product: a search that let
them took 4 to 5 times as long, on a busy machine up to 17. The cores are for labellings.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock

from threadpoolctl import ThreadpoolController

_LOCK = Lock()
_limited = ExitStack()
_inside = 0


@cache
def _controller() -> ThreadpoolController:
    """Libraries of such products that are loaded; looked up once, when numpy and scipy are there."""
    import scipy.linalg  # noqa: F401 – brings a library of its own

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it products of matrices take one thread, afterwards as many as before; also a decorator.

    Nested, or in several threads of one program, it costs next to nothing: the first to come sets the limit and the
    last to leave lifts it.
    """
    global _inside
    with _LOCK:
        # looking is a tenth of setting
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
