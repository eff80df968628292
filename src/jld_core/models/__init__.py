"""Solve one labelling of an assembly under the modelling options of the user.

- `FALLBACKS_BY_FRICTION`: the fallbacks tried in order, by the value of `SolveOptions.condense`
- `FIELD_SECONDS`: default time for the bounds by fields of one load case
- `BatchResult`: load factors of many labellings, with proven bounds
- `CostEstimate`: expected time and memory to evaluate one labelling
- `FieldResult`: λ of one labelling by stress and velocity fields
- `ProximalOptions`: parameters of the fixed-point search for a non-dilatant solution
- `Sensitivity`: rate of change of λ with one parameter
- `SolveOptions`: modelling options, the same as on the command line
- `areas_under`: compute the effective areas under given forces
- `assembly_of`: return the assembly of a scene file, of a scene, or an assembly itself
- `change`: compute the largest change of effective areas between two iterates
- `cost_estimate`: estimate time and memory to evaluate one labelling
- `frozen_areas`: build a program template whose effective areas are fixed
- `labellings_of`: return several labellings as a checked bool array
- `labels_of`: return one labelling as a checked bool array
- `limit_analysis`: build the analysis that `solve_labelling` needs, for one labelling or many
- `point_contact_assembly`: build the assembly of concave contact, with point contacts at corners
- `prove_condensed`: prove the load factor with rigid blocks, taken apart where needed
- `require_cracks`: raise InputError if a scene cannot be analysed with its crack model
- `require_memory`: raise InputError if one labelling needs more memory than there is
- `require_model`: raise InputError if the options do not support an assembly
- `rigid_blocks`: join elements through inner faces into rigid blocks
- `sensitivities`: compute the rates of λ with strengths and weight
- `solve`: compute λ of one labelling, with a two-sided bracket
- `solve_by_fields`: bound λ of one labelling whose blocks may crack anywhere
- `solve_labelling`: prove the load factor of one labelling under given options
- `solve_many`: compute λ of many labellings by the batch solver
- `worth_condensing`: return True if inner faces are strong enough that rigid blocks save time
"""

from __future__ import annotations

from jld_core.limit import SolveOptions
from jld_core.models.by_fields import FIELD_SECONDS, FieldResult, require_cracks, solve_by_fields
from jld_core.models.costs import CostEstimate, cost_estimate, require_memory
from jld_core.models.effective_area import change
from jld_core.models.inputs import assembly_of, labellings_of, labels_of
from jld_core.models.many import BatchResult, solve_many
from jld_core.models.moving_rows import areas_under, frozen_areas
from jld_core.models.point_contacts import point_contact_assembly
from jld_core.models.rigid_blocks import prove_condensed, rigid_blocks, worth_condensing
from jld_core.models.sensitivity import Sensitivity, sensitivities
from jld_core.models.solve import FALLBACKS_BY_FRICTION, limit_analysis, require_model, solve, solve_labelling
from jld_core.models.zero_dilation.search import ProximalOptions

__all__ = [
    "FALLBACKS_BY_FRICTION",
    "FIELD_SECONDS",
    "BatchResult",
    "CostEstimate",
    "FieldResult",
    "ProximalOptions",
    "Sensitivity",
    "SolveOptions",
    "areas_under",
    "assembly_of",
    "change",
    "cost_estimate",
    "frozen_areas",
    "labellings_of",
    "labels_of",
    "limit_analysis",
    "point_contact_assembly",
    "prove_condensed",
    "require_cracks",
    "require_memory",
    "require_model",
    "rigid_blocks",
    "sensitivities",
    "solve",
    "solve_by_fields",
    "solve_labelling",
    "solve_many",
    "worth_condensing",
]
