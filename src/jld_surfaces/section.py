"""Resultants of a plastic cross-section: a polytope inside its curved yield surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from jld_core import Floats, InputError
from jld_surfaces.keys import Section

_DIRECTIONS = 8  # directions of neutral axes in space

_WIDE = 10.0  # side of a half-plane, unit squares


def shape_of(section: Section) -> shapely.Geometry:
    """Return the cross-section about the middle of its face, which is a unit square."""
    solid, holes = ([shapely.Polygon(ring) for ring in rings] for rings in (section.polygons, section.holes))
    valid = all(part.is_valid for part in (*solid, *holes))
    shape = shapely.union_all(solid).difference(shapely.union_all(holes)) if valid else shapely.Polygon()
    if not shape.area > 0.0:
        raise InputError(".section", "its polygons hold no area", "simple polygons with corners in order")
    if not shapely.box(-1e-9, -1e-9, 1 + 1e-9, 1 + 1e-9).covers(shape):
        raise InputError(".section", "it reaches beyond its face", "corners from 0 to 1")
    return shapely.affinity.translate(shape, -0.5, -0.5)


def resultants(shape: shapely.Geometry, section: Section, dimension: int) -> tuple[Floats, Floats]:
    """Return vertices (p, 2 or 3) and rays of (n, m) or (n, m1, m2), pressure and moments over unit square as stress.

    Each vertex has one neutral axis, compression on one side of it and tension on the other. Moments are scaled as
    those of a face: twice stress times arm.
    """
    tension, compression = section.tensile_strength, section.compressive_strength
    whole = _moments(shape)
    if compression is None:
        hull = np.array(shape.convex_hull.exterior.coords)[:-1]
        rays = _of(np.column_stack([np.ones(len(hull)), hull]), dimension)
        return _of(-tension * whole[None], dimension), rays
    angles = [0.0, np.pi] if dimension == 2 else 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    points = [-tension * whole, compression * whole]
    for angle in angles:
        way = np.array([np.cos(angle), np.sin(angle)])
        heights = np.array(shape.convex_hull.exterior.coords) @ way
        for height in np.linspace(heights.min(), heights.max(), section.steps + 1)[1:-1]:
            pressed = _moments(shape.intersection(_beyond(way, height)))
            points.append((compression + tension) * pressed - tension * whole)
    return _of(np.array(points), dimension), np.zeros((0, dimension))


def _beyond(way: Floats, height: float) -> shapely.Geometry:
    """Return the half-plane of points x with x·way ≥ height."""
    across = np.array([-way[1], way[0]])
    start = height * way
    return shapely.Polygon([start - _WIDE * across, start + _WIDE * across, start + _WIDE * (across + way),
                            start + _WIDE * (way - across)])  # fmt: skip


def _moments(shape: shapely.Geometry) -> Floats:
    """Return area and first moments (3,) of a shape."""
    centre = shape.centroid
    return np.zeros(3) if shape.is_empty else shape.area * np.array([1.0, centre.x, centre.y])


def _of(table: Floats, dimension: int) -> Floats:
    """Return resultants from stress times (area, ∫x, ∫y): a force at (x, y) turns by −x about e2, and y about e1."""
    n, x, y = table.T
    columns: Sequence[Floats] = (n, -2.0 * x) if dimension == 2 else (n, 2.0 * y, -2.0 * x)
    return np.column_stack(columns)
