"""Files of other programs: read as scenes with a report, written as blocks (`jld import`, `jld export`).

- `FORMATS`: export formats and their file endings
- `Format`: how a file format is read and written, and what its files keep
- `ImportOptions`: options for reading a file
- `Imported`: scene document with a report of its import
- `Notes`: what a reader found, snapped, assumed and skipped, while it reads
- `Part`: one solid of a file
- `Report`: sentences on what a reader found, snapped, assumed and skipped
- `Solids`: content of a spatial file, which a reader returns
- `cells`: cells of a planar drawing: from outlines, lines across and between them, and openings
- `drawn_loads`: loads from a drawing: arrows, lines along edges, points and texts on load layers
- `export`: write a layout to a file of another program
- `facts`: scene data that another file format cannot represent, stored in the file for re-import; and what is not kept
- `forces`: parser of forces written as text: `10 kN`, `F1 = 2,5 kN`, `1 t`, `3 kN; -4 kN`
- `formats`: file formats as data: how each is read and written, and what a file of it keeps
- `import_file`: read a file of another program as a scene document
- `libraries`: optional libraries of some formats, and checks of input files
- `options`: options and report of an import, and functions shared by all readers
- `paths`: paths of lines and arcs, and their approximation by chords
- `planar_scene`: convert the content of a planar drawing to a scene document
- `solids`: conversion of meshes to spatial elements: snapping, merging of faces, supports by name
- `solids_of`: yield name, support flag and closed surface of each block, or of each element
- `step_of_solids`: text of a STEP file of solids with plane faces
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_formats import cells, drawn_loads, facts, forces, formats, libraries, options, paths, solids
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
    submodules=["cells", "drawn_loads", "facts", "forces", "formats", "libraries", "options", "paths", "solids"],
)
