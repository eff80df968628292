"""Solve one labelling of an assembly under the modelling options of the user."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.models import by_fields, effective_area
    from jld_core.models.by_fields import solve_by_fields
    from jld_core.models.case_analysis import CaseAnalysis, require_cracks, rigid, solve_by_elements, solve_rigid
    from jld_core.models.central_path import areas_under, under_own_areas
    from jld_core.models.costs import cost_estimate
    from jld_core.models.rigid_blocks import limit_analysis, solve_labelling
    from jld_core.models.sensitivity import GeometrySensitivities, SolvedProgram, sensitivities

__all__ = [
    "CaseAnalysis",
    "GeometrySensitivities",
    "SolvedProgram",
    "areas_under",
    "by_fields",
    "cost_estimate",
    "effective_area",
    "limit_analysis",
    "require_cracks",
    "rigid",
    "sensitivities",
    "solve_by_elements",
    "solve_by_fields",
    "solve_labelling",
    "solve_rigid",
    "under_own_areas",
]

export_lazily(
    __name__,
    {
        "by_fields": ["solve_by_fields"],
        "costs": ["cost_estimate"],
        "case_analysis": ["require_cracks", "rigid", "CaseAnalysis", "solve_by_elements", "solve_rigid"],
        "rigid_blocks": ["limit_analysis", "solve_labelling"],
        "sensitivity": ["GeometrySensitivities", "SolvedProgram", "sensitivities"],
        "central_path": ["areas_under", "under_own_areas"],
    },
    submodules=["by_fields", "effective_area"],
)
