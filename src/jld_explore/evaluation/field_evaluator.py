"""Evaluate labellings whose blocks crack along finer cells, or anywhere by fields."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.fields.bounds import CoarseBounds, FieldSetting
from jld_core.limit import CaseBounds, Status, governing
from jld_core.refinement.cells import CrackCells
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.protocol import BOUND, SOLVE, Evaluation, EvaluatorSettings, LabellingEvaluator


def field_evaluation(
    low: Floats,
    high: Floats,
    required: Floats,
    *,
    most: float = math.inf,
    best: float = -math.inf,
    seconds: float = 0.0,
    nominal: float | None = None,
) -> Evaluation:
    """Return the evaluation of bounds by fields (c,) on λ under each case; λ is the lower bound."""
    least, most = float((low / required).min()), min(most, float((high / required).min()))
    several = len(low) > 1
    cases = tuple(float(value) if math.isfinite(value) else math.nan for value in low) if several else ()
    if nominal is not None:
        # with nominal values the entries of load cases and then that value are expected
        cases = (*cases, nominal if math.isfinite(nominal) else math.nan)
    known = [
        CaseBounds(Status.COLLAPSE, one, other, one) for one, other in zip(low.tolist(), high.tolist(), strict=True)
    ]
    case = governing(known, required.tolist()).case if several else -1
    nan = math.nan
    low_end, high_end = (end if math.isfinite(end) else nan for end in (least, most))
    if most < 0.0:
        status, low_end, high_end, value, settled = Status.UNSTABLE, nan, nan, nan, SOLVE
    elif math.isfinite(least) and math.isfinite(most):
        status, value, settled = Status.COLLAPSE, least, SOLVE
    else:
        status, value = Status.UNCERTIFIED, nan
        settled = BOUND if math.isnan(low_end) and most < best else SOLVE
    return Evaluation(status, low_end, high_end, value, settled=settled, seconds=seconds, cases=cases, governing=case)


_TOGETHER: Final = 16  # most labellings that are bounded together: two vectors of the widest processors

# Time that labellings take together above which fewer are, as time limits are kept between them; s
_SECONDS: Final = 0.25


class FieldEvaluator(LabellingEvaluator):
    """Evaluator of labellings by fields on the coarsest mesh, under all load cases."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings | None = None) -> None:
        self._coarse = [CoarseBounds(FieldSetting.of(case)) for case in assembly.by_case]
        self._required, self._count = assembly.required, 1
        self._nominal: list[CoarseBounds] | None = None
        if assembly.has_low_values:
            self._nominal = [CoarseBounds(FieldSetting.of(case)) for case in assembly.at_nominal.by_case]

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        # Pruning thresholds are ignored: bounds by fields have no cheap part.
        found: list[Evaluation] = []
        while len(found) < len(labellings) and not (deadline is not None and deadline.passed()):
            start = time.perf_counter()
            found += self._together(labellings[len(found) : len(found) + self._count])
            # how many are taken together does not change their bounds
            late = time.perf_counter() - start > _SECONDS
            self._count = max(1, self._count // 2) if late else min(_TOGETHER, 2 * self._count)
        return found

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        return self._together(labels[None])[0]

    def _together(self, labellings: Bits) -> list[Evaluation]:
        """Bound labellings (k, m) on the coarsest mesh."""
        start = time.perf_counter()
        lows, highs = np.moveaxis(np.array([coarse.both(labellings) for coarse in self._coarse]), 1, 0)
        nominal: list[float | None] = [None] * len(labellings)
        if self._nominal is not None:
            least = np.array([coarse.both(labellings)[0] for coarse in self._nominal])
            nominal = [float(value) for value in (least / self._required[:, None]).min(axis=0)]
        seconds = (time.perf_counter() - start) / len(labellings)
        return [
            field_evaluation(low, high, self._required, seconds=seconds, nominal=value)
            for low, high, value in zip(lows.T, highs.T, nominal, strict=True)
        ]


@dataclass(frozen=True)
class MakeCellEvaluator:
    """Maker of evaluators on finer cells, which can be sent to the workers of a study."""

    cells: CrackCells  # the cells, and the joint face of each of their faces

    def __call__(self, assembly: Assembly, settings: EvaluatorSettings) -> LabellingEvaluator:
        """Return an evaluator of labellings of the joint grid that solves the finer cells."""
        return CellEvaluator(self.cells, settings)


class CellEvaluator(LabellingEvaluator):
    """Evaluator of labellings of the joint grid on finer cells, whose faces share labels."""

    def __init__(self, cells: CrackCells, settings: EvaluatorSettings) -> None:
        self._cells, self._fine = cells, evaluator_of(cells.fine, settings)

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        return self._fine.evaluate_all(self._cells.labels(labellings), pruning_thresholds, deadline)

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        return self._fine.evaluate(self._cells.labels(labels), pruning_threshold)


TIME_POWER: Final = 1.3  # power of the number of triangles that the time of a large mesh grows with


def time_rate(seconds: float, triangles: float) -> float:
    """Return the time of a mesh over the power `TIME_POWER` of its number of triangles."""
    return float(seconds / triangles**TIME_POWER)


def mesh_seconds(rate: float, triangles: float) -> float:
    """Return the expected processor time of bounds by fields on a mesh."""
    return float(rate * triangles**TIME_POWER)


# rate of both bounds on a coarsest mesh, s; a mesh of 60 triangles takes 24 ms
COARSE_RATE: Final = time_rate(0.024, 60)
