"""Write, read and show the results of a search: tables, front, pictures and pages.

- `CaseSolver`: solver of labellings under all load cases that reuses its templates
- `Exploration`: finished search with its tables
- `Page`: page of a search for a notebook
- `PageData`: data of a page
- `Summary`: outcome of a search by named fields
- `assembly`: describe an assembly and its search space for `jld check`
- `asset`: return the text of a front-end file
- `asset_names`: list the front-end files that a browser loads
- `check_certificate_file`: check that a certificate file can be written
- `check_folder`: check that a results folder may be written into
- `check_writable`: check that a folder can be made or written into
- `csv_of`: convert a table to CSV that is safe for spreadsheets
- `filled`: insert parts into a template
- `loads_of`: list the live loads for drawing
- `on_front`: return which rows are on the Pareto front
- `page_data`: assemble the data of a page
- `read_folder`: read a results folder as an `Exploration`
- `results_table`: make the table of results
- `scene_page`: make the HTML page of a scene with its solution
- `show_page`: make the page of a finished search for a notebook
- `solution_of`: convert a limit analysis result to the data of a drawing
- `study_data`: assemble the data of the page of a search
- `study_page`: make the HTML page of a search
- `write_pictures`: draw all pictures of a search
- `write_report`: write the page of a search
- `write_tables`: write all tables of a search
- `write_text`: write a text file atomically
"""

from __future__ import annotations

from jld_explore.report.columns import csv_of
from jld_explore.report.exploration import Exploration
from jld_explore.report.folder import (
    check_certificate_file,
    check_folder,
    check_writable,
    write_pictures,
    write_tables,
    write_text,
)
from jld_explore.report.front import on_front
from jld_explore.report.notebook import Page, show_page
from jld_explore.report.page import asset, asset_names, filled
from jld_explore.report.page_contract import PageData
from jld_explore.report.page_data import loads_of, page_data, solution_of
from jld_explore.report.page_of_study import CaseSolver, scene_page, study_data, study_page, write_report
from jld_explore.report.reading import read_folder
from jld_explore.report.summary import Summary
from jld_explore.report.tables import results_table
from jld_explore.report.words import assembly

__all__ = [
    "CaseSolver",
    "Exploration",
    "Page",
    "PageData",
    "Summary",
    "assembly",
    "asset",
    "asset_names",
    "check_certificate_file",
    "check_folder",
    "check_writable",
    "csv_of",
    "filled",
    "loads_of",
    "on_front",
    "page_data",
    "read_folder",
    "results_table",
    "scene_page",
    "show_page",
    "solution_of",
    "study_data",
    "study_page",
    "write_pictures",
    "write_report",
    "write_tables",
    "write_text",
]
