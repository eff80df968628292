"""Bending sets of spatial faces: rows, corners, and solids of inner faces that crush.

With a list of rows c per face, a dry face requires c·m ≤ N and an inner face c·m ≤ N + σtA.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.geometry import outlines as polygons

InnerBending = Literal["uncoupled", "kern"]
"""Bending set of inner rectangles: "uncoupled" is the uncoupled form (2.5), "kern" the elastic edge stress (2.6)."""


@dataclass(frozen=True)
class Bending:
    """Bending sets of m faces in scaled x = (m1, m2): c·x ≤ N of dry faces, c·x ≤ N + σtA of inner ones.

    Face f has the rows start[f] to start[f + 1] − 1 of `dry` and `inner` (rows, 2), in order of angle; corners (rows,
    2) of {x : c·x ≤ 1} lie between a row and the next. crushed: faces with c·x ≥ N − σcA also; crush_corners: (corners,
    3) corners (ν, x) of their solids, from crush_start on, where N = −σtA + ν (σcA + σtA) and x is divided by σcA +
    σtA.
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
        """Return the face (rows,) to which each row belongs."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def table(self, *, dry: bool) -> tuple[Floats, Floats, Bools]:
        """Return the rows and corners (m, e, 2) of one label by faces, and a mask (m, e) of those that a face has."""
        counts, face = np.diff(self.start), self.face
        used = np.arange(int(counts.max(initial=0))) < counts[:, None]
        found = []
        for values in (self.dry, self.dry_corners) if dry else (self.inner, self.inner_corners):
            table = np.zeros((*used.shape, 2))
            table[face, np.arange(len(face)) - self.start[face]] = values
            found.append(table)
        return found[0], found[1], used

    def solids(self, faces: Ints) -> Floats:
        """Return the corners (k, p, 3) of the solids of some crushed faces, filled up with the first one."""
        counts = np.diff(self.crush_start)
        places = np.arange(int(counts.max(initial=0)))
        own = np.searchsorted(self.crushed, faces)
        at = self.crush_start[own][:, None] + np.where(places < counts[own][:, None], places, 0)
        return np.asarray(self.crush_corners[at])


# Rows c of a rectangle with uncoupled moments, in order of angle
_SIDES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
# Corners of the uncoupled rectangle, and rows c of its kern, in order of angle
_DIAGONALS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
# Corners of the kern of a rectangle, each between a row and the next.
_TIPS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])


def bending_of(faces: Interfaces, point: Bools, inner_bending: InnerBending, crushed: Bools) -> Bending:
    """Compute the bending rows of all faces; point, crushed: (m,) points, and inner faces of compressive strength."""
    # A point has 1 row, a rectangle 4, any other face 1 per edge of its hull.
    rectangle = faces.rectangle & ~point
    count = np.where(point, 1, 4)
    general = np.flatnonzero(~rectangle & ~point)
    outlines = local_hulls(faces, general)
    count[general] = [len(outline) for outline in outlines]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    dry, inner, dry_corners, inner_corners = (np.zeros((start[-1], 2)) for _ in range(4))
    place = start[:-1][rectangle][:, None] + np.arange(4)
    dry[place], dry_corners[place] = _SIDES, _DIAGONALS
    rows, corners = (_DIAGONALS, _TIPS) if inner_bending == "kern" else (_SIDES, _DIAGONALS)
    inner[place], inner_corners[place] = 3.0 * rows, corners / 3.0
    for position, outline in zip(general.tolist(), outlines, strict=True):
        part = slice(start[position], start[position + 1])
        # Moments are scaled by half the sizes of the face.
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
    """Return the corners (k, 2) of one face in its own frame, scene units."""
    return np.asarray((faces.polygon[face] - faces.origin[face]) @ np.array([faces.e1[face], faces.e2[face]]).T)


def local_hulls(faces: Interfaces, which: Ints) -> list[Floats]:
    """Return the convex hulls of some faces in their own frames: corners, counter-clockwise, scene units."""
    local = [_local(faces, face) for face in which.tolist()]
    # Take the hull first: the outline of a face with a hole passes its bridges twice.
    return polygons.without_idle_corners(polygons.hulls(local), tolerances.FACE)


def _kern(faces: Interfaces, face: int, outline: Floats) -> Floats:
    """Return the scaled rows (h, 2) that limit the elastic edge stress of one face, see `polygons.kern_rows`."""
    moments = polygons.second_moments(_local(faces, face)[None])[0]
    return polygons.kern_rows(outline, float(faces.area[face]), moments)


def _between(rows: Floats) -> Floats:
    """Return the corners (h, 2) of the polygon {m : c·m ≤ 1}, each between a row (h, 2) and the next."""
    onward = np.roll(rows, -1, axis=0)
    cross = rows[:, 0] * onward[:, 1] - rows[:, 1] * onward[:, 0]
    return np.column_stack([onward[:, 1] - rows[:, 1], rows[:, 0] - onward[:, 0]]) / cross[:, None]


def _rectangle_solid(corners: Floats) -> Floats:
    """Return the corners (k, 3) of a crushing rectangle's solid, (ν, m1, m2): two tips and half of corners (4, 2)."""
    middle = np.column_stack([np.full(len(corners), 0.5), 0.5 * corners])
    return np.concatenate([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], middle])


def _solid(rows: Floats) -> Floats:
    """Return the corners (k, 3) of {(ν, m1, m2) : ν − 1 ≤ c·m ≤ ν} for rows (h, 2), of any inner face that crushes."""
    one = np.ones(len(rows))
    lower = np.column_stack([-one, rows, 0.0 * one])
    upper = np.column_stack([one, -rows, -one])
    from scipy.spatial import HalfspaceIntersection  # slow to import, and only spatial scenes need it

    found = HalfspaceIntersection(np.concatenate([lower, upper]), np.array([0.5, 0.0, 0.0])).intersections
    return np.asarray(found[np.all(np.isfinite(found), axis=1)])
