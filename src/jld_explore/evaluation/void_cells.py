"""Evaluate labellings that leave cells out, each on the structure of the remaining cells."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.sub_assembly import without
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.protocol import EvaluatorSettings, LabellingEvaluator

_MOST_EVALUATORS: Final = 64  # largest number of structures whose evaluators are cached


class VoidCellsEvaluator(LabellingEvaluator):
    """Evaluator of labellings that leave cells out (`space.void`).

    Each labelling is evaluated on the structure of the cells that remain.

    assembly: structure with a sink, an element that stands for the void: m faces, then c faces from cells to the sink.
    settings: model and settings; the batch solver is never used.
    """

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        # Nearly every labelling leaves a different structure; one solve is faster than making its batch solver.
        self.settings, self._sink = replace(settings, use_batch_solver=False), assembly.sink
        gone = np.arange(len(assembly.elements)) == assembly.sink
        self._real, self._faces = without(assembly, gone)
        self._cells = assembly.interfaces.a[len(self._faces) :]
        self._evaluators: OrderedDict[bytes, tuple[LabellingEvaluator, Ints]] = OrderedDict()

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings, grouped by the cells they leave out.

        See `LabellingEvaluator.evaluate_all`. A labelling is a row (m + c,): labels of faces (True = dry), then of
        cells (True = stays).
        """
        found: list[Evaluation | None] = [None] * len(labellings)
        groups: dict[bytes, list[int]] = {}
        for row, labels in enumerate(labellings):
            groups.setdefault(np.packbits(labels[len(self._faces) :]).tobytes(), []).append(row)
        for rows in groups.values():
            if deadline is not None and deadline.passed():
                break
            evaluator, kept = self._evaluator_of(labellings[rows[0]])
            own = None if pruning_thresholds is None else pruning_thresholds[rows]
            answers = evaluator.evaluate_all(labellings[rows][:, kept], own, deadline)
            for row, answer in zip(rows, answers, strict=False):
                found[row] = answer
        done = next((row for row, answer in enumerate(found) if answer is None), len(found))
        return [answer for answer in found[:done] if answer is not None]

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling (m + c,); see `LabellingEvaluator.evaluate`."""
        evaluator, kept = self._evaluator_of(labels)
        return evaluator.evaluate(labels[kept], pruning_threshold)

    def _evaluator_of(self, labels: Bits) -> tuple[LabellingEvaluator, Ints]:
        """Return the evaluator of the remaining structure, and the indices of the remaining faces.

        labels: (m + c,) as in `evaluate_all`. Evaluators are stored by the cells that are left out.
        """
        stays = labels[len(self._faces) :]
        key = np.packbits(stays).tobytes()
        if key not in self._evaluators:
            gone = np.zeros(len(self._real.elements), dtype=bool)
            gone[self._cells[~stays]] = True
            rest, kept = without(self._real, gone)
            self._evaluators[key] = evaluator_of(rest, self.settings), kept
            if len(self._evaluators) > _MOST_EVALUATORS:
                self._evaluators.popitem(last=False)
        self._evaluators.move_to_end(key)
        return self._evaluators[key]
