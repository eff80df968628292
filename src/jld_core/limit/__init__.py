"""Limit analysis of labelled assemblies: proven bounds on λ, results and relaxations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.limit.bounds import Motion, Proof, Prover, State, load_scale, relative_width
from jld_core.limit.mechanism import displacement
from jld_core.limit.options import FIELD_SECONDS, CaseBounds, governing
from jld_core.limit.result import number, result_of

if TYPE_CHECKING:
    from jld_core.limit import case_relaxation, mechanism
    from jld_core.limit.batch import SampleAnalysis
    from jld_core.limit.bounds import crossed
    from jld_core.limit.mechanism import face_jumps, movements
    from jld_core.limit.result import effects, without_idle

__all__ = [
    "FIELD_SECONDS",
    "CaseBounds",
    "Motion",
    "Proof",
    "Prover",
    "SampleAnalysis",
    "State",
    "case_relaxation",
    "crossed",
    "displacement",
    "effects",
    "face_jumps",
    "governing",
    "load_scale",
    "mechanism",
    "movements",
    "number",
    "relative_width",
    "result_of",
    "without_idle",
]

export_lazily(
    __name__,
    {
        "batch": ["SampleAnalysis"],
        "bounds": ["crossed"],
        "mechanism": ["face_jumps", "movements"],
        "result": ["effects", "without_idle"],
    },
    submodules=["case_relaxation"],
)
