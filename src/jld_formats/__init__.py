"""Files of other programs: read as scenes with a report, written as blocks (`jld import`, `jld export`).

- `FORMATS`: export formats and their file endings
- `Format`: how a file format is read and written
- `ImportOptions`: options for reading a file
- `Imported`: scene document with a report
- `Notes`: what a reader says while it reads
- `Part`: one solid of a file
- `Report`: sentences of a reader
- `Solids`: content of a spatial file
- `cells`: cells of a planar drawing
- `dem_solver`: jld as a solver of compas_dem
- `drawn_loads`: loads from a drawing
- `export`: write a layout to a file
- `facts`: scene data that a format cannot represent
- `forces`: parser of forces written as text
- `formats`: file formats as data
- `import_file`: read a file as a scene document
- `libraries`: optional libraries, and checks of input files
- `options`: options and report of an import
- `paths`: paths of lines and arcs
- `planar_scene`: planar drawing → scene document
- `solids`: meshes → spatial elements
- `solids_of`: yield the closed surface of each block or element
- `step_of_solids`: text of a STEP file
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_formats import cells, dem_solver, drawn_loads, facts, forces, formats, libraries, options, paths, solids
    from jld_formats.drawing import planar_scene
    from jld_formats.formats import FORMATS, Format, export
    from jld_formats.libraries import import_file
    from jld_formats.options import Imported, ImportOptions, Notes, Report
    from jld_formats.read_mesh import solids_of
    from jld_formats.solids import Part, Solids
    from jld_formats.write_solids import step_of_solids

__all__ = [
    "FORMATS",
    "Format",
    "ImportOptions",
    "Imported",
    "Notes",
    "Part",
    "Report",
    "Solids",
    "cells",
    "dem_solver",
    "drawn_loads",
    "export",
    "facts",
    "forces",
    "formats",
    "import_file",
    "libraries",
    "options",
    "paths",
    "planar_scene",
    "solids",
    "solids_of",
    "step_of_solids",
]

export_lazily(
    __name__,
    {
        "drawing": ["planar_scene"],
        "formats": ["FORMATS", "Format", "export"],
        "libraries": ["import_file"],
        "options": ["ImportOptions", "Imported", "Notes", "Report"],
        "read_mesh": ["solids_of"],
        "solids": ["Part", "Solids"],
        "write_solids": ["step_of_solids"],
    },
    submodules=[
        "cells",
        "dem_solver",
        "drawn_loads",
        "facts",
        "forces",
        "formats",
        "libraries",
        "options",
        "paths",
        "solids",
    ],
)
