"""Equilibrium of free elements, A_eq F + b + λ b_λ = 0.

Only this module builds its matrices.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.geometry import moment_about
from jld_core.strengths import CRITERIA, STANDARD, Route

# Rounding of a difference of two coordinates, relative to the larger one
_LAST_DIGITS: Final = 4.0 * float(np.finfo(float).eps)


def equilibrium_matrix(assembly: Assembly) -> sp.csc_array:
    """Assemble A_eq: forces, then moments about the centroid, of each free element.

    Column q·f + j is resultant j of interface f, planar (N, V, M), spatial (N, V1, V2, M1, M2, MT). It acts as +F on
    element b and as −F on element a. Supports have no rows. N of a member acts along it, V of a pin across it.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    (q·free, q·m) sparse array
        A_eq in scene units, q = 3 (planar) or 6 (spatial).

    Notes
    -----
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (1.1), (1.2). Entries that are zero by construction are
    exactly zero, see `_clear_rounding`, so that the sparsity does not depend on units, position or order.
    """
    faces, elements, q, d = assembly.interfaces, assembly.elements, assembly.freedoms, assembly.dimension
    count, of_faces = len(faces), ~assembly.of_members
    row_of = np.full(len(elements), -1, dtype=np.int64)
    row_of[elements.free] = np.arange(len(elements.free))
    directions = [faces.normal, faces.e1] if d == 2 else [faces.normal, faces.e1, faces.e2]
    couples = [None] if d == 2 else [faces.e1, faces.e2, faces.normal]
    rows, columns, values = [], [], []
    for element, sign in ((faces.a, -1.0), (faces.b, 1.0)):
        free = (row_of[element] >= 0) & of_faces
        base = q * row_of[element[free]]
        arm = faces.origin[free] - elements.centroid[element[free]]
        unit, least_arm = np.ones(len(base)), _least_arm(assembly, element[free])
        for j in range(q):
            column = q * np.flatnonzero(free) + j
            block = np.zeros((len(base), q))
            if j < d:
                direction = directions[j][free]
                block[:, :d] = direction
                block[:, d:] = moment_about(arm, direction)
                block = _clear_rounding(block, unit, least_arm)
            elif d == 2:
                block[:, 2] = 1.0
            else:
                block[:, 3:] = couples[j - d][free]  # type: ignore[index]
                block = _clear_rounding(block, unit, tolerances.ROUNDING * unit)
            rows.append((base[:, None] + np.arange(q)).ravel())
            columns.append(np.repeat(column, q))
            values.append((sign * block).ravel())
    for member_column, holder, point, force in _of_members(assembly):
        if row_of[holder] >= 0:
            block = np.append(force, moment_about(point - elements.centroid[holder], force))[None]
            size = np.array([float(np.linalg.norm(force))])
            block = _clear_rounding(block, size, size * _least_arm(assembly, np.array([holder])))
            rows.append(q * row_of[holder] + np.arange(q))
            columns.append(np.full(q, member_column))
            values.append(block.ravel())
    row, column, value = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
    nonzero = value != 0.0
    shape = (q * len(elements.free), q * count)
    return sp.csc_array((value[nonzero], (row[nonzero], column[nonzero])), shape=shape)


def _of_members(assembly: Assembly) -> Iterator[tuple[int, int, Floats, Floats]]:
    """Yield the forces of unit resultants of members on elements."""
    # Each entry is the column of A_eq, the element, the point (d,) of application and the force (d,). Bars and pins
    # have no moments, and only pins have shear V.
    members, faces, q = assembly.members, assembly.interfaces, assembly.freedoms
    for k, face in enumerate(members.face.tolist()):
        if face < 0:
            continue
        elements, points, forces = members.push(k)
        if members.axial[k]:
            for element, point, force in zip(elements.tolist(), points, forces, strict=True):
                yield q * face, element, point, force
        if members.kinds[k] == "pin":
            sides = [faces.e1[face]] if assembly.dimension == 2 else [faces.e1[face], faces.e2[face]]
            for number, direction in enumerate(sides, start=1):
                for element, point, sign in zip(elements.tolist(), points, (-1.0, 1.0), strict=True):
                    yield q * face + number, element, point, sign * direction


def load_vectors(assembly: Assembly) -> tuple[Floats, Floats]:
    """Return b and b_λ on the free elements: dead loads with self-weight, and live loads.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    dead, live : (q·free,) arrays
        Forces, then moments about the centroid, of each free element, scene units.
    """
    free = assembly.elements.free
    vectors = []
    # Moments of forces through a centroid, and components that cancel, are rounding of coordinates. They become exactly
    # zero, so that an element without a moment has none wherever the structure lies and in whatever unit.
    for load in (assembly.dead[free], assembly.live[free]):
        force = np.linalg.norm(load[:, : assembly.dimension], axis=1)
        vectors.append(_clear_rounding(load, force, force * _least_arm(assembly, free)).ravel())
    return vectors[0], vectors[1]


def _clear_rounding(block: Floats, force: Floats, moment: Floats) -> Floats:
    """Set entries (k, q) to zero that are rounding errors of forces (k,), or of moments (k,) up to a magnitude."""
    d = 2 if block.shape[1] == 3 else 3
    rounding = np.repeat(np.column_stack([tolerances.ROUNDING * force, moment]), [d, block.shape[1] - d], axis=1)
    return np.where(abs(block) <= rounding, 0.0, block)


def _least_arm(assembly: Assembly, element: Ints) -> Floats:
    """Return the arm (k,) below which one is rounding: `ROUNDING` radii, or last digits of coordinates."""
    lower, upper = assembly.elements.lower[element], assembly.elements.upper[element]
    radius = 0.5 * np.linalg.norm(upper - lower, axis=1)
    digits = _LAST_DIGITS * np.maximum(abs(lower), abs(upper)).max(axis=1, initial=0.0)
    return np.asarray(np.maximum(tolerances.ROUNDING * radius, digits))


_ROUTE: Final = Route("scales", STANDARD | CRITERIA)


@dataclass(frozen=True)
class Scaling:
    """Factors between scene values and scaled values: scene value = factor × scaled value.

    Attributes
    ----------
    force : float
        Scale of all forces, scene units.
    face : (m, q) array
        Factors of the resultants: `force`, for moments times the half-size of the interface, for torsion times c_T.
    row : (free, q) array
        Factors of the equilibrium rows: `force`, for moments times half the diagonal of the element's bounding box.
    load : float
        λ = load × scaled λ.

    Notes
    -----
    Source: docs/method.md (8.1) to (8.3).
    """

    force: float
    face: Floats
    row: Floats
    load: float


def scaling_of(assembly: Assembly) -> Scaling:
    """Compute the scales of an assembly from its loads, strengths and sizes.

    A labelling never enters.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.

    Returns
    -------
    Scaling
        Scales, docs/method.md (8.1) to (8.3).
    """
    faces, elements = assembly.interfaces, assembly.elements
    force = _force_scale(assembly)
    ones = np.ones(len(faces))
    if assembly.dimension == 2:
        face = np.column_stack([ones, ones, 0.5 * faces.l1])
    else:
        face = np.column_stack([ones, ones, ones, 0.5 * faces.l2, 0.5 * faces.l1, faces.c_t])
    free = elements.free
    radius = 0.5 * np.linalg.norm(elements.upper[free] - elements.lower[free], axis=1)
    row = np.repeat(
        np.column_stack([np.ones(len(free)), radius]),
        [assembly.dimension, assembly.freedoms - assembly.dimension],
        axis=1,
    )
    return Scaling(force=force, face=force * face, row=force * row, load=force / (assembly.total_live or force))


def _force_scale(assembly: Assembly) -> float:
    """Return the force scale: mean weight of free elements times the height of their pile."""
    # The height is the largest number of interfaces between a free element and a support, docs/method.md (8.2). Without
    # weight the result is that of `reference_load`.
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    weights = np.linalg.norm(assembly.dead[free, : assembly.dimension], axis=1)
    if weights.any():
        count = len(elements)
        contacts = csr_array((np.ones(len(faces)), (faces.a, faces.b)), shape=(count + 1, count + 1))
        supports = np.flatnonzero(elements.support)
        entries = np.ones(len(supports)), (np.full(len(supports), count), supports)
        ground = csr_array(entries, shape=(count + 1, count + 1))
        distance = shortest_path(contacts + ground, directed=False, unweighted=True, indices=count)
        height = float(distance[free].max()) - 1.0
        return float(weights.mean()) * max(height, 1.0)
    return reference_load(assembly)


def reference_load(assembly: Assembly) -> float:
    """Compute the reference force of an assembly: weight, else a strength, else live load.

    Forces far below it count as zero in the width of a bracket. Source: docs/method.md (3.13).

    Parameters
    ----------
    assembly : Assembly
        Structure.

    Returns
    -------
    float
        Total weight, scene units. Without weight: the least strength times area of any face, under either label.
        Without strengths: the total live load.
    """
    if assembly.total_dead:
        return assembly.total_dead
    usable = _usable(assembly, *assembly.strengths(_ROUTE).stresses.values())
    return float(usable.min()) if usable.size else assembly.total_live


def _usable(assembly: Assembly, *strengths: Floats) -> Floats:
    """Return all finite strengths (m,) above zero, each times the area of its face."""
    capacity = np.concatenate(strengths) * np.tile(assembly.interfaces.area, len(strengths))
    return np.asarray(capacity[np.isfinite(capacity) & (capacity > 0.0)])
