"""Paths of lines and arcs, and their approximation by chords.

A path has rows x, y, bulge (k, 3): tangent of a quarter of the angle of the arc to the next point, positive to the
left. Arcs of one circle are divided at the same points in all paths, so that neighbours share their chords.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import Floats, InputError, Ints
from jld_core.geometry import merge_points

_MOST_CHORDS: Final = 100_000  # largest number of chords of all arcs of a drawing

_MOST: Final = 1e7  # largest number of pairs of arcs of one circle; more indicate a wrong or malicious file


@dataclass(frozen=True)
class Path:
    """Sequence of lines and arcs on a layer of a drawing."""

    # (k, 3) x, y and bulge of the edge from this point to the next. The bulge is the tangent of a quarter of the arc's
    # angle, positive to the left, 0 for a line.
    points: Floats
    closed: bool  # True if the last point is joined to the first
    layer: str
    name: str | None = None  # id of the future element, None if unknown
    holes: tuple[Floats, ...] = ()  # outlines (k, 3) cut out of the area

    def scaled(self, scale: float) -> Path:
        factor = np.array([scale, scale, 1.0])
        return Path(
            self.points * factor, self.closed, self.layer, self.name, tuple(hole * factor for hole in self.holes)
        )


@dataclass(frozen=True)
class Chords:
    points: list[Floats]  # (k, 2) of each path
    arcs: int  # number of arcs
    deviation: float  # largest distance of an arc from its chords


@dataclass(frozen=True)
class _Arc:
    """Arc of a path: centre, radius, first angle and sweep, radians, positive to the left."""

    path: int
    edge: int
    centre: Floats
    radius: float
    first: float
    sweep: float


def without_repeats(path: Path, same: float) -> Path:
    """Return a path that ends where it comes back to its start."""
    # An open path that comes back to its start is closed. One that goes on past its start along its own first edges, as
    # A B C D A B, ends at the start.
    points = path.points
    count = len(points)
    at_start = np.hypot(*(points[:, :2] - points[0, :2]).T) <= same
    for k in np.flatnonzero(at_start).tolist():
        if k > 2 or (k == 2 and points[:2, 2].any()):
            ring = points[:k]
            repeated = ring[np.arange(k, count) % k]
            differs = np.hypot(*(points[k:, :2] - repeated[:, :2]).T) > same
            if not differs[:-1].any() and (not differs[-1] or _between(points[-1], ring, count - 1, same)):
                return Path(ring, closed=True, layer=path.layer, name=path.name, holes=path.holes)
    return path


def _between(point: Floats, ring: Floats, step: int, same: float) -> bool:
    """Return True if a point lies on the straight edge that ends at corner `step`, modulo k, of a ring (k, 3)."""
    start, end = ring[(step - 1) % len(ring)], ring[step % len(ring)]
    along = end[:2] - start[:2]
    length = float(np.hypot(*along))
    if length == 0.0 or start[2]:
        return False
    share = float((point[:2] - start[:2]) @ along) / length**2
    return 0.0 <= share <= 1.0 and float(np.hypot(*(point[:2] - start[:2] - share * along))) <= same


def arc_points(centre: Sequence[float], radius: float, first: float, sweep: float) -> Floats:
    """Return points (k, 3) of x, y and bulge along an arc, as rows of a `Path`."""
    parts = max(1, int(np.ceil(abs(sweep) / np.pi - 1e-12)))
    angles = first + sweep * np.arange(parts + 1) / parts
    points = np.column_stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)])
    bulge = np.append(np.full(parts, np.tan(sweep / parts / 4.0)), 0.0)
    return np.column_stack([points, bulge])


def flatten(paths: Sequence[Path], facet: float, same: float) -> Chords:
    """Approximate arcs by chords within `facet`, equal on both sides of a shared arc; InputError for too many."""
    arcs = [arc for number, path in enumerate(paths) for arc in _arcs(number, path)]
    if not arcs:
        return Chords([path.points[:, :2].copy() for path in paths], 0, 0.0)
    circle = merge_points(np.array([[*arc.centre, arc.radius] for arc in arcs]), max(same, 1e-300))
    stops: dict[int, list[float]] = {}
    for which, arc in zip(circle.tolist(), arcs, strict=True):
        stops.setdefault(which, []).extend([arc.first, arc.first + arc.sweep])
    _add_ends(stops, paths, arcs, circle, same)
    count = np.bincount(circle)
    if float((count.astype(float) ** 2).sum()) > _MOST:
        raise InputError("", f"it holds {int(count.max())} arcs of one circle", "the arcs of a structure")
    chords = sum(abs(arc.sweep) / _step(arc.radius, facet) for arc in arcs)
    if chords > _MOST_CHORDS:
        problem = f"its arcs are {chords:.3g} chords within {facet:.3g} of them"
        raise InputError("", problem, f"a larger `facet`: at most {_MOST_CHORDS} chords")
    regular = {
        which: _dividing_angles(np.array(ends), arcs[int(np.argmax(circle == which))].radius, facet, same)
        for which, ends in stops.items()
    }
    inside: dict[tuple[int, int], Floats] = {}
    deviation = 0.0
    for which, arc in zip(circle.tolist(), arcs, strict=True):
        turn = 1.0 if arc.sweep > 0.0 else -1.0
        along = np.mod(turn * (regular[which] - arc.first), 2.0 * np.pi)
        least_angle = max(same / arc.radius, 1e-9)
        divisions = np.sort(along[(along > least_angle) & (along < abs(arc.sweep) - least_angle)])
        angles = arc.first + turn * divisions
        inside[arc.path, arc.edge] = arc.centre + arc.radius * np.column_stack([np.cos(angles), np.sin(angles)])
        gaps = np.diff(np.concatenate([[0.0], divisions, [abs(arc.sweep)]]))
        deviation = max(deviation, arc.radius * (1.0 - float(np.cos(gaps.max() / 2.0))))
    chord_points = []
    for number, path in enumerate(paths):
        pieces = []
        for edge, point in enumerate(path.points[:, :2]):
            pieces.append(point[None])
            if (number, edge) in inside:
                pieces.append(inside[number, edge])
        chord_points.append(np.concatenate(pieces))
    return Chords(chord_points, len(arcs), deviation)


def _add_ends(
    stops: dict[int, list[float]], paths: Sequence[Path], arcs: list[_Arc], circle: Ints, same: float
) -> None:
    """Add the angles at which corners of paths lie on a circle: a joint that ends on an arc ends on its chords."""
    corners = np.concatenate([path.points[:, :2] for path in paths])
    corners = corners[np.argsort(corners[:, 0], kind="stable")]
    for which, first in zip(*np.unique(circle, return_index=True), strict=True):
        centre, radius = arcs[first].centre, arcs[first].radius
        reach = radius + same
        low, high = np.searchsorted(corners[:, 0], [centre[0] - reach, centre[0] + reach])
        offset = corners[low:high] - centre
        on_circle = offset[abs(np.hypot(*offset.T) - radius) <= same]
        stops[int(which)].extend(np.arctan2(on_circle[:, 1], on_circle[:, 0]).tolist())


def _step(radius: float, facet: float) -> float:
    """Return the angle, radians, of the largest chord that is within a distance of its circle."""
    return float(max(2.0 * np.arccos(np.clip(1.0 - facet / radius, np.cos(np.pi / 8.0), 1.0)), 1e-3))


def _dividing_angles(stops: Floats, radius: float, facet: float, same: float) -> Floats:
    """Return ascending angles (j,) that divide a circle at the ends (k,) of its arcs and between, radians."""
    # The steps between two ends are equal, so that the division has every symmetry of the ends.
    least_angle = max(same / radius, 1e-9)
    ends = np.sort(np.mod(stops, 2.0 * np.pi))
    ends = ends[np.concatenate([[True], np.diff(ends) > least_angle])]
    if len(ends) > 1 and ends[0] + 2.0 * np.pi - ends[-1] <= least_angle:
        ends = ends[:-1]
    step = _step(radius, facet)
    spans = np.append(np.diff(ends), ends[0] + 2.0 * np.pi - ends[-1])
    parts = np.maximum(1, np.ceil(spans / step - 1e-9)).astype(int)
    return np.concatenate(
        [
            begin + span * np.arange(count) / count
            for begin, span, count in zip(ends, spans, parts.tolist(), strict=True)
        ]
    )


def _arcs(number: int, path: Path) -> list[_Arc]:
    """Return the arcs of a path; edges with a bulge below 1e-9 are straight."""
    arcs = []
    points = path.points
    for edge in range(len(points) if path.closed else len(points) - 1):
        bulge = float(points[edge, 2])
        start, end = points[edge, :2], points[(edge + 1) % len(points), :2]
        chord = end - start
        length = float(np.hypot(*chord))
        if abs(bulge) < 1e-9 or length == 0.0:
            continue
        # the centre lies on the perpendicular bisector, to the left of the chord by (1 − b²)/(4b) times its length
        centre = 0.5 * (start + end) + (1.0 - bulge**2) / (4.0 * bulge) * np.array([-chord[1], chord[0]])
        radius = length * (1.0 + bulge**2) / (4.0 * abs(bulge))
        first = float(np.arctan2(*(start - centre)[::-1]))
        arcs.append(_Arc(number, edge, centre, radius, first, 4.0 * float(np.arctan(bulge))))
    return arcs
