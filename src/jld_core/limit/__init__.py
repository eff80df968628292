"""A raw answer → a proof: bounds, repairs, status, result."""

from __future__ import annotations

from jld_core.limit.analysis import LADDER, Climb, LimitAnalysis, Rung
from jld_core.limit.batch import Batch, BatchAnswers
from jld_core.limit.block_relaxation import BlockRelaxation, Choice, applies_to
from jld_core.limit.bounds import Motion, Prover, State, apart, crossed, load_floor, relative_width
from jld_core.limit.case_relaxation import CaseRelaxation
from jld_core.limit.governing import Governing, Known, governing
from jld_core.limit.mechanism import (
    Movement,
    displacement,
    face_jumps,
    face_motions,
    flow_rule,
    work_balance,
)
from jld_core.limit.options import Condense, Contacts, Friction, SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.relaxation import DualBound, Relaxation, has_hull
from jld_core.limit.repair import Repair
from jld_core.limit.result import LimitAnalysisResult, element_velocities, governing_result, number, result_of
from jld_core.limit.status import Status

__all__ = [
    "LADDER",
    "Batch",
    "BatchAnswers",
    "BlockRelaxation",
    "CaseRelaxation",
    "Choice",
    "Climb",
    "Condense",
    "Contacts",
    "DualBound",
    "Friction",
    "Governing",
    "Known",
    "LimitAnalysis",
    "LimitAnalysisResult",
    "Motion",
    "Movement",
    "Proof",
    "Prover",
    "Relaxation",
    "Repair",
    "Rung",
    "SolveOptions",
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
    "governing",
    "governing_result",
    "has_hull",
    "load_floor",
    "number",
    "relative_width",
    "result_of",
    "work_balance",
]
