"""Define the interface of all evaluators: labellings in, evaluations out."""

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

SOLVE: Final = "solve"  # settled by a limit analysis of the labelling itself


BOUND: Final = "bound"  # the solve was omitted because the upper bound is too low to matter


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
    associative, zero_dilation : float
        λ with associative friction, and without dilation.
    settled : str
        `SOLVE`, or `BOUND` for a pruned labelling, of which only `high` is known.
    seconds : float
        Time spent on the labelling, s.
    cases : tuple of float
        λ of each load case, then at nominal material values; NaN where there is none.
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
        """λ of the objective: without dilation if computed, else associative; NaN if pruned."""
        if self.settled == BOUND:
            return math.nan
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


# evaluation of a labelling whose worker died or hung twice
FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)


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
        Friction model, tolerances and other options.
    use_batch_solver : bool
        Whether there are enough labellings to make the batch solver, which costs about ten solves.
    """

    model: SolveOptions = field(default_factory=SolveOptions)
    use_batch_solver: bool = True

    @property
    def batched(self) -> bool:
        """True if the batch solver is wanted, and the model has bounds over labellings."""
        return self.use_batch_solver and self.model.supports_bounds_over_labellings


class LabellingEvaluator(Protocol):
    """Evaluator of one assembly's labellings, each by its own alone, for one thread at a time."""

    @abstractmethod
    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
        """Evaluate labellings (k, m), the first ones where the deadline passes.

        pruning_thresholds: (k,) λ, scene units, at or below which a labelling need not be solved to the end.
        """

    @abstractmethod
    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling (m,)."""


@runtime_checkable
class SharedEvaluator(LabellingEvaluator, Protocol):
    """Evaluator that can share its batch solver with evaluators of other threads."""

    @property
    @abstractmethod
    def settles_nearly_all(self) -> bool:
        """True if the batch solver settles nearly all labellings, so that one process is enough."""

    @abstractmethod
    def twin(self) -> Self:
        """Return an evaluator with the same results for another thread, sharing the batch solver."""


# makes the evaluator of a worker; defined at module level so that it can be pickled
MakeEvaluator = Callable[[Assembly, EvaluatorSettings], LabellingEvaluator]


class Evaluator(SharedEvaluator):
    """Evaluator of labellings of one assembly under one load.

    The batch solver may be shared by several threads.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    settings : EvaluatorSettings
        Model and settings.
    share_batch_solver_with : Evaluator, optional
        Evaluator of the same assembly and settings whose batch solver is shared.
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
        """Limit analysis for one labelling at a time, made on first use."""
        return limit_analysis(self.assembly, self.settings.model)

    def twin(self) -> Evaluator:
        return Evaluator(self.assembly, self.settings, self)

    @property
    def settles_nearly_all(self) -> bool:
        return self._batch is not None and self._batch.settles_most

    def evaluate_all(
        self,
        labellings: Bits,
        pruning_thresholds: Floats | None = None,
        deadline: Deadline | None = None,
    ) -> list[Evaluation]:
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
        """Evaluate one labelling; None if the deadline passes before λ without dilation is known."""
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
