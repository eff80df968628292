"""Write, read and show the results of a search: tables, front, pictures and pages.

- `columns`: convert tables to spreadsheet-safe text, and describe units and meanings of columns
- `csv_of`: convert a table to CSV that is safe for spreadsheets
- `languages`: texts of the printed report in English, German and Italian
- `page_contract`: define the data format of a page
- `page_data`: assemble the data of a page as JSON, docs/guide/page.md: structure, loads and solutions, rounded
- `page_of_study`: make pages of finished searches and single scenes, and choose the layouts they contain
- `show_page`: make the page of a finished search for a notebook
- `words`: describe assemblies and results in words for the terminal
- `write_report`: write the page of a search
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.report.columns import csv_of
from jld_explore.report.page_of_study import show_page, write_report

if TYPE_CHECKING:
    from jld_explore.report import columns, languages, page_contract, page_data, page_of_study, words

__all__ = [
    "columns",
    "csv_of",
    "languages",
    "page_contract",
    "page_data",
    "page_of_study",
    "show_page",
    "words",
    "write_report",
]

export_lazily(__name__, {}, submodules=["columns", "languages", "page_contract", "page_data", "page_of_study", "words"])
