"""Classify each point of a front: proven, found by a search for it, or visited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bools

if TYPE_CHECKING:
    import pandas as pd

PROVEN: Final = "proven"
"""Evidence of a point that is proven to be on the front: no layout carries more, or as much with a better count."""
FOUND: Final = "found"
"""Evidence of a point that is the best found by a search for it."""
VISITED: Final = "visited"
"""Evidence of a point that was evaluated during a search with another aim."""

COLUMN: Final = "evidence"
"""Name of the column of the evidence."""


def front_rows(
    front: pd.DataFrame, summary: Mapping[str, Any], axes: Sequence[tuple[str, str]], *, complete: bool, aimed: bool
) -> list[dict[str, Any]]:
    """Return the best λ known for every count, with its evidence, for summary.json.

    Counts are those on the front and those of the driver's own front. Each row has count, load_factor, bound, proven
    and evidence ("proven", "found" or "visited"). With two counts `count` is a list. The strongest layout alone is
    proven the best of its count, and not on the front: one with a better count may carry as much.

    front: rows of the results that no other row dominates. summary: summary of the study, with the driver's own front
    if it has one. axes: names of the counts with their better directions, "max" or "min". complete: True if every class
    of the space has been evaluated. aimed: True if the driver searched for the whole front.
    """
    given = {row["count"]: row for row in summary.get("front") or [] if not isinstance(row["count"], list)}
    rows, told = [], list(given.values())
    sign = 1.0 if axes[0][1] == "max" else -1.0
    for key, group in front.groupby([name for name, _ in axes]):
        values = key if isinstance(key, tuple) else (key,)
        value = _value(values)
        best = group.sort_values("load_factor", ascending=False, kind="stable").iloc[0]
        known = given.pop(value, None) if len(values) == 1 else None
        # Of several tied rows, the one on the front may have a slightly smaller λ.
        strongest = bool(best["rank"] == 1 or best["bracket_hi"] >= summary["best"])
        rivals = [] if known is None else [row for row in told if sign * row["count"] >= sign * known["count"]]
        sure = bool(complete or (rivals and all(row["proven"] for row in rivals)))
        bound = (known or {}).get("bound")
        if bound is None and (sure or (strongest and summary["proven"])):
            bound = summary["bound"] if strongest and not complete else best["bracket_hi"]
        rows.append(
            {
                "count": value,
                "load_factor": float(best["load_factor"]),
                "bound": None if bound is None else float(bound),
                "proven": sure,
                COLUMN: PROVEN if sure else FOUND if aimed or strongest else VISITED,
            }
        )
    # Counts whose best is dominated are not on the front, but their bounds are known.
    rest = [{**row, COLUMN: PROVEN if row["proven"] else FOUND} for row in given.values()]
    return sorted([*rows, *rest], key=lambda row: row["count"] if isinstance(row["count"], list) else [row["count"]])


def _value(values: Sequence[Any]) -> Any:
    """Return counts as in JSON: a number, or a list for several counts."""
    numbers = [value if isinstance(value, float) else int(str(value)) for value in values]
    return numbers if len(numbers) > 1 else numbers[0]


def known_front(front: pd.DataFrame) -> tuple[pd.DataFrame, Bools]:
    """Return the rows of a front with better evidence than "visited", and the proven ones.

    The mask (k,) of proven rows belongs to the rows returned. A front without evidence is returned whole, with no row
    proven.
    """
    if COLUMN not in front:
        return front, np.zeros(len(front), dtype=bool)
    known = front[front[COLUMN] != VISITED]
    return known, (known[COLUMN] == PROVEN).to_numpy()


def with_evidence(front: pd.DataFrame, summary: Mapping[str, Any], counts: Sequence[str]) -> pd.DataFrame:
    """Return a front with its column `evidence`, from the entry `front` of a summary.

    counts: names of the counts that identify a point. Points that the summary does not contain become "visited".
    """
    told = summary.get("front") or []
    known = {str(row["count"]): row.get(COLUMN, PROVEN if row["proven"] else FOUND) for row in told}
    return front.assign(**{COLUMN: [known.get(str(value), VISITED) for value in values_on(front, counts)]})


def values_on(front: pd.DataFrame, counts: Sequence[str]) -> list[Any]:
    """Return the count of each row of a front in the form of summary.json.

    It is a number, or a list of numbers for several counts.
    """
    return [_value(row) for row in zip(*(front[name].tolist() for name in counts), strict=True)]
