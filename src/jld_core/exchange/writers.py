"""Export of a layout to a file of another program."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Final

from jld_core.errors import ParameterError
from jld_core.exchange.layout import Layout
from jld_core.exchange.write_3dec import command_text
from jld_core.exchange.write_compas import compas_text
from jld_core.exchange.write_drawing import svg_text, write_dxf
from jld_core.exchange.write_mesh import obj_text, ply_text, stl_text
from jld_core.exchange.write_rhino import write_rhino
from jld_core.exchange.write_vtk import write_vtk
from jld_core.files import whole_file
from jld_core.limit.result_of_faces import result_of_faces
from jld_core.sub_assembly import faces_of

FORMATS: Final = {
    "dxf": ".dxf",
    "obj": ".obj",
    "stl": ".stl",
    "ply": ".ply",
    "compas": ".json",
    "3dec": ".dat",
    "vtk": ".vtu",
    "svg": ".svg",
    "3dm": ".3dm",
}
"""Export formats and their file endings."""

ANALYSED: Final = ("vtk", "3dm")
"""Formats that hold results of the analysis: forces, mechanism or load factor."""

_SOLIDS: Final = {"obj": obj_text, "stl": stl_text, "ply": ply_text, "compas": compas_text}
"""Functions that return the text of blocks or elements as solids."""

_LAYOUTS: Final = {"3dec": command_text, "svg": svg_text}
"""Functions that return the text of a whole layout."""

RUN_BY_SPREADSHEETS: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters by which a spreadsheet takes a text for a formula."""


def export(layout: Layout, kind: str, path: str | Path, *, cells: bool = False) -> Path:
    """Write a layout to a file of another program, completely or not at all.

    Parameters
    ----------
    layout : Layout
        Layout to write.
    kind : str
        One of FORMATS.
    path : str or Path
        File to write.
    cells : bool
        Write every element as a separate solid, instead of every block (obj, stl, ply, compas).

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        The format is unknown or does not fit the layout, or a library is missing. Files for an analysis (3dec, compas)
        hold no members, so that layouts with members are refused.
    """
    path = Path(path)
    if kind not in FORMATS:
        raise ParameterError("format", f"no format is named {kind!r}", "one of " + ", ".join(FORMATS))
    solids = (*_SOLIDS, "3dm") if layout.assembly.dimension == 3 else tuple(_SOLIDS)
    if cells and kind not in solids:
        raise ParameterError("cells", f"{kind} draws blocks and the faces inside them", " or ".join(solids))
    layout = _of_faces(layout, kind)
    with whole_file(path) as fresh:
        if kind == "dxf":
            write_dxf(layout, fresh)
        elif kind == "3dm":
            write_rhino(layout, fresh, cells=cells)
        elif kind == "vtk":
            write_vtk(layout, fresh, legacy=path.suffix == ".vtk")
        else:
            text = _SOLIDS[kind](layout, cells=cells) if kind in _SOLIDS else _LAYOUTS[kind](layout)
            fresh.write_text(text, encoding="utf-8")
    return path


def _of_faces(layout: Layout, kind: str) -> Layout:
    """Return a layout without the interfaces of members; raise InputError for formats that an analysis starts from."""
    if kind in ("3dec", "compas"):
        layout.assembly.members.refuse(f"a file of the format {kind}")
    assembly = faces_of(layout.assembly)
    if assembly is layout.assembly:
        return layout
    result = None if layout.result is None else result_of_faces(layout.result)
    return replace(layout, assembly=assembly, labels=layout.labels[: assembly.faces], result=result)


def blocks_csv(layout: Layout) -> str:
    """Return the text of blocks.csv: one row for each block with a free element.

    Parameters
    ----------
    layout : Layout
        Layout of the blocks.

    Returns
    -------
    str
        CSV text with a header.
    """
    rows = layout.table()
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]) if rows else ["block"], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: harmless(value) for key, value in row.items()} for row in rows)
    return stream.getvalue()


def harmless(value: object) -> object:
    """Quote a text that a spreadsheet would run as a formula.

    Parameters
    ----------
    value : object
        Value for a CSV file.

    Returns
    -------
    object
        The value; a text that begins with one of `RUN_BY_SPREADSHEETS` is preceded by an apostrophe.
    """
    return f"'{value}" if isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) else value
