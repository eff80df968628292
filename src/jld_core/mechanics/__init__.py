"""Equilibrium, scaling, and what a yield set is."""

from __future__ import annotations

from jld_core.mechanics.bending import InnerBending, local_hulls
from jld_core.mechanics.equilibrium import equilibrium_matrix, load_vectors
from jld_core.mechanics.prescribed_friction import Contact, PrescribedFriction
from jld_core.mechanics.scaling import Scaling, scaling_of
from jld_core.mechanics.yield_planar import PlanarYield, planar_yield
from jld_core.mechanics.yield_set import RowPattern, Rows, YieldSet, require_materials
from jld_core.mechanics.yield_spatial import SpatialYield, spatial_yield

__all__ = [
    "Contact",
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
    "planar_yield",
    "require_materials",
    "scaling_of",
    "spatial_yield",
]
