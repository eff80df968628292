"""Memory limit of the process, so that impossible tasks are refused before they begin."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

# Files in which Linux control groups (versions 2 and 1) give the memory limit of a container
_GROUPS: Final = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def memory_limit() -> float:
    """Return the number of bytes that this process may use; inf where it is unknown."""
    # The smallest of three limits: physical memory, container, and address space of the process.
    known = []
    with suppress(AttributeError, ValueError, OSError):
        known.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    for file in _GROUPS:
        with suppress(OSError, ValueError):  # the file holds "max" if there is no limit
            known.append(int(file.read_text(encoding="ascii")))
    with suppress(ImportError):
        import resource  # Windows has no such module

        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        if own != resource.RLIM_INFINITY:
            known.append(own)
    return min((float(size) for size in known if size > 0), default=float("inf"))
