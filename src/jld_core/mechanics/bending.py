"""Bending sets of spatial faces: rows, corners, and the solids that an inner compressive strength makes of them.

With a list of rows c per face, a dry face asks for c·m ≤ N and an inner one for c·m ≤ N + σtA.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.geometry import polygons

InnerBending = Literal["paper", "kern"]


@dataclass(frozen=True)
class Bending:
    """Rows and corners of the bending sets of m faces, ragged: face f has rows start[f] to start[f + 1].

    dry, inner: (rows, 2) coefficients c of (m1, m2), in order of angle. dry_corners, inner_corners: (rows, 2)
    corners of {c·m ≤ 1}, the one between a row and the next. crushed: faces whose inner set has an upper end
    too, c·m ≥ N − σcA; their sets are solids with corners (ν, m) = crush_corners[crush_start[i] :
    crush_start[i + 1]], where N = −σtA + ν (σcA + σtA) and m is over σcA + σtA.
    """

    start: Ints
    dry: Floats
    inner: Floats
    dry_corners: Floats
    inner_corners: Floats
    crushed: Ints
    crush_start: Ints
    crush_corners: Floats

    @property
    def face(self) -> Ints:
        """(rows,) face of each row."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def most(self, rows: Floats, pair: Floats) -> Floats:
        """(m,) greatest c·x over the rows of each face, for x = pair (m, 2)."""
        product = np.einsum("ej,ej->e", rows, pair[self.face])
        return np.asarray(np.maximum.reduceat(product, self.start[:-1]))


_SIDES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
_DIAGONALS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
# corners of the kern of a rectangle: between a row and the next
_TIPS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])


def bending_of(faces: Interfaces, point: Bools, inner_bending: InnerBending, crushed: Bools) -> Bending:
    """Bending rows of all faces: one for a point, four for a rectangle, one per hull edge otherwise."""
    rectangle = faces.rectangle & ~point
    count = np.where(point, 1, 4)
    general = np.flatnonzero(~rectangle & ~point)
    outlines = local_hulls(faces, general)
    count[general] = [len(outline) for outline in outlines]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    dry, inner, dry_corners, inner_corners = (np.zeros((start[-1], 2)) for _ in range(4))
    place = start[:-1][rectangle][:, None] + np.arange(4)
    dry[place], dry_corners[place] = _SIDES, _DIAGONALS
    rows, corners = (_SIDES, _DIAGONALS) if inner_bending == "paper" else (_DIAGONALS, _TIPS)
    inner[place], inner_corners[place] = 3.0 * rows, corners / 3.0
    for position, outline in zip(general.tolist(), outlines, strict=True):
        part = slice(start[position], start[position + 1])
        # moments are scaled by half the extents
        scale = 0.5 * np.array([faces.l2[position], faces.l1[position]])
        edges = polygons.hull_rows(outline)
        dry[part] = -edges[:, 1:] / edges[:, :1] * scale
        inner[part] = -_kern(faces, position, outline)[:, 1:] * scale
        dry_corners[part], inner_corners[part] = _between(dry[part]), _between(inner[part])
    chosen = np.flatnonzero(crushed & ~point)
    solids = [
        _rectangle_solid(inner_corners[start[f] : start[f + 1]])
        if rectangle[f]
        else _solid(inner[start[f] : start[f + 1]])
        for f in chosen.tolist()
    ]
    return Bending(
        start=start,
        dry=dry,
        inner=inner,
        dry_corners=dry_corners,
        inner_corners=inner_corners,
        crushed=chosen,
        crush_start=np.concatenate([[0], np.cumsum([len(solid) for solid in solids])]).astype(np.int64),
        crush_corners=np.concatenate(solids) if solids else np.zeros((0, 3)),
    )


def _local(faces: Interfaces, face: int) -> Floats:
    """Polygon of a face in its own frame (k, 2)."""
    return np.asarray((faces.polygon[face] - faces.origin[face]) @ np.array([faces.e1[face], faces.e2[face]]).T)


def local_hulls(faces: Interfaces, which: Ints) -> list[Floats]:
    """Return the convex hulls (h, 2) of some faces in their own frames, counter-clockwise, without idle corners."""
    local = [_local(faces, face) for face in which.tolist()]
    # the hull first: the outline of a face with a hole runs along its bridges both ways
    return polygons.without_idle_corners(polygons.hulls(local), tolerances.FACE)


def _kern(faces: Interfaces, face: int, outline: Floats) -> Floats:
    moments = polygons.second_moments(_local(faces, face)[None])[0]
    return polygons.kern_rows(outline, float(faces.area[face]), moments)


def _between(rows: Floats) -> Floats:
    """Corners (h, 2) of {c·m ≤ 1}: where a row and the next, in order of angle, are both equal to one."""
    onward = np.roll(rows, -1, axis=0)
    cross = rows[:, 0] * onward[:, 1] - rows[:, 1] * onward[:, 0]
    return np.column_stack([onward[:, 1] - rows[:, 1], rows[:, 0] - onward[:, 0]]) / cross[:, None]


def _rectangle_solid(corners: Floats) -> Floats:
    """Corners (ν, m) of a double pyramid: its two tips, and the middle section."""
    middle = np.column_stack([np.full(len(corners), 0.5), 0.5 * corners])
    return np.concatenate([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], middle])


def _solid(rows: Floats) -> Floats:
    """Corners (ν, m) of {c·m ≤ ν, c·m ≥ ν − 1}; where the hull is not symmetric this is no double pyramid."""
    one = np.ones(len(rows))
    lower = np.column_stack([-one, rows, 0.0 * one])
    upper = np.column_stack([one, -rows, -one])
    from scipy.spatial import HalfspaceIntersection  # slow to import, and for spatial scenes alone

    found = HalfspaceIntersection(np.concatenate([lower, upper]), np.array([0.5, 0.0, 0.0])).intersections
    return np.asarray(found[np.all(np.isfinite(found), axis=1)])
