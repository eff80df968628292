"""Exchange of files with other programs: import as scenes with a report, export of blocks.

- `FORMATS`: export formats and their file endings
- `Format`: how a file format is read and written, and what its files keep
- `ImportOptions`: options for reading a file
- `Imported`: scene document with a report of its import
- `Layout`: assembly under one labelling, as blocks
- `Notes`: what a reader found, snapped, assumed and skipped, while it reads
- `Part`: one solid of a file
- `Report`: sentences on what a reader found, snapped, assumed and skipped
- `Solids`: content of a spatial file, which a reader returns
- `blocks_csv`: return the text of blocks.csv
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
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.exchange.formats import FORMATS, Format, blocks_csv, export
from jld_core.exchange.layout import Layout
from jld_core.exchange.libraries import import_file
from jld_core.exchange.options import Imported, ImportOptions, Notes, Report
from jld_core.exchange.solids import Part, Solids
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.exchange import cells, drawn_loads, facts, forces, formats, libraries, options, paths, solids
    from jld_core.exchange.drawing import planar_scene
    from jld_core.exchange.read_mesh import solids_of

__all__ = [
    "FORMATS",
    "Format",
    "ImportOptions",
    "Imported",
    "Layout",
    "Notes",
    "Part",
    "Report",
    "Solids",
    "blocks_csv",
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
]

export_lazily(
    __name__,
    {
        "drawing": ["planar_scene"],
        "read_mesh": ["solids_of"],
    },
    submodules=["cells", "drawn_loads", "facts", "forces", "formats", "libraries", "options", "paths", "solids"],
)
