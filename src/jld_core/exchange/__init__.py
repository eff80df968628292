"""Files of other programs: in as scenes, with a report; out as blocks."""

from __future__ import annotations

from jld_core.exchange.options import Imported, ImportOptions, Report
from jld_core.exchange.readers import import_file

__all__ = ["ImportOptions", "Imported", "Report", "import_file"]
