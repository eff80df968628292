"""Cells that cover a region (rectangles, courses, Voronoi, sectors), and cuts of convex polyhedra."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import ParameterError
from jld_core.geometry import Faces, facets_of
from jld_core.samples.bonds import course

MOST: Final = 100_000
"""Largest number of cells of a refinement."""

# Number of Lloyd iterations (seeds move to the centroids of their cells), which equalise Voronoi cells
_ROUNDS: Final = 3

_ON: Final = 1e-9  # distance from a plane, relative to a solid, up to which a corner lies in the plane


def squares(lower: Floats, upper: Floats, cell: tuple[float, float]) -> list[shapely.Polygon]:
    """Cover a box with rectangles of a given size, row by row from the lower left corner.

    lower, upper: (2,) corners of the box. cell: width and height, length. The last rectangles may exceed the box.
    Raises InputError for more than `MOST` cells.
    """
    counts = [
        max(1, int(np.ceil((high - low) / size - 1e-9))) for low, high, size in zip(lower, upper, cell, strict=True)
    ]
    _refuse(counts[0] * counts[1])
    x = lower[0] + cell[0] * np.arange(counts[0] + 1)
    y = lower[1] + cell[1] * np.arange(counts[1] + 1)
    return [shapely.box(x[i], y[j], x[i + 1], y[j + 1]) for j in range(counts[1]) for i in range(counts[0])]


def courses_of(lower: Floats, upper: Floats, cell: tuple[float, float], bond: str) -> list[shapely.Polygon]:
    """Cover a box with stones in courses of a masonry bond, course by course from below.

    lower, upper: (2,) corners of the box. cell: length of a stretcher and height of a course, length. bond: its name,
    one of `BONDS`. Raises InputError for an unknown bond or more than `MOST` cells.
    """
    length = float(upper[0] - lower[0])
    count = max(1, int(np.ceil((upper[1] - lower[1]) / cell[1] - 1e-9)))
    _refuse(count * max(length / cell[0], 1.0))
    found = []
    for number in range(count):
        low, high = lower[1] + cell[1] * number, lower[1] + cell[1] * (number + 1)
        ends = lower[0] + course(bond, number, length, cell[0])
        ends[-1] = upper[0]
        found += [shapely.box(a, low, b, high) for a, b in itertools.pairwise(ends.tolist())]
    return found


def voronoi(region: shapely.Geometry, cell: tuple[float, float], seed: int) -> list[shapely.Polygon]:
    """Return Voronoi cells that cover a region, about as many as cells of a given size.

    region: polygons. cell: width and height, length. seed: of the random points in the region, which are then spread
    evenly by Lloyd iterations. Outer cells extend beyond the region. Raises InputError for more than `MOST` cells.
    """
    count = max(2, round(region.area / (cell[0] * cell[1])))
    _refuse(count)
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = region.bounds
    points = np.zeros((0, 2))
    while len(points) < count:
        drawn = rng.uniform((x0, y0), (x1, y1), (4 * count, 2))
        points = np.concatenate([points, drawn[shapely.contains_xy(region, drawn[:, 0], drawn[:, 1])]])
    points = points[:count]
    frame = shapely.box(x0, y0, x1, y1).buffer(max(x1 - x0, y1 - y0))
    cells: list[shapely.Polygon] = []
    for _ in range(_ROUNDS + 1):
        found = shapely.voronoi_polygons(shapely.MultiPoint(points), extend_to=frame, ordered=True)
        cells = list(found.geoms)
        middles = [shapely.intersection(one, region).centroid for one in cells]
        points = np.array([[m.x, m.y] if not m.is_empty else p for m, p in zip(middles, points.tolist(), strict=True)])
    return cells


def sectors(
    lower: Floats, upper: Floats, cell: tuple[float, float], centre: tuple[float, float]
) -> list[shapely.Polygon]:
    """Cover a box with sectors of rings about a centre, with chords for arcs.

    lower, upper: (2,) corners of the box. cell: ring thickness, length, and sector angle, degrees. Raises InputError
    for an angle above 120 degrees, or more than `MOST` cells.
    """
    thick, angle = cell
    if not angle <= 120.0:
        raise ParameterError("cell", f"sectors of {angle:g} degrees are no sectors", "at most 120 degrees")
    corners = np.array([[x, y] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])])
    turns = max(3, round(360.0 / angle))
    # chords lie inside their circle, so that the last ring must be larger
    far = float(np.linalg.norm(corners - centre, axis=1).max()) / np.cos(np.pi / turns)
    rings = max(1, int(np.ceil(far / thick)))
    _refuse(rings * turns)
    angles = 2.0 * np.pi * np.arange(turns + 1) / turns
    unit = np.column_stack([np.cos(angles), np.sin(angles)])
    unit[-1] = unit[0]
    found = []
    for ring in range(rings):
        for k in range(turns):
            outer = [centre + thick * (ring + 1) * unit[j] for j in (k, k + 1)]
            inner = [centre + thick * ring * unit[j] for j in (k + 1, k)] if ring else [np.array(centre)]
            found.append(shapely.Polygon([*outer, *inner]))
    return found


def _refuse(count: float) -> None:
    """Raise InputError if the number of cells exceeds `MOST`."""
    if count > MOST:
        raise ParameterError("cell", f"that makes {count:.3g} cells", f"at most {MOST}")


def cut(vertices: Floats, faces: Faces, normal: Floats, offset: float) -> list[tuple[Floats, Faces]]:
    """Cut a convex polyhedron by the plane n·x = offset into two closed polyhedra.

    vertices: (k, 3). faces: outward loops of vertex indices. normal: (3,) unit vector n. Returns vertices and faces of
    the part below the plane, then above; of the polyhedron alone where the plane does not cross it.
    """
    height = vertices @ normal - offset
    size = float(np.ptp(vertices, axis=0).max())
    height = np.where(np.abs(height) <= _ON * size, 0.0, height)
    if not (height.min() < 0.0 < height.max()):
        return [(vertices, faces)]
    return [_half(vertices, faces, sign * height, sign * normal) for sign in (-1.0, 1.0)]


def _half(vertices: Floats, faces: Faces, height: Floats, normal: Floats) -> tuple[Floats, Faces]:
    """Return the part of a convex polyhedron above a plane, with the cut as its last face.

    vertices: (k, 3). faces: outward loops of vertex indices. height: (k,) signed distance of every vertex from the
    plane, exactly 0 on it, with both signs present. normal: (3,) unit vector towards the part that is returned.
    """
    points: list[Floats] = []
    place: dict[tuple[int, int], int] = {}

    def number(key: tuple[int, int], point: Floats) -> int:
        """Return the index of the vertex with a key, adding it at `point` at first use."""
        if key not in place:
            place[key] = len(points)
            points.append(point)
        return place[key]

    loops = []
    rim: set[int] = set()
    for loop in faces:
        kept = []
        for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
            if height[a] >= 0.0:
                index = number((a, a), vertices[a])
                kept.append(index)
                if height[a] == 0.0:
                    rim.add(index)
            if height[a] * height[b] < 0.0:
                # interpolate from the lower to the higher vertex number, so that both parts get the same point
                i, j = min(a, b), max(a, b)
                share = height[i] / (height[i] - height[j])
                index = number((i, j), vertices[i] + share * (vertices[j] - vertices[i]))
                kept.append(index)
                rim.add(index)
        if len(kept) > 2 and any(index not in rim for index in kept):
            loops.append(tuple(kept))
    table = np.array(points)
    around = sorted(rim)
    middle = table[around].mean(axis=0)
    e1 = table[around[0]] - middle
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    angle = np.arctan2((table[around] - middle) @ e2, (table[around] - middle) @ e1)
    # clockwise about the normal, so that the face is outward
    loops.append(tuple(around[k] for k in np.argsort(-angle, kind="stable").tolist()))
    return table, tuple(loops)


def convex(vertices: Floats, faces: Faces) -> bool:
    """Return True if a polyhedron is convex, up to 1e-5 of its size.

    vertices: (k, 3). faces: outward loops of vertex indices.
    """
    facets = facets_of([vertices], [faces])
    size = float(np.ptp(vertices, axis=0).max())
    over = np.einsum("fd,fvd->fv", facets.normal, vertices[None] - facets.origin[:, None])
    return bool(over.max() <= 1e-5 * size)
