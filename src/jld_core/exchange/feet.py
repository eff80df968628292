"""Supports of structures that name none: below lowest edges and faces, at springings of arches, beside flat arches."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.exchange.drawn_loads import Cell
from jld_core.exchange.options import Notes
from jld_core.geometry.snapping import straight

_LEVEL: Final = 1e-6  # height above the lowest point, relative to the size, up to which an edge or a face lies there

_LEAN: Final = 0.05  # least run of the sides of a flat arch over its depth; below it an outline is a wall

_FOOT: Final = 0.05  # height of supports that are added, relative to the size

_SMOOTH: Final = np.cos(np.radians(35.0))  # cosine of the largest turn between chords of one curve

_CURVED: Final = np.radians(10.0)  # least turn of a curve from end to end

_RINGS: Final = 8  # largest number of rings of an arch

_RISING: Final = 0.6  # largest upward component of the outer normal of a springing


def planar_feet(cells: list[Cell], tolerance: float, notes: Notes) -> list[Cell]:
    """Return supports for the cells of a drawing that names none; none where nothing is level or raked."""
    own = [shapely.Polygon(cell.points) for cell in cells if not cell.support]
    whole = shapely.union_all([shapely.make_valid(shape) for shape in own])
    rings = [_ring(part) for part in shapely.get_parts(whole) if part.geom_type == "Polygon"]
    every = np.concatenate(rings)
    size, low = float(np.ptp(every, axis=0).max()), float(every[:, 1].min())
    out = _FOOT * size
    near = max(_LEVEL * size, tolerance)
    if len(rings) == 1 and (found := _skewbacks(rings[0], size, near)):
        notes.assumed.append("supports beside the raked sides of a flat arch: the drawing names none")
        return [Cell(points, "supports", None, True) for points in found]
    ends = [end for ring in rings for end in _springings(ring)]
    if not ends and len(own) <= _RINGS:  # rings of an arch whose ends are no line
        bands = [_springings(_ring(shape)) for shape in own]
        ends = [end for band in bands for end in band] if all(bands) else []
    level = [
        (a, b) for ring in rings for a, b in _edges(ring) if max(a[1], b[1]) - low <= near and abs(b[0] - a[0]) > near
    ]
    if level and not any(line[:, 1].max() - low > near for line in ends):
        notes.assumed.append("supports below the lowest edges: the drawing names none")
        spans = [sorted((float(a[0]), float(b[0]))) for a, b in level]
        boxes = [[(x0, low - out), (x1, low - out), (x1, low), (x0, low)] for x0, x1 in spans]
        return [Cell(np.array(box), "supports", None, True) for box in boxes]
    ends = ends or [np.array(edge) for ring in rings for edge in _lowest_edges(ring)]
    if not ends:
        return []
    notes.assumed.append("supports at the springings: the drawing names none")
    feet = [shapely.Polygon([*line, *(line + out * _normal(line[0], line[-1]))[::-1]]) for line in ends]
    return [Cell(_ring(foot), "supports", None, True) for foot in _without(feet, whole)]


def _ring(shape: shapely.Polygon) -> Floats:
    """Return the corners (k, 2) of an outline, counter-clockwise, without those in straight edges."""
    return straight(shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1])


def _without(feet: list[shapely.Polygon], whole: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the largest part of each area that lies outside a structure and outside those before."""
    found: list[shapely.Polygon] = []
    for foot in feet:
        taken = shapely.union_all([whole, *found])
        if taken.intersection(foot).area > 1e-9 * foot.area:
            parts = [p for p in shapely.get_parts(foot.difference(taken)) if p.geom_type == "Polygon"]
            foot = max(parts, key=lambda part: float(part.area), default=shapely.Polygon())
        if not foot.is_empty:
            found.append(foot)
    return found


def _edges(ring: Floats) -> list[tuple[Floats, Floats]]:
    """Return the edges of a ring (k, 2) by their ends (2,)."""
    return list(zip(ring, np.roll(ring, -1, axis=0), strict=True))


def _normal(a: Floats, b: Floats) -> Floats:
    """Return the outer unit normal (2,) of an edge of a counter-clockwise ring."""
    along = (b - a) / np.hypot(*(b - a))
    return np.array([along[1], -along[0]])


def _springings(ring: Floats) -> list[Floats]:
    """Return the two ends (j, 2) of a band between two curves; none for any other counter-clockwise ring (k, 2)."""
    along = np.roll(ring, -1, axis=0) - ring
    along = along / np.hypot(*along.T)[:, None]
    before = np.roll(along, 1, axis=0)
    cosine = np.einsum("ij,ij->i", before, along)
    turn = np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], cosine)
    corners = np.flatnonzero(cosine < _SMOOTH).tolist()
    if len(corners) != 4:
        return []
    runs = []
    for first, last in zip(corners, [*corners[1:], corners[0] + len(ring)], strict=True):
        inside = np.arange(first + 1, last) % len(ring)
        runs.append((ring[np.arange(first, last + 1) % len(ring)], abs(float(turn[inside].sum())) > _CURVED))
    ends = [line for line, curved in runs if not curved]
    if [curved for _, curved in runs] not in ([True, False] * 2, [False, True] * 2):
        return []
    return ends if all(_normal(line[0], line[-1])[1] < _RISING for line in ends) else []


def _lowest_edges(ring: Floats) -> list[tuple[Floats, Floats]]:
    """Return the edge at the lowest corner of either half of a ring (k, 2) that looks down and out."""
    middle = 0.5 * (ring[:, 0].min() + ring[:, 0].max())
    edges = _edges(ring)
    found: dict[int, tuple[Floats, Floats]] = {}
    for side in (-1.0, 1.0):
        half = np.flatnonzero(side * (ring[:, 0] - middle) > 0.0)
        if not len(half):
            continue
        corner = int(half[np.argmin(ring[half, 1])])
        pair = [(corner - 1) % len(ring), corner]
        best = max(pair, key=lambda k: float(_normal(*edges[k]) @ (side, -1.0)))
        if float(_normal(*edges[best]) @ (side, -1.0)) > 0.0:
            found[best] = edges[best]
    return list(found.values())


def _skewbacks(corners: Floats, size: float, near: float) -> list[Floats]:
    """Return supports beside both sides of a flat arch's outline (k, 2); none for any other."""
    # A flat arch has four corners, a level soffit at least as long as it is deep, and sides that lean outwards.
    if len(corners) != 4:
        return []
    order = np.argsort(corners[:, 1], kind="stable")
    (x0, y0), (x1, y1) = sorted(corners[order[:2]].tolist())
    (x2, y2), (x3, y3) = sorted(corners[order[2:]].tolist())
    deep = min(y2, y3) - y0
    if not (abs(y1 - y0) <= near and 0.0 < deep <= x1 - x0 and x0 - x2 > _LEAN * deep and x3 - x1 > _LEAN * deep):
        return []
    out = _FOOT * size
    return [
        np.array([[xs, y0], [xt + way * out, y0], [xt + way * out, yt], [xt, yt]])
        for xs, xt, yt, way in ((x0, x2, y2, -1.0), (x1, x3, y3, 1.0))
    ]
