"""What is modelled, and the one policy how.

- `FALLBACKS_BY_FRICTION`: what is tried, in order, by `SolveOptions.condense`
- `CostEstimate`: what one labelling takes
- `ProximalOptions`: how a solution without dilation is sought
- `Sensitivity`: the rate of λ by one number
- `SolveOptions`: what is modelled, as on the command line
- `areas_under`: effective areas under given forces
- `change`: how far effective areas moved between two iterates
- `cost_estimate`: what one labelling is expected to take
- `frozen_areas`: a template with effective areas frozen
- `limit_analysis`: the analysis behind `solve_labelling`, for many labellings
- `point_contact_assembly`: the assembly of concave contact
- `prove_condensed`: proof by rigid blocks, cracked on demand
- `require_memory`: refuses what there is not the memory for
- `require_model`: refuses options that do not go with an assembly
- `rigid_blocks`: elements joined through inner faces
- `sensitivities`: how λ changes with strengths and weight
- `solve`: λ of one labelling, with a two-sided bracket
- `solve_labelling`: proof of one labelling under the options asked for
- `worth_condensing`: whether blocks are better taken as rigid
"""

from __future__ import annotations

from jld_core.limit import SolveOptions
from jld_core.models.cost_estimate import CostEstimate, cost_estimate, require_memory
from jld_core.models.effective_area import areas_under, change, frozen_areas
from jld_core.models.point_contacts import point_contact_assembly
from jld_core.models.rigid_blocks import prove_condensed, rigid_blocks, worth_condensing
from jld_core.models.sensitivity import Sensitivity, sensitivities
from jld_core.models.solve import FALLBACKS_BY_FRICTION, limit_analysis, require_model, solve, solve_labelling
from jld_core.models.zero_dilation.search import ProximalOptions

__all__ = [
    "FALLBACKS_BY_FRICTION",
    "CostEstimate",
    "ProximalOptions",
    "Sensitivity",
    "SolveOptions",
    "areas_under",
    "change",
    "cost_estimate",
    "frozen_areas",
    "limit_analysis",
    "point_contact_assembly",
    "prove_condensed",
    "require_memory",
    "require_model",
    "rigid_blocks",
    "sensitivities",
    "solve",
    "solve_labelling",
    "worth_condensing",
]
