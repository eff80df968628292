"""Load cases of vehicles that move along a path on the outline of a planar structure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Elements
from jld_core.build.fill import Backing
from jld_core.errors import InputError
from jld_core.scene import FillLoad, PointLoad
from jld_core.scene.fill import Strip
from jld_core.scene.loads import Case, LoadEntry, MovingLoad


class PlacedCase(NamedTuple):
    """Load case of a scene with its origin."""

    where: str  # key in the scene
    case: Case  # the load case
    # of a moving load: its name and direction, and the distance of its first axle along the path; None for other cases
    place: tuple[str, float] | None = None


def cases_of(
    moving: MovingLoad, elements: Elements, downwards: Floats, where: str, backing: Backing | None = None
) -> list[PlacedCase]:
    """Return one load case for each position of a vehicle, named by the place of its first axle along the path.

    Axles on joints give a case for each side; positions with no axle on a free element are left out. downwards: (2,)
    unit direction of weights.
    """
    if elements.centroid.shape[1] == 3 or any(len(point) != 2 for point in moving.path):
        raise InputError(where, "it is for planar scenes", '"cases" with the positions of the loads')
    found: list[PlacedCase] = []
    path = np.array(moving.path, dtype=float)
    ways = [("", path), (" back", path[::-1])] if moving.both_directions else [("", path)]
    for word, points in ways:
        legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not (legs > 0.0).all():
            raise InputError(f"{where}.path", "two of its points coincide", "points apart from each other")
        for first, forces in _positions(moving, points, legs):
            fixed: list[LoadEntry] = []
            touched: list[tuple[list[int], PointLoad]] = []
            for at, unit, weight in forces:
                if backing is not None and backing.carries(at):
                    place = backing.position(at)
                    if backing.covers(place):
                        fixed.append(FillLoad(on_fill=Strip(at=place), weight=weight))
                    continue
                under = _elements_under(elements, at, unit)
                if not under:
                    problem = f"no element is at ({at[0]:.6g}, {at[1]:.6g})"
                    raise InputError(f"{where}.path", problem, "points on the outline of the structure")
                force = (weight * downwards).tolist()
                touched.append((under, PointLoad(element="", force=force, at=at.tolist())))
            name = f"{moving.name}{word} at {first:.6g}"
            # an axle on a joint stands on either side of it: the limits of the positions ahead and behind
            for side in range(max((len(under) for under, _ in touched), default=1)):
                own = [(under[min(side, len(under) - 1)], load) for under, load in touched]
                live = fixed + [
                    load.model_copy(update={"element": elements.ids[k]}) for k, load in own if not elements.support[k]
                ]
                if live:
                    title = name if side == 0 else f"{name} behind the joint" + f" {side}" * (side > 1)
                    case = Case(name=title, live=live, required=moving.required)
                    found.append(PlacedCase(where, case, (f"{moving.name}{word}", first)))
    if not found:
        raise InputError(f"{where}.path", "it touches supports alone", "points on free elements")
    return found


def _positions(
    moving: MovingLoad, points: Floats, legs: Floats
) -> Iterator[tuple[float, list[tuple[Floats, Floats, float]]]]:
    """Yield the positions on a path (k, 2) in equal steps.

    Place of the first axle, and (point, direction, weight) of those on it.
    """
    behind = np.cumsum([0.0, *(axle.distance for axle in moving.axles[1:])])
    ends = np.append(0.0, np.cumsum(legs))
    whole = float(ends[-1])
    for first in np.linspace(0.0, whole + float(behind[-1]), moving.steps).tolist():
        forces = []
        for place, axle in zip((first - behind).tolist(), moving.axles, strict=True):
            if -tolerances.ON_OUTLINE * whole <= place <= (1.0 + tolerances.ON_OUTLINE) * whole:
                leg = min(int(np.searchsorted(ends, place, side="right")) - 1, len(legs) - 1)
                leg = max(leg, 0)
                unit = (points[leg + 1] - points[leg]) / legs[leg]
                forces.append((points[leg] + (place - ends[leg]) * unit, unit, axle.weight))
        yield first, forces


def _elements_under(elements: Elements, at: Floats, unit: Floats) -> list[int]:
    """Return the elements that a point (2,) touches, the farthest along `unit` (2,) first."""
    reach = tolerances.ON_OUTLINE * elements.size
    near: Ints = np.flatnonzero(((elements.lower - reach <= at) & (at <= elements.upper + reach)).all(axis=1))
    point = shapely.Point(*at)
    touching = [k for k in near.tolist() if shapely.Polygon(elements.shape[k]).distance(point) <= reach]
    return sorted(touching, key=lambda k: -float(elements.centroid[k] @ unit))
