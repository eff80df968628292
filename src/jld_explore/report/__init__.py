"""A finished study: tables, front, pictures, words."""

from __future__ import annotations

from jld_explore.report.columns import csv_of
from jld_explore.report.exploration import Exploration
from jld_explore.report.folder import (
    check_folder,
    check_writable,
    read_folder,
    write_pictures,
    write_tables,
    write_text,
)
from jld_explore.report.front import on_front
from jld_explore.report.notebook import ExplorationView
from jld_explore.report.page import asset, asset_names, filled
from jld_explore.report.page_data import loads_of, page_data, solution_of
from jld_explore.report.page_of_study import scene_page, solve_cases, study_data, study_page, write_report
from jld_explore.report.tables import results_table
from jld_explore.report.words import assembly

__all__ = [
    "Exploration",
    "ExplorationView",
    "assembly",
    "asset",
    "asset_names",
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
    "solution_of",
    "solve_cases",
    "study_data",
    "study_page",
    "write_pictures",
    "write_report",
    "write_tables",
    "write_text",
]
