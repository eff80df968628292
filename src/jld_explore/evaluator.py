"""Labelling → Evaluation: one limit analysis per labelling, on a template that is built once."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

from jld_core import tolerances
from jld_core.assembly import Assembly, Bits
from jld_core.condense import solve_condensed, worth_condensing
from jld_core.limit import LimitAnalysis
from jld_core.solvers.status import Status
from jld_core.zero_dilation import zero_dilation

SOLVE: Final = "solve"
CERTIFICATE: Final = "certificate"


@dataclass(frozen=True)
class Evaluation:
    """What is known of one labelling; λ in scene units, NaN where not computed or infinite.

    status: of the objective. low, high: proven bounds. associative: λ with associative friction.
    zero_dilation: λ without dilation. settled: "solve" or "certificate". seconds: spent on it.
    """

    status: Status
    low: float
    high: float
    associative: float
    zero_dilation: float = math.nan
    settled: str = SOLVE
    seconds: float = 0.0

    @property
    def load_factor(self) -> float:
        """λ of the objective: without dilation where that was computed, else associative."""
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)
"""The evaluation of a labelling whose worker died or hung twice."""


@dataclass(frozen=True)
class EvaluatorSettings:
    """What an evaluator is asked for.

    objective: "associative" or "zero-dilation". gap: width above which it is uncertified.
    """

    objective: str = "associative"
    gap: float = tolerances.GAP


class Evaluator:
    """Evaluates labellings of one assembly; an answer depends on the labelling alone, never on the order."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self.assembly, self.settings = assembly, settings
        self._analysis = LimitAnalysis(assembly, gap=settings.gap)

    def evaluate(self, labels: Bits) -> Evaluation:
        """Evaluate one labelling. labels: (m,) True dry."""
        start = time.perf_counter()
        if self.settings.objective == "zero-dilation":
            return self._without_dilation(labels, start)
        if worth_condensing(self._analysis.template, labels):
            found = solve_condensed(self._analysis, labels, stands=False)
            if found is not None:
                low, high = found.bracket
                return Evaluation(found.status, low, high, found.load_factor, seconds=time.perf_counter() - start)
        status, proof = self._analysis.prove(labels)
        scale, nan = self._analysis.template.scaling.load, math.nan
        low = proof.low * scale if math.isfinite(proof.low) else nan
        high = proof.high * scale if math.isfinite(proof.high) else nan
        load_factor = 0.5 * (low + high)
        if status is Status.UNSTABLE:
            low = high = load_factor = nan
        elif status is Status.LOCKED:
            high = load_factor = nan
        elif status is Status.UNCERTIFIED and math.isnan(load_factor):
            load_factor = proof.guess * scale
        return Evaluation(status, low, high, load_factor, seconds=time.perf_counter() - start)

    def _without_dilation(self, labels: Bits, start: float) -> Evaluation:
        associative = self._analysis.solve(labels, stands=False)
        found = zero_dilation(self._analysis, labels, associative=associative, stands=False)
        low, high = found.bracket
        return Evaluation(
            status=found.status,
            low=low,
            high=high,
            associative=associative.load_factor,
            zero_dilation=found.load_factor,
            seconds=time.perf_counter() - start,
        )
