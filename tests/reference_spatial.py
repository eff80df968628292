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
from scipy.linalg import block_diag

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
    faces: list[Face], f: Any, dry: bool, materials: list[dict[str, float]], kern: bool = False, unit: float = 1.0
) -> list[Any]:
    """Constraints on rows f[k] = (N, V1, V2, M1, M2, MT) of faces alike in label, forces over `unit`.

    Moments are in force × length. materials, one for each face: friction, cohesion (a stress); tension, shear
    (stresses); crush (a stress, if any). All faces are stated together: CVXPY takes far longer over many small
    conditions than the solver does.
    """
    n, v, m1, m2, twist = f[:, 0], f[:, 1:3], f[:, 3], f[:, 4], f[:, 5]
    area = np.array([face.area for face in faces]) / unit
    size = np.array([np.ptp(face.corners, axis=0) for face in faces])
    crush = np.array([material.get("crush", np.inf) for material in materials]) * area
    crushed = np.flatnonzero(np.isfinite(crush))

    def each(key: str) -> Array:
        return np.array([material.get(key, 0.0) for material in materials])

    constraints = []
    if dry:
        rows = [(np.ones(len(face.corners)), *face.corners.T) for face in faces]
        total, x, y = (block_diag(*parts) for parts in zip(*rows, strict=True))
        weight = cp.Variable(total.shape[1], nonneg=True)
        constraints += [total @ weight == n, x @ weight == -m2, y @ weight == m1]
        capacity = each("cohesion") * area + cp.multiply(each("friction"), n)
        for k in crushed:
            # effective rectangle (l1 − 2|x1|)(l2 − 2|x2|) σc ≥ N, multiplied out
            one = size[k, 0] * n[k] - 2.0 * cp.abs(m2[k])
            two = size[k, 1] * n[k] - 2.0 * cp.abs(m1[k])
            stress = cp.Constant(crush[k] / faces[k].area)
            constraints.append(cp.geo_mean(cp.hstack([one, two, stress])) >= n[k])
    else:
        strength = each("tension") * area
        capacity = each("shear") * area + cp.multiply(each("friction"), n)
        blocks = [k for k, face in enumerate(faces) if face.rectangle and not kern]
        others = [k for k in range(len(faces)) if k not in blocks]
        for moment, length in ((m1, size[:, 1] / 6.0), (m2, size[:, 0] / 6.0)) if blocks else ():
            constraints.append(cp.abs(moment[blocks]) <= cp.multiply(n[blocks] + strength[blocks], length[blocks]))
            if len(some := np.intersect1d(blocks, crushed)):
                constraints.append(cp.abs(moment[some]) <= cp.multiply(crush[some] - n[some], length[some]))
        if others:
            slope = cp.Variable((len(others), 2))  # of the stress, times the area
            along, across = slope[:, 0], slope[:, 1]
            second = np.array([faces[k].moments / faces[k].area for k in others])
            for row, moment in enumerate((-m2[others], m1[others])):
                bent = cp.multiply(second[:, row, 0], along) + cp.multiply(second[:, row, 1], across)
                constraints.append(bent == moment)
            owner = np.repeat(np.arange(len(others)), [len(faces[k].corners) for k in others])
            x, y = np.concatenate([faces[k].corners for k in others]).T
            at = np.array(others)[owner]
            stress = n[at] + cp.multiply(x, along[owner]) + cp.multiply(y, across[owner])
            constraints.append(stress >= -strength[at])
            if len(some := np.flatnonzero(np.isfinite(crush[at]))):
                constraints.append(stress[some] <= crush[at][some])
    torsion = np.array([face.torsion for face in faces])
    constraints.append(cp.norm(v, axis=1) + cp.multiply(1.0 / torsion, cp.abs(twist)) <= capacity)
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
    place = {name: 6 * position for position, name in enumerate(weight)}
    kinds: dict[bool, list[tuple[Face, dict[str, float]]]] = {True: [], False: []}
    acts: dict[str, list[Array]] = {"dry": [], "inner": [], "corner": []}  # columns: what one unknown does to elements
    rough: list[float] = []  # friction at each corner
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
        none = np.zeros((3, 3))
        if dry and concave:
            corners = face.origin + face.corners @ face.frame[1:]
            rough += [material["friction"]] * len(corners)
            unknowns = [(corner, face.frame.T, none) for corner in corners]
        else:
            kinds[dry].append((face, material))
            # f = (N, V1, V2, M1, M2, MT): force and couple of each
            couple = face.frame[[1, 2, 0]].T
            unknowns = [(face.origin, np.hstack([face.frame.T, none]), np.hstack([none, couple]))]
        for at, push, couple in unknowns:
            columns = np.zeros((6 * len(weight), push.shape[1]))
            for name, sign in ((a, -1.0), (b, 1.0)):
                if name not in weight:
                    continue
                x, y, z = at - np.array(elements[name]["centroid"])
                cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                columns[place[name] : place[name] + 3] = sign * push
                columns[place[name] + 3 : place[name] + 6] = sign * (cross @ push + couple)
            acts["corner" if dry and concave else "dry" if dry else "inner"].append(columns)
    load = cp.Variable()
    own = np.array(list(weight.values()))[:, None] / unit
    down, pushed = np.zeros((2, len(weight), 6))
    down[:, 2], pushed[:, :3] = -own[:, 0], own * body
    balance = down.ravel() + load * pushed.ravel()
    constraints = []
    for dry, named in ((True, "dry"), (False, "inner")):
        if kinds[dry]:
            f = cp.Variable((len(kinds[dry]), 6))
            faces, materials = zip(*kinds[dry], strict=True)
            constraints += face_constraints(list(faces), f, dry, list(materials), kern, unit)
            balance = balance + np.hstack(acts[named]) @ cp.reshape(f, (f.size,), order="C")
    if rough:
        parts = cp.Variable((len(rough), 3))
        constraints.append(parts[:, 0] >= 0)  # which the cone says only where there is friction
        constraints.append(cp.multiply(np.array(rough), parts[:, 0]) >= cp.norm(parts[:, 1:], axis=1))
        balance = balance + np.hstack(acts["corner"]) @ cp.reshape(parts, (parts.size,), order="C")
    constraints.append(balance == 0)
    problem = cp.Problem(cp.Maximize(load), constraints)
    problem.solve(solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    assert problem.status == "optimal", problem.status
    return float(load.value)
