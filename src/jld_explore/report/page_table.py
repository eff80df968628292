"""Make the table of a page: the columns of results.csv, rounded, with each row's evidence."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

from jld_core.assembly import Assembly
from jld_explore.report.columns import ranked_by
from jld_explore.report.page_contract import Column, Curve, Table
from jld_explore.report.rounding import rounded
from jld_explore.space import Count, registered
from jld_explore.space.labelling import pack
from jld_explore.space.void import beside_nothing, dry_of

if TYPE_CHECKING:
    import pandas as pd

MOST: Final = 20_000
"""Largest number of strongest rows on a page; the front is added."""

TITLES: Final = {
    "multiplicity": "mirror images",
    "load_factor_associative": "λ associative",
    "load_factor_zero_dilation": "λ without dilation",
    "seconds": "seconds",
}
"""Titles of columns whose name is not a good title."""
_FIRST: Final = ("rank", "load_factor", "bracket_lo", "bracket_hi", "governing", "status")  # columns shown first
# Columns shown last
_LAST: Final = ("load_factor_associative", "load_factor_zero_dilation", "multiplicity", "settled", "seconds", "driver")
# Beginnings of the names of numeric columns that are no counts
_NO_COUNT: Final = ("rank", "multiplicity", "seconds", "load_factor", "bracket_lo", "bracket_hi")


def chosen_rows(results: pd.DataFrame, front: pd.DataFrame, most: int = MOST) -> pd.DataFrame:
    """Return the rows of the results that a page shows: the first `most`, and the front.

    They keep the order of the results.
    """
    if len(results) <= most:
        return results
    kept = np.arange(len(results)) < most
    kept |= results.index.isin(front.index)
    return results[kept]


def table_of(
    results: pd.DataFrame, front: pd.DataFrame, assembly: Assembly, *, axes: Sequence[tuple[str, str]], left_out: int
) -> Table:
    """Return the table of layouts for a page: columns, labellings and evidence.

    results: the rows to show. front: rows on the front, with a column `evidence`. axes: counts of the front, each with
    its better direction, "max" or "min". left_out: number of rows of the study that are not shown.
    """
    import pandas as pd  # here and below: slow to import and needed for tables only

    count, sense = axes[0]
    texts = results["labelling"].astype(str)
    rows = [dry_of(text) for text in texts]
    bits = np.array(rows, dtype=bool).reshape(len(results), assembly.faces)
    nothing = [beside_nothing(text) for text in texts]
    beside = np.array(nothing if np.any(nothing) else [])
    evidence = pd.Series("visited", index=results.index, dtype=object)
    known = front.index.intersection(results.index)
    evidence.loc[known] = front.loc[known, "evidence"].astype(str)
    value = ranked_by(results)
    ranked = {"load_factor": value, "bracket_lo": f"{value} at least", "bracket_hi": f"{value} at most"}
    columns = [
        _column(name, ranked.get(name) or _title(name, assembly), results[name], assembly)
        for name in _ordered(list(map(str, results.columns)))
        if name != "labelling" and (name == "load_factor" or results[name].notna().any())
    ]
    counts = [c["name"] for c in columns if c["kind"] != "text" and not c["name"].startswith(_NO_COUNT)]
    return {
        "rows": len(results),
        "columns": columns,
        "labellings": base64.b64encode(pack(bits).tobytes()).decode("ascii"),
        "evidence": cast(list[Any], evidence.tolist()),
        "beside": base64.b64encode(pack(beside.astype(bool)).tobytes()).decode("ascii"),
        "count": count,
        "sense": "max" if sense == "max" else "min",
        "line": len(axes) == 1,
        "counts": sorted(counts, key=lambda name: name != count),
        "left_out": left_out,
    }


def _ordered(names: list[str]) -> list[str]:
    """Order column names: rank and λ first, then counts, then the origin of each row."""
    first = [name for name in _FIRST if name in names]
    last = [name for name in _LAST if name in names]
    return [*first, *(name for name in names if name not in first and name not in last), *last]


def _column(name: str, title: str, values: pd.Series[Any], assembly: Assembly) -> Column:
    """Return one column as data."""
    kind, shown = _values(values, digits=4 if name == "seconds" else 10)
    return {"name": name, "title": title, "unit": _unit(name, assembly), "kind": kind, "values": shown}


def _values(values: pd.Series[Any], digits: int) -> tuple[Literal["integer", "number", "text"], list[Any]]:
    """Return the kind of a column ("integer", "number" or "text") and its values."""
    import pandas as pd

    if pd.api.types.is_integer_dtype(values):
        return "integer", [None if pd.isna(v) else int(v) for v in values]
    if pd.api.types.is_float_dtype(values):
        return "number", rounded(values.to_numpy(dtype=float, na_value=np.nan), digits)
    return "text", ["" if pd.isna(v) else str(v) for v in values]


def _title(name: str, assembly: Assembly) -> str:
    """Return the title of a column."""
    if name.startswith("load_factor["):
        return f"λ, {name[len('load_factor[') : -1]}"
    count = _counts().get(name)
    return TITLES.get(name, name.replace("_", " ")) if count is None else count.heading(assembly)


def _unit(name: str, assembly: Assembly) -> str:
    """Return the unit of a column, "" for none."""
    count = _counts().get(name)
    return "" if count is None else count.unit(assembly)


def _counts() -> dict[str, Count]:
    """Return all counts by name."""
    return {count.name: count for count in registered()}


def curve_of(name: str, history: pd.DataFrame) -> Curve:
    """Return a convergence curve for a page from the table of convergence.csv.

    name: legend text. Rows without a finite best λ are left out.
    """
    found = history[np.isfinite(history["best"].astype(float))]
    return {
        "name": name,
        "solves": [int(v) for v in found["solves"]],
        "seconds": rounded(found["seconds"].to_numpy(dtype=float), 5),
        "best": rounded(found["best"].to_numpy(dtype=float), 10),
    }


def facts_of_summary(summary: Mapping[str, Any], results: pd.DataFrame) -> dict[str, str]:
    """Describe the proven results of a search: bracket of the best, bound, gap.

    The result is texts by name. The versions of libraries are added if the summary has them. results: table of results,
    best row first.
    """
    facts: dict[str, str] = {}
    best = results[results["load_factor"].notna()].head(1)
    if summary.get("best") is not None and len(best):
        row = best.iloc[0]
        facts["bracket of the best"] = f"{row['bracket_lo']:.9g} … {row['bracket_hi']:.9g}"
    bound, gap = summary.get("bound"), summary.get("gap")
    facts["bound over all layouts"] = "none is known" if bound is None else f"{bound:.9g}"
    if gap is not None:
        facts["gap to the bound"] = f"{gap:.2g}"
    versions = summary.get("versions", {})
    if versions:
        facts["versions"] = ", ".join(f"{name} {version}" for name, version in versions.items())
    return facts
