"""Outlines of free cells over common nodes at corners, ends of interfaces and of loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.linalg import components

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FREE = -1
"""Tag of an outline edge that belongs to no interface."""


@dataclass(frozen=True)
class Outlines:
    """Outlines of all free cells over common nodes (p, 2).

    rings: per outline (k,) its nodes, counter-clockwise. tags: per outline (k,) the interface on the edge from node i
    to i + 1, or FREE.
    """

    points: Floats
    cells: Ints
    rings: tuple[Ints, ...]
    tags: tuple[Ints, ...]


def outlines_of(assembly: Assembly, extra: Floats | None = None) -> Outlines:
    """Return the outlines of free cells, with nodes at ends of interfaces and at `extra` (k, 2) points."""
    from scipy.spatial import cKDTree  # slow to import, and most searches have no fields

    cells = assembly.elements.free
    shapes = [assembly.elements.shape[cell] for cell in cells]
    ends = np.concatenate([np.asarray(ends, dtype=float) for ends in assembly.interfaces.polygon])
    corners = np.concatenate(shapes)
    every = np.concatenate([ends, corners, np.zeros((0, 2)) if extra is None else extra])
    reach = tolerances.ON_OUTLINE * assembly.size
    points, number = merged(every, reach)
    rings, start, near = [], len(ends), cKDTree(points)
    for shape in shapes:
        rings.append(ring_of(points, near, number[start : start + len(shape)], reach))
        start += len(shape)
    face_ends = number[: len(ends)].reshape(-1, 2)
    own: list[list[int]] = [[] for _ in assembly.elements.ids]
    for face, pair in enumerate(zip(assembly.interfaces.a.tolist(), assembly.interfaces.b.tolist(), strict=True)):
        for cell in pair:
            own[cell].append(face)
    tags = [_tags(points, own[cell], ring, face_ends, reach) for cell, ring in zip(cells.tolist(), rings, strict=True)]
    return Outlines(points, cells, tuple(rings), tuple(tags))


def merged(places: Floats, reach: float) -> tuple[Floats, Ints]:
    """Merge places (k, d) within `reach`; return points (p, d) and the point (k,) of each."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    group = components(len(places), pairs[:, 0], pairs[:, 1])
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return places[first], np.asarray(number)


def ring_of(points: Floats, near: cKDTree, corners: Ints, reach: float) -> Ints:
    """Return the nodes of a closed polygon: its corners (k,), and all nodes within `reach` of its edges, in order."""
    corners = corners[corners != np.roll(corners, 1)]
    after = np.roll(corners, -1)
    middle, half = (
        0.5 * (points[corners] + points[after]),
        0.5 * np.linalg.norm(points[after] - points[corners], axis=1),
    )
    around = near.query_ball_point(middle, half + reach, return_sorted=True)
    nodes: list[int] = []
    for a, b, found in zip(corners.tolist(), after.tolist(), around, strict=True):
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        along = along / length
        some = np.array(found, dtype=np.int64)
        away = points[some] - points[a]
        place = away @ along
        off = np.linalg.norm(away - place[:, None] * along, axis=1)
        between = np.flatnonzero((off <= reach) & (place > reach) & (place < length - reach))
        nodes += [a, *some[between[np.argsort(place[between])]].tolist()]
    return np.array(nodes, dtype=np.int64)


def _tags(points: Floats, own: list[int], ring: Ints, face_ends: Ints, reach: float) -> Ints:
    """Return the interface (k,) that covers each edge of an outline, FREE where none does."""
    tags = np.full(len(ring), FREE, dtype=np.int64)
    middle = 0.5 * (points[ring] + points[np.roll(ring, -1)])
    for face in own:
        a, b = points[face_ends[face]]
        along = b - a
        length = float(np.hypot(*along))
        along = along / length
        away = middle - a
        place = away @ along
        off = abs(away[:, 0] * along[1] - away[:, 1] * along[0])
        tags[(off <= reach) & (place > 0.0) & (place < length)] = face
    return tags
