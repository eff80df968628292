"""Define the arrays of the time stepping: constant ones, and ones changed in every step."""

from __future__ import annotations

from typing import NamedTuple

from jld_core.arrays import Bools, Floats, Ints

Drive = tuple[bool, tuple[float, float], tuple[float, float], tuple[float, float], float]
"""Control of a number of steps: push, share of the dead loads, λ, rate and damping.

If `push` is True, live·velocity follows the rate and λ is the multiplier of this constraint; else λ is given.
Shares, λ and rates are pairs: first and last step, linear between.
Damping is the share of the unbalanced force that acts against the velocity.
Forces and moments are damped separately, so that no direction is preferred.
"""


class Bench(NamedTuple):
    """Constant arrays of the time stepping.

    Attributes
    ----------
    dead, live : (n, q) float array
        Loads.
    inverse : (n, 2) float array
        Inverse of mass and inertia, 0 on supports.
    radius : (n,) float array
        Length by which moments are compared with forces.
    ends : (m, 2) int array
        Elements a and b.
    frame : (m, 6) or (m, 15) float array
        Planar: normal x, y, then r × n and r × t for the arms from a and from b to the centre of the face.
        Spatial: normal, e1, e2, arms.
    first : (m + 1,) int array
        Position of the first sub-contact of each face.
    place : (s, d) float array
        Coordinates along the face, and area.
    law : (m, 8) float array
        Law of each face, columns as in `laws`.
    brittle : (m,) bool array
        True for faces that lose a strength that is exceeded.
    gaps : (m,) bool array
        True for joints whose gaps stay open.
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
    """Arrays that every step changes in place.

    Attributes
    ----------
    moved, velocity : (n, q) float array
        Displacements and velocities.
    overlap, pressure : (s,) float array
        Elastic overlap and compressive stress of sub-contacts.
    shear : (s, d − 1) float array
        Shear stress of sub-contacts.
    broken : (s,) bool array
        True for broken sub-contacts.
    """

    moved: Floats
    velocity: Floats
    overlap: Floats
    pressure: Floats
    shear: Floats
    broken: Bools
