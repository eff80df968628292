"""Linear programs of many objectives or rows over one set of columns, by HiGHS: what the search without dilation asks.

Answers are hints as everywhere: what they prove is checked by whoever asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import highspy
import numpy as np

from jld_core.arrays import Floats
from jld_core.solvers.highs import highs_ends, highs_of

_POLISHED: Final = 1e-8  # relative gap asked of the interior point, which ends without crossover
_FEASIBLE: Final[dict[str, Any]] = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


@dataclass(frozen=True)
class LinearAnswer:
    """What a linear solver says of one program. found: it says optimal. value: of the objective. point: (columns,).

    dual: (rows,) with objective = Rᵀ dual on free columns, ≥ 0 where the lower end of a row binds in a minimisation.
    """

    found: bool
    value: float
    point: Floats
    dual: Floats


class LinearRows:
    """low ≤ R x ≤ high and ends on x, minimised again and again by the dual simplex method from where it stands."""

    def __init__(self, rows: Any, low: Floats, high: Floats, least: Floats, most: Floats) -> None:
        self._highs = highs_of(rows, np.zeros(rows.shape[1]), low, high, least, most, _FEASIBLE)
        self._columns = np.arange(rows.shape[1], dtype=np.int32)

    def bound(self, rows: slice, low: Floats, high: Floats) -> None:
        """Give rows other ends, ±inf where none."""
        place = np.arange(rows.start, rows.stop, dtype=np.int32)
        self._highs.changeRowsBounds(len(place), place, highs_ends(low), highs_ends(high))

    def minimise(self, objective: Floats) -> LinearAnswer:
        """The least of an objective (columns,)."""
        self._highs.changeColsCost(len(self._columns), self._columns, np.ascontiguousarray(objective))
        return _run(self._highs)


def interior_point(
    objective: Floats,
    rows: Any,
    low: Floats,
    high: Floats,
    seconds: float = np.inf,
    threads: int = 1,
    presolve: bool = True,
) -> LinearAnswer:
    """min objective·x over free x with low ≤ R x ≤ high, by HiGHS' interior point without crossover.

    seconds: after which it is given up; the answer is then not found. presolve: False where rows repeat one another,
    of which what it takes out can come back with a dual that fits no column.
    """
    free = np.full(rows.shape[1], np.inf)
    options = {
        **_FEASIBLE,
        "solver": "ipx",
        "run_crossover": "off",
        "threads": threads,
        "presolve": "choose" if presolve else "off",
        "ipm_optimality_tolerance": _POLISHED,
    }
    if np.isfinite(seconds):
        options["time_limit"] = max(seconds, 0.1)
    return _run(highs_of(rows, objective, low, high, -free, free, options))


def _run(highs: Any) -> LinearAnswer:
    highs.run()
    solution = highs.getSolution()
    found = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
    value = float(highs.getInfo().objective_function_value)
    return LinearAnswer(found, value, np.array(solution.col_value), np.array(solution.row_dual))
