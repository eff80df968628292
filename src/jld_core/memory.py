"""How much memory a process may have, so that what cannot be done is said before it is begun."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

_GROUPS: Final = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def memory_limit() -> float:
    """Bytes that this process may have: what the machine, its container and its own limit allow; inf where unknown."""
    known = []
    with suppress(AttributeError, ValueError, OSError):
        known.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    for file in _GROUPS:
        with suppress(OSError, ValueError):  # "max" where there is none
            known.append(int(file.read_text(encoding="ascii")))
    with suppress(ImportError):
        import resource  # not on Windows

        own = resource.getrlimit(resource.RLIMIT_AS)[0]
        if own != resource.RLIM_INFINITY:
            known.append(own)
    return min((float(size) for size in known if size > 0), default=float("inf"))
