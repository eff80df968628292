"""Files of other programs: in as scenes, with a report; out as blocks.

- `FORMATS`: endings and formats that can be written
- `RUN_BY_SPREADSHEETS`: what a text begins with that a spreadsheet takes for a formula
- `Block`: one block of a layout: elements, outline or solid, mass, shape
- `ImportOptions`: how a file is read
- `Imported`: a scene document and how it came about
- `Layout`: an assembly under one labelling, as blocks
- `Report`: what a reader did, in sentences
- `blocks_csv`: the text of blocks.csv
- `export`: a layout → a file of another program
- `harmless`: a text that no spreadsheet runs
- `import_file`: a file of another program → a scene document
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
