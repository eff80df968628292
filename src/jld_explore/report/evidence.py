"""What is known of each point of a front: proven, the best found by a search for it, or merely visited on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bools

if TYPE_CHECKING:
    import pandas as pd

PROVEN: Final = "proven"
FOUND: Final = "found"
VISITED: Final = "visited"

COLUMN: Final = "evidence"


def front_rows(
    front: pd.DataFrame, summary: Mapping[str, Any], counts: Sequence[str], *, complete: bool, aimed: bool
) -> list[dict[str, Any]]:
    """`best_by_count` of summary.json: count, load_factor, bound, proven and evidence for each value of the count that
    is on the front or that the driver speaks of; of two counts `count` is the list of both.

    front: rows of the results that no other row beats. summary: of the study so far, with the driver's own front where
    it has one. complete: every class of the space has its evaluation. aimed: the driver looked for the whole front.
    """
    given = {row["count"]: row for row in summary.get("front") or [] if not isinstance(row["count"], list)}
    rows = []
    for key, group in front.groupby(list(counts)):
        values = key if isinstance(key, tuple) else (key,)
        value = _value(values)
        best = group.sort_values("load_factor", ascending=False, kind="stable").iloc[0]
        known = given.pop(value, None) if len(values) == 1 else None
        # of several that tie the one on the front may carry less by rounding
        strongest = bool(best["rank"] == 1 or best["bracket_hi"] >= summary["best"])
        sure = bool(complete or (known or {}).get("proven") or (strongest and summary["proven"]))
        bound = (known or {}).get("bound")
        if bound is None and sure:
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
    # counts whose best is below that of another count are on no front, and known all the same
    rest = [{**row, COLUMN: PROVEN if row["proven"] else FOUND} for row in given.values()]
    return sorted([*rows, *rest], key=lambda row: row["count"] if isinstance(row["count"], list) else [row["count"]])


def _value(values: Sequence[Any]) -> Any:
    """Counts as JSON has them: a number, or of several the list."""
    numbers = [value if isinstance(value, float) else int(str(value)) for value in values]
    return numbers if len(numbers) > 1 else numbers[0]


def known_front(front: pd.DataFrame) -> tuple[pd.DataFrame, Bools]:
    """The rows of a front without those merely visited, and (k,) which of them are proven."""
    if COLUMN not in front:
        return front, np.zeros(len(front), dtype=bool)
    known = front[front[COLUMN] != VISITED]
    return known, (known[COLUMN] == PROVEN).to_numpy()


def with_evidence(front: pd.DataFrame, summary: Mapping[str, Any], counts: Sequence[str]) -> pd.DataFrame:
    """The front with its column, from `front` of a summary; what a summary does not know was merely visited."""
    told = summary.get("front") or []
    known = {str(row["count"]): row.get(COLUMN, PROVEN if row["proven"] else FOUND) for row in told}
    return front.assign(**{COLUMN: [known.get(str(value), VISITED) for value in values_on(front, counts)]})


def values_on(front: pd.DataFrame, counts: Sequence[str]) -> list[Any]:
    """The count of each row of a front as summary.json has it."""
    return [_value(row) for row in zip(*(front[name].tolist() for name in counts), strict=True)]
