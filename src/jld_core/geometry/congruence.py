"""Which shapes are the same, wherever they stand and, where that is allowed, however they are turned or turned over."""

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
"""How far squares of lengths of one shape may differ, over reach and radius: 4 where every corner is off by twice the
reach, and more for higher moments."""


class Kinds:
    """Outlines numbered by their shape as they come: each is compared with one of every kind so far.

    reach: distance within which corners are one. rotate: turned copies are the same shape. flip: mirrored ones too;
    without turns only by mirrors along the axes, and by what several of them make together, such as half a turn. Either
    way the moves that are allowed form a group, so that being of one shape does not depend on the order of outlines.
    """

    def __init__(self, reach: float, *, rotate: bool = False, flip: bool = False) -> None:
        self.reach, self.rotate, self.flip = reach, rotate, flip
        self._count = 0
        self._kinds: dict[tuple[int, int, int], list[tuple[int, Floats, Outline]]] = {}

    def number(self, outline: Outline) -> int:
        """Number of its shape, from 0 by first appearance."""
        square = (outline.points**2).sum(axis=1)
        # of one shape, whose corners are off by twice the reach at the most, no further apart than that
        size = math.floor(math.sqrt(float(square.mean())) / (2.0 * self.reach))
        name = outline.count, len(outline.points)
        around = [one for k in (-1, 0, 1) for one in self._kinds.get((*name, size + k), ())]
        moments = self._moments(outline.points)
        if around:
            # of those as large their moments tell nearly all apart
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
        """Squares of lengths that a move which is allowed leaves as they are."""
        square = (points**2).sum(axis=1)
        found = [square.mean(), np.sqrt((square**2).mean())]
        if not self.rotate:
            found += (points**2).mean(axis=0).tolist()
        if not (self.rotate or self.flip):
            found += (points * abs(points)).mean(axis=0).tolist()
        return np.array(found)


def shape_numbers(outlines: Sequence[Outline], reach: float, *, rotate: bool = True, flip: bool = False) -> list[int]:
    """Number of the shape of each outline, from 1 by first appearance; options as of `Kinds`."""
    kinds = Kinds(reach, rotate=rotate, flip=flip)
    return [kinds.number(outline) + 1 for outline in outlines]


def alike(one: Outline, other: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> bool:
    """Whether two outlines are one by a shift, a turn if allowed, and a mirror if allowed."""
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
    """Whether every corner falls on a corner of the other and every middle on a middle, one to one."""
    for part in (slice(0, count), slice(count, None)):
        mine, there = points[part], other.points[part]
        if not len(mine):
            continue
        from scipy.spatial import cKDTree  # slow to import, and seldom needed

        distance, to = cKDTree(there).query(mine)
        if float(np.max(distance)) > 2.0 * reach or len(np.unique(to)) != len(there):
            return False
    return True


def _axis_mirrors(dimension: int) -> list[Floats]:
    """Every product of mirrors along the axes but the identity: mirrors alone are no group."""
    signs = itertools.product((1.0, -1.0), repeat=dimension)
    return [np.diag(sign) for sign in signs if min(sign) < 0.0]


def _turns(one: Outline, other: Outline, reach: float, flip: bool) -> list[Floats]:
    """Orthogonal matrices that may lay one block onto the other: turns, and with `flip` turned mirrors too."""
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
