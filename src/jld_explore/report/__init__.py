"""Write, read and show the results of a search: tables, front, pictures and pages.

- `Exploration`: finished search with its tables
- `Summary`: outcome of a search by named fields
- `check_folder`: check that a results folder may be written into
- `csv_of`: convert a table to CSV that is safe for spreadsheets
- `read_folder`: read a results folder as an `Exploration`
- `show_page`: make the page of a finished search for a notebook
- `write_pictures`: draw all pictures of a search
- `write_report`: write the page of a search
"""

from __future__ import annotations

from jld_explore.report.columns import csv_of
from jld_explore.report.folder import check_folder, write_pictures
from jld_explore.report.page_of_study import show_page, write_report
from jld_explore.report.reading import Exploration, read_folder
from jld_explore.report.summary import Summary

__all__ = [
    "Exploration",
    "Summary",
    "check_folder",
    "csv_of",
    "read_folder",
    "show_page",
    "write_pictures",
    "write_report",
]
