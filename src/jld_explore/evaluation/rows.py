"""Evaluations as rows of numbers, in memory, and as the columns of a record on disk.

A row holds a labelling packed to bits, codes of its status and of how it was settled, and numbers in scene units, NaN
where not computed; its checksum is of all its bytes.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from itertools import repeat
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import BOUND, CERTIFICATE, SOLVE, Evaluation

Rows = NDArray[np.void]

_STATUSES: Final = tuple(Status)
_SETTLED: Final = (SOLVE, CERTIFICATE, BOUND)
_NUMBERS: Final = ("low", "high", "associative", "zero_dilation", "seconds")
COLUMNS: Final = ("labelling", "multiplicity", "status", "settled", *_NUMBERS, "governing", "cases", "checksum")
"""Of the table of evaluations, their number apart."""

_CODES: Final = {str(status): code for code, status in enumerate(_STATUSES)}
_SETTLED_CODES: Final = {name: code for code, name in enumerate(_SETTLED)}
_STATUS_NAMES: Final = np.array([str(status) for status in _STATUSES], dtype=object)
_SETTLED_NAMES: Final = np.array(_SETTLED, dtype=object)
_numbers: Final = attrgetter(*_NUMBERS)


def record_type(faces: int, cases: int = 0) -> np.dtype[np.void]:
    """Layout of one evaluation for scenes of m faces and c load cases: labelling packed to bits, codes, numbers in
    scene units."""
    fields = [(name, "<f8") for name in _NUMBERS]
    head = [("labelling", "u1", ((faces + 7) // 8,)), ("multiplicity", "<u4"), ("status", "u1"), ("settled", "u1")]
    return np.dtype([*head, *fields, ("governing", "<i4"), ("cases", "<f8", (cases,))])


def rows_of(
    kind: np.dtype[np.void], labellings: Bits, multiplicities: Sequence[int], found: Sequence[Evaluation]
) -> Rows:
    """Rows of evaluations. labellings: (k, m); multiplicities: k orbit sizes."""
    rows = np.zeros(len(found), dtype=kind)
    rows["labelling"] = np.packbits(labellings, axis=1)
    rows["multiplicity"] = multiplicities
    rows["status"] = [_CODES[one.status] for one in found]
    rows["settled"] = [_SETTLED_CODES[one.settled] for one in found]
    values = np.array([_numbers(one) for one in found], dtype=np.float64).reshape(-1, len(_NUMBERS))
    # one zero and one NaN, as the file has them
    values = np.where(np.isnan(values), np.nan, values + 0.0)
    for name, column in zip(_NUMBERS, values.T, strict=True):
        rows[name] = column
    rows["governing"] = [one.governing for one in found]
    if width := rows["cases"].shape[1]:
        cases = [one.cases or (math.nan,) * width for one in found]
        # time may have run out before the first of a portion
        rows["cases"] = np.array(cases, dtype=np.float64).reshape(-1, width)
    return rows


def columns_of(rows: Rows) -> Iterator[tuple[Any, ...]]:
    """Each row as COLUMNS has it."""
    return zip(
        keys_of(rows),
        rows["multiplicity"].tolist(),
        _STATUS_NAMES[rows["status"]].tolist(),
        _SETTLED_NAMES[rows["settled"]].tolist(),
        *(rows[name].tolist() for name in _NUMBERS),
        rows["governing"].tolist(),
        (one.tobytes() for one in rows["cases"]) if rows["cases"].shape[1] else repeat(b"", len(rows)),
        checksums(rows),
        strict=True,
    )


def from_columns(kind: np.dtype[np.void], content: Sequence[tuple[Any, ...]]) -> tuple[Rows, int | None]:
    """Rows out of what `columns_of` gave, and the first that has not its checksum, None where all have.

    Raises KeyError, TypeError, ValueError or OverflowError for what no row can hold.
    """
    rows = np.zeros(len(content), dtype=kind)
    columns = dict(zip(COLUMNS, zip(*content, strict=True), strict=True))
    packed = np.frombuffer(b"".join(columns["labelling"]), np.uint8)
    rows["labelling"] = packed.reshape(len(rows), kind["labelling"].itemsize)
    rows["multiplicity"] = columns["multiplicity"]
    rows["status"] = [_CODES[name] for name in columns["status"]]
    rows["settled"] = [_SETTLED_CODES[name] for name in columns["settled"]]
    for name in _NUMBERS:
        rows[name] = np.array(columns[name], dtype=np.float64)
    rows["governing"] = columns["governing"]
    rows["cases"] = np.frombuffer(b"".join(columns["cases"]), "<f8").reshape(rows["cases"].shape)
    made, kept = checksums(rows), list(columns["checksum"])
    if made == kept:
        return rows, None
    return rows, next(n for n, (one, other) in enumerate(zip(made, kept, strict=True)) if one != other)


def keys_of(rows: Rows) -> list[bytes]:
    """The packed labelling of each row."""
    width = rows.dtype["labelling"].itemsize
    content = rows["labelling"].tobytes()
    return [content[n : n + width] for n in range(0, len(content), width)]


def statuses(rows: Rows) -> NDArray[np.object_]:
    """Status of each row by name, (k,)."""
    return np.asarray(_STATUS_NAMES[rows["status"]])


def settled(rows: Rows) -> NDArray[np.object_]:
    """How each row was settled, (k,): by a solve, a certificate or a bound."""
    return np.asarray(_SETTLED_NAMES[rows["settled"]])


def load_factors(rows: Rows) -> Floats:
    """λ of each row, (k,), as `Evaluation.load_factor` has it."""
    zero = rows["zero_dilation"]
    found = np.where(np.isnan(zero), rows["associative"], zero)
    return np.asarray(np.where(rows["settled"] == _SETTLED_CODES[BOUND], np.nan, found))


def checksums(rows: Rows) -> list[int]:
    """A number of each row's bytes."""
    raw, size = memoryview(rows.tobytes()), rows.dtype.itemsize
    return [zlib.crc32(raw[n : n + size]) for n in range(0, len(raw), size)]


def evaluation_of(row: np.void) -> Evaluation:
    """What a row says, proofs apart."""
    status, settled_by = _STATUSES[row["status"]], _SETTLED[row["settled"]]
    low, high, associative, zero_dilation, seconds = (float(row[name]) for name in _NUMBERS)
    cases, governing = tuple(row["cases"].tolist()), int(row["governing"])
    return Evaluation(
        status, low, high, associative, zero_dilation, settled_by, seconds, cases=cases, governing=governing
    )
