"""Conversion of a scene's load entries to generalised forces about the centroids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements
from jld_core.errors import InputError
from jld_core.geometry import moment_about
from jld_core.scene import PointLoad
from jld_core.scene.loads import BodyLoad
from jld_core.scene.schema import Element
from jld_core.shape_loads import ShapeLoads


class PlacedLoad(NamedTuple):
    """Load entry of a scene, with its key for error messages.

    from_pressure: True for the resultant of a pressure on a face.
    """

    where: str
    load: PointLoad | BodyLoad
    from_pressure: bool = False


def generalised(entries: Sequence[PlacedLoad], elements: Elements) -> Floats:
    """Sum load entries to generalised forces on each element, about its centroid.

    Returns (n, 3) planar (fx, fy, m) or (n, 6) spatial (f, m), scene units; zero for supports. elements: with weights.
    The moment of a force applied at p is (p − c) × f about centroid c; p may lie outside the element. Sums within
    rounding of zero become exactly zero. Raises InputError for an unknown element, a support, or a vector of the wrong
    length.
    """
    dimension = elements.centroid.shape[1]
    total = np.zeros((len(elements), 3 if dimension == 2 else 6))
    gross = np.zeros_like(total)
    for where, entry, _ in entries:
        if isinstance(entry, BodyLoad):
            body = _vector(entry.body, dimension, f"{where}.body")
            magnitude = np.linalg.norm(elements.weight, axis=1)
            weight = np.where(elements.support, 0.0, magnitude)[:, None] * body
            total[:, :dimension] += weight
            gross[:, :dimension] += np.abs(weight)
            continue
        if entry.element not in elements.index:
            raise InputError(f"{where}.element", f"no element is named {entry.element!r}", "the id of a free element")
        index = elements.index[entry.element]
        if elements.support[index]:
            raise InputError(f"{where}.element", f"{entry.element!r} is a support", "the id of a free element")
        moment = np.atleast_1d(np.asarray(entry.moment, dtype=float))
        if dimension == 3 and moment.size == 1 and moment[0] == 0.0:
            moment = np.zeros(3)
        if moment.size != total.shape[1] - dimension:
            raise InputError(
                f"{where}.moment",
                f"it has {moment.size} numbers",
                f"{total.shape[1] - dimension} in this scene",
            )
        total[index, dimension:] += moment
        gross[index, dimension:] += np.abs(moment)
        if entry.force is not None:
            force = _vector(entry.force, dimension, f"{where}.force")
            at = elements.centroid[index] if entry.at is None else _vector(entry.at, dimension, f"{where}.at")
            couple = moment_about(at - elements.centroid[index], force)
            total[index, :dimension] += force
            total[index, dimension:] += couple
            gross[index] += np.abs(np.append(force, couple))
    total[np.abs(total) <= tolerances.ROUNDING * gross] = 0.0
    return total


def shape_dependent(
    dead: Sequence[PlacedLoad],
    live: Sequence[PlacedLoad],
    elements: Elements,
    entries: Sequence[Element],
) -> ShapeLoads:
    """Return the forces that grow with the volumes of elements or move with their centroids.

    dead, live: valid load entries, which may include body loads. elements: with weights; their self-weight counts as a
    dead load. entries: the scene's entry for each element. Forces on an element with a stated weight or volume do not
    grow; those on one with a stated centroid do not move. Supports have none. Returns arrays (n, d), scene units, and
    whether any entry comes from a pressure.
    """
    rides = ~elements.support & np.array([entry.centroid is None for entry in entries])
    grows = ~elements.support & np.array([entry.weight is None and entry.volume is None for entry in entries])
    parts = []
    for loads, by_weight in ((dead, elements.weight.copy()), (live, np.zeros_like(elements.weight))):
        at_centroid = np.zeros_like(elements.centroid)
        for _, entry, _ in loads:
            if isinstance(entry, BodyLoad):
                by_weight += np.linalg.norm(elements.weight, axis=1)[:, None] * np.array(entry.body, dtype=float)
            elif entry.force is not None and entry.at is None:
                at_centroid[elements.index[entry.element]] += np.array(entry.force, dtype=float)
        parts += [np.where(grows[:, None], by_weight, 0.0), np.where(rides[:, None], by_weight + at_centroid, 0.0)]
    pressed = any(entry.from_pressure for entry in (*dead, *live))
    dead_growing, dead_riding, live_growing, live_riding = parts
    return ShapeLoads(dead_growing, dead_riding, live_growing, live_riding, pressed)


def _vector(values: list[float], dimension: int, where: str) -> Floats:
    """Convert numbers to a vector; raise InputError unless their number is `dimension`."""
    if len(values) != dimension:
        raise InputError(where, f"it has {len(values)} numbers", f"{dimension} in this scene")
    return np.array(values, dtype=float)
