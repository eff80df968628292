"""Evaluate labellings by limit analyses that share one template."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from functools import cached_property

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit import BatchAnalysis, LimitAnalysis, Proof, Status
from jld_core.models import limit_analysis, solve_labelling
from jld_explore.evaluation.evaluation import BOUND, SOLVE, Evaluation
from jld_explore.evaluation.protocol import EvaluatorSettings, SharedEvaluator


class Evaluator(SharedEvaluator):
    """Evaluator of labellings of one assembly under one load.

    The batch solver may be shared by several threads.

    assembly: structure whose labellings are evaluated. settings: model and settings. share_batch_solver_with: evaluator
    of the same assembly and settings whose batch solver is shared.
    """

    def __init__(
        self, assembly: Assembly, settings: EvaluatorSettings, share_batch_solver_with: Evaluator | None = None
    ) -> None:
        self.assembly, self.settings = assembly, settings
        self._shortest = self._batch_share = 0.0
        self._batch: BatchAnalysis | None
        if share_batch_solver_with is not None:
            self._batch = share_batch_solver_with._batch
        else:
            self._batch = BatchAnalysis.of(self._analysis) if settings.batched else None

    @cached_property
    def _analysis(self) -> LimitAnalysis:
        """Return the limit analysis for one labelling at a time, made on first use."""
        return limit_analysis(self.assembly, self.settings.model)

    def twin(self) -> Evaluator:
        """Return an equal evaluator for another thread; see `SharedEvaluator.twin`."""
        return Evaluator(self.assembly, self.settings, self)

    @property
    def settles_nearly_all(self) -> bool:
        """Return True if the batch solver settles nearly all labellings.

        See `SharedEvaluator`.
        """
        return self._batch is not None and self._batch.settles_most

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings, in batches where the batch solver applies.

        See `LabellingEvaluator.evaluate_all`.
        """
        if deadline is not None and deadline.passed():
            return []
        if deadline is not None and self._batch_share > 0.0:
            # no more than there is time for, at least one
            labellings = labellings[: max(1, int(min(deadline.remaining() / self._batch_share, len(labellings))))]
            pruning_thresholds = None if pruning_thresholds is None else pruning_thresholds[: len(labellings)]
        known = self._by_batch_solver(labellings)
        values = [-math.inf] * len(labellings) if pruning_thresholds is None else pruning_thresholds.tolist()
        found: list[Evaluation] = []
        for labels, pruning_threshold, evaluation in zip(labellings, values, known, strict=True):
            if evaluation is None:
                # one that takes a second would surely end late
                if deadline is not None and deadline.remaining() <= self._shortest:
                    break
                evaluation = self._before_deadline(labels, pruning_threshold, deadline)
            if evaluation is None:
                break
            found.append(evaluation)
        return found

    def _before_deadline(self, labels: Bits, pruning_threshold: float, deadline: Deadline | None) -> Evaluation | None:
        """Evaluate one labelling; return None if the deadline passes meanwhile.

        With associative friction, and without a deadline, the evaluation is always finished.
        """
        if deadline is None or self.settings.model.friction == "associative":
            return self.evaluate(labels, pruning_threshold)
        with suppress(DeadlinePassed), deadline.enforced():
            found = self.evaluate(labels, pruning_threshold)
            return None if deadline.passed() else found
        return None

    def _by_batch_solver(self, labellings: Bits) -> list[Evaluation | None]:
        """Evaluate labellings with the batch solver; return None for each one it cannot settle."""
        if self._batch is None:
            return [None] * len(labellings)
        start = time.perf_counter()
        batch_results = self._batch.prove(labellings)
        scale = self._batch.load
        low, high = (scale * batch_results.low).tolist(), (scale * batch_results.high).tolist()
        each = self._batch_share = (time.perf_counter() - start) / max(len(labellings), 1)
        found: list[Evaluation | None] = []
        for k, (least, most) in enumerate(zip(low, high, strict=True)):
            status = batch_results.status(k)
            found.append(
                None if status is None else Evaluation(status, least, most, 0.5 * (least + most), seconds=each)
            )
        return found

    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling; see `LabellingEvaluator.evaluate`.

        A labelling with associative λ at or below the pruning threshold is not solved without dilation.
        """
        start = time.perf_counter()
        proof = solve_labelling(self._analysis, labels, self.settings.model, pruning_threshold=pruning_threshold)
        found = self._evaluation(proof, start)
        self._shortest = min(self._shortest or found.seconds, found.seconds)
        return found

    def _evaluation(self, proof: Proof, start: float) -> Evaluation:
        """Convert the proof of a limit analysis, begun at `start`, to an evaluation (scene units)."""
        scale = self._analysis.template.scaling.load
        (low, high), load = proof.bracket, proof.load_factor
        if self.settings.model.ranks_by_lower_bound and not proof.outbid and proof.status is Status.COLLAPSE:
            return self._floor_evaluation(proof, scale, start)
        dilates = self.settings.model.friction == "associative"
        return Evaluation(
            status=proof.status,
            low=low * scale,
            high=high * scale,
            associative=(load if dilates else proof.associative) * scale,
            zero_dilation=math.nan if dilates or proof.outbid else load * scale,
            settled=BOUND if proof.outbid else SOLVE,
            seconds=time.perf_counter() - start,
        )

    def _floor_evaluation(self, proof: Proof, scale: float, start: float) -> Evaluation:
        """Convert a proof of a lower bound on λ over all solutions without dilation.

        `low` is the proven bound and `high` the lowest λ found.
        """
        bound, found = proof.extra["lowest_proven"], proof.extra["lowest_found"]
        return Evaluation(
            status=Status.UNCERTIFIED if bound is None else Status.COLLAPSE,
            low=math.nan if bound is None else bound,
            high=math.nan if found is None else float(found),  # None if nothing was found in time
            associative=proof.associative * scale,
            zero_dilation=math.nan if bound is None else bound,
            settled=BOUND if bound is None else SOLVE,
            seconds=time.perf_counter() - start,
        )
