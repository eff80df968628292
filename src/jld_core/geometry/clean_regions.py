"""Parts of a plane region without what is no wider than a tolerance: spikes, slivers, necks, and holes.

Intersections of polygons with rounded coordinates leave spikes of a width near rounding, by which a hull grows as far
as they reach. A spike is removed where its tip is a corner of the outline; a neck splits the region in two.
"""

from __future__ import annotations

import shapely

from jld_core.arrays import Floats
from jld_core.geometry import polygons as measures
from jld_core.geometry.overlay import area_of, intersections

Rings = tuple[Floats, tuple[Floats, ...]]
"""Shell (k, 2), counter-clockwise, and holes (k, 2) each, clockwise."""


def clean_parts(region: shapely.Geometry, reach: float) -> list[Rings]:
    """Split a region into its parts, without anything narrower than a tolerance.

    Parameters
    ----------
    region : shapely geometry
        Polygons, lines and points; lines and points are dropped.
    reach : float
        Width up to which spikes and holes are dropped; parts and necks are dropped up to half of it. A length.

    Returns
    -------
    list of Rings
        Corners of each part, its shell first and then its holes, in order of place.
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
    return list(shapely.get_parts(area_of(region)))


def _without_necks(part: shapely.Polygon, reach: float) -> list[shapely.Polygon]:
    """Split a polygon at necks narrower than half the tolerance; nothing is left of one that is narrower throughout."""
    wide = _polygons(shapely.buffer(part, -0.25 * reach, join_style="mitre"))
    if len(wide) < 2:
        return [part] if wide else []
    grown = [shapely.buffer(one, 0.5 * reach, join_style="mitre") for one in wide]
    halves = [_polygons(half) for half in intersections([part] * len(grown), grown)]
    return [max(half, key=lambda piece: piece.area) for half in halves if half]


def _ring(ring: shapely.LinearRing) -> Floats:
    corners: Floats = shapely.get_coordinates(ring)[:-1]
    return corners


def _turned(ring: Floats, sense: float) -> Floats:
    """Turn a ring (k, 2) counter-clockwise (sense 1) or clockwise (sense −1)."""
    return ring if sense * measures.area(ring[None])[0] > 0.0 else ring[::-1].copy()
