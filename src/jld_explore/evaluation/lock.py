"""Lock a folder so that only one process at a time writes into it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from jld_core.errors import InputError

if sys.platform != "win32":
    import fcntl


class FolderLock:
    """Exclusive lock of a folder, held until `release` or the end of the process.

    folder: existing folder. Raises InputError if another process holds the lock.
    """

    def __init__(self, folder: Path) -> None:
        self._handle: int | None = None
        if sys.platform == "win32":
            return  # On Windows the SQLite file itself is locked.
        self._handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise busy(folder) from None

    def release(self) -> None:
        """Release the lock; repeated calls have no effect."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def busy(folder: Path) -> InputError:
    """Return the InputError, not raised, for a folder that another process has locked."""
    return InputError(str(folder), "another process is at work in it", "a folder of its own for each study")
