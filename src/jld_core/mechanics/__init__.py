"""Equilibrium, scaling and yield sets of dry and inner faces.

- `CoulombWedge`: yield sets of planar faces of one label without compressive strength
- `EffectiveAreas`: effective rectangles of spatial faces, as they enter torsion
- `FrictionSet`: interface of a yield set with cohesion and friction
- `InnerBending`: form of the inner bending set, "uncoupled" (uncoupled) or "kern"
- `PlanarYield`: yield sets of planar faces
- `PrescribedFriction`: yield set whose friction depends on prescribed normal forces
- `RowPattern`: sparsity and numbers of the yield rows under both labels
- `Rows`: interface of the rows that a program takes from yield sets
- `Scaling`: factors between scene values and scaled values
- `SpatialYield`: yield sets of spatial faces
- `YieldSet`: interface of a yield set, as proofs use it
- `equilibrium_matrix`: assemble A_eq
- `load_vectors`: return b and b_λ
- `local_hulls`: return the convex hulls of faces in their own frames
- `reference_load`: compute the force relative to which forces count as zero
- `require_materials`: refuse labellings whose material is missing
- `scaling_of`: compute the scales of an assembly
- `spatial_yield`: make the yield sets of a spatial assembly
- `yield_set`: make the yield sets of an assembly of either dimension
"""

from __future__ import annotations

from jld_core.mechanics.bending import InnerBending, local_hulls
from jld_core.mechanics.equilibrium import equilibrium_matrix, load_vectors
from jld_core.mechanics.prescribed_friction import EffectiveAreas, PrescribedFriction
from jld_core.mechanics.scaling import Scaling, reference_load, scaling_of
from jld_core.mechanics.yield_planar import PlanarYield
from jld_core.mechanics.yield_set import CoulombWedge, FrictionSet, RowPattern, Rows, YieldSet, require_materials
from jld_core.mechanics.yield_spatial import SpatialYield, spatial_yield, yield_set

__all__ = [
    "CoulombWedge",
    "EffectiveAreas",
    "FrictionSet",
    "InnerBending",
    "PlanarYield",
    "PrescribedFriction",
    "RowPattern",
    "Rows",
    "Scaling",
    "SpatialYield",
    "YieldSet",
    "equilibrium_matrix",
    "load_vectors",
    "local_hulls",
    "reference_load",
    "require_materials",
    "scaling_of",
    "spatial_yield",
    "yield_set",
]
