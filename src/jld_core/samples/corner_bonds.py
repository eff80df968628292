"""Bonded corners: stones of one course of walls that meet at right angles in plan."""

from __future__ import annotations

import itertools

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.samples.bonds import course

Rectangle = tuple[float, float, float, float]
"""Least x and y, and largest x and y, of an upright wall or stone in plan."""

_SLIVER = 0.25
"""Least distance of a head joint from the end of its wall and from a corner that it passes, in stretchers."""

_NEAR = 1e-6
"""Distance, relative to the extent of a plan, up to which coordinates are the same."""


def corner_course(
    plan: shapely.Polygon, number: int, bond: str, stretcher: float, name: str = "plan"
) -> list[Rectangle]:
    """Return the stones of one course over a plan of walls, the quoins of courses above one another alternating.

    In even courses walls along x run through the corners, in odd courses those along y: the stone at a corner belongs
    to the one, then to the other. Head joints closer than a quarter of a stretcher to a corner or to the end of their
    wall are left out, so that no joint runs through two courses at a corner.

    plan: outline whose edges lie along x and y; it may have holes. number: number of the course, from 0. bond: one of
    `BONDS`. stretcher: length of a stretcher, in the unit of the plan. name: of the element, for messages. Raises
    InputError for an unknown bond, or edges that are not along the axes.
    """
    through = number % 2
    low_x, low_y, high_x, high_y = plan.bounds
    ends = ((low_x, high_x), (low_y, high_y))
    plan = _squared(plan, name)
    lines = _lines(plan)
    found: list[Rectangle] = []
    for wall in _walls(plan, lines, through):
        sides = (wall[2] - wall[0], wall[3] - wall[1])
        along = int(sides[1] > sides[0])
        # walls along y are one course ahead: where they run through, a whole stretcher begins at their corner
        start, end = ends[along]
        joints = start + course(bond, number + along, end - start, stretcher)[1:-1]
        least, most = wall[along], wall[along + 2]
        kept = np.concatenate([[least, most], lines[along][(lines[along] > least) & (lines[along] < most)]])
        joints = joints[(joints > least) & (joints < most)]
        clear = abs(joints[:, None] - kept).min(axis=1, initial=np.inf) >= _SLIVER * stretcher * (1.0 - 1e-9)
        for a, b in itertools.pairwise([least, *joints[clear].tolist(), most]):
            stone = list(wall)
            stone[along], stone[along + 2] = a, b
            found.append((stone[0], stone[1], stone[2], stone[3]))
    return found


def _squared(plan: shapely.Polygon, name: str) -> shapely.Polygon:
    """Return a plan whose nearly equal coordinates are equal.

    name: of the element, for messages. Raises InputError for edges that are not along the axes.
    """
    points = shapely.get_coordinates(plan)
    near = _NEAR * float(np.ptp(points, axis=0).max())
    levels = []
    for column in np.sort(points, axis=0).T:
        levels.append(column[np.concatenate([[True], np.diff(column) > near])])
    squared = shapely.transform(
        shapely.geometry.polygon.orient(plan),
        lambda points: np.column_stack(
            [level[np.searchsorted(level, one, side="right") - 1] for level, one in zip(levels, points.T, strict=True)]
        ),
    )
    for ring in (squared.exterior, *squared.interiors):
        if np.diff(shapely.get_coordinates(ring), axis=0).all(axis=1).any():
            raise InputError(
                f"element {name!r}", "an edge of its plan is at no right angle to others", "walls at right angles"
            )
    return squared


def _lines(plan: shapely.Polygon) -> tuple[Floats, Floats]:
    """Return the x and the y of the re-entrant corners of a plan that `_squared` returns, ascending, each once."""
    found: list[Floats] = []
    for ring in (plan.exterior, *plan.interiors):
        points = shapely.get_coordinates(ring)[:-1]
        edges = np.roll(points, -1, axis=0) - points
        before = np.roll(edges, 1, axis=0)
        turns = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
        found.append(points[turns < 0.0])
    corners = np.concatenate(found)
    return np.unique(corners[:, 0]), np.unique(corners[:, 1])


def _walls(plan: shapely.Polygon, lines: tuple[Floats, Floats], through: int) -> list[Rectangle]:
    """Divide a plan into walls, those along one axis running through the corners.

    lines: coordinates of the re-entrant corners. through: 0 for walls along x, 1 for those along y.
    """
    across = 1 - through
    levels = [plan.bounds[across], *lines[across].tolist(), plan.bounds[across + 2]]
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
