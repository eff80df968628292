"""Conversion of materials to strengths per interface and self-weights per element."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry.vectors import resultants
from jld_core.scene import Scene
from jld_core.scene.materials import Dry, FaceMaterial, Inner, Materials, lies_within_apex
from jld_core.scene.schema import Contact, Element
from jld_core.scene.standard import PARAMETERS, StandardParameter, key_of
from jld_core.strengths import Route, StatedCriterion, Strengths, stated


def friction(source: Dry | Inner | Contact) -> float | None:
    """Return the friction coefficient of an entry that states it or its angle; None if it states neither."""
    return _coefficient(source.friction_coefficient, source.friction_angle)


def _coefficient(coefficient: float | None, angle: float | None) -> float | None:
    return coefficient if angle is None else math.tan(math.radians(angle))


def gravity_vector(materials: Materials, dimension: int) -> Floats:
    """Return gravity as a vector (d,); raise InputError for one of another length."""
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
    """Return the unit vector (d,) of gravity; without gravity, downwards."""
    vector = gravity_vector(scene.materials, scene.dimension)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        vector[-1], length = -1.0, 1.0
    return vector / length


def self_weight(element: Element, volume: float, materials: Materials, direction: Floats, gravity: float) -> Floats:
    """Return the self-weight (d,) of one element: the stated "weight", else density × volume × gravity."""
    if element.weight is not None:
        return element.weight * direction
    density = element.density if element.density is not None else materials.density
    return (density or 0.0) * volume * gravity * direction


def _stated(source: Any, one: StandardParameter, prefix: str = "") -> float | None:
    """Return the value that an entry states for a parameter, if any; prefix: of the keys of friction in it."""
    if source is None:
        return None
    if one.side == "friction":
        return _coefficient(*(getattr(source, f"{prefix}friction_{what}") for what in ("coefficient", "angle")))
    value: float | None = getattr(source, one.key)
    return value


def _of_face(face: FaceMaterial) -> dict[str, float | None]:
    """Return the values that an entry of "materials.faces" states, by fields of `Strengths`."""
    given = {one.field: _stated(getattr(face, one.label), one) for one in PARAMETERS}
    return {name: value for name, value in given.items() if value is not None}


def criteria(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None]
) -> tuple[StatedCriterion, ...]:
    """Return the criteria of plug-ins that a scene states, each with its interfaces (m,)."""
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


# Prefix of the keys of friction of a label in "interfaces", and the keys there that state strengths of one label
_PREFIX = {"dry": "", "inner": "inner_"}
_OF_CONTACTS = {
    label: [
        key
        for one in PARAMETERS
        if one.label == label
        for key in ([f"{prefix}{one.key}", f"{prefix}friction_angle"] if one.side == "friction" else [one.key])
    ]
    for label, prefix in _PREFIX.items()
}


def strengths(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None] | None = None
) -> Strengths:
    """Return the strengths of m interfaces under both labels."""
    usual = {one.field: _stated(getattr(materials, one.label), one) for one in PARAMETERS}
    rows = []
    for contact, face in zip(contacts, faces or [None] * len(contacts), strict=True):
        own = dict(usual)
        if face is not None:
            stating = [label for label in _PREFIX if getattr(getattr(face, label), "criterion", None) is not None]
            own |= {one.field: None for one in PARAMETERS if one.label in stating}
            own |= _of_face(face)
            _check_apex(own, f"materials.faces of {'–'.join(face.between)}")
        if contact is not None:
            given = {one.field: _stated(contact, one, _PREFIX[one.label]) for one in PARAMETERS}
            own |= {name: value for name, value in given.items() if value is not None}
            _check_apex(own, f"interface {'–'.join(contact.elements)}")
        rows.append([one.absent if own[one.field] is None else own[one.field] for one in PARAMETERS])
    table = np.array(rows, dtype=float).reshape(-1, len(PARAMETERS))
    columns = zip(PARAMETERS, table.T, strict=True)
    return Strengths(**{one.field: np.ascontiguousarray(column) for one, column in columns})


def _check_apex(own: Mapping[str, float | None], where: str) -> None:
    """Raise InputError if the inner tension of strengths by fields exceeds the apex of friction."""
    found = {one.side: own[one.field] for one in PARAMETERS if one.label == "inner"}
    lies_within_apex(found["tension"], found["shear"], found["friction"], where)


_ROUTE: Final = Route("the bond of joints")

_KEY = "materials.dry.tensile_strength"


def with_bond(assembly: Assembly, materials: Materials, entries: Sequence[FaceMaterial | None]) -> Assembly:
    """Return an assembly whose dry joints have a tensile strength.

    Strengths, dead loads and σt A in `members.bond`.
    """
    # With N' = N + σt A, the yield sets of both labels are sets without this strength: a dry face has c − μ σt, an
    # inner one the tensile strength less σt. The difference is a constant force σt A that pulls both sides of the face
    # together, part of the dead load. Results subtract it from N'.
    usual = materials.dry.tensile_strength if materials.dry is not None else 0.0
    values = [None if one is None or one.dry is None else one.dry.tensile_strength for one in entries]
    strength = np.array([usual if value is None else value for value in values], dtype=float)
    if not strength.any():
        return assembly
    own, faces, d = assembly.strengths(_ROUTE), assembly.interfaces, assembly.dimension
    dry, inner = own.side(dry=True), own.side(dry=False)
    with np.errstate(invalid="ignore"):
        over = strength * dry.friction > dry.shear * (1.0 + 1e-12)
        weak = strength > inner.tension * (1.0 + 1e-12)
    for wrong, what, limit in (
        (over, "beyond the apex of its friction", f"at most {key_of('dry', 'shear')} over friction"),
        (weak, "above the tensile strength of the same face as an inner one", "at most that of materials.inner"),
    ):
        if wrong.any():
            face = int(np.flatnonzero(wrong)[0])
            entry = entries[face]
            own_value = entry is not None and entry.dry is not None and entry.dry.tensile_strength is not None
            where = f"materials.faces of {assembly.pair(face)}: dry.tensile_strength" if own_value else _KEY
            raise InputError(where, f"{strength[face]:g} is {what} (face {assembly.pair(face)})", limit)
    strengths = Strengths.of(
        replace(
            dry,
            shear=np.where(strength > 0.0, np.maximum(dry.shear - dry.friction * strength, 0.0), dry.shear),
            crush=dry.crush + strength,
        ),
        replace(
            inner,
            tension=np.maximum(inner.tension - strength, 0.0),
            shear=np.maximum(inner.shear - inner.friction * strength, 0.0),
            crush=inner.crush + strength,
        ),
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
