"""What resultants on elements do not tell apart, as data: where loads act, and which values have which uncertainty."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly, Elements
from jld_core.build.assemble import cases_of_scene
from jld_core.scene import PointLoad, Scene
from jld_core.scene.cracks import FieldCracks
from jld_core.scene.loads import BodyLoad, FaceLoad, LoadEntry
from jld_core.scene.uncertain import Uncertain, UncertainVector, uncertain_values, written

# Largest difference of values that are mapped onto each other, relative to their size
_NEAR: Final = 10.0 * tolerances.SYMMETRY

Tag = tuple[Hashable, ...]
"""Facts that must be the same at the image."""


@dataclass(frozen=True)
class Mark:
    """One fact with a place, of which a symmetry needs an image.

    kind: facts that must be the same at the image. element: its index, −1 for none. items: (k, d + v) points in any
    order, with v values each. vectors: (j, d), turned with the structure. turns: (t, 1 or 3) moments.
    """

    kind: Tag
    element: int
    items: Floats
    vectors: Floats
    turns: Floats


@dataclass(frozen=True)
class Signature:
    """Facts that a symmetry must map onto themselves, beside geometry, strengths and resultants.

    elements, faces, members: tag of each. dead: marks of all cases. cases: marks of each load case.
    """

    elements: tuple[Tag, ...]
    faces: tuple[Tag, ...]
    members: tuple[Tag, ...]
    dead: tuple[Mark, ...]
    cases: tuple[tuple[Mark, ...], ...]


class Unknown(Exception):
    """A fact that no signature states: a structure with it has no known symmetry."""


def signature_of(scene: Scene, assembly: Assembly) -> Signature | None:
    """Return the signature of a scene, None where resultants and mean strengths are all that is read.

    Blocks that crack by fields read where loads act, and a reliability analysis the distribution of each value. Raises
    Unknown for facts that are not in the signature.
    """
    varying = [path for path, _ in uncertain_values(scene)]
    if not varying and not isinstance(scene.cracks, FieldCracks):
        return None
    if scene.fill is not None:
        raise Unknown("the pressure of its fill is not compared")
    if any(path[:2] == ("loads", "moving") for path in varying):
        raise Unknown("distributions of moving loads are not compared")
    elements = assembly.elements
    placed = cases_of_scene(scene, elements)
    dead = _marks(scene.loads.dead, elements)
    if placed:
        cases = tuple(_marks([*one.case.dead], elements) + _marks(one.case.live, elements, "live") for one in placed)
    else:
        cases = (_marks(scene.loads.live or [], elements, "live"),)
    weights: list[Tag] = [() for _ in range(len(elements))]
    strengths: list[Tag] = [() for _ in range(assembly.faces)]
    if varying:
        for k, entry in enumerate(scene.elements or []):
            weights[k] = (_text([entry.weight, entry.density]),)
        strengths = _tags_of_faces(scene, assembly)
    members = [(_text([one.tension, one.compression, one.prestress, one.shear]),) for one in scene.members]
    return Signature(tuple(weights), tuple(strengths), tuple(members), dead, cases)


def _tags_of_faces(scene: Scene, assembly: Assembly) -> list[Tag]:
    """Return for each face which entry of the scene gives its strengths, with all distributions."""
    stated: dict[frozenset[str], set[str]] = {}
    for entry in scene.materials.faces:
        stated.setdefault(frozenset(entry.between), set()).add(
            json.dumps(entry.model_dump(mode="json", exclude={"between"}), sort_keys=True)
        )
    for contact in scene.interfaces or []:
        own = contact.model_dump(mode="json", exclude={"elements", "polygon", "label"}, exclude_none=True)
        stated.setdefault(frozenset(contact.elements), set()).add(json.dumps(own, sort_keys=True))
    ids, faces = assembly.elements.ids, assembly.interfaces
    tags: list[Tag] = []
    for a, b in zip(faces.a[: assembly.faces].tolist(), faces.b[: assembly.faces].tolist(), strict=True):
        texts = stated.get(frozenset((ids[a], ids[b])), set())
        if len(texts) > 1:
            raise Unknown(f"faces between {ids[a]!r} and {ids[b]!r} have strengths of their own")
        tags.append(tuple(texts))
    return tags


def _text(values: Iterable[Any]) -> str:
    """Return values with their distributions as a text."""
    return json.dumps([written(value) for value in values], sort_keys=True)


def _marks(entries: Sequence[LoadEntry], elements: Elements, kind: str = "dead") -> tuple[Mark, ...]:
    """Return the marks of load entries; raise Unknown for a load that is not known here."""
    d = elements.centroid.shape[1]
    none, still = np.empty((0, d)), np.empty((0, 1 if d == 2 else 3))
    marks: list[Mark] = []

    def add(tag: Tag, element: int, items: Any, vectors: Any = none, turns: Any = still) -> None:
        """Add the mark of a fact, and one for each component of its vector that has a distribution."""
        size: Tag = ()
        if isinstance(vectors, UncertainVector):
            size = (vectors.size.cov, vectors.size.kind)
        mean = np.array(vectors, dtype=float).reshape(-1, d)
        places = np.atleast_2d(np.array(items, dtype=float))
        marks.append(
            Mark((kind, *tag, *size), element, places, mean, np.array(turns, dtype=float).reshape(-1, still.shape[1]))
        )
        for axis, component in enumerate(vectors):
            if isinstance(component, Uncertain):
                along = (mean[0, axis] * np.eye(d)[axis])[None]
                marks.append(Mark((kind, "component", component.cov, component.kind), element, places, along, still))

    for entry in entries:
        if isinstance(entry, BodyLoad):
            add(("body",), -1, np.empty((0, d)), entry.body)
        elif isinstance(entry, PointLoad):
            k = elements.index[entry.element]
            place = [*(entry.at or elements.centroid[k].tolist()), entry.width or 0.0]
            moments = entry.moment if isinstance(entry.moment, list) else [entry.moment] * (still.shape[1])
            if len(moments) > 1 and any(isinstance(one, Uncertain) for one in moments):
                raise Unknown("distributions of spatial moments are not compared")
            add(("point", entry.width is None, *_spread(moments[0])), k, [place], entry.force or none, moments)
        elif isinstance(entry, FaceLoad):
            for tag, element, items, vector in _of_face(entry, elements):
                add(tag, element, items, vector)
        else:
            raise Unknown("loads on fill are not compared")
    return tuple(marks)


def _of_face(entry: FaceLoad, elements: Elements) -> list[tuple[Tag, int, Floats, Any]]:
    """Return kind, element, points with pressures, and vector of each part of a load on faces."""
    first, last = entry.ends
    spread: Tag = _spread(entry.pressure)
    if isinstance(entry.pressure, list) and any(isinstance(one, Uncertain) for one in entry.pressure):
        raise Unknown("distributions of linear pressures are not compared")
    vector = entry.line or entry.traction or np.empty((0, elements.centroid.shape[1]))
    if entry.face.between is not None:
        k = elements.index[entry.face.between[0]]
        return [(("between", *spread), k, np.array([[*elements.centroid[k], first, last]]), vector)]
    points = np.array(entry.face.along or entry.face.patch, dtype=float)
    if entry.face.patch is not None:
        return [(("patch", *spread), -1, np.column_stack([points, np.full(len(points), first)]), vector)]
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    items = np.column_stack([points, first + (last - first) * length / length[-1]])
    return [(("along", *spread), -1, items[k : k + 2], vector) for k in range(len(points) - 1)]


def _spread(value: Any) -> Tag:
    """Return the distribution of a number; () of one without."""
    return (value.cov, value.kind) if isinstance(value, Uncertain) else ()


def same_tags(tags: tuple[Tag, ...], to: Ints) -> bool:
    """Return True if each tag is that of its image; further images, which have no tag, are left out."""
    return all(tags[k] == tags[image] for k, image in enumerate(to[: len(tags)].tolist()) if image < len(tags))


def same_marks(
    marks: tuple[Mark, ...], images: tuple[Mark, ...], to: Ints, matrix: Floats, centre: Floats, reach: float
) -> bool:
    """Return True if marks are mapped one to one: elements by `to`, points by a matrix (d, d) about `centre`."""
    if len(marks) != len(images):
        return False
    left = list(range(len(images)))
    for mark in marks:
        image = next((k for k in left if _is_image(mark, images[k], to, matrix, centre, reach)), None)
        if image is None:
            return False
        left.remove(image)
    return True


def _is_image(mark: Mark, image: Mark, to: Ints, matrix: Floats, centre: Floats, reach: float) -> bool:
    """Return True if a mark is mapped onto another one."""
    element = -1 if mark.element < 0 else int(to[mark.element])
    if mark.kind != image.kind or element != image.element or mark.items.shape != image.items.shape:
        return False
    d = len(centre)
    reflect = float(np.linalg.det(matrix))
    turn = np.array([[reflect]]) if d == 2 else reflect * matrix
    for values, there, map_ in ((mark.vectors, image.vectors, matrix), (mark.turns, image.turns, turn)):
        if values.shape != there.shape or abs(values @ map_.T - there).max(initial=0.0) > _NEAR * _size(values, there):
            return False
    moved = (mark.items[:, :d] - centre) @ matrix.T + centre
    near = np.linalg.norm(moved[:, None] - image.items[None, :, :d], axis=2) <= 2.0 * reach
    values, there = mark.items[:, d:], image.items[:, d:]
    near &= (abs(values[:, None] - there[None]) <= _NEAR * _size(values, there)).all(axis=2)
    return bool(near.any(axis=0).all() and near.any(axis=1).all())


def _size(one: Floats, other: Floats) -> float:
    """Return the largest magnitude in two arrays."""
    return max(float(abs(one).max(initial=0.0)), float(abs(other).max(initial=0.0)))
