"""Find the symmetries of a scene: isometries that map labellings onto equivalent ones."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, Elements, Interfaces, faces_of
from jld_core.build import cases_of_scene
from jld_core.errors import InputError
from jld_core.geometry.vectors import frame
from jld_core.mechanics.criteria import maps_criteria
from jld_core.scene import PointLoad
from jld_core.scene.cracks import CellCracks, FieldCracks
from jld_core.scene.loads import BodyLoad, FaceLoad, LoadEntry, TiltLoad
from jld_core.scene.schema import Scene
from jld_core.scene.uncertain import Uncertain, UncertainVector, uncertain_values, written

if TYPE_CHECKING:
    from jld_core.refinement.refine import CrackCells


# Largest difference of values that are mapped onto each other, relative to their size
_NEAR: Final = 10.0 * tolerances.SYMMETRY

Tag = tuple[Hashable, ...]  # facts that must be the same at the image


@dataclass(frozen=True)
class Mark:
    """One fact with a place, of which a symmetry needs an image."""

    kind: Tag  # facts that must be the same at the image
    element: int  # its index, −1 for none
    items: Floats  # (k, d + v) points in any order, with v values each
    vectors: Floats  # (j, d), turned with the structure
    turns: Floats  # (t, 1 or 3) moments


@dataclass(frozen=True)
class Signature:
    """Facts that a symmetry must map onto themselves, beside geometry, strengths and resultants."""

    # elements, faces, members: tag of each
    elements: tuple[Tag, ...]
    faces: tuple[Tag, ...]
    members: tuple[Tag, ...]
    dead: tuple[Mark, ...]  # marks of all cases
    cases: tuple[tuple[Mark, ...], ...]  # marks of each load case


class Unknown(Exception):
    """A fact that no signature states: a structure with it has no known symmetry."""


def signature_of(scene: Scene, assembly: Assembly) -> Signature | None:
    """Return the signature of a scene, None where resultants and mean strengths are all that is read."""
    # Blocks that crack by fields read where loads act, and a reliability analysis the distribution of each value.
    varying = [path for path, _ in uncertain_values(scene)]
    if not varying and not isinstance(scene.cracks, FieldCracks):
        return None
    if scene.fill is not None:
        raise Unknown("the pressure of its fill is not compared")
    if any(path[:2] == ("loads", "moving") for path in varying):
        raise Unknown("distributions of moving loads are not compared")
    elements = assembly.elements
    scene_cases = cases_of_scene(scene, elements)
    dead = _marks(scene.loads.dead, elements)
    if scene_cases:
        cases = tuple(
            _marks([*placed.case.dead], elements) + _marks(placed.case.live, elements, "live") for placed in scene_cases
        )
    else:
        cases = (_marks(scene.loads.live or [], elements, "live"),)
    weights: list[Tag] = [() for _ in range(len(elements))]
    strengths: list[Tag] = [() for _ in range(assembly.faces)]
    if varying:
        for k, entry in enumerate(scene.elements or []):
            weights[k] = (_text([entry.weight, entry.density]),)
        strengths = _tags_of_faces(scene, assembly)
    members = [
        (_text([member.tension, member.compression, member.prestress, member.shear]),) for member in scene.members
    ]
    return Signature(tuple(weights), tuple(strengths), tuple(members), dead, cases)


def _tags_of_faces(scene: Scene, assembly: Assembly) -> list[Tag]:
    """Return for each face which entry of the scene gives its strengths, with all distributions."""
    texts_of: dict[frozenset[str], set[str]] = {}
    for entry in scene.materials.faces:
        texts_of.setdefault(frozenset(entry.between), set()).add(
            json.dumps(entry.model_dump(mode="json", exclude={"between"}), sort_keys=True)
        )
    for contact in scene.interfaces or []:
        strengths = contact.model_dump(mode="json", exclude={"elements", "polygon", "label"}, exclude_none=True)
        texts_of.setdefault(frozenset(contact.elements), set()).add(json.dumps(strengths, sort_keys=True))
    ids, faces = assembly.elements.ids, assembly.interfaces
    tags: list[Tag] = []
    for a, b in zip(faces.a[: assembly.faces].tolist(), faces.b[: assembly.faces].tolist(), strict=True):
        texts = texts_of.get(frozenset((ids[a], ids[b])), set())
        if len(texts) > 1:
            raise Unknown(f"faces between {ids[a]!r} and {ids[b]!r} have strengths of their own")
        tags.append(tuple(texts))
    return tags


def _text(values: Iterable[Any]) -> str:
    return json.dumps([written(value) for value in values], sort_keys=True)


def _marks(entries: Sequence[LoadEntry], elements: Elements, kind: str = "dead") -> tuple[Mark, ...]:
    """Return the marks of load entries; raise Unknown for a load that is not known here."""
    d = elements.centroid.shape[1]
    no_vectors, still = np.empty((0, d)), np.empty((0, 1 if d == 2 else 3))
    marks: list[Mark] = []

    def add(tag: Tag, element: int, items: Any, vectors: Any = no_vectors, turns: Any = still) -> None:
        """Add the mark of a fact, and one for each component of its vector that has a distribution."""
        size: Tag = ()
        if isinstance(vectors, UncertainVector):
            size = (vectors.size.cov, vectors.size.kind)
        mean = np.array(vectors, dtype=float).reshape(-1, d)
        rows = np.atleast_2d(np.array(items, dtype=float))
        marks.append(
            Mark((kind, *tag, *size), element, rows, mean, np.array(turns, dtype=float).reshape(-1, still.shape[1]))
        )
        for axis, component in enumerate(vectors):
            if isinstance(component, Uncertain):
                along = (mean[0, axis] * np.eye(d)[axis])[None]
                marks.append(Mark((kind, "component", component.cov, component.kind), element, rows, along, still))

    for entry in entries:
        if isinstance(entry, BodyLoad | TiltLoad):
            add(("body",), -1, np.empty((0, d)), entry.body)
        elif isinstance(entry, PointLoad):
            k = elements.index[entry.element]
            point = [*(entry.at or elements.centroid[k].tolist()), entry.width or 0.0]
            moments = entry.moment if isinstance(entry.moment, list) else [entry.moment] * (still.shape[1])
            if len(moments) > 1 and any(isinstance(moment, Uncertain) for moment in moments):
                raise Unknown("distributions of spatial moments are not compared")
            add(("point", entry.width is None, *_spread(moments[0])), k, [point], entry.force or no_vectors, moments)
        elif isinstance(entry, FaceLoad):
            for tag, element, items, vector in _of_face(entry, elements):
                add(tag, element, items, vector)
        else:
            raise Unknown("loads on fill are not compared")
    return tuple(marks)


def _of_face(entry: FaceLoad, elements: Elements) -> list[tuple[Tag, int, Floats, Any]]:
    """Return kind, element, points with pressures, and vector of each part of a load on faces."""
    first, last = entry.ends  # pressures
    spread: Tag = _spread(entry.pressure)
    if isinstance(entry.pressure, list) and any(isinstance(pressure, Uncertain) for pressure in entry.pressure):
        raise Unknown("distributions of linear pressures are not compared")
    vector = entry.line or entry.traction or np.empty((0, elements.centroid.shape[1]))
    if entry.face.between is not None:
        k = elements.index[entry.face.between[0]]  # the other one is "outside"
        return [(("between", *spread), k, np.array([[*elements.centroid[k], first, last]]), vector)]
    points = np.array(entry.face.along or entry.face.patch, dtype=float)
    if entry.face.patch is not None:
        return [(("patch", *spread), -1, np.column_stack([points, np.full(len(points), first)]), vector)]
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    loaded = np.column_stack([points, first + (last - first) * length / length[-1]])
    # segment by segment, as a symmetry may reverse the points of "along"
    return [(("along", *spread), -1, loaded[k : k + 2], vector) for k in range(len(points) - 1)]


def _spread(value: Any) -> Tag:
    return (value.cov, value.kind) if isinstance(value, Uncertain) else ()


def same_tags(tags: tuple[Tag, ...], to: Ints) -> bool:
    """Return whether each tag is that of its image; further images, without tags, are left out."""
    return all(tags[k] == tags[image] for k, image in enumerate(to[: len(tags)].tolist()) if image < len(tags))


def same_marks(
    marks: tuple[Mark, ...], images: tuple[Mark, ...], to: Ints, matrix: Floats, centre: Floats, reach: float
) -> bool:
    """Return whether marks are mapped one to one: elements by `to`, points by a matrix about `centre`."""
    if len(marks) != len(images):
        return False
    unmatched = list(range(len(images)))
    for mark in marks:
        image = next((k for k in unmatched if _is_image(mark, images[k], to, matrix, centre, reach)), None)
        if image is None:
            return False
        unmatched.remove(image)
    return True


def _is_image(mark: Mark, image: Mark, to: Ints, matrix: Floats, centre: Floats, reach: float) -> bool:
    """Return whether a mark is mapped onto another one, within `reach`."""
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


def _size(first: Floats, second: Floats) -> float:
    return max(float(abs(first).max(initial=0.0)), float(abs(second).max(initial=0.0)))


_ANGLE: Final = 10.0 * tolerances.SYMMETRY  # largest difference of unit vectors that are mapped onto each other
_FEW: Final = 200  # largest number of points whose distances are all computed; a tree of points takes 0.07 s to import


@dataclass(frozen=True)
class SymmetryGroup:
    """Isometries that map the scene onto itself, the identity first; each permutes faces differently."""

    matrices: Floats  # (g, d, d) orthogonal matrices about the mean of the elements' centroids
    elements: Ints  # (g, n) element onto which each element is mapped
    faces: Ints  # (g, m) face onto which each face is mapped

    def __len__(self) -> int:
        return len(self.faces)


def symmetry_group(
    assembly: Assembly, scene: Scene, candidates: Bools, fixed: Bits, *, unknown: str = ""
) -> SymmetryGroup:
    """Find the group that `search.symmetry` requests; InputError for a "mirror-x" that is not there."""
    d, n, m = assembly.dimension, len(assembly.elements), len(assembly.interfaces)
    identity = (np.eye(d), np.arange(n), np.arange(m))
    isometries = [identity]
    requested = scene.search.symmetry
    if requested != "none":
        mirror = np.diag([-1.0] + [1.0] * (d - 1))
        try:
            signature = signature_of(scene, assembly)
        except Unknown as reason:
            unknown = unknown or str(reason)
        if unknown:
            images: list[tuple[Floats, tuple[Ints, Ints] | str]] = [(mirror, unknown)]
        else:
            trial = _IsometryTest(assembly, scene, candidates, fixed, signature)
            possible = [mirror] if requested == "mirror-x" else _possible_matrices(assembly)
            images = [(matrix, trial.image(matrix)) for matrix in possible]
        for matrix, image in images:
            if not isinstance(image, str):
                isometries.append((matrix, *image))
            elif requested == "mirror-x":
                raise InputError("search.symmetry", f"the scene has no mirror-x symmetry: {image}", '"auto" or "none"')
    matrices, elements, faces = (np.array(part) for part in zip(*isometries, strict=True))
    # Isometries with the same effect on faces count once (a mirror through a column of single cells).
    first = np.sort(np.unique(faces, axis=0, return_index=True)[1])
    return SymmetryGroup(matrices[first], elements[first], faces[first])


def _possible_matrices(assembly: Assembly) -> list[Floats]:
    """Return orthogonal matrices (d, d) that may map the assembly onto itself."""
    # Matrices follow from the possible images of the rarest elements. The identity is left out.
    elements, d = assembly.elements, assembly.dimension
    reach = tolerances.SYMMETRY * assembly.size
    points, kind = elements.centroid - elements.centroid.mean(axis=0), _kinds(assembly)
    if np.linalg.matrix_rank(points, tol=1e-3 * assembly.size) < d - 1:
        points = np.concatenate(elements.shape) - elements.centroid.mean(axis=0)
        kind = np.repeat(kind, [len(s) for s in elements.shape])
    radius = np.linalg.norm(points, axis=1)
    # Elements of one kind and equal distance from the centre may be images of each other; sort them together.
    order = np.lexsort((radius, kind))
    key = (radius + 4.0 * radius.max() * kind)[order]
    first, last = np.searchsorted(key, key - reach, "left"), np.searchsorted(key, key + reach, "right")
    alike = np.empty(len(points), dtype=np.int64)
    alike[order] = last - first
    rank_of = np.empty(len(points), dtype=np.int64)
    rank_of[order] = np.arange(len(points))
    # An anchor near the centre would amplify rounding; the rarest of the others has the fewest images.
    rarest = np.lexsort((-radius, alike + len(points) * (radius < 1e-3 * radius.max())))
    anchors = [int(rarest[0])]
    if d == 3:
        distance = np.linalg.norm(np.cross(points[rarest], points[anchors[0]]), axis=1)
        limit = 1e-3 * radius.max() * radius[anchors[0]]
        anchors.append(int(rarest[np.flatnonzero(distance > limit)[0]]))
    base = frame(points[anchors])
    images_of_anchors = [np.sort(order[first[rank_of[anchor]] : last[rank_of[anchor]]]) for anchor in anchors]
    matrices = []
    for images in np.stack(np.meshgrid(*images_of_anchors, indexing="ij"), axis=-1).reshape(-1, d - 1):
        gram = points[images] @ points[images].T - points[anchors] @ points[anchors].T
        if abs(gram).max() > 4.0 * reach * radius.max():
            continue
        for last_sign in (1.0, -1.0):
            matrix = frame(points[images]).T @ np.diag([1.0] * (d - 1) + [last_sign]) @ base
            near = np.round(matrix)
            matrix = near if abs(matrix - near).max() < reach / radius.max() else matrix
            if abs(matrix - np.eye(d)).max() > 1e-6:
                matrices.append(matrix)
    return matrices


def _kinds(assembly: Assembly) -> Ints:
    """Return (n,) kind of each element: equal volume, number of corners and support flag."""
    elements = assembly.elements
    order = np.argsort(elements.volume, kind="stable")
    volume = elements.volume[order]
    # Volumes that differ only by rounding are equal; a larger step begins a new kind.
    step = np.diff(volume, prepend=volume[:1]) > 10.0 * tolerances.SYMMETRY * volume
    size = np.empty(len(volume), dtype=np.int64)
    size[order] = np.cumsum(step)
    corners = np.array([len(s) for s in elements.shape])
    table = np.column_stack([size, corners, elements.support])
    return np.asarray(np.unique(table, axis=0, return_inverse=True)[1].reshape(-1), dtype=np.int64)


class _IsometryTest:
    """Test of isometries on one scene; finer cells are computed once a matrix maps the joint grid."""

    def __init__(
        self, assembly: Assembly, scene: Scene, candidates: Bools, fixed: Bits, signature: Signature | None
    ) -> None:
        self._assembly, self._scene, self._signature = assembly, scene, signature
        self._candidates, self._fixed = candidates[: assembly.faces], fixed[: assembly.faces]
        self._cells: CrackCells | None = None

    def image(self, matrix: Floats) -> tuple[Ints, Ints] | str:
        """Return the images of elements (n,) and faces (m,) under a matrix (d, d), or a reason for none."""
        assembly, search = self._assembly, self._scene.search
        centre = assembly.elements.centroid.mean(axis=0)
        if search.block_extent != [None, None] and abs(matrix).max(axis=1).min() < 1.0 - 1e-9:
            return "it turns the bounding boxes that block_extent limits"
        image = _image(assembly, matrix, centre, self._signature)
        if isinstance(image, str):
            return image
        to, face_to = image
        excepted = np.isin(assembly.elements.ids, search.except_)
        if np.any(excepted[to] != excepted):
            return "its elements that limits except are not mapped onto themselves"
        candidates, fixed, of_faces = self._candidates, self._fixed, face_to[: assembly.faces]
        if np.any(candidates[of_faces] != candidates) or np.any((fixed[of_faces] != fixed) & ~candidates):
            return "its candidates and fixed labels are not mapped onto themselves"
        return self._of_cells(matrix, centre, of_faces) or image

    def _of_cells(self, matrix: Floats, centre: Floats, face_to: Ints) -> str:
        """Return why the finer cells are not mapped as the faces of the joint grid are, else ""."""
        cracks, base = self._scene.cracks, self._assembly
        if not isinstance(cracks, CellCracks):
            return ""
        if self._cells is None:
            from jld_core.refinement import crack_cells

            self._cells = crack_cells(self._scene, base, cracks.cell)
        cells = self._cells
        if cells.fine is base:
            return ""
        image = _image(cells.fine, matrix, centre, None)
        if isinstance(image, str):
            return f"of the cells along which blocks crack: {image}"
        of = cells.face[: cells.fine.faces]
        if np.array_equal(of[image[1][: len(of)]], np.where(of >= 0, face_to[np.maximum(of, 0)], -1)):
            return ""
        return "its joints are not mapped as the cells along which blocks crack"


def _image(assembly: Assembly, matrix: Floats, centre: Floats, signature: Signature | None) -> tuple[Ints, Ints] | str:
    """Return the images of elements (n,) and interfaces (m,) under a matrix about `centre`, or a reason."""
    # The reason is a text that names the first property that is not mapped onto itself.
    with_members, assembly = assembly, faces_of(assembly)
    elements, faces = assembly.elements, assembly.interfaces
    reach = tolerances.SYMMETRY * assembly.size
    moved = (elements.centroid - centre) @ matrix.T + centre
    kind = _kinds(assembly)
    to = _nearest(moved, elements.centroid, kind, kind, reach)
    if to is None or not _same_corners(elements.shape, to, matrix, centre, reach):
        return "its elements are not mapped onto elements of the same shape"
    weight = np.where(elements.support[:, None], 0.0, elements.weight)
    if abs(weight @ matrix.T - weight[to]).max() > tolerances.SYMMETRY * np.linalg.norm(weight, axis=1).max():
        return "its weights are not mapped onto themselves"
    if not _same_loads(assembly, signature, to, matrix, centre, reach):
        return "its loads are not mapped onto themselves"
    count = len(elements)
    pair = np.minimum(faces.a, faces.b) * count + np.maximum(faces.a, faces.b)
    pair_to = np.minimum(to[faces.a], to[faces.b]) * count + np.maximum(to[faces.a], to[faces.b])
    moved = (faces.origin - centre) @ matrix.T + centre
    names, number = np.unique(pair, return_inverse=True)
    number_to = np.minimum(np.searchsorted(names, pair_to), len(names) - 1)
    if not np.array_equal(names[number_to], pair_to):
        return "its interfaces are not mapped onto interfaces"
    face_to = _nearest(moved, faces.origin, number_to, number, reach)
    if face_to is None or not _same_corners(faces.polygon, face_to, matrix, centre, reach):
        return "its interfaces are not mapped onto interfaces"
    sign = np.where(faces.a[face_to] == to[faces.a], 1.0, -1.0)[:, None]
    if abs(faces.normal @ matrix.T - sign * faces.normal[face_to]).max(initial=0.0) > _ANGLE:
        return "its interfaces are not mapped onto interfaces"
    if assembly.dimension == 3 and not _same_axes(faces, face_to, matrix):
        return "the axes of its faces are not mapped onto themselves"
    table = assembly.face_strengths.table()
    if not np.array_equal(table[face_to], table, equal_nan=True):
        return "its strengths are not mapped onto themselves"
    if not maps_criteria(assembly, face_to, matrix):
        return "its yield criteria are not mapped onto themselves"
    if signature is not None and not (same_tags(signature.elements, to) and same_tags(signature.faces, face_to)):
        return "distributions of its values are not mapped onto themselves"
    members_to = _image_of_members(with_members, signature, to, matrix, centre, reach)
    if members_to is None:
        return "its members are not mapped onto themselves"
    return to, np.concatenate([face_to, members_to])


def _same_axes(faces: Interfaces, to: Ints, matrix: Floats) -> bool:
    """Return whether the axes of bending of spatial faces are mapped onto axes of equal sizes."""
    # The axes of a face without a preferred direction may be an arbitrary choice, which its yield set reads.
    e1, e2 = faces.e1 @ matrix.T, faces.e2 @ matrix.T
    near = 10.0 * tolerances.SYMMETRY * np.maximum(faces.l1, faces.l2)
    same = np.ones(len(to), dtype=bool)
    swapped = same.copy()
    for length, axis, other in ((faces.l1, e1, "1"), (faces.l2, e2, "2")):
        for chosen, name in ((same, other), (swapped, "2" if other == "1" else "1")):
            there, size = getattr(faces, f"e{name}")[to], getattr(faces, f"l{name}")[to]
            turned = np.linalg.norm(np.cross(axis, there), axis=1)
            chosen &= (turned <= _ANGLE) & (abs(length - size) <= near)
    return bool((same | swapped).all() and (abs(faces.c_t[to] - faces.c_t) <= near).all())


def _image_of_members(
    assembly: Assembly, signature: Signature | None, to: Ints, matrix: Floats, centre: Floats, reach: float
) -> Ints | None:
    """Return the image of each face of members under a motion of elements `to`, or None."""
    members = assembly.members
    tags = () if signature is None else signature.members
    strengths = assembly.face_strengths.table()
    table = np.column_stack([members.axial, members.prestress])

    def alike(k: int, j: int) -> bool:
        """Return whether two members have the same kind, numbers and strengths."""
        face, other = int(members.face[k]), int(members.face[j])
        return bool(
            members.kinds[j] == members.kinds[k]
            and np.array_equal(table[j], table[k])
            and (face < 0) == (other < 0)
            and len(members.elements[j]) == len(members.elements[k])
            and tags[k : k + 1] == tags[j : j + 1]
            and (face < 0 or not np.any(strengths[face] != strengths[other]))
        )

    def maps_to(k: int, j: int) -> bool:
        """Return whether the motion takes member k to member j, in either sense."""
        images, axis = to[members.elements[k]], matrix @ members.axis[k]
        points = (members.points[k] - centre) @ matrix.T + centre
        for step in (1, -1):
            turned = float(abs(axis - step * members.axis[j]).max()) if members.kinds[k] == "pin" else 0.0
            same_elements = np.array_equal(members.elements[j][::step], images)
            if same_elements and abs(members.points[j][::step] - points).max() <= reach and turned <= _ANGLE:
                return True
        return False

    image = np.arange(assembly.faces, len(assembly.interfaces))
    free = list(range(len(members)))
    for k in range(len(members)):
        target = next((j for j in free if alike(k, j) and maps_to(k, j)), None)
        if target is None:
            return None
        free.remove(target)
        if members.face[k] >= 0:
            image[members.face[k] - assembly.faces] = members.face[target]
    return image


def _nearest(moved: Floats, points: Floats, moved_kind: Ints, kind: Ints, reach: float) -> Ints | None:
    """Return the point (n,) of equal kind within `reach` of each moved point; None unless every one has its own."""
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    # An additional coordinate separates kinds by more than the distance of any two points.
    gap = 4.0 * max(float(np.ptp(points, axis=0).max()), reach)
    sources, targets = (np.column_stack([points, gap * kind]), np.column_stack([moved, gap * moved_kind]))
    if len(points) <= _FEW:
        distances = np.linalg.norm(targets[:, None] - sources[None], axis=2)
        to, distance = distances.argmin(axis=1), distances.min(axis=1)
    else:
        from scipy.spatial import cKDTree

        distance, to = cKDTree(sources).query(targets, distance_upper_bound=2.0 * reach)
    fits = np.all(distance <= reach) and len(np.unique(to)) == len(points)
    return np.asarray(to, dtype=np.int64) if fits else None


def _same_corners(shapes: tuple[Floats, ...], to: Ints, matrix: Floats, centre: Floats, reach: float) -> bool:
    """Return whether each moved shape has the corners of its image, in any order, to twice `reach`."""
    corners = np.array([len(s) for s in shapes])
    if np.any(corners != corners[to]):
        return False
    for size in np.unique(corners):
        group = np.flatnonzero(corners == size)
        moved = (np.array([shapes[i] for i in group]) - centre) @ matrix.T + centre
        there = np.array([shapes[i] for i in to[group]])
        near = np.linalg.norm(moved[:, :, None] - there[:, None], axis=3) <= 2.0 * reach
        if not (near.any(axis=1).all() and near.any(axis=2).all()):
            return False
    return True


def _same_loads(
    assembly: Assembly, signature: Signature | None, to: Ints, matrix: Floats, centre: Floats, reach: float
) -> bool:
    """Return whether every load case maps one to one onto a case of equal required factor."""
    cases, required = assembly.by_case, assembly.required
    if signature is not None and not same_marks(signature.dead, signature.dead, to, matrix, centre, reach):
        return False

    def is_image(k: int, j: int) -> bool:
        if required[k] != required[j] or not _falls_on(cases[k], cases[j], to, matrix):
            return False
        return signature is None or same_marks(signature.cases[k], signature.cases[j], to, matrix, centre, reach)

    unmatched = list(range(len(cases)))
    for k in range(len(cases)):
        image = next((j for j in unmatched if is_image(k, j)), None)
        if image is None:
            return False
        unmatched.remove(image)
    return True


def _falls_on(case: Assembly, image: Assembly, to: Ints, matrix: Floats) -> bool:
    """Return whether the dead and live loads of one case map onto those of another."""
    d = case.dimension
    reflect = np.linalg.det(matrix)
    turn = np.array([[reflect]]) if d == 2 else reflect * matrix
    for loads, target in ((case.dead, image.dead), (case.live, image.live)):
        total = np.linalg.norm(loads[:, :d], axis=1).sum() + np.linalg.norm(loads[:, d:], axis=1).sum() / case.size
        for columns, turning, arm in ((slice(0, d), matrix, 1.0), (slice(d, None), turn, case.size)):
            if (
                abs(loads[:, columns] @ turning.T - target[to][:, columns]).max(initial=0.0)
                > 10.0 * tolerances.SYMMETRY * total * arm
            ):
                return False
    return True
