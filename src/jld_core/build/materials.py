"""Conversion of materials to strengths per interface and self-weights per element."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry.vectors import resultants
from jld_core.scene import Scene
from jld_core.scene.materials import Dry, DryFace, FaceMaterial, Inner, InnerFace, Materials, lies_within_apex
from jld_core.scene.schema import Contact, Element
from jld_core.strengths import Route, StatedCriterion, Strengths, stated


def friction(source: Dry | Inner | Contact) -> float | None:
    """Return the friction coefficient of an entry that states it or the friction angle.

    The result is None if the entry states neither.
    """
    return _coefficient(source.friction_coefficient, source.friction_angle)


def _coefficient(coefficient: float | None, angle: float | None) -> float | None:
    """Return the tangent of an angle in degrees, or else the coefficient; None without both."""
    return coefficient if angle is None else math.tan(math.radians(angle))


def gravity_vector(materials: Materials, dimension: int) -> Floats:
    """Return gravity as a vector.

    dimension: dimension d of the scene, 2 or 3. Returns (d,). Raises InputError: a given vector has the wrong length.
    """
    if isinstance(materials.gravity, float | int):
        vector = np.zeros(dimension)
        vector[-1] = -materials.gravity
        return vector
    if len(materials.gravity) != dimension:
        raise InputError(
            "materials.gravity",
            f"it has {len(materials.gravity)} numbers",
            f"a number or a vector of {dimension}",
        )
    return np.array(materials.gravity, dtype=float)


def direction_of_weight(scene: Scene) -> Floats:
    """Return the unit vector (d,) along which stated weights act: along gravity.

    It is downwards, the negative last axis, for zero gravity.
    """
    vector = gravity_vector(scene.materials, scene.dimension)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        vector[-1], length = -1.0, 1.0
    return vector / length


def self_weight(element: Element, volume: float, materials: Materials, direction: Floats, gravity: float) -> Floats:
    """Return the self-weight (d,) of one element as a force, scene units.

    It is the entry's "weight" if stated, else density × volume × gravity; without a density it is zero.
    """
    if element.weight is not None:
        return element.weight * direction
    density = element.density if element.density is not None else materials.density
    return (density or 0.0) * volume * gravity * direction


def _of_face(face: FaceMaterial) -> dict[str, float]:
    """Return the values that an entry of "materials.faces" states, by fields of `Strengths`."""
    dry, inner = face.dry or DryFace(), face.inner or InnerFace()
    given = {
        "friction": _coefficient(dry.friction_coefficient, dry.friction_angle),
        "tension": inner.tensile_strength,
        "shear": inner.shear_strength,
        "crush_dry": dry.compressive_strength,
        "crush_inner": inner.compressive_strength,
        "cohesion": dry.cohesion,
        "inner_friction": _coefficient(inner.friction_coefficient, inner.friction_angle),
    }
    return {name: value for name, value in given.items() if value is not None}


def criteria(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None]
) -> tuple[StatedCriterion, ...]:
    """Return the criteria of plug-ins that a scene states, each with the interfaces (m,) that have it.

    Raises InputError for a criterion or parameters that are unknown or out of bounds, and for an interface with
    standard strengths of its own beside a criterion.
    """
    found: dict[tuple[str, str, tuple[tuple[str, float], ...]], list[int]] = {}
    for label in ("dry", "inner"):
        usual, keys = getattr(materials, label), _OF_CONTACTS[label]
        for number, (contact, face) in enumerate(zip(contacts, faces, strict=True)):
            source, key = usual, f"materials.{label}"
            own = getattr(face, label) if face is not None else None
            if face is not None and own is not None and own.model_fields_set:
                source, key = own, f"materials.faces of {'–'.join(face.between)}: {label}"
            if source is None or source.criterion is None:
                continue
            given = [one for one in keys if contact is not None and getattr(contact, one) is not None]
            if contact is not None and given:
                where = f"interface {'–'.join(contact.elements)}: {given[0]}"
                raise InputError(where, f'{key} has the criterion "{source.criterion}"', "no strength of its own")
            values = stated(label, source.criterion, source.parameters, key)
            found.setdefault((label, source.criterion, values), []).append(number)
    mask = np.arange(len(contacts))
    return tuple(StatedCriterion(*key, np.isin(mask, places)) for key, places in found.items())


# Keys of "interfaces" that state strengths of one label
_OF_CONTACTS = {
    "dry": ("friction_coefficient", "friction_angle", "cohesion", "compressive_strength"),
    "inner": (
        *("tensile_strength", "shear_strength", "compressive_strength"),
        *("inner_friction_coefficient", "inner_friction_angle"),
    ),
}


def strengths(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None] | None = None
) -> Strengths:
    """Return the strengths of m interfaces under both labels, scene units.

    Raises InputError where the inner tension of a face or contact entry exceeds the apex of its friction cone.
    """
    # Friction, tension and shear that are not stated are NaN; compressive strengths are inf, cohesion and inner
    # friction 0.
    dry, inner = materials.dry, materials.inner
    usual = {
        "friction": friction(dry) if dry else None,
        "tension": inner.tensile_strength if inner else None,
        "shear": inner.shear_strength if inner else None,
        "crush_dry": dry.compressive_strength if dry else None,
        "crush_inner": inner.compressive_strength if inner else None,
        "cohesion": dry.cohesion if dry else None,
        "inner_friction": friction(inner) if inner else None,
    }
    absent = {"crush_dry": math.inf, "crush_inner": math.inf, "cohesion": 0.0, "inner_friction": 0.0}
    rows = []
    for contact, face in zip(contacts, faces or [None] * len(contacts), strict=True):
        own = dict(usual)
        if face is not None:
            if face.dry is not None and face.dry.criterion is not None:
                own |= dict.fromkeys(("friction", "crush_dry", "cohesion"))
            if face.inner is not None and face.inner.criterion is not None:
                own |= dict.fromkeys(("tension", "shear", "crush_inner", "inner_friction"))
            own |= _of_face(face)
            where = f"materials.faces of {'–'.join(face.between)}"
            lies_within_apex(own["tension"], own["shear"], own["inner_friction"], where)
        if contact is not None:
            inner_friction = _coefficient(contact.inner_friction_coefficient, contact.inner_friction_angle)
            given = {
                "friction": friction(contact),
                "tension": contact.tensile_strength,
                "shear": contact.shear_strength,
                "crush_dry": contact.compressive_strength,
                "crush_inner": contact.compressive_strength,
                "cohesion": contact.cohesion,
                "inner_friction": inner_friction,
            }
            own |= {name: value for name, value in given.items() if value is not None}
            lies_within_apex(
                own["tension"], own["shear"], own["inner_friction"], f"interface {'–'.join(contact.elements)}"
            )
        rows.append([absent.get(name, math.nan) if value is None else value for name, value in own.items()])
    table = np.array(rows, dtype=float).reshape(-1, len(usual))
    return Strengths(**{name: np.ascontiguousarray(column) for name, column in zip(usual, table.T, strict=True)})


_ROUTE: Final = Route("the bond of joints")

_KEY = "materials.dry.tensile_strength"


def with_bond(assembly: Assembly, materials: Materials, entries: Sequence[FaceMaterial | None]) -> Assembly:
    """Return an assembly whose dry joints have a tensile strength.

    Result: assembly with changed strengths and dead loads, and the forces σt A in `members.bond`. Raises InputError: a
    tensile strength exceeds the apex c/μ of its friction, or the tensile strength of the face as an inner one.
    """
    # With N' = N + σt A, the yield sets of both labels are sets without this strength: a dry face has the cohesion c −
    # μ σt, an inner one the tensile strength less σt. The difference is a constant force σt A that pulls both sides of
    # the face together, part of the dead load. Results subtract it from N'.
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
