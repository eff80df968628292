"""Evaluate labellings in worker processes and record the results on disk."""

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

__all__ = ["Evaluator", "EvaluatorSettings", "Pool", "Records", "evaluator_of", "field_evaluator", "raise_deferred"]

export_lazily(__name__, {"protocol": ["Evaluator"]}, submodules=["field_evaluator"])
