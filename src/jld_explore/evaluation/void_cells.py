"""Evaluation of labellings that leave cells out: each set of cells that stay is a structure of its own."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly, without
from jld_core.deadline import Deadline
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.evaluator import EvaluatorSettings

_KEPT: Final = 64
"""Structures whose evaluators are kept at hand."""


class VoidCellsEvaluator:
    """Evaluates labellings of an assembly with a sink (`space.void`), each on the structure that it leaves."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        # nearly every labelling leaves another structure, and one alone is solved before its batch solver is made
        self.settings, self._sink = replace(settings, many=False), assembly.sink
        gone = np.arange(len(assembly.elements)) == assembly.sink
        self._real, self._faces = without(assembly, gone)
        self._cells = assembly.interfaces.a[len(self._faces) :]
        self._made: OrderedDict[bytes, tuple[Any, Any]] = OrderedDict()

    def evaluate_all(
        self,
        labellings: Bits,
        floors: Floats | None = None,
        waiting: Bits | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m + c); arguments as for `Evaluator.evaluate_all`."""
        found: list[Evaluation | None] = [None] * len(labellings)
        groups: dict[bytes, list[int]] = {}
        for row, labels in enumerate(labellings):
            groups.setdefault(np.packbits(labels[len(self._faces) :]).tobytes(), []).append(row)
        for rows in groups.values():
            if deadline is not None and deadline.passed():
                break
            evaluator, kept = self._of(labellings[rows[0]])
            own = None if floors is None else floors[rows]
            answers = evaluator.evaluate_all(labellings[rows][:, kept], own, None, deadline)
            for row, answer in zip(rows, answers, strict=False):
                found[row] = answer
        done = next((row for row, answer in enumerate(found) if answer is None), len(found))
        return [answer for answer in found[:done] if answer is not None]

    def evaluate(self, labels: Bits, floor: float = -math.inf, waiting: Bits | None = None) -> Evaluation:
        """Evaluate one labelling (m + c,)."""
        evaluator, kept = self._of(labels)
        answer: Evaluation = evaluator.evaluate(labels[kept], floor, None)
        return answer

    def _of(self, labels: Bits) -> tuple[Any, Any]:
        """The evaluator of what a labelling leaves, and the faces that are left."""
        stays = labels[len(self._faces) :]
        key = np.packbits(stays).tobytes()
        if key not in self._made:
            gone = np.zeros(len(self._real.elements), dtype=bool)
            gone[self._cells[~stays]] = True
            rest, kept = without(self._real, gone)
            self._made[key] = evaluator_of(rest, self.settings), kept
            if len(self._made) > _KEPT:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        return self._made[key]
