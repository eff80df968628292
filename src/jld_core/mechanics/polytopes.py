"""Vertices of polytopes given by rows, in exact arithmetic, and rows that enclose vertices and rays."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from itertools import combinations
from math import gcd
from operator import mul
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats

# Violation of a row, relative to its terms, above which a point of intersection is no vertex in floats
_NEAR: Final = 1e-6

# Size of the minors of unit rows below which their line of intersection is found in exact arithmetic alone
_FLAT: Final = 1e-9

_TRIES: Final = 8  # parts in which the ends of a hull are tried as normals of its facets

_SAME: Final = 1e-9  # distance below which two unit normals of facets are one

# Distance of a vertex beyond a row, relative to all, below which the row is a facet; rows are moved out then
_INSIDE: Final = 1e-11

Vector = tuple[int, ...]
"""Point or ray in homogeneous coordinates: (x w, w) with w > 0, and (x, 0)."""


def corners(rows: Floats, constants: Floats) -> tuple[Floats, Floats]:
    """Return the vertices (p, k) and extreme rays (q, k) of {x : C x + d ≥ 0}, C (r, k) and d (r,).

    Both are exact for the numbers given, then rounded. A ray has N = 1 where its N is positive, else size 1. Rows of
    zeros are ignored. The set must hold no line.
    """
    used = np.any(rows != 0.0, axis=1)
    table = np.column_stack([rows[used], constants[used]])
    found = _corners(np.vstack([table, np.eye(table.shape[1])[-1:]]).tobytes(), table.shape[1])
    ends: list[list[list[float]]] = [[], []]
    for *point, w in found:
        size = w or (point[0] if point[0] > 0 else max(map(abs, point)))
        ends[w == 0].append([float(Fraction(x, size)) for x in point])
    return tuple(np.array(many).reshape(-1, rows.shape[1]) for many in ends)  # type: ignore[return-value]


@lru_cache(maxsize=4096)
def _corners(table: bytes, width: int) -> tuple[Vector, ...]:
    """Return the extreme rays (x w, w) of the cone {C x + d w ≥ 0, w ≥ 0} of numbers given as bytes."""
    floats = np.frombuffer(table).reshape(-1, width)
    exact = [_integers(row) for row in floats.tolist()]
    found: dict[Vector, None] = {}
    known: set[tuple[int, ...]] = set()  # rows that hold with equality at what was found, and at nothing else
    for group in _candidates(floats):
        if any(set(group) <= set(touched) for touched in known):
            continue
        line = _line([exact[row] for row in group])
        if line is None:
            continue
        products = [sum(map(mul, row, line)) for row in exact]
        sign = -1 if any(product < 0 for product in products) else 1
        if all(sign * product >= 0 for product in products) and any(products):
            found[tuple(sign * x for x in line)] = None
            known.add(tuple(place for place, product in enumerate(products) if product == 0))
    return tuple(found)


def _integers(row: list[float]) -> list[int]:
    """Return numbers times the smallest power of two that makes them whole."""
    pairs = [value.as_integer_ratio() for value in row]
    shared = max(below for _, below in pairs)
    return [above * (shared // below) for above, below in pairs]


def _line(rows: list[list[int]]) -> Vector | None:
    """Return the line that is orthogonal to k rows (k, k + 1), without common factor; None if there are several."""
    # Elimination without fractions: after each step all entries are minors, and divide by the pivot before.
    table, columns, last = [list(row) for row in rows], list(range(len(rows) + 1)), 1
    for step in range(len(table)):
        place = next(((i, j) for j in range(step, len(columns)) for i in range(step, len(table)) if table[i][j]), None)
        if place is None:
            return None
        table[step], table[place[0]] = table[place[0]], table[step]
        for row in (*table, columns):
            row[step], row[place[1]] = row[place[1]], row[step]
        pivot = table[step][step]
        for i, row in enumerate(table):
            if i != step:
                factor = row[step]
                table[i] = [(pivot * x - factor * y) // last for x, y in zip(row, table[step], strict=True)]
        last = pivot
    found = [0] * len(columns)
    found[columns[-1]] = last
    for row, column in zip(table, columns[:-1], strict=True):
        found[column] = -row[-1]
    shared = gcd(*found)
    return tuple(x // shared for x in found)


def _candidates(table: Floats) -> list[tuple[int, ...]]:
    """Return the groups of rows that may meet in a vertex or ray: those whose line violates no row by far in floats."""
    width = table.shape[1]
    groups = np.array(list(combinations(range(len(table)), width - 1)), dtype=np.int64).reshape(-1, width - 1)
    reach = abs(table[:, -1]).max(initial=0.0) or 1.0
    scaled = table / np.append(np.ones(width - 1), reach)
    unit = scaled / np.linalg.norm(scaled, axis=1)[:, None]
    lines = _normals(unit[groups])
    size = np.linalg.norm(lines, axis=1)
    flat = size < _FLAT
    products = (lines / np.where(flat, 1.0, size)[:, None]) @ unit.T
    near = np.maximum(products.min(axis=1, initial=np.inf), -products.max(axis=1, initial=-np.inf)) > -_NEAR
    return [tuple(group) for group in groups[flat | near].tolist()]


def enclosing_rows(vertices: Floats, rays: Floats) -> tuple[Floats, Floats]:
    """Return rows C x + d ≥ 0 of the closed hull of vertices and rays.

    Parameters
    ----------
    vertices, rays : (p, k) and (q, k) arrays
        Ends of the hull, which fills the space.

    Returns
    -------
    (r, k) array, (r,) array
        C with largest entry 1, and d. Every vertex and ray satisfies the rows up to rounding.
    """
    return _enclosing_rows(vertices.tobytes(), rays.tobytes(), vertices.shape[1])


@lru_cache(maxsize=64)
def _enclosing_rows(of_vertices: bytes, of_rays: bytes, k: int) -> tuple[Floats, Floats]:
    """Return rows, as `enclosing_rows`, of numbers given as bytes; callers must not write to them."""
    vertices, rays = (np.frombuffer(part).reshape(-1, k) for part in (of_vertices, of_rays))
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
    for start in range(_TRIES):  # a few ends after the other leave out most at once
        normals = normals[(normals @ generators[start::_TRIES].T).min(axis=1, initial=np.inf) > -_INSIDE]
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
    near = abs(normals[:, None] - normals[None]).max(axis=2, initial=0.0) < 10.0 * _SAME
    return np.asarray(~np.any(np.tril(near, -1), axis=1))
