"""Threads and memory of the machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Final

from threadpoolctl import ThreadpoolController

_LOCK = Lock()  # protects `_limited` and `_open_contexts`
_limited = ExitStack()  # holds the present limit on threads
_open_contexts = 0  # number of contexts that are open in all threads


@cache
def _controller() -> ThreadpoolController:
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
    global _open_contexts
    with _LOCK:
        # Reading the limit takes a tenth of the time of setting it.
        if _open_contexts == 0 and any(library.num_threads > 1 for library in _controller().lib_controllers):
            _limited.enter_context(_controller().limit(limits=1))
        _open_contexts += 1
    try:
        yield
    finally:
        with _LOCK:
            _open_contexts -= 1
            if _open_contexts == 0:
                _limited.close()


# Files in which Linux control groups (versions 2 and 1) give the memory limit of a container
_GROUPS: Final = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def memory_limit() -> float:
    """Return the number of bytes that this process may use; inf where it is unknown."""
    # The smallest of three limits: physical memory, container, and address space of the process.
    limits = []
    with suppress(AttributeError, ValueError, OSError):
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    for file in _GROUPS:
        with suppress(OSError, ValueError):  # the file holds "max" if there is no limit
            limits.append(int(file.read_text(encoding="ascii")))
    with suppress(ImportError):
        import resource  # Windows has no such module

        address_space = resource.getrlimit(resource.RLIMIT_AS)[0]
        if address_space != resource.RLIM_INFINITY:
            limits.append(address_space)
    return min((float(size) for size in limits if size > 0), default=float("inf"))
