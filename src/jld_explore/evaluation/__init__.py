"""Evaluate labellings in worker processes and record the results on disk.

- `Evaluation`: result of evaluating one labelling
- `EvaluatorSettings`: settings of an evaluator
- `MakeEvaluator`: function that makes the evaluator of a worker
- `Pool`: threads, processes or workers of a cluster for tasks
- `Records`: evaluations, proofs and conflicts on disk
- `evaluator_of`: make the evaluator of an assembly
- `raise_deferred`: raise an error, or defer it to the end of a protected section
"""

from __future__ import annotations

from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.pool import Pool, raise_deferred
from jld_explore.evaluation.protocol import Evaluation, EvaluatorSettings, MakeEvaluator
from jld_explore.evaluation.records import Records

__all__ = [
    "Evaluation",
    "EvaluatorSettings",
    "MakeEvaluator",
    "Pool",
    "Records",
    "evaluator_of",
    "raise_deferred",
]
