"""Equilibrium, scaling and yield sets of dry and inner faces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.mechanics.criteria import FaceGeometry, FaceRows, Gauge, enclosing_rows, yield_set
from jld_core.mechanics.equilibrium import Scaling, equilibrium_matrix, load_vectors, scaling_of
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
    {"yield_set": ["FrictionSet", "used"], "equilibrium": ["reference_load"]},
    submodules=["prescribed_friction"],
)
