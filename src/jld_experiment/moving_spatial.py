"""Compute forces of spatial faces that follow the geometry, and contacts of corners.

As in `moving`, with finite rotations: contact is lost where a face slides past the rim of another. New contacts arise
where corners meet other elements. Edges that cross edges, with no corner inside the other element, are not detected.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Floats, Ints
from jld_core.geometry import area_vector
from jld_experiment.bench import Bench, Motion
from jld_experiment.compiled import compiled
from jld_experiment.laws import numbers_of, record_loss, sub_contact
from jld_experiment.moving import contacts_of, corner_springs, near_corners
from jld_experiment.solids import (
    angle_seen,
    beyond,
    dot,
    is_among,
    nearest_on_triangle,
    pressed,
    triangles_of,
    turned,
    turned_back,
)
from jld_experiment.subcontacts import SubContacts

_FLUSH: Final = 1e-6  # Distance, in typical element sizes, up to which faces count as coplanar.


class Space(NamedTuple):
    """Data of moving spatial faces and corners, with shapes at rest about the centroids.

    The last seven attributes are state and are changed in place.

    centre: (n, 3) centroids. near, far: (s, 3) arms to each sub-contact from elements a and b. share: (s,) side of a
    square with the area of the sub-contact. rim_first: (m + 1,) position of the first rim point of each face. rim: (r,
    2) rims of faces in their frames about their origins. corner: (c,) element of each corner. arm: (c, 3) arm to each
    corner. pair: (p, 2) corner and element that may meet. barred: (p, k) faces of that element whose contact is already
    a face, −1 for none. side_first: (n + 1,) position of the first triangle of each element. sides: (t, 3, 3) outward
    triangles of the elements. side: (t,) face of the element to which each triangle belongs. flush: (p, k) faces of the
    element through which the corner cannot enter, −1 for none. spring: (6,) springs of corners, see `corner_springs`.
    turn: (n, 3, 3) rotations since rest. kept: (s,) share of the area of sub-contacts that is in contact. gap: (s,) gap
    of sub-contacts. slid: (s, 2) slip of sub-contacts. stuck, place: (p, 3) force and position on the element, in its
    axes at rest. on: (p,) face touched.
    """

    centre: Floats
    near: Floats
    far: Floats
    share: Floats
    rim_first: Ints
    rim: Floats
    corner: Ints
    arm: Floats
    pair: Ints
    barred: Ints
    side_first: Ints
    sides: Floats
    side: Ints
    flush: Ints
    spring: Floats
    turn: Floats
    kept: Floats
    gap: Floats
    slid: Floats
    stuck: Floats
    place: Floats
    on: Ints


def space_of(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats) -> Space:
    """Return the data of a spatial assembly at rest; arguments are those of `plane_of`."""
    faces, elements = assembly.interfaces, assembly.elements
    along = points.place[:, :1] * faces.e1[points.face] + points.place[:, 1:2] * faces.e2[points.face]
    at = faces.origin[points.face] + along
    near, far = at - elements.centroid[faces.a[points.face]], at - elements.centroid[faces.b[points.face]]
    rims = []
    for face in range(len(faces)):
        arm = faces.polygon[face] - faces.origin[face]
        rims.append(np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]]))
    corner = np.repeat(np.arange(len(elements)), [len(shape) for shape in elements.shape])
    places = np.concatenate(elements.shape)
    typical = float(np.median(np.cbrt(elements.volume[elements.free])))
    pair = near_corners(assembly, corner, places, typical)
    cut = [triangles_of(elements.shape[k] - elements.centroid[k], elements.faces[k]) for k in range(len(elements))]
    return Space(
        centre=elements.centroid,
        near=near,
        far=far,
        share=np.sqrt(points.place[:, 2]),
        rim_first=np.concatenate([[0], np.cumsum([len(rim) for rim in rims])]),
        rim=np.concatenate(rims),
        corner=corner,
        arm=places - elements.centroid[corner],
        pair=pair,
        barred=_faces_in_contact(assembly, corner, pair),
        side_first=np.concatenate([[0], np.cumsum([len(which) for _, which in cut])]),
        sides=np.concatenate([table for table, _ in cut]),
        side=np.concatenate([which for _, which in cut]),
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
    """Return (p, k) faces along which a pair's element already touches that of the corner.

    The value is −1 where there is no such face.
    """
    contacts, faces, elements = contacts_of(assembly), assembly.interfaces, assembly.elements
    found = []
    for c, other in pair.tolist():
        rings = [elements.shape[other][list(side)] for side in elements.faces[other]]
        off = []
        for face in contacts.get((int(corner[c]), other), []):
            away = [abs((ring - faces.origin[face]) @ faces.normal[face]).max() for ring in rings]
            off.append(int(np.argmin(away)))
        found.append(off)
    return _table(found)


def _flush_faces(assembly: Assembly, corner: Ints, pair: Ints, typical: float) -> Ints:
    """Return (p, k) faces of a pair's element that are coplanar with a face of the corner's.

    Both faces have the same outward normal, as at the ends of a wall's blocks, so no corner enters through them.
    The value is −1 where there is no such face.
    """
    elements, planes = assembly.elements, []
    for shape, sides in zip(elements.shape, elements.faces, strict=True):
        rows = []
        for side in sides:
            ring = shape[list(side)]
            normal = area_vector(ring)
            normal /= np.linalg.norm(normal)
            rows.append(np.append(typical * normal, ring.mean(axis=0) @ normal))
        planes.append(np.array(rows))
    found, known = [], dict[tuple[int, int], list[int]]()
    for c, other in pair.tolist():
        both = int(corner[c]), other
        if both not in known:
            apart = abs(planes[other][:, None] - planes[both[0]][None]).max(axis=2)
            known[both] = np.flatnonzero(apart.min(axis=1) < _FLUSH * typical).tolist()
        found.append(known[both])
    return _table(found)


def _table(rows: list[list[int]]) -> Ints:
    """Return lists of numbers as one table, filled with −1."""
    table = np.full((len(rows), max((len(row) for row in rows), default=0)), -1)
    for line, row in zip(table, rows, strict=True):
        line[: len(row)] = row
    return table


@compiled
def turn_along(velocity: Floats, space: Space) -> None:
    """Rotate the elements by their rotation of one time step (Rodrigues' formula).

    velocity: (n, 6) displacement and rotation vector per step. `space.turn` is changed in place.
    """
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
    """Update all sub-contacts and add the forces of their faces to `force` (n, 6).

    All else is as in `moving_forces`; the rotations are those of `space.turn`.
    """
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
        ks, own = law[f, 1], numbers_of(law, f)
        low, high = space.rim_first[f], space.rim_first[f + 1]
        for k in range(first[f], first[f + 1]):
            turned(space.turn[a], space.near[k], near)
            turned(space.turn[b], space.far[k], far)
            for i in range(3):
                jump[i] = between[i] + far[i] - near[i]
            gap, slid1, slid2 = dot(jump, axes[0]), dot(jump, axes[1]), dot(jump, axes[2])
            e = overlap[k] - (gap - space.gap[k])
            q1 = shear[k, 0] - ks * (slid1 - space.slid[k, 0])
            q2 = shear[k, 1] - ks * (slid2 - space.slid[k, 1])
            space.gap[k], space.slid[k, 0], space.slid[k, 1] = gap, slid1, slid2
            trial, was = (own[0] * e, np.sqrt(q1 * q1 + q2 * q2)), broken[k]
            start = (pressure[k], (shear[k, 0] * q1 + shear[k, 1] * q2) / max(trial[1], 1e-300))
            e, p, size, broken[k] = sub_contact(e, trial[1], own, brittle[f], gaps[f], was)
            if size < trial[1]:
                q1 *= size / trial[1]
                q2 *= size / trial[1]
            overlap[k], pressure[k] = e, p
            shear[k, 0], shear[k, 1] = q1, q2
            deepest = max(deepest, e)
            x1, x2, left = place[k, 0], place[k, 1], space.share[k]
            kept_b = max(0.0, 1.0 - beyond(x1 + slid1, x2 + slid2, low, high, space.rim) / left)
            kept_a = max(0.0, 1.0 - beyond(x1 - slid1, x2 - slid2, low, high, space.rim) / left)
            space.kept[k] = 0.5 * (kept_a + kept_b)
            area = space.kept[k] * place[k, 2]
            if area == 0.0:
                continue
            if size < trial[1] or p != trial[0]:
                record_loss(motion.work, own, area, (dry[f], was, broken[k]), start, trial, (p, size))
            at = kept_b / (kept_a + kept_b)
            for i in range(3):
                part[i] = area * (p * axes[0, i] + q1 * axes[1, i] + q2 * axes[2, i])
                near[i] += at * jump[i]
                far[i] -= (1.0 - at) * jump[i]
            pressed(force, b, far, part, 1.0)
            pressed(force, a, near, part, -1.0)
    space.spring[5] = deepest


@compiled
def nearest_side(pair: int, moved: Floats, space: Space, point: Floats, nearest: Floats) -> tuple[int, float]:
    """Return the triangle of a pair's element that is nearest to its corner, and the distance.

    Flush faces are left out. `point` and `nearest` (3,) are set to the corner and the nearest point, in the element's
    axes at rest. pair: row of `space.pair`. moved: (n, 6) displacements.
    """
    c, j = space.pair[pair, 0], space.pair[pair, 1]
    i = space.corner[c]
    arm, trial = np.empty(3), np.empty(3)
    turned(space.turn[i], space.arm[c], arm)
    for k in range(3):
        arm[k] += space.centre[i, k] + moved[i, k] - space.centre[j, k] - moved[j, k]
    turned_back(space.turn[j], arm, point)
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
    """Return True if a point (3,), in the axes at rest of a pair's element, lies within it.

    Flush faces are left out. A point in their plane still sees half the solid angle of a point far inside.
    """
    element, seen = space.pair[pair, 1], 0.0
    for t in range(space.side_first[element], space.side_first[element + 1]):
        if not is_among(space.flush, pair, space.side[t]):
            seen += angle_seen(point, space.sides[t])
    return seen > 0.4 * np.pi


@compiled
def near_pairs_in_space(moved: Floats, space: Space) -> Ints:
    """Return the pairs (k,) whose corner is now near its element's surface; see `near_pairs`."""
    found, count = np.empty(len(space.pair), dtype=np.int64), 0
    point, nearest = np.empty(3), np.empty(3)
    for pair in range(len(space.pair)):
        _, away = nearest_side(pair, moved, space, point, nearest)
        if away < space.spring[4]:
            found[count] = pair
            count += 1
    return found[:count]


@compiled
def corner_forces_in_space(pairs: Ints, moved: Floats, force: Floats, space: Space) -> None:
    """Add the corner forces to `force` (n, 6), with arguments as in `corner_forces`."""
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
        turned(space.turn[j], part, total)
        turned(space.turn[i], space.arm[c], arm)
        pressed(force, i, arm, total, 1.0)
        for k in range(3):
            arm[k] += space.centre[i, k] + moved[i, k] - space.centre[j, k] - moved[j, k]
        pressed(force, j, arm, total, -1.0)
