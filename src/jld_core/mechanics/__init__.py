"""Equilibrium, scaling and yield sets of dry and inner faces.

- `FaceGeometry`: faces for which a yield criterion of a plug-in is asked
- `FaceRows`: yield set that it states as rows
- `Gauge`: limit on shear and torsion among them, in space
- `InnerBending`: form of the inner bending set, "uncoupled" (each moment by itself) or "kern" (edge stress)
- `Parameter`: parameter of a yield criterion
- `RowPattern`: sparsity and numbers of the yield rows under both labels
- `Rows`: interface of the rows that a program takes from yield sets
- `Scaling`: factors between scene values and scaled values
- `YieldSet`: interface of a yield set, as proofs use it
- `equilibrium_matrix`: assemble A_eq
- `load_vectors`: return b and b_λ
- `maps_criteria`: tell whether a symmetry maps the yield criteria of plug-ins
- `require_materials`: refuse labellings whose material is missing
- `scaling_of`: compute the scales of an assembly
- `yield_set`: make the yield sets of an assembly of either dimension
"""

from __future__ import annotations

from jld_core.mechanics.bending import InnerBending
from jld_core.mechanics.compiled_rows import maps_criteria, yield_set
from jld_core.mechanics.criteria import FaceGeometry, FaceRows, Gauge
from jld_core.mechanics.equilibrium import equilibrium_matrix, load_vectors
from jld_core.mechanics.scaling import Scaling, scaling_of
from jld_core.mechanics.yield_set import RowPattern, Rows, YieldSet, require_materials
from jld_core.strengths import Parameter

__all__ = [
    "FaceGeometry",
    "FaceRows",
    "Gauge",
    "InnerBending",
    "Parameter",
    "RowPattern",
    "Rows",
    "Scaling",
    "YieldSet",
    "equilibrium_matrix",
    "load_vectors",
    "maps_criteria",
    "require_materials",
    "scaling_of",
    "yield_set",
]
