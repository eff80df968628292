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


def _stated_value(source: Any, parameter: StandardParameter, prefix: str = "") -> float | None:
    """Return the value that an entry states for a parameter, if any; prefix: of its keys of friction."""
    if source is None:
        return None
    if parameter.side == "friction":
        return _coefficient(*(getattr(source, f"{prefix}friction_{name}") for name in ("coefficient", "angle")))
    value: float | None = getattr(source, parameter.key)
    return value


def _of_face(face: FaceMaterial) -> dict[str, float | None]:
    """Return the values that an entry of "materials.faces" states, by fields of `Strengths`."""
    values = {parameter.field: _stated_value(getattr(face, parameter.label), parameter) for parameter in PARAMETERS}
    return {name: value for name, value in values.items() if value is not None}


def criteria(
    materials: Materials, contacts: list[Contact | None], faces: list[FaceMaterial | None]
) -> tuple[StatedCriterion, ...]:
    """Return the criteria of plug-ins that a scene states, each with its interfaces (m,)."""
    by_text: dict[str, tuple[StatedCriterion, list[int]]] = {}
    for label in ("dry", "inner"):
        default, keys = getattr(materials, label), _OF_CONTACTS[label]
        for number, (contact, face) in enumerate(zip(contacts, faces, strict=True)):
            source, key = default, f"materials.{label}"
            of_face = getattr(face, label) if face is not None else None
            if face is not None and of_face is not None and of_face.model_fields_set:
                source, key = of_face, f"materials.faces of {'–'.join(face.between)}: {label}"
            criterion = None if source is None else source.named
            if criterion is None:
                continue
            name, parameters = criterion
            stated_keys = [k for k in keys if getattr(contact, k, None) is not None]
            if contact is not None and stated_keys:
                where = f"interface {'–'.join(contact.elements)}: {stated_keys[0]}"
                raise InputError(where, f'{key} has the criterion "{name}"', "no strength of its own")
            text = json.dumps([label, name, parameters], sort_keys=True)
            if text not in by_text:
                values = stated(label, name, parameters, key)
                by_text[text] = StatedCriterion(label, name, values, np.zeros(0, dtype=bool)), []
            by_text[text][1].append(number)
    indices = np.arange(len(contacts))
    return tuple(replace(criterion, faces=np.isin(indices, numbers)) for criterion, numbers in by_text.values())


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
    # Values of "interfaces" replace those of "materials.faces", and these those of "materials". A face with a criterion
    # has none of the strengths of its label in "materials".
    defaults = {p.field: _stated_value(getattr(materials, p.label), p) for p in PARAMETERS}
    rows = []
    for contact, face in zip(contacts, faces or [None] * len(contacts), strict=True):
        values = dict(defaults)
        if face is not None:
            stating = [label for label in _PREFIX if getattr(getattr(face, label), "named", None) is not None]
            values |= {p.field: None for p in PARAMETERS if p.label in stating}
            values |= _of_face(face)
            _check_apex(values, f"materials.faces of {'–'.join(face.between)}")
        if contact is not None:
            of_contact = {p.field: _stated_value(contact, p, _PREFIX[p.label]) for p in PARAMETERS}
            values |= {name: value for name, value in of_contact.items() if value is not None}
            _check_apex(values, f"interface {'–'.join(contact.elements)}")
        rows.append([p.absent if values[p.field] is None else values[p.field] for p in PARAMETERS])
    table = np.array(rows, dtype=float).reshape(-1, len(PARAMETERS))
    columns = zip(PARAMETERS, table.T, strict=True)
    return Strengths(**{p.field: np.ascontiguousarray(column) for p, column in columns})


def _check_apex(values: Mapping[str, float | None], where: str) -> None:
    """Raise InputError if the inner tension of strengths by fields exceeds the apex of friction."""
    inner = {parameter.side: values[parameter.field] for parameter in PARAMETERS if parameter.label == "inner"}
    lies_within_apex(inner["tension"], inner["shear"], inner["friction"], where)


_ROUTE: Final = Route("the bond of joints")

_KEY = "materials.dry.tensile_strength"


def with_bond(assembly: Assembly, materials: Materials, entries: Sequence[FaceMaterial | None]) -> Assembly:
    """Return an assembly whose dry joints have a tensile strength. Strengths, dead loads and σt A in `members.bond`."""
    # With N' = N + σt A, the yield sets of both labels are sets without this strength: a dry face has c − μ σt, an
    # inner one the tensile strength less σt. The difference is a constant force σt A that pulls both sides of the face
    # together, part of the dead load. Results subtract it from N'.
    default = materials.dry.tensile_strength if materials.dry is not None else 0.0
    values = [
        None if material is None or material.dry is None else material.dry.tensile_strength for material in entries
    ]
    strength = np.array([default if value is None else value for value in values], dtype=float)
    if not strength.any():
        return assembly
    unbonded = assembly.strengths(_ROUTE)
    dry, inner = unbonded.side(dry=True), unbonded.side(dry=False)
    with np.errstate(invalid="ignore"):
        beyond_apex = strength * dry.friction > dry.shear * (1.0 + 1e-12)
        above_inner = strength > inner.tension * (1.0 + 1e-12)
    for faulty, relation, limit in (
        (beyond_apex, "beyond the apex of its friction", f"at most {key_of('dry', 'shear')} over friction"),
        (above_inner, "above the tensile strength of the same face as an inner one", "at most that of materials.inner"),
    ):
        if faulty.any():
            face = int(np.flatnonzero(faulty)[0])
            entry = entries[face]
            is_of_face = entry is not None and entry.dry is not None and entry.dry.tensile_strength is not None
            where = f"materials.faces of {assembly.pair(face)}: dry.tensile_strength" if is_of_face else _KEY
            raise InputError(where, f"{strength[face]:g} is {relation} (face {assembly.pair(face)})", limit)
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
    forces = resultants(len(assembly.elements), owner, loads, arm)
    forces[assembly.elements.support] = 0.0
    return forces


def with_members(assembly: Assembly, entries: Sequence[Member], fill_bars: Members | None = None) -> Assembly:
    """Return an assembly with members. An interface for each whose force may vary, and prestress among dead loads."""
    if not entries and not fill_bars:
        return assembly
    members = _members(assembly, entries) if entries else Members()
    members = members + fill_bars if fill_bars else members
    varying = np.flatnonzero(members.axial | (members.shear > 0.0))
    face_of = np.full(len(members), -1, dtype=np.int64)
    face_of[varying] = len(assembly.interfaces) + np.arange(len(varying))
    members = replace(members, face=face_of)
    prestress, bonded = _prestress(assembly, members), assembly.members
    self_stress = prestress if bonded.self_stress is None else summed(bonded.self_stress, prestress)
    members = replace(members, bond=bonded.bond, self_stress=self_stress if self_stress.any() else None)
    strengths = _strengths(members, varying)
    return replace(
        assembly,
        members=members,
        interfaces=_join_interfaces(assembly.interfaces, _interfaces(assembly, members, varying)),
        face_strengths=assembly.face_strengths.joined(strengths),
        labels=np.append(assembly.labels, np.full(len(varying), INNER)).astype(bool),
    )


def _join_interfaces(first: Interfaces, second: Interfaces) -> Interfaces:
    parts: dict[str, Any] = {}
    for field in fields(first):
        left, right = getattr(first, field.name), getattr(second, field.name)
        parts[field.name] = left + right if isinstance(left, tuple) else np.concatenate([left, right])
    return Interfaces(**parts)


def _members(assembly: Assembly, entries: Sequence[Member]) -> Members:
    """Convert entries to `Members` without interfaces; raise InputError for wrong points, elements, axes or names."""
    names, elements_of, points, axes = [], [], [], []
    for position, entry in enumerate(entries):
        where = f"members[{position}]"
        anchors = [("from", entry.from_), *((f"through[{k}]", via) for k, via in enumerate(entry.through))]
        anchors.append(("to", entry.to))
        anchored = [_anchor_point(assembly, anchor, f"{where}.{key}") for key, anchor in anchors]
        elements, polyline = np.array([k for k, _ in anchored]), np.array([point for _, point in anchored])
        _require_two(assembly, elements, where)
        names.append(entry.name or f"{entry.kind} {position + 1}")
        elements_of.append(elements)
        points.append(polyline)
        axes.append(_axis(assembly, entry, elements, polyline, where))
    repeated = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if repeated is not None:
        raise InputError(f"members[{names.index(repeated)}].name", f"{repeated!r} is given twice", "a name for each")
    return Members(
        names=tuple(names),
        kinds=tuple(entry.kind for entry in entries),
        elements=tuple(elements_of),
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
    zero_segments = np.flatnonzero(length <= tolerances.ON_OUTLINE * assembly.size)
    if not zero_segments.size:
        return np.asarray(step[0] / length[0])
    if entry.kind != "pin":
        names = ["from", *(f"through[{k}]" for k in range(len(entry.through))), "to"]
        first, second = names[zero_segments[0]], names[zero_segments[0] + 1]
        raise InputError(where, f'"{first}" and "{second}" are the same point', "points apart from each other")
    faces = assembly.interfaces
    between = faces.between(*elements.tolist())
    if not between.size:
        first, second = (assembly.elements.ids[k] for k in elements)
        problem = f"both ends are the same point, and {first!r} and {second!r} share no face"
        raise InputError(where, problem, "two points, which give the axis of the pin")
    distance = np.array([distance_from_face(faces, face, points[0]) for face in between.tolist()])
    nearest = between[distance <= distance.min() + tolerances.ON_OUTLINE * assembly.size]
    normal = np.asarray(faces.normal[nearest] * np.where(faces.a[nearest] == elements[0], 1.0, -1.0)[:, None])
    if (normal @ normal[0] < 1.0 - tolerances.FACE).any():
        first, second = (assembly.elements.ids[k] for k in elements)
        problem = f"both ends are the same point, where faces of {first!r} and {second!r} meet at an angle"
        raise InputError(where, problem, "two points, which give the axis of the pin")
    return np.asarray(normal[0])


def _interfaces(assembly: Assembly, members: Members, rows: Ints) -> Interfaces:
    # Interfaces of members. Both sides are the first free element of a member, so that an interface never joins or
    # separates blocks. Area and sizes are 1, which makes a stress of the same number a force.
    d, support = assembly.dimension, assembly.elements.support
    owner = np.array([members.elements[k][np.argmin(support[members.elements[k]])] for k in rows], dtype=np.int64)
    axis, unit = members.axis[rows], np.ones(len(rows))
    if d == 2:
        e1, e2 = np.column_stack([-axis[:, 1], axis[:, 0]]), np.empty((len(rows), 0))
    else:
        frames = np.array([across(normal) for normal in axis]).reshape(-1, 2, 3)
        e1, e2 = frames[:, 0], frames[:, 1]
    ends = [members.points[k][[0, -1]] for k in rows]
    return Interfaces(
        a=owner,
        b=owner,
        origin=np.array([pair.mean(axis=0) for pair in ends]).reshape(-1, d),
        normal=axis,
        e1=e1,
        e2=e2,
        l1=unit,
        l2=unit,
        area=unit,
        c_t=unit if d == 3 else 0.0 * unit,
        rectangle=np.ones(len(rows), dtype=bool),
        polygon=tuple(pair if d == 2 else pair[[0, 0, 1, 1]] for pair in ends),
    )


def _strengths(members: Members, rows: Ints) -> Strengths:
    zero, infinite = np.zeros(len(rows)), np.full(len(rows), np.inf)
    dry = Side(zero, zero, zero, infinite)
    tension, compression = (members.tension - members.prestress)[rows], members.compression[rows]
    # A pin without axial capacity has no column of N; a reserve of both signs leaves its yield set an interior.
    reserve = np.where(members.axial[rows], 0.0, members.shear[rows])
    return Strengths.of(dry, Side(tension + reserve, members.shear[rows], zero, compression + reserve))


def _prestress(assembly: Assembly, members: Members) -> Floats:
    """Return forces and moments (n, q) of all prestress about the centroids of elements; zero on supports."""
    elements, d = assembly.elements, assembly.dimension
    pushes = [(members.prestress[k], *members.push(k)) for k in np.flatnonzero(members.prestress).tolist()]
    if not pushes:
        return np.zeros_like(assembly.dead)
    owner = np.concatenate([elements_of for _, elements_of, _, _ in pushes])
    arm = np.concatenate([points for _, _, points, _ in pushes]) - elements.centroid[owner]
    forces_of = np.concatenate([-prestress * forces for prestress, _, _, forces in pushes])
    loads = np.column_stack([forces_of, np.zeros((len(forces_of), assembly.freedoms - d))])
    total = resultants(len(elements), owner, loads, arm)
    total[elements.support] = 0.0
    return total
