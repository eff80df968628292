"""Convert evaluations to rows of numbers in memory and to columns of a record on disk.

A row holds a labelling packed to bits, codes of its status and of how it was settled, and numbers.
Numbers are in scene units, NaN where not computed. The checksum covers all bytes of the row.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import BOUND, SOLVE, Evaluation

Rows = NDArray[np.void]
"""Structured array of evaluations with the fields of `record_type`."""

_STATUSES: Final = tuple(Status)  # statuses; the position is the code in a row
_SETTLED: Final = (SOLVE, BOUND)  # ways in which a labelling is settled; the position is the code in a row
# Attributes of `Evaluation` that are stored as float64
_NUMBERS: Final = ("low", "high", "associative", "zero_dilation", "seconds")
COLUMNS: Final = ("labelling", "multiplicity", "status", "settled", *_NUMBERS, "governing", "cases", "checksum")
"""Columns of the table of evaluations, without their number."""

_CODES: Final = {str(status): code for code, status in enumerate(_STATUSES)}
_SETTLED_CODES: Final = {name: code for code, name in enumerate(_SETTLED)}
_STATUS_NAMES: Final = np.array([str(status) for status in _STATUSES], dtype=object)
_SETTLED_NAMES: Final = np.array(_SETTLED, dtype=object)
_numbers: Final = attrgetter(*_NUMBERS)


def record_type(faces: int, cases: int = 0) -> np.dtype[np.void]:
    """Return the structured type of one evaluation for m faces and c load cases.

    The fields are the packed labelling, codes, and numbers in scene units.
    """
    fields = [(name, "<f8") for name in _NUMBERS]
    head = [("labelling", "u1", ((faces + 7) // 8,)), ("multiplicity", "<u4"), ("status", "u1"), ("settled", "u1")]
    return np.dtype([*head, *fields, ("governing", "<i4"), ("cases", "<f8", (cases,))])


def rows_of(
    kind: np.dtype[np.void], labellings: Bits, multiplicities: Sequence[int], found: Sequence[Evaluation]
) -> Rows:
    """Return the rows (k,) of evaluations, for a record or a table.

    kind: type from `record_type`. labellings: (k, m) labels, True = dry. multiplicities: k orbit sizes.
    """
    rows = np.zeros(len(found), dtype=kind)
    rows["labelling"] = np.packbits(labellings, axis=1)
    rows["multiplicity"] = multiplicities
    rows["status"] = [_CODES[one.status] for one in found]
    rows["settled"] = [_SETTLED_CODES[one.settled] for one in found]
    values = np.array([_numbers(one) for one in found], dtype=np.float64).reshape(-1, len(_NUMBERS))
    # The file has one zero and one NaN, so remove the sign of zeros and the payload of NaNs.
    values = np.where(np.isnan(values), np.nan, values + 0.0)
    for name, column in zip(_NUMBERS, values.T, strict=True):
        rows[name] = column
    rows["governing"] = [one.governing for one in found]
    if width := rows["cases"].shape[1]:
        cases = [one.cases or (math.nan,) * width for one in found]
        # Reshape also works for an empty list, if time ran out before the first evaluation.
        rows["cases"] = np.array(cases, dtype=np.float64).reshape(-1, width)
    return rows


def columns_of(rows: Rows) -> Iterator[tuple[Any, ...]]:
    """Yield each row as a tuple of the columns `COLUMNS`, as SQLite stores them."""
    # mypy takes seconds for the types of so many columns, which are any in the end
    columns: list[Iterable[Any]] = [
        keys_of(rows),
        rows["multiplicity"].tolist(),
        statuses(rows).tolist(),
        settled(rows).tolist(),
        *(rows[name].tolist() for name in _NUMBERS),
        rows["governing"].tolist(),
        (one.tobytes() for one in rows["cases"]) if rows["cases"].shape[1] else repeat(b"", len(rows)),
        checksums(rows),
    ]
    return zip(*columns, strict=True)


def from_columns(kind: np.dtype[np.void], content: Sequence[tuple[Any, ...]]) -> tuple[Rows, int | None]:
    """Return the rows of stored columns, and the index of the first row that is damaged.

    The index is that of the first wrong checksum, None if all are right. content: one tuple of `COLUMNS` per row.
    Raises KeyError, TypeError, ValueError or OverflowError for values that no row can hold.
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
    """Return the packed labelling of each row as bytes, by which a labelling is found."""
    width = rows.dtype["labelling"].itemsize
    content = rows["labelling"].tobytes()
    return [content[n : n + width] for n in range(0, len(content), width)]


def statuses(rows: Rows) -> NDArray[np.object_]:
    """Return the status of each row by name.

    rows: (k,) rows with the fields of `record_type`. Returns (k,).
    """
    codes = rows["status"]
    return _STATUS_NAMES.take(codes)


def settled(rows: Rows) -> NDArray[np.object_]:
    """Return the way in which each row was settled, "solve" or "bound".

    rows: (k,) rows with the fields of `record_type`. Returns (k,).
    """
    codes = rows["settled"]
    return _SETTLED_NAMES.take(codes)


def load_factors(rows: Rows) -> Floats:
    """Return λ of each row, as `Evaluation.load_factor`.

    rows: (k,) rows with the fields of `record_type`. Returns (k,): λ without dilation where computed, else associative;
    NaN for rows settled by a bound. Scene units.
    """
    zero = rows["zero_dilation"]
    found = np.where(np.isnan(zero), rows["associative"], zero)
    return np.asarray(np.where(rows["settled"] == _SETTLED_CODES[BOUND], np.nan, found))


def checksums(rows: Rows) -> list[int]:
    """Return the CRC-32 of each row's bytes."""
    raw, size = memoryview(rows.tobytes()), rows.dtype.itemsize
    return [zlib.crc32(raw[n : n + size]) for n in range(0, len(raw), size)]


def evaluation_of(row: np.void) -> Evaluation:
    """Convert one row, with the fields of `record_type`, to an evaluation."""
    status, settled_by = _STATUSES[row["status"]], _SETTLED[row["settled"]]
    low, high, associative, zero_dilation, seconds = (float(row[name]) for name in _NUMBERS)
    cases, governing = tuple(row["cases"].tolist()), int(row["governing"])
    return Evaluation(
        status, low, high, associative, zero_dilation, settled_by, seconds, cases=cases, governing=governing
    )
