"""Masonry bonds: head joints course by course, and walls that meet at bonded corners in plan."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError, ParameterError

BONDS: Final = ("running", "third", "stack", "english", "flemish")
"""Names of the bonds.

running: every second course shifted by half a stretcher. third: courses shifted by 0, 1/3 and 2/3 of a stretcher.
stack: all head joints in line. english: courses of stretchers and of headers alternate. flemish: stretchers and headers
alternate in each course, headers over the middle of stretchers.
"""

_SLIVER: Final = 0.25  # shortest piece at the end of a course, in stretchers; a shorter one joins its neighbour


def course(bond: str, number: int, length: float, stretcher: float) -> Floats:
    """Return the positions of the head joints of one course, with its ends; raise InputError for an unknown bond."""
    # The result (k + 1,) ascends from 0 to `length` and bounds k stones.
    if bond not in BONDS:
        raise ParameterError("bond", f"no bond is named {bond!r}", "one of " + ", ".join(BONDS))
    if bond == "flemish":
        pattern, start = [stretcher, 0.5 * stretcher], 0.75 * stretcher * (number % 2)
    elif bond == "english":
        header = number % 2 == 1
        pattern, start = [0.5 * stretcher if header else stretcher], 0.25 * stretcher if header else 0.0
    else:
        share = {"running": 0.5 * (number % 2), "third": (number % 3) / 3.0, "stack": 0.0}[bond]
        pattern, start = [stretcher], share * stretcher
    repeats = int(np.ceil(length / sum(pattern))) + 2
    joints = start - sum(pattern) + np.concatenate([[0.0], np.cumsum(np.tile(pattern, repeats))])
    inside = joints[
        (joints > _SLIVER * stretcher * (1.0 - 1e-9)) & (joints < length - _SLIVER * stretcher * (1.0 - 1e-9))
    ]
    return np.concatenate([[0.0], inside, [length]])


def without(pieces: list[tuple[float, float]], left: float, right: float, least: float) -> list[tuple[float, float]]:
    """Remove an interval from the stones of a course; what is left below a length joins its neighbour."""
    before = [(float(a), float(min(b, left))) for a, b in pieces if a < left - 1e-12]
    after = [(float(max(a, right)), float(b)) for a, b in pieces if b > right + 1e-12]
    if len(before) > 1 and before[-1][1] - before[-1][0] < least:
        before = [*before[:-2], (before[-2][0], before[-1][1])]
    if len(after) > 1 and after[0][1] - after[0][0] < least:
        after = [(after[0][0], after[1][1]), *after[2:]]
    return before + after


Rectangle = tuple[float, float, float, float]
"""Least x and y, and largest x and y, of an upright wall or stone in plan."""

SLIVER = 0.25
"""Least distance of a head joint from an end of its wall and from a line that it must not meet, in stretchers."""

_NEAR = 1e-6  # distance, relative to the extent of a plan, up to which coordinates are the same


def corner_course(
    plan: shapely.Polygon, number: int, bond: str, stretcher: float, name: str = "plan"
) -> list[Rectangle]:
    """Return the stones of one course over a plan of walls along the axes; quoins alternate from course to course."""
    # In even courses walls along x run through the corners, in odd courses those along y: the stone at a corner belongs
    # to the one, then to the other. Head joints closer than a quarter of a stretcher to a corner or to the end of their
    # wall are left out, so that no joint runs through two courses at a corner.
    bounds = plan.bounds
    plan = squared(plan, name)
    corners = inner_corners(plan)
    found: list[Rectangle] = []
    for wall in walls_of(plan, corners, number % 2):
        along = axis_of(wall)
        ends = (wall[along], wall[along + 2])
        joints = head_joints(bounds, along, ends, np.unique(corners[:, along]), number, bond, stretcher)
        found += [within(wall, a, b) for a, b in itertools.pairwise(joints)]
    return found


def axis_of(wall: Rectangle) -> int:
    """Return the axis along which a wall runs: 0 for x, 1 for y."""
    return int(wall[3] - wall[1] > wall[2] - wall[0])


def within(wall: Rectangle, start: float, end: float) -> Rectangle:
    """Return the part of a wall between two positions along it."""
    part = list(wall)
    along = axis_of(wall)
    part[along], part[along + 2] = start, end
    return part[0], part[1], part[2], part[3]


def head_joints(
    bounds: Rectangle, along: int, ends: tuple[float, float], lines: Floats, number: int, bond: str, stretcher: float
) -> list[float]:
    """Return the head joints of a bond in a part of a wall, with its ends, ascending.

    Those closer than `SLIVER` to an end or a line are left out.
    """
    # walls along y are one course ahead: where they run through, a whole stretcher begins at their corner
    joints = bounds[along] + course(bond, number + along, bounds[along + 2] - bounds[along], stretcher)[1:-1]
    joints = joints[(joints > ends[0]) & (joints < ends[1])]
    clear = abs(joints[:, None] - np.concatenate([ends, lines])).min(axis=1) >= SLIVER * stretcher * (1.0 - 1e-9)
    return [ends[0], *joints[clear].tolist(), ends[1]]


def squared(plan: shapely.Geometry, name: str) -> shapely.Geometry:
    """Return a plan whose nearly equal coordinates are equal."""
    points = shapely.get_coordinates(plan)
    extent = float(np.ptp(points, axis=0).max())
    levels = [levels_of(column, extent) for column in points.T]
    polygons = [
        shapely.transform(
            shapely.geometry.polygon.orient(part),
            lambda points: np.column_stack([snapped(one, level) for level, one in zip(levels, points.T, strict=True)]),
        )
        for part in shapely.get_parts(plan)
    ]
    for ring in (ring for part in polygons for ring in (part.exterior, *part.interiors)):
        if np.diff(shapely.get_coordinates(ring), axis=0).all(axis=1).any():
            raise InputError(
                f"element {name!r}", "an edge of its plan is at no right angle to others", "walls at right angles"
            )
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def levels_of(values: Floats, extent: float) -> Floats:
    """Return the different values, ascending; of nearly equal ones the least."""
    ordered = np.sort(values)
    return np.asarray(ordered[np.concatenate([[True], np.diff(ordered) > _NEAR * extent])])


def snapped(values: Floats, levels: Floats) -> Floats:
    return np.asarray(levels[np.searchsorted(levels, values, side="right") - 1])


def inner_corners(plan: shapely.Polygon) -> Floats:
    """Return the re-entrant corners (k, 2) of a squared plan, where walls meet."""
    found: list[Floats] = [np.zeros((0, 2))]
    for ring in (plan.exterior, *plan.interiors):
        points = shapely.get_coordinates(ring)[:-1]
        edges = np.roll(points, -1, axis=0) - points
        before = np.roll(edges, 1, axis=0)
        turns = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
        found.append(points[turns < 0.0])
    return np.concatenate(found)


def walls_of(plan: shapely.Polygon, corners: Floats, through: int) -> list[Rectangle]:
    """Divide a plan into walls, those along one axis running through its re-entrant corners (k, 2)."""
    across = 1 - through
    levels = [plan.bounds[across], *np.unique(corners[:, across]).tolist(), plan.bounds[across + 2]]
    walls: list[list[float]] = []
    for a, b in itertools.pairwise(levels):
        strip = list(plan.bounds)
        strip[across], strip[across + 2] = a, b
        inside = shapely.intersection(plan, shapely.box(*strip))
        for part in shapely.get_parts(inside):
            if part.geom_type != "Polygon":  # edges that touch the strip
                continue
            one = list(part.bounds)
            # as wide as the piece below it: both are one wall
            below = next(
                (
                    other
                    for other in walls
                    if other[through] == one[through]
                    and other[through + 2] == one[through + 2]
                    and other[across + 2] == one[across]
                ),
                None,
            )
            if below is None:
                walls.append(one)
            else:
                below[across + 2] = one[across + 2]
    return [(one[0], one[1], one[2], one[3]) for one in walls]
