"""Export of a layout to a file of another program."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Final

from jld_core.errors import ParameterError
from jld_core.exchange.formats import FORMATS, formats
from jld_core.exchange.layout import Layout
from jld_core.exchange.units_out import layout_in_unit
from jld_core.files import whole_file
from jld_core.limit.result_of_faces import result_of_faces
from jld_core.sub_assembly import faces_of

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
        Length unit of the file ("mm", "in", …) where a file may have one; by default that of the scene.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        The format is unknown or does not fit the layout, or a library is missing; or the layout has members
        and an analysis starts from the file.
    """
    path = Path(path)
    if kind not in FORMATS:
        raise ParameterError("format", f"no format is named {kind!r}", "one of " + ", ".join(FORMATS))
    form = formats()[kind]
    dimension = layout.assembly.dimension
    if cells and dimension not in form.cells:
        solids = [name for name in FORMATS if dimension in formats()[name].cells]
        raise ParameterError("cells", f"{kind} draws blocks and the faces inside them", " or ".join(solids))
    layout = _of_faces(layout, kind)
    if unit is not None:
        if form.unit != "any":
            problem = f"{kind} has " + ("metres" if form.unit == "metres" else "the units of the scene")
            free = [name for name in FORMATS if formats()[name].unit == "any"]
            raise ParameterError("unit", problem, " or ".join(free))
        layout = layout_in_unit(layout, unit)
    assert form.write is not None
    with whole_file(path) as fresh:
        form.write(layout, fresh, cells=cells)
    return path


def _of_faces(layout: Layout, kind: str) -> Layout:
    """Drop the interfaces of members from a layout and its analysis.

    Raises InputError for a layout with members if `kind` is a format that an analysis starts from.
    """
    if not formats()[kind].members:
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
