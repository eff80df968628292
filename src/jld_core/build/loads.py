"""Conversion of single load entries of a scene to forces and moments, with checks of their vectors."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Elements
from jld_core.build.fill import PointEntry
from jld_core.errors import InputError
from jld_core.scene import PointLoad
from jld_core.scene.loads import BodyLoad


def body_forces(entry: BodyLoad, elements: Elements, where: str) -> Floats:
    """Return the forces (n, d) of a body load: magnitudes of weights times its vector, zero on supports."""
    body = _vector(entry.body, elements.centroid.shape[1], f"{where}.body")
    magnitude = np.linalg.norm(elements.weight, axis=1)
    return np.asarray(np.where(elements.support, 0.0, magnitude)[:, None] * body)


def couple_of(entry: PointLoad, elements: Elements, where: str) -> tuple[int, Floats]:
    """Return the element of a point load and its moment (1,) or (3,).

    Raises InputError for an unknown element, a support, or a moment of the wrong length.
    """
    if entry.element not in elements.index:
        raise InputError(f"{where}.element", f"no element is named {entry.element!r}", "the id of a free element")
    index, expected = elements.index[entry.element], 1 if elements.centroid.shape[1] == 2 else 3
    if elements.support[index]:
        raise InputError(f"{where}.element", f"{entry.element!r} is a support", "the id of a free element")
    moment = np.atleast_1d(np.asarray(entry.moment, dtype=float))
    if expected == 3 and moment.size == 1 and moment[0] == 0.0:
        moment = np.zeros(3)
    if moment.size != expected:
        raise InputError(f"{where}.moment", f"it has {moment.size} numbers", f"{expected} in this scene")
    return index, moment


def force_of(entry: PointLoad, index: int, elements: Elements, where: str) -> PointEntry:
    """Return the force of a point load on an element; raise InputError for a vector of the wrong length."""
    d = elements.centroid.shape[1]
    force = _vector(entry.force or [], d, f"{where}.force")
    at = elements.centroid[index] if entry.at is None else _vector(entry.at, d, f"{where}.at")
    return index, at, force, entry.width, entry.at is None


def _vector(values: list[float], dimension: int, where: str) -> Floats:
    """Convert numbers to a vector; raise InputError unless their number is `dimension`."""
    if len(values) != dimension:
        raise InputError(where, f"it has {len(values)} numbers", f"{dimension} in this scene")
    return np.array(values, dtype=float)
