"""A raw answer → a proof: bounds, repairs, status, result."""

from __future__ import annotations

from jld_core.limit.analysis import LimitAnalysis, Proof
from jld_core.limit.batch import Batch, BatchAnswers
from jld_core.limit.block_relaxation import BlockRelaxation, Choice, applies_to
from jld_core.limit.bounds import Motion, Prover, State, apart, crossed, load_floor, relative_width
from jld_core.limit.mechanism import (
    Movement,
    displacement,
    element_velocities,
    face_jumps,
    face_motions,
    flow_rule,
    work_balance,
)
from jld_core.limit.relaxation import DualBound, Relaxation, has_hull
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, number
from jld_core.limit.status import Status

__all__ = [
    "Batch",
    "BatchAnswers",
    "BlockRelaxation",
    "Choice",
    "DualBound",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Motion",
    "Movement",
    "Proof",
    "Prover",
    "Relaxation",
    "Repair",
    "State",
    "Status",
    "apart",
    "applies_to",
    "crossed",
    "displacement",
    "element_velocities",
    "face_jumps",
    "face_motions",
    "flow_rule",
    "has_hull",
    "load_floor",
    "number",
    "relative_width",
    "work_balance",
]
