"""Load cases of horizontal pushes in several directions."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.scene.loads import BodyLoad, Case, Pushes

_PLANAR: Final = 2  # number of horizontal directions of a planar structure


def cases_of_pushes(pushes: Pushes, downwards: Floats, where: str) -> list[Case]:
    """Return one load case for each direction of a push.

    downwards: (d,) direction of the weights, a unit vector. Result: load cases in the order of the directions. Names
    end with the angle of the direction in degrees: planar 0 or 180 where both are horizontal, spatial from the first
    horizontal axis of the scene. Raises InputError: a planar scene has more than two horizontal directions, or a vector
    has a wrong length, is zero or occurs twice.
    """
    d = len(downwards)
    first = _first_axis(downwards)
    if isinstance(pushes.directions, int):
        if d == 2 and pushes.directions > _PLANAR:
            problem = f"{pushes.directions} horizontal directions in a planar scene"
            raise InputError(f"{where}.directions", problem, "1 or 2, or a list of vectors")
        units = _horizontal(pushes.directions, first, downwards)
    else:
        units = [_unit(vector, d, f"{where}.directions[{k}]") for k, vector in enumerate(pushes.directions)]
    names = [f"{pushes.name} {_angles(unit, first, downwards)}" for unit in units]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{where}.directions[{k}]", "it is a direction that stands before", "each direction once")
    return [
        Case(name=name, live=[BodyLoad(body=(pushes.of_weight * unit + 0.0).tolist())], required=pushes.required)
        for name, unit in zip(names, units, strict=True)
    ]


def _first_axis(downwards: Floats) -> Floats:
    """Return the unit vector (d,) from which angles of directions count.

    In the plane it is gravity turned by +90°. In space it is the horizontal part of the first axis that is not nearly
    vertical.
    """
    if len(downwards) == 2:
        return np.array([-downwards[1], downwards[0]])
    axis = next(row for row in np.eye(3) if abs(float(row @ downwards)) < 0.9)
    flat = axis - (axis @ downwards) * downwards
    return np.asarray(flat / np.linalg.norm(flat))


def _horizontal(count: int, first: Floats, downwards: Floats) -> list[Floats]:
    """Return horizontal unit vectors (d,) at equal angles, beginning with `first`."""
    if len(first) == 2:
        return [sign * first for sign in (1.0, -1.0)[:count]]
    second = np.cross(-downwards, first)
    angles = [2.0 * math.pi * k / count for k in range(count)]
    units = np.array([math.cos(angle) * first + math.sin(angle) * second for angle in angles])
    units[np.abs(units) <= tolerances.ROUNDING] = 0.0
    return list(units)


def _unit(vector: list[float], dimension: int, where: str) -> Floats:
    """Return the unit vector (d,) of a direction.

    Raises InputError for a wrong length or a zero vector.
    """
    if len(vector) != dimension:
        raise InputError(where, f"it has {len(vector)} numbers", f"{dimension} in this scene")
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise InputError(where, "it is zero", "a direction")
    return np.array(vector, dtype=float) / length


def _angles(unit: Floats, first: Floats, downwards: Floats) -> str:
    """Return the angle of a direction as text, degrees; in space also its slope, if any."""
    if len(first) == 2:
        return f"at {_degrees(float(unit @ -downwards), float(unit @ first))}°"
    second = np.cross(-downwards, first)
    rise = float(unit @ -downwards)
    slope = "" if abs(rise) <= tolerances.ROUNDING else f" up {math.degrees(math.asin(min(1.0, max(-1.0, rise)))):.6g}°"
    return f"at {_degrees(float(unit @ second), float(unit @ first))}°{slope}"


def _degrees(rise: float, run: float) -> str:
    """Return an angle as text, from 0 up to below 360 degrees."""
    angle = math.degrees(math.atan2(rise, run)) % 360.0
    return f"{0.0 if min(angle, 360.0 - angle) < 1e-9 else angle:.6g}"
