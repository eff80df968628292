"""Evaluate labellings by an objective function of the user instead of λ."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.errors import ParameterError
from jld_core.limit import Status
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.protocol import EvaluatorSettings, LabellingEvaluator

OwnObjective = Callable[[Evaluation, Assembly, Bits], float]
"""Function of an evaluation with its λ, the assembly, and the labels (m,); its value is maximised."""


class OwnObjectiveEvaluator(LabellingEvaluator):
    """Evaluator whose load factors are the values of a function of the user.

    Only labellings that have a λ are valued; others keep their status and are not ranked. `associative`, `low` and
    `high` of an evaluation are the value, and the last entry of its `cases` is λ.

    function: function of an evaluation, the assembly and the labels, which returns the value. assembly: structure whose
    labellings are evaluated. settings: model and settings of the evaluator of λ.
    """

    def __init__(self, function: OwnObjective, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self._function, self._assembly = function, assembly
        self._evaluator = evaluator_of(assembly, settings)

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings by the objective; see `LabellingEvaluator.evaluate_all`.

        Pruning thresholds are ignored, since bounds on λ are no bounds on the objective.
        """
        found = self._evaluator.evaluate_all(labellings, None, deadline)
        return [self._with_value(labels, one) for labels, one in zip(labellings, found, strict=False)]

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling by the objective; see `LabellingEvaluator.evaluate`."""
        return self.evaluate_all(labels[None])[0]

    def _with_value(self, labels: Bits, found: Evaluation) -> Evaluation:
        """Return a copy of an evaluation in which the value of the objective replaces λ.

        Raises InputError for a value that is no number.
        """
        cases = found.cases or (math.nan,) * len(self._assembly.cases)
        if found.status is not Status.COLLAPSE:
            return replace(found, cases=(*cases, math.nan))
        value: Any = self._function(found, self._assembly, labels)
        if not isinstance(value, int | float | np.integer | np.floating) or not math.isfinite(value):
            text = "".join("d" if dry else "i" for dry in labels)
            raise ParameterError("objective", f"it is {value!r} for the labelling {text}", "a finite number")
        return replace(
            found,
            low=float(value),
            high=float(value),
            associative=float(value),
            zero_dilation=math.nan,
            cases=(*cases, found.load_factor),
        )
