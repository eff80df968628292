"""Linear programs with many objectives or bounds over one set of columns, solved by HiGHS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Floats
from jld_core.solvers import highs_ends, highs_of

_POLISHED: Final = 1e-8  # relative gap to reach by the interior-point method, which ends without crossover
# Feasibility tolerances of all these programs
_FEASIBLE: Final[dict[str, Any]] = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


@dataclass(frozen=True)
class LinearAnswer:
    """Unverified solution of a linear program."""

    found: bool  # True if the solver reports an optimum. Otherwise the other values may be arbitrarily wrong.
    value: float
    point: Floats  # (columns,) solution x
    # (rows,) multipliers with objective = Rᵀ dual on free columns; ≥ 0 where the lower bound of a row binds in a
    # minimisation
    dual: Floats


class LinearRows:
    """Program low ≤ R x ≤ high, least ≤ x ≤ most, minimised for many objectives from the last solution."""

    def __init__(self, rows: Any, low: Floats, high: Floats, least: Floats, most: Floats) -> None:
        self._highs = highs_of(rows, np.zeros(rows.shape[1]), low, high, least, most, _FEASIBLE)
        self._columns = np.arange(rows.shape[1], dtype=np.int32)

    def bound(self, rows: slice, low: Floats, high: Floats) -> None:
        """Change the bounds (k,) of consecutive rows for the minimisations that follow."""
        place = np.arange(rows.start, rows.stop, dtype=np.int32)
        self._highs.changeRowsBounds(len(place), place, highs_ends(low), highs_ends(high))

    def minimise(self, objective: Floats) -> LinearAnswer:
        """Minimise an objective (columns,) over the present bounds."""
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
    """Minimise objective·x over free x with low ≤ R x ≤ high, by HiGHS' interior-point method."""
    # No crossover follows.
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
    """Run a HiGHS instance, and return its unverified solution."""
    highs.run()
    solution = highs.getSolution()
    found = highs.getModelStatus().name == "kOptimal"
    value = float(highs.getInfo().objective_function_value)
    return LinearAnswer(found, value, np.array(solution.col_value), np.array(solution.row_dual))
