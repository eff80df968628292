"""Yield criteria of faces, stated as rows: the interface of a plug-in, and the check of what it states.

A criterion speaks of stresses, so that its numbers are material constants: n = N/A, pressure positive, V/A, and the
scaled moment M/(A l/2). Compressed at its edge, a face has |m| = n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import BaseModel

from jld_core.arrays import Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.errors import InputError
from jld_core.mechanics.standard import Bending
from jld_core.strengths import Parameter, StatedCriterion, criterion_of


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
        one = np.where(np.any(coefficients != 0.0, axis=2), 1.0, 0.0)
        if self.dimension == 2:
            return np.stack([one, 0.0 * one, -coefficients[..., 1]], axis=2)
        return np.concatenate([one[..., None], -coefficients], axis=2)


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


def geometry_of(faces: Interfaces, which: Ints, bending: Bending | None, label: Any) -> FaceGeometry:
    own = faces.take(which)
    if bending is None:
        edge = np.array([[0.0, 1.0], [0.0, -1.0]])
        edges, kern = (np.broadcast_to(scale * edge, (len(which), 2, 2)) for scale in (1.0, 3.0))
    else:
        edges, kern = (bending.table(dry=dry)[0][which] for dry in (True, False))
    return FaceGeometry(
        *(label, faces.normal.shape[1]),
        *(own.normal, own.e1, own.e2, own.l1, own.l2, own.area, own.c_t, own.origin, edges, kern),
    )


def rows_of(one: StatedCriterion, geometry: FaceGeometry) -> FaceRows:
    """Return the checked rows of a criterion for k faces.

    InputError: wrong shapes, numbers not finite, negative d, shear in space without limit.
    """
    key, k, dimension = one.key, len(geometry), geometry.dimension
    criterion = criterion_of(one.name, key)
    try:
        found = criterion.rows(geometry, one.values)
        c = np.asarray(found.C, dtype=float)
        rows = np.array(np.broadcast_to(c, (k, *c.shape[-2:])))
        constants = np.array(np.broadcast_to(np.asarray(found.d, dtype=float), rows.shape[:2]))
        gauges = tuple(_arrays(gauge, k) for gauge in found.gauges)
    except InputError as error:  # ".key" of what a scene states, and what is wrong with it
        where = one.key + error.where if error.where.startswith(".") else error.where
        raise InputError(where, error.problem, error.expected) from None
    except Exception as error:  # whatever the code of a stranger raises
        shapes = "FaceRows with C (k, r, q), d (k, r)"
        raise InputError(key, f'the rows of "{one.name}" are unusable: {error!r}', shapes) from error
    numbers = [rows, constants, *(part for gauge in gauges for part in vars(gauge).values() if part is not None)]
    if rows.shape[2] not in (3, 3 * dimension - 3) or not all(np.isfinite(part).all() for part in numbers):
        problem = f'the rows of "{one.name}" are no finite numbers of 3{" or 6" * (dimension == 3)} columns'
        raise InputError(key, problem, "C (k, r, q) and d (k, r)")
    idle = ~np.any(rows != 0.0, axis=2)
    wrong = np.argwhere(constants < 0.0)
    if len(wrong):
        face, row = (int(x) for x in wrong[0])
        problem = f'row {row} of "{one.name}" is {constants[face, row]:g} without force'
        raise InputError(key, problem, "d of at least 0: zero inside the yield set")
    constants[idle] = 0.0
    if dimension == 3:
        own = np.any(rows != 0.0, axis=(0, 1))
        held = [own[1] or own[2], own[5]] if len(own) == 6 else [False, False]
        limits = [sum(gauge.shear is not None for gauge in gauges), sum(np.any(gauge.torsion) for gauge in gauges)]
        odd = any(count + by_rows != 1 for count, by_rows in zip(limits, held, strict=True))
        if odd or any(np.any(gauge.torsion) != np.all(gauge.torsion) for gauge in gauges):
            problem = f'{limits[0]} gauges of "{one.name}" limit shear and {limits[1]} limit torsion'
            raise InputError(key, problem, "one for both, or one for each, or rows of six columns")
        if any(gauge.shear is not None and np.min(abs(np.linalg.det(gauge.shear))) <= 0.0 for gauge in gauges):
            raise InputError(key, f'a matrix B of "{one.name}" is singular', "a limit on both directions of shear")
        if any(np.min(part) < 0.0 for gauge in gauges for part in (gauge.torsion, gauge.capacity, gauge.friction)):
            raise InputError(key, f'a number of a gauge of "{one.name}" is negative', "k, c and μ of at least 0")
    elif gauges:
        raise InputError(key, f'"{one.name}" states gauges in the plane', "rows of (n, v, m) alone")
    return FaceRows(rows, constants, gauges)


def _arrays(gauge: Gauge, k: int) -> Gauge:
    shear = None if gauge.shear is None else np.array(np.broadcast_to(np.asarray(gauge.shear, dtype=float), (k, 2, 2)))
    numbers = (gauge.torsion, gauge.capacity, gauge.friction)
    return Gauge(shear, *(np.array(np.broadcast_to(np.asarray(one, dtype=float), (k,))) for one in numbers))
