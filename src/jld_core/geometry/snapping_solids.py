"""Snapping of polyhedra: merge corners that nearly meet, move faces into common planes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.errors import InputError
from jld_core.geometry.polyhedra import Faces
from jld_core.geometry.snapping import merge_points
from jld_core.geometry.spatial_contacts import near_pairs
from jld_core.geometry.vectors import area_vector

_FLAT: Final = 0.995
"""Cosine between normals below which two faces are not merged into one plane, whatever their size."""

_RANK: Final = 0.05
"""Relative singular value of the unit normals at a corner below which a direction stays free."""

_FAR: Final = 4.0
"""Largest displacement of a corner, in tolerances.

Beyond, the corner stays in place: its planes meet at too flat an angle to define their intersection.
"""


@dataclass(frozen=True)
class SnappedSolids:
    """Solids after snapping, in the given order; faces keep their vertex indices.

    vertices: (k, 3) of each solid. largest: largest displacement of a vertex, length. moved: number of moved vertices.
    """

    vertices: list[Floats]
    largest: float
    moved: int


def snap_solids(vertices: Sequence[Floats], faces: Sequence[Faces], tolerance: float) -> SnappedSolids:
    """Close gaps between polyhedra and make their faces plane, up to a tolerance.

    Parameters
    ----------
    vertices : sequence of (k, 3) arrays
        Vertices of each solid.
    faces : sequence of Faces
        Loops of vertex indices of each solid.
    tolerance : float
        Length, at least 0.

    Returns
    -------
    SnappedSolids
        Vertices after snapping, largest displacement and number of moved vertices.

    Raises
    ------
    InputError
        The tolerance is negative or not finite.
    """
    if not (tolerance >= 0.0 and np.isfinite(tolerance)):
        raise InputError("tolerance", f"{tolerance:g} is no length", "a length of at least 0")
    if not len(vertices):
        return SnappedSolids([], 0.0, 0)
    points = np.concatenate([np.asarray(v, dtype=float) for v in vertices])
    start = np.concatenate([[0], np.cumsum([len(v) for v in vertices])]).astype(np.int64)
    node = merge_points(points, tolerance)
    place = points[np.unique(node, return_index=True)[1]]
    loops = [
        np.array([node[start[solid] + index] for index in loop], dtype=np.int64)
        for solid, of_solid in enumerate(faces)
        for loop in of_solid
    ]
    solid = np.repeat(np.arange(len(faces)), [len(of_solid) for of_solid in faces])
    group, normal, origin = _planes(place, loops, solid, tolerance)
    place = _onto_planes(place, loops, group, normal, origin, tolerance)
    moved = place[node]
    shift = np.linalg.norm(moved - points, axis=1)
    solids = [moved[a:b] for a, b in itertools.pairwise(start)]
    return SnappedSolids(solids, float(shift.max(initial=0.0)), int(np.count_nonzero(shift)))


def _planes(place: Floats, loops: list[Ints], solid: Ints, tolerance: float) -> tuple[Ints, Floats, Floats]:
    """Group faces that lie in one plane within the tolerance.

    place: (n, 3) positions of the nodes. loops: nodes of each face. solid: (faces,) solid of each face. The results are
    the plane (faces,) of each face, and normal (p, 3) and point (p, 3) of each plane, those of its largest face. The
    plane is −1 for faces that are not plane themselves.
    """
    vector = np.zeros((len(loops), 3))
    middle = np.zeros((len(loops), 3))
    lower, upper = np.zeros((len(loops), 3)), np.zeros((len(loops), 3))
    stacks = _stacked(loops)
    for which, stack in stacks:
        corners = place[stack]
        vector[which] = area_vector(corners)
        middle[which], lower[which], upper[which] = corners.mean(axis=1), corners.min(axis=1), corners.max(axis=1)
    area = np.linalg.norm(vector, axis=1)
    normal = vector / np.where(area == 0.0, 1.0, area)[:, None]
    size, row = np.zeros(len(loops), dtype=np.int64), np.zeros(len(loops), dtype=np.int64)
    for number, (which, _) in enumerate(stacks):
        size[which], row[which] = number, np.arange(len(which))

    def farthest(faces: Ints, planes: Ints) -> Floats:
        """Return the largest distance of the corners of faces (p,) from the planes of other faces (p,)."""
        found = np.zeros(len(faces))
        for number, (_, stack) in enumerate(stacks):
            mine = np.flatnonzero(size[faces] == number)
            arm = place[stack[row[faces[mine]]]] - middle[planes[mine], None]
            found[mine] = np.abs(np.einsum("nki,ni->nk", arm, normal[planes[mine]])).max(axis=1, initial=0.0)
        return found

    every = np.arange(len(loops))
    own = farthest(every, every)
    one, two = near_pairs(lower, upper, np.full(len(loops), tolerance))
    swap = area[one] < area[two]
    one, two = np.where(swap, two, one), np.where(swap, one, two)
    cosine = np.einsum("ij,ij->i", normal[one], normal[two])
    # Faces of two solids are opposite or continue one another; faces of one solid continue one another.
    facing = np.where(solid[one] == solid[two], cosine, np.abs(cosine))
    kept = (facing > _FLAT) & (area[two] > 0.0) & (own[one] <= tolerance)
    one, two = one[kept], two[kept]
    off = farthest(two, one)
    joined = off <= tolerance if len(off) else np.zeros(0, dtype=bool)
    order = np.argsort(-area, kind="stable")
    group = np.full(len(loops), -1)
    partners: dict[int, list[int]] = {}
    for a, b in zip(one[joined].tolist(), two[joined].tolist(), strict=True):
        partners.setdefault(a, []).append(b)
        partners.setdefault(b, []).append(a)
    origins: list[int] = []
    for seed in order.tolist():
        if group[seed] >= 0:
            continue
        # Groups grow from the largest face, and every candidate is compared with that face: chains do not drift.
        group[seed] = len(origins)
        pending = [seed]
        while pending:
            for other in partners.get(pending.pop(), ()):
                if group[other] < 0 and np.abs((place[loops[other]] - middle[seed]) @ normal[seed]).max() <= tolerance:
                    group[other] = len(origins)
                    pending.append(other)
        origins.append(seed)
    # faces that are themselves not plane within the tolerance move no corner
    group[own > tolerance] = -1
    return group, normal[origins], middle[origins]


def _stacked(loops: list[Ints]) -> list[tuple[Ints, Ints]]:
    """Stack loops of equal length: for each length, indices (n,) and loops as an array (n, k)."""
    count = np.array([len(loop) for loop in loops], dtype=np.int64)
    found = []
    for corners in np.unique(count).tolist():
        which = np.flatnonzero(count == corners)
        found.append((which, np.array([loops[k] for k in which.tolist()], dtype=np.int64).reshape(-1, corners)))
    return found


def _onto_planes(
    place: Floats, loops: list[Ints], group: Ints, normal: Floats, origin: Floats, tolerance: float
) -> Floats:
    """Move every node by the least distance onto the planes of the faces that meet in it.

    Nodes that would move further than a multiple of the tolerance stay. place: (n, 3) positions. loops: nodes of each
    face. group: (faces,) plane of each face, −1 for none. normal, origin: (p, 3) of the planes. The result is (n, 3).
    """
    count = np.array([len(loop) for loop in loops])
    node = np.concatenate(loops)
    pairs = np.unique(np.column_stack([node, np.repeat(group, count)]), axis=0)
    pairs = pairs[pairs[:, 1] >= 0]
    first = np.searchsorted(pairs[:, 0], np.arange(len(place) + 1))
    moved = place.copy()
    for k in range(len(place)):
        planes = pairs[first[k] : first[k + 1], 1]
        rows = normal[planes]
        if not len(rows):
            continue
        rest = np.einsum("ij,ij->i", origin[planes] - place[k], rows)
        step = np.linalg.pinv(rows, rcond=_RANK) @ rest
        if np.linalg.norm(step) <= _FAR * tolerance:
            moved[k] = place[k] + step
    return moved
