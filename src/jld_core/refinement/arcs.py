"""Circular arcs of an outline, found from its corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Floats

_ON: Final = 1e-5  # distance from a circle, relative to the extent of a run of corners, up to which they lie on it

# Largest turn at a corner of an arc; four corners of a rectangle lie on a circle as well, and are no arc
_CHORD: Final = np.radians(44.0)

_LEAST: Final = 4  # smallest number of corners of an arc: three lie on a circle always

# Smallest angle of an arc about its centre; a flatter one is no better known than a straight line
_SWEEP: Final = np.radians(8.0)


@dataclass(frozen=True)
class Arc:
    """Circular arc of an outline.

    centre: (2,) centre of the circle, scene units. radius: radius of the circle, scene units. angles: (k,) angles of
    the corners about the centre, ascending, radians; the first and the last are its ends. hollow: True if the material
    lies outside the circle, as at an intrados.
    """

    centre: Floats
    radius: float
    angles: Floats
    hollow: bool

    @property
    def sweep(self) -> float:
        """Return the angle between the ends, radians."""
        return float(self.angles[-1] - self.angles[0])

    def point(self, angle: float) -> Floats:
        """Return the point (2,) of the circle at an angle, radians."""
        return self.centre + self.radius * np.array([np.cos(angle), np.sin(angle)])


def find_arcs(ring: Floats) -> list[Arc]:
    """Return the arcs of a closed outline, in the order of its corners.

    ring: (k, 2) corners, counter-clockwise, none in a straight edge. An arc has at least four corners.
    """
    count = len(ring)
    step = np.roll(ring, -1, axis=0) - ring
    back = np.roll(step, 1, axis=0)
    turn = np.arctan2(back[:, 0] * step[:, 1] - back[:, 1] * step[:, 0], (back * step).sum(axis=1))
    smooth = abs(turn) <= _CHORD
    breaks = np.flatnonzero(~smooth)
    first = int(breaks[0]) if len(breaks) else 0
    found: list[Arc] = []
    at = 0
    while at + _LEAST <= count + 1:
        run = _longest(ring, turn, smooth, first + at, min(count + 1 - at, count))
        arc = _arc(ring[(first + at + np.arange(run)) % count]) if run >= _LEAST else None
        if arc is not None:
            found.append(arc)
        at += run - 1 if arc is not None else 1
    return found


def _longest(ring: Floats, turn: Floats, smooth: Floats, start: int, most: int) -> int:
    """Return the number of corners from `start` on that form one arc, 1 if there is none.

    Corners of an arc lie on one circle and turn to one side. ring: (k, 2) corners. turn: (k,) angle at each corner,
    radians. smooth: (k,) True where that angle is small enough for an arc. most: largest number to try.
    """
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
    """Fit a circle to points (k, 2) by least squares; return its centre (2,) and radius.

    None if a point is off the circle by more than a tolerance, or the points lie on a line.
    """
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
    """Fit an arc to consecutive corners (k, 2) of a counter-clockwise outline.

    None if the points are on no circle, or turn by less than the least angle of an arc.
    """
    fitted = _fit(points)
    if fitted is None:
        return None
    centre, radius = fitted
    angles = np.unwrap(np.arctan2(*(points - centre).T[::-1]))
    hollow = bool(angles[-1] < angles[0])
    angles = angles[::-1] if hollow else angles
    return Arc(centre, radius, angles, hollow) if angles[-1] - angles[0] >= _SWEEP else None
