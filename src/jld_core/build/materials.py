"""Conversion of materials to strengths per interface and self-weights per element."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import INNER, Assembly, Interfaces, Members
from jld_core.errors import InputError
from jld_core.geometry import across
from jld_core.geometry.polyhedra import contains, distance_from_face
from jld_core.geometry.vectors import resultants
from jld_core.linalg.factors import summed
from jld_core.scene.materials import Dry, FaceMaterial, Inner, Materials, lies_within_apex
from jld_core.scene.part import Anchor, Member
from jld_core.scene.schema import Contact, Element, Scene
from jld_core.scene.standard import PARAMETERS, StandardParameter, key_of
from jld_core.strengths import Route, Side, StatedCriterion, Strengths, stated


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
            "materials.gravity", f"it has {len(materials.gravity)} numbers", f"a number or a vector of {dimension}"
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


def _stated_value(source: Any, one: StandardParameter, prefix: str = "") -> float | None:
    """Return the value that an entry states for a parameter, if any; prefix: of the keys of friction in it."""
    if source is None:
        return None
    if one.side == "friction":
        return _coefficient(*(getattr(source, f"{prefix}friction_{what}") for what in ("coefficient", "angle")))
    value: float | None = getattr(source, one.key)
    return value


def _of_face(face: FaceMaterial) -> dict[str, float | None]:
    """Return the values that an entry of "materials.faces" states, by fields of `Strengths`."""
    given = {parameter.field: _stated_value(getattr(face, parameter.label), parameter) for parameter in PARAMETERS}
    return {name: value for name, value in given.items() if value is not None}


def criteria(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None]
) -> tuple[StatedCriterion, ...]:
    """Return the criteria of plug-ins that a scene states, each with its interfaces (m,)."""
    found: dict[str, tuple[StatedCriterion, list[int]]] = {}
    for label in ("dry", "inner"):
        usual, keys = getattr(materials, label), _OF_CONTACTS[label]
        for number, (contact, face) in enumerate(zip(contacts, faces, strict=True)):
            source, key = usual, f"materials.{label}"
            own = getattr(face, label) if face is not None else None
            if face is not None and own is not None and own.model_fields_set:
                source, key = own, f"materials.faces of {'–'.join(face.between)}: {label}"
            named = None if source is None else source.named
            if named is None:
                continue
            name, parameters = named
            given = [one for one in keys if contact is not None and getattr(contact, one) is not None]
            if contact is not None and given:
                where = f"interface {'–'.join(contact.elements)}: {given[0]}"
                raise InputError(where, f'{key} has the criterion "{name}"', "no strength of its own")
            text = json.dumps([label, name, parameters], sort_keys=True)
            if text not in found:
                values = stated(label, name, parameters, key)
                found[text] = StatedCriterion(label, name, values, np.zeros(0, dtype=bool)), []
            found[text][1].append(number)
    mask = np.arange(len(contacts))
    return tuple(replace(one, faces=np.isin(mask, places)) for one, places in found.values())


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
    usual = {parameter.field: _stated_value(getattr(materials, parameter.label), parameter) for parameter in PARAMETERS}
    rows = []
    for contact, face in zip(contacts, faces or [None] * len(contacts), strict=True):
        own = dict(usual)
        if face is not None:
            stating = [label for label in _PREFIX if getattr(getattr(face, label), "named", None) is not None]
            own |= {parameter.field: None for parameter in PARAMETERS if parameter.label in stating}
            own |= _of_face(face)
            _check_apex(own, f"materials.faces of {'–'.join(face.between)}")
        if contact is not None:
            given = {
                parameter.field: _stated_value(contact, parameter, _PREFIX[parameter.label]) for parameter in PARAMETERS
            }
            own |= {name: value for name, value in given.items() if value is not None}
            _check_apex(own, f"interface {'–'.join(contact.elements)}")
        rows.append(
            [parameter.absent if own[parameter.field] is None else own[parameter.field] for parameter in PARAMETERS]
        )
    table = np.array(rows, dtype=float).reshape(-1, len(PARAMETERS))
    columns = zip(PARAMETERS, table.T, strict=True)
    return Strengths(**{one.field: np.ascontiguousarray(column) for one, column in columns})


def _check_apex(own: Mapping[str, float | None], where: str) -> None:
    """Raise InputError if the inner tension of strengths by fields exceeds the apex of friction."""
    found = {parameter.side: own[parameter.field] for parameter in PARAMETERS if parameter.label == "inner"}
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
    values = [
        None if material is None or material.dry is None else material.dry.tensile_strength for material in entries
    ]
    strength = np.array([usual if value is None else value for value in values], dtype=float)
    if not strength.any():
        return assembly
    own = assembly.strengths(_ROUTE)
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
    force = strength * assembly.interfaces.area
    return replace(
        assembly.with_strengths(strengths),
        members=replace(assembly.members, bond=force, self_stress=bond_pull(assembly, force)),
    )


def bond_pull(assembly: Assembly, force: Floats) -> Floats:
    """Return the resultants (n, q) of forces (m,) that pull both sides of each face together; zero on supports."""
    faces, d = assembly.interfaces, assembly.dimension
    vector = np.concatenate([force[:, None] * faces.normal, -force[:, None] * faces.normal])
    owner = np.concatenate([faces.a, faces.b])
    arm = np.concatenate([faces.origin, faces.origin]) - assembly.elements.centroid[owner]
    loads = np.column_stack([vector, np.zeros((len(vector), assembly.freedoms - d))])
    pull = resultants(len(assembly.elements), owner, loads, arm)
    pull[assembly.elements.support] = 0.0
    return pull


def with_members(assembly: Assembly, entries: Sequence[Member], more: Members | None = None) -> Assembly:
    """Return an assembly with members.

    An interface for each whose force may vary, and prestress among dead loads.
    """
    if not entries and not more:
        return assembly
    members = _members(assembly, entries) if entries else Members()
    members = members + more if more else members
    varying = np.flatnonzero(members.axial | (members.shear > 0.0))
    place = np.full(len(members), -1, dtype=np.int64)
    place[varying] = len(assembly.interfaces) + np.arange(len(varying))
    members = replace(members, face=place)
    prestress, own = _prestress(assembly, members), assembly.members
    stress = prestress if own.self_stress is None else summed(own.self_stress, prestress)
    members = replace(members, bond=own.bond, self_stress=stress if stress.any() else None)
    strengths = _strengths(members, varying)
    return replace(
        assembly,
        members=members,
        interfaces=_join_interfaces(assembly.interfaces, _interfaces(assembly, members, varying)),
        face_strengths=assembly.face_strengths.joined(strengths),
        labels=np.append(assembly.labels, np.full(len(varying), INNER)).astype(bool),
    )


def _join_interfaces(one: Interfaces, other: Interfaces) -> Interfaces:
    parts: dict[str, Any] = {}
    for part in fields(one):
        first, second = getattr(one, part.name), getattr(other, part.name)
        parts[part.name] = first + second if isinstance(first, tuple) else np.concatenate([first, second])
    return Interfaces(**parts)


def _members(assembly: Assembly, entries: Sequence[Member]) -> Members:
    """Convert entries to `Members` without interfaces; raise InputError for wrong points, elements, axes or names."""
    names, held, points, axes = [], [], [], []
    for position, entry in enumerate(entries):
        where = f"members[{position}]"
        anchors = [("from", entry.from_), *((f"through[{k}]", one) for k, one in enumerate(entry.through))]
        anchors.append(("to", entry.to))
        found = [_anchor_point(assembly, anchor, f"{where}.{key}") for key, anchor in anchors]
        elements, places = np.array([element for element, _ in found]), np.array([place for _, place in found])
        _require_two(assembly, elements, where)
        names.append(entry.name or f"{entry.kind} {position + 1}")
        held.append(elements)
        points.append(places)
        axes.append(_axis(assembly, entry, elements, places, where))
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InputError(f"members[{names.index(twice)}].name", f"{twice!r} is given twice", "a name for each")
    return Members(
        names=tuple(names),
        kinds=tuple(entry.kind for entry in entries),
        elements=tuple(held),
        points=tuple(points),
        axis=np.array(axes),
        tension=np.array([entry.most for entry in entries], dtype=float),
        compression=np.array([entry.compression for entry in entries], dtype=float),
        shear=np.array([entry.shear or 0.0 for entry in entries], dtype=float),
        prestress=np.array([entry.prestress for entry in entries], dtype=float),
    )


def _anchor_point(assembly: Assembly, anchor: Anchor, where: str) -> tuple[int, Floats]:
    """Return the element and the point (d,) of an anchor, checked to lie inside it."""
    elements, d = assembly.elements, assembly.dimension
    index = elements.named(anchor.element, f"{where}.element", "the id of an element")
    if len(anchor.at) != d:
        raise InputError(f"{where}.at", f"it has {len(anchor.at)} numbers", f"{d} in this scene")
    point = np.array(anchor.at, dtype=float)
    loops = elements.faces[index] if elements.faces else ()
    if not contains(elements.shape[index], loops, point, tolerances.ON_OUTLINE * assembly.size):
        problem = f"({', '.join(f'{x:g}' for x in anchor.at)}) lies outside element {anchor.element!r}"
        raise InputError(f"{where}.at", problem, "a point of the element")
    return index, point


def _require_two(assembly: Assembly, elements: Ints, where: str) -> None:
    """Raise InputError if a member connects a single element, or supports only."""
    if len(np.unique(elements)) == 1:
        problem = f"all its points belong to element {assembly.elements.ids[elements[0]]!r}"
        raise InputError(where, problem, "points of two elements, since an element is rigid")
    if assembly.elements.support[elements].all():
        raise InputError(where, "all its points belong to supports", "a free element at one end at least")


def _axis(assembly: Assembly, entry: Member, elements: Ints, points: Floats, where: str) -> Floats:
    """Return the unit vector (d,) along the first segment.

    For a pin of coinciding ends the normal of the nearest face.
    """
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    short = np.flatnonzero(length <= tolerances.ON_OUTLINE * assembly.size)
    if not short.size:
        return np.asarray(step[0] / length[0])
    if entry.kind != "pin":
        names = ["from", *(f"through[{k}]" for k in range(len(entry.through))), "to"]
        one, two = names[short[0]], names[short[0] + 1]
        raise InputError(where, f'"{one}" and "{two}" are the same point', "points apart from each other")
    faces = assembly.interfaces
    between = np.flatnonzero(
        (np.minimum(faces.a, faces.b) == elements.min()) & (np.maximum(faces.a, faces.b) == elements.max())
    )
    if not between.size:
        one, two = (assembly.elements.ids[k] for k in elements)
        problem = f"both ends are the same point, and {one!r} and {two!r} share no face"
        raise InputError(where, problem, "two points, which give the axis of the pin")
    away = np.array([distance_from_face(faces, face, points[0]) for face in between.tolist()])
    near = between[away <= away.min() + tolerances.ON_OUTLINE * assembly.size]
    normal = np.asarray(faces.normal[near] * np.where(faces.a[near] == elements[0], 1.0, -1.0)[:, None])
    if (normal @ normal[0] < 1.0 - tolerances.FACE).any():
        one, two = (assembly.elements.ids[k] for k in elements)
        problem = f"both ends are the same point, where faces of {one!r} and {two!r} meet at an angle"
        raise InputError(where, problem, "two points, which give the axis of the pin")
    return np.asarray(normal[0])


def _interfaces(assembly: Assembly, members: Members, rows: Ints) -> Interfaces:
    # Interfaces of members. Both sides are the first free element of a member, so that an interface never joins or
    # separates blocks. Area and sizes are 1, which makes a stress of the same number a force.
    d, support = assembly.dimension, assembly.elements.support
    own = np.array([members.elements[k][np.argmin(support[members.elements[k]])] for k in rows], dtype=np.int64)
    axis, one = members.axis[rows], np.ones(len(rows))
    if d == 2:
        e1, e2 = np.column_stack([-axis[:, 1], axis[:, 0]]), np.empty((len(rows), 0))
    else:
        frames = np.array([across(normal) for normal in axis]).reshape(-1, 2, 3)
        e1, e2 = frames[:, 0], frames[:, 1]
    ends = [members.points[k][[0, -1]] for k in rows]
    return Interfaces(
        a=own,
        b=own,
        origin=np.array([pair.mean(axis=0) for pair in ends]).reshape(-1, d),
        normal=axis,
        e1=e1,
        e2=e2,
        l1=one,
        l2=one,
        area=one,
        c_t=one if d == 3 else 0.0 * one,
        rectangle=np.ones(len(rows), dtype=bool),
        polygon=tuple(pair if d == 2 else pair[[0, 0, 1, 1]] for pair in ends),
    )


def _strengths(members: Members, rows: Ints) -> Strengths:
    none, never = np.zeros(len(rows)), np.full(len(rows), np.inf)
    bare = Side(none, none, none, never)
    tension, compression = (members.tension - members.prestress)[rows], members.compression[rows]
    # A pin without axial capacity has no column of N; the range of N only has to leave its yield set an interior.
    idle = np.where(members.axial[rows], 0.0, members.shear[rows])
    return Strengths.of(bare, Side(tension + idle, members.shear[rows], none, compression + idle))


def _prestress(assembly: Assembly, members: Members) -> Floats:
    """Return forces and moments (n, q) of all prestress about the centroids of elements; zero on supports."""
    elements, d = assembly.elements, assembly.dimension
    pushes = [(members.prestress[k], *members.push(k)) for k in np.flatnonzero(members.prestress).tolist()]
    if not pushes:
        return np.zeros_like(assembly.dead)
    held = np.concatenate([one for _, one, _, _ in pushes])
    arm = np.concatenate([points for _, _, points, _ in pushes]) - elements.centroid[held]
    pull = np.concatenate([-prestress * forces for prestress, _, _, forces in pushes])
    loads = np.column_stack([pull, np.zeros((len(pull), assembly.freedoms - d))])
    total = resultants(len(elements), held, loads, arm)
    total[elements.support] = 0.0
    return total
