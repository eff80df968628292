"""One process at a time writes into a folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from jld_core.errors import InputError

if sys.platform != "win32":
    import fcntl


class FolderLock:
    """Keeps other processes from writing into a folder, until it is released or this process is gone."""

    def __init__(self, folder: Path) -> None:
        self._handle: int | None = None
        if sys.platform == "win32":
            return  # there the file itself is locked
        self._handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise busy(folder) from None

    def release(self) -> None:
        """Let others write; once more does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def busy(folder: Path) -> InputError:
    """What a process is told that comes second."""
    return InputError(str(folder), "another process is at work in it", "a folder of its own for each study")
