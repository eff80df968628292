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

# Allowed difference of the moments of congruent shapes, divided by reach times radius. Corners that are each off by
# twice the reach give a difference of 4, and higher moments more.
_MOMENTS: Final = 20.0

# Distance of corners, relative to the reach, up to which outlines are copies but for rounding: one of them is kept
_SAME: Final = 1e-3

# Distance of corners, in reaches, at which they are paired before the best move is computed from all pairs
_PAIRED: Final = 8.0


class Kinds:
    """Register that numbers outlines by shape, as chains of coinciding ones count.

    rotate, flip: copies that have the same shape; without `rotate`, mirrors along the axes and their products.
    """

    def __init__(self, reach: float, *, rotate: bool = False, flip: bool = False) -> None:
        self.reach, self.rotate, self.flip = reach, rotate, flip
        self.exact = True
        self._parent: list[int] = []
        self._kinds: dict[tuple[int, int, int], list[tuple[int, Floats, Outline]]] = {}

    def number(self, outline: Outline) -> int:
        """Store an outline unless it copies one, and return its number, of which `roots` gives that of the shape."""
        square = (outline.points**2).sum(axis=1)
        # Corners of one shape are off by twice the reach at most, and so are the mean radii compared here.
        size = math.floor(math.sqrt(float(square.mean())) / (2.0 * self.reach))
        name = outline.count, len(outline.points)
        around = [one for k in (-1, 0, 1) for one in self._kinds.get((*name, size + k), ())]
        moments, found = self._moments(outline.points), len(self._parent)
        linked: set[int] = set()
        if around:
            # Moments distinguish nearly all shapes of similar size, so that few outlines need the full comparison.
            radius = float(np.sqrt(square.max()))
            differ = abs(np.array([known for _, known, _ in around]) - moments).max(axis=1)
            nearest: list[int] = np.argsort(differ, kind="stable").tolist()
            for k in nearest:
                if differ[k] > _MOMENTS * self.reach * radius:
                    break
                number, _, kind = around[k]
                if self._root(number) in linked:
                    continue
                off = deviation(outline, kind, self.reach, rotate=self.rotate, flip=self.flip)
                if off <= _SAME * self.reach:
                    return number
                if off <= 2.0 * self.reach:
                    linked.add(self._root(number))
        self._kinds.setdefault((*name, size), []).append((found, moments, outline))
        self._parent.append(found)
        for root in linked:
            self._parent[root] = found
            self.exact = False
        return found

    def roots(self, numbers: Sequence[int]) -> list[int]:
        """Return the shape of each outline by its `number`; later outlines may connect shapes."""
        return [self._root(number) for number in numbers]

    def _root(self, number: int) -> int:
        """Return the number that stands for the shape of an outline."""
        while self._parent[number] != number:
            self._parent[number] = self._parent[self._parent[number]]
            number = self._parent[number]
        return number

    def _moments(self, points: Floats) -> Floats:
        """Compute means of squares of coordinates of points (k, d) that no allowed move changes."""
        square = (points**2).sum(axis=1)
        found = [square.mean(), np.sqrt((square**2).mean())]
        if not self.rotate:
            found += (points**2).mean(axis=0).tolist()
        if not (self.rotate or self.flip):
            found += (points * abs(points)).mean(axis=0).tolist()
        return np.array(found)


def shape_numbers(outlines: Sequence[Outline], reach: float, *, flip: bool) -> list[int]:
    """Assign numbers to outlines by shape, from 1; rotated copies have the same shape."""
    kinds = Kinds(reach, rotate=True, flip=flip)
    roots = kinds.roots([kinds.number(outline) for outline in outlines])
    order = {root: k for k, root in enumerate(dict.fromkeys(roots), 1)}
    return [order[root] for root in roots]


def alike(one: Outline, other: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> bool:
    """Return True if two outlines coincide after an allowed move."""
    return deviation(one, other, reach, rotate=rotate, flip=flip) <= 2.0 * reach


def deviation(one: Outline, other: Outline, reach: float, *, rotate: bool = False, flip: bool = False) -> float:
    """Return the largest distance of paired corners and middles of two outlines after the best move, else inf."""
    # Shifts are always allowed; `rotate` and `flip` allow rotations and mirrors as in `Kinds`. Middles of edges or
    # faces are paired too.
    near = abs(one.size - other.size) <= 1e-3 * max(one.size, other.size)
    if not near or one.count != other.count or len(one.points) != len(other.points):
        return math.inf
    best = _off(one.points, one.count, other, reach, turn=False)
    if best > _SAME * reach and (rotate or flip):
        turns = _turns(one, other, reach, flip) if rotate else _axis_mirrors(one.points.shape[1])
        for matrix in turns:
            best = min(best, _off(one.points @ matrix.T, one.count, other, reach, turn=rotate))
            if best <= _SAME * reach:
                break
    return best


def _off(points: Floats, count: int, other: Outline, reach: float, *, turn: bool) -> float:
    """Return the largest distance of points, `count` corners and middles, to partners on an outline; inf without."""
    from scipy.spatial import cKDTree  # local import: slow to import and seldom needed

    pairs = []
    for start, end in ((0, count), (count, len(points))):
        if start == end:
            continue
        distance, to = cKDTree(other.points[start:end]).query(points[start:end])
        limit = _PAIRED if turn else 2.0
        if float(np.max(distance)) > limit * reach or len(np.unique(to)) != end - start:
            return math.inf
        pairs.append(start + to)
    there = other.points[np.concatenate(pairs)]
    if turn:
        u, _, v = np.linalg.svd(points.T @ there)
        sign = np.ones(points.shape[1])
        sign[-1] = np.sign(np.linalg.det(u @ v))
        points = points @ (u * sign) @ v
    return float(np.sqrt(((points - there) ** 2).sum(axis=1)).max())


def _axis_mirrors(dimension: int) -> list[Floats]:
    """Return all products of mirrors along the axes but the identity, as matrices (d, d)."""
    signs = itertools.product((1.0, -1.0), repeat=dimension)
    return [np.diag(sign) for sign in signs if min(sign) < 0.0]


def _turns(one: Outline, other: Outline, reach: float, flip: bool) -> list[Floats]:
    """Return the orthogonal matrices (d, d) that may map one outline onto the other."""
    # Rotations and, with `flip`, also rotations combined with a mirror. Each maps a far corner, in space two, onto
    # corners at the same distance from the centroid.
    d = one.points.shape[1]
    corners, images = one.points[: one.count], other.points[: other.count]
    radius, there = np.linalg.norm(corners, axis=1), np.linalg.norm(images, axis=1)
    first = int(np.argmax(radius))
    slack = _PAIRED * reach
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
