"""Masonry bonds: head joints course by course, walls that meet at bonded corners in plan, and openings in them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import shapely

from jld_core import Floats, InputError, ParameterError

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


def without(pieces: list[tuple[float, float]], start: float, end: float, shortest: float) -> list[tuple[float, float]]:
    """Remove an interval from the stones of a course; what is left below a length joins its neighbour."""
    before = [(float(a), float(min(b, start))) for a, b in pieces if a < start - 1e-12]
    after = [(float(max(a, end)), float(b)) for a, b in pieces if b > end + 1e-12]
    if len(before) > 1 and before[-1][1] - before[-1][0] < shortest:
        before = [*before[:-2], (before[-2][0], before[-1][1])]
    if len(after) > 1 and after[0][1] - after[0][0] < shortest:
        after = [(after[0][0], after[1][1]), *after[2:]]
    return before + after


Rectangle = tuple[float, float, float, float]  # least x and y, and largest x and y, of an upright wall or stone in plan

# Least distance of a head joint from an end of its wall and from a line that it must not meet, in stretchers.
SLIVER = 0.25
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
    rectangles: list[Rectangle] = []
    for wall in walls_of(plan, corners, number % 2):
        along = axis_of(wall)
        ends = (wall[along], wall[along + 2])
        joints = head_joints(bounds, along, ends, np.unique(corners[:, along]), number, bond, stretcher)
        rectangles += [within(wall, a, b) for a, b in itertools.pairwise(joints)]
    return rectangles


def axis_of(wall: Rectangle) -> int:
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
    """Return the head joints of a bond in a part of a wall, with its ends, ascending."""
    # Those closer than `SLIVER` to an end or a line are left out.
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
            lambda points: np.column_stack(
                [snapped(axis, level) for level, axis in zip(levels, points.T, strict=True)]
            ),
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
    corners: list[Floats] = [np.zeros((0, 2))]
    for ring in (plan.exterior, *plan.interiors):
        points = shapely.get_coordinates(ring)[:-1]
        edges = np.roll(points, -1, axis=0) - points
        before = np.roll(edges, 1, axis=0)
        turns = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
        corners.append(points[turns < 0.0])
    return np.concatenate(corners)


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
            piece = list(part.bounds)
            # as wide as the piece below it: both are one wall
            below = next(
                (
                    other
                    for other in walls
                    if other[through] == piece[through]
                    and other[through + 2] == piece[through + 2]
                    and other[across + 2] == piece[across]
                ),
                None,
            )
            if below is None:
                walls.append(piece)
            else:
                below[across + 2] = piece[across + 2]
    return [(wall[0], wall[1], wall[2], wall[3]) for wall in walls]


FACES: Final = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
"""Outward faces of a stone with corners (8, 3), x running fastest, then y, then z."""

# Areas and lengths, relative to the plan, below which they are nothing, and up to which two of them are the same
_SAME: Final = 1e-9

# Default bearing of a lintel, and least stone between a lintel and the end of its wall behind a corner, stretchers
_HALF: Final = 0.5
Interval = tuple[float, float]  # two positions along a wall


@dataclass(frozen=True)
class Lintel:
    """How openings are spanned: by one long stone, or a flat arch of `stones` wedges between two skewbacks."""

    # bearing: least length beyond either jamb. None: half a stretcher, or less where the wall beside the jamb is
    # shorter, but at least a quarter of a stretcher.

    stones: int = 1
    bearing: float | None = None


def bonded_walls(
    sections: Sequence[shapely.Geometry],
    beds: Sequence[float],
    bond: str,
    stretcher: float,
    *,
    first: int = 0,
    lintel: Lintel | None = None,
    name: str = "plan",
) -> list[list[Floats]]:
    """Return the stones of walls course by course, each as its corners (8, 3) with the faces `FACES`."""
    # Corners are bonded as by `corner_course`. Head joints keep a quarter of a stretcher away from the jambs of
    # openings in their own course and in those above and below, and from the ends of lintels in courses above and
    # below.
    walls = _Walls(sections, bond, stretcher, first, lintel or Lintel(), name)
    lintels: list[list[tuple[Rectangle, Interval]]] = []
    for k in range(len(sections)):
        lintels.append(walls.lintels(k, lintels[k - 1] if k else []))
    courses = []
    for k, (low, high) in enumerate(itertools.pairwise(beds)):
        beside = [lintel_plan for j in (k - 1, k + 1) if 0 <= j < len(lintels) for lintel_plan, _ in lintels[j]]
        stones = [_hexahedron(*_axes(stone), low, high) for stone in walls.stones(k, lintels[k], beside)]
        for lintel_plan, jambs in lintels[k]:
            stones += _lintel_stones(lintel_plan, jambs, low, high, walls.lintel.stones)
        courses.append(stones)
    return courses


@dataclass
class _Walls:
    sections: Sequence[shapely.Geometry]
    bond: str
    stretcher: float
    first: int
    lintel: Lintel
    name: str
    plan: shapely.Polygon = field(init=False)
    corners: Floats = field(init=False)
    voids: list[shapely.Geometry] = field(init=False)
    near: float = field(init=False)

    def __post_init__(self) -> None:
        for section in self.sections:
            squared(section, self.name)
        plan = squared(shapely.union_all(list(self.sections)), self.name)
        if plan.geom_type != "Polygon":
            raise self._refusal("its walls stand apart", "one element for each of them")
        self.plan, self.corners = plan, inner_corners(plan)
        self.voids = [shapely.difference(plan, section) for section in self.sections]
        self.near = _SAME * float(np.ptp(shapely.get_coordinates(plan), axis=0).max())

    def _refusal(self, problem: str, expected: str) -> InputError:
        return InputError(f"element {self.name!r}", problem, expected)

    def walls(self, k: int) -> list[Rectangle]:
        return walls_of(self.plan, self.corners, (self.first + k) % 2)

    def _intervals(self, region: shapely.Geometry, wall: Rectangle, *, strict: bool = True) -> list[Interval]:
        """Return the positions along a wall that a region covers, ascending; if strict, through its whole thickness."""
        along = axis_of(wall)
        thickness = wall[3 - along] - wall[1 - along]
        intervals = []
        for part in shapely.get_parts(shapely.intersection(region, shapely.box(*wall))):
            start, end = part.bounds[along], part.bounds[along + 2]
            if part.geom_type != "Polygon" or part.area <= _SAME * self.plan.area:
                continue
            if strict and abs((end - start) * thickness - part.area) > _SAME * self.plan.area:
                raise self._refusal("an opening is no rectangle through its wall", "windows and doors with plane jambs")
            intervals.append((start, end))
        return sorted(intervals)

    def lintels(self, k: int, below: list[tuple[Rectangle, Interval]]) -> list[tuple[Rectangle, Interval]]:
        """Return the lintels of a course, in plan, each with the jambs of its opening."""
        if k == 0:
            return []
        covered = shapely.difference(self.voids[k - 1], self.voids[k])
        lintels = []
        for wall in self.walls(k):
            along = axis_of(wall)
            spans = self._intervals(covered, wall)
            openings_below = self._intervals(self.voids[k - 1], wall, strict=bool(spans))
            gaps = self._intervals(self.voids[k], wall)
            openings_above = self._intervals(self.voids[k + 1], wall, strict=False) if k + 1 < len(self.voids) else []
            inside = (self.corners >= wall[:2]).all(axis=1) & (self.corners <= wall[2:]).all(axis=1)
            lines = [*self.corners[inside, along].tolist(), *(p for one in openings_above for p in one)]
            lines += [p for lintel, _ in below if _overlap(lintel, wall) for p in (lintel[along], lintel[along + 2])]
            for span in spans:
                if not any(np.allclose(span, one, rtol=0.0, atol=self.near) for one in openings_below):
                    raise self._refusal("an opening is narrower above", "jambs that are upright up to the lintel")
                ends = []
                for side in (0, 1):
                    sign = 2 * side - 1
                    # the middle of the pier between two lintels, the jamb of a higher opening, or the end of the wall
                    stops = [sign * (wall[along + 2 * side] - span[side])]
                    stops += [sign * (gap[1 - side] - span[side]) for gap in gaps]
                    stops += [0.5 * sign * (other[1 - side] - span[side]) for other in spans if other != span]
                    limit = max(0.0, min(stop for stop in stops if stop >= -self.near))
                    reach = self._bearing(limit, [sign * (line - span[side]) for line in lines])
                    ends.append(span[side] + sign * reach)
                lintels.append((within(wall, *ends), span))
        if abs(sum(_area(lintel, span) for lintel, span in lintels) - covered.area) > _SAME * self.plan.area:
            raise self._refusal("an opening is no rectangle through its wall", "windows and doors with plane jambs")
        return lintels

    def _bearing(self, limit: float, lines: list[float]) -> float:
        """Return the length by which a lintel reaches beyond a jamb; raise InputError where the wall is too short."""
        least, bearing = SLIVER * self.stretcher * (1.0 - 1e-9), self.lintel.bearing
        if limit < (least if bearing is None else bearing * (1.0 - 1e-9)):
            needed = SLIVER * self.stretcher if bearing is None else bearing
            advice = "" if bearing is None else ", or a smaller `bearing`"
            raise self._refusal(
                f"an opening leaves {limit:.3g} of wall beside it",
                f"at least {needed:g} for the bearing of its lintel{advice}",
            )
        reach = min(limit, _HALF * self.stretcher if bearing is None else bearing)
        for line in sorted(line for line in lines if 0.0 < line < limit):
            if abs(line - reach) < least:
                reach = line + SLIVER * self.stretcher
                if limit - reach < _HALF * self.stretcher:
                    reach = limit
        return limit if limit - reach < least else reach

    def stones(self, k: int, lintels: list[tuple[Rectangle, Interval]], beside: list[Rectangle]) -> list[Rectangle]:
        """Divide the walls of course k; beside: lintels of the courses next to it."""
        stones = []
        neighbours = [self.voids[j] for j in (k - 1, k + 1) if 0 <= j < len(self.voids)]
        for wall in self.walls(k):
            along = axis_of(wall)
            lines = np.unique(self.corners[:, along]).tolist()
            # head joints keep clear of the edges of openings and lintels in the courses next to it
            for void in neighbours:
                lines += itertools.chain(*self._intervals(void, wall, strict=False))
            lines += itertools.chain(*((stone[along], stone[along + 2]) for stone in beside if _overlap(stone, wall)))
            empty = self._intervals(self.voids[k], wall)
            occupied = [(stone[along], stone[along + 2]) for stone, _ in lintels if _overlap(stone, wall)]
            # the ends of the gaps bound what is left of the wall
            bounds = [wall[along], *itertools.chain(*sorted(empty + occupied)), wall[along + 2]]
            for start, end in zip(bounds[::2], bounds[1::2], strict=True):
                length = end - start
                if length <= self.near:
                    continue
                if len(bounds) > 2 and length < SLIVER * self.stretcher * (1.0 - 1e-9):
                    problem = f"an opening leaves {length:.3g} of wall beside it"
                    raise self._refusal(
                        problem, f"at least {SLIVER * self.stretcher:g}, a quarter of a stretcher, or none"
                    )
                joints = head_joints(
                    self.plan.bounds, along, (start, end), np.array(lines), self.first + k, self.bond, self.stretcher
                )
                stones += [within(wall, a, b) for a, b in itertools.pairwise(joints)]
        return stones


def _overlap(first: Rectangle, second: Rectangle) -> bool:
    """Return True if two rectangles have an area in common."""
    return all(min(first[k + 2], second[k + 2]) > max(first[k], second[k]) for k in (0, 1))


def _area(wall: Rectangle, span: Interval) -> float:
    along = axis_of(wall)
    return (span[1] - span[0]) * (wall[3 - along] - wall[1 - along])


def _axes(stone: Rectangle) -> tuple[int, Interval, Interval, Interval]:
    """Return axis, ends at the lower and at the upper face, and sides of an upright stone."""
    along = axis_of(stone)
    ends = (stone[along], stone[along + 2])
    return along, ends, ends, (stone[1 - along], stone[3 - along])


def _hexahedron(along: int, lower: Interval, upper: Interval, sides: Interval, low: float, high: float) -> Floats:
    """Return the corners (8, 3) of a stone whose ends at the lower and the upper face may differ."""
    corners = []
    for ends, height in ((lower, low), (upper, high)):
        x, y = (ends, sides) if along == 0 else (sides, ends)
        corners += [(x[i], y[j], height) for j in (0, 1) for i in (0, 1)]
    return np.array(corners)


def _lintel_stones(lintel: Rectangle, jambs: Interval, low: float, high: float, stones: int) -> list[Floats]:
    """Return the stones of a lintel: one, or wedges of a flat arch between skewbacks that lean by half the bearing."""
    along, ends, _, sides = _axes(lintel)
    if stones == 1:
        return [_hexahedron(along, ends, ends, sides, low, high)]
    soffit = np.linspace(*jambs, stones + 1)
    top = np.linspace(0.5 * (ends[0] + jambs[0]), 0.5 * (ends[1] + jambs[1]), stones + 1)
    lower, upper = ([ends[0], *line.tolist(), ends[1]] for line in (soffit, top))
    return [
        _hexahedron(along, a, b, sides, low, high)
        for a, b in zip(itertools.pairwise(lower), itertools.pairwise(upper), strict=True)
    ]
