"""Cells that cover a plane structure: courses of a bond, Voronoi cells, sectors of rings."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import shapely

from jld_core import Floats, ParameterError
from jld_core.refinement import arrangement
from jld_masonry.bonds import course

# Number of Lloyd iterations (seeds move to the centroids of their cells), which equalise Voronoi cells
_ROUNDS: Final = 3


def courses_of(lower: Floats, upper: Floats, cell: tuple[float, float], bond: str) -> list[shapely.Polygon]:
    """Cover a box with stones of a masonry bond, course by course from below; InputError as `squares`."""
    length = float(upper[0] - lower[0])
    count = max(1, int(np.ceil((upper[1] - lower[1]) / cell[1] - 1e-9)))
    arrangement.refuse_more(count * max(length / cell[0], 1.0))
    polygons = []
    for number in range(count):
        low, high = lower[1] + cell[1] * number, lower[1] + cell[1] * (number + 1)
        ends = lower[0] + course(bond, number, length, cell[0])
        ends[-1] = upper[0]
        polygons += [shapely.box(a, low, b, high) for a, b in itertools.pairwise(ends.tolist())]
    return polygons


def voronoi(region: shapely.Geometry, cell: tuple[float, float], seed: int) -> list[shapely.Polygon]:
    """Return Voronoi cells of about a given size that cover a region; InputError as `squares`."""
    count = max(2, round(region.area / (cell[0] * cell[1])))
    arrangement.refuse_more(count)
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = region.bounds
    points = np.zeros((0, 2))
    while len(points) < count:
        samples = rng.uniform((x0, y0), (x1, y1), (4 * count, 2))
        points = np.concatenate([points, samples[shapely.contains_xy(region, samples[:, 0], samples[:, 1])]])
    points = points[:count]
    frame = shapely.box(x0, y0, x1, y1).buffer(max(x1 - x0, y1 - y0))
    cells: list[shapely.Polygon] = []
    for _ in range(_ROUNDS + 1):
        polygons = shapely.voronoi_polygons(shapely.MultiPoint(points), extend_to=frame, ordered=True)
        cells = list(polygons.geoms)
        middles = [shapely.intersection(polygon, region).centroid for polygon in cells]
        points = np.array([[m.x, m.y] if not m.is_empty else p for m, p in zip(middles, points.tolist(), strict=True)])
    return cells


def sectors(
    lower: Floats, upper: Floats, cell: tuple[float, float], centre: tuple[float, float]
) -> list[shapely.Polygon]:
    """Cover a box with sectors of rings about a centre, chords for arcs; InputError above 120° as well."""
    thick, angle = cell
    if not angle <= 120.0:
        raise ParameterError("cell", f"sectors of {angle:g} degrees are no sectors", "at most 120 degrees")
    corners = np.array([[x, y] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])])
    turns = max(3, round(360.0 / angle))
    # chords lie inside their circle, so that the last ring must be larger
    far = float(np.linalg.norm(corners - centre, axis=1).max()) / np.cos(np.pi / turns)
    rings = max(1, int(np.ceil(far / thick)))
    arrangement.refuse_more(rings * turns)
    angles = 2.0 * np.pi * np.arange(turns + 1) / turns
    unit = np.column_stack([np.cos(angles), np.sin(angles)])
    unit[-1] = unit[0]
    polygons = []
    for ring in range(rings):
        for k in range(turns):
            outer = [centre + thick * (ring + 1) * unit[j] for j in (k, k + 1)]
            inner = [centre + thick * ring * unit[j] for j in (k + 1, k)] if ring else [np.array(centre)]
            polygons.append(shapely.Polygon([*outer, *inner]))
    return polygons
