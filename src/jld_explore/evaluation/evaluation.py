"""One labelling, evaluated: the record that everything later is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from jld_core.limit import Status
from jld_explore.evaluation.certificates import Proofs

SOLVE: Final = "solve"


CERTIFICATE: Final = "certificate"


BOUND: Final = "bound"
"""Settled without the solve it was asked for, because its upper bound is below what matters."""


@dataclass(frozen=True)
class Evaluation:
    """What is known of one labelling; λ in scene units, NaN where not computed or infinite.

    status: of the objective. low, high: proven bounds. associative: λ with associative friction.
    zero_dilation: λ without dilation. settled: "solve", "certificate" or
    "bound": then only `high` is known, of a labelling that was not worth more. seconds: spent on it. proofs: what the
    solve proves about other labellings, where that was asked for. cases: of a structure with load cases λ of each,
    NaN where none; all else is then of the governing factor. governing: position of the case that governs, −1 of one
    load alone.
    """

    status: Status
    low: float
    high: float
    associative: float
    zero_dilation: float = math.nan
    settled: str = SOLVE
    seconds: float = 0.0
    proofs: Proofs | None = field(default=None, compare=False, repr=False)
    cases: tuple[float, ...] = ()
    governing: int = -1

    @property
    def load_factor(self) -> float:
        """λ of the objective: without dilation where that was computed, else associative; NaN for a bound alone."""
        if self.settled == BOUND:
            return math.nan
        return self.associative if math.isnan(self.zero_dilation) else self.zero_dilation


FAILED: Final = Evaluation(Status.FAILED, math.nan, math.nan, math.nan)
"""The evaluation of a labelling whose worker died or hung twice."""
