"""Define the result of evaluating one labelling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jld_core.limit import Status
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
