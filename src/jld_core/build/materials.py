"""Materials of a scene to strengths per interface, and self-weights per element."""

from __future__ import annotations

import math

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Strengths
from jld_core.errors import InputError
from jld_core.scene import Contact, Dry, Element, Materials, Scene


def friction(source: Dry | Contact) -> float | None:
    """Friction coefficient, from either key; None where neither is given."""
    if source.friction_angle is not None:
        return math.tan(math.radians(source.friction_angle))
    return source.friction_coefficient


def gravity_vector(materials: Materials, dimension: int) -> Floats:
    """Gravity as a vector (d,): a number points along −y (planar) or −z (spatial).

    Raises InputError for a vector of the wrong length.
    """
    if isinstance(materials.gravity, float | int):
        vector = np.zeros(dimension)
        vector[-1] = -materials.gravity
        return vector
    if len(materials.gravity) != dimension:
        raise InputError(
            "materials.gravity",
            f"it has {len(materials.gravity)} numbers",
            f"a number or a vector of {dimension}",
        )
    return np.array(materials.gravity, dtype=float)


def direction_of_weight(scene: Scene) -> Floats:
    """Unit vector (d,) in which given weights act; downwards where gravity is zero."""
    vector = gravity_vector(scene.materials, scene.dimension)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        vector[-1], length = -1.0, 1.0
    return vector / length


def self_weight(element: Element, volume: float, materials: Materials, direction: Floats, gravity: float) -> Floats:
    """Self-weight (d,) of one element as a force: "weight" if given, else density × volume × gravity.

    direction: unit vector of gravity; gravity: its magnitude. Neither weight nor density means no weight.
    """
    if element.weight is not None:
        return element.weight * direction
    density = element.density if element.density is not None else materials.density
    return (density or 0.0) * volume * gravity * direction


def strengths(materials: Materials, contacts: list[Contact | None]) -> Strengths:
    """What each interface would be made of under either label, (m,) arrays, NaN where not named.

    contacts: per interface the scene's own entry with its overriding keys, or None.
    """
    dry, inner = materials.dry, materials.inner
    nan = math.nan
    base_mu = friction(dry) if dry is not None else None
    rows = []
    for contact in contacts:
        mu = base_mu
        tension = inner.tensile_strength if inner else None
        shear = inner.shear_strength if inner else None
        crush_dry = dry.compressive_strength if dry else None
        crush_inner = inner.compressive_strength if inner else None
        if contact is not None:
            own = friction(contact)
            mu = own if own is not None else mu
            tension = contact.tensile_strength if contact.tensile_strength is not None else tension
            shear = contact.shear_strength if contact.shear_strength is not None else shear
            if contact.compressive_strength is not None:
                crush_dry = crush_inner = contact.compressive_strength
        rows.append(
            [
                nan if mu is None else mu,
                nan if tension is None else tension,
                nan if shear is None else shear,
                math.inf if crush_dry is None else crush_dry,
                math.inf if crush_inner is None else crush_inner,
            ]
        )
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Strengths(*(np.ascontiguousarray(column) for column in table.T))
