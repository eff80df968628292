"""Equilibrium, scaling and yield sets of dry and inner faces.

- `FaceGeometry`: faces for which a yield criterion of a plug-in is asked
- `FaceRows`: yield set that it states as rows
- `FrictionSet`: interface of a yield set with friction, whose friction may be prescribed
- `Gauge`: limit on shear and torsion among them, in space
- `Parameter`: parameter of a yield criterion
- `Scaling`: factors between scene values and scaled values
- `YieldSet`: interface of a yield set, as proofs use it
- `enclosing_rows`: rows of the closed hull of vertices and rays
- `equilibrium_matrix`: assemble A_eq
- `load_vectors`: return b and b_λ
- `prescribed_friction`: yield sets with friction from prescribed normal forces, and constant effective areas
- `reference_load`: compute the reference force of an assembly: weight, else a strength, else live load
- `require_materials`: refuse labellings whose material is missing
- `scaling_of`: compute the scales of an assembly
- `used`: return the ratio demand / capacity (m,) of each face
- `yield_set`: make the yield sets of an assembly of either dimension
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.mechanics.compiled_rows import yield_set
from jld_core.mechanics.criteria import FaceGeometry, FaceRows, Gauge
from jld_core.mechanics.equilibrium import Scaling, equilibrium_matrix, load_vectors, scaling_of
from jld_core.mechanics.polytopes import enclosing_rows
from jld_core.mechanics.yield_set import YieldSet, require_materials
from jld_core.strengths import Parameter

if TYPE_CHECKING:
    from jld_core.mechanics import prescribed_friction
    from jld_core.mechanics.equilibrium import reference_load
    from jld_core.mechanics.yield_set import FrictionSet, used

__all__ = [
    "FaceGeometry",
    "FaceRows",
    "FrictionSet",
    "Gauge",
    "Parameter",
    "Scaling",
    "YieldSet",
    "enclosing_rows",
    "equilibrium_matrix",
    "load_vectors",
    "prescribed_friction",
    "reference_load",
    "require_materials",
    "scaling_of",
    "used",
    "yield_set",
]

export_lazily(
    __name__,
    {
        "yield_set": ["FrictionSet", "used"],
        "equilibrium": ["reference_load"],
    },
    submodules=["prescribed_friction"],
)
