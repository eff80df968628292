"""Congruence of outlines under shifts and, where allowed, rotations and mirrors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.geometry.outlines import Outline
from jld_core.geometry.vectors import frame

_MOMENTS: Final = 20.0
"""Allowed difference of the moments of congruent shapes, divided by reach times radius.

Corners that are each off by twice the reach give a difference of 4, and higher moments more.
"""


class Kinds:
    """Register that numbers outlines by shape in order of first appearance.

    Each new outline is compared with one representative of every known shape of similar size. The allowed moves form a
    group, so that congruence does not depend on the order of the outlines.

    Parameters
    ----------
    reach : float
        Half the largest distance at which two corners coincide, scene units.
    rotate : bool
        Treat rotated copies as the same shape.
    flip : bool
        Treat mirrored copies as the same shape; without `rotate` only mirrors along the axes and their products, such
        as half a turn.
    """

    def __init__(self, reach: float, *, rotate: bool = False, flip: bool = False) -> None:
        self.reach, self.rotate, self.flip = reach, rotate, flip
        self._count = 0
        self._kinds: dict[tuple[int, int, int], list[tuple[int, Floats, Outline]]] = {}

    def number(self, outline: Outline) -> int:
        """Return the number of an outline's shape, from 0 by first appearance.

        Parameters
        ----------
        outline : Outline
            Outline; it is stored if its shape is new.

        Returns
        -------
        int
            Number of the shape.
        """
        square = (outline.points**2).sum(axis=1)
        # Corners of one shape are off by twice the reach at most, and so are the mean radii compared here.
        size = math.floor(math.sqrt(float(square.mean())) / (2.0 * self.reach))
        name = outline.count, len(outline.points)
        around = [one for k in (-1, 0, 1) for one in self._kinds.get((*name, size + k), ())]
        moments = self._moments(outline.points)
        if around:
            # Moments distinguish nearly all shapes of similar size, so that few outlines need the full comparison.
            radius = float(np.sqrt(square.max()))
            differ = abs(np.array([known for _, known, _ in around]) - moments).max(axis=1)
            for k in np.flatnonzero(differ <= _MOMENTS * self.reach * radius).tolist():
                number, _, kind = around[k]
                if alike(outline, kind, self.reach, rotate=self.rotate, flip=self.flip):
                    return number
        self._kinds.setdefault((*name, size), []).append((self._count, moments, outline))
        self._count += 1
        return self._count - 1

    def _moments(self, points: Floats) -> Floats:
        """Compute invariants of an outline, equal up to rounding for outlines of one shape.

        They are means of squares of coordinates that no allowed move changes. points: (k, d) of the outline, relative
        to its centroid.
        """
        square = (points**2).sum(axis=1)
        found = [square.mean(), np.sqrt((square**2).mean())]
        if not self.rotate:
            found += (points**2).mean(axis=0).tolist()
        if not (self.rotate or self.flip):
            found += (points * abs(points)).mean(axis=0).tolist()
        return np.array(found)


def shape_numbers(outlines: Sequence[Outline], reach: float, *, flip: bool) -> list[int]:
    """Assign numbers to outlines by shape, from 1; rotated copies have the same shape.

    Parameters
    ----------
    outlines : sequence of Outline
        Outlines to number.
    reach : float
        Half the largest distance at which two corners coincide, scene units; see `reach_of`.
    flip : bool
        Treat mirrored copies as the same shape, as in `Kinds`.

    Returns
    -------
    list of int
        Shape number of each outline.
    """
    kinds = Kinds(reach, rotate=True, flip=flip)
    return [kinds.number(outline) + 1 for outline in outlines]


def alike(one: Outline, other: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> bool:
    """Return True if the corners of two outlines coincide after an allowed move.

    Shifts are always allowed; `rotate` and `flip` allow rotations and mirrors as in `Kinds`. Middles of edges or faces
    must coincide too. reach: half the largest distance at which two points coincide, scene units.
    """
    near = abs(one.size - other.size) <= 1e-3 * other.size
    if not near or one.count != other.count or len(one.points) != len(other.points):
        return False
    if _falls_on(one.points, one.count, other, reach):
        return True
    if not (rotate or flip):
        return False
    turns = _turns(one, other, reach, flip) if rotate else _axis_mirrors(one.points.shape[1])
    return any(_falls_on(one.points @ matrix.T, one.count, other, reach) for matrix in turns)


def _falls_on(points: Floats, count: int, other: Outline, reach: float) -> bool:
    """Return True if points coincide one to one with the points of an outline.

    points: (k + e, d), of which the first `count` are corners and the others middles; corners must coincide with
    corners. reach: half the largest distance at which two points coincide.
    """
    for part in (slice(0, count), slice(count, None)):
        mine, there = points[part], other.points[part]
        if not len(mine):
            continue
        from scipy.spatial import cKDTree  # local import: slow to import and seldom needed

        distance, to = cKDTree(there).query(mine)
        if float(np.max(distance)) > 2.0 * reach or len(np.unique(to)) != len(there):
            return False
    return True


def _axis_mirrors(dimension: int) -> list[Floats]:
    """Return all products of mirrors along the axes but the identity, as matrices (d, d).

    Single mirrors alone do not form a group.
    """
    signs = itertools.product((1.0, -1.0), repeat=dimension)
    return [np.diag(sign) for sign in signs if min(sign) < 0.0]


def _turns(one: Outline, other: Outline, reach: float, flip: bool) -> list[Floats]:
    """Return the orthogonal matrices (d, d) that may map one outline onto the other.

    They are rotations and, with `flip`, also rotations combined with a mirror. Each maps a far corner, in space two,
    onto corners at the same distance from the centroid. reach: half the largest distance at which two points coincide.
    """
    d = one.points.shape[1]
    corners, images = one.points[: one.count], other.points[: other.count]
    radius, there = np.linalg.norm(corners, axis=1), np.linalg.norm(images, axis=1)
    first = int(np.argmax(radius))
    slack = 4.0 * reach
    matrices: list[Floats] = []
    signs = [1.0] + [-1.0] * flip
    if d == 2:
        for q in np.flatnonzero(abs(there - radius[first]) <= slack).tolist():
            for sign in signs:
                angle = np.arctan2(images[q, 1], images[q, 0]) - sign * np.arctan2(corners[first, 1], corners[first, 0])
                c, s = np.cos(angle), np.sin(angle)
                matrices.append(np.array([[c, -s], [s, c]]) @ np.diag([1.0, sign]))
        return matrices
    away = np.linalg.norm(np.cross(corners, corners[first]), axis=1)
    second = int(np.argmax(away))
    gram = float(corners[first] @ corners[second])
    base = frame(corners[[first, second]])
    for p in np.flatnonzero(abs(there - radius[first]) <= slack).tolist():
        for q in np.flatnonzero(abs(there - radius[second]) <= slack).tolist():
            if p == q or abs(float(images[p] @ images[q]) - gram) > slack * 2.0 * radius[first]:
                continue
            for sign in signs:
                matrices.append(frame(images[[p, q]]).T @ np.diag([1.0, 1.0, sign]) @ base)
    return matrices
