"""Evaluate labellings in worker processes and record the results on disk.

- `Evaluator`: evaluator of labellings of one assembly under one load
- `EvaluatorSettings`: settings of an evaluator
- `Pool`: threads, processes or workers of a cluster for tasks
- `Records`: evaluations, proofs and conflicts on disk
- `evaluator_of`: make the evaluator of an assembly
- `field_evaluator`: evaluate labellings whose blocks crack along finer cells, or anywhere by fields
- `raise_deferred`: raise an error, or defer it to the end of a protected section
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.pool import Pool, raise_deferred
from jld_explore.evaluation.protocol import EvaluatorSettings
from jld_explore.evaluation.records import Records

if TYPE_CHECKING:
    from jld_explore.evaluation import field_evaluator
    from jld_explore.evaluation.protocol import Evaluator

__all__ = [
    "Evaluator",
    "EvaluatorSettings",
    "Pool",
    "Records",
    "evaluator_of",
    "field_evaluator",
    "raise_deferred",
]

export_lazily(
    __name__,
    {
        "protocol": ["Evaluator"],
    },
    submodules=["field_evaluator"],
)
