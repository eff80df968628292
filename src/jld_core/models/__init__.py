"""Solve one labelling of an assembly under the modelling options of the user.

- `SolveOptions`: modelling options, the same as on the command line
- `cost_estimate`: estimate time and memory to evaluate one labelling
- `limit_analysis`: build the analysis that `solve_labelling` needs, for one labelling or many
- `require_memory`: raise InputError if one labelling needs more memory than there is
- `require_model`: raise InputError if the options do not support an assembly
- `sensitivities`: compute the rates of λ with strengths and weight
- `solve`: compute λ of one labelling, with a two-sided bracket
- `solve_by_fields`: bound λ of one labelling whose blocks may crack anywhere
- `solve_labelling`: prove the load factor of one labelling under given options
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.limit import SolveOptions
    from jld_core.models.by_fields import solve_by_fields
    from jld_core.models.costs import cost_estimate, require_memory
    from jld_core.models.labelling import limit_analysis, require_model, solve_labelling
    from jld_core.models.sensitivity import sensitivities
    from jld_core.models.solve import solve

__all__ = [
    "SolveOptions",
    "cost_estimate",
    "limit_analysis",
    "require_memory",
    "require_model",
    "sensitivities",
    "solve",
    "solve_by_fields",
    "solve_labelling",
]

export_lazily(
    __name__,
    {
        "by_fields": ["solve_by_fields"],
        "costs": ["cost_estimate", "require_memory"],
        "labelling": ["SolveOptions", "limit_analysis", "require_model", "solve_labelling"],
        "sensitivity": ["sensitivities"],
        "solve": ["solve"],
    },
)
