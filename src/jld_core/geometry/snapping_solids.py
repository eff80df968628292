"""Snapping of polyhedra: merge corners that nearly meet, move faces into common planes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import InputError
from jld_core.geometry.merging import merge_points
from jld_core.geometry.polyhedra import Faces, lay_out
from jld_core.geometry.spatial_contacts import near_pairs
from jld_core.geometry.vectors import area_vector
from jld_core.linalg import components

_FLAT: Final = 0.995  # cosine between normals below which two faces are not merged into one plane, whatever their size

_RANK: Final = 0.05  # relative singular value of the unit normals at a corner below which a direction stays free

# Largest displacement of a corner, in tolerances. Beyond, the corner stays in place: its planes meet at too flat an
# angle to define their intersection.
_FAR: Final = 4.0


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
    surface = lay_out([np.asarray(v, dtype=float) for v in vertices], list(faces))
    points = surface.points
    start = np.concatenate([[0], np.cumsum([len(v) for v in vertices])]).astype(np.int64)
    node = merge_points(points, tolerance)
    place = points[np.unique(node, return_index=True)[1]]
    loops = _Loops(node[surface.vertex], surface.start, surface.count)
    group, normal, origin = _planes(place, loops, surface.element, tolerance)
    place = _onto_planes(place, loops, group, normal, origin, tolerance)
    moved = place[node]
    shift = np.linalg.norm(moved - points, axis=1)
    solids = [moved[a:b] for a, b in itertools.pairwise(start)]
    return SnappedSolids(solids, float(shift.max(initial=0.0)), int(np.count_nonzero(shift)))


@dataclass(frozen=True)
class _Loops:
    """Nodes of all faces in one array, face after face.

    node: (c,) node of each corner. start, count: (faces,) first corner and number of corners of each face.
    """

    node: Ints
    start: Ints
    count: Ints

    def __len__(self) -> int:
        return len(self.count)

    def of(self, face: int) -> Ints:
        """Return the nodes (k,) of one face."""
        return self.node[self.start[face] : self.start[face] + self.count[face]]

    def stacks(self) -> list[tuple[Ints, Ints]]:
        """Stack faces of equal numbers of corners k: for each k, indices (n,) and nodes (n, k)."""
        chosen = [(np.flatnonzero(self.count == corners), corners) for corners in np.unique(self.count).tolist()]
        return [(which, self.node[self.start[which, None] + np.arange(corners)]) for which, corners in chosen]


def _planes(place: Floats, loops: _Loops, solid: Ints, tolerance: float) -> tuple[Ints, Floats, Floats]:
    """Group faces that lie in one plane within the tolerance.

    place: (n, 3) positions of the nodes. loops: nodes of each face. solid: (faces,) solid of each face. The results are
    the plane (faces,) of each face, and normal (p, 3) and point (p, 3) of each plane, those of its largest face. The
    plane is −1 for faces that are not plane themselves.
    """
    vector = np.zeros((len(loops), 3))
    middle = np.zeros((len(loops), 3))
    lower, upper = np.zeros((len(loops), 3)), np.zeros((len(loops), 3))
    stacks = loops.stacks()
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
        """Return the largest distance (p,) of corners of faces from planes of other faces."""
        found = np.zeros(len(faces))
        for number, (_, stack) in enumerate(stacks):
            mine = np.flatnonzero(size[faces] == number)
            arm = place[stack[row[faces[mine]]]] - middle[planes[mine], None]
            found[mine] = np.abs(np.einsum("nki,ni->nk", arm, normal[planes[mine]])).max(axis=1, initial=0.0)
        return found

    every = np.arange(len(loops))
    own = farthest(every, every)

    def parallel(one: Ints, two: Ints) -> Bools:
        """Return a mask (p,) of pairs of faces, True where normals are nearly parallel."""
        cosine = np.einsum("ij,ij->i", normal[one], normal[two])
        # Faces of two solids are opposite or continue one another; faces of one solid continue one another.
        return np.asarray(np.where(solid[one] == solid[two], cosine, np.abs(cosine)) > _FLAT)

    one, two = near_pairs(lower, upper, np.full(len(loops), tolerance), parallel)
    swap = area[one] < area[two]
    one, two = np.where(swap, two, one), np.where(swap, one, two)
    kept = (area[two] > 0.0) & (own[one] <= tolerance)
    one, two = one[kept], two[kept]
    joined = farthest(two, one) <= tolerance
    leader = _leaders(-area, one[joined], two[joined], farthest, tolerance)
    order = np.argsort(-area, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = every
    first, group = np.unique(rank[leader], return_inverse=True)
    # faces that are themselves not plane within the tolerance move no corner
    group[own > tolerance] = -1
    return group, normal[order[first]], middle[order[first]]


def _leaders(key: Floats, one: Ints, two: Ints, farthest: Callable[[Ints, Ints], Floats], tolerance: float) -> Ints:
    """Return the face (faces,) that defines the plane of each face.

    The first face of a plane defines it. Groups grow along pairs from the face of least key; every candidate is
    compared with that face, so that chains do not drift. key: (faces,) sort key. one, two: (p,) pairs of faces in
    nearly one plane. farthest: function that returns the distances (k,) of faces (k,) from the planes of other faces
    (k,).
    """
    order = np.argsort(key, kind="stable")
    rank = np.empty(len(key), dtype=np.int64)
    rank[order] = np.arange(len(key))
    part = components(len(key), one, two)
    least = np.full(int(part.max(initial=-1)) + 1, len(key), dtype=np.int64)
    np.minimum.at(least, part, rank)
    leader = order[least[part]]
    # Where all faces joined by pairs lie in the plane of their first one, they are one group.
    drifts = np.zeros(len(least), dtype=bool)
    drifts[part[farthest(np.arange(len(key)), leader) > tolerance]] = True
    open_pair = drifts[part[one]]
    partners: dict[int, list[int]] = {}
    for a, b in zip(one[open_pair].tolist(), two[open_pair].tolist(), strict=True):
        partners.setdefault(a, []).append(b)
        partners.setdefault(b, []).append(a)
    remaining = order[drifts[part[order]]].tolist()
    leader[remaining] = -1
    for seed in remaining:
        if leader[seed] >= 0:
            continue
        leader[seed] = seed
        pending = [seed]
        while pending:
            near = [face for face in partners.get(pending.pop(), ()) if leader[face] < 0]
            faces = np.array(near, dtype=np.int64)
            level = faces[farthest(faces, np.full(len(faces), seed)) <= tolerance]
            leader[level] = seed
            pending += level.tolist()
    return leader


def _onto_planes(place: Floats, loops: _Loops, group: Ints, normal: Floats, origin: Floats, tolerance: float) -> Floats:
    """Move every node by the least distance onto the planes of the faces that meet in it.

    Nodes that would move further than a multiple of the tolerance stay. place: (n, 3) positions. loops: nodes of each
    face. group: (faces,) plane of each face, −1 for none. normal, origin: (p, 3) of the planes. The result is (n, 3).
    """
    # One number for a node and a plane: sorting it is many times faster than sorting rows.
    wide = len(normal) + 1
    pairs = np.unique(loops.node * wide + np.repeat(group, loops.count) + 1)
    pairs = pairs[pairs % wide > 0]
    node, plane = pairs // wide, pairs % wide - 1
    amount = np.bincount(node, minlength=len(place))
    first = np.concatenate([[0], np.cumsum(amount)])[:-1]
    moved = place.copy()
    for count in np.unique(amount[amount > 0]).tolist():
        which = np.flatnonzero(amount == count)
        planes = plane[first[which, None] + np.arange(count)]
        rows = normal[planes]
        rest = np.einsum("nki,nki->nk", origin[planes] - place[which, None], rows)
        step = np.einsum("nik,nk->ni", np.linalg.pinv(rows, rcond=_RANK), rest)
        near = np.linalg.norm(step, axis=1) <= _FAR * tolerance
        moved[which[near]] += step[near]
    return moved
