"""Spatial limit analysis stated a second time, in CVXPY and in scene units, from the scene document alone.

Nothing of jld_core is used: frames, areas, torsion lengths, sides of normals and equilibrium are worked out
here in other ways (centre of pressure as a mean of corners, stress as a linear field, normals by a point in a
body).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Face:
    """A plane contact: frame, corners in the frame about the centroid, and its integrals by quadrature."""

    origin: Array
    frame: Array  # rows n, e1, e2
    corners: Array
    rectangle: bool
    area: float
    moments: Array
    torsion: float


def make_face(polygon: Array, normal: Array) -> Face:
    """normal: out of element a."""
    e1 = polygon[1] - polygon[0]
    e1 = e1 - (e1 @ normal) * normal
    e1 /= np.linalg.norm(e1)
    frame = np.array([normal, e1, np.cross(normal, e1)])
    local = (polygon - polygon[0]) @ frame[1:].T
    shape = shapely.Polygon(local)
    centre = np.array(shape.centroid.coords[0])
    height = float(((polygon - polygon[0]) @ normal).mean())
    # points in line belong to the file, not to the shape
    corners = shapely.get_coordinates(shapely.Polygon(local - centre).simplify(1e-6 * np.ptp(local)))[:-1]
    if not shapely.LinearRing(corners).is_ccw:
        corners = corners[::-1]
    keep = [k for k in range(len(corners)) if _bend(corners, k) > 1e-6]
    corners = corners[keep]
    sides = np.roll(corners, -1, axis=0) - corners
    cosines = [
        abs(sides[k - 1] @ sides[k]) / np.prod(np.linalg.norm(sides[[k - 1, k]], axis=1)) for k in range(len(sides))
    ]
    moments, torsion = _integrals(corners)
    return Face(
        origin=polygon[0] + centre @ frame[1:] + height * normal,
        frame=frame,
        corners=corners,
        rectangle=len(corners) == 4 and max(cosines) < 1e-4,
        area=shape.area,
        moments=moments,
        torsion=torsion / shape.area,
    )


def _bend(corners: Array, k: int) -> float:
    one, two = corners[k] - corners[k - 1], corners[(k + 1) % len(corners)] - corners[k]
    return float(abs(one[0] * two[1] - one[1] * two[0]) / (np.linalg.norm(one) * np.linalg.norm(two)))


def _integrals(corners: Array) -> tuple[Array, float]:
    """∫ x xᵀ and ∫ r over a polygon about the origin: signed triangles from there, Gauss points on edges."""
    node, weight = np.polynomial.legendre.leggauss(60)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    moments, total = np.zeros((2, 2)), 0.0
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        twice = p[0] * q[1] - p[1] * q[0]
        edge = p + node[:, None] * (q - p)
        moments += twice * 0.25 * np.einsum("k,ki,kj->ij", weight, edge, edge)
        total += twice / 3.0 * float(weight @ np.linalg.norm(edge, axis=1))
    return moments, total


def face_constraints(
    face: Face, f: Any, dry: bool, material: dict[str, float], kern: bool = False, unit: float = 1.0
) -> list[Any]:
    """Constraints on f = (N, V1, V2, M1, M2, MT), forces over `unit`, moments in force × length.

    material: friction, cohesion (a stress); tension, shear (stresses); crush (a stress, if any).
    """
    n, v, m1, m2, twist = f[0], f[1:3], f[3], f[4], f[5]
    constraints = []
    crush = material.get("crush")
    size = np.ptp(face.corners, axis=0)
    if dry:
        weight = cp.Variable(len(face.corners), nonneg=True)
        constraints += [
            cp.sum(weight) == n,
            face.corners[:, 0] @ weight == -m2,
            face.corners[:, 1] @ weight == m1,
        ]
        capacity = material.get("cohesion", 0.0) * face.area / unit + material["friction"] * n
        if crush is not None:
            # effective rectangle (l1 − 2|x1|)(l2 − 2|x2|) σc ≥ N, multiplied out
            one = size[0] * n - 2.0 * cp.abs(m2)
            two = size[1] * n - 2.0 * cp.abs(m1)
            stress = cp.Constant(crush / unit)
            constraints.append(cp.geo_mean(cp.hstack([one, two, stress])) >= n)
    else:
        strength = material["tension"] * face.area / unit
        capacity = material["shear"] * face.area / unit + material.get("friction", 0.0) * n
        limit = None if crush is None else crush * face.area / unit
        if face.rectangle and not kern:
            for moment, length in ((m1, size[1]), (m2, size[0])):
                constraints.append(cp.abs(moment) <= (n + strength) * length / 6.0)
                if limit is not None:
                    constraints.append(cp.abs(moment) <= (limit - n) * length / 6.0)
        else:
            slope = cp.Variable(2)  # of the stress, times the area
            constraints.append(face.moments / face.area @ slope == cp.hstack([-m2, m1]))
            stress = n + face.corners @ slope
            constraints.append(stress >= -strength)
            if limit is not None:
                constraints.append(stress <= limit)
    constraints.append(cp.norm(v) + cp.abs(twist) / face.torsion <= capacity)
    return constraints


def inside(point: Array, vertices: Array, faces: list[list[int]]) -> bool:
    """Is a point inside a closed surface? By the solid angle of its triangles."""
    total = 0.0
    for face in faces:
        loop = vertices[face]
        for k in range(1, len(loop) - 1):
            a, b, c = loop[[0, k, k + 1]] - point
            la, lb, lc = np.linalg.norm([a, b, c], axis=1)
            volume = a @ np.cross(b, c)
            total += 2.0 * np.arctan2(volume, la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb)
    return abs(total) > 2.0 * np.pi


def load_factor(document: dict[str, Any], concave: bool = False, kern: bool = False) -> float:
    """Greatest λ of a spatial scene with given interfaces and body loads, faces labelled one by one."""
    elements = {e["id"]: e for e in document["elements"]}
    gravity = document["materials"].get("gravity", 9.81)
    weight = {k: e.get("density", 1.0) * e["volume"] * gravity for k, e in elements.items() if not e["support"]}
    unit = sum(weight.values()) / len(weight)
    body = np.sum([np.array(load["body"], dtype=float) for load in document["loads"]["live"]], axis=0)
    force = {k: [] for k in weight}
    moment = {k: [] for k in weight}
    constraints = []
    for entry in document["interfaces"]:
        polygon = np.array(entry["polygon"])
        normal = np.cross(polygon[1] - polygon[0], polygon[-1] - polygon[0])
        normal /= np.linalg.norm(normal)
        a, b = entry["elements"]
        size = float(np.ptp(polygon, axis=0).max())
        probe = polygon.mean(axis=0) + 1e-3 * size * normal
        if inside(probe, np.array(elements[a]["vertices"]), elements[a]["faces"]):
            normal = -normal
        face = make_face(polygon, normal)
        dry = entry.get("label", "dry") == "dry"
        named = document["materials"]["dry" if dry else "inner"]
        material = {
            "friction": named.get("friction_coefficient", 0.0),
            "tension": named.get("tensile_strength", 0.0),
            "shear": named.get("shear_strength", 0.0),
            "cohesion": named.get("cohesion", 0.0),
        }
        if named.get("compressive_strength") is not None:
            material["crush"] = named["compressive_strength"]
        if dry and concave:
            corners = face.origin + face.corners @ face.frame[1:]
            parts = cp.Variable((len(corners), 3))
            constraints.append(parts[:, 0] >= 0)  # which the cone says only where there is friction
            constraints.append(material["friction"] * parts[:, 0] >= cp.norm(parts[:, 1:], axis=1))
            acting = [(corners[k], parts[k] @ face.frame, np.zeros(3)) for k in range(len(corners))]
        else:
            f = cp.Variable(6)
            constraints += face_constraints(face, f, dry, material, kern, unit)
            couple = f[3] * face.frame[1] + f[4] * face.frame[2] + f[5] * face.frame[0]
            acting = [(face.origin, f[:3] @ face.frame, couple)]
        for name, sign in ((a, -1.0), (b, 1.0)):
            if name not in weight:
                continue
            centre = np.array(elements[name]["centroid"])
            for place, push, couple in acting:
                x, y, z = place - centre
                cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                force[name].append(sign * push)
                moment[name].append(sign * (cross @ push + couple))
    load = cp.Variable()
    for name, amount in weight.items():
        own = amount / unit
        constraints.append(sum(force[name]) + own * (np.array([0.0, 0.0, -1.0]) + load * body) == 0)
        constraints.append(sum(moment[name]) == 0)
    problem = cp.Problem(cp.Maximize(load), constraints)
    problem.solve(solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    assert problem.status == "optimal", problem.status
    return float(load.value)
