"""Removal of spikes, slivers, necks and holes narrower than a tolerance from regions.

Intersections of polygons with rounded coordinates leave spikes as narrow as rounding; each extends the convex hull by
its whole length. A spike is removed where its tip is a corner of the outline; a neck splits the region in two.
"""

from __future__ import annotations

import shapely

from jld_core.arrays import Floats
from jld_core.geometry import polygons as measures
from jld_core.geometry.overlay import area_of, intersections

Rings = tuple[Floats, tuple[Floats, ...]]
"""Shell (k, 2), counter-clockwise, and holes (k, 2) each, clockwise."""


def clean_parts(region: shapely.Geometry, reach: float) -> list[Rings]:
    """Split a region into its parts, and remove details narrower than a tolerance.

    region: polygons, lines and points; lines and points are dropped. reach: width up to which spikes and holes are
    removed, a length. Parts and necks are removed if they are narrower than half of it. Result: corners of each part,
    first its shell and then its holes, ordered by the mean of the shell's corners.
    """
    found = []
    for part in _polygons(region):
        for piece in _without_necks(part, reach):
            shell = measures.corners(_ring(piece.exterior), reach)
            extent = float((shell.max(axis=0) - shell.min(axis=0)).max())
            if 2.0 * abs(measures.area(shell[None])[0]) <= reach * extent:
                continue
            holes = [ring for ring in piece.interiors if 2.0 * shapely.Polygon(ring).area > reach * ring.length]
            inner = tuple(_turned(measures.corners(_ring(hole), reach), -1.0) for hole in holes)
            found.append((_turned(shell, 1.0), inner))
    return sorted(found, key=lambda rings: tuple(rings[0].mean(axis=0)))


def _polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the polygons of a region."""
    return list(shapely.get_parts(area_of(region)))


def _without_necks(part: shapely.Polygon, reach: float) -> list[shapely.Polygon]:
    """Split a polygon at necks narrower than half of `reach`, and return the parts.

    The list is empty if the whole polygon is narrower.
    """
    wide = _polygons(shapely.buffer(part, -0.25 * reach, join_style="mitre"))
    if len(wide) < 2:
        return [part] if wide else []
    grown = [shapely.buffer(one, 0.5 * reach, join_style="mitre") for one in wide]
    halves = [_polygons(half) for half in intersections([part] * len(grown), grown)]
    return [max(half, key=lambda piece: piece.area) for half in halves if half]


def _ring(ring: shapely.LinearRing) -> Floats:
    """Return the corners (k, 2) of a closed ring, without the repeated last one."""
    corners: Floats = shapely.get_coordinates(ring)[:-1]
    return corners


def _turned(ring: Floats, sense: float) -> Floats:
    """Orient a ring (k, 2) counter-clockwise (sense 1) or clockwise (sense −1)."""
    return ring if sense * measures.area(ring[None])[0] > 0.0 else ring[::-1].copy()
