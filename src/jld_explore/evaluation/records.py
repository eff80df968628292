"""Keep the record of a study: one SQLite file of evaluations and conflicts.

One transaction writes the evaluations of a batch.
A kill at any moment therefore loses no finished evaluation and leaves no partial row.
One process at a time has the file open for writing; any process may read it meanwhile.
Tables, fronts and pictures are pure functions of the record, so resuming a study replays it.

Numbers are in scene units, blank (NULL) where not computed.
Every row has a checksum of its content, which detects flipped bits that SQLite does not check.
"""

from __future__ import annotations

import json
import sqlite3
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats, Ints
from jld_core.errors import InputError
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.lock import FolderLock
from jld_explore.evaluation.record_file import FORMAT, TABLES, damaged, errors_named
from jld_explore.evaluation.record_rows import (
    BOUND,
    CONFLICTS_OF,
    WITHDRAWN,
    checksum,
    parsed,
    require_same,
)
from jld_explore.evaluation.rows import (
    COLUMNS,
    Rows,
    columns_of,
    evaluation_of,
    from_columns,
    keys_of,
    record_type,
    rows_of,
)
from jld_explore.space import keys

RECORDS_FILE: Final = "records.sqlite3"
"""Name of the SQLite file of records in the folder of a study."""
SCENE_FILE: Final = "scene.json"
"""Name of the copy of the scene beside the record, written after the tables of the record exist."""

SYNC: Final = 0.2
"""Seconds after which a transaction waits until the disk holds all data; a wait costs as much as some solves."""

_READER_WAIT: Final = 5.0  # seconds to wait for readers to finish, which is necessary before a file can be begun anew

_ROWS_AT_ONCE: Final = 1 << 15  # number of rows read at a time, which limits temporary memory

# Prefix of a conflict's checksum by the kind of its proof (`Evidence` of the exact driver)
_EVIDENCE: Final = {0: "", 1: "closed", 2: "possible blocks"}


class Records:
    """Record of one study on disk, written by the parent process alone.

    Parameters
    ----------
    folder : Path
        Folder of the record, created if missing.
    header : dict
        Facts in which a study that resumes the record must agree.
    faces : int
        Number m of faces.
    cases : int
        Number of values per evaluation for load cases and nominal material values.

    Attributes
    ----------
    bound : float or None
        Proven upper bound on λ over the whole space, scene units.
    withdrawn : list of str
        Reasons for which bounds were withdrawn.
    began_anew : bool
        True if an empty file was found and begun anew.

    Raises
    ------
    InputError
        If another process has the record open, or if it is damaged or of another study.
    OSError
        If the disk fails or is full, with the name of the file.
    """

    def __init__(self, folder: Path, header: dict[str, Any], faces: int, cases: int = 0) -> None:
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
        """Return all evaluations in the order in which they finished, as rows of `record_type`."""
        return self._table[: self._count]

    def __len__(self) -> int:
        """Return the number of recorded evaluations."""
        return self._count

    def find(self, labelling: Bits) -> Evaluation | None:
        """Return the evaluation of a labelling (m,), True = dry; None if not on record."""
        return self.find_all(labelling[None])[0]

    def find_all(self, labellings: Bits) -> list[Evaluation | None]:
        """Return the evaluation of each labelling (k, m); None if not on record.

        Raises ValueError after `close`, which frees the index.
        """
        if len(self._index) < self._count:
            raise ValueError(f"{self.path} is closed")
        places = [self._index.get(key) for key in keys(labellings)]
        return [None if place is None else evaluation_of(self._table[place]) for place in places]

    def append(self, labellings: Bits, multiplicities: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
        """Write finished evaluations; rows of labellings already on record stay as they are.

        The rows survive the end of this process at once, and a crash of the machine after at most `SYNC` seconds.

        Parameters
        ----------
        labellings : (k, m) bool array
            Labels, True = dry.
        multiplicities : sequence of k int
            Orbit sizes under the symmetries.
        evaluations : sequence of Evaluation
            Results of the k labellings.
        """
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
        """Delete all evaluations, on disk and in memory."""
        with self._errors_named(), self._transaction():
            self._file.execute("DELETE FROM evaluations")
        self._count = 0
        self._index.clear()

    # --- conflicts --------------------------------------------------------------------------------------

    def conflicts(self, key: str) -> tuple[Bits, Bits, Floats, Ints]:
        """Return the conflicts on record that were proven for the problem `key`.

        Conflicts of another key are deleted.

        Parameters
        ----------
        key : str
            Description of the problem for which conflicts are valid.

        Returns
        -------
        decided : (k, m) bool array
            Faces whose label belongs to the conflict.
        labels : (k, m) bool array
            Labels of these faces, True = dry.
        bounds : (k,) float array
            Upper bounds on scaled λ of all labellings that contain the conflict.
        evidence : (k,) int array
            Kind of the proof of each conflict.

        Raises
        ------
        InputError
            If a row is damaged.
        """
        columns = "decided, labels, bound, closed, checksum"
        with self._errors_named():
            known = self._file.execute("SELECT value FROM meta WHERE key = ?", (CONFLICTS_OF,)).fetchone()
            if known != (json.dumps(key),):
                with self._transaction():
                    self._file.execute("DELETE FROM conflicts")
                    self._file.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (CONFLICTS_OF, json.dumps(key)))
            found = self._file.execute(f"SELECT {columns} FROM conflicts ORDER BY id").fetchall()
        width = self.type["labelling"].itemsize
        try:
            if any(checksum(_EVIDENCE[closed], bound, *masks) != check for *masks, bound, closed, check in found):
                raise ValueError
            masks = b"".join(part for decided, labels, *_ in found for part in (decided, labels))
            packed = np.frombuffer(masks, np.uint8).reshape(len(found), 2, width)
        except (TypeError, ValueError, KeyError):
            raise self._damaged("a conflict is not as it was written") from None
        bits = np.unpackbits(packed, axis=2, count=self.faces).astype(bool)
        bounds, evidence = [row[2] for row in found], [row[3] for row in found]
        return bits[:, 0], bits[:, 1], np.array(bounds, dtype=np.float64), np.array(evidence, dtype=np.int64)

    def add_conflicts(self, decided: Bits, labels: Bits, bounds: Sequence[float], evidence: Sequence[int]) -> None:
        """Write conflicts in one transaction.

        One transaction per conflict would take longer than finding the conflicts.

        Parameters
        ----------
        decided : (k, m) bool array
            Faces whose label belongs to each conflict.
        labels : (k, m) bool array
            Labels of these faces, True = dry.
        bounds : sequence of k float
            Upper bounds on scaled λ of all labellings that contain each conflict.
        evidence : sequence of k int
            Kind of the proof of each conflict, a number of `_EVIDENCE`.
        """
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
        """Delete the proven bound and record the reason.

        `withdrawn` holds all reasons, including those of earlier runs.
        """
        self.withdrawn = [*self.withdrawn, reason]
        with self._errors_named(), self._transaction():
            self._file.execute("DELETE FROM meta WHERE key = ?", (BOUND,))
            self._file.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (WITHDRAWN, json.dumps(self.withdrawn)))
        self.bound = None

    def keep_bound(self, bound: float) -> None:
        """Write a proven upper bound on λ of the whole space if it is lower than the recorded one.

        `bound` is in scene units; the attribute `bound` is the recorded one, None if there is none.
        """
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
        """Write all data to disk, close the file and release the lock.

        Repeated calls have no effect. `rows` stays; the index is freed, 0.2 GB for a million evaluations.
        """
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
        """Convert SQLite errors to InputError or OSError with the name of the file."""
        return errors_named(self.path)

    def _damaged(self, how: str) -> InputError:
        """Return the InputError, not raised, for a damaged file.

        how: description of the damage.
        """
        return damaged(self.path, how)
