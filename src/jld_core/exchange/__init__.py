"""Exchange of files with other programs: import as scenes with a report, export of blocks.

- `FORMATS`: export formats and their file endings
- `Block`: one block of a layout: elements, mass, bounding box, shape
- `Format`: how a file format is read and written, and what its files keep
- `ImportOptions`: options for reading a file
- `Imported`: scene document with a report of its import
- `Layout`: assembly under one labelling, as blocks
- `Notes`: what a reader found, snapped, assumed and skipped, while it reads
- `Part`: one solid of a file
- `Report`: sentences on what a reader found, snapped, assumed and skipped
- `Solids`: content of a spatial file, which a reader returns
- `blocks_csv`: return the text of blocks.csv
- `export`: write a layout to a file of another program
- `import_file`: read a file of another program as a scene document
"""

from __future__ import annotations

from jld_core.exchange.formats import FORMATS, Format
from jld_core.exchange.layout import Block, Layout
from jld_core.exchange.libraries import import_file
from jld_core.exchange.options import Imported, ImportOptions, Notes, Report
from jld_core.exchange.solids import Part, Solids
from jld_core.exchange.writers import blocks_csv, export

__all__ = [
    "FORMATS",
    "Block",
    "Format",
    "ImportOptions",
    "Imported",
    "Layout",
    "Notes",
    "Part",
    "Report",
    "Solids",
    "blocks_csv",
    "export",
    "import_file",
]
