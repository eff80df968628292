"""Labellings evaluated once: what is on record is taken from there, the rest goes to workers and onto the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.deadline import Deadline
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.pruning import IncumbentFront
from jld_explore.evaluation.records import Records
from jld_explore.evaluation.workers import Run, Workers
from jld_explore.space import orbit_sizes


@dataclass(frozen=True)
class Sent:
    """Labellings (k, m), what is found of them so far, the positions of those the workers have, and their run."""

    labellings: Bits
    found: list[Evaluation | None]
    missing: Ints
    run: Run | None


class Evaluating(Protocol):
    """What a study asks: send labellings, and take their evaluations when their turn comes."""

    def send(self, labellings: Bits) -> Sent:
        """Begin to evaluate labellings (k, m)."""

    def take(self, sent: Sent) -> list[Evaluation] | None:
        """Evaluations in the order sent; None where time ran out."""


class RecordedEvaluator:
    """Workers with a record.

    group: symmetries (g, m), which say how many labellings one stands for. deadline: after which none is begun.
    front: what does not matter is not solved to the end. proofs: evaluations come with what they prove about others.
    report: told what is known, as it comes. solved: how many the workers evaluated.
    """

    def __init__(
        self,
        workers: Workers,
        records: Records,
        group: Ints,
        *,
        deadline: Deadline | None = None,
        front: IncumbentFront | None = None,
        proofs: bool = False,
        report: Callable[[list[Evaluation]], None] = lambda found: None,
    ) -> None:
        self.records, self.solved = records, 0
        self._empty = not len(records)
        self._workers, self._group, self._deadline = workers, group, deadline
        self._front, self._proofs, self._report = front, proofs, report

    def send(self, labellings: Bits, waiting: Bits | None = None) -> Sent:
        """Begin to evaluate what is not on record. waiting: (j, m) labellings that wait as well."""
        found = self._recalled(labellings)
        missing = _missing(found)
        run = None
        if missing.size:
            floors = None if self._front is None else self._front.below(labellings[missing])
            # a search that ends for lack of time has something to show at least
            owed, self._empty = self._empty, False
            run = self._workers.run(labellings[missing], self._deadline, floors, waiting, owed=owed)
        return Sent(labellings, found, missing, run)

    def take(self, sent: Sent) -> list[Evaluation] | None:
        """Evaluations in the order sent, recorded as they come; None where time ran out."""
        found, labellings, missing = sent.found, sent.labellings, sent.missing
        self._report([evaluation for evaluation in found if evaluation is not None])
        if sent.run is not None:
            weights = orbit_sizes(labellings[missing], self._group)
            for part, evaluations in sent.run:
                self.records.append(labellings[missing[part]], weights[part].tolist(), evaluations)
                self.solved += len(evaluations)
                for position, evaluation in zip(missing[part].tolist(), evaluations, strict=True):
                    found[position] = evaluation
                self._report(evaluations)
                if self._deadline is not None and self._deadline.passed():
                    break
        complete = [evaluation for evaluation in found if evaluation is not None]
        return complete if len(complete) == len(found) else None

    def settle(self, labellings: Bits, evaluations: list[Evaluation]) -> list[Evaluation]:
        """Record what needed no solve, labellings (k, m); of those on record, what the record says."""
        stored = self.records.find_all(labellings)
        new = _missing(stored)
        if new.size:
            weights = orbit_sizes(labellings[new], self._group)
            self.records.append(labellings[new], weights.tolist(), [evaluations[n] for n in new])
        told = [old or made for old, made in zip(stored, evaluations, strict=True)]
        self._report(told)
        return told

    def _recalled(self, labellings: Bits) -> list[Evaluation | None]:
        found = self.records.find_all(labellings)
        if not self._proofs:
            return found
        return [
            None if one is None else replace(one, proofs=self.records.proofs(labels))
            for one, labels in zip(found, labellings, strict=True)
        ]


def _missing(found: list[Evaluation | None]) -> Ints:
    return np.array([n for n, evaluation in enumerate(found) if evaluation is None], dtype=np.int64)
