"""Equilibrium, scaling and yield sets of dry and inner faces.

- `FaceGeometry`: faces for which a yield criterion of a plug-in is asked
- `FaceRows`: yield set that it states as rows
- `FrictionSet`: interface of a yield set with friction, whose friction may be prescribed
- `Gauge`: limit on shear and torsion among them, in space
- `InnerBending`: form of the inner bending set, "uncoupled" (each moment by itself) or "kern" (edge stress)
- `Parameter`: parameter of a yield criterion
- `Scaling`: factors between scene values and scaled values
- `YieldSet`: interface of a yield set, as proofs use it
- `enclosing_rows`: rows of the closed hull of vertices and rays
- `equilibrium_matrix`: assemble A_eq
- `load_vectors`: return b and b_λ
- `maps_criteria`: tell whether a symmetry maps the yield criteria of plug-ins
- `prescribed_friction`: yield sets with friction from prescribed normal forces, and constant effective areas
- `reference_load`: compute the reference force of an assembly: weight, else a strength, else live load
- `require_materials`: refuse labellings whose material is missing
- `scaled_strengths`: convert strengths to forces, stress times area, and divide them by the force scale
- `scaling_of`: compute the scales of an assembly
- `stated_rows`: what criteria of plug-ins state of each face
- `used`: return the ratio demand / capacity (m,) of each face
- `yield_set`: make the yield sets of an assembly of either dimension
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.mechanics.compiled_rows import maps_criteria, stated_rows, yield_set
from jld_core.mechanics.criteria import FaceGeometry, FaceRows, Gauge
from jld_core.mechanics.equilibrium import Scaling, equilibrium_matrix, load_vectors, scaling_of
from jld_core.mechanics.polytopes import enclosing_rows
from jld_core.mechanics.standard import InnerBending
from jld_core.mechanics.yield_set import YieldSet, require_materials
from jld_core.strengths import Parameter

if TYPE_CHECKING:
    from jld_core.mechanics import prescribed_friction
    from jld_core.mechanics.equilibrium import reference_load
    from jld_core.mechanics.standard import scaled_strengths
    from jld_core.mechanics.yield_set import FrictionSet, used

__all__ = [
    "FaceGeometry",
    "FaceRows",
    "FrictionSet",
    "Gauge",
    "InnerBending",
    "Parameter",
    "Scaling",
    "YieldSet",
    "enclosing_rows",
    "equilibrium_matrix",
    "load_vectors",
    "maps_criteria",
    "prescribed_friction",
    "reference_load",
    "require_materials",
    "scaled_strengths",
    "scaling_of",
    "stated_rows",
    "used",
    "yield_set",
]

export_lazily(
    __name__,
    {
        "yield_set": ["FrictionSet", "used"],
        "equilibrium": ["reference_load"],
        "standard": ["scaled_strengths"],
    },
    submodules=["prescribed_friction"],
)
