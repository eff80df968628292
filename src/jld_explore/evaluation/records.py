"""Keep the record of a study: one SQLite file of evaluations and conflicts."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import shutil
import sqlite3
import sys
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.files import whole_file
from jld_explore.evaluation.cases import IncumbentFront
from jld_explore.evaluation.pool import deferred_signals
from jld_explore.evaluation.protocol import (
    COLUMNS,
    CutShort,
    Evaluation,
    Rows,
    checksums,
    columns_of,
    evaluation_of,
    from_columns,
    keys_of,
    record_type,
    rows_of,
)
from jld_explore.evaluation.workers import Run, Workers
from jld_explore.space import keys
from jld_explore.space.labelling import orbit_sizes

if sys.platform != "win32":
    import fcntl


class FolderLock:
    """Exclusive lock of a folder, held until `release` or the end of the process."""

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


FORMAT: Final = 5  # version of the file format; a record of another version cannot be resumed

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
    """Convert SQLite errors inside the context to InputError, or OSError, that name the file."""
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


def recorded(path: Path) -> dict[str, Any]:
    """Return the facts of the study in a record file, such as its "driver" and "scene"; none if it cannot be read."""
    with suppress(sqlite3.Error, json.JSONDecodeError), closing(sqlite3.connect(path)) as file:
        return {key: json.loads(value) for key, value in file.execute("SELECT key, value FROM meta")}
    return {}


def damaged(path: Path, how: str) -> InputError:
    return InputError(str(path), f"it is damaged ({how})", "a file as jld explore left it, or a new folder")


BOUND: Final = "bound"  # key of the proven bound in the table `meta`

WITHDRAWN: Final = "withdrawn"  # key of the reasons for withdrawn bounds in the table `meta`

CONFLICTS_OF: Final = "conflicts of"  # key in `meta` of the problem for which the recorded conflicts were proven

# Keys of `meta` that may differ between a record and the study that resumes it
_CHANGING: Final = {CONFLICTS_OF, BOUND, WITHDRAWN}


def checksum(kind: str, value: float, *parts: bytes) -> int:
    """Return the CRC-32 of a row: its kind, its number and the bytes of its other columns."""
    # SQLite does not store the sign of zero; adding 0.0 turns −0.0 into 0.0.
    return zlib.crc32(b"".join([kind.encode(), np.float64(value + 0.0).tobytes(), *parts]))


def parsed(value: object) -> Any:
    """Parse a JSON text; return None for invalid JSON."""
    try:
        return json.loads(str(value))
    except ValueError:
        return None


def require_same(path: str, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Raise InputError for the first entry in which a record differs from the current study."""
    # what a user names goes before what follows from it: the crack model before the scene, friction before its times
    for key in sorted(
        (old.keys() | new.keys()) - _CHANGING, key=lambda key: (key == "scene", isinstance(new.get(key), float), key)
    ):
        if old.get(key) != new.get(key):
            raise InputError(
                path,
                f"it was made with {key} {_shown(old.get(key))}, not {_shown(new.get(key))}",
                f"the same {key} to resume",
            )


def _shown(value: object) -> str:
    """Return a value as JSON text of at most 60 characters for messages."""
    if isinstance(value, float) and math.isnan(value):
        return "none"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


RECORDS_FILE: Final = "records.sqlite3"  # SQLite file of records in the folder of a study
SCENE_FILE: Final = "scene.json"  # copy of the scene beside the record, written after the tables of the record exist

# seconds after which a transaction waits until the disk holds all data; a wait costs as much as some solves
SYNC: Final = 0.2

_READER_WAIT: Final = 5.0  # seconds to wait for readers to finish, which is necessary before a file can be begun anew

_ROWS_AT_ONCE: Final = 1 << 15  # number of rows read at a time, which limits temporary memory

# Prefix of a conflict's checksum by the kind of its proof (`Evidence` of the exact driver)
_EVIDENCE: Final = {0: "", 1: "closed", 2: "possible blocks"}


class Records:
    """Record of one study on disk, written by the parent process alone.

    Parameters
    ----------
    folder : Path
        Created if missing.
    header : dict
        Facts in which a study that resumes the record must agree.
    faces : int
        Number m of faces.
    cases : int
        Values per evaluation for load cases and nominal materials.

    Attributes
    ----------
    bound : float or None
        Proven upper bound on λ over the whole space, scene units.
    withdrawn : list of str
        Reasons for which bounds were withdrawn.
    began_anew : bool
        True if an empty file was found.

    Raises
    ------
    InputError
        If another process has the record open, or it is damaged or of another study.
    OSError
        If the disk fails or is full.
    """

    def __init__(self, folder: Path, header: dict[str, Any], faces: int, cases: int = 0) -> None:
        # a transaction for each batch: a kill loses no finished evaluation, and leaves no partial row
        self.folder, self.path, self.faces, self.header = folder, folder / RECORDS_FILE, faces, header
        self.type = record_type(faces, cases)
        self._table = np.empty(0, dtype=self.type)
        self._count = 0
        self._index: dict[bytes, int] = {}
        self._synced = time.monotonic()
        self.bound: float | None = None
        self.withdrawn: list[str] = []
        folder.mkdir(parents=True, exist_ok=True)
        wanted = {"jld": "records", "format": FORMAT, "faces": faces, **header}
        self._file: Any = None
        self._lock = FolderLock(folder)
        fresh = not self.path.exists()
        self.began_anew = not fresh and self.path.is_file() and not self.path.stat().st_size
        if self.began_anew and (self.folder / SCENE_FILE).exists():
            self._lock.release()
            raise self._damaged("it is empty, though a search was begun here")
        try:
            with self._errors_named():
                self._file = sqlite3.connect(self.path, timeout=_READER_WAIT, isolation_level=None)
                self._open(wanted)
        except BaseException:
            self.close()
            if fresh:  # Remove the incomplete files.
                for ending in ("", "-wal", "-shm"):
                    self.path.with_name(self.path.name + ending).unlink(missing_ok=True)
            raise

    def _open(self, wanted: dict[str, Any]) -> None:
        """Create the tables of an empty file, else read its content."""
        if sys.platform == "win32":
            self._file.execute("PRAGMA locking_mode=EXCLUSIVE")
        self._file.execute("PRAGMA journal_mode=WAL")
        self._file.execute("PRAGMA synchronous=NORMAL")
        names = {name for (name,) in self._file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not names:
            if (self.folder / SCENE_FILE).exists():  # The scene is written only after the tables exist.
                raise self._damaged("it has no tables, though a search was begun here")
            with self._transaction():
                for statement in TABLES.split(";")[:-1]:
                    self._file.execute(statement)
                rows = [(key, json.dumps(value)) for key, value in wanted.items()]
                self._file.executemany("INSERT INTO meta VALUES (?, ?)", rows)
            return
        if not names >= {"meta", "evaluations", "conflicts"}:
            raise self._damaged("it holds other tables")
        found = {key: parsed(value) for key, value in self._file.execute("SELECT key, value FROM meta")}
        self.bound = self._bound_of(found.get(BOUND))
        self.withdrawn = [str(reason) for reason in found.get(WITHDRAWN) or []]
        require_same(str(self.path), found, json.loads(json.dumps(wanted)))
        self._read()

    # --- evaluations ------------------------------------------------------------------------------------

    def _read(self) -> None:
        """Read all evaluations; raise InputError if the checksum of a row is wrong."""
        columns = ", ".join(COLUMNS)
        found = self._file.execute(f"SELECT {columns} FROM evaluations ORDER BY id")
        parts: list[Rows] = []
        # Read some rows at a time to limit the memory of rows not yet converted.
        while content := found.fetchmany(_ROWS_AT_ONCE):
            try:
                rows, wrong = from_columns(self.type, content)
            except (KeyError, TypeError, ValueError, OverflowError):
                raise self._damaged("a record holds an impossible value") from None
            if wrong is not None:
                raise self._damaged(f"record {self._count + wrong + 1} is not as it was written")
            self._index.update(zip(keys_of(rows), range(self._count, self._count + len(rows)), strict=True))
            self._count += len(rows)
            parts.append(rows)
        if len(self._index) < self._count:
            raise self._damaged("record twice is not as it was written")
        if parts:
            self._table = np.concatenate(parts)

    @property
    def rows(self) -> NDArray[np.void]:
        """All evaluations in the order in which they finished, as rows of `record_type`."""
        return self._table[: self._count]

    def __len__(self) -> int:
        return self._count

    def find(self, labelling: Bits) -> Evaluation | None:
        return self.find_all(labelling[None])[0]

    def find_all(self, labellings: Bits) -> list[Evaluation | None]:
        """Return the evaluation of each labelling (k, m), None if not on record; not after `close`."""
        if len(self._index) < self._count:
            raise ValueError(f"{self.path} is closed")
        places = [self._index.get(key) for key in keys(labellings)]
        return [None if place is None else evaluation_of(self._table[place]) for place in places]

    def append(self, labellings: Bits, multiplicities: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
        """Write finished evaluations of new labellings (k, m); they survive this process, a crash after `SYNC` s."""
        rows = rows_of(self.type, labellings, multiplicities, evaluations)
        named = keys_of(rows)
        if len(set(named)) == len(named) and self._index.keys().isdisjoint(named):
            new: Sequence[int] = range(len(named))
        else:
            first = {key: n for n, key in reversed(list(enumerate(named))) if key not in self._index}
            new = sorted(first.values())
            rows, named = rows[new], [named[n] for n in new]
        start = self._count
        end = start + len(rows)
        content = ((start + n, *columns) for n, columns in enumerate(columns_of(rows), 1))
        with self._errors_named(), self._transaction():
            self._file.executemany(f"INSERT INTO evaluations VALUES ({', '.join('?' * 13)})", content)
        if end > len(self._table):
            # Double the table, so that a million appends copy it only about twenty times.
            self._table = np.concatenate([self._table[:start], np.empty(max(1024, end), dtype=self.type)])
        self._table[start:end] = rows
        self._index.update(zip(named, range(start, end), strict=True))
        self._count = end  # Set the count last, so that an interruption leaves no partial row visible.

    def forget_evaluations(self) -> None:
        with self._errors_named(), self._transaction():
            self._file.execute("DELETE FROM evaluations")
        self._count = 0
        self._index.clear()

    # --- conflicts --------------------------------------------------------------------------------------

    def conflicts(self, key: str) -> tuple[Bits, Bits, Floats, Ints]:
        """Return a problem's conflicts: decided, labels (k, m), bounds (k,) on scaled λ, kind of proof (k,).

        Those of another problem are deleted. InputError if a row is damaged.
        """
        columns = "decided, labels, bound, closed, checksum"
        with self._errors_named():
            problem = self._file.execute("SELECT value FROM meta WHERE key = ?", (CONFLICTS_OF,)).fetchone()
            if problem != (json.dumps(key),):
                with self._transaction():
                    self._file.execute("DELETE FROM conflicts")
                    self._file.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (CONFLICTS_OF, json.dumps(key)))
            rows = self._file.execute(f"SELECT {columns} FROM conflicts ORDER BY id").fetchall()
        width = self.type["labelling"].itemsize
        try:
            if any(checksum(_EVIDENCE[closed], bound, *masks) != check for *masks, bound, closed, check in rows):
                raise ValueError
            masks = b"".join(part for decided, labels, *_ in rows for part in (decided, labels))
            packed = np.frombuffer(masks, np.uint8).reshape(len(rows), 2, width)
        except (TypeError, ValueError, KeyError):
            raise self._damaged("a conflict is not as it was written") from None
        bits = np.unpackbits(packed, axis=2, count=self.faces).astype(bool)
        bounds, evidence = [row[2] for row in rows], [row[3] for row in rows]
        return bits[:, 0], bits[:, 1], np.array(bounds, dtype=np.float64), np.array(evidence, dtype=np.int64)

    def add_conflicts(self, decided: Bits, labels: Bits, bounds: Sequence[float], evidence: Sequence[int]) -> None:
        """Write conflicts in one transaction, as `conflicts` returns them."""
        rows = []
        packed = np.packbits(decided, axis=1), np.packbits(labels, axis=1)
        for on, values, bound, kind in zip(*packed, bounds, evidence, strict=True):
            masks = on.tobytes(), values.tobytes()
            rows.append((*masks, bound, int(kind), checksum(_EVIDENCE[kind], bound, *masks)))
        columns = "decided, labels, bound, closed, checksum"
        with self._errors_named(), self._transaction():
            self._file.executemany(f"INSERT INTO conflicts ({columns}) VALUES (?, ?, ?, ?, ?)", rows)

    def forget_conflicts(self) -> None:
        """Delete all conflicts, because one of them or a consequence has been contradicted."""
        with self._errors_named(), self._transaction():
            self._file.execute("DELETE FROM conflicts")

    # --- the bound --------------------------------------------------------------------------------------

    def withdraw_bound(self, reason: str) -> None:
        """Delete the proven bound and record the reason in `withdrawn`."""
        self.withdrawn = [*self.withdrawn, reason]
        with self._errors_named(), self._transaction():
            self._file.execute("DELETE FROM meta WHERE key = ?", (BOUND,))
            self._file.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (WITHDRAWN, json.dumps(self.withdrawn)))
        self.bound = None

    def keep_bound(self, bound: float) -> None:
        """Write a proven upper bound on λ, scene units, if it is lower than the recorded one."""
        if self.bound is not None and bound >= self.bound:
            return
        content = json.dumps([bound, checksum(BOUND, bound)])
        with self._errors_named(), self._transaction():
            self._file.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (BOUND, content))
        self.bound = bound

    def _bound_of(self, found: Any) -> float | None:
        """Return the recorded bound, or None; raise InputError if its checksum is wrong."""
        if found is None:
            return None
        try:
            bound, check = found
            if checksum(BOUND, bound) != check:
                raise ValueError
        except (TypeError, ValueError):
            raise self._damaged("the bound is not as it was written") from None
        return float(bound)

    # --- the file ---------------------------------------------------------------------------------------

    def close(self) -> None:
        """Write all data to disk, close the file and release the lock; `rows` stays."""
        self._index = {}
        try:
            with self._errors_named():
                if self._file is not None:
                    self._file.close()
        finally:
            self._lock.release()

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Run statements as one transaction; every `SYNC` seconds also wait for the disk."""
        now = time.monotonic()
        late = now - self._synced >= SYNC
        if late:
            self._file.execute("PRAGMA synchronous=FULL")
        self._file.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._file.execute("COMMIT")
        except BaseException:
            if self._file.in_transaction:
                self._file.execute("ROLLBACK")
            raise
        if late:
            self._file.execute("PRAGMA synchronous=NORMAL")
            self._synced = now

    def _errors_named(self) -> AbstractContextManager[None]:
        return errors_named(self.path)

    def _damaged(self, how: str) -> InputError:
        return damaged(self.path, how)


@dataclass(frozen=True)
class PendingEvaluations:
    labellings: Bits  # (k, m) True = dry
    found: list[Evaluation | None]  # evaluations known so far, one entry per labelling
    missing: Ints  # (j,) positions of the labellings sent to the workers
    run: Run | None  # run of the workers; None if no labelling was sent
    required: bool = False  # True if the first labelling sent is evaluated whatever the deadline


class RecordedEvaluator:
    """Evaluator that runs workers and records every evaluation: `submit`, then `collect`."""

    def __init__(
        self,
        workers: Workers,
        records: Records,
        group: Ints,
        *,
        deadline: Deadline | None = None,
        front: IncumbentFront | None = None,
        finish_first: bool = False,
        report: Callable[[list[Evaluation], Bits], None] = lambda found, labellings: None,
    ) -> None:
        self.records, self.solved = records, 0
        self._without_result = not len(records)
        self._workers, self._group, self._deadline = workers, group, deadline
        self._front, self._report, self._finish_first = front, report, finish_first

    def submit(self, labellings: Bits) -> PendingEvaluations:
        """Begin to evaluate the labellings (k, m) not on record."""
        found = self.records.find_all(labellings)
        missing = np.array([n for n, evaluation in enumerate(found) if evaluation is None], dtype=np.int64)
        run, first_required = None, False
        if missing.size:
            thresholds = None if self._front is None else self._front.thresholds(labellings[missing])
            # A search with an empty record evaluates its first labelling in any case, so that it has a result.
            first_required, self._without_result = self._without_result, False
            run = self._workers.run(labellings[missing], self._deadline, thresholds, first_required=first_required)
        return PendingEvaluations(labellings, found, missing, run, first_required)

    def collect(self, pending: PendingEvaluations) -> list[Evaluation] | None:
        """Wait for submitted labellings and record them; return all k, None if time ran out."""
        found, labellings, missing = pending.found, pending.labellings, pending.missing
        known = np.array([evaluation is not None for evaluation in found], dtype=bool)
        self._report([evaluation for evaluation in found if evaluation is not None], labellings[known])
        if pending.run is not None:
            weights = orbit_sizes(labellings[missing], self._group)
            with ExitStack() as until_first:
                if pending.required and self._finish_first:
                    until_first.enter_context(deferred_signals())
                for part, evaluations in pending.run:
                    self.records.append(labellings[missing[part]], weights[part].tolist(), evaluations)
                    self.solved += len(evaluations)
                    for position, evaluation in zip(missing[part].tolist(), evaluations, strict=True):
                        found[position] = evaluation
                    self._report(evaluations, labellings[missing[part]])
                    until_first.close()
                    if isinstance(evaluations, CutShort):
                        raise evaluations.error
                    if self._deadline is not None and self._deadline.passed():
                        break
        complete = [evaluation for evaluation in found if evaluation is not None]
        return complete if len(complete) == len(found) else None


REFINED_FILE: Final = "refined.npz"  # refined evaluations in the folder of a study


class RefinedRecords:
    """Rows of a record in which refined evaluations replace those of the coarsest mesh."""

    def __init__(self, records: Records) -> None:
        self.faces, self._records = records.faces, records
        self._path = records.folder / REFINED_FILE
        self._refined = np.empty(0, dtype=records.type)
        if self._path.exists():
            self._refined = self._read()

    def _read(self) -> Rows:
        """Read the refined rows; raise InputError if they are not as they were written."""
        try:
            with np.load(io.BytesIO(self._path.read_bytes()), allow_pickle=False) as content:
                rows, made = np.asarray(content["rows"]), content["checksum"].tolist()
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise damaged(self._path, str(error)) from None
        if rows.dtype != self._records.type or checksums(rows) != made:
            raise damaged(self._path, "its rows are not as they were written")
        return rows

    @property
    def rows(self) -> Rows:
        """All rows in the order of the record, with refined evaluations where known."""
        rows = self._records.rows.copy()
        place = {key: n for n, key in enumerate(keys_of(rows))}
        for own, key in zip(self._refined, keys_of(self._refined), strict=True):
            if key in place:
                rows[place[key]] = own
        return rows

    def keep(self, labellings: Bits, multiplicities: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
        """Write refined evaluations of labellings (k, m); they replace all that were kept before."""
        rows = rows_of(self._records.type, labellings, multiplicities, evaluations)
        with whole_file(self._path) as fresh, fresh.open("wb") as file:
            np.savez_compressed(file, rows=rows, checksum=np.array(checksums(rows), dtype=np.int64))
        self._refined = rows
