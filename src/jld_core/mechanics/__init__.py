"""Equilibrium, scaling, and what a yield set is.

- `EffectiveAreas`: effective rectangles, as they enter torsion
- `FrictionSet`: a yield set of cohesion and friction, of which friction may be prescribed
- `InnerBending`: "paper" or "kern"
- `PlanarYield`: yield sets of planar faces
- `PrescribedFriction`: a yield set whose friction does not follow the present N
- `RowPattern`: sparsity of the yield rows under both labels
- `Rows`: what a program asks of yield sets
- `Scaling`: scene values ↔ scaled values
- `SpatialYield`: yield sets of spatial faces
- `CoulombWedge`: planar faces of one label that nothing crushes
- `YieldSet`: what a proof asks of yield sets
- `equilibrium_matrix`: A_eq
- `load_vectors`: b and b_λ
- `local_hulls`: convex hulls of faces in their own frames
- `reference_load`: the force beside which forces count as zero
- `require_materials`: refuse labellings whose material is missing
- `scaling_of`: the scales of an assembly
- `spatial_yield`: the yield sets of a spatial assembly
- `yield_set`: the yield sets of an assembly of either dimension
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
