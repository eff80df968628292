"""Trajectories of principal stresses: evenly spaced lines in fields linear in triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter, map_coordinates

from jld_core.arrays import Bools, Floats
from jld_core.assembly import Assembly
from jld_core.fields.bounds import Stresses
from jld_core.views.quantities import typical

Sign = Literal["compression", "tension"]
"""Sign of a principal stress."""

GRID: Final = 12
"""Grid points along a typical element on which stresses are averaged for drawing."""

APART: Final = 0.2
"""Distance between trajectories over the size of a typical element."""

FAINT: Final = 0.06
"""Share of the largest principal stress of its sign below which no trajectory is drawn."""

_MOST_POINTS: Final = 400  # largest number of grid points along one side of the structure

_STEPS: Final = 600  # largest number of steps of one trajectory in each direction; one step is half a grid spacing

_PIECES: Final = 4  # parts of each edge of a triangle: stresses are sampled at the middles of its equal parts


@dataclass(frozen=True)
class AveragedStresses:
    """Stresses averaged on a regular grid of ny × nx points."""

    origin: Floats  # (2,) first grid point
    spacing: float  # of grid points, length
    stress: Floats  # (ny, nx, 3) σx, σy, τxy, tension positive
    inside: Bools  # (ny, nx) True within free elements

    def at(self, points: Floats) -> Floats:
        """Return the stresses (k, 3) at points (k, 2), interpolated linearly between grid points."""
        place = ((points - self.origin) / self.spacing)[:, ::-1].T
        parts = [map_coordinates(self.stress[..., c], place, order=1, mode="nearest") for c in range(3)]
        return np.stack(parts, axis=1)

    def holds(self, points: Floats) -> Bools:
        """Return a mask (k,) of points (k, 2) whose nearest grid point is inside free elements."""
        column, row = np.round((points - self.origin) / self.spacing).astype(np.int64).T
        rows, columns = self.inside.shape
        known = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = np.zeros(len(points), dtype=bool)
        found[known] = self.inside[row[known], column[known]]
        return found


@dataclass(frozen=True)
class Trajectory:
    """One trajectory of principal stress."""

    points: Floats  # (k, 2) along it, scene units
    stress: Floats  # (k,) magnitude of the principal stress there


def averaged(assembly: Assembly, stresses: Stresses) -> AveragedStresses:
    """Average a planar stress field on a regular grid, so that its trajectories can be drawn."""
    # The spacing of the grid is a share of a typical element. A Gaussian filter of this width smooths jumps between
    # triangles.
    elements = assembly.elements
    lower, upper = elements.lower[elements.free].min(axis=0), elements.upper[elements.free].max(axis=0)
    spacing = max(typical(assembly) / GRID, float((upper - lower).max()) / _MOST_POINTS)
    count = np.ceil((upper - lower) / spacing).astype(np.int64) + 1
    corners, values = stresses.mesh.corners, stresses.stress
    # centres of the equal parts of a triangle, by their shares of the second and third corner
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(_PIECES) for j in range(_PIECES - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(_PIECES - 1) for j in range(_PIECES - 1 - i)]
    total = np.zeros((*count[::-1], 4))
    flat = total.reshape(-1, 4)
    for one, two in upright + turned:
        weights = np.array([_PIECES - one - two, one, two]) / _PIECES
        place = np.round((np.einsum("k,tkd->td", weights, corners) - lower) / spacing).astype(np.int64)
        number = np.clip(place[:, 1], 0, count[1] - 1) * count[0] + np.clip(place[:, 0], 0, count[0] - 1)
        stress = np.einsum("k,tkc->tc", weights, values)
        np.add.at(flat, number, np.column_stack([stress, np.ones(len(stress))]) * stresses.mesh.volume[:, None])
    smooth = np.stack([gaussian_filter(total[..., c], 1.0, mode="constant") for c in range(4)], axis=-1)
    x, y = (lower[axis] + spacing * np.arange(count[axis]) for axis in (0, 1))
    shapes = shapely.union_all([shapely.Polygon(elements.shape[k]) for k in elements.free])
    inside = shapely.contains_xy(shapely.buffer(shapes, 0.3 * spacing), *np.meshgrid(x, y))
    weight = smooth[..., 3]
    known = weight > 1e-6 * float(weight.max())
    stress = np.where(known[..., None], smooth[..., :3] / np.where(known, weight, 1.0)[..., None], 0.0)
    return AveragedStresses(lower, spacing, stress, np.asarray(inside & known))


def principal(stress: Floats, kind: Sign) -> tuple[Floats, Floats]:
    """Return the principal stress of one sign at points, and its direction.

    stress: (k, 3) σx, σy, τxy, tension positive. The magnitude (k,) is 0 where no stress has that sign; the directions
    (k, 2) are unit vectors.
    """
    m, d, s = 0.5 * (stress[:, 0] + stress[:, 1]), 0.5 * (stress[:, 0] - stress[:, 1]), stress[:, 2]
    radius, angle = np.hypot(d, s), 0.5 * np.arctan2(s, d)
    if kind == "compression":
        return np.maximum(radius - m, 0.0), np.column_stack([-np.sin(angle), np.cos(angle)])
    return np.maximum(m + radius, 0.0), np.column_stack([np.cos(angle), np.sin(angle)])


def trajectories(grid: AveragedStresses, kind: Sign, apart: float) -> list[Trajectory]:
    """Trace evenly spaced trajectories of principal stress, the most stressed first."""
    rows, columns = np.nonzero(grid.inside)
    seeds = grid.origin + grid.spacing * np.column_stack([columns, rows])
    size = principal(grid.at(seeds), kind)[0]
    least = FAINT * float(size.max(initial=0.0))
    if not least > 0.0:
        return []
    taken = _Taken(grid, apart)
    found = []
    for seed in seeds[np.argsort(-size, kind="stable")][: int((size > least).sum())]:
        if taken.near(seed, 1.0):
            continue
        ways = [_followed(grid, kind, seed, sign, least, taken) for sign in (-1.0, 1.0)]
        points = np.concatenate([ways[0][:0:-1], ways[1]])
        taken.add(points)
        if len(points) > 3:
            found.append(Trajectory(points, principal(grid.at(points), kind)[0]))
    return found


class _Taken:
    """Points of the trajectories traced so far, stored by squares for fast look-up.

    The side of a square is the distance between trajectories. grid: supplies the origin. apart: that distance.
    """

    def __init__(self, grid: AveragedStresses, apart: float) -> None:
        self._origin, self._apart = grid.origin, apart
        self._squares: dict[tuple[int, int], list[tuple[float, float]]] = {}

    def add(self, points: Floats) -> None:
        """Store the points (k, 2) of a trajectory."""
        for x, y in points.tolist():
            self._squares.setdefault(self._square(x, y), []).append((x, y))

    def near(self, point: Floats, share: float) -> bool:
        """Return True if a stored point lies within `share` of the distance between trajectories.

        point: (2,).
        """
        x, y = float(point[0]), float(point[1])
        column, row = self._square(x, y)
        limit = share * self._apart
        return any(
            math.hypot(x - other[0], y - other[1]) < limit
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
            for other in self._squares.get((column + i, row + j), ())
        )

    def _square(self, x: float, y: float) -> tuple[int, int]:
        """Return column and row of the square that contains a point."""
        return math.floor((x - self._origin[0]) / self._apart), math.floor((y - self._origin[1]) / self._apart)


def _followed(
    grid: AveragedStresses,
    kind: Literal["compression", "tension"],
    seed: Floats,
    sign: float,
    least: float,
    taken: _Taken,
) -> Floats:
    """Trace a trajectory from its seed in one direction; return its points (k, 2).

    seed: (2,).
    """
    # The midpoint rule is used.
    step, points, point = 0.5 * grid.spacing, [seed], seed
    ahead = sign * principal(grid.at(seed[None]), kind)[1][0]
    for _ in range(_STEPS):
        middle = point + 0.5 * step * ahead
        size, way = principal(grid.at(middle[None]), kind)
        along = way[0] if float(way[0] @ ahead) >= 0.0 else -way[0]
        after = point + step * along
        closed = len(points) > 8 and float(np.hypot(*(after - seed))) < step
        if size[0] < least or not grid.holds(after[None])[0] or taken.near(after, 0.5) or closed:
            break
        points.append(after)
        point, ahead = after, along
    return np.array(points)
