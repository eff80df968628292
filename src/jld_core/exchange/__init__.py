"""Files of other programs: in as scenes, with a report; out as blocks."""

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
