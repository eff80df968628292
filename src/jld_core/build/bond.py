"""Bond of dry joints: tensile strength as a shift of normal forces.

Source: docs/method.md (2.7a) to (2.7c).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry.vectors import resultants
from jld_core.scene.materials import FaceMaterial, Materials
from jld_core.strengths import Route

_ROUTE: Final = Route("the bond of joints")

_KEY = "materials.dry.tensile_strength"


def with_bond(assembly: Assembly, materials: Materials, entries: Sequence[FaceMaterial | None]) -> Assembly:
    """Return an assembly whose dry joints have a tensile strength.

    With N' = N + σt A, the yield sets of both labels are sets without this strength: a dry face has the cohesion
    c − μ σt, an inner one the tensile strength less σt. The difference is a constant force σt A that pulls both sides
    of the face together, part of the dead load. Results subtract it from N'.

    assembly: assembly without members. materials: materials of the scene, with the tensile strength σt of dry joints.
    entries: for each interface the entry of "materials.faces" for its two elements, or None. Result: assembly with
    changed strengths and dead loads, and the forces σt A in `members.bond`. Raises InputError: a tensile strength
    exceeds the apex c/μ of its friction, or the tensile strength of the face as an inner one.
    """
    usual = materials.dry.tensile_strength if materials.dry is not None else 0.0
    values = [None if one is None or one.dry is None else one.dry.tensile_strength for one in entries]
    strength = np.array([usual if value is None else value for value in values], dtype=float)
    if not strength.any():
        return assembly
    own, faces, d = assembly.strengths(_ROUTE), assembly.interfaces, assembly.dimension
    with np.errstate(invalid="ignore"):
        over = strength * own.friction > own.cohesion * (1.0 + 1e-12)
        weak = strength > own.tension * (1.0 + 1e-12)
    for wrong, what, limit in (
        (over, "beyond the apex of its friction", "at most cohesion over friction"),
        (weak, "above the tensile strength of the same face as an inner one", "at most that of materials.inner"),
    ):
        if wrong.any():
            face = int(np.flatnonzero(wrong)[0])
            entry = entries[face]
            own_value = entry is not None and entry.dry is not None and entry.dry.tensile_strength is not None
            where = f"materials.faces of {assembly.pair(face)}: dry.tensile_strength" if own_value else _KEY
            raise InputError(where, f"{strength[face]:g} is {what} (face {assembly.pair(face)})", limit)
    strengths = replace(
        own,
        cohesion=np.where(strength > 0.0, np.maximum(own.cohesion - own.friction * strength, 0.0), own.cohesion),
        tension=np.where(np.isnan(own.tension), np.nan, np.maximum(own.tension - strength, 0.0)),
        shear=np.where(np.isnan(own.shear), np.nan, np.maximum(own.shear - own.inner_friction * strength, 0.0)),
        crush_dry=own.crush_dry + strength,
        crush_inner=own.crush_inner + strength,
    )
    force = strength * faces.area
    vector = np.concatenate([force[:, None] * faces.normal, -force[:, None] * faces.normal])
    owner = np.concatenate([faces.a, faces.b])
    arm = np.concatenate([faces.origin, faces.origin]) - assembly.elements.centroid[owner]
    loads = np.column_stack([vector, np.zeros((len(vector), assembly.freedoms - d))])
    pull = resultants(len(assembly.elements), owner, loads, arm)
    pull[assembly.elements.support] = 0.0
    return replace(
        assembly.with_strengths(strengths),
        members=replace(assembly.members, bond=force, self_stress=pull),
    )
