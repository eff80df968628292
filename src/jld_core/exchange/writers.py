"""Export of a layout to a file of another program."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Final

from jld_core.errors import ParameterError
from jld_core.exchange.layout import Layout
from jld_core.exchange.units_out import WITH_UNIT, layout_in_unit
from jld_core.exchange.write_3dec import command_text
from jld_core.exchange.write_compas import compas_text
from jld_core.exchange.write_dem import dem_text
from jld_core.exchange.write_drawing import svg_text, write_dxf
from jld_core.exchange.write_gltf import gltf_bytes
from jld_core.exchange.write_ifc import write_ifc
from jld_core.exchange.write_mesh import obj_text, ply_text, stl_text
from jld_core.exchange.write_rhino import write_rhino
from jld_core.exchange.write_step import step_text
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
    "compas_dem": ".json",
    "3dec": ".dat",
    "vtk": ".vtu",
    "svg": ".svg",
    "3dm": ".3dm",
    "step": ".step",
    "ifc": ".ifc",
    "gltf": ".glb",
}
"""Export formats and their file endings."""

ANALYSED: Final = ("vtk", "3dm", "compas_dem", "ifc", "gltf")
"""Formats that hold results of the analysis: forces, mechanism or load factor."""

# Functions that return the text of blocks or elements as solids
_SOLIDS: Final = {
    "obj": obj_text,
    "stl": stl_text,
    "ply": ply_text,
    "compas": compas_text,
    "compas_dem": dem_text,
    "step": step_text,
}

_FILES: Final = {"3dm": write_rhino, "ifc": write_ifc}  # functions that write blocks or elements by a library

_LAYOUTS: Final = {"3dec": command_text, "svg": svg_text}  # functions that return the text of a whole layout

RUN_BY_SPREADSHEETS: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters by which a spreadsheet takes a text for a formula."""


def export(layout: Layout, kind: str, path: str | Path, *, cells: bool = False, unit: str | None = None) -> Path:
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
        Write every element as a separate solid, instead of every block, where the format holds solids.
    unit : str, optional
        Length unit of the file ("mm", "in", …) for formats of `WITH_UNIT`; by default that of the scene.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        The format is unknown or does not fit the layout, or a library is missing. Files for an analysis (3dec, compas,
        compas_dem) hold no members, so that layouts with members are refused.
    """
    path = Path(path)
    if kind not in FORMATS:
        raise ParameterError("format", f"no format is named {kind!r}", "one of " + ", ".join(FORMATS))
    solids = (*_SOLIDS, "ifc", "gltf", *(("3dm",) if layout.assembly.dimension == 3 else ()))
    if cells and kind not in solids:
        raise ParameterError("cells", f"{kind} draws blocks and the faces inside them", " or ".join(solids))
    layout = _of_faces(layout, kind)
    if unit is not None:
        if kind not in WITH_UNIT:
            problem = f"{kind} has metres" if kind == "gltf" else f"{kind} has the units of the scene"
            raise ParameterError("unit", problem, " or ".join(WITH_UNIT))
        layout = layout_in_unit(layout, unit)
    with whole_file(path) as fresh:
        if kind == "dxf":
            write_dxf(layout, fresh)
        elif kind == "gltf":
            fresh.write_bytes(gltf_bytes(layout, cells=cells))
        elif kind in _FILES:
            _FILES[kind](layout, fresh, cells=cells)
        elif kind == "vtk":
            write_vtk(layout, fresh, legacy=path.suffix == ".vtk")
        else:
            text = _SOLIDS[kind](layout, cells=cells) if kind in _SOLIDS else _LAYOUTS[kind](layout)
            fresh.write_text(text, encoding="utf-8")
    return path


def _of_faces(layout: Layout, kind: str) -> Layout:
    """Drop the interfaces of members from a layout and its analysis.

    Raises InputError for a layout with members if `kind` is a format that an analysis starts from.
    """
    if kind in ("3dec", "compas", "compas_dem"):
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

    value: value for a CSV file. Result: the value; a text that begins with one of `RUN_BY_SPREADSHEETS` is preceded by
    an apostrophe.
    """
    return f"'{value}" if isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) else value
