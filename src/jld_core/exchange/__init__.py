"""Exchange of files with other programs: import as scenes with a report, export of blocks.

- `FORMATS`: export formats and their file endings
- `RUN_BY_SPREADSHEETS`: first characters by which a spreadsheet takes a text for a formula
- `Block`: one block of a layout: elements, mass, bounding box, shape
- `ImportOptions`: options for reading a file
- `Imported`: scene document with a report of its import
- `Layout`: assembly under one labelling, as blocks
- `Report`: sentences on what a reader found, snapped, assumed and skipped
- `blocks_csv`: return the text of blocks.csv
- `export`: write a layout to a file of another program
- `harmless`: quote a text that a spreadsheet would run as a formula
- `import_file`: read a file of another program as a scene document
"""

from __future__ import annotations

from jld_core.exchange.layout import Block, Layout
from jld_core.exchange.options import Imported, ImportOptions, Report
from jld_core.exchange.readers import import_file
from jld_core.exchange.writers import FORMATS, RUN_BY_SPREADSHEETS, blocks_csv, export, harmless

__all__ = [
    "FORMATS",
    "RUN_BY_SPREADSHEETS",
    "Block",
    "ImportOptions",
    "Imported",
    "Layout",
    "Report",
    "blocks_csv",
    "export",
    "harmless",
    "import_file",
]
