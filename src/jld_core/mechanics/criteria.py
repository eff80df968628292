"""Yield criteria of faces, stated as rows: the interface of a plug-in, its check, and the yield sets that follow.

A criterion speaks of stresses, so that its numbers are material constants: n = N/A, pressure positive, V/A, and the
scaled moment M/(A l/2). Compressed at its edge, a face has |m| = n. Vertices of rows are found in exact arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import combinations
from math import gcd
from operator import mul
from typing import Any, Final, Literal, Protocol

import numpy as np
from pydantic import BaseModel

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly, Interfaces
from jld_core.errors import InputError
from jld_core.mechanics.equilibrium import Scaling
from jld_core.mechanics.row_yield import LabelRows, RowYield
from jld_core.mechanics.standard import (
    ROUTE_OF_ROWS,
    Bending,
    InnerBending,
    bending_of,
    scaled_strengths,
    standard_rows,
    standard_yield,
)
from jld_core.mechanics.yield_set import YieldSet
from jld_core.strengths import Parameter, StatedCriterion, Strengths, criterion_of


@dataclass(frozen=True)
class FaceGeometry:
    """Faces for which a criterion is asked.

    Attributes
    ----------
    label : {"dry", "inner"}
        Label for which the yield set is asked.
    dimension : int
        2 or 3.
    normal, e1, e2 : (k, d) arrays
        Unit frame of each face; the normal points from its first to its second element. Planar: e2 is empty.
    l1, l2, area, torsion_length : (k,) arrays
        Sizes, scene units: planar length and thickness. The torsion length is that of docs/method.md (2.7).
    origin : (k, d) array
        Centroids.
    edges : (k, r, 2) array
        Coefficients c of the moments (m1, m2) of each edge of the hull: c·m ≤ n keeps the centre of pressure on the
        face. Planar: of (0, m).
    kern : (k, r, 2) array
        Coefficients c of the moments for elastic stress: n − c·m is the stress along an edge, or at a corner.
    """

    label: Literal["dry", "inner"]
    dimension: int
    normal: Floats
    e1: Floats
    e2: Floats
    l1: Floats
    l2: Floats
    area: Floats
    torsion_length: Floats
    origin: Floats
    edges: Floats
    kern: Floats

    def __len__(self) -> int:
        return len(self.area)

    def bending(self, coefficients: Floats) -> Floats:
        """Return the rows n − c·m of coefficients c, `edges` or `kern`, to take as part of `FaceRows.C`.

        Parameters
        ----------
        coefficients : (k, r, 2) array
            Coefficients of the moments.

        Returns
        -------
        (k, r, 3) array
            Rows of (n, v, m) in the plane, and of (n, m1, m2) in space; zeros where a face has fewer edges.
        """
        ones = np.where(np.any(coefficients != 0.0, axis=2), 1.0, 0.0)
        if self.dimension == 2:
            return np.stack([ones, 0.0 * ones, -coefficients[..., 1]], axis=2)
        return np.concatenate([ones[..., None], -coefficients], axis=2)


@dataclass(frozen=True)
class Gauge:
    """Limit on shear in space: |B (V1, V2)| + k |MT| ≤ c + μ N, as stresses, with MT over the torsion length.

    Attributes
    ----------
    shear : (2, 2) or (k, 2, 2) array or None
        B, not singular; None: this gauge does not limit shear.
    torsion : float or (k,) array
        k; 0: this gauge does not limit torsion.
    capacity : float or (k,) array
        c, the resistance without N, stress.
    friction : float or (k,) array
        μ.
    """

    shear: Floats | None
    torsion: float | Floats = 1.0
    capacity: float | Floats = 0.0
    friction: float | Floats = 0.0


@dataclass(frozen=True)
class FaceRows:
    """Yield set of k faces under one label, in stresses: C x + d ≥ 0.

    Attributes
    ----------
    C : (r, q) or (k, r, q) array
        Rows of x = (n, v, m) in the plane; in space of x = (n, m1, m2), or of all six, (n, v1, v2, m1, m2, mT). Rows
        of zeros are idle.
    d : (r,) or (k, r) array
        Constants, stress, at least 0: without force a face is safe.
    gauges : tuple of Gauge
        Space: limits on shear and torsion. One limits both together, or one limits each; what rows limit needs none.
    """

    C: Floats
    d: Floats
    gauges: tuple[Gauge, ...] = field(default=())


class Criterion(Protocol):
    """Yield criterion that a package adds, the object that its entry point in `jld.criteria` names."""

    label: Literal["dry", "inner", "either"]
    """Label of the faces that it is for."""

    parameters: Sequence[Parameter] | type[BaseModel]
    """Numbers that a scene states, or a model of pydantic of what it states."""

    def rows(self, faces: FaceGeometry, values: Any) -> FaceRows:
        """Return the yield set of faces.

        values: numbers by name, or an instance of the model. Result: rows of k faces, or of one for all of them.
        """


def geometry_of(faces: Interfaces, rows: Ints, bending: Bending | None, label: Any) -> FaceGeometry:
    chosen = faces.take(rows)
    if bending is None:
        edge = np.array([[0.0, 1.0], [0.0, -1.0]])
        edges, kern = (np.broadcast_to(scale * edge, (len(rows), 2, 2)) for scale in (1.0, 3.0))
    else:
        edges, kern = (bending.table(dry=dry)[0][rows] for dry in (True, False))
    frame, sizes = (chosen.normal, chosen.e1, chosen.e2), (chosen.l1, chosen.l2, chosen.area, chosen.c_t)
    return FaceGeometry(label, faces.normal.shape[1], *frame, *sizes, chosen.origin, edges, kern)


def rows_of(source: StatedCriterion, geometry: FaceGeometry) -> FaceRows:
    """Return the checked rows of a criterion for k faces.

    InputError: wrong shapes, numbers not finite, negative d, shear in space without limit.
    """
    key, k, dimension = source.key, len(geometry), geometry.dimension
    criterion = criterion_of(source.name, key)
    try:
        raw = criterion.rows(geometry, source.values)
        c = np.asarray(raw.C, dtype=float)
        rows = np.array(np.broadcast_to(c, (k, *c.shape[-2:])))
        constants = np.array(np.broadcast_to(np.asarray(raw.d, dtype=float), rows.shape[:2]))
        gauges = tuple(_arrays(gauge, k) for gauge in raw.gauges)
    except InputError as error:  # ".key" of what a scene states, and what is wrong with it
        where = source.key + error.where if error.where.startswith(".") else error.where
        raise InputError(where, error.problem, error.expected) from None
    except Exception as error:  # whatever the code of a stranger raises
        shapes = "FaceRows with C (k, r, q), d (k, r)"
        raise InputError(key, f'the rows of "{source.name}" are unusable: {error!r}', shapes) from error
    numbers = [rows, constants, *(values for gauge in gauges for values in vars(gauge).values() if values is not None)]
    if rows.shape[2] not in (3, 3 * dimension - 3) or not all(np.isfinite(values).all() for values in numbers):
        problem = f'the rows of "{source.name}" are no finite numbers of 3{" or 6" * (dimension == 3)} columns'
        raise InputError(key, problem, "C (k, r, q) and d (k, r)")
    idle = ~np.any(rows != 0.0, axis=2)
    negative = np.argwhere(constants < 0.0)
    if len(negative):
        face, row = (int(x) for x in negative[0])
        problem = f'row {row} of "{source.name}" is {constants[face, row]:g} without force'
        raise InputError(key, problem, "d of at least 0: zero inside the yield set")
    constants[idle] = 0.0
    if dimension == 3:
        _refuse_gauges(source, rows, gauges)
    elif gauges:
        raise InputError(key, f'"{source.name}" states gauges in the plane', "rows of (n, v, m) alone")
    return FaceRows(rows, constants, gauges)


def _refuse_gauges(criterion: StatedCriterion, rows: Floats, gauges: tuple[Gauge, ...]) -> None:
    """Raise InputError unless rows or one gauge limit shear, and likewise torsion."""
    key, name = criterion.key, criterion.name
    limits = np.any(rows != 0.0, axis=(0, 1))  # (q,) resultants that rows limit
    shear_by_rows, torsion_by_rows = (limits[1] or limits[2], limits[5]) if len(limits) == 6 else (False, False)
    of_shear = sum(gauge.shear is not None for gauge in gauges)
    of_torsion = sum(np.any(gauge.torsion) for gauge in gauges)
    limited_once = of_shear + shear_by_rows == 1 and of_torsion + torsion_by_rows == 1
    if not limited_once or any(np.any(gauge.torsion) != np.all(gauge.torsion) for gauge in gauges):
        problem = f'{of_shear} gauges of "{name}" limit shear and {of_torsion} limit torsion'
        raise InputError(key, problem, "one for both, or one for each, or rows of six columns")
    if any(gauge.shear is not None and np.min(abs(np.linalg.det(gauge.shear))) <= 0.0 for gauge in gauges):
        raise InputError(key, f'a matrix B of "{name}" is singular', "a limit on both directions of shear")
    if any(np.min(values) < 0.0 for gauge in gauges for values in (gauge.torsion, gauge.capacity, gauge.friction)):
        raise InputError(key, f'a number of a gauge of "{name}" is negative', "k, c and μ of at least 0")


def _arrays(gauge: Gauge, k: int) -> Gauge:
    shear = None if gauge.shear is None else np.array(np.broadcast_to(np.asarray(gauge.shear, dtype=float), (k, 2, 2)))
    numbers = (gauge.torsion, gauge.capacity, gauge.friction)
    return Gauge(shear, *(np.array(np.broadcast_to(np.asarray(number, dtype=float), (k,))) for number in numbers))


# Violation of a row, relative to its terms, above which a point of intersection is no vertex in floats
_NEAR: Final = 1e-6

# Size of the minors of unit rows below which their line of intersection is found in exact arithmetic alone
_FLAT: Final = 1e-9
_TRIES: Final = 8  # parts in which the ends of a hull are tried as normals of its facets
_SAME: Final = 1e-9  # distance below which two unit normals of facets are one

# Distance of a vertex beyond a row, relative to all, below which the row is a facet; rows are moved out then
_INSIDE: Final = 1e-11
Vector = tuple[int, ...]  # point or ray in homogeneous coordinates: (x w, w) with w > 0, and (x, 0)


def corners(rows: Floats, constants: Floats) -> tuple[Floats, Floats]:
    """Return the vertices (p, k) and extreme rays (q, k) of {x : C x + d ≥ 0}, C (r, k) and d (r,).

    Both are exact for the numbers given, then rounded. A ray has N = 1 where its N is positive, else size 1. Rows of
    zeros are ignored. The set must hold no line.
    """
    # Extreme rays (x w, w) of the cone {C x + d w ≥ 0, w ≥ 0}: a vertex x where w > 0, a ray of the set where w = 0.
    is_row = np.any(rows != 0.0, axis=1)
    table = np.column_stack([rows[is_row], constants[is_row]])
    generators = _corners(np.vstack([table, np.eye(table.shape[1])[-1:]]).tobytes(), table.shape[1])
    points_and_rays: list[list[list[float]]] = [[], []]
    for *point, w in generators:
        size = w or (point[0] if point[0] > 0 else max(map(abs, point)))
        points_and_rays[w == 0].append([float(Fraction(x, size)) for x in point])
    return tuple(np.array(generators_of_kind).reshape(-1, rows.shape[1]) for generators_of_kind in points_and_rays)  # type: ignore[return-value]


@lru_cache(maxsize=4096)
def _corners(table: bytes, width: int) -> tuple[Vector, ...]:
    """Return the extreme rays (x w, w) of the cone {C x + d w ≥ 0, w ≥ 0} of numbers given as bytes."""
    floats = np.frombuffer(table).reshape(-1, width)
    exact = [_integers(row) for row in floats.tolist()]
    generators: dict[Vector, None] = {}
    tight_sets: set[tuple[int, ...]] = set()  # rows that hold with equality at what was found, and at nothing else
    for group in _candidates(floats):
        if any(set(group) <= set(touched) for touched in tight_sets):
            continue
        line = _line([exact[row] for row in group])
        if line is None:
            continue
        products = [sum(map(mul, row, line)) for row in exact]
        sign = -1 if any(product < 0 for product in products) else 1
        if all(sign * product >= 0 for product in products) and any(products):
            generators[tuple(sign * x for x in line)] = None
            tight_sets.add(tuple(row for row, product in enumerate(products) if product == 0))
    return tuple(generators)


def _integers(row: list[float]) -> list[int]:
    """Return numbers times the smallest power of two that makes them whole."""
    ratios = [value.as_integer_ratio() for value in row]
    common = max(denominator for _, denominator in ratios)
    return [numerator * (common // denominator) for numerator, denominator in ratios]


def _line(rows: list[list[int]]) -> Vector | None:
    """Return the line that is orthogonal to k rows (k, k + 1), without common factor; None if there are several."""
    # Elimination without fractions: after each step all entries are minors, and divide by the pivot before.
    matrix, columns, previous_pivot = [list(row) for row in rows], list(range(len(rows) + 1)), 1
    for step in range(len(matrix)):
        places = ((i, j) for j in range(step, len(columns)) for i in range(step, len(matrix)) if matrix[i][j])
        place = next(places, None)
        if place is None:
            return None
        matrix[step], matrix[place[0]] = matrix[place[0]], matrix[step]
        for row in (*matrix, columns):
            row[step], row[place[1]] = row[place[1]], row[step]
        pivot = matrix[step][step]
        for i, row in enumerate(matrix):
            if i != step:
                factor = row[step]
                matrix[i] = [(pivot * x - factor * y) // previous_pivot for x, y in zip(row, matrix[step], strict=True)]
        previous_pivot = pivot
    line = [0] * len(columns)
    line[columns[-1]] = previous_pivot
    for row, column in zip(matrix, columns[:-1], strict=True):
        line[column] = -row[-1]
    divisor = gcd(*line)
    return tuple(x // divisor for x in line)


def _candidates(table: Floats) -> list[tuple[int, ...]]:
    """Return the groups of rows that may meet in a vertex or ray: those whose line violates no row by far in floats."""
    width = table.shape[1]
    groups = np.array(list(combinations(range(len(table)), width - 1)), dtype=np.int64).reshape(-1, width - 1)
    largest_constant = abs(table[:, -1]).max(initial=0.0) or 1.0
    scaled = table / np.append(np.ones(width - 1), largest_constant)
    unit = scaled / np.linalg.norm(scaled, axis=1)[:, None]
    lines = _normals(unit[groups])
    sizes = np.linalg.norm(lines, axis=1)
    is_flat = sizes < _FLAT
    products = (lines / np.where(is_flat, 1.0, sizes)[:, None]) @ unit.T
    is_near = np.maximum(products.min(axis=1, initial=np.inf), -products.max(axis=1, initial=-np.inf)) > -_NEAR
    return [tuple(group) for group in groups[is_flat | is_near].tolist()]


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
    scale = float(abs(vertices).max(initial=0.0)) or 1.0
    ray_sizes = np.linalg.norm(rays, axis=1, keepdims=True)
    generators = np.unique(
        np.vstack([
            np.column_stack([vertices / scale, np.ones(len(vertices))]),
            np.column_stack([rays / np.where(ray_sizes > 0.0, ray_sizes, 1.0), np.zeros(len(rays))]),
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
    normals = normals[_is_first_of_equal(normals)]
    rows = normals[:, :k] / abs(normals[:, :k]).max(axis=1, keepdims=True)
    rows[abs(rows) < 1e-14] = 0.0
    return rows, -(rows @ vertices.T).min(axis=1)


def _normals(groups: Floats) -> Floats:
    """Return the vector (g, k + 1) orthogonal to each group (g, k, k + 1) of vectors."""
    k = groups.shape[1]
    columns = [np.delete(groups, axis, axis=2) for axis in range(k + 1)]
    return np.column_stack([(-1.0) ** axis * np.linalg.det(part) for axis, part in enumerate(columns)])


def _is_first_of_equal(normals: Floats) -> Bools:
    is_same = abs(normals[:, None] - normals[None]).max(axis=2, initial=0.0) < 10.0 * _SAME
    return np.asarray(~np.any(np.tril(is_same, -1), axis=1))


_ROUNDED: Final = 1e-12  # share of a strength by which N may pass the apex of friction in rounding
_MOST: Final = 600_000  # largest number of groups of rows that are tried for vertices and rays
_TOUCHES: Final = 1e-12  # distance of a vertex from a row, relative to strengths, below which the row touches it


def row_yield(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> RowYield:
    """Make the yield sets of all faces from rows; InputError for joints that crush and unusable rows."""
    dry, inner = _of_stresses(assembly, inner_bending)
    sets = _align_rows(assembly.dimension, [dry, inner, _enclosing(assembly.dimension, dry, inner)])
    dry, inner, both = (rows.scaled(assembly.interfaces.area / scaling.force) for rows in sets)
    return RowYield(assembly.dimension, dry, inner, both, assembly.face_strengths.criteria)


def _of_stresses(assembly: Assembly, inner_bending: InnerBending) -> tuple[LabelRows, LabelRows]:
    """Return the sets of dry and of inner faces in stresses; raise InputError as `row_yield`."""
    numbers, bending = assembly.strengths(ROUTE_OF_ROWS), None
    if assembly.dimension == 3:
        no_points = np.zeros(len(assembly.interfaces), dtype=bool)
        bending = bending_of(assembly.interfaces, no_points, inner_bending, np.isfinite(numbers.side(dry=False).crush))
    groups = [_rows(assembly, numbers, bending, label) for label in (True, False)]
    width = max(rows.C.shape[2] for group in groups for _, rows in group)
    dry, inner = (_compile(assembly, group, width, label) for group, label in zip(groups, (True, False), strict=True))
    return dry, inner


def maps_criteria(assembly: Assembly, face_to: Ints, matrix: Floats) -> bool:
    """Return whether a symmetry maps the yield set of each face onto that of its image, under both labels.

    V and m of a face may change sign, so that equal parameters are no equal sets. Sets are known to be mapped where the
    axes of a face are mapped onto those of its image. True without criteria of plug-ins: strengths then say all.
    """
    if not assembly.face_strengths.criteria:
        return True
    faces, handedness = assembly.interfaces, float(np.sign(np.linalg.det(matrix)))
    image = faces.take(face_to)
    sides = np.sign(np.einsum("mi,mi->m", faces.normal @ matrix.T, image.normal))
    count, sets = len(faces), _of_stresses(assembly, "uncoupled")
    core_map, shear_map = np.tile(np.eye(sets[0].C.shape[2]), (count, 1, 1)), np.tile(np.eye(2), (count, 1, 1))
    if assembly.dimension == 2:
        core_map[:, 1, 1], core_map[:, 2, 2] = handedness, handedness * sides
    else:
        axes = [np.stack([interfaces.e1, interfaces.e2], axis=2) for interfaces in (faces, image)]
        axes_map = np.round(np.swapaxes(axes[1], 1, 2) @ matrix @ axes[0], 9)
        if not np.isin(axes_map, (-1.0, 0.0, 1.0)).all():
            return False
        shear_map = sides[:, None, None] * axes_map
        if core_map.shape[1] == 6:
            core_map[:, 1:3, 1:3], core_map[:, 5, 5] = shear_map, handedness
        bends = slice(1, 3) if core_map.shape[1] == 3 else slice(3, 5)
        core_map[:, bends, bends] = handedness * shear_map
    return all(_maps_onto_image(rows, face_to, core_map, shear_map) for rows in sets)


def _maps_onto_image(sets: LabelRows, image_of: Ints, core: Floats, shear: Floats) -> bool:
    """Return True if maps of the core (m, q, q) and of shear (m, 2, 2) turn each set into that of its image."""
    for points in (sets.vertices, sets.rays):
        if not points.shape[1]:
            continue
        mapped, of_image = points @ np.swapaxes(core, 1, 2), points[image_of]
        size = max(1e-300, float(abs(points).max()))
        is_equal = abs(mapped[:, :, None] - of_image[:, None]).max(axis=3) <= 1e-9 * size
        if not (is_equal.any(axis=1).all() and is_equal.any(axis=2).all()):
            return False
    metric = np.swapaxes(sets.B, 1, 2) @ sets.B
    if not np.allclose(np.swapaxes(shear, 1, 2) @ metric[image_of] @ shear, metric, rtol=1e-9, atol=1e-12):
        return False
    numbers = np.column_stack([sets.k, sets.c, sets.mu, sets.coupled])
    return bool(np.allclose(numbers[image_of], numbers, rtol=1e-9, atol=0.0))


def stated_rows(assembly: Assembly) -> dict[tuple[int, bool], FaceRows]:
    """Return the rows that criteria state, not yet scaled, by face and label (True = dry)."""
    numbers, bending = assembly.strengths(ROUTE_OF_ROWS), None
    if assembly.dimension == 3:
        no_points = np.zeros(len(assembly.interfaces), dtype=bool)
        bending = bending_of(assembly.interfaces, no_points, "uncoupled", np.isfinite(numbers.side(dry=False).crush))
    stated = {}
    for dry in (True, False):
        _, *groups = _rows(assembly, numbers, bending, dry)  # without the standard rows
        for faces, rows in groups:
            for position, face in enumerate(faces.tolist()):
                gauges = tuple(_gauge_of(gauge, np.arange(len(faces)) == position) for gauge in rows.gauges)
                stated[face, dry] = FaceRows(rows.C[position], rows.d[position], gauges)
    return stated


def _standard(numbers: Strengths, bending: Bending | None, *, dry: bool) -> FaceRows:
    """Return the standard criterion's rows under one label, in stresses; in the plane they limit V too."""
    point = np.zeros(len(numbers.friction), dtype=bool)
    side = scaled_strengths(numbers, np.ones(len(point))).side(dry=dry)
    late_rows = 2 if bending is None else int(np.diff(bending.start).max(initial=0))
    core = standard_rows(side, bending, point, 0 if dry else late_rows, dry=dry)
    if bending is not None:
        return FaceRows(core.C, core.d, (Gauge(core.B, core.k[:, 1], side.shear, side.friction),))
    ones = np.ones(len(side.shear))
    shear_rows = np.stack([side.friction, -ones, 0.0 * ones, side.friction, ones, 0.0 * ones], axis=1).reshape(-1, 2, 3)
    limits = np.column_stack([side.shear, side.shear])
    return FaceRows(np.concatenate([core.C, shear_rows], axis=1), np.concatenate([core.d, limits], axis=1))


def _rows(assembly: Assembly, numbers: Strengths, bending: Bending | None, dry: bool) -> list[tuple[Ints, FaceRows]]:
    """Return the rows of one label by groups of faces (k,): standard ones, and those of each criterion."""
    label = "dry" if dry else "inner"
    is_standard, groups = np.ones(len(assembly.interfaces), dtype=bool), []
    for criterion in assembly.face_strengths.criteria:
        faces = np.flatnonzero(criterion.faces)
        if criterion.label == label and faces.size:
            groups.append((faces, rows_of(criterion, geometry_of(assembly.interfaces, faces, bending, label))))
            is_standard[faces] = False
    standard = _standard(numbers, bending, dry=dry)
    gauges = tuple(_gauge_of(gauge, is_standard) for gauge in standard.gauges)
    return [(np.flatnonzero(is_standard), FaceRows(standard.C[is_standard], standard.d[is_standard], gauges)), *groups]


def _gauge_of(gauge: Gauge, faces: Bools) -> Gauge:
    numbers = (np.asarray(part)[faces] for part in (gauge.torsion, gauge.capacity, gauge.friction))
    return Gauge(None if gauge.shear is None else gauge.shear[faces], *numbers)


def _compile(assembly: Assembly, groups: list[tuple[Ints, FaceRows]], width: int, dry: bool) -> LabelRows:
    """Return one label's sets in stresses: needed rows, vertices, rays, class of each face.

    width: resultants of the core. InputError for unusable rows.
    """
    count, most_rows = len(assembly.interfaces), max(rows.C.shape[1] for _, rows in groups)
    table = np.zeros((count, most_rows, width + 1))
    for faces_of_group, rows in groups:
        size = abs(rows.C).max(axis=2, initial=0.0)
        size = np.where(size > 0.0, size, 1.0)[..., None]
        columns = np.arange(width) if rows.C.shape[2] == width else np.array([0, 3, 4])
        entries = faces_of_group[:, None, None], np.arange(rows.C.shape[1])[:, None]
        table[(*entries, columns)], table[(*entries, [width])] = rows.C / size, rows.d[..., None] / size
    tables, first, table_of_face = np.unique(table.reshape(count, -1), axis=0, return_index=True, return_inverse=True)
    table_of_face = table_of_face.ravel()
    criteria = [criterion for criterion in assembly.face_strengths.criteria if (criterion.label == "dry") == dry]
    cores = []
    for distinct, face in zip(tables.reshape(-1, most_rows, width + 1), first, strict=True):
        # what an error names: the criterion of a face that has these rows
        names = ((criterion.key, criterion.name) for criterion in criteria if criterion.faces[face])
        cores.append(_core(distinct, *next(names, ("materials", "standard"))))
    limits, vertices, rays = (_pad([core[k] for core in cores], repeat=k == 1)[table_of_face] for k in range(3))
    shear, numbers, coupled = _gauges(groups, count)
    k, c, mu = numbers
    compiled = LabelRows(limits[..., :-1], limits[..., -1], shear, k, c, mu, coupled, vertices, rays, table_of_face)
    for criterion in criteria:
        low = vertices[criterion.faces, :, 0].min(axis=1, initial=np.inf)[:, None]
        spare = c[criterion.faces] + mu[criterion.faces] * low
        if spare.min(initial=0.0) < -_ROUNDED * max(1e-300, float(c[criterion.faces].max(initial=0.0))):
            problem = f'N of "{criterion.name}" reaches {float(low.min()):g}, where c + μN is negative'
            raise InputError(criterion.key, problem, "N of at least −c/μ")
    return compiled


def _gauges(groups: list[tuple[Ints, FaceRows]], count: int) -> tuple[Floats, Floats, Bools]:
    """Return B (m, 2, 2); k, c and μ (3, m, 2) of the gauge of shear, then of torsion; True (m,) where one is both."""
    # Gauges are divided by the larger of the size of B and k. Where rows limit shear, B is zero.
    shear, coupled = np.zeros((count, 2, 2)), np.zeros(count, dtype=bool)
    numbers = np.zeros((3, count, 2))
    for faces, rows in groups:
        for gauge in rows.gauges:
            k, c, mu = (np.asarray(values) for values in (gauge.torsion, gauge.capacity, gauge.friction))
            size = np.array(k)
            if gauge.shear is not None:
                size = np.maximum(size, np.linalg.norm(gauge.shear, ord=2, axis=(1, 2)))
                shear[faces] = gauge.shear / size[:, None, None]
                coupled[faces] = k > 0.0
            limited = (gauge.shear is not None, bool(np.all(k > 0.0)))
            for column, factor in enumerate((size, k)):
                if limited[column] and len(faces):
                    numbers[:, faces, column] = np.array([factor, c, mu]) / size
    return shear, numbers, coupled


def _pad(arrays: list[Floats], *, repeat: bool) -> Floats:
    """Return arrays (r, q) of several lengths as one (k, most, q), filled with zeros or with their first row."""
    longest = max(len(array) for array in arrays)
    padded = np.zeros((len(arrays), longest, arrays[0].shape[1]))
    for number, array in enumerate(arrays):
        padded[number, : len(array)] = array
        if repeat:
            padded[number, len(array) :] = array[0]
    return padded


def _core(table: Floats, key: str, name: str) -> tuple[Floats, Floats, Floats]:
    """Return rows (r, q + 1), vertices (p, q) and rays (r, q) of a core; InputError for an unusable set."""
    table = np.unique(table[np.any(table[:, :-1] != 0.0, axis=1)], axis=0)
    width = table.shape[1] - 1
    # N and moments count always, spatial shear (V1 with V2) and torsion only where rows name them
    resultants = np.any(table[:, :-1] != 0.0, axis=0) | ((width == 3) | np.isin(np.arange(width), [0, 3, 4]))
    resultants[1:3] |= (width == 6) & resultants[1:3].any()
    count, rows, constants = int(resultants.sum()), table[:, :-1][:, resultants], table[:, -1]
    if np.linalg.matrix_rank(rows) < count if len(rows) else True:
        raise InputError(key, f'"{name}" leaves a force or moment without limit', "rows that limit all of them")
    if math.comb(len(rows) + 1, count) > _MOST:
        raise InputError(key, f'"{name}" has {len(rows)} rows of {count} resultants', "fewer rows")
    generators_of_kind = corners(rows, constants)
    vertices, rays = (np.zeros((len(points), width)) for points in generators_of_kind)
    vertices[:, resultants], rays[:, resultants] = generators_of_kind
    if not len(vertices):
        raise InputError(key, f'no force satisfies all rows of "{name}"', "a set that is not empty")
    if rays[:, 0].min(initial=0.0) < 0.0:
        raise InputError(key, f'"{name}" lets N fall without limit', "a tensile strength")
    if not (vertices[:, 0].any() or rays[:, 0].any()):
        raise InputError(key, f'"{name}" carries no N', "rows that let N act")
    generators = np.vstack([np.column_stack([vertices, np.ones(len(vertices))]), np.pad(rays, ((0, 0), (0, 1)))])
    if np.linalg.matrix_rank(generators) == count + 1:
        # A facet holds as many extreme points or rays as resultants; other rows touch the set, or stay away.
        gap = abs(generators @ table.T) / np.maximum(abs(generators).max(axis=1), 1e-300)[:, None]
        table = table[(gap <= _TOUCHES * max(1.0, float(constants.max()))).sum(axis=0) >= count]
    return table, vertices, rays


def _enclosing(dimension: int, dry: LabelRows, inner: LabelRows) -> LabelRows:
    """Return sets of stresses that enclose those of both labels."""
    # The cores have hulls of (N, moments), and of N with what rows limit of shear and torsion. A gauge is the widest
    # circle in the two of shear, with a line above the capacities of both labels.
    vertices = np.concatenate([dry.vertices, inner.vertices], axis=1)
    rays = np.concatenate([dry.rays, inner.rays], axis=1)
    facts = [
        part for label in (dry, inner) for part in (label.kind, label.B.reshape(-1, 4), label.k, label.c, label.mu)
    ]
    _, first, kind_of_face = np.unique(np.column_stack(facts), axis=0, return_index=True, return_inverse=True)
    parts = [_hull_of(dimension, dry, inner, face) for face in first.tolist()]
    kind_of_face = kind_of_face.ravel()
    table = _pad(parts, repeat=False)[kind_of_face]
    ranges = [(label.vertices[:, :, 0].min(axis=1), label.vertices[:, :, 0].max(axis=1)) for label in (dry, inner)]
    low = vertices[:, :, 0].min(axis=1)[:, None]
    friction = np.max([np.where(label.endless[:, None], label.mu, 0.0) for label in (dry, inner)], axis=0)
    # The line starts at the least N of both, above every end of the capacities.
    start = np.max(
        [
            label.c + label.mu * end[:, None] - friction * (end[:, None] - low)
            for label, (bottom, top) in zip((dry, inner), ranges, strict=True)
            for end in (bottom, np.where(label.endless, bottom, top))
        ],
        axis=0,
    )
    shear = np.min([np.linalg.svd(label.B, compute_uv=False)[:, 1] for label in (dry, inner)], axis=0)
    torsion = np.minimum(dry.k, inner.k)
    by_gauge = np.column_stack([shear, torsion[:, 1]]) > 0.0  # the others stand in rows
    return LabelRows(
        table[..., :-1],
        table[..., -1],
        shear[:, None, None] * np.eye(2),
        torsion,
        np.where(by_gauge, start - friction * low, 0.0),
        np.where(by_gauge, friction, 0.0),
        dry.coupled & inner.coupled,
        vertices,
        rays,
        kind_of_face,
    )


def _hull_of(dimension: int, dry: LabelRows, inner: LabelRows, face: int) -> Floats:
    """Return the rows (r, q + 1) of the hulls of both labels of a face, in each part of their core."""
    labels, width = (dry, inner), dry.C.shape[2]
    # Columns that rows of a hull couple: N with bending, with shear where no gauge limits it, with torsion likewise.
    if dimension == 2:
        parts = [[0, 2], [0, 1]]
    else:
        parts = [[0, 1, 2] if width == 3 else [0, 3, 4]]
        if width > 3 and any(not rows.B[face].any() for rows in labels):
            parts.append([0, 1, 2])
        if width > 3 and any(not rows.k[face, 1] for rows in labels):
            parts.append([0, 5])
    table = list[Floats]()
    for columns in parts:
        vertices = np.vstack([_ends(rows, face, columns, "vertices") for rows in labels])
        rays = np.vstack([_ends(rows, face, columns, "rays") for rows in labels])
        enclosing, constants = enclosing_rows(vertices, rays[np.any(rays != 0.0, axis=1)])
        hull = np.zeros((len(enclosing), width + 1))
        hull[:, columns], hull[:, -1] = enclosing, constants
        # All parts have the same range of N, stated by the first.
        table.append(hull if not table else hull[np.any(hull[:, columns[1:]] != 0.0, axis=1)])
    return np.vstack(table)


def _ends(rows: LabelRows, face: int, columns: list[int], kind: str) -> Floats:
    """Return vertices or rays (p, k) of a part of a set; those of a polygon about it where a gauge is its limit."""
    points = np.asarray(getattr(rows, kind)[face][:, columns])
    gauge, has_gauge = int(columns == [0, 5]), rows.B[face].any() if columns == [0, 1, 2] else rows.k[face, 1] > 0.0
    if rows.C.shape[2] == 3 or columns == [0, 3, 4] or not has_gauge:
        return points
    normal = np.unique(points[:, 0])
    capacity = rows.mu[face, gauge] * normal + (rows.c[face, gauge] if kind == "vertices" else 0.0)
    if gauge:
        directions = np.array([[1.0], [-1.0]]) / rows.k[face, 1]
    else:
        angles = (np.arange(8) + 0.5) * np.pi / 4.0
        circle = np.column_stack([np.cos(angles), np.sin(angles)]) / np.cos(np.pi / 8.0)
        directions = circle @ np.linalg.inv(rows.B[face]).T
    points = capacity[:, None, None] * directions
    return np.column_stack([np.repeat(normal, len(directions)), points.reshape(-1, directions.shape[1])])


def _align_rows(dimension: int, sets: list[LabelRows]) -> list[LabelRows]:
    """Return sets whose rows of bending, shear and others have places of their own, so that they share sparsity."""
    # Kinds in the plane: 0 bending alone, 1 shear alone, 2 others; in space: 0 bending with N of coefficient above 0,
    # 1 other bending, 2 with shear or torsion; 3 idle. Within a kind rows stand by falling N, in space by the angle of
    # the moments.
    ordered, kinds = [], []
    for label in sets:
        c = label.C
        idle = ~np.any(c != 0.0, axis=2)
        if dimension == 2:
            kind = np.where(c[..., 1] == 0.0, np.where(c[..., 2] == 0.0, 2, 0), np.where(c[..., 2] == 0.0, 1, 2))
            sort_keys = [np.where(kind == 1, c[..., 1], c[..., 2]), -c[..., 0]]
        else:
            first, shears = (3, [1, 2, 5]) if c.shape[2] == 6 else (1, [])
            limits_shear = np.any(c[..., shears] != 0.0, axis=2)
            kind = np.where(limits_shear, 2, np.where(c[..., 0] > 0.0, 0, 1))
            moments = c[..., first : first + 2]
            sort_keys = [np.round(np.mod(np.arctan2(-moments[..., 1], -moments[..., 0]), 2.0 * np.pi), 12)]
        kind = np.where(idle, 3, kind)
        order = np.tile(np.arange(c.shape[1]), (len(c), 1))
        for key in (*sort_keys, kind):
            order = np.take_along_axis(order, np.argsort(np.take_along_axis(key, order, 1), axis=1, kind="stable"), 1)
        ordered.append((np.take_along_axis(c, order[..., None], 1), np.take_along_axis(label.d, order, 1)))
        kinds.append(np.take_along_axis(kind, order, 1))
    slots = [max(int((kind == number).sum(axis=1).max(initial=0)) for kind in kinds) for number in range(3)]
    p, q = (max(getattr(label, name).shape[1] for label in sets) for name in ("vertices", "rays"))
    aligned = []
    for label, (c, d), kind in zip(sets, ordered, kinds, strict=True):
        rows, constants = np.zeros((*c.shape[:1], sum(slots), c.shape[2])), np.zeros((len(c), sum(slots)))
        for number in range(3):
            face, position = np.nonzero(kind == number)
            first = np.argmax(kind == number, axis=1)[face]
            new_position = sum(slots[:number]) + position - first
            rows[face, new_position], constants[face, new_position] = c[face, position], d[face, position]
        vertices, rays = _repeat_last(label.vertices, p), _repeat_last(label.rays, q)
        aligned.append(replace(label, C=rows, d=constants, vertices=vertices, rays=rays))
    return aligned


def _repeat_last(points: Floats, most: int) -> Floats:
    """Return points (m, p, q), the last repeated until there are `most`; zeros where there are none."""
    missing = most - points.shape[1]
    last = points[:, -1:] if points.shape[1] else np.zeros((len(points), 1, points.shape[2]))
    return np.concatenate([points, np.repeat(last, missing, axis=1)], axis=1)


def yield_set(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> YieldSet:
    """Make the yield sets of all faces of a planar or spatial assembly.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.
    scaling : Scaling
        Scales of the assembly.
    inner_bending : {"uncoupled", "kern"}
        Bending form of inner faces in space; ignored in the plane.

    Returns
    -------
    YieldSet
        One class for plane and space; with the standard criterion alone it also states friction apart.

    Raises
    ------
    InputError
        A dry compressive strength is given for a spatial face that is no rectangle, or a criterion is unusable.
    """
    make = row_yield if assembly.face_strengths.criteria else standard_yield
    return make(assembly, scaling, inner_bending)
