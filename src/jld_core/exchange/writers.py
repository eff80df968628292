"""A layout → a file of another program."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Final

from jld_core.errors import InputError
from jld_core.exchange.layout import Layout
from jld_core.exchange.write_3dec import command_text
from jld_core.exchange.write_compas import compas_text
from jld_core.exchange.write_drawing import svg_text, write_dxf
from jld_core.exchange.write_mesh import obj_text, ply_text, stl_text
from jld_core.exchange.write_vtk import write_vtk
from jld_core.files import whole_file

FORMATS: Final = {
    "dxf": ".dxf",
    "obj": ".obj",
    "stl": ".stl",
    "ply": ".ply",
    "compas": ".json",
    "3dec": ".dat",
    "vtk": ".vtu",
    "svg": ".svg",
}
"""What can be written, and how such a file ends."""

_SOLIDS: Final = {"obj": obj_text, "stl": stl_text, "ply": ply_text, "compas": compas_text}
_LAYOUTS: Final = {"3dec": command_text, "svg": svg_text}
"""Texts of blocks or of every element as solids, and of whole layouts."""

RUN_BY_SPREADSHEETS: Final = ("=", "+", "-", "@", "\t", "\r")
"""What a text begins with that a spreadsheet takes for a formula."""


def export(layout: Layout, kind: str, path: str | Path, *, cells: bool = False) -> Path:
    """Write a layout for another program, whole or not at all.

    kind: one of FORMATS. path: the file. cells: every element as a solid of its own, not every block (obj, stl, ply,
    compas). Returns the path. Raises InputError: an unknown kind, one that has no such thing, or a missing library.
    """
    path = Path(path)
    if kind not in FORMATS:
        raise InputError("--format", f"no format is named {kind!r}", "one of " + ", ".join(FORMATS))
    if cells and kind not in _SOLIDS:
        raise InputError("--cells", f"{kind} draws blocks and the faces inside them", " or ".join(_SOLIDS))
    with whole_file(path) as fresh:
        if kind == "dxf":
            write_dxf(layout, fresh)
        elif kind == "vtk":
            write_vtk(layout, fresh, legacy=path.suffix == ".vtk")
        else:
            text = _SOLIDS[kind](layout, cells=cells) if kind in _SOLIDS else _LAYOUTS[kind](layout)
            fresh.write_text(text, encoding="utf-8")
    return path


def blocks_csv(layout: Layout) -> str:
    """The text of blocks.csv: one row for each block that holds a free element."""
    rows = layout.table()
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]) if rows else ["block"], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: harmless(value) for key, value in row.items()} for row in rows)
    return stream.getvalue()


def harmless(value: object) -> object:
    """A value for a CSV file: a text that a spreadsheet would run, as it begins with = + - @, after an apostrophe."""
    return f"'{value}" if isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) else value
