"""Export of a layout to a file of another program."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Final

from jld_core.assembly import faces_of
from jld_core.errors import InputError, ParameterError
from jld_core.exchange.formats import FORMATS, formats
from jld_core.exchange.layout import Layout
from jld_core.files import whole_file
from jld_core.limit.movements import result_of_faces
from jld_core.parameters import typed
from jld_core.scene.units import METRES


def layout_in_unit(layout: Layout, unit: str) -> Layout:
    """Return a layout in another unit of length; ParameterError if either is unknown."""
    # Weights, forces and labels stay as they are. Scene data for re-import and the analysis are taken from
    # `Layout.drawn_from`, the given layout.
    own = layout.assembly.units[0]
    if unit not in METRES:
        raise ParameterError("unit", f"no unit is named {unit!r}", "one of " + ", ".join(METRES))
    if own not in METRES:
        raise ParameterError(
            "unit", f"lengths of the scene are in {own!r}, which is unknown", "units.length of a scene"
        )
    factor = METRES[own] / METRES[unit]
    if factor == 1.0:
        return layout
    assembly = layout.assembly
    elements = replace(
        assembly.elements,
        centroid=factor * assembly.elements.centroid,
        volume=factor**3 * assembly.elements.volume,
        shape=tuple(factor * shape for shape in assembly.elements.shape),
    )
    faces = assembly.interfaces
    interfaces = replace(
        faces,
        origin=factor * faces.origin,
        l1=factor * faces.l1,
        l2=factor * faces.l2,
        area=factor**2 * faces.area,
        c_t=factor * faces.c_t,
        polygon=tuple(factor * polygon for polygon in faces.polygon),
    )
    scaled = replace(
        assembly,
        units=(unit, assembly.units[1]),
        elements=elements,
        interfaces=interfaces,
        dead_loads=assembly.dead_loads.stretched(factor),
        live_loads=assembly.live_loads.stretched(factor),
        cases=tuple(
            replace(case, dead_loads=case.dead_loads.stretched(factor), live_loads=case.live_loads.stretched(factor))
            for case in assembly.cases
        ),
    )
    return Layout(layout.scene, scaled, layout.labels, layout.result, layout)


RUN_BY_SPREADSHEETS: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters by which a spreadsheet takes a text for a formula."""


@typed
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
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(str(path), "it cannot be written", "a file in a folder that is there")
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
    """Drop the interfaces of members from a layout; InputError with members if an analysis starts from the format."""
    if not formats()[kind].members:
        layout.assembly.members.refuse(f"a file of the format {kind}")
    assembly = faces_of(layout.assembly)
    if assembly is layout.assembly:
        return layout
    result = None if layout.result is None else result_of_faces(layout.result)
    return replace(layout, assembly=assembly, labels=layout.labels[: assembly.faces], result=result)


@typed
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
    """Quote a text that a spreadsheet would run as a formula, by an apostrophe before `RUN_BY_SPREADSHEETS`."""
    return f"'{value}" if isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) else value
