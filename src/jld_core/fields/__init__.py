"""Stress and velocity fields in the blocks: two-sided bounds on λ, with cracks anywhere.

- `ConeProgram`: cone program: minimise q x where A x + s = b and s lies in a product of cones
- `WeakEquilibrium`: stresses in weak equilibrium of one labelling on one mesh
- `bounds`: bounds on λ of blocks that crack anywhere, refined where the two fields disagree
- `bounds_by_fields`: bounds on λ of one labelling, in the plane or in space
- `governing_bounds`: bound the governing load factor of a planar layout whose blocks crack anywhere
- `loads`: loads of cells as body forces and tractions with the resultants of the scene
- `mesh`: simplices inside the cells of an assembly, conforming across every interface
- `problem`: non-dimensional problem of both bounds, with numbers of order one
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.fields.bounds import bounds_by_fields
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.fields import bounds, loads, mesh, problem
    from jld_core.fields.bounds import governing_bounds
    from jld_core.fields.cones import ConeProgram
    from jld_core.fields.weak_equilibrium import WeakEquilibrium

__all__ = [
    "ConeProgram",
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
    {
        "bounds": ["governing_bounds"],
        "cones": ["ConeProgram"],
        "weak_equilibrium": ["WeakEquilibrium"],
    },
    submodules=["bounds", "loads", "mesh", "problem"],
)
