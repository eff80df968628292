"""Solve one labelling of an assembly under the modelling options of the user.

- `CaseAnalysis`: limit analyses of one structure, one for each load case, or one for its single load
- `GeometrySensitivities`: derivatives of λ by the positions of the v vertices of a structure
- `SolvedProgram`: solved program of one labelling, from which rates of λ with parameters are computed
- `areas_under`: compute the torsion factors of the effective areas of faces under given forces
- `by_fields`: λ of one labelling whose blocks crack anywhere: bounds by fields under every load case, as one result
- `cost_estimate`: estimate time and memory to evaluate one labelling
- `effective_area`: resist torsion on the effective area of dry rectangles
- `limit_analysis`: build the analysis that `solve_labelling` needs, for one labelling or many
- `require_cracks`: raise InputError if an assembly cannot be analysed with its crack model
- `rigid`: return the rigid elements under a crack model
- `sensitivities`: compute the rates of λ with strengths and weight
- `solve_by_elements`: compute λ of one labelling whose blocks crack by faces or by cells
- `solve_by_fields`: bound λ of one labelling whose blocks may crack anywhere
- `solve_labelling`: prove the load factor of one labelling under given options
- `solve_rigid`: compute λ of one labelling of rigid elements as they are
- `under_own_areas`: evaluate a state under the effective areas of its own forces
"""

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
