"""A mixed-integer linear program built row by row, and run so that it can be watched and stopped."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import highspy
import numpy as np

from jld_core.assembly import Floats

INF: Final = highspy.kHighsInf
FEASIBILITY: Final = 1e-8
"""Tolerance on rows asked of the solver, scaled."""

INTEGRALITY: Final = 1e-7
"""Tolerance on integrality asked of the solver."""


class Program:
    """Columns and rows added in groups; maximises. Everything is scaled as in `Template`."""

    def __init__(self) -> None:
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.cost: list[float] = []
        self.whole: list[int] = []
        self._rows: list[tuple[list[int], list[float], float, float]] = []

    def columns(self, count: int, lower: float, upper: float, *, whole: bool = False) -> range:
        """Add columns with these bounds; their indices."""
        start = len(self.lower)
        self.lower += [lower] * count
        self.upper += [upper] * count
        self.cost += [0.0] * count
        if whole:
            self.whole += range(start, start + count)
        return range(start, start + count)

    def row(self, columns: Sequence[int], values: Sequence[float], lower: float, upper: float) -> int:
        """Add lower ≤ Σ values·columns ≤ upper; its index."""
        self._rows.append((list(columns), list(values), lower, upper))
        return len(self._rows) - 1

    def bound_row(self, index: int, lower: float, upper: float) -> None:
        """Change the bounds of a row."""
        columns, values, _, _ = self._rows[index]
        self._rows[index] = (columns, values, lower, upper)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self._rows), len(self.lower)

    def load(self, *, relaxed: bool = False, threads: int = 1) -> highspy.Highs:
        """The program in a solver; relaxed: without integrality."""
        model = highspy.HighsLp()
        model.num_col_, model.num_row_ = len(self.lower), len(self._rows)
        model.sense_ = highspy.ObjSense.kMaximize
        model.col_cost_ = np.array(self.cost)
        model.col_lower_, model.col_upper_ = np.array(self.lower), np.array(self.upper)
        model.row_lower_ = np.array([row[2] for row in self._rows])
        model.row_upper_ = np.array([row[3] for row in self._rows])
        start = np.concatenate([[0], np.cumsum([len(row[0]) for row in self._rows])])
        model.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        model.a_matrix_.start_ = start.astype(np.int32)
        model.a_matrix_.index_ = np.array([c for row in self._rows for c in row[0]], dtype=np.int32)
        model.a_matrix_.value_ = np.array([v for row in self._rows for v in row[1]])
        if not relaxed:
            kinds = [highspy.HighsVarType.kContinuous] * len(self.lower)
            for column in self.whole:
                kinds[column] = highspy.HighsVarType.kInteger
            model.integrality_ = kinds
        highs = highspy.Highs()  # type: ignore[no-untyped-call]
        options: dict[str, bool | int | float | str] = {
            "output_flag": False,
            "threads": threads,
            "primal_feasibility_tolerance": FEASIBILITY,
            "dual_feasibility_tolerance": FEASIBILITY,
            "mip_feasibility_tolerance": INTEGRALITY,
            "mip_rel_gap": 1e-7,
            "mip_heuristic_effort": 0.0,  # incumbents come from elsewhere
            "mip_abs_gap": 1e-9,
        }
        for key, value in options.items():
            highs.setOptionValue(key, value)
        highs.passModel(model)
        return highs


@dataclass(frozen=True)
class Outcome:
    """status: "optimal", "infeasible" or "stopped". bound: the solver's upper bound. point: best found, or None.

    nodes: of the branch and bound.
    """

    status: str
    bound: float
    point: Floats | None
    nodes: int


def run(highs: highspy.Highs, *, stop: Callable[[float], bool]) -> Outcome:
    """Run a loaded mixed-integer program in a thread of its own.

    stop: asked several times a second with the bound so far, in the caller's thread, so that signals are heard;
    True, or an exception, ends the run.
    """
    halt = threading.Event()
    seen = [INF]

    def watch(event: Any) -> None:
        seen[0] = min(seen[0], float(event.data_out.mip_dual_bound))
        if halt.is_set():
            event.interrupt()

    highs.cbMipInterrupt += watch
    worker = threading.Thread(target=highs.run, daemon=True)
    worker.start()
    try:
        while worker.is_alive():
            worker.join(0.1)
            if worker.is_alive() and not halt.is_set() and stop(seen[0]):
                halt.set()
    except BaseException:
        halt.set()
        worker.join()
        raise
    finally:
        highs.cbMipInterrupt -= watch
    info = highs.getInfo()
    kind, known = highspy.HighsModelStatus, highs.getModelStatus()
    bound = float(info.mip_dual_bound)
    if not math.isfinite(bound) or abs(bound) >= INF:
        bound = seen[0]
    feasible = info.primal_solution_status == int(highspy.SolutionStatus.kSolutionStatusFeasible)
    point = np.array(highs.getSolution().col_value) if feasible else None
    status = {kind.kOptimal: "optimal", kind.kInfeasible: "infeasible"}.get(known, "stopped")
    return Outcome(status, bound, point, max(int(info.mip_node_count), 0))
