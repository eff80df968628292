"""Evaluate each labelling once: reuse recorded evaluations, compute and record the others."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.deadline import Deadline
from jld_explore.evaluation.deferred_signals import deferred_signals
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.pruning import IncumbentFront
from jld_explore.evaluation.records import Records
from jld_explore.evaluation.workers import Run, Workers
from jld_explore.space.labelling import orbit_sizes


@dataclass(frozen=True)
class PendingEvaluations:
    """Labellings under evaluation.

    labellings: (k, m) True = dry. found: evaluations known so far, one entry per labelling. missing: (j,) positions of
    the labellings sent to the workers. run: run of the workers; None if no labelling was sent. required: True if the
    first labelling sent is evaluated whatever the deadline.
    """

    labellings: Bits
    found: list[Evaluation | None]
    missing: Ints
    run: Run | None
    required: bool = False


class RecordedEvaluator:
    """Evaluator that runs workers and records every evaluation.

    Call `submit`, then `collect`; several submissions may be under way.

    workers: workers that solve labellings not on record. records: record on disk. group: (g, m) symmetries as face
    permutations, which determine the multiplicity of a labelling. deadline: time after which no further labelling is
    begun. front: source of pruning thresholds; without it every labelling is solved to the end. finish_first: record
    the first evaluation of a search before an error of a signal is raised (see `deferred_signals`). report: function
    called with each list of evaluations as it becomes known, and their labellings (k, m). solved: number of labellings
    that the workers evaluated.
    """

    def __init__(
        self,
        workers: Workers,
        records: Records,
        group: Ints,
        *,
        deadline: Deadline | None = None,
        front: IncumbentFront | None = None,
        finish_first: bool = False,
        report: Callable[[list[Evaluation], Bits], None] = lambda found, labellings: None,
    ) -> None:
        self.records, self.solved = records, 0
        self._without_result = not len(records)
        self._workers, self._group, self._deadline = workers, group, deadline
        self._front, self._report, self._finish_first = front, report, finish_first

    def submit(self, labellings: Bits) -> PendingEvaluations:
        """Begin to evaluate the labellings not on record.

        labellings: (k, m) True = dry. Result: labellings under evaluation, for `collect`.
        """
        found = self.records.find_all(labellings)
        missing = _missing(found)
        run, first_required = None, False
        if missing.size:
            thresholds = None if self._front is None else self._front.thresholds(labellings[missing])
            # A search with an empty record evaluates its first labelling in any case, so that it has a result.
            first_required, self._without_result = self._without_result, False
            run = self._workers.run(labellings[missing], self._deadline, thresholds, first_required=first_required)
        return PendingEvaluations(labellings, found, missing, run, first_required)

    def collect(self, pending: PendingEvaluations) -> list[Evaluation] | None:
        """Wait for submitted labellings, record their evaluations, and return all k in order.

        The result is None if time ran out before all were evaluated; finished evaluations are recorded also then.
        """
        found, labellings, missing = pending.found, pending.labellings, pending.missing
        known = np.array([evaluation is not None for evaluation in found], dtype=bool)
        self._report([evaluation for evaluation in found if evaluation is not None], labellings[known])
        if pending.run is not None:
            weights = orbit_sizes(labellings[missing], self._group)
            with ExitStack() as until_first:
                if pending.required and self._finish_first:
                    until_first.enter_context(deferred_signals())
                for part, evaluations in pending.run:
                    self.records.append(labellings[missing[part]], weights[part].tolist(), evaluations)
                    self.solved += len(evaluations)
                    for position, evaluation in zip(missing[part].tolist(), evaluations, strict=True):
                        found[position] = evaluation
                    self._report(evaluations, labellings[missing[part]])
                    until_first.close()
                    if self._deadline is not None and self._deadline.passed():
                        break
        complete = [evaluation for evaluation in found if evaluation is not None]
        return complete if len(complete) == len(found) else None


def _missing(found: list[Evaluation | None]) -> Ints:
    """Return the positions of the entries that are None."""
    return np.array([n for n, evaluation in enumerate(found) if evaluation is None], dtype=np.int64)
