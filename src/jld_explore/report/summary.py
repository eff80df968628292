"""Summary of a finished search, by named fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Floats
from jld_core.limit import Status
from jld_core.scene import Search
from jld_explore.evaluation.protocol import BOUND
from jld_explore.space import count_named

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Summary:
    """Outcome of a search: the entries of summary.json that every search has.

    Attributes
    ----------
    best, best_labelling : float, str or None
        Largest load factor of the objective, scene units, and its labelling as text.
    unbounded, proven : bool
        Whether some layout carries any load, and whether none carries more than `best`.
    stands_at_zero : bool or None
        False if the best falls under its dead load alone.
    bound, gap : float or None
        Proven upper bound on λ of all layouts, and its relative distance from `best`.
    stop_reason : str
        Why the search ended.
    classes, evaluated, labellings : int
        Layouts up to symmetry, in total and evaluated; and those evaluated with their images.
    solved, pruned, settled : int
        Classes solved in this run; not worth a solve by a bound; always 0.
    counts_by_status : dict of str to int
        Number of classes by status.
    seconds, rate : float
        Duration, s, and classes solved per second, or None.
    driver, seed : str, int
        Driver and its seed.
    warnings : list of str
        Warnings.
    front : list of dict
        Points: `count`, `load_factor`, `bound`, `proven`.
    next : str or None
        How to complete the proof.
    cracks : str or dict
        Crack model of λ, as in a scene.
    by_fields, uncut : [float or None, float or None] or None
        Bounds on λ of the best, and without cuts, where blocks may crack anywhere.
    facts : dict
        All entries of summary.json.
    """

    best: float | None
    best_labelling: str | None
    unbounded: bool
    proven: bool
    bound: float | None
    gap: float | None
    stop_reason: str
    labellings: int
    evaluated: int
    counts_by_status: dict[str, int]
    seconds: float
    rate: float | None
    driver: str
    classes: int | None = None
    stands_at_zero: bool | None = None
    solved: int = 0
    settled: int = 0
    pruned: int = 0
    seed: int = 0
    warnings: list[str] = field(default_factory=list)
    front: list[dict[str, Any]] = field(default_factory=list)
    next: str | None = None
    cracks: Any = "faces"
    by_fields: list[float | None] | None = None
    uncut: list[float | None] | None = None
    facts: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Summary:
        """Make a summary from the content of summary.json; TypeError if a field without default is missing."""
        known = {one.name for one in fields(cls)} - {"facts", "warnings"}
        found = [*facts.get("warnings", []), *(facts.get("fields") or {}).get("findings", [])]
        return cls(**{name: value for name, value in facts.items() if name in known}, warnings=found, facts=dict(facts))

    def to_json(self) -> dict[str, Any]:
        """Return the content of summary.json as a new dict."""
        return dict(self.facts)


COLUMN: Final = "meets"  # column of layouts that reach the required load factor


def column(low: Floats, status: NDArray[np.object_], search: Search) -> dict[str, Any]:
    """Return the column of rows (k,) that reach the required load factor, as locked ones do.

    Empty if none is required.
    """
    if search.require is None:
        return {}
    with np.errstate(invalid="ignore"):
        carries = (status == str(Status.COLLAPSE)) & (low >= search.require.threshold)
    return {COLUMN: carries | (status == str(Status.LOCKED))}


def order(table: pd.DataFrame, search: Search) -> list[Floats]:
    """Return sort keys (k,) for `numpy.lexsort` that put layouts with the required λ, by count, first."""
    if search.require is None:
        return []
    met = table[COLUMN].to_numpy(bool)
    return [np.where(met, _signed(table, search), 0.0), np.where(met, 0.0, 1.0)]


def facts(table: pd.DataFrame, search: Search, *, complete: bool, finished: bool) -> dict[str, Any]:
    """Return the entries of summary.json on the required load factor; empty if none is required."""
    # a layout that collapses may reach the factor although its lower bound does not
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
