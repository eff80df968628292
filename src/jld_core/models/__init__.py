"""Solve one labelling of an assembly under the modelling options of the user.

- `Model`: how a structure is modelled and solved, as on the command line
- `SolveOptions`: name of `Model` before version 0.4
- `cost_estimate`: estimate time and memory to evaluate one labelling
- `geometry_sensitivities`: compute the derivatives of λ by the positions of vertices
- `limit_analysis`: build the analysis that `solve_labelling` needs, for one labelling or many
- `require_memory`: raise InputError if one labelling needs more memory than there is
- `require_model`: raise InputError if the options do not support an assembly
- `rigid`: return the rigid elements under a crack model
- `sensitivities`: compute the rates of λ with strengths and weight
- `solve`: compute λ of one labelling, with a two-sided bracket
- `solve_by_elements`: compute λ of one labelling whose blocks crack by faces or by cells
- `solve_by_fields`: bound λ of one labelling whose blocks may crack anywhere
- `solve_cracked`: compute λ of one labelling under the crack model of an assembly
- `solve_labelling`: prove the load factor of one labelling under given options
- `solve_rigid`: compute λ of one labelling of rigid elements as they are
- `under`: return an assembly with the crack model that a model names
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.limit import Model, SolveOptions
    from jld_core.models.by_fields import solve_by_fields
    from jld_core.models.case_analysis import solve, solve_by_elements, solve_cracked, solve_rigid
    from jld_core.models.costs import cost_estimate, require_memory
    from jld_core.models.crack_models import rigid, under
    from jld_core.models.rigid_blocks import limit_analysis, require_model, solve_labelling
    from jld_core.models.sensitivity import geometry_sensitivities, sensitivities

__all__ = [
    "Model",
    "SolveOptions",
    "cost_estimate",
    "geometry_sensitivities",
    "limit_analysis",
    "require_memory",
    "require_model",
    "rigid",
    "sensitivities",
    "solve",
    "solve_by_elements",
    "solve_by_fields",
    "solve_cracked",
    "solve_labelling",
    "solve_rigid",
    "under",
]

export_lazily(
    __name__,
    {
        "by_fields": ["solve_by_fields"],
        "costs": ["cost_estimate", "require_memory"],
        "crack_models": ["rigid", "under"],
        "rigid_blocks": ["Model", "SolveOptions", "limit_analysis", "require_model", "solve_labelling"],
        "sensitivity": ["geometry_sensitivities", "sensitivities"],
        "case_analysis": ["solve", "solve_by_elements", "solve_cracked", "solve_rigid"],
    },
)
