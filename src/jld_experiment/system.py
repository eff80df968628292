"""Compute springs, masses and periods of the elastic assembly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Floats, Ints
from jld_core.geometry import moment_about
from jld_experiment.subcontacts import SubContacts

_BITS: Final = 32  # Binary digits of masses, periods and lengths: 2e-10 of them, far below what changes an experiment.


@dataclass(frozen=True)
class System:
    """Elastic assembly of n rigid elements on springs, with scaled masses.

    The masses are scaled so that a time step of one is the share `step` of the critical step. Times are in such steps,
    all else in scene units.

    ends: (m, 2) elements a and b of each face. frame: (m, 6) normals and arms for the time stepping, columns as in
    `Bench.frame`. inverse: (n, 2) inverse of mass and inertia, 0 on supports. radius: (n,) radius of gyration
    √(inertia/mass), length; 1 on supports. period: slowest period, steps. reach: elastic displacement live·u under the
    live loads with λ = 1. sag, swing: largest elastic displacement of an element under the dead loads, and under the
    live loads with λ = 1.
    """

    ends: Ints
    frame: Floats
    inverse: Floats
    radius: Floats
    period: float
    reach: float
    sag: float
    swing: float


def system_of(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats, step: float) -> System:
    """Compute stiffness, scaled masses and periods of an assembly with all faces in contact.

    points: sub-contacts of all faces. kn, ks: (m,) normal and shear springs of the faces, stress per length.
    step: time step as a share of the largest stable one.
    """
    elements, q, d = assembly.elements, assembly.freedoms, assembly.dimension
    ends = np.column_stack([assembly.interfaces.a, assembly.interfaces.b]).astype(np.int64)
    count = len(elements)
    stiffness = np.zeros((count, q, count, q))
    jumps = jump_matrices(assembly)
    for face, (a, b) in enumerate(ends):
        part = points.place[points.first[face] : points.first[face + 1]]
        spring = _spring(part, float(kn[face]), float(ks[face]))
        block = np.einsum("ji,jk,kl->il", jumps[face], spring, jumps[face])
        for i, x in enumerate((a, b)):
            for j, y in enumerate((a, b)):
                stiffness[x, :, y, :] += block[i * q : (i + 1) * q, j * q : (j + 1) * q]
    own = stiffness[np.arange(count), :, np.arange(count), :]
    mass = np.einsum("ijj->i", own[:, :d, :d]) / d
    inertia = np.einsum("ijj->i", own[:, d:, d:]) / (q - d)
    free = elements.free
    masses = np.column_stack([mass, inertia])[free]
    scaled = np.repeat(masses**-0.5, (d, q - d), axis=1).ravel()
    matrix = stiffness[free][:, :, free].reshape(q * len(free), q * len(free))
    values = np.linalg.eigvalsh(matrix * scaled[:, None] * scaled)
    # A time step of one is stable up to ω = 2.
    factor = float(values[-1]) / (2.0 * step) ** 2
    inverse = np.zeros((count, 2))
    inverse[free] = rounded(1.0 / (factor * masses))
    live, dead = (load[free].ravel() for load in (assembly.live, assembly.dead))
    moved = np.linalg.solve(matrix, np.column_stack([live, dead]))
    radius = np.ones(count)
    squared = masses[:, 1] / masses[:, 0]
    radius[free] = rounded(np.sqrt(squared))
    own = np.array([2.0 * np.pi * np.sqrt(factor / values[0]), live @ moved[:, 0]])
    sizes = np.abs(moved.reshape(-1, q, 2)[:, :d]).max(axis=(0, 1))
    period, reach, swing, sag = rounded(np.concatenate([own, sizes])).tolist()
    return System(
        ends=ends,
        frame=_frame(assembly),
        inverse=inverse,
        radius=radius,
        period=period,
        reach=reach,
        sag=sag,
        swing=swing,
    )


def rounded(values: Floats) -> Floats:
    """Round numbers to `_BITS` binary digits.

    Eigenvalues and solutions of linear equations differ in their last digits between machines. Rounded masses, periods
    and lengths give equal digits of an experiment, except where a number lies within 1e-16 of a boundary of rounding.
    """
    fraction, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(np.ldexp(fraction, _BITS)), exponent - _BITS))


def jump_matrices(assembly: Assembly) -> Floats:
    """Return matrices (m, q, 2q) from motions of elements a and b to jumps of faces.

    Columns are the q freedoms of a, then those of b. The q jumps are opening, slips and rotations, conjugate to the
    resultants of `Specimen.resultants`.
    """
    faces, q, d = assembly.interfaces, assembly.freedoms, assembly.dimension
    found = np.zeros((len(faces), q, 2 * q))
    axes = [faces.normal, faces.e1] if d == 2 else [faces.normal, faces.e1, faces.e2]
    turns = [np.ones((1, 1))] if d == 2 else [faces.e1, faces.e2, faces.normal]
    for place, element, sign in ((0, faces.a, -1.0), (q, faces.b, 1.0)):
        arm = faces.origin - assembly.elements.centroid[element]
        for j, axis in enumerate(axes):
            found[:, j, place : place + d] = sign * axis
            found[:, j, place + d : place + q] = sign * moment_about(arm, axis)
        for j in range(q - d):
            found[:, d + j, place + d : place + q] = sign * turns[j]
    return found


def _spring(place: Floats, kn: float, ks: float) -> Floats:
    """Return the (q, q) stiffness of one face in its jumps."""
    if place.shape[1] == 2:
        s, area = place.T
        opening, slip = np.column_stack([np.ones_like(s), 0 * s, -s]), np.column_stack([0 * s, np.ones_like(s), 0 * s])
        rows, weights = [opening, slip], [kn * area, ks * area]
    else:
        x1, x2, area = place.T
        one, none = np.ones_like(x1), np.zeros_like(x1)
        rows = [
            np.column_stack([one, none, none, x2, -x1, none]),
            np.column_stack([none, one, none, none, none, -x2]),
            np.column_stack([none, none, one, none, none, x1]),
        ]
        weights = [kn * area, ks * area, ks * area]
    return np.asarray(sum((row * w[:, None]).T @ row for row, w in zip(rows, weights, strict=True)))


def _frame(assembly: Assembly) -> Floats:
    """Return normals and arms of all faces, one row each, for the time stepping."""
    faces, centroid = assembly.interfaces, assembly.elements.centroid
    near, far = faces.origin - centroid[faces.a], faces.origin - centroid[faces.b]
    if assembly.dimension == 3:
        return np.ascontiguousarray(np.hstack([faces.normal, faces.e1, faces.e2, near, far]))
    columns = [faces.normal]
    for arm in (near, far):
        columns += [moment_about(arm, axis) for axis in (faces.normal, faces.e1)]
    return np.ascontiguousarray(np.hstack(columns))
