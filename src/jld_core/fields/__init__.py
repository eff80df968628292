"""Stress and velocity fields in the blocks: two-sided bounds on λ, with cracks anywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.fields.bounds import bounds_by_fields
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.fields import bounds, loads, mesh, problem
    from jld_core.fields.bounds import governing_bounds
    from jld_core.fields.cones import ConeProgram, ConeSizes
    from jld_core.fields.weak_equilibrium import WeakEquilibrium

__all__ = [
    "ConeProgram",
    "ConeSizes",
    "WeakEquilibrium",
    "bounds",
    "bounds_by_fields",
    "governing_bounds",
    "loads",
    "mesh",
    "problem",
]

export_lazily(
    __name__,
    {"bounds": ["governing_bounds"], "cones": ["ConeProgram", "ConeSizes"], "weak_equilibrium": ["WeakEquilibrium"]},
    submodules=["bounds", "loads", "mesh", "problem"],
)
