"""Define the tables of the record file; convert SQLite errors to ones with its name."""

from __future__ import annotations

import errno
import json
import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final

from jld_core.errors import InputError
from jld_explore.evaluation.lock import busy

FORMAT: Final = 5
"""Version of the file format; a record of another version cannot be resumed."""

TABLES: Final = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL /* JSON: what a study must agree with to go on */);
CREATE TABLE evaluations (
  id INTEGER PRIMARY KEY /* in the order in which they were finished */,
  labelling BLOB NOT NULL /* a bit for each face of faces.csv, the first the highest, 1 dry: see hex(labelling) */,
  multiplicity INTEGER NOT NULL, status TEXT NOT NULL, settled TEXT NOT NULL,
  low REAL, high REAL, associative REAL, zero_dilation REAL, seconds REAL,
  governing INTEGER NOT NULL /* position of the load case that governs, -1 of one load alone */,
  cases BLOB NOT NULL /* a float64 for each load case: its load factor */, checksum INTEGER NOT NULL);
CREATE TABLE conflicts (
  id INTEGER PRIMARY KEY, decided BLOB NOT NULL, labels BLOB NOT NULL, bound REAL NOT NULL,
  closed INTEGER NOT NULL /* evidence: 0 a mechanism, 1 a cube that conflicts leave nothing of, 2 possible blocks */,
  checksum INTEGER NOT NULL);
"""

_BESIDE: Final = 1 << 16  # bytes that SQLite's auxiliary files need at least

# System error number for each SQLite error code that concerns the disk or permissions
_DISK: Final = {
    sqlite3.SQLITE_FULL: errno.ENOSPC,
    sqlite3.SQLITE_IOERR: errno.EIO,
    sqlite3.SQLITE_READONLY: errno.EACCES,
    sqlite3.SQLITE_CANTOPEN: errno.EACCES,
    sqlite3.SQLITE_PERM: errno.EACCES,
}


@contextmanager
def errors_named(path: Path) -> Iterator[None]:
    """Convert SQLite errors inside the context to errors that name the file.

    path: the SQLite file. Raises InputError if another process has the file open, or if the file is damaged. Raises
    OSError if the disk fails or is full.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise busy(path.parent) from None
        if code in _DISK:
            # SQLite reports a general I/O error if the disk has no room for its auxiliary files.
            full = code == sqlite3.SQLITE_IOERR and shutil.disk_usage(path.parent).free < _BESIDE
            number = errno.ENOSPC if full else _DISK[code]
            raise OSError(number, os.strerror(number), str(path)) from None
        raise damaged(path, str(error)) from None


def recorded_driver(path: Path) -> str | None:
    """Return the name of the driver of the study in a record file; None if it cannot be read.

    Whoever opens the record to go on with it finds out why.
    """
    with suppress(sqlite3.Error, json.JSONDecodeError), closing(sqlite3.connect(path)) as file:
        row = file.execute("SELECT value FROM meta WHERE key = 'driver'").fetchone()
        return None if row is None else str(json.loads(row[0]))
    return None


def damaged(path: Path, how: str) -> InputError:
    """Return the InputError, not raised, for a damaged record file.

    how: description of the damage.
    """
    return InputError(str(path), f"it is damaged ({how})", "a file as jld explore left it, or a new folder")
