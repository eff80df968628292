"""Write and read the table of results: Parquet where pyarrow is installed, CSV where it is small, asked or alone."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jld_core.errors import InputError
from jld_core.exchange.writers import harmless
from jld_core.files import whole_file, write_text
from jld_explore.report.columns import csv_of
from jld_explore.space import registered

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

WITH_PARQUET: Final = "pip install 'jld[parquet]'"
"""Command that installs what Parquet needs."""

# Columns of texts, which CSV does not tell from numbers
_TEXTS: Final = ("labelling", "status", "settled", "driver", "governing")


def parquet_is_installed() -> bool:
    """Return True if tables can be written and read as Parquet."""
    return find_spec("pyarrow") is not None


def without_parquet(rows: int) -> list[str]:
    """Return the sentence that says what a table of so many rows loses without Parquet; none for few rows."""
    if rows <= CSV_ROWS or parquet_is_installed():
        return []
    lost = f"{CSV_FILE} of {rows} rows takes four times the space and time of {PARQUET_FILE}, which needs pyarrow"
    return [f"{lost}: {WITH_PARQUET}"]


def write_results(folder: Path, results: pd.DataFrame, *, csv: bool | None = None) -> None:
    """Write the table of results into a folder; a file that is not written any more is removed."""
    # Parquet: where pyarrow is installed. CSV: always without it; else if csv is True or there are at most `CSV_ROWS`
    # rows, and with None also where the folder has a CSV file already.
    path, parquet = folder / CSV_FILE, parquet_is_installed()
    if csv or not parquet or len(results) <= CSV_ROWS or (csv is None and path.exists()):
        write_text(path, csv_of(results))
    else:
        path.unlink(missing_ok=True)
    if parquet:
        with whole_file(folder / PARQUET_FILE) as fresh:
            results.to_parquet(fresh, index=False, row_group_size=CSV_ROWS)  # groups limit its memory
    else:
        (folder / PARQUET_FILE).unlink(missing_ok=True)


def results_path(folder: Path) -> Path:
    """Return the file of a folder that holds its table: Parquet where it can be read, else CSV.

    The path of results.csv if there is none. Raises InputError for Parquet alone that cannot be read.
    """
    parquet, csv = folder / PARQUET_FILE, folder / CSV_FILE
    if not parquet.exists() or (csv.exists() and not parquet_is_installed()):
        return csv
    if not parquet_is_installed():
        raise InputError(str(parquet), "it needs pyarrow, which is not installed", f"{CSV_FILE}, or {WITH_PARQUET}")
    return parquet


def read_results(path: Path) -> pd.DataFrame:
    """Read a table of results, of the same types from both files.

    Raises OSError, TypeError or ValueError for a damaged file.
    """
    import pandas as pd  # slow to import and needed for tables only

    if path.suffix == ".parquet":
        return pd.read_parquet(path)
    # from version 3.1 on pandas reads all digits by default, and warns where that is asked for
    version = tuple(int(part) for part in pd.__version__.split(".")[:2])
    exact: Any = {} if version >= (3, 1) else {"float_precision": "round_trip"}
    texts = dict.fromkeys(_TEXTS, "str")
    table: pd.DataFrame = pd.read_csv(path, dtype=texts, keep_default_na=False, na_values=[""], **exact)
    if "governing" in table:  # names of load cases, which a spreadsheet might run
        table["governing"] = table["governing"].map(_without_apostrophe)
    table.columns = pd.Index([_without_apostrophe(name) for name in table.columns])
    for count in registered():
        if count.name in table and table[count.name].isna().any():
            table[count.name] = table[count.name].astype("Int64" if count.integer else "Float64")
    return table.astype({"rank": "Int64"}) if "rank" in table else table


def _without_apostrophe(value: object) -> object:
    """Return a text as it was before `harmless` put an apostrophe before it; any other value as it is."""
    return value[1:] if isinstance(value, str) and value[:1] == "'" and harmless(value[1:]) == value else value
