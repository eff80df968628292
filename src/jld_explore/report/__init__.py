"""A finished study: tables, front, pictures, words.

- `CaseSolver`: solves labellings of one assembly under each of its load cases, on templates that are built once
- `Exploration`: a finished search
- `Page`: the page of a search, which a notebook shows in a frame
- `assembly`: what `jld check` prints
- `asset`: text of a file of the front end
- `asset_names`: files of the front end that a browser loads
- `check_certificate_file`: refuse a file that no certificate can be written to
- `check_folder`: refuse a folder that may not be written into
- `check_writable`: refuse a folder that cannot be made
- `csv_of`: a table as CSV, safe for spreadsheets
- `filled`: a template with its parts put in
- `loads_of`: live loads as they are drawn
- `on_front`: which rows are on a front
- `page_data`: the object that a page is made of
- `read_folder`: a folder → Exploration
- `results_table`: the table of results
- `scene_page`: HTML of a scene, solved
- `show_page`: a finished search → Page
- `solution_of`: what is proven of one layout, by load case, ready to be drawn
- `study_data`: the data of the page of a search, as `page_data` has it
- `study_page`: HTML of a search
- `write_pictures`: draw all pictures of a search
- `write_report`: write the page of a search
- `write_tables`: write all tables of a search
- `write_text`: write a file whole or not at all
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
from jld_explore.report.page_data import loads_of, page_data, solution_of
from jld_explore.report.page_of_study import CaseSolver, scene_page, study_data, study_page, write_report
from jld_explore.report.reading import read_folder
from jld_explore.report.tables import results_table
from jld_explore.report.words import assembly

__all__ = [
    "CaseSolver",
    "Exploration",
    "Page",
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
