"""Forces of faces that follow the geometry, and contacts of corners; edges across edges are not detected."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from jld_core import Assembly, Floats, Ints, Route
from jld_core.geometry import area_vector
from jld_experiment.subcontacts import Bench, Motion, SubContacts, compiled, numbers_of, record_loss, sub_contact


def triangles_of(vertices: Floats, faces: tuple[tuple[int, ...], ...]) -> tuple[Floats, Ints]:
    """Cut the faces of a solid (v, 3) by ear clipping: triangles (t, 3, 3), and the face (t,) of each."""
    triangles, face_of = [], []
    for number, face in enumerate(faces):
        ring = list(face)
        normal = area_vector(vertices[ring])
        while len(ring) > 3:
            ear = next((k for k in range(len(ring)) if _is_ear(vertices, ring, k, normal)), 0)
            triangles.append(vertices[[ring[ear - 1], ring[ear], ring[(ear + 1) % len(ring)]]])
            face_of.append(number)
            del ring[ear]
        triangles.append(vertices[ring])
        face_of.append(number)
    return np.array(triangles), np.array(face_of)


def _is_ear(vertices: Floats, ring: list[int], k: int, normal: Floats) -> bool:
    """Return whether corner k of a ring is convex and its triangle contains no other corner."""
    a, b, c = vertices[ring[k - 1]], vertices[ring[k]], vertices[ring[(k + 1) % len(ring)]]
    if np.cross(b - a, c - b) @ normal <= 0.0:
        return False
    others = [vertices[v] for v in ring if v not in (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])]
    return not any(
        min(np.cross(y - x, point - x) @ normal for x, y in ((a, b), (b, c), (c, a))) >= 0.0 for point in others
    )


@compiled
def rotate(matrix: Floats, arm: Floats, out: Floats) -> None:
    for i in range(3):
        out[i] = matrix[i, 0] * arm[0] + matrix[i, 1] * arm[1] + matrix[i, 2] * arm[2]


@compiled
def rotate_back(matrix: Floats, arm: Floats, out: Floats) -> None:
    for i in range(3):
        out[i] = matrix[0, i] * arm[0] + matrix[1, i] * arm[1] + matrix[2, i] * arm[2]


@compiled
def dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def add_force(force: Floats, element: int, arm: Floats, part: Floats, sign: float) -> None:
    """Add `sign` × a force (3,) at an arm (3,) from an element's centroid, with its moment, to `force` (n, 6)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[element, i] += sign * part[i]
        force[element, 3 + i] += sign * (arm[j] * part[k] - arm[k] * part[j])


@compiled
def is_among(table: Ints, row: int, value: int) -> bool:
    among = False
    for k in range(table.shape[1]):
        among = among or table[row, k] == value
    return among


@compiled
def distance_outside(x: float, y: float, low: int, high: int, rim: Floats) -> float:
    """Return the distance of (x, y) from the polygon of rows low … high − 1 of `rim`, 0 inside."""
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


_ROUTE: Final = Route("the virtual experiment")

# Depth beyond the largest elastic overlap at which a corner begins to press, in typical element sizes: four cells that
# meet in a point and are compressed must not press by their corners.
CLEARANCE: Final = 1e-3

_NEAR: Final = 0.05  # Distance, in typical element sizes, within which a corner is checked in every step.
_AROUND: Final = 1.0  # Distance, in typical element sizes, within which a corner is considered at all.


class Plane(NamedTuple):
    """Data of moving planar faces and corners, with shapes at rest about the centroids."""

    # n elements, m faces, s sub-contacts, c corners, p pairs of a corner and an element that it may meet; the last six
    # are state and change in place

    centre: Floats  # (n, 2) centroids
    # near, far: (s, 2) arms to each sub-contact from elements a and b
    near: Floats
    far: Floats
    share: Floats  # (s,) tributary length
    half: Floats  # (m,) half length of each face
    corner: Ints  # (c,) element of each corner
    arm: Floats  # (c, 2) arm to each corner
    pair: Ints  # (p, 2) corner and element that may meet
    barred: Ints  # (p, 2) edges of that element whose contact is already a face, −1 for none
    edge_first: Ints  # (n + 1,) position of the first corner of each element, counter-clockwise
    # (6,) normal and shear stiffness of a corner contact (force per overlap or slip), friction coefficient, overlap
    # without force, distance within which corners are checked. The last entry is state: the largest elastic overlap.
    spring: Floats
    kept: Floats  # (s,) share of the area of sub-contacts that is in contact
    # gap, slid: (s,) gap and slip of sub-contacts
    gap: Floats
    slid: Floats
    stuck: Floats  # (p,) friction force along the edge
    place: Floats  # (p,) position along the edge, from its first corner
    on: Ints  # (p,) edge touched, −1 for none


def plane_of(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats) -> Plane:
    """Return the data of a planar assembly at rest; kn, ks: (m,) springs, stress per length."""
    faces, elements = assembly.interfaces, assembly.elements
    middle = faces.origin[points.face] + points.place[:, :1] * faces.e1[points.face]
    near, far = middle - elements.centroid[faces.a[points.face]], middle - elements.centroid[faces.b[points.face]]
    thickness = faces.l2[points.face]
    counts = [len(shape) for shape in elements.shape]
    corner = np.repeat(np.arange(len(elements)), counts)
    corners = np.concatenate(elements.shape)
    typical = float(np.median(np.sqrt(elements.volume[elements.free] / float(np.median(faces.l2)))))
    pair = near_corners(assembly, corner, corners, typical)
    return Plane(
        centre=elements.centroid,
        near=near,
        far=far,
        share=points.place[:, 1] / thickness,
        half=0.5 * faces.l1,
        corner=corner,
        arm=corners - elements.centroid[corner],
        pair=pair,
        barred=_edges_in_contact(assembly, corner, pair),
        edge_first=np.concatenate([[0], np.cumsum(counts)]),
        spring=corner_springs(assembly, points, kn, ks, typical),
        kept=np.ones(len(points.face)),
        gap=np.zeros(len(points.face)),
        slid=np.zeros(len(points.face)),
        stuck=np.zeros(len(pair)),
        place=np.zeros(len(pair)),
        on=np.full(len(pair), -1),
    )


def corner_springs(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats, typical: float) -> Floats:
    """Return `Plane.spring` (6,) of corner contacts, by medians over the faces; typical: size of an element."""
    # a corner has the area of the mean sub-contact of a face
    total, count = np.bincount(points.face, weights=points.place[:, -1]), np.bincount(points.face)
    area = float(np.median(total / count))
    coefficients = assembly.strengths(_ROUTE).friction
    coefficients = coefficients[np.isfinite(coefficients)]
    friction = float(np.median(coefficients)) if coefficients.size else 0.0
    stiffness = (float(np.median(kn)) * area, float(np.median(ks)) * area)
    # the last one is the largest elastic overlap so far
    return np.array([*stiffness, friction, CLEARANCE * typical, _NEAR * typical, 0.0])


def near_corners(assembly: Assembly, corner: Ints, points: Floats, typical: float) -> Ints:
    """Return the pairs (p, 2) of a corner, at points (c, d), and another element that may meet."""
    # Near corners lie within one typical size of the bounding box of the element. Pairs of two supports are left out.
    elements, around = assembly.elements, _AROUND * typical
    pairs = []
    for other in range(len(elements)):
        low, high = elements.lower[other] - around, elements.upper[other] + around
        close = np.flatnonzero(np.all((points > low) & (points < high), axis=1) & (corner != other))
        supports = elements.support[corner[close]] & elements.support[other]
        pairs += [(c, other) for c in close[~supports].tolist()]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def contacts_of(assembly: Assembly) -> dict[tuple[int, int], list[int]]:
    """Return the faces between every two elements in contact, by the pair in either order."""
    faces, contacts = assembly.interfaces, dict[tuple[int, int], list[int]]()
    for face in range(len(faces)):
        a, b = int(faces.a[face]), int(faces.b[face])
        contacts.setdefault((a, b), []).append(face)
        contacts.setdefault((b, a), []).append(face)
    return contacts


def _edges_in_contact(assembly: Assembly, corner: Ints, pair: Ints) -> Ints:
    """Return (p, 2) edges along which a pair's element already touches that of the corner, else −1."""
    contacts, faces, elements = contacts_of(assembly), assembly.interfaces, assembly.elements
    barred = []
    for c, other in pair.tolist():
        shared = contacts.get((int(corner[c]), other), [])
        edges = [_edge_along(elements.shape[other], faces.polygon[face]) for face in shared]
        barred.append(([*edges, -1, -1])[:2])
    return np.array(barred, dtype=np.int64).reshape(-1, 2)


def _edge_along(shape: Floats, contact: Floats) -> int:
    """Return the edge of a polygon (k, 2) on which a contact (2, 2), given by its ends, lies."""
    after = np.roll(shape, -1, axis=0)
    along = after - shape
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    off = np.zeros(len(shape))
    for point in contact:
        arm = point - shape
        off += abs(arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0])
    return int(np.argmin(off))


@compiled
def moving_forces(bench: Bench, motion: Motion, force: Floats, plane: Plane) -> None:
    """Update all sub-contacts at the present positions, and add their forces to `force` (n, 3)."""
    # Normals follow the mean rotation of both elements. Half of a sub-contact belongs to either element. A half that
    # has slid past the end of the other face by its tributary length is lost, until it slides back.
    moved, ends, frame = motion.moved, bench.ends, bench.frame
    first, place, law, brittle, gaps = bench.first, bench.place, bench.law, bench.brittle, bench.gaps
    overlap, pressure, shear, broken, dry = motion.overlap, motion.pressure, motion.shear, motion.broken, bench.dry
    deepest = 0.0
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        ca, sa = np.cos(moved[a, 2]), np.sin(moved[a, 2])
        cb, sb = np.cos(moved[b, 2]), np.sin(moved[b, 2])
        half = 0.5 * (moved[a, 2] + moved[b, 2])
        c, s = np.cos(half), np.sin(half)
        nx, ny = c * frame[f, 0] - s * frame[f, 1], s * frame[f, 0] + c * frame[f, 1]
        ax, ay = plane.centre[a, 0] + moved[a, 0], plane.centre[a, 1] + moved[a, 1]
        bx, by = plane.centre[b, 0] + moved[b, 0], plane.centre[b, 1] + moved[b, 1]
        ks, numbers = law[f, 1], numbers_of(law, f)
        for k in range(first[f], first[f + 1]):
            px = ax + ca * plane.near[k, 0] - sa * plane.near[k, 1]
            py = ay + sa * plane.near[k, 0] + ca * plane.near[k, 1]
            qx = bx + cb * plane.far[k, 0] - sb * plane.far[k, 1]
            qy = by + sb * plane.far[k, 0] + cb * plane.far[k, 1]
            gap, slid = (qx - px) * nx + (qy - py) * ny, (qy - py) * nx - (qx - px) * ny
            e = overlap[k] - (gap - plane.gap[k])
            q = shear[k, 0] - ks * (slid - plane.slid[k])
            plane.gap[k], plane.slid[k] = gap, slid
            trial, was_broken = (numbers[0] * e, abs(q)), broken[k]
            start = (pressure[k], shear[k, 0] if q > 0.0 else -shear[k, 0])
            e, p, size, broken[k] = sub_contact(e, abs(q), numbers, brittle[f], gaps[f], was_broken)
            q = size if q > 0.0 else -size
            overlap[k], pressure[k], shear[k, 0] = e, p, q
            deepest = max(deepest, e)
            along, length = place[k, 0], plane.share[k]
            kept_b = min(1.0, max(0.0, 1.0 - (abs(along + slid) - plane.half[f]) / length))
            kept_a = min(1.0, max(0.0, 1.0 - (abs(along - slid) - plane.half[f]) / length))
            plane.kept[k] = 0.5 * (kept_a + kept_b)
            area = plane.kept[k] * place[k, 1]
            fx, fy = area * (p * nx - q * ny), area * (p * ny + q * nx)
            if area == 0.0:
                continue
            if size < trial[1] or p != trial[0]:
                record_loss(motion.work, numbers, area, (dry[f], was_broken, broken[k]), start, trial, (p, size))
            at = kept_b / (kept_a + kept_b)
            x, y = px + at * (qx - px), py + at * (qy - py)
            force[b, 0] += fx
            force[b, 1] += fy
            force[b, 2] += (x - bx) * fy - (y - by) * fx
            force[a, 0] -= fx
            force[a, 1] -= fy
            force[a, 2] -= (x - ax) * fy - (y - ay) * fx
    plane.spring[5] = deepest


@compiled
def nearest_edge(pair: int, moved: Floats, plane: Plane) -> tuple[int, float, float, float, float]:
    """Return the edge of a pair's element nearest to its corner, depth inside, place along it, and direction (x, y)."""
    c, j = plane.pair[pair, 0], plane.pair[pair, 1]
    i = plane.corner[c]
    ci, si = np.cos(moved[i, 2]), np.sin(moved[i, 2])
    cj, sj = np.cos(moved[j, 2]), np.sin(moved[j, 2])
    # Transform the corner to the frame of the element at rest.
    x = plane.centre[i, 0] + moved[i, 0] + ci * plane.arm[c, 0] - si * plane.arm[c, 1]
    y = plane.centre[i, 1] + moved[i, 1] + si * plane.arm[c, 0] + ci * plane.arm[c, 1]
    x -= plane.centre[j, 0] + moved[j, 0]
    y -= plane.centre[j, 1] + moved[j, 1]
    x, y = cj * x + sj * y, cj * y - sj * x
    low, high = plane.edge_first[j], plane.edge_first[j + 1]
    best, least, position, tx, ty, within = 0, np.inf, 0.0, 0.0, 0.0, False
    for k in range(low, high):
        after = k + 1 if k + 1 < high else low
        x0, y0 = plane.arm[k, 0], plane.arm[k, 1]
        x1, y1 = plane.arm[after, 0], plane.arm[after, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (x1 - x0) * (y - y0) / (y1 - y0):
            within = not within
        ex, ey = x1 - x0, y1 - y0
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        along = min(max((x - x0) * ex + (y - y0) * ey, 0.0), length)
        away = (x - x0 - along * ex) ** 2 + (y - y0 - along * ey) ** 2
        if away < least:
            best, least, position = k - low, away, along
            tx, ty = cj * ex - sj * ey, sj * ex + cj * ey
    depth = np.sqrt(least) if within else -np.sqrt(least)
    return best, depth, position, tx, ty


@compiled
def near_pairs(moved: Floats, plane: Plane) -> Ints:
    """Return the pairs (k,) whose corner is now near the outline; time steps look at these alone."""
    near = np.empty(len(plane.pair), dtype=np.int64)
    count = 0
    for pair in range(len(plane.pair)):
        _, depth, _, _, _ = nearest_edge(pair, moved, plane)
        if abs(depth) < plane.spring[4]:
            near[count] = pair
            count += 1
    return near[:count]


@compiled
def corner_forces(pairs: Ints, moved: Floats, force: Floats, plane: Plane) -> None:
    """Add the forces of corners of pairs (k,) that have entered other elements, with friction."""
    # A corner on an edge along which its element already has a face gets no force here: the face transfers it.
    kn, ks, friction = plane.spring[0], plane.spring[1], plane.spring[2]
    clearance = plane.spring[3] + plane.spring[5]
    for pair in pairs:
        edge, depth, position, tx, ty = nearest_edge(pair, moved, plane)
        inside = depth - clearance
        if inside <= 0.0 or edge == plane.barred[pair, 0] or edge == plane.barred[pair, 1]:
            plane.on[pair] = -1
            plane.stuck[pair] = 0.0
            continue
        if plane.on[pair] != edge:
            plane.on[pair], plane.stuck[pair] = edge, 0.0
        else:
            plane.stuck[pair] -= ks * (position - plane.place[pair])
        plane.place[pair] = position
        press = kn * inside
        most = friction * press
        rub = min(most, max(-most, plane.stuck[pair]))
        plane.stuck[pair] = rub
        c, j = plane.pair[pair, 0], plane.pair[pair, 1]
        i = plane.corner[c]
        # The outward normal of a counter-clockwise element is its edge turned by −90°.
        fx, fy = press * ty + rub * tx, rub * ty - press * tx
        ci, si = np.cos(moved[i, 2]), np.sin(moved[i, 2])
        ax = ci * plane.arm[c, 0] - si * plane.arm[c, 1]
        ay = si * plane.arm[c, 0] + ci * plane.arm[c, 1]
        bx = plane.centre[i, 0] + moved[i, 0] + ax - plane.centre[j, 0] - moved[j, 0]
        by = plane.centre[i, 1] + moved[i, 1] + ay - plane.centre[j, 1] - moved[j, 1]
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += ax * fy - ay * fx
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= bx * fy - by * fx


_FLUSH: Final = 1e-6  # Distance, in typical element sizes, up to which faces count as coplanar.


class Space(NamedTuple):
    """Data of moving spatial faces and corners, with shapes at rest about the centroids."""

    # the last seven are state and change in place

    centre: Floats  # (n, 3) centroids
    # near, far: (s, 3) arms to each sub-contact from elements a and b
    near: Floats
    far: Floats
    share: Floats  # (s,) side of a square with the area of the sub-contact
    rim_first: Ints  # (m + 1,) position of the first rim point of each face
    rim: Floats  # (r, 2) rims of faces in their frames about their origins
    corner: Ints  # (c,) element of each corner
    arm: Floats  # (c, 3) arm to each corner
    pair: Ints  # (p, 2) corner and element that may meet
    barred: Ints  # (p, k) faces of that element whose contact is already a face, −1 for none
    side_first: Ints  # (n + 1,) position of the first triangle of each element
    sides: Floats  # (t, 3, 3) outward triangles of the elements
    side: Ints  # (t,) face of the element to which each triangle belongs
    flush: Ints  # (p, k) faces of the element through which the corner cannot enter, −1 for none
    spring: Floats  # (6,) springs of corners, see `corner_springs`
    turn: Floats  # (n, 3, 3) rotations since rest
    kept: Floats  # (s,) share of the area of sub-contacts that is in contact
    gap: Floats  # (s,) gap of sub-contacts
    slid: Floats  # (s, 2) slip of sub-contacts
    # stuck, place: (p, 3) force and position on the element, in its axes at rest
    stuck: Floats
    place: Floats
    on: Ints  # (p,) face touched


def space_of(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats) -> Space:
    """Return the data of a spatial assembly at rest; kn, ks: (m,) springs, stress per length."""
    faces, elements = assembly.interfaces, assembly.elements
    along = points.place[:, :1] * faces.e1[points.face] + points.place[:, 1:2] * faces.e2[points.face]
    middle = faces.origin[points.face] + along
    near, far = middle - elements.centroid[faces.a[points.face]], middle - elements.centroid[faces.b[points.face]]
    rims = []
    for face in range(len(faces)):
        arm = faces.polygon[face] - faces.origin[face]
        rims.append(np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]]))
    corner = np.repeat(np.arange(len(elements)), [len(shape) for shape in elements.shape])
    corners = np.concatenate(elements.shape)
    typical = float(np.median(np.cbrt(elements.volume[elements.free])))
    pair = near_corners(assembly, corner, corners, typical)
    solids = [triangles_of(elements.shape[k] - elements.centroid[k], elements.faces[k]) for k in range(len(elements))]
    return Space(
        centre=elements.centroid,
        near=near,
        far=far,
        share=np.sqrt(points.place[:, 2]),
        rim_first=np.concatenate([[0], np.cumsum([len(rim) for rim in rims])]),
        rim=np.concatenate(rims),
        corner=corner,
        arm=corners - elements.centroid[corner],
        pair=pair,
        barred=_faces_in_contact(assembly, corner, pair),
        side_first=np.concatenate([[0], np.cumsum([len(face_of) for _, face_of in solids])]),
        sides=np.concatenate([triangles for triangles, _ in solids]),
        side=np.concatenate([face_of for _, face_of in solids]),
        flush=_flush_faces(assembly, corner, pair, typical),
        spring=corner_springs(assembly, points, kn, ks, typical),
        turn=np.tile(np.eye(3), (len(elements), 1, 1)),
        kept=np.ones(len(points.face)),
        gap=np.zeros(len(points.face)),
        slid=np.zeros((len(points.face), 2)),
        stuck=np.zeros((len(pair), 3)),
        place=np.zeros((len(pair), 3)),
        on=np.full(len(pair), -1),
    )


def _faces_in_contact(assembly: Assembly, corner: Ints, pair: Ints) -> Ints:
    """Return (p, k) facets along which a pair's element already touches that of the corner, else −1."""
    contacts, faces, elements = contacts_of(assembly), assembly.interfaces, assembly.elements
    rows = []
    for c, other in pair.tolist():
        rings = [elements.shape[other][list(side)] for side in elements.faces[other]]
        facets = []
        for face in contacts.get((int(corner[c]), other), []):
            # the facet nearest to the plane of the interface
            away = [abs((ring - faces.origin[face]) @ faces.normal[face]).max() for ring in rings]
            facets.append(int(np.argmin(away)))
        rows.append(facets)
    return _padded(rows)


def _flush_faces(assembly: Assembly, corner: Ints, pair: Ints, typical: float) -> Ints:
    """Return (p, k) faces of a pair's element that are coplanar with a face of the corner's, else −1."""
    # Both faces have the same outward normal, as at the ends of a wall's blocks, so no corner enters through them.
    elements, planes = assembly.elements, []
    for shape, sides in zip(elements.shape, elements.faces, strict=True):
        rows = []
        for side in sides:
            ring = shape[list(side)]
            normal = area_vector(ring)
            normal /= np.linalg.norm(normal)
            rows.append(np.append(typical * normal, ring.mean(axis=0) @ normal))
        planes.append(np.array(rows))
    flush, flush_of = [], dict[tuple[int, int], list[int]]()
    for c, other in pair.tolist():
        elements_of_pair = int(corner[c]), other
        if elements_of_pair not in flush_of:
            distance = abs(planes[other][:, None] - planes[elements_of_pair[0]][None]).max(axis=2)
            flush_of[elements_of_pair] = np.flatnonzero(distance.min(axis=1) < _FLUSH * typical).tolist()
        flush.append(flush_of[elements_of_pair])
    return _padded(flush)


def _padded(rows: list[list[int]]) -> Ints:
    """Return rows of different lengths as a table, filled up with −1."""
    table = np.full((len(rows), max((len(row) for row in rows), default=0)), -1)
    for line, row in zip(table, rows, strict=True):
        line[: len(row)] = row
    return table


@compiled
def turn_along(velocity: Floats, space: Space) -> None:
    """Rotate the elements, `space.turn`, by their rotation of one time step (Rodrigues' formula)."""
    # Here and below numbers are set one by one: each assignment of an array to an array adds a second to compilation.
    spin, was = np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(velocity)):
        x, y, z = velocity[i, 3], velocity[i, 4], velocity[i, 5]
        angle = np.sqrt(x * x + y * y + z * z)
        if angle == 0.0:
            continue
        x, y, z = x / angle, y / angle, z / angle
        s, c = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
        spin[0, 0], spin[0, 1], spin[0, 2] = -c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
        spin[1, 0], spin[1, 1], spin[1, 2] = c * x * y + s * z, -c * (x * x + z * z), c * y * z - s * x
        spin[2, 0], spin[2, 1], spin[2, 2] = c * x * z - s * y, c * y * z + s * x, -c * (x * x + y * y)
        for row in range(3):
            for column in range(3):
                was[row, column] = space.turn[i, row, column]
        for row in range(3):
            for column in range(3):
                for k in range(3):
                    space.turn[i, row, column] += spin[row, k] * was[k, column]


@compiled
def mean_axes(bench: Bench, space: Space, f: int, axes: Floats) -> None:
    """Set `axes` (3, 3) to normal, e1 and e2 of face f, rotated by the mean of both elements."""
    a, b = bench.ends[f, 0], bench.ends[f, 1]
    for axis in range(2):
        for i in range(3):
            axes[axis, i] = 0.0
            for k in range(3):
                axes[axis, i] += (space.turn[a, i, k] + space.turn[b, i, k]) * bench.frame[f, 3 * axis + k]
    size = np.sqrt(dot(axes[0], axes[0]))
    for i in range(3):
        axes[0, i] /= size
    off = dot(axes[0], axes[1])
    for i in range(3):
        axes[1, i] -= off * axes[0, i]
    size = np.sqrt(dot(axes[1], axes[1]))
    for i in range(3):
        axes[1, i] /= size
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        axes[2, i] = axes[0, j] * axes[1, k] - axes[0, k] * axes[1, j]


@compiled
def moving_forces_in_space(bench: Bench, motion: Motion, force: Floats, space: Space) -> None:
    """Update all sub-contacts and add the forces of their faces to `force` (n, 6)."""
    # All else is as in `moving_forces`; the rotations are those of `space.turn`.
    axes, near, far = np.empty((3, 3)), np.empty(3), np.empty(3)
    between, part, jump = np.empty(3), np.empty(3), np.empty(3)
    moved, ends, first, place = motion.moved, bench.ends, bench.first, bench.place
    law, brittle, gaps, dry = bench.law, bench.brittle, bench.gaps, bench.dry
    overlap, pressure, shear, broken = motion.overlap, motion.pressure, motion.shear, motion.broken
    deepest = 0.0
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        mean_axes(bench, space, f, axes)
        for i in range(3):
            between[i] = space.centre[b, i] - space.centre[a, i] + moved[b, i] - moved[a, i]
        ks, numbers = law[f, 1], numbers_of(law, f)
        low, high = space.rim_first[f], space.rim_first[f + 1]
        for k in range(first[f], first[f + 1]):
            rotate(space.turn[a], space.near[k], near)
            rotate(space.turn[b], space.far[k], far)
            for i in range(3):
                jump[i] = between[i] + far[i] - near[i]
            gap, slid1, slid2 = dot(jump, axes[0]), dot(jump, axes[1]), dot(jump, axes[2])
            e = overlap[k] - (gap - space.gap[k])
            q1 = shear[k, 0] - ks * (slid1 - space.slid[k, 0])
            q2 = shear[k, 1] - ks * (slid2 - space.slid[k, 1])
            space.gap[k], space.slid[k, 0], space.slid[k, 1] = gap, slid1, slid2
            trial, was = (numbers[0] * e, np.sqrt(q1 * q1 + q2 * q2)), broken[k]
            start = (pressure[k], (shear[k, 0] * q1 + shear[k, 1] * q2) / max(trial[1], 1e-300))
            e, p, size, broken[k] = sub_contact(e, trial[1], numbers, brittle[f], gaps[f], was)
            if size < trial[1]:
                q1 *= size / trial[1]
                q2 *= size / trial[1]
            overlap[k], pressure[k] = e, p
            shear[k, 0], shear[k, 1] = q1, q2
            deepest = max(deepest, e)
            x1, x2, width = place[k, 0], place[k, 1], space.share[k]
            kept_b = max(0.0, 1.0 - distance_outside(x1 + slid1, x2 + slid2, low, high, space.rim) / width)
            kept_a = max(0.0, 1.0 - distance_outside(x1 - slid1, x2 - slid2, low, high, space.rim) / width)
            space.kept[k] = 0.5 * (kept_a + kept_b)
            area = space.kept[k] * place[k, 2]
            if area == 0.0:
                continue
            if size < trial[1] or p != trial[0]:
                record_loss(motion.work, numbers, area, (dry[f], was, broken[k]), start, trial, (p, size))
            at = kept_b / (kept_a + kept_b)
            for i in range(3):
                part[i] = area * (p * axes[0, i] + q1 * axes[1, i] + q2 * axes[2, i])
                near[i] += at * jump[i]
                far[i] -= (1.0 - at) * jump[i]
            add_force(force, b, far, part, 1.0)
            add_force(force, a, near, part, -1.0)
    space.spring[5] = deepest


@compiled
def nearest_side(pair: int, moved: Floats, space: Space, point: Floats, nearest: Floats) -> tuple[int, float]:
    """Return the triangle of a pair's element that is nearest to its corner, and the distance."""
    # Flush faces are left out. `point` and `nearest` (3,) are set to the corner and the nearest point, in the element's
    # axes at rest.
    c, j = space.pair[pair, 0], space.pair[pair, 1]
    i = space.corner[c]
    arm, trial = np.empty(3), np.empty(3)
    rotate(space.turn[i], space.arm[c], arm)
    for k in range(3):
        arm[k] += space.centre[i, k] + moved[i, k] - space.centre[j, k] - moved[j, k]
    rotate_back(space.turn[j], arm, point)
    best, least = 0, np.inf
    for t in range(space.side_first[j], space.side_first[j + 1]):
        if is_among(space.flush, pair, space.side[t]):
            continue
        nearest_on_triangle(point, space.sides[t], trial)
        away = (point[0] - trial[0]) ** 2 + (point[1] - trial[1]) ** 2 + (point[2] - trial[2]) ** 2
        if away < least:
            best, least = t, away
            for k in range(3):
                nearest[k] = trial[k]
    return best, np.sqrt(least)


@compiled
def is_inside(point: Floats, pair: int, space: Space) -> bool:
    """Return whether a point (3,), in the axes at rest of a pair's element, lies within it."""
    # `angle_seen` is half the solid angle: 2π far inside, π in the plane of a face left out, π/2 at the edge of two.
    element, seen = space.pair[pair, 1], 0.0
    for t in range(space.side_first[element], space.side_first[element + 1]):
        if not is_among(space.flush, pair, space.side[t]):
            seen += angle_seen(point, space.sides[t])
    return seen > 0.4 * np.pi


@compiled
def near_pairs_in_space(moved: Floats, space: Space) -> Ints:
    """Return the pairs (k,) whose corner is now near its element's surface."""
    near, count = np.empty(len(space.pair), dtype=np.int64), 0
    point, nearest = np.empty(3), np.empty(3)
    for pair in range(len(space.pair)):
        _, away = nearest_side(pair, moved, space, point, nearest)
        if away < space.spring[4]:
            near[count] = pair
            count += 1
    return near[:count]


@compiled
def corner_forces_in_space(pairs: Ints, moved: Floats, force: Floats, space: Space) -> None:
    """Add the forces of corners of pairs (k,) that have entered other elements to `force` (n, 6)."""
    kn, ks, friction = space.spring[0], space.spring[1], space.spring[2]
    clearance = space.spring[3] + space.spring[5]
    # Rows of one array would have another memory layout, for which all functions were compiled once more.
    point, nearest, normal = np.empty(3), np.empty(3), np.empty(3)
    part, total, arm = np.empty(3), np.empty(3), np.empty(3)
    for pair in pairs:
        t, away = nearest_side(pair, moved, space, point, nearest)
        side, c, j = space.side[t], space.pair[pair, 0], space.pair[pair, 1]
        meets = away > clearance and not is_among(space.barred, pair, side)
        if not (meets and is_inside(point, pair, space)):
            space.on[pair] = -1
            for k in range(3):
                space.stuck[pair, k] = 0.0
            continue
        goes_on = space.on[pair] == side
        space.on[pair] = side
        # For a point inside, the nearest point lies along the outward normal.
        press = kn * (away - clearance)
        stuck = space.stuck[pair]
        for k in range(3):
            stuck[k] = stuck[k] - ks * (nearest[k] - space.place[pair, k]) if goes_on else 0.0
            space.place[pair, k] = nearest[k]
            normal[k] = (nearest[k] - point[k]) / away
        across = dot(stuck, normal)
        for k in range(3):
            stuck[k] -= across * normal[k]
        rub = np.sqrt(dot(stuck, stuck))
        i = space.corner[c]
        for k in range(3):
            if rub > friction * press:
                stuck[k] *= friction * press / rub
            part[k] = press * normal[k] + stuck[k]
        rotate(space.turn[j], part, total)
        rotate(space.turn[i], space.arm[c], arm)
        add_force(force, i, arm, total, 1.0)
        for k in range(3):
            arm[k] += space.centre[i, k] + moved[i, k] - space.centre[j, k] - moved[j, k]
        add_force(force, j, arm, total, -1.0)
