"""Conversion of loads on patches of the free surface of solids to forces on elements.

Source: docs/method.md (1.13).
"""

from __future__ import annotations

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.errors import InputError
from jld_core.geometry import area_vector
from jld_core.geometry.vectors import across
from jld_core.scene import PointLoad
from jld_core.scene.loads import FaceLoad


def patch_loads(elements: Elements, interfaces: Interfaces, entry: FaceLoad, where: str) -> list[PointLoad]:
    """Return the forces of a uniform load on a patch, one for each element face below it.

    Parameters
    ----------
    elements : Elements
        Elements of a spatial structure.
    interfaces : Interfaces
        Its interfaces, on which no load may act.
    entry : FaceLoad
        Load with a patch.
    where : str
        Key of the entry in the scene, for error messages.

    Returns
    -------
    list of PointLoad
        Forces at the centroids of the parts of the patch. Parts on supports are left out.

    Raises
    ------
    InputError
        If the scene is planar, the patch is no plane polygon, or part of it is no free surface.
    """
    key = f"{where}.face.patch"
    corners = _corners(elements, entry, key)
    normal = area_vector(corners)
    area = float(np.linalg.norm(normal))
    reach, origin = tolerances.ON_OUTLINE * elements.size, corners.mean(axis=0)
    if not (area > reach * elements.size and np.abs((corners - origin) @ normal).max() <= reach * area):
        raise InputError(key, "its corners lie on no plane", "the corners of a plane polygon, in order")
    normal = normal / area
    frame = across(normal)
    patch = shapely.Polygon((corners - origin) @ np.transpose(frame))
    if not patch.is_valid:
        raise InputError(key, "its outline crosses itself", "the corners of a plane polygon, in order")
    found, covered = [], 0.0
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    for index in np.flatnonzero(((elements.lower <= high) & (low <= elements.upper)).all(axis=1)).tolist():
        for outward, part in _parts(elements, interfaces, index, patch, normal, frame, origin):
            covered += part.area
            if elements.support[index]:
                continue
            at = origin + np.array([part.centroid.x, part.centroid.y]) @ frame
            unit = _force_per_area(entry, outward)
            found.append(PointLoad(element=elements.ids[index], force=(part.area * unit).tolist(), at=at.tolist()))
    if abs(covered - patch.area) > 4.0 * reach * patch.length:
        problem = f"of its area of {patch.area:.6g}, {covered:.6g} is free surface"
        raise InputError(key, problem, "a polygon on faces of solids that touch no others there")
    return found


def _corners(elements: Elements, entry: FaceLoad, key: str) -> Floats:
    """Return the corners (k, 3) of a patch.

    Raises InputError for a planar scene or uneven pressure.
    """
    points = [*(entry.face.patch or []), *([entry.traction] if entry.traction is not None else [])]
    if elements.centroid.shape[1] == 2 or any(len(point) != 3 for point in points):
        raise InputError(
            key, "it is for spatial scenes, with points and vectors of three numbers", '"along" in the plane'
        )
    first, last = entry.ends
    if first != last:
        raise InputError(key, "the pressure varies, and a patch has no first and last point", "one number")
    return np.array(entry.face.patch, dtype=float)


def _force_per_area(entry: FaceLoad, outward: Floats) -> Floats:
    """Return the force per area (3,) on a face; outward: (3,) its normal."""
    return -entry.ends[0] * outward if entry.traction is None else np.array(entry.traction, dtype=float)


def _parts(
    elements: Elements,
    interfaces: Interfaces,
    index: int,
    patch: shapely.Polygon,
    normal: Floats,
    frame: Floats,
    origin: Floats,
) -> list[tuple[Floats, shapely.Geometry]]:
    """Return the free parts of a patch on one element, each with the outward normal (3,).

    patch: in the coordinates of `frame` (2, 3) about `origin` (3,). normal: (3,) of the patch.
    """
    reach = tolerances.ON_OUTLINE * elements.size
    found = []
    for loop in elements.faces[index]:
        corners = elements.shape[index][list(loop)]
        outward = area_vector(corners)
        outward = outward / np.linalg.norm(outward)
        if (
            abs(float(outward @ normal)) < 1.0 - tolerances.ON_OUTLINE
            or np.abs((corners - origin) @ normal).max() > reach
        ):
            continue
        part = patch.intersection(shapely.Polygon((corners - origin) @ np.transpose(frame)))
        for face in np.flatnonzero((interfaces.a == index) | (interfaces.b == index)).tolist():
            outline = interfaces.polygon[face]
            if part.area > 0.0 and np.abs((outline - origin) @ normal).max() <= reach:
                part = part.difference(shapely.Polygon((outline - origin) @ np.transpose(frame)))
        if part.area > reach**2:
            found.append((outward, part))
    return found
