"""Compute geometry of points, polygons and solids in space for the time stepping."""

from __future__ import annotations

import math

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.geometry import area_vector
from jld_experiment.energy import compiled


def triangles_of(vertices: Floats, faces: tuple[tuple[int, ...], ...]) -> tuple[Floats, Ints]:
    """Cut the faces of a solid into triangles by ear clipping, also faces that are not convex.

    vertices: (v, 3) corners. Result: the triangles (t, 3, 3) with the orientation of their faces, and the face (t,) of
    each.
    """
    table, which = [], []
    for number, face in enumerate(faces):
        left = list(face)
        normal = area_vector(vertices[left])
        while len(left) > 3:
            ear = next((k for k in range(len(left)) if _is_ear(vertices, left, k, normal)), 0)
            table.append(vertices[[left[ear - 1], left[ear], left[(ear + 1) % len(left)]]])
            which.append(number)
            del left[ear]
        table.append(vertices[left])
        which.append(number)
    return np.array(table), np.array(which)


def _is_ear(vertices: Floats, ring: list[int], k: int, normal: Floats) -> bool:
    """Return True if corner k of a ring is convex and its triangle contains no other corner."""
    a, b, c = vertices[ring[k - 1]], vertices[ring[k]], vertices[ring[(k + 1) % len(ring)]]
    if np.cross(b - a, c - b) @ normal <= 0.0:
        return False
    others = [vertices[v] for v in ring if v not in (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])]
    return not any(
        min(np.cross(y - x, point - x) @ normal for x, y in ((a, b), (b, c), (c, a))) >= 0.0 for point in others
    )


@compiled
def turned(matrix: Floats, arm: Floats, out: Floats) -> None:
    """Set `out` (3,) to matrix (3, 3) · arm (3,)."""
    for i in range(3):
        out[i] = matrix[i, 0] * arm[0] + matrix[i, 1] * arm[1] + matrix[i, 2] * arm[2]


@compiled
def turned_back(matrix: Floats, arm: Floats, out: Floats) -> None:
    """Set `out` (3,) to matrixᵀ (3, 3) · arm (3,)."""
    for i in range(3):
        out[i] = matrix[0, i] * arm[0] + matrix[1, i] * arm[1] + matrix[2, i] * arm[2]


@compiled
def dot(one: Floats, two: Floats) -> float:
    """Return the scalar product of two vectors (3,)."""
    return float(one[0] * two[0] + one[1] * two[1] + one[2] * two[2])


@compiled
def pressed(force: Floats, element: int, arm: Floats, part: Floats, sign: float) -> None:
    """Add `sign` × a force at an arm from an element's centroid, with its moment, to `force`.

    force: (n, 6) forces and moments of all elements. arm, part: (3,) arm and force.
    """
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[element, i] += sign * part[i]
        force[element, 3 + i] += sign * (arm[j] * part[k] - arm[k] * part[j])


@compiled
def is_among(table: Ints, row: int, value: int) -> bool:
    """Return True if a value occurs in a row of a table."""
    found = False
    for k in range(table.shape[1]):
        found = found or table[row, k] == value
    return found


@compiled
def beyond(x: float, y: float, low: int, high: int, rim: Floats) -> float:
    """Return the distance of a point (x, y) from a polygon, 0 inside.

    low, high: the corners of the polygon are the rows low … high − 1 of `rim` (r, 2).
    """
    within, least = False, np.inf
    for k in range(low, high):
        after = k + 1 if k + 1 < high else low
        x0, y0, x1, y1 = rim[k, 0], rim[k, 1], rim[after, 0], rim[after, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (x1 - x0) * (y - y0) / (y1 - y0):
            within = not within
        ex, ey = x1 - x0, y1 - y0
        along = min(max(((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        least = min(least, (x - x0 - along * ex) ** 2 + (y - y0 - along * ey) ** 2)
    return 0.0 if within else math.sqrt(least)


@compiled
def nearest_on_triangle(point: Floats, triangle: Floats, out: Floats) -> None:
    """Set `out` (3,) to the point of a triangle (3, 3) nearest to a point (3,)."""
    # Source: Ericson, Real-Time Collision Detection, 2005, 5.1.5.
    a, b, c = triangle[0], triangle[1], triangle[2]
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for i in range(3):
        u, v = b[i] - a[i], c[i] - a[i]
        d1 += u * (point[i] - a[i])
        d2 += v * (point[i] - a[i])
        d3 += u * (point[i] - b[i])
        d4 += v * (point[i] - b[i])
        d5 += u * (point[i] - c[i])
        d6 += v * (point[i] - c[i])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    for i in range(3):
        out[i] = a[i] + v * (b[i] - a[i]) + w * (c[i] - a[i])


@compiled
def angle_seen(point: Floats, triangle: Floats) -> float:
    """Return half the signed solid angle, rad, of a triangle (3, 3) seen from a point (3,)."""
    # The values of all outward triangles sum to 2π inside a solid and to 0 outside. Source: van Oosterom & Strackee
    # 1983.
    x, y, z = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        x[i], y[i], z[i] = triangle[0, i] - point[i], triangle[1, i] - point[i], triangle[2, i] - point[i]
    lx, ly, lz = np.sqrt(dot(x, x)), np.sqrt(dot(y, y)), np.sqrt(dot(z, z))
    volume = (
        x[0] * (y[1] * z[2] - y[2] * z[1]) + x[1] * (y[2] * z[0] - y[0] * z[2]) + x[2] * (y[0] * z[1] - y[1] * z[0])
    )
    return math.atan2(volume, lx * ly * lz + dot(x, y) * lz + dot(y, z) * lx + dot(z, x) * ly)
