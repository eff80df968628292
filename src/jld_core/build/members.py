"""Conversion of a scene's members to interfaces, strengths and prestress of an assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import INNER, Assembly, Interfaces
from jld_core.errors import InputError
from jld_core.geometry import across
from jld_core.geometry.polyhedra import contains, distance_from_face
from jld_core.geometry.vectors import resultants
from jld_core.linalg.projection import summed
from jld_core.members import Members
from jld_core.scene.part import Anchor, Member
from jld_core.strengths import Side, Strengths


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
        interfaces=_joined(assembly.interfaces, _interfaces(assembly, members, varying)),
        face_strengths=assembly.face_strengths.joined(strengths),
        labels=np.append(assembly.labels, np.full(len(varying), INNER)).astype(bool),
    )


def _joined(one: Interfaces, other: Interfaces) -> Interfaces:
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
        found = [_anchored(assembly, anchor, f"{where}.{key}") for key, anchor in anchors]
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


def _anchored(assembly: Assembly, anchor: Anchor, where: str) -> tuple[int, Floats]:
    """Return the element and the point (d,) of an anchor, checked to lie inside it."""
    elements, d = assembly.elements, assembly.dimension
    if anchor.element not in elements.index:
        raise InputError(f"{where}.element", f"no element is named {anchor.element!r}", "the id of an element")
    if len(anchor.at) != d:
        raise InputError(f"{where}.at", f"it has {len(anchor.at)} numbers", f"{d} in this scene")
    index, point = elements.index[anchor.element], np.array(anchor.at, dtype=float)
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
    # Both sides are the same element, so that an interface never joins or separates blocks. Area and sizes are 1, which
    # makes a stress of the same number a force.
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
