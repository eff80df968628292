"""Stress and velocity fields in the blocks: λ of planar blocks that may crack anywhere, from both sides.

- `CoarseBounds`: both bounds of many labellings on the coarsest mesh, set up once
- `FieldBounds`: a two-sided bound with its fields and history
- `FieldMechanism`: upper bound on λ of every labelling, by one velocity field
- `FieldSetting`: what all meshes and labellings of one assembly have in common
- `FieldStatus`: how a two-sided bound ended
- `FieldStep`: both bounds on one mesh
- `FieldStresses`: lower bound on λ of many labellings, by one stress field
- `Fields`: certified fields of one labelling on one mesh
- `Material`: Mohr–Coulomb with tension cut-off in plane stress
- `Mesh`: triangles inside the cells, conforming across interfaces
- `Stresses`: a certified stress field
- `Velocities`: a certified velocity field
- `bounds_by_fields`: bounds on λ of one labelling
- `material_of`: the material of the blocks of an assembly
- `require_fields`: refuse an assembly that fields cannot bound
"""

from __future__ import annotations

from jld_core.fields.adaptive import CoarseBounds, Fields, FieldSetting
from jld_core.fields.bounds import FieldBounds, FieldStatus, FieldStep, Stresses, Velocities, bounds_by_fields
from jld_core.fields.material import Material, material_of
from jld_core.fields.mesh import Mesh
from jld_core.fields.requirements import require_fields
from jld_core.fields.transfer import FieldMechanism, FieldStresses

__all__ = [
    "CoarseBounds",
    "FieldBounds",
    "FieldMechanism",
    "FieldSetting",
    "FieldStatus",
    "FieldStep",
    "FieldStresses",
    "Fields",
    "Material",
    "Mesh",
    "Stresses",
    "Velocities",
    "bounds_by_fields",
    "material_of",
    "require_fields",
]
