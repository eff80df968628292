"""Which shapes are the same, wherever they stand and however they are turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from jld_core.arrays import Floats

_SAME: Final = 1e-6
"""Distance of corners, relative to the shape, within which two shapes are one."""


@dataclass(frozen=True)
class Shape:
    """What is compared. corners: (k, d). measure: area or volume. boundary: length or area of the boundary."""

    corners: Floats
    measure: float
    boundary: float


def shape_numbers(shapes: Sequence[Shape], *, rotate: bool = True, flip: bool = False) -> list[int]:
    """Number of the shape of each entry, from 1 by first appearance.

    rotate: turned copies are the same shape. flip: mirrored ones too.
    """
    kinds: list[Shape] = []
    numbers = []
    for shape in shapes:
        for number, kind in enumerate(kinds, start=1):
            if _alike(shape, kind) and congruent(shape.corners, kind.corners, rotate=rotate, flip=flip):
                numbers.append(number)
                break
        else:
            kinds.append(shape)
            numbers.append(len(kinds))
    return numbers


def _alike(one: Shape, other: Shape) -> bool:
    return (
        len(one.corners) == len(other.corners)
        and abs(one.measure - other.measure) <= _SAME * max(one.measure, other.measure)
        and abs(one.boundary - other.boundary) <= _SAME * max(one.boundary, other.boundary)
    )


def congruent(one: Floats, other: Floats, *, rotate: bool = True, flip: bool = False) -> bool:
    """Whether two sets of corners (k, d) are one by a shift, a turn if allowed, and a mirror if allowed."""
    if len(one) != len(other):
        return False
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    reach = _SAME * float(np.linalg.norm(one, axis=1).max())
    if np.abs(np.sort(np.linalg.norm(one, axis=1)) - np.sort(np.linalg.norm(other, axis=1))).max() > 4.0 * reach:
        return False
    tree = cKDTree(other)

    def falls(matrix: Floats) -> bool:
        distance, index = (np.asarray(found) for found in tree.query(one @ matrix.T))
        return bool(distance.max() <= 10.0 * reach) and len(np.unique(index)) == len(other)

    mirrors = [np.eye(one.shape[1])]
    if flip:
        mirrors.append(np.diag([-1.0, *([1.0] * (one.shape[1] - 1))]))
    if not rotate:
        return any(falls(mirror) for mirror in mirrors)
    for mirror in mirrors:
        for matrix in _turns(one @ mirror.T, other, reach):
            if falls(matrix @ mirror):
                return True
    return False


def _turns(one: Floats, other: Floats, reach: float) -> list[Floats]:
    """Rotations that bring the frame of the first corners of one onto corners of the other."""
    radius = np.linalg.norm(one, axis=1)
    first = int(np.argmax(radius))
    starts = np.flatnonzero(np.abs(np.linalg.norm(other, axis=1) - radius[first]) <= 4.0 * reach)
    if one.shape[1] == 2:
        angle = np.arctan2(other[starts, 1], other[starts, 0]) - np.arctan2(one[first, 1], one[first, 0])
        return [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angle]
    across = np.linalg.norm(np.cross(one, one[first]), axis=1)
    second = int(np.argmax(across))
    if across[second] <= 1e-9 * radius[first] ** 2:
        return [np.eye(3)]
    gap = float(np.linalg.norm(one[second] - one[first]))
    base = _axes(one[first], one[second])
    found = []
    for a in starts.tolist():
        ends = (np.abs(np.linalg.norm(other, axis=1) - radius[second]) <= 4.0 * reach) & (
            np.abs(np.linalg.norm(other - other[a], axis=1) - gap) <= 8.0 * reach
        )
        found += [_axes(other[a], other[b]).T @ base for b in np.flatnonzero(ends).tolist()]
    return found


def _axes(one: Floats, other: Floats) -> Floats:
    """(3, 3) rows of a right-handed frame along the first of two vectors, the second in its plane."""
    x = one / np.linalg.norm(one)
    z = np.cross(one, other)
    z /= np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])
