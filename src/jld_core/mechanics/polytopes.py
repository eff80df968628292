"""Polytopes of three resultants: vertices and extreme rays in exact arithmetic, and rows of hulls."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from itertools import combinations
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats

# Violation of a row, relative to its terms, above which a point of intersection is no vertex in floats
_NEAR: Final = 1e-6

# Determinant of unit rows below which their point of intersection is found in exact arithmetic alone
_FLAT: Final = 1e-9

_SAME: Final = 1e-9  # distance below which two unit normals of facets are one

# Distance of a vertex beyond a row, relative to all, below which the row is a facet; rows are moved out then
_INSIDE: Final = 1e-11

Vector = tuple[Fraction, ...]


def corners(rows: Floats, constants: Floats) -> tuple[Floats, Floats]:
    """Return exact vertices (p, 3) and rays (q, 3) of {x : C x + d ≥ 0}, then rounded; the set holds no line.

    A ray has N = 1 where its N is positive, else size 1. Rows of zeros are ignored.
    """
    used = np.any(rows != 0.0, axis=1)
    return _corners(rows[used].tobytes(), constants[used].tobytes())


@lru_cache(maxsize=4096)
def _corners(rows: bytes, constants: bytes) -> tuple[Floats, Floats]:
    """Return vertices and rays, as `corners`, of numbers given as bytes."""
    c, d = np.frombuffer(rows).reshape(-1, 3), np.frombuffer(constants)
    exact = [[Fraction(x) for x in row] for row in c.tolist()]
    sides = [Fraction(x) for x in d.tolist()]
    points: dict[Vector, None] = {}
    for i, j, k in _candidates(c, d):
        cross = _cross(exact[j], exact[k])
        size = _dot(exact[i], cross)
        if size == 0:
            continue
        # Cramer's rule with C x = −d in the three rows
        parts = (sides[i], cross), (sides[j], _cross(exact[k], exact[i])), (sides[k], _cross(exact[i], exact[j]))
        point = tuple(-sum(side * way[axis] for side, way in parts) / size for axis in range(3))
        if all(_dot(row, point) + side >= 0 for row, side in zip(exact, sides, strict=True)):
            points[point] = None
    ways: dict[Vector, None] = {}
    for i, j in combinations(range(len(exact)), 2):
        along = _cross(exact[i], exact[j])
        if not any(along):
            continue
        products = [_dot(row, along) for row in exact]
        for sign in (1, -1):
            if all(sign * product >= 0 for product in products):
                size = along[0] * sign if along[0] * sign > 0 else max(abs(part) for part in along)
                ways[tuple(sign * part / size for part in along)] = None
    found = [np.array([[float(x) for x in point] for point in many]).reshape(-1, 3) for many in (points, ways)]
    return found[0], found[1]


def _candidates(rows: Floats, constants: Floats) -> list[list[int]]:
    """Return the triples of rows whose point violates no row by far in floats."""
    threes = np.array(list(combinations(range(len(rows)), 3)), dtype=np.int64).reshape(-1, 3)
    size = np.linalg.norm(rows, axis=1)
    unit, side = rows / size[:, None], constants / size
    systems = unit[threes]
    flat = abs(np.linalg.det(systems)) < _FLAT
    systems[flat] = np.eye(3)
    points = -np.linalg.solve(systems, side[threes][..., None])[..., 0]
    least = (points @ unit.T + side).min(axis=1, initial=np.inf)
    reach = 1.0 + abs(points).max(axis=1, initial=0.0) + abs(side).max(initial=0.0)
    return [list(map(int, three)) for three in threes[flat | (least > -_NEAR * reach)]]


def _cross(a: list[Fraction], b: list[Fraction]) -> list[Fraction]:
    """Return the cross product of two vectors."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: list[Fraction], b: list[Fraction] | Vector) -> Fraction:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def enclosing_rows(vertices: Floats, rays: Floats) -> tuple[Floats, Floats]:
    """Return rows C x + d ≥ 0 of the closed hull of vertices (p, k) and rays (q, k), k = 2 or 3."""
    # C is (r, k) with largest entry 1. Every vertex and ray satisfies the rows up to rounding.
    k = vertices.shape[1]
    reach = float(abs(vertices).max(initial=0.0)) or 1.0
    sizes = np.linalg.norm(rays, axis=1, keepdims=True)
    generators = np.unique(
        np.vstack([
            np.column_stack([vertices / reach, np.ones(len(vertices))]),
            np.column_stack([rays / np.where(sizes > 0.0, sizes, 1.0), np.zeros(len(rays))]),
        ]),
        axis=0,
    )  # fmt: skip
    generators = np.vstack([generators, np.append(np.zeros(k), 1.0)]) if len(generators) < k else generators
    groups = generators[np.array(list(combinations(range(len(generators)), k)), dtype=np.int64).reshape(-1, k)]
    normals = _normals(groups)
    size = np.linalg.norm(normals[:, :k], axis=1)
    normals = normals[size > _SAME] / size[size > _SAME, None]
    normals = np.vstack([normals, -normals])
    normals = normals[(normals @ generators.T).min(axis=1, initial=np.inf) > -_INSIDE]
    normals = normals[_firsts(normals)]
    rows = normals[:, :k] / abs(normals[:, :k]).max(axis=1, keepdims=True)
    rows[abs(rows) < 1e-14] = 0.0
    return rows, -(rows @ vertices.T).min(axis=1)


def _normals(groups: Floats) -> Floats:
    """Return the vector (g, k + 1) orthogonal to each group (g, k, k + 1) of vectors."""
    k = groups.shape[1]
    columns = [np.delete(groups, axis, axis=2) for axis in range(k + 1)]
    return np.column_stack([(-1.0) ** axis * np.linalg.det(part) for axis, part in enumerate(columns)])


def _firsts(normals: Floats) -> Bools:
    """Return a mask of the rows that are equal to no earlier one."""
    near = abs(normals[:, None] - normals[None]).max(axis=2, initial=0.0) < 10.0 * _SAME
    return np.asarray(~np.any(np.tril(near, -1), axis=1))
