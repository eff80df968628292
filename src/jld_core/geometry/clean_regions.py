"""Removal of spikes, slivers, necks and holes narrower than a tolerance, which rounding leaves in regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.geometry import outlines as measures

_GRID: Final = 1e-12  # grid width relative to the smaller region: far below the required accuracy of contacts, 1e-9

# Largest coordinate, in sizes of the smaller region, up to which the grid keeps its width. Doubles resolve 1e-12 of it;
# beyond, the grid is widened.
_MOST: Final = 500.0


def intersections(first: Sequence[shapely.Geometry], second: Sequence[shapely.Geometry]) -> Any:
    """Intersect pairs of regions (n,), each on a rounding grid about its own middle; empty where nothing is shared."""
    regions_1, regions_2 = np.asarray(first, dtype=object), np.asarray(second, dtype=object)
    boxes = np.nan_to_num(np.stack([shapely.bounds(regions_1), shapely.bounds(regions_2)])).reshape(2, -1, 2, 2)
    middle = 0.5 * (boxes[:, :, 0].max(axis=0) + boxes[:, :, 1].min(axis=0))
    size = (boxes[:, :, 1] - boxes[:, :, 0]).max(axis=2).min(axis=0)
    reach = abs(boxes - middle[None, :, None]).max(axis=(0, 2, 3))
    unit = np.maximum(size, reach / _MOST)
    unit[unit == 0.0] = 1.0
    scaled = [_moved(regions, -middle / unit[:, None], 1.0 / unit) for regions in (regions_1, regions_2)]
    return _moved(shapely.intersection(*scaled, grid_size=_GRID), middle, unit)


def area_of(region: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a region, without lines, points and bridges to holes.

    Parameters
    ----------
    region : shapely geometry
        Region, also an invalid one.

    Returns
    -------
    shapely.MultiPolygon
        Polygons with an area; empty where there are none.
    """
    parts = shapely.get_parts(shapely.get_parts(region if region.is_valid else shapely.make_valid(region)))
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon" and part.area > 0.0])


def _moved(regions: Any, shift: Floats, factor: Floats) -> Any:
    """Scale regions (n,) by factors (n,), then shift them by (n, 2)."""
    owner = np.repeat(np.arange(len(regions)), shapely.get_num_coordinates(regions))
    return shapely.transform(regions, lambda points: points * factor[owner, None] + shift[owner])


Rings = tuple[Floats, tuple[Floats, ...]]
"""Shell (k, 2), counter-clockwise, and holes (k, 2) each, clockwise."""


def clean_parts(region: shapely.Geometry, reach: float) -> list[Rings]:
    """Split a region into parts without details narrower than `reach`: shell and holes, by mean corner."""
    parts_with_holes = []
    for part in _polygons(region):
        for piece in _without_necks(part, reach):
            shell = measures.corners(_ring(piece.exterior), reach)
            extent = float((shell.max(axis=0) - shell.min(axis=0)).max())
            if 2.0 * abs(measures.area(shell[None])[0]) <= reach * extent:
                continue
            holes = [ring for ring in piece.interiors if 2.0 * shapely.Polygon(ring).area > reach * ring.length]
            inner = tuple(_turned(measures.corners(_ring(hole), reach), -1.0) for hole in holes)
            parts_with_holes.append((_turned(shell, 1.0), inner))
    return sorted(parts_with_holes, key=lambda rings: tuple(rings[0].mean(axis=0)))


def _polygons(region: shapely.Geometry) -> list[shapely.Polygon]:
    return list(shapely.get_parts(area_of(region)))


def _without_necks(part: shapely.Polygon, reach: float) -> list[shapely.Polygon]:
    """Split a polygon at necks narrower than half of `reach`; [] if all of it is narrower."""
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
