"""Define the interface of all evaluators: labellings in, evaluations out.

Methods are documented here. Classes that implement them document differences alone.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Protocol, Self, runtime_checkable

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.limit import BatchAnalysis, LimitAnalysis, Proof, SolveOptions, Status
from jld_core.models import limit_analysis, solve_labelling
from jld_core.models.solve_many import BatchResult

SOLVE: Final = "solve"
"""Value of `Evaluation.settled`: settled by a limit analysis of the labelling itself."""


BOUND: Final = "bound"
"""Value of `Evaluation.settled`: the requested solve was omitted because the upper bound is too low to matter."""


@dataclass(frozen=True)
class Evaluation:
    """Result of evaluating one labelling; λ in scene units, NaN if not computed or infinite.

    With load cases all values except `cases` refer to the governing factor.

    Attributes
    ----------
    status : Status
        Status of the objective.
    low, high : float
        Proven bounds on λ of the objective.
    associative : float
        λ with associative friction.
    zero_dilation : float
        λ without dilation.
    settled : str
        `SOLVE` or `BOUND`. With `BOUND` the labelling was pruned and only `high` is known.
    seconds : float
        Time spent on the labelling, s.
    cases : tuple of float
        λ of each load case, NaN where there is none; empty without load cases.
        With nominal material values the last entry is λ at those values.
    governing : int
        Position of the governing load case, −1 for a single load.
    """

    status: Status
    low: float
    high: float
    associative: float
    zero_dilation: float = math.nan
    settled: str = SOLVE
    seconds: float = 0.0
    cases: tuple[float, ...] = ()
    governing: int = -1

    @property
    def load_factor(self) -> float:
        """Return λ of the objective: without dilation if computed, else associative.

        It is NaN for a labelling settled by a bound.
        """
        if self.settled == BOUND:
            return math.nan
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)
"""Evaluation of a labelling whose worker died or hung twice."""


def evaluations_of(found: Sequence[Evaluation] | BatchResult) -> Sequence[Evaluation]:
    """Return the evaluations of a result of `jld_core.solve_many`, and evaluations as they are."""
    if not isinstance(found, BatchResult):
        if not isinstance(found, Sequence) or not all(isinstance(one, Evaluation) for one in found):
            raise ParameterError("evaluations", "they are wrong", "a list of them, or what solve_many returned")
        return found
    names = list(found.cases)
    cases = [tuple(one.load_factor[k] for one in found.cases.values()) for k in range(len(found))]
    dilatant = found.model.friction == "associative"
    value = found.load_factor.tolist()
    return [
        Evaluation(
            status,
            found.low[k],
            found.high[k],
            value[k] if dilatant else math.nan,
            math.nan if dilatant else value[k],
            cases=cases[k],
            governing=names.index(found.governing[k]) if names else -1,
        )
        for k, status in enumerate(found.status)
    ]


@dataclass(frozen=True)
class EvaluatorSettings:
    """Settings of an evaluator.

    Attributes
    ----------
    model : SolveOptions
        Friction model, tolerances and other options of the limit analysis.
    use_batch_solver : bool
        True if there are enough labellings to make the batch solver, which costs about ten solves.
    """

    model: SolveOptions = field(default_factory=SolveOptions)
    use_batch_solver: bool = True

    @property
    def batched(self) -> bool:
        """Return True if the batch solver can be used.

        It needs a model for which bounds over labellings exist, and `use_batch_solver`.
        """
        return self.use_batch_solver and self.model.supports_bounds_over_labellings


class LabellingEvaluator(Protocol):
    """Evaluator of the labellings of one assembly.

    An evaluation depends only on its labelling and the threshold, never on other labellings or the order of calls.
    Use an evaluator in one thread at a time.
    """

    @abstractmethod
    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings until the deadline passes.

        labellings: (k, m) True = dry. pruning_thresholds: (k,) a λ per labelling, scene units, as in `evaluate`.
        Default: evaluate every labelling to the end. Result: evaluations of the first labellings, all k unless the
        deadline passes.
        """

    @abstractmethod
    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling.

        labels: (m,) True = dry. Result: result in scene units.
        """


@runtime_checkable
class SharedEvaluator(LabellingEvaluator, Protocol):
    """Evaluator that can share its batch solver with evaluators of other threads."""

    @property
    @abstractmethod
    def settles_nearly_all(self) -> bool:
        """Return True if the batch solver settles nearly all labellings.

        One process is then enough.
        """

    @abstractmethod
    def twin(self) -> Self:
        """Return an evaluator with the same results for another thread, sharing the batch solver."""


MakeEvaluator = Callable[[Assembly, EvaluatorSettings], LabellingEvaluator]
"""Type of a function that makes the evaluator of a worker; defined at module level so that it can be pickled."""


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
        """Return an equal evaluator for another thread."""
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
        """Evaluate labellings, in batches where the batch solver applies."""
        # See `LabellingEvaluator.evaluate_all`.
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
        """Evaluate one labelling.

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
        """Convert a proof of a lower bound on λ over all solutions without dilation."""
        # `low` is the proven bound and `high` the lowest λ found.
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
