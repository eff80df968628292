"""Reader of CSV polygons: one corner per line, corners of one id in order.

Columns are id, x, y, and optionally layer and support.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path as File
from typing import Final

import numpy as np

from jld_core import InputError
from jld_formats.drawn_loads import MOST, Drawing
from jld_formats.libraries import text_of
from jld_formats.options import ImportOptions, Notes
from jld_formats.paths import Path

_COLUMNS: Final = ("id", "x", "y", "layer", "support")  # allowed columns

_TRUE: Final = ("1", "true", "yes")  # texts that mean true in the column support


def _rows(text: str, mark: str) -> Iterator[list[str]]:
    """Yield the rows of a CSV text; InputError with the line number for an invalid one."""
    reader = csv.reader(io.StringIO(text), delimiter=mark)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(f"line {reader.line_num}", f"it is no row ({error})", "a name and numbers") from None
        yield row


def read_csv(path: File, options: ImportOptions, notes: Notes) -> Drawing:
    """Read the polygons of a CSV file, one corner per line, as closed paths; InputError names line or element."""
    # Columns are id, x, y and optionally layer and support, separated by commas, semicolons or tabs. Lines of one id
    # form a polygon; it is on layer "support" where its column support means true.
    text = text_of(path)
    first = text.splitlines()[0]
    mark = max(",;\t", key=first.count)
    rows = _rows(text, mark)
    head = [name.strip().casefold() for name in next(rows)]
    missing = [name for name in ("id", "x", "y") if name not in head]
    unknown = [name for name in head if name not in _COLUMNS]
    if missing or unknown:
        what = f"no column {missing[0]!r}" if missing else f"an unknown column {unknown[0]!r}"
        raise InputError("line 1", what, "columns id, x, y, and if wanted layer and support")
    corners: dict[str, list[tuple[float, float]]] = {}
    layers: dict[str, str] = {}
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise InputError(f"line {number}", f"it has {len(row)} fields", f"{len(head)} as in line 1")
        if number > MOST:
            raise InputError("", "it holds too many corners", f"at most {MOST}")
        entry = {name: cell.strip() for name, cell in zip(head, row, strict=True)}
        if not entry["id"]:
            raise InputError(f"line {number}", "its id is empty", "the name of an element")
        try:
            point = (float(entry["x"]), float(entry["y"]))
        except ValueError:
            raise InputError(
                f"line {number}", f"{row[head.index('x')]!r}, {row[head.index('y')]!r} is no point", "two numbers"
            ) from None
        if not np.isfinite(point).all():
            raise InputError(f"line {number}", "it holds a coordinate that is no number", "finite numbers only")
        corners.setdefault(entry["id"], []).append(point)
        layer = "support" if entry.get("support", "").casefold() in _TRUE else entry.get("layer", "")
        layers[entry["id"]] = layer or layers.get(entry["id"], "")
    paths = []
    for name, points in corners.items():
        if len(points) > 1 and points[0] == points[-1]:
            points = points[:-1]
        if len(points) < 3:
            raise InputError(f"element {name!r}", f"it has {len(points)} corners", "at least 3")
        paths.append(Path(np.column_stack([points, np.zeros(len(points))]), True, layers[name], name))
    notes.found.append(f"{len(paths)} polygons")
    return Drawing(paths, [], None, {}, path.stem)
