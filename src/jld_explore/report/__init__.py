"""Write, read and show the results of a search: tables and words; pictures and pages are made by `jld_views`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.plugins import door
from jld_explore.report.columns import csv_of

if TYPE_CHECKING:
    from jld_explore.report import columns, folder, reading, words

__all__ = ["columns", "csv_of", "folder", "reading", "words"]

__getattr__ = door("views")  # `show_page`, `write_report` and others

export_lazily(__name__, {}, submodules=["columns", "folder", "reading", "words"])
