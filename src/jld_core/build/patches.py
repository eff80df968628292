"""Conversion of loads on the free surface of solids to tractions, docs/method.md (1.13)."""

from __future__ import annotations

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.errors import InputError
from jld_core.geometry import across, area_vector
from jld_core.loads import Traction
from jld_core.scene.loads import FaceLoad


def patch_tractions(elements: Elements, interfaces: Interfaces, entry: FaceLoad, where: str) -> list[Traction]:
    """Return a uniform load on a plane patch as tractions on the element faces below it, without those of supports."""
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
    found, covered = list[Traction](), 0.0
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    for index in np.flatnonzero(((elements.lower <= high) & (low <= elements.upper)).all(axis=1)).tolist():
        for loop in elements.faces[index]:
            face = elements.shape[index][list(loop)]
            outward = _unit(face)
            if abs(float(outward @ normal)) < 1.0 - tolerances.ON_OUTLINE:
                continue
            if np.abs((face - origin) @ normal).max() > reach:
                continue
            part = patch.intersection(_flat(face, frame, origin))
            part = _free(part, interfaces, index, normal, frame, origin, reach)
            covered += part.area
            if not elements.support[index]:
                found += _tractions(index, part, _force_per_area(entry, outward), frame, origin, reach)
    if abs(covered - patch.area) > 4.0 * reach * patch.length:
        problem = f"of its area of {patch.area:.6g}, {covered:.6g} is free surface"
        raise InputError(key, problem, "a polygon on faces of solids that touch no others there")
    return found


def _corners(elements: Elements, entry: FaceLoad, key: str) -> Floats:
    """Return the corners (k, 3) of a patch; raise InputError for a planar scene or uneven pressure."""
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
    """Return the force per area (3,) on a face with outward normal (3,)."""
    return -entry.ends[0] * outward if entry.traction is None else np.array(entry.traction, dtype=float)


def surface_tractions(elements: Elements, interfaces: Interfaces, index: int, pressure: float) -> list[Traction]:
    """Return a uniform pressure on the whole free surface of a solid, one traction per free part of a face."""
    reach, found = tolerances.ON_OUTLINE * elements.size, list[Traction]()
    for loop in elements.faces[index]:
        face = elements.shape[index][list(loop)]
        outward, origin = _unit(face), face.mean(axis=0)
        frame = across(outward)
        part = _free(_flat(face, frame, origin), interfaces, index, outward, frame, origin, reach)
        found += _tractions(index, part, -pressure * outward, frame, origin, reach)
    return found


def _unit(face: Floats) -> Floats:
    """Return the outward unit normal (3,) of a face (k, 3)."""
    vector = area_vector(face)
    return np.asarray(vector / np.linalg.norm(vector))


def _flat(face: Floats, frame: Floats, origin: Floats) -> shapely.Polygon:
    """Return a face (k, 3) in the coordinates of `frame` (2, 3) about `origin` (3,)."""
    return shapely.Polygon((face - origin) @ np.transpose(frame))


def _free(
    part: shapely.Geometry,
    interfaces: Interfaces,
    index: int,
    normal: Floats,
    frame: Floats,
    origin: Floats,
    reach: float,
) -> shapely.Geometry:
    """Return what the interfaces of an element leave of a part of its face, in the coordinates of `frame`."""
    for face in np.flatnonzero((interfaces.a == index) | (interfaces.b == index)).tolist():
        outline = interfaces.polygon[face]
        if part.area > 0.0 and np.abs((outline - origin) @ normal).max() <= reach:
            part = part.difference(_flat(outline, frame, origin))
    return part


def _tractions(
    index: int, part: shapely.Geometry, value: Floats, frame: Floats, origin: Floats, reach: float
) -> list[Traction]:
    """Return a uniform force per area (3,) on the polygons of a part of a face, in the coordinates of `frame`."""
    found = []
    for one in shapely.get_parts(part):
        if one.geom_type == "Polygon" and one.area > reach**2:
            rings = tuple(origin + np.asarray(r.coords)[:-1] @ frame for r in (one.exterior, *one.interiors))
            middle = origin + np.array([one.centroid.x, one.centroid.y]) @ frame
            found.append(Traction(index, rings, middle, value, np.zeros((3, 3))))
    return found
