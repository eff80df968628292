"""What the time stepping works on: arrays that stay as they are, and arrays that every step changes."""

from __future__ import annotations

from typing import NamedTuple

from jld_core.arrays import Bools, Floats, Ints

Drive = tuple[bool, tuple[float, float], tuple[float, float], tuple[float, float], float]
"""How some steps are driven: is live·velocity held at a rate, so that λ is the multiplier of that constraint (else λ is
given); share of the dead loads, λ and rate, each from the first step to the last, linear; damping, the share of the
out-of-balance force that acts against the movement, forces and moments apart, so that no direction is preferred."""


class Bench(NamedTuple):
    """What stays. dead, live: (n, q) loads. inverse: (n, 2) one over mass and over inertia, 0 on supports. radius: (n,)
    by which moments are compared with forces. ends: (m, 2) elements a and b. frame: (m, 6) planar: normal x, y, then
    r × n and r × t for the arms to the middle of the face from a and from b; (m, 15) spatial: normal, e1, e2, arms.
    first: (m + 1,) where the sub-contacts of each face begin. place: (s, d) coordinates along the face, and area.
    law: (m, 8), columns as in `laws`. brittle: (m,) do faces lose what they exceed. gaps: (m,) do joints stay open.
    """

    dead: Floats
    live: Floats
    inverse: Floats
    radius: Floats
    ends: Ints
    frame: Floats
    first: Ints
    place: Floats
    law: Floats
    brittle: Bools
    gaps: Bools


class Motion(NamedTuple):
    """What changes, in place. moved, velocity: (n, q). Of sub-contacts overlap, pressure (s,), shear (s, d − 1), broken
    (s,)."""

    moved: Floats
    velocity: Floats
    overlap: Floats
    pressure: Floats
    shear: Floats
    broken: Bools
