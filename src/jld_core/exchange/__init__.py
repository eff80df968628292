"""Files of other programs: in as scenes, with a report; out as blocks."""

from __future__ import annotations

from jld_core.exchange.layout import Block, Layout
from jld_core.exchange.options import Imported, ImportOptions, Report
from jld_core.exchange.readers import import_file
from jld_core.exchange.writers import FORMATS, blocks_csv, export

__all__ = ["FORMATS", "Block", "ImportOptions", "Imported", "Layout", "Report", "blocks_csv", "export", "import_file"]
