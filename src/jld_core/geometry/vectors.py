"""Cross products and areas as vectors; in the plane, moments and spins have one component."""

from __future__ import annotations

import math

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.linalg.factors import without_rounding


def moment_about(arm: Floats, force: Floats) -> Floats:
    """Compute the moments arm × force.

    Parameters
    ----------
    arm : (…, d) array
        Lever arms, d = 2 or 3, scene units.
    force : (…, d) array
        Forces.

    Returns
    -------
    (…, 1) or (…, 3) array
        Moments: about the out-of-plane axis for d = 2, vectors for d = 3.
    """
    if arm.shape[-1] == 2:
        return (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])[..., None]
    return np.cross(arm, force)


def resultants(count: int, owner: Ints, loads: Floats, arm: Floats) -> Floats:
    """Sum loads (k, q) at arms (k, d) from the centres of their owners (k,) to resultants (count, q)."""
    # Sums that cancel up to rounding are exactly zero: the scale of a program must not be made of what is left.
    d = arm.shape[1]
    moment = moment_about(arm, loads[:, :d])
    # |arm × force| alone would miss the rounding of components of forces that cancel within it
    moment_magnitudes = np.linalg.norm(arm, axis=1)[:, None] * np.linalg.norm(loads[:, :d], axis=1)[:, None]
    magnitudes = np.column_stack(
        [np.repeat(np.linalg.norm(loads[:, :d], axis=1)[:, None], d, axis=1), abs(loads[:, d:])]
    )
    magnitudes[:, d:] += moment_magnitudes
    total, size = np.zeros((count, loads.shape[1])), np.zeros((count, loads.shape[1]))
    np.add.at(total, owner, np.column_stack([loads[:, :d], loads[:, d:] + moment]))
    np.add.at(size, owner, magnitudes)
    return without_rounding(total, size)


def spun(turn: Floats, arm: Floats) -> Floats:
    """Compute spin × arm, the velocity of a point of a rotating body.

    Parameters
    ----------
    turn : (…, 1) or (…, 3) array
        Spins, in the plane or in space.
    arm : (…, d) array
        Position relative to the centre of rotation, d = 2 or 3.

    Returns
    -------
    (…, d) array
        Velocities.
    """
    if arm.shape[-1] == 2:
        return np.stack([-turn[..., 0] * arm[..., 1], turn[..., 0] * arm[..., 0]], axis=-1)
    return np.cross(turn, arm)


def area_vector(corners: Floats) -> Floats:
    """Return the area vector of a plane polygon, or of several with equal numbers of corners.

    Parameters
    ----------
    corners : (…, k, 3) array
        Corners in order, scene units.

    Returns
    -------
    (…, 3) array
        Vector of length area, along the normal about which the corners run counter-clockwise.
    """
    # Coordinates relative to a corner: far from the origin, absolute ones lose digits.
    arm = corners - corners[..., :1, :]
    following = np.concatenate((arm[..., 1:, :], arm[..., :1, :]), axis=-2)
    # `numpy.cross` takes three times as long for a few corners
    x, y, z, u, v, w = (side[..., axis] for side in (arm, following) for axis in range(3))
    return np.asarray(0.5 * np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1).sum(axis=-2))


def across(normal: Floats) -> Floats:
    """Return two axes of a plane that form a right-handed frame with its normal.

    Parameters
    ----------
    normal : (3,) array
        Unit normal of the plane.

    Returns
    -------
    (2, 3) array
        Unit axes e1, e2 with e1 × e2 = normal.
    """
    # written out: the general cross product of numpy takes ten times as long for single vectors
    x, y, z = normal.tolist()
    smallest = int(np.argmin(abs(normal)))
    perpendicular = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[smallest]
    length = math.sqrt(perpendicular[0] ** 2 + perpendicular[1] ** 2 + perpendicular[2] ** 2)
    a, b, c = perpendicular[0] / length, perpendicular[1] / length, perpendicular[2] / length
    return np.array([(a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)])


def frame(vectors: Floats) -> Floats:
    """Return a right-handed orthonormal frame (d, d) that starts with d − 1 independent vectors."""
    first = vectors[0] / np.linalg.norm(vectors[0])
    if len(first) == 2:
        return np.array([first, [-first[1], first[0]]])
    second = vectors[1] - (vectors[1] @ first) * first
    second = second / np.linalg.norm(second)
    return np.array([first, second, np.cross(first, second)])
