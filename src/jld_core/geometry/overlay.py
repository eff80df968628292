"""Intersections of plane regions on a fine grid, and extraction of their polygons.

In floating point, GEOS 3.14 may take two polygons that share an edge up to rounding for one inside the other. It then
returns the whole smaller polygon without an exception. On a grid its nodes are exact, which excludes this error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Floats

_GRID: Final = 1e-12  # grid width relative to the smaller region: far below the required accuracy of contacts, 1e-9

# Largest coordinate, in sizes of the smaller region, up to which the grid keeps its width. Doubles resolve 1e-12 of it;
# beyond, the grid is widened.
_MOST: Final = 500.0


def intersections(first: Sequence[shapely.Geometry], second: Sequence[shapely.Geometry]) -> Any:
    """Intersect each region of one sequence with the region at the same place of another.

    first, second: (n,) regions in any unit and at any place. Each pair has a grid of its own, about the middle of the
    intersection of both bounding boxes. Result: (n,) regions, lines and points that a pair has in common; empty
    geometries where it has none.
    """
    one, two = np.asarray(first, dtype=object), np.asarray(second, dtype=object)
    boxes = np.nan_to_num(np.stack([shapely.bounds(one), shapely.bounds(two)])).reshape(2, -1, 2, 2)
    middle = 0.5 * (boxes[:, :, 0].max(axis=0) + boxes[:, :, 1].min(axis=0))
    size = (boxes[:, :, 1] - boxes[:, :, 0]).max(axis=2).min(axis=0)
    reach = abs(boxes - middle[None, :, None]).max(axis=(0, 2, 3))
    unit = np.maximum(size, reach / _MOST)
    unit[unit == 0.0] = 1.0
    scaled = [_moved(regions, -middle / unit[:, None], 1.0 / unit) for regions in (one, two)]
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
