"""Test whether points lie in elements and on faces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.assembly import Interfaces
from jld_core.geometry.overlay import area_of

_Loops = tuple[tuple[int, ...], ...]


def contains(shape: Floats, faces: _Loops, point: Floats, reach: float) -> bool:
    """Return True if a point (d,) lies in a polygon or polyhedron, or near its boundary.

    shape, faces: as in `distance_to`. reach: distance up to which a point counts as near.
    """
    return distance_to(shape, faces, point) <= reach


def distance_to(shape: Floats, faces: _Loops, point: Floats) -> float:
    """Return the distance of a point (d,) from a polygon or polyhedron, 0 inside.

    shape: (k, 2) outline, or (k, 3) vertices. faces: loops of vertices, empty in the plane.
    """
    if shape.shape[1] == 2:
        ends = np.roll(shape, -1, axis=0)
        one, two = shape - point, ends - point
        turn = np.arctan2(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0], np.einsum("ij,ij->i", one, two))
        return 0.0 if abs(turn.sum()) > np.pi else float(_off_segments(point, shape, ends).min())
    corners = np.array([[loop[0], *pair] for loop in faces for pair in pairwise(loop[1:])])
    triangles = shape[corners] - point
    # Solid angle of each triangle seen from the point; see van Oosterom and Strackee 1983, eq. (8).
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    angle = 2.0 * np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), below)
    return 0.0 if abs(angle.sum()) > 2.0 * np.pi else min(_off_triangle(triangle) for triangle in triangles)


def point_in_face(faces: Interfaces, face: int) -> Floats:
    """Return a point (d,) inside a face; its centroid may lie outside, for example around a corner."""
    if faces.origin.shape[1] == 2:
        return np.asarray(faces.origin[face])
    flat = shapely.get_coordinates(shapely.point_on_surface(_region(faces, face)))[0]
    return np.asarray(faces.origin[face] + flat @ np.array([faces.e1[face], faces.e2[face]]))


def distance_from_face(faces: Interfaces, face: int, point: Floats) -> float:
    """Return the distance of a point (d,) from a face, 0 inside it."""
    if len(point) == 2:
        return float(shapely.LineString(faces.polygon[face]).distance(shapely.Point(point)))
    arm = point - faces.origin[face]
    flat = shapely.Point(float(arm @ faces.e1[face]), float(arm @ faces.e2[face]))
    return float(np.hypot(_region(faces, face).distance(flat), arm @ faces.normal[face]))


def _region(faces: Interfaces, face: int) -> shapely.MultiPolygon:
    """Return the polygons of a spatial face in its plane, about its centroid."""
    arm = np.asarray(faces.polygon[face], dtype=float) - faces.origin[face]
    return area_of(shapely.Polygon(arm @ np.array([faces.e1[face], faces.e2[face]]).T))


def _off_segments(point: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distances (k,) of a point from segments, given by their ends (k, d)."""
    along = end - start
    length = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
    share = np.clip(np.einsum("ij,ij->i", point - start, along) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[:, None] * along - point, axis=1))


def _off_triangle(triangle: Floats) -> float:
    """Return the distance of the origin from a triangle (3, 3)."""
    edge = float(_off_segments(np.zeros(3), triangle, np.roll(triangle, -1, axis=0)).min())
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    size = float(np.linalg.norm(normal))
    if size == 0.0:
        return edge
    foot = (triangle[0] @ normal) / size**2 * normal
    sides = [np.cross(triangle[k - 2] - triangle[k], foot - triangle[k]) @ normal for k in range(3)]
    return min(edge, abs(float(triangle[0] @ normal)) / size) if min(sides) >= 0.0 else edge
