"""Cells of voussoirs in rings: joints radiate from the centres of the outline's own arcs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from jld_core import Floats, InputError, ParameterError
from jld_core.geometry import unions
from jld_core.refinement import arrangement

_ON: Final = 1e-5  # distance from a circle, relative to the extent of a run of corners, up to which they lie on it

# Largest turn at a corner of an arc; four corners of a rectangle lie on a circle as well, and are no arc
_CHORD: Final = np.radians(44.0)

_LEAST: Final = 4  # smallest number of corners of an arc: three lie on a circle always

# Smallest angle of an arc about its centre; a flatter one is no better known than a straight line
_SWEEP: Final = np.radians(8.0)


@dataclass(frozen=True)
class Arc:
    centre: Floats  # (2,) centre of the circle, scene units
    radius: float  # radius of the circle, scene units
    # (k,) angles of the corners about the centre, ascending, radians; the first and the last are its ends
    angles: Floats
    hollow: bool  # True if the material lies outside the circle, as at an intrados

    @property
    def sweep(self) -> float:
        """Return the angle between the ends, radians."""
        return float(self.angles[-1] - self.angles[0])

    def point(self, angle: float) -> Floats:
        return self.centre + self.radius * np.array([np.cos(angle), np.sin(angle)])


def find_arcs(ring: Floats) -> list[Arc]:
    """Return the arcs, of at least four corners, of a counter-clockwise outline (k, 2) without straight corners."""
    count = len(ring)
    step = np.roll(ring, -1, axis=0) - ring
    back = np.roll(step, 1, axis=0)
    turn = np.arctan2(back[:, 0] * step[:, 1] - back[:, 1] * step[:, 0], (back * step).sum(axis=1))
    smooth = abs(turn) <= _CHORD
    breaks = np.flatnonzero(~smooth)
    first = int(breaks[0]) if len(breaks) else 0
    arcs: list[Arc] = []
    at = 0
    while at + _LEAST <= count + 1:
        run = _longest(ring, turn, smooth, first + at, min(count + 1 - at, count))
        arc = _arc(ring[(first + at + np.arange(run)) % count]) if run >= _LEAST else None
        if arc is not None:
            arcs.append(arc)
        at += run - 1 if arc is not None else 1
    return arcs


def _longest(ring: Floats, turn: Floats, smooth: Floats, start: int, most: int) -> int:
    """Return the number of corners from `start` that form one arc, 1 if none; turn: (k,) angles."""
    # Corners of an arc lie on one circle and turn to one side.
    count, run = len(ring), 1
    for number in range(_LEAST, most + 1):
        inside = (start + np.arange(1, number - 1)) % count
        if not smooth[inside].all() or abs(np.sign(turn[inside]).sum()) < number - 2:
            break
        if _fit(ring[(start + np.arange(number)) % count]) is None:
            break
        run = number
    return run


def _fit(points: Floats) -> tuple[Floats, float] | None:
    """Fit a circle to points (k, 2): centre (2,) and radius; None if off by a tolerance, or on a line."""
    middle, extent = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    local = (points - middle) / extent
    rows = np.column_stack([2.0 * local, np.ones(len(local))])
    solution, _, rank, _ = np.linalg.lstsq(rows, (local**2).sum(axis=1), rcond=None)
    if rank < 3:
        return None
    radius = float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0.0)))
    off = abs(np.hypot(*(local - solution[:2]).T) - radius).max()
    return (middle + extent * solution[:2], extent * radius) if off <= _ON else None


def _arc(points: Floats) -> Arc | None:
    """Fit an arc to consecutive corners (k, 2) of an outline; None on no circle, or of too small an angle."""
    fitted = _fit(points)
    if fitted is None:
        return None
    centre, radius = fitted
    angles = np.unwrap(np.arctan2(*(points - centre).T[::-1]))
    hollow = bool(angles[-1] < angles[0])
    angles = angles[::-1] if hollow else angles
    return Arc(centre, radius, angles, hollow) if angles[-1] - angles[0] >= _SWEEP else None


_PARALLEL: Final = 1e-9  # sine of the angle between two edges up to which they do not meet

_COVERS: Final = 0.6  # share of an intrados that an arc must lie above to be its extrados


@dataclass(frozen=True)
class VoussoirCells:
    """Cells that cover a structure by voussoirs, and by courses beside them."""

    cells: list[shapely.Polygon]  # cells; those of voussoirs come first
    width: float  # length of a voussoir at the intrados
    depth: float  # depth of a ring at the crown


@dataclass(frozen=True)
class _Fan:
    """Rays from one centre that bound the voussoirs of an arc, with the rings' end distances."""

    centre: Floats
    directions: Floats  # (s, 2) unit vectors of rays, and of corners between them
    ray: list[int]  # indices of those directions that are joints
    distance: Floats  # (k, s) from the centre to the end of each ring but the last, which ends far outside
    # first, last: springings (2,)
    first: Floats
    last: Floats
    width: float  # of a voussoir at the intrados
    depth: float  # of a ring at the crown
    opening: int = 0  # number of the opening, which may have several arcs

    def cells(self, far: float) -> list[shapely.Polygon]:
        """Return the cells between the rays, ring by ring; the last ring ends beyond `far`."""
        polygons = []
        for k in range(len(self.distance) + 1):
            for a, b in zip(self.ray[:-1], self.ray[1:], strict=True):
                between = np.arange(a, b + 1)
                spread = float(self.directions[a] @ self.directions[b])
                outside = np.full(len(between), 2.0 * far / max(math.sqrt(max(0.5 * (1.0 + spread), 0.0)), 0.1))
                outer = self.distance[k, between] if k < len(self.distance) else outside
                lower = self.distance[k - 1, between[::-1]] if k else np.zeros(1)
                inner = between[::-1] if k else between[:1]
                above = self.centre + outer[:, None] * self.directions[between]
                below = self.centre + lower[:, None] * self.directions[inner]
                polygons.append(shapely.Polygon(np.concatenate([above, below])))
        return polygons


def voussoir_cells(
    region: shapely.Geometry,
    down: Floats,
    voussoirs: int,
    rings: int,
    centre: tuple[float, float] | None,
    skew: float | None = None,
) -> VoussoirCells:
    """Return cells of voussoirs that cover a structure; InputError without an arc or a centre."""
    # Joints radiate from the centre of each arc of an opening, and divide the arc between its springings in equal
    # parts. Rings divide the depth below an extrados. Without an extrados, a ring has the depth of the crown over the
    # number of rings, and rings go on outwards. Parts of the structure that no ray reaches are cut in courses. A
    # structure without an arc is a flat arch. Its joints meet at `centre`, or where its sides meet, and divide the
    # soffit in equal parts.
    if voussoirs < 1 or rings < 1:
        name, value = ("voussoirs", voussoirs) if voussoirs < 1 else ("rings", rings)
        raise ParameterError(name, f"{value} is wrong", "a whole number from 1")
    if voussoirs * rings > arrangement.MOST:
        raise ParameterError("voussoirs", f"that makes {voussoirs * rings:.3g} cells", f"at most {arrangement.MOST}")
    fans: list[_Fan] = []
    for part in shapely.get_parts(region):
        fans += _fans(part, down, voussoirs, rings, centre, skew, len(fans))
    if not fans:
        problem = "the outline has no arc, and no soffit between two sides that meet below it"
        raise ParameterError("voussoirs", problem, "an outline with an arc, or `centre` x,y where its joints meet")
    far = float(np.hypot(*np.ptp(np.array(region.bounds).reshape(2, 2), axis=0)))
    zones = _zones(fans, down, far)
    cells: list[shapely.Polygon] = []
    for fan, zone in zip(fans, zones, strict=True):
        inside = [zone.intersection(cell) for cell in fan.cells(_reach(region, fan.centre))]
        cells += [part for piece in inside for part in shapely.get_parts(piece) if part.geom_type == "Polygon"]
    cells += _courses(region, cells, fans[0], down)
    return VoussoirCells(cells, min(fan.width for fan in fans), min(fan.depth for fan in fans))


def _fans(
    part: shapely.Polygon,
    down: Floats,
    voussoirs: int,
    rings: int,
    centre: tuple[float, float] | None,
    skew: float | None,
    number: int,
) -> list[_Fan]:
    """Make the rays of one connected part: a fan for each arc, or one for a flat arch."""
    region = unions.region_of(part)
    arcs = [arc for ring in (region.shell, *region.holes) for arc in find_arcs(ring)]
    hollow = [arc for arc in arcs if arc.hollow]
    if not arcs or centre is not None or skew is not None:
        flat = _flat(region.shell, part, down, voussoirs, rings, centre, skew)
        return [replace(flat, opening=number)] if flat is not None else []
    chosen = hollow or arcs
    fans = []
    for opening, chain in enumerate(_chains(chosen), number):
        for arc, count in zip(chain, _distribute(chain, voussoirs), strict=True):
            fans.append(replace(_of_arc(arc, arcs, part, count, rings), opening=opening))
    return fans


def _chains(arcs: list[Arc]) -> list[list[Arc]]:
    """Group arcs that meet at an end, as those of a basket arch or a pointed arch."""
    chains: list[list[Arc]] = []
    for arc in arcs:
        for chain in chains:
            ends = [chained.point(angle) for chained in chain for angle in (chained.angles[0], chained.angles[-1])]
            ends_of_arc = [arc.point(angle) for angle in (arc.angles[0], arc.angles[-1])]
            if min(float(np.hypot(*(a - b))) for a in ends for b in ends_of_arc) <= 1e-4 * arc.radius:
                chain.append(arc)
                break
        else:
            chains.append([arc])
    return chains


def _distribute(chain: list[Arc], voussoirs: int) -> list[int]:
    """Distribute voussoirs over a chain's arcs by length, at least one each; ParameterError if too few."""
    if len(chain) == 1:
        return [voussoirs]
    if voussoirs < len(chain):
        raise ParameterError("voussoirs", f"{voussoirs} are fewer than the {len(chain)} arcs of one opening", "more")
    length = np.array([arc.sweep * arc.radius for arc in chain])
    shares = length / length.sum() * (voussoirs - len(chain))
    counts = np.floor(shares + 1e-9).astype(int)
    for k in np.argsort(counts - shares, kind="stable")[: voussoirs - len(chain) - int(counts.sum())]:
        counts[k] += 1
    return (counts + 1).tolist()  # type: ignore[no-any-return]


def _of_arc(arc: Arc, arcs: list[Arc], part: shapely.Polygon, voussoirs: int, rings: int) -> _Fan:
    """Make the rays and rings of one arc; InputError if no material lies above it."""
    joints = np.linspace(arc.angles[0], arc.angles[-1], voussoirs + 1)
    near = 1e-3 * (joints[1] - joints[0])
    corners = [angle for angle in arc.angles if abs(joints - angle).min() > near]
    angles = np.sort(np.concatenate([joints, corners]))
    ray = np.searchsorted(angles, joints).tolist()
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    above = _extrados(arc, arcs, directions) if arc.hollow else None
    if above is not None:
        steps = np.arange(1, rings)[:, None] / rings
        distance = np.minimum(_at_corners(arc, angles), above)
        distance = distance + steps * (above - distance)
        depth = float((above - arc.radius).min()) / rings
    elif arc.hollow:
        depth = _crown(arc, part) / rings
        count = int(np.ceil((_reach(part, arc.centre) - arc.radius) / depth - 1e-9))
        if rings * voussoirs * max(count, 1) > arrangement.MOST:
            raise ParameterError("rings", "that makes too many cells", f"at most {arrangement.MOST} cells")
        outwards = depth * np.arange(1, max(count, 1))[:, None]
        distance = _at_corners(arc, angles) * (1.0 + outwards / arc.radius)
    else:
        depth = arc.radius / rings
        distance = (np.arange(1, rings) / rings)[:, None] * _at_corners(arc, angles)
    width = arc.radius * float(joints[1] - joints[0])
    first, last = arc.point(arc.angles[0]), arc.point(arc.angles[-1])
    return _Fan(arc.centre, directions, ray, distance, first, last, width, depth)


def _at_corners(arc: Arc, angles: Floats) -> Floats:
    """Return the distances (s,) from the centre of an arc to its chords, at angles (s,)."""
    after = np.clip(np.searchsorted(arc.angles, angles), 1, len(arc.angles) - 1)
    before, next_angle = arc.angles[after - 1], arc.angles[after]
    half = 0.5 * (next_angle - before)
    return np.asarray(arc.radius * np.cos(half) / np.cos(angles - 0.5 * (before + next_angle)))


def _extrados(arc: Arc, arcs: list[Arc], directions: Floats) -> Floats | None:
    """Return the distances (s,) along rays (s, 2) from an intrados' centre to the extrados, or None."""
    for other in arcs:
        if other.hollow or other.radius <= arc.radius:
            continue
        away = arc.centre - other.centre
        along = directions @ away
        square = along**2 - away @ away + other.radius**2
        if (square <= 0.0).any():
            continue
        distance = np.sqrt(square) - along
        points = arc.centre + distance[:, None] * directions - other.centre
        angle = np.arctan2(points[:, 1], points[:, 0])
        turned = (angle - other.angles[0] + 1e-9) % (2.0 * np.pi)
        if (distance > arc.radius).all() and (turned <= other.sweep + 2e-9).mean() >= _COVERS:
            return np.asarray(distance)
    return None


def _crown(arc: Arc, part: shapely.Polygon) -> float:
    """Return the depth of material above the middle of an arc; InputError if there is none."""
    middle = 0.5 * (arc.angles[0] + arc.angles[-1])
    direction = np.array([np.cos(middle), np.sin(middle)])
    far = _reach(part, arc.centre) + arc.radius
    line = shapely.LineString([arc.centre + 0.5 * arc.radius * direction, arc.centre + far * direction])
    ends = [
        sorted(float((point - arc.centre) @ direction) for point in shapely.get_coordinates(piece))
        for piece in shapely.get_parts(shapely.intersection(line, part))
    ]
    pieces = sorted((low, high) for low, *_, high in (end for end in ends if len(end) > 1))
    depth = pieces[0][1] - arc.radius if pieces else 0.0
    if depth <= 1e-6 * arc.radius:
        raise InputError("elements", "there is no material above the middle of an arc", "an arc below its structure")
    return depth


def _flat(
    ring: Floats,
    part: shapely.Polygon,
    down: Floats,
    voussoirs: int,
    rings: int,
    centre: tuple[float, float] | None,
    skew: float | None,
) -> _Fan | None:
    """Return the fan of a flat arch; None if its sides do not meet below the soffit."""
    edge = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*edge.T)
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / length[:, None]
    faces_down = outward @ down
    # the soffit is the lowest edge that faces downwards
    level = (ring + 0.5 * edge) @ down
    candidates = np.flatnonzero(faces_down > 0.9)
    if not len(candidates):
        return None
    k = int(candidates[np.lexsort((-length[candidates], -np.round(level[candidates], 9)))[0]])
    a, b = ring[k], ring[(k + 1) % len(ring)]
    if skew is not None:
        # tan θ is half of the span over the depth of the centre below the soffit
        meeting = 0.5 * (a + b) + 0.5 * float(length[k]) / math.tan(math.radians(skew)) * outward[k]
    elif centre is None:
        before, after = ring[k - 1] - a, ring[(k + 2) % len(ring)] - b
        cross = float(before[0] * after[1] - before[1] * after[0])
        if abs(cross) <= _PARALLEL * float(np.hypot(*before) * np.hypot(*after)):
            return None
        share = float((b - a)[0] * after[1] - (b - a)[1] * after[0]) / cross
        meeting = a + share * before
    else:
        meeting = np.array(centre, dtype=float)
    if float((meeting - 0.5 * (a + b)) @ outward[k]) <= 0.0:
        return None
    stations = a + np.linspace(0.0, 1.0, voussoirs + 1)[:, None] * (b - a)
    reach = np.hypot(*(stations - meeting).T)
    directions = (stations - meeting) / reach[:, None]
    tops = np.array([_exit(part, meeting, direction, float(r)) for direction, r in zip(directions, reach, strict=True)])
    steps = np.arange(1, rings)[:, None] / rings
    distance = reach + steps * (tops - reach)
    depth = float((tops - reach)[voussoirs // 2]) / rings
    return _Fan(meeting, directions, list(range(voussoirs + 1)), distance, a, b, float(length[k]) / voussoirs, depth)


def _exit(part: shapely.Polygon, centre: Floats, direction: Floats, start: float) -> float:
    """Return the distance from a centre at which a ray leaves a part of the structure."""
    far = 2.0 * (_reach(part, centre) + start)
    line = shapely.LineString([centre, centre + far * direction])
    points = shapely.get_coordinates(shapely.intersection(line, part.buffer(1e-9 * far)))
    along = (points - centre) @ direction
    return float(along.max())


def _reach(region: shapely.Geometry, centre: Floats) -> float:
    return float(np.hypot(*(shapely.get_coordinates(region) - centre).T).max())


def _zones(fans: list[_Fan], down: Floats, far: float) -> list[shapely.Polygon]:
    """Return the strip of the plane, along the direction of weight, that each fan cuts."""
    # Borders lie in the middle of the piers between openings. Fans of one opening share a strip.
    right = np.array([-down[1], down[0]])
    spans: dict[int, tuple[float, float]] = {}
    for fan in fans:
        ends = (float(fan.first @ right), float(fan.last @ right))
        low, high = spans.get(fan.opening, (math.inf, -math.inf))
        spans[fan.opening] = (min(low, *ends), max(high, *ends))
    polygons = []
    for fan in fans:
        low, high = spans[fan.opening]
        others = [span for opening, span in spans.items() if opening != fan.opening]
        left_of = [0.5 * (low + end) for _, end in others if end <= low + 1e-6 * far]
        right_of = [0.5 * (high + begin) for begin, _ in others if begin >= high - 1e-6 * far]
        # beyond all of the structure, and of the centre of a flat arc
        away = 4.0 * (far + float(np.hypot(*(fan.centre - 0.5 * (fan.first + fan.last)))))
        low, high = max(left_of, default=low - away), min(right_of, default=high + away)
        middle = float(fan.first @ down)
        corners = [(low, middle - away), (high, middle - away), (high, middle + away), (low, middle + away)]
        polygons.append(shapely.Polygon([x * right + y * down for x, y in corners]))
    return polygons


def _courses(region: shapely.Geometry, fans: list[shapely.Polygon], fan: _Fan, down: Floats) -> list[shapely.Polygon]:
    """Cover the part outside all voussoirs by cells in courses; one box if nothing is left."""
    outside = shapely.difference(region, shapely.union_all(fans))
    if outside.area <= 1e-9 * region.area:
        return [shapely.box(*region.bounds)]  # slivers along springings join their neighbours
    right = np.array([-down[1], down[0]])
    corners = shapely.get_coordinates(region) - fan.first
    local = np.column_stack([corners @ right, -(corners @ down)])
    size = (fan.depth, fan.width)
    lower = size * np.floor(local.min(axis=0) / size - 1e-9)
    inside = []
    covered = shapely.union_all(fans)
    for cell in arrangement.squares(lower, local.max(axis=0), size):
        shape = shapely.transform(cell, lambda p: fan.first + p[:, :1] * right - p[:, 1:] * down)
        free = shapely.difference(shape, covered)
        inside += [part for part in shapely.get_parts(free) if part.geom_type == "Polygon" and part.area > 0.0]
    return inside
