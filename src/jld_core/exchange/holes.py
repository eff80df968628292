"""Plane faces with holes, cut into triangles: faces of solids are single loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.geometry import Faces, area_vector
from jld_core.geometry.unions import triangulate_region
from jld_core.geometry.vectors import across


def without_holes(points: Floats, loops: Sequence[Sequence[int]], title: str) -> Faces:
    """Return a plane face as loops of corners without holes, in the sense of its outline.

    points: (k, 3). loops: indices of corners, of the outline and of each hole in any order and sense; the largest is
    the outline. title: words for the solid in messages. The face itself where it has no hole, else triangles between
    its own corners. Raises InputError where a hole reaches beyond the outline, or they lie in no common plane.
    """
    if len(loops) == 1:
        return (tuple(loops[0]),)
    areas = [area_vector(points[list(loop)]) for loop in loops]
    order = sorted(range(len(loops)), key=lambda k: -float(np.linalg.norm(areas[k])))
    outline, *holes = [loops[k] for k in order]
    length = float(np.linalg.norm(areas[order[0]]))
    corners = points[[index for loop in loops for index in loop]]
    size = float(np.ptp(corners, axis=0).max())
    normal = areas[order[0]] / length if length > 0.0 else np.zeros(3)
    if length == 0.0 or np.ptp(corners @ normal) > tolerances.FACE * size:
        raise InputError(title, "a face with a hole is no plane", "plane faces")
    flat = points @ across(normal).T
    region = shapely.Polygon(flat[list(outline)], [flat[list(hole)] for hole in holes])
    triangles = triangulate_region(flat, [outline, *holes]) if region.is_valid else []
    covered = sum(float(np.linalg.norm(area_vector(points[list(triangle)]))) for triangle in triangles)
    if not triangles or abs(covered - region.area) > 1e-9 * length:
        raise InputError(title, "a hole of a face crosses its outline or another hole", "holes inside, apart")
    return tuple(triangles)
