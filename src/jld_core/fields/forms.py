"""What stresses and rates are in the plane and in space: as vectors, on planes, and against yield.

In the plane a stress is the vector (m, d, s) = ((σx + σy)/2, (σx − σy)/2, τxy). In space it is the upper triangle (xx,
√2 xy, yy, √2 xz, √2 yz, zz) of the tensor, so that products of tensors are products of vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats


@dataclass(frozen=True)
class Material:
    """Mohr–Coulomb material with tension cut-off in plane stress."""

    tension: float  # tensile strength σt, a stress
    shear: float  # shear strength τ without normal stress, a stress
    friction: float = 0.0  # friction μi = tan φ of crack planes
    crushing: float = np.inf  # compressive strength σc, a stress; inf where none is given

    @property
    def sine(self) -> float:
        """Sine of the angle of friction φ of crack planes, tan φ = `friction`."""
        return self.friction / float(np.hypot(1.0, self.friction))

    @property
    def intercept(self) -> float:
        """Largest R = (σ1 − σ2)/2 that Mohr–Coulomb admits at m = 0: τ cos φ, stress."""
        return self.shear / float(np.hypot(1.0, self.friction))

    def scaled(self, unit: float) -> Material:
        """Return the same material with its strengths divided by `unit`, a stress above 0."""
        return Material(self.tension / unit, self.shear / unit, self.friction, self.crushing / unit)

    @cached_property
    def lines(self) -> Floats:
        """(k, 2) coefficients (a, b) of R ≤ a + b m: Mohr–Coulomb, tension cut-off, crushing where given."""
        rows = [(self.intercept, -self.sine), (self.tension, -1.0)]
        if np.isfinite(self.crushing):
            rows.append((self.crushing, 1.0))
        return np.array(rows)

    @cached_property
    def vertices(self) -> Floats:
        """(k, 2) corners (m, R) of the yield set in the half-plane R ≥ 0, stress."""
        # m = (σx + σy)/2 and R = (σ1 − σ2)/2. Without a compressive strength the set is unbounded towards m = −∞; that
        # end has no corner.
        corners = [(self.tension, 0.0)]
        if np.isfinite(self.crushing):
            corners.append((-self.crushing, 0.0))
        for i, (a, b) in enumerate(self.lines):
            for c, d in self.lines[i + 1 :]:
                if b != d:
                    m = (c - a) / (b - d)
                    corners.append((m, a + b * m))
        slack = 1e-12 * max(self.tension, self.shear)
        admissible = [(m, r) for m, r in corners if r >= 0.0 and (r <= self.lines @ (1.0, m) + slack).all()]
        return np.array(admissible)

    def slack(self, stress: Floats) -> Floats:
        """Return the least a + b m − R (...,) of stresses (..., 3); negative means that yield is violated."""
        radius = np.hypot(stress[..., 1], stress[..., 2])
        heads = self.lines[:, 0] + self.lines[:, 1] * stress[..., :1]
        return np.asarray(heads.min(axis=-1) - radius)

    def missing(self, trace: Floats, shear: Floats) -> Floats:
        """Return g sin φ − e (k,) of (9.2): above 0 the dissipation is infinite; −inf if the material crushes."""
        if np.isfinite(self.crushing):
            return np.full_like(trace, -np.inf)
        return self.sine * shear - trace

    def dissipation(self, trace: Floats, shear: Floats, allowance: float = 0.0) -> Floats:
        """Return the power per volume of strain rates, (...,): docs/method.md (9.2)."""
        power = (trace[..., None] * self.vertices[:, 0] + shear[..., None] * self.vertices[:, 1]).max(axis=-1)
        return np.asarray(np.where(self.missing(trace, shear) > allowance, np.inf, power))


COMPONENTS = {2: 3, 3: 6}  # number of components of a stress by the dimension
DIAGONAL = (0, 2, 5)  # positions of xx, yy and zz in the vector of a tensor in space
# row and column in a tensor for each entry of its vector
_POSITIONS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def tensors(vectors: Floats) -> Floats:
    """Convert vectors (..., 3 or 6) to symmetric tensors (..., d, d)."""
    if vectors.shape[-1] == COMPONENTS[2]:
        mean, half_difference, shear = np.moveaxis(vectors, -1, 0)
        first, second = mean + half_difference, mean - half_difference
        return np.stack([np.stack([first, shear], axis=-1), np.stack([shear, second], axis=-1)], axis=-2)
    result = np.empty((*vectors.shape[:-1], 3, 3))
    for entry, (i, j) in enumerate(_POSITIONS):
        result[..., i, j] = result[..., j, i] = vectors[..., entry] / (1.0 if i == j else np.sqrt(2.0))
    return result


def normal_map(normals: Floats) -> Floats:
    """Return matrices (..., d, 3 or 6) that map vectors of stresses to tractions σ n on planes."""
    if normals.shape[-1] == 2:
        x, y = normals[..., 0], normals[..., 1]
        return np.stack([np.stack([x, x, y], axis=-1), np.stack([y, -y, x], axis=-1)], axis=-2)
    maps = np.zeros((*normals.shape[:-1], 3, 6))
    for entry, (i, j) in enumerate(_POSITIONS):
        maps[..., i, entry] = normals[..., j] / (1.0 if i == j else np.sqrt(2.0))
        maps[..., j, entry] = normals[..., i] / (1.0 if i == j else np.sqrt(2.0))
    return maps


def across(normals: Floats) -> tuple[Floats, ...]:
    """Return unit vectors (k, d) perpendicular to each normal and to each other: one in the plane, two in space.

    normals: (k, d) unit vectors. Slip and shear on planes are written in these directions.
    """
    if normals.shape[-1] == 2:
        return (np.column_stack([-normals[:, 1], normals[:, 0]]),)
    axis = np.eye(3)[np.argmin(abs(normals), axis=1)]
    first = np.cross(normals, axis)
    first = first / np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normals, first)


def tangential(vectors: Floats, normals: Floats) -> Floats:
    """Return the sizes (k, j) of the parts of vectors (k, j, d) that are perpendicular to normals (k, d)."""
    if normals.shape[-1] == 2:
        return np.asarray(abs(vectors[..., 1] * normals[:, :1] - vectors[..., 0] * normals[:, 1:]))
    parts = [np.einsum("kji,ki->kj", vectors, direction) for direction in across(normals)]
    return np.asarray(np.linalg.norm(parts, axis=0))


def slack(material: Material, stress: Floats) -> Floats:
    """Return the distances (t, d + 1) of stresses (t, d + 1, 3 or 6) to yield; negative means violated."""
    if stress.shape[-1] == COMPONENTS[2]:
        return material.slack(stress)
    principal = np.linalg.eigvalsh(tensors(stress))
    low, high = principal[..., 0], principal[..., 2]
    distance = material.slack(np.stack([0.5 * (low + high), 0.5 * (high - low), np.zeros_like(low)], axis=-1))
    # eigenvalues are exact but for rounding
    return distance - tolerances.ROUNDING * float(abs(principal).max())


def shear_rate(slope: Floats) -> Floats:
    """Return g (t,) of docs/method.md (9.2) and (10.2) for velocity gradients (t, d, d)."""
    if slope.shape[-1] == 2:
        return np.hypot(slope[:, 0, 0] - slope[:, 1, 1], slope[:, 0, 1] + slope[:, 1, 0])
    return np.asarray(abs(np.linalg.eigvalsh(0.5 * (slope + slope.transpose(0, 2, 1)))).sum(axis=1))
