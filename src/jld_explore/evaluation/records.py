"""The one record of a study: append-only, fsynced, repaired where it was torn.

The file is a header, one line of JSON, followed by records of fixed size that each carry a checksum. Tables,
fronts and pictures are pure functions of it, so to resume is to replay.
"""

from __future__ import annotations

import json
import math
import os
import time
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import BOUND, CERTIFICATE, SOLVE, Evaluation

STORE_FILE = "evaluations.jld"
SYNC = 0.2
"""Seconds after which what was written is waited for until the disk has it: a wait costs as much as some solves."""

_STATUSES = tuple(Status)
_SETTLED = (SOLVE, CERTIFICATE, BOUND)


def record_type(faces: int) -> np.dtype[np.void]:
    """Layout of one record for scenes of m faces: labelling packed to bits, numbers in scene units, checksum."""
    return np.dtype(
        [
            ("labelling", "u1", ((faces + 7) // 8,)),
            ("multiplicity", "<u4"),
            ("status", "u1"),
            ("settled", "u1"),
            ("low", "<f8"),
            ("high", "<f8"),
            ("associative", "<f8"),
            ("zero_dilation", "<f8"),
            ("seconds", "<f8"),
            ("checksum", "<u4"),
        ]
    )


class Store:
    """Evaluations of one study on disk; written by the parent process alone.

    first: called before records are waited for, to wait for what they rely on.
    """

    def __init__(self, folder: Path, header: dict[str, Any], faces: int) -> None:
        self.path = folder / STORE_FILE
        self.first: Callable[[], None] | None = None
        self.faces = faces
        self.type = record_type(faces)
        self._table = np.empty(0, dtype=self.type)
        self._count = 0
        self._synced = time.monotonic()
        line = (
            json.dumps({"jld": "evaluations", "format": 1, "faces": faces, **header}, sort_keys=True) + "\n"
        ).encode()
        self.repaired = 0
        if self.path.exists() and self._read(line):
            self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115 – open as long as the study
            self._file.seek(0, os.SEEK_END)
        else:
            folder.mkdir(parents=True, exist_ok=True)
            fresh = self.path.with_suffix(".new")
            with open(fresh, "wb") as file:
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
            os.replace(fresh, self.path)
            _sync_folder(folder)
            self._file = open(self.path, "ab", buffering=0)  # noqa: SIM115
        self._index = dict(zip(self._keys(self.rows), range(self._count), strict=True))

    def _read(self, line: bytes) -> bool:
        """Take in an existing file, cut off a torn tail; False where not even its header is whole."""
        content = self.path.read_bytes()
        end = content.find(b"\n") + 1
        if end == 0:
            return False
        _compare_headers(str(self.path), content[:end], line)
        size = self.type.itemsize
        whole = np.frombuffer(content, dtype=self.type, offset=end, count=(len(content) - end) // size)
        raw = memoryview(content)[end:]
        sums = whole["checksum"].tolist()
        good = next(
            (n for n, known in enumerate(sums) if zlib.crc32(raw[n * size : (n + 1) * size - 4]) != known),
            len(whole),
        )
        self._table, self._count = whole[:good].copy(), good
        kept = end + good * size
        self.repaired = len(content) - kept
        if self.repaired:
            with open(self.path, "r+b") as file:
                file.truncate(kept)
                os.fsync(file.fileno())
        return True

    @property
    def rows(self) -> NDArray[np.void]:
        """All records, in the order in which they were finished."""
        return self._table[: self._count]

    def _keys(self, rows: NDArray[np.void]) -> list[bytes]:
        """The packed labelling of each record."""
        width = self.type["labelling"].itemsize
        content = rows["labelling"].tobytes()
        return [content[n : n + width] for n in range(0, len(content), width)]

    def __len__(self) -> int:
        return len(self._index)

    def find(self, labelling: Bits) -> Evaluation | None:
        """What the store knows of a labelling (m,), or None."""
        position = self._index.get(np.packbits(labelling).tobytes())
        return None if position is None else _evaluation(self._table[position])

    def append(self, labellings: Bits, multiplicities: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
        """Write finished evaluations; they outlive this process at once, and the machine within SYNC seconds.

        labellings: (k, m); multiplicities: k orbit sizes.
        """
        rows = np.zeros(len(evaluations), dtype=self.type)
        rows["labelling"] = np.packbits(labellings, axis=1)
        rows["multiplicity"] = multiplicities
        rows["status"] = [_STATUSES.index(found.status) for found in evaluations]
        rows["settled"] = [_SETTLED.index(found.settled) for found in evaluations]
        for name in ("low", "high", "associative", "zero_dilation", "seconds"):
            rows[name] = [getattr(found, name) for found in evaluations]
        raw, size = memoryview(rows.tobytes()), self.type.itemsize
        rows["checksum"] = [zlib.crc32(raw[n : n + size - 4]) for n in range(0, len(raw), size)]
        self._file.write(rows.tobytes())
        now = time.monotonic()
        if now - self._synced >= SYNC:
            self._sync()
            self._synced = now
        start, end = self._count, self._count + len(rows)
        if end > len(self._table):
            # room for as much again, so that a million appends copy the table twenty times, not a million
            self._table = np.concatenate([self._table[:start], np.empty(max(1024, end), dtype=self.type)])
        self._table[start:end] = rows
        self._index.update(zip(self._keys(rows), range(start, end), strict=True))
        self._count = end  # last: an interruption before this leaves no half-written row in the tables

    def keep_proven(self, holds: Callable[[bytes], bool]) -> None:
        """Cut the records off from the first that was solved and whose packed labelling `holds` knows no proofs of.

        Where power was lost the disk may have later pages of this file and not the earlier ones of another.
        """
        solved = self.rows["settled"] == _SETTLED.index(SOLVE)
        kept = next((n for key, n in self._index.items() if solved[n] and not holds(key)), self._count)
        if kept == self._count:
            return
        size = (self._count - kept) * self.type.itemsize
        self._file.truncate(self._file.seek(0, os.SEEK_END) - size)
        self._file.seek(0, os.SEEK_END)
        os.fsync(self._file.fileno())
        self.repaired += size
        self._count = kept
        self._index = {key: n for key, n in self._index.items() if n < kept}

    def close(self) -> None:
        """Wait until the disk has all that was appended, and close the file."""
        if not self._file.closed:
            self._sync()
        self._file.close()

    def _sync(self) -> None:
        if self.first is not None:
            self.first()
        os.fsync(self._file.fileno())


def statuses(rows: NDArray[np.void]) -> NDArray[np.object_]:
    """Status of each record by name, (k,)."""
    return np.asarray(np.array([str(status) for status in _STATUSES], dtype=object)[rows["status"]])


def settled(rows: NDArray[np.void]) -> NDArray[np.object_]:
    """How each record was settled, (k,): by a solve, a certificate or a bound."""
    return np.asarray(np.array(_SETTLED, dtype=object)[rows["settled"]])


def _evaluation(row: np.void) -> Evaluation:
    low, high, associative, zero_dilation, seconds = (
        float(row[name]) for name in ("low", "high", "associative", "zero_dilation", "seconds")
    )
    status, settled_by = _STATUSES[row["status"]], _SETTLED[row["settled"]]
    return Evaluation(status, low, high, associative, zero_dilation, settled_by, seconds)


def _compare_headers(path: str, found: bytes, wanted: bytes) -> None:
    """Raise InputError naming the first entry in which a store differs from the study that wants to go on."""
    try:
        old, new = json.loads(found), json.loads(wanted)
    except ValueError:
        raise InputError(path, "its header cannot be read", "a file written by jld explore") from None
    for key in sorted(old.keys() | new.keys()):
        if old.get(key) != new.get(key):
            raise InputError(
                path,
                f"it was made with {key} {_shown(old.get(key))}, not {_shown(new.get(key))}",
                f"the same {key} to resume",
            )


def _shown(value: object) -> str:
    if isinstance(value, float) and math.isnan(value):
        return "none"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
