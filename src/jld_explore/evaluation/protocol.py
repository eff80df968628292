"""Define the interface of all evaluators: labellings in, evaluations out.

Methods are documented here. Classes that implement them document differences alone.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, Self, runtime_checkable

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.limit import SolveOptions
from jld_explore.evaluation.evaluation import Evaluation


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
        Default: evaluate every labelling to the end. deadline: time after which no further labelling is begun. Result:
        evaluations of the first labellings, all k unless the deadline passes.
        """

    @abstractmethod
    def evaluate(self, labels: Bits, pruning_threshold: float = -math.inf) -> Evaluation:
        """Evaluate one labelling.

        labels: (m,) True = dry. pruning_threshold: λ, scene units. Where a cheap upper bound does not exceed it, the
        expensive part of the evaluation is omitted. Evaluators without a cheap bound ignore it. Result: result in scene
        units.
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
