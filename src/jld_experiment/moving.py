"""Planar faces that follow the geometry: gaps and slips from where the elements are, contact lost where one slides past
the end of the other, and new contacts where corners meet other elements."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.errors import InputError
from jld_experiment.compiled import compiled
from jld_experiment.laws import contact_stress
from jld_experiment.subcontacts import SubContacts

CLEARANCE: Final = 1e-3
"""Depth, in typical elements and beyond the largest elastic overlap of any face, at which a corner begins to press:
four cells that meet in a point and are pressed together do not by that."""

_NEAR: Final = 0.05  # typical elements within which a corner is looked at step by step
_AROUND: Final = 1.0  # typical elements within which it is looked at at all


class Geometry(NamedTuple):
    """What moving faces and corners need to know, shapes at rest about the centroids.

    centre: (n, 2). near, far: (s, 2) arms to each sub-contact from elements a and b. share: (s,) tributary length.
    half: (m,) half length. corner: (c,) element of each corner; arm: (c, 2) to it. pair: (p, 2) corner and element that
    may meet. barred: (p, 2) edges of that element whose contact is a face already, −1 where none. edge_first: (n + 1,)
    where the corners of each element begin, counter-clockwise. spring: normal and shear force per length of a corner,
    friction, clearance, margin, and as a state the largest elastic overlap of any face.
    State, changed in place: gap, slid (s,); stuck (p,) force along the edge, place (p,) along it, on (p,) edge touched.
    """

    centre: Floats
    near: Floats
    far: Floats
    share: Floats
    half: Floats
    corner: Ints
    arm: Floats
    pair: Ints
    barred: Ints
    edge_first: Ints
    spring: Floats
    gap: Floats
    slid: Floats
    stuck: Floats
    place: Floats
    on: Ints


def geometry_of(assembly: Assembly, points: SubContacts, labels: Bits, kn: Floats, ks: Floats) -> Geometry:
    """Geometry of a planar assembly at rest. kn, ks: (m,) springs per area. Raises InputError for a spatial one."""
    if assembly.dimension == 3:
        raise InputError("--moving", "the geometry of spatial scenes stays at rest", "a planar scene")
    faces, elements = assembly.interfaces, assembly.elements
    at = faces.origin[points.face] + points.place[:, :1] * faces.e1[points.face]
    near, far = at - elements.centroid[faces.a[points.face]], at - elements.centroid[faces.b[points.face]]
    thickness = faces.l2[points.face]
    counts = [len(shape) for shape in elements.shape]
    corner = np.repeat(np.arange(len(elements)), counts)
    places = np.concatenate(elements.shape)
    typical = float(np.median(np.sqrt(elements.volume[elements.free] / float(np.median(faces.l2)))))
    pair, barred = _pairs(assembly, corner, places, _AROUND * typical)
    size = float(np.median(np.bincount(points.face, weights=points.place[:, 1]) / np.bincount(points.face)))
    friction = (
        float(np.nanmedian(assembly.strengths.friction)) if np.isfinite(assembly.strengths.friction).any() else 0.0
    )
    spring = [
        float(np.median(kn)) * size,
        float(np.median(ks)) * size,
        friction,
        CLEARANCE * typical,
        _NEAR * typical,
        0.0,
    ]
    return Geometry(
        centre=elements.centroid,
        near=near,
        far=far,
        share=points.place[:, 1] / thickness,
        half=0.5 * faces.l1,
        corner=corner,
        arm=places - elements.centroid[corner],
        pair=pair,
        barred=barred,
        edge_first=np.concatenate([[0], np.cumsum(counts)]),
        spring=np.array(spring),
        gap=np.zeros(len(points.face)),
        slid=np.zeros(len(points.face)),
        stuck=np.zeros(len(pair)),
        place=np.zeros(len(pair)),
        on=np.full(len(pair), -1),
    )


def nowhere() -> Geometry:
    """In place of a geometry where it stays at rest."""
    flat, table = np.zeros(0), np.zeros((0, 2))
    ints, pairs = np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
    return Geometry(
        table, table, table, flat, flat, ints, table, pairs, pairs, ints, flat, flat, flat, flat, flat, ints
    )


def _pairs(assembly: Assembly, corner: Ints, places: Floats, around: float) -> tuple[Ints, Ints]:
    """Corners and elements that may meet, and the edges along which they already do."""
    elements, faces = assembly.elements, assembly.interfaces
    contacts: dict[tuple[int, int], list[int]] = {}
    for face in range(len(faces)):
        a, b = int(faces.a[face]), int(faces.b[face])
        contacts.setdefault((a, b), []).append(face)
        contacts.setdefault((b, a), []).append(face)
    found, barred = [], []
    for other, shape in enumerate(elements.shape):
        low, high = shape.min(axis=0) - around, shape.max(axis=0) + around
        close = np.flatnonzero(np.all((places > low) & (places < high), axis=1) & (corner != other))
        for c in close.tolist():
            own = int(corner[c])
            if elements.support[own] and elements.support[other]:
                continue
            edges = [_edge_along(shape, faces.polygon[face]) for face in contacts.get((own, other), [])]
            found.append((c, other))
            barred.append(([*edges, -1, -1])[:2])
    table = np.array(found, dtype=np.int64).reshape(-1, 2)
    return table, np.array(barred, dtype=np.int64).reshape(-1, 2)


def _edge_along(shape: Floats, contact: Floats) -> int:
    """The edge of a polygon on which a contact lies."""
    after = np.roll(shape, -1, axis=0)
    along = after - shape
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    off = np.zeros(len(shape))
    for point in contact:
        arm = point - shape
        off += abs(arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0])
    return int(np.argmin(off))


@compiled
def moving_forces(
    moved: Floats,
    force: Floats,
    ends: Ints,
    frame: Floats,
    first: Ints,
    place: Floats,
    law: Floats,
    brittle: Bools,
    gaps: Bools,
    overlap: Floats,
    pressure: Floats,
    shear: Floats,
    broken: Bools,
    geometry: Geometry,
) -> None:
    """Forces of all faces from where the elements are, added to `force`. moved: (n, 3) since rest.

    Normals follow the mean rotation of both elements. A sub-contact is half on either element; the half that has slid
    past the end of the other face by its tributary length is lost, and comes back with it.
    """
    deepest = 0.0
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        ca, sa = np.cos(moved[a, 2]), np.sin(moved[a, 2])
        cb, sb = np.cos(moved[b, 2]), np.sin(moved[b, 2])
        half = 0.5 * (moved[a, 2] + moved[b, 2])
        c, s = np.cos(half), np.sin(half)
        nx, ny = c * frame[f, 0] - s * frame[f, 1], s * frame[f, 0] + c * frame[f, 1]
        ax, ay = geometry.centre[a, 0] + moved[a, 0], geometry.centre[a, 1] + moved[a, 1]
        bx, by = geometry.centre[b, 0] + moved[b, 0], geometry.centre[b, 1] + moved[b, 1]
        kn, ks = law[f, 0], law[f, 1]
        for k in range(first[f], first[f + 1]):
            px = ax + ca * geometry.near[k, 0] - sa * geometry.near[k, 1]
            py = ay + sa * geometry.near[k, 0] + ca * geometry.near[k, 1]
            qx = bx + cb * geometry.far[k, 0] - sb * geometry.far[k, 1]
            qy = by + sb * geometry.far[k, 0] + cb * geometry.far[k, 1]
            gap, slid = (qx - px) * nx + (qy - py) * ny, (qy - py) * nx - (qx - px) * ny
            e = overlap[k] - (gap - geometry.gap[k])
            q = shear[k, 0] - ks * (slid - geometry.slid[k])
            geometry.gap[k], geometry.slid[k] = gap, slid
            p = kn * e
            mu, psi, cohesion, tension = law[f, 2], law[f, 3], law[f, 4], law[f, 5]
            if broken[k]:
                mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
            failing = p < -tension or abs(q) > cohesion + mu * p
            if failing or p > law[f, 6]:
                if failing and brittle[f] and not broken[k]:
                    broken[k] = True
                    mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
                kept = gaps[f] or broken[k]
                e, p, size = contact_stress(e, abs(q), kn, ks, mu, psi, cohesion, tension, law[f, 6], kept)
                q = size if q > 0.0 else -size
            overlap[k], pressure[k], shear[k, 0] = e, p, q
            deepest = max(deepest, e)
            here, left = place[k, 0], geometry.share[k]
            kept_b = min(1.0, max(0.0, 1.0 - (abs(here + slid) - geometry.half[f]) / left))
            kept_a = min(1.0, max(0.0, 1.0 - (abs(here - slid) - geometry.half[f]) / left))
            area = 0.5 * (kept_a + kept_b) * place[k, 1]
            fx, fy = area * (p * nx - q * ny), area * (p * ny + q * nx)
            if area == 0.0:
                continue
            at = kept_b / (kept_a + kept_b)
            x, y = px + at * (qx - px), py + at * (qy - py)
            force[b, 0] += fx
            force[b, 1] += fy
            force[b, 2] += (x - bx) * fy - (y - by) * fx
            force[a, 0] -= fx
            force[a, 1] -= fy
            force[a, 2] -= (x - ax) * fy - (y - ay) * fx
    geometry.spring[5] = deepest


@compiled
def nearest_edge(pair: int, moved: Floats, geometry: Geometry) -> tuple[int, float, float, float, float]:
    """Edge of the element of a pair that its corner is nearest to: edge, depth inside the element (negative outside),
    place along the edge, and its direction."""
    c, j = geometry.pair[pair, 0], geometry.pair[pair, 1]
    i = geometry.corner[c]
    ci, si = np.cos(moved[i, 2]), np.sin(moved[i, 2])
    cj, sj = np.cos(moved[j, 2]), np.sin(moved[j, 2])
    # the corner in the frame of the element at rest
    x = geometry.centre[i, 0] + moved[i, 0] + ci * geometry.arm[c, 0] - si * geometry.arm[c, 1]
    y = geometry.centre[i, 1] + moved[i, 1] + si * geometry.arm[c, 0] + ci * geometry.arm[c, 1]
    x -= geometry.centre[j, 0] + moved[j, 0]
    y -= geometry.centre[j, 1] + moved[j, 1]
    x, y = cj * x + sj * y, cj * y - sj * x
    low, high = geometry.edge_first[j], geometry.edge_first[j + 1]
    best, least, place, tx, ty, within = 0, np.inf, 0.0, 0.0, 0.0, False
    for k in range(low, high):
        after = k + 1 if k + 1 < high else low
        x0, y0 = geometry.arm[k, 0], geometry.arm[k, 1]
        x1, y1 = geometry.arm[after, 0], geometry.arm[after, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (x1 - x0) * (y - y0) / (y1 - y0):
            within = not within
        ex, ey = x1 - x0, y1 - y0
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        along = min(max((x - x0) * ex + (y - y0) * ey, 0.0), length)
        away = (x - x0 - along * ex) ** 2 + (y - y0 - along * ey) ** 2
        if away < least:
            best, least, place = k - low, away, along
            tx, ty = cj * ex - sj * ey, sj * ex + cj * ey
    depth = np.sqrt(least) if within else -np.sqrt(least)
    return best, depth, place, tx, ty


@compiled
def near_pairs(moved: Floats, geometry: Geometry) -> Ints:
    """Pairs of corner and element that are near each other now."""
    found = np.empty(len(geometry.pair), dtype=np.int64)
    count = 0
    for pair in range(len(geometry.pair)):
        _, depth, _, _, _ = nearest_edge(pair, moved, geometry)
        if abs(depth) < geometry.spring[4]:
            found[count] = pair
            count += 1
    return found[:count]


@compiled
def corner_forces(pairs: Ints, moved: Floats, force: Floats, geometry: Geometry) -> None:
    """Forces of corners that have come into other elements, with friction, added to `force`.

    A corner that lies on an edge along which its element is in contact already is left to that face.
    """
    kn, ks, friction = geometry.spring[0], geometry.spring[1], geometry.spring[2]
    clearance = geometry.spring[3] + geometry.spring[5]
    for pair in pairs:
        edge, depth, place, tx, ty = nearest_edge(pair, moved, geometry)
        inside = depth - clearance
        if inside <= 0.0 or edge == geometry.barred[pair, 0] or edge == geometry.barred[pair, 1]:
            geometry.on[pair] = -1
            geometry.stuck[pair] = 0.0
            continue
        if geometry.on[pair] != edge:
            geometry.on[pair], geometry.stuck[pair] = edge, 0.0
        else:
            geometry.stuck[pair] -= ks * (place - geometry.place[pair])
        geometry.place[pair] = place
        press = kn * inside
        most = friction * press
        rub = min(most, max(-most, geometry.stuck[pair]))
        geometry.stuck[pair] = rub
        c, j = geometry.pair[pair, 0], geometry.pair[pair, 1]
        i = geometry.corner[c]
        # outward of a counter-clockwise element is its edge turned by −90°
        fx, fy = press * ty + rub * tx, rub * ty - press * tx
        ci, si = np.cos(moved[i, 2]), np.sin(moved[i, 2])
        ax = ci * geometry.arm[c, 0] - si * geometry.arm[c, 1]
        ay = si * geometry.arm[c, 0] + ci * geometry.arm[c, 1]
        bx = geometry.centre[i, 0] + moved[i, 0] + ax - geometry.centre[j, 0] - moved[j, 0]
        by = geometry.centre[i, 1] + moved[i, 1] + ay - geometry.centre[j, 1] - moved[j, 1]
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += ax * fy - ay * fx
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= bx * fy - by * fx
