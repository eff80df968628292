"""Write the table of results: Parquet always, CSV where it is small or asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from jld_core.files import whole_file, write_text
from jld_explore.report.columns import csv_of

if TYPE_CHECKING:
    import pandas as pd

CSV_FILE: Final = "results.csv"
"""File name of the table for people and spreadsheets."""

PARQUET_FILE: Final = "results.parquet"
"""File name of the table that programs read."""

CSV_ROWS: Final = 100_000
"""Largest number of rows that are written as CSV unasked. A million rows take 280 MB and 10 s, four times as much as
Parquet; spreadsheets end at 1 048 576 rows.
"""


def write_results(folder: Path, results: pd.DataFrame, *, csv: bool | None = None) -> None:
    """Write the table of results into a folder: Parquet always, CSV by size or request.

    csv: True always writes CSV. False writes it for up to `CSV_ROWS` rows only. None also writes it for more rows if
    the folder has a CSV file already. If no CSV is written, an existing one is removed.
    """
    path = folder / CSV_FILE
    if csv or len(results) <= CSV_ROWS or (csv is None and path.exists()):
        write_text(path, csv_of(results))
    else:
        path.unlink(missing_ok=True)
    with whole_file(folder / PARQUET_FILE) as fresh:
        results.to_parquet(fresh, index=False, row_group_size=CSV_ROWS)  # groups limit its memory
