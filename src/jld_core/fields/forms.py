"""What stresses and rates are in the plane and in space: as vectors, on planes, and against yield.

In the plane a stress is the vector (m, d, s) = ((σx + σy)/2, (σx − σy)/2, τxy). In space it is the upper triangle (xx,
√2 xy, yy, √2 xz, √2 yz, zz) of the tensor, so that products of tensors are products of vectors.
"""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.fields.problem import Material

COMPONENTS = {2: 3, 3: 6}
"""Number of components of a stress by the dimension."""

DIAGONAL = (0, 2, 5)
"""Positions of xx, yy and zz in the vector of a tensor in space."""

_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # row and column of the tensor for each entry of its vector


def tensors(vectors: Floats) -> Floats:
    """Convert vectors (..., 3 or 6) to symmetric tensors (..., d, d)."""
    if vectors.shape[-1] == COMPONENTS[2]:
        m, d, s = np.moveaxis(vectors, -1, 0)
        return np.stack([np.stack([m + d, s], axis=-1), np.stack([s, m - d], axis=-1)], axis=-2)
    found = np.empty((*vectors.shape[:-1], 3, 3))
    for place, (i, j) in enumerate(_PLACES):
        found[..., i, j] = found[..., j, i] = vectors[..., place] / (1.0 if i == j else np.sqrt(2.0))
    return found


def normal_map(normals: Floats) -> Floats:
    """Return matrices (..., d, 3 or 6) that map vectors of stresses to tractions σ n on planes."""
    if normals.shape[-1] == 2:
        x, y = normals[..., 0], normals[..., 1]
        return np.stack([np.stack([x, x, y], axis=-1), np.stack([y, -y, x], axis=-1)], axis=-2)
    found = np.zeros((*normals.shape[:-1], 3, 6))
    for place, (i, j) in enumerate(_PLACES):
        found[..., i, place] = normals[..., j] / (1.0 if i == j else np.sqrt(2.0))
        found[..., j, place] = normals[..., i] / (1.0 if i == j else np.sqrt(2.0))
    return found


def across(normals: Floats) -> tuple[Floats, ...]:
    """Return unit vectors (k, d) perpendicular to each normal and to each other: one in the plane, two in space.

    normals: (k, d) unit vectors. Slip and shear on planes are written in these directions.
    """
    if normals.shape[-1] == 2:
        return (np.column_stack([-normals[:, 1], normals[:, 0]]),)
    axis = np.eye(3)[np.argmin(abs(normals), axis=1)]
    one = np.cross(normals, axis)
    one = one / np.linalg.norm(one, axis=1)[:, None]
    return one, np.cross(normals, one)


def tangential(vectors: Floats, normals: Floats) -> Floats:
    """Return the sizes (k, j) of the parts of vectors (k, j, d) that are perpendicular to normals (k, d)."""
    if normals.shape[-1] == 2:
        return np.asarray(abs(vectors[..., 1] * normals[:, :1] - vectors[..., 0] * normals[:, 1:]))
    return np.asarray(np.linalg.norm([np.einsum("kji,ki->kj", vectors, way) for way in across(normals)], axis=0))


def slack(material: Material, stress: Floats) -> Floats:
    """Return the distances (t, d + 1) of stresses (t, d + 1, 3 or 6) to yield; negative means violated."""
    if stress.shape[-1] == COMPONENTS[2]:
        return material.slack(stress)
    principal = np.linalg.eigvalsh(tensors(stress))
    low, high = principal[..., 0], principal[..., 2]
    room = material.slack(np.stack([0.5 * (low + high), 0.5 * (high - low), np.zeros_like(low)], axis=-1))
    # eigenvalues are exact but for rounding
    return room - tolerances.ROUNDING * float(abs(principal).max())


def shear_rate(slope: Floats) -> Floats:
    """Return g (t,) of docs/method.md (9.2) and (10.2) for velocity gradients (t, d, d)."""
    if slope.shape[-1] == 2:
        return np.hypot(slope[:, 0, 0] - slope[:, 1, 1], slope[:, 0, 1] + slope[:, 1, 0])
    return np.asarray(abs(np.linalg.eigvalsh(0.5 * (slope + slope.transpose(0, 2, 1)))).sum(axis=1))
