"""Report which layouts reach a required load factor, and the best count among them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Floats
from jld_core.limit import Status
from jld_core.scene import Search
from jld_explore.evaluation.evaluation import BOUND
from jld_explore.space import count_named

if TYPE_CHECKING:
    import pandas as pd

COLUMN: Final = "meets"
"""Name of the column of layouts that reach the required load factor."""


def column(low: Floats, status: NDArray[np.object_], search: Search) -> dict[str, Any]:
    """Return the column of results with True for layouts that reach the required load factor.

    low: (k,) proven lower bounds on λ. status: (k,) names. Locked layouts carry any load and reach it. The result is a
    dict of name to (k,) mask; empty if no load factor is required.
    """
    if search.require is None:
        return {}
    with np.errstate(invalid="ignore"):
        carries = (status == str(Status.COLLAPSE)) & (low >= search.require.threshold)
    return {COLUMN: carries | (status == str(Status.LOCKED))}


def order(table: pd.DataFrame, search: Search) -> list[Floats]:
    """Return sort keys for `numpy.lexsort` that put layouts with the required λ first.

    Those are sorted by the first count of the front, best first. Each key is (k,); without a requirement there are
    none.
    """
    if search.require is None:
        return []
    met = table[COLUMN].to_numpy(bool)
    return [np.where(met, _signed(table, search), 0.0), np.where(met, 0.0, 1.0)]


def facts(table: pd.DataFrame, search: Search, *, complete: bool, finished: bool) -> dict[str, Any]:
    """Return the entries of summary.json on the required load factor: `require` and `proven`.

    table: results with the column of `column`. complete: True if every class has been evaluated. finished: True if the
    driver's proof is complete. A layout that collapses may reach the factor although its lower bound does not. The dict
    is empty if no load factor is required.
    """
    if search.require is None:
        return {}
    met, (count, sense) = table[table[COLUMN]], search.front.axes[0]
    sign = _signed(met, search)
    best = None if met.empty else met.iloc[int(np.argmin(sign))]
    open_status = [Status.UNCERTIFIED, Status.FAILED, Status.COLLAPSE]
    open_rows = table[~table[COLUMN] & table["status"].isin([str(status) for status in open_status])]
    high = open_rows["bracket_hi"].to_numpy(float)
    # Undecided layouts matter only if their count is better.
    may = ~(high < search.require.threshold) & (open_rows["settled"] != BOUND).to_numpy(bool)
    better = _signed(open_rows, search) < (np.inf if best is None else float(np.min(sign)))
    proven = finished or (complete and not np.any(may & better))
    found: dict[str, Any] = {
        "load_factor": search.require.load_factor,
        "count": count,
        "sense": sense,
        "met": len(met),
        "best": None if best is None else _plain(best[count]),
        "best_load_factor": None if best is None or np.isnan(best["load_factor"]) else float(best["load_factor"]),
        "best_labelling": None if best is None else str(best["labelling"]),
        "proven": proven,
    }
    return {"require": found, "proven": proven}


def words(require: dict[str, Any]) -> str:
    """Describe the entry `require` of a summary in one line."""
    least = f"λ ≥ {require['load_factor']:g}"
    if require["best"] is None:
        return f"no layout with {least}" + (": proven that there is none" if require["proven"] else " found")
    count = count_named(require["count"])
    value = f"{require['best']:g} {count.noun}s" if count.integer else f"{count.title} {require['best']:.4g}"
    carried = "any load" if require["best_load_factor"] is None else f"{require['best_load_factor']:.6g}"
    side = "fewest" if require["sense"] == "min" else "most"
    if not count.integer:
        side = "least" if require["sense"] == "min" else "most"
    proof = f"proven the {side}" if require["proven"] else "not proven"
    return f"{value} ({proof} with {least}), which carry {carried}; {require['met']} layouts meet it"


def _signed(table: pd.DataFrame, search: Search) -> Floats:
    """Return the first count of the front, signed so that less is better."""
    count, sense = search.front.axes[0]
    return np.asarray((1.0 if sense == "min" else -1.0) * table[count].to_numpy(float))


def _plain(value: Any) -> float | int:
    """Return a NumPy number as a Python number."""
    return float(value) if isinstance(value, float | np.floating) else int(value)
