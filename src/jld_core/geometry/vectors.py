"""Moments, spins and areas as vectors: the same words in the plane, where those about an axis have one component."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Floats


def moment_about(arm: Floats, force: Floats) -> Floats:
    """arm × force: (…, 2) → (…, 1) about the out-of-plane axis, (…, 3) → (…, 3)."""
    if arm.shape[-1] == 2:
        return (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])[..., None]
    return np.cross(arm, force)


def spun(turn: Floats, arm: Floats) -> Floats:
    """turn × arm, the velocity at an arm (…, d) by a spin (…, 1) in the plane or (…, 3)."""
    if arm.shape[-1] == 2:
        return np.stack([-turn[..., 0] * arm[..., 1], turn[..., 0] * arm[..., 0]], axis=-1)
    return np.cross(turn, arm)


def area_vector(corners: Floats) -> Floats:
    """(3,) area of a plane polygon (k, 3) along its normal, about which the corners turn counter-clockwise."""
    # about a corner: far from the origin the plain sum loses digits
    arm = corners - corners[0]
    return np.asarray(0.5 * np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0))


def across(normal: Floats) -> Floats:
    """(2, 3) axes of a plane, right-handed with its unit normal (3,)."""
    other = np.eye(3)[int(np.argmin(abs(normal)))]
    one = np.cross(normal, other)
    one = one / np.linalg.norm(one)
    return np.array([one, np.cross(normal, one)])


def frame(vectors: Floats) -> Floats:
    """(d, d) rows of a right-handed orthonormal frame that starts with d − 1 given vectors."""
    first = vectors[0] / np.linalg.norm(vectors[0])
    if len(first) == 2:
        return np.array([first, [-first[1], first[0]]])
    second = vectors[1] - (vectors[1] @ first) * first
    second = second / np.linalg.norm(second)
    return np.array([first, second, np.cross(first, second)])
