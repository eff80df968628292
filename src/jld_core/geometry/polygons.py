"""Section properties of plane polygons in the local frame of an interface.

Coordinates are x1 along e1 and x2 along e2, in scene units. Functions take stacks of polygons with equally many
corners, so that a wall of rectangles needs no Python loop. `by_corner_count` makes the stacks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints


def by_corner_count(polygons: Sequence[Floats]) -> Iterator[tuple[Ints, Floats]]:
    """Yield stacks of polygons with equally many corners, fewest corners first.

    polygons: m arrays (k, d). Yields the positions (n,) in the sequence and the stack (n, k, d).
    """
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    for count in np.unique(counts):
        chosen = np.flatnonzero(counts == count)
        yield chosen, np.array([polygons[i] for i in chosen.tolist()])


def area(polygons: Floats) -> Floats:
    """Compute the signed areas (n,) of polygons (n, k, 2), positive when counter-clockwise."""
    # Coordinates relative to a corner: far from the origin, absolute ones lose digits.
    p = polygons - polygons[:, :1]
    q = np.roll(p, -1, axis=1)
    return np.asarray(0.5 * (p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]).sum(axis=1))


def centroid(polygons: Floats) -> Floats:
    """Compute the centroids (n, 2) of simple polygons (n, k, 2) with an area.

    Both senses of rotation are allowed.
    """
    p = polygons - polygons[:, :1]
    q = np.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    return np.asarray(polygons[:, 0] + ((p + q) * cross[..., None]).sum(axis=1) / (3.0 * cross.sum(axis=1))[:, None])


def second_moments(polygons: Floats) -> Floats:
    """Compute the second moments of area of polygons about their centroids.

    polygons: (n, k, 2), counter-clockwise. The result (n, 2, 2) holds ∫ x xᵀ dA of each.
    """
    p = polygons - centroid(polygons)[:, None]
    q = np.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    total = p + q
    outer = np.einsum("nk,nki,nkj->nij", cross, p, p) + np.einsum("nk,nki,nkj->nij", cross, q, q)
    return np.asarray((outer + np.einsum("nk,nki,nkj->nij", cross, total, total)) / 24.0)


def torsion_length(polygons: Floats) -> Floats:
    """Compute the torsion length c_T, the mean distance from the centroid, of polygons.

    polygons: (n, k, 2), simple and counter-clockwise. The result (n,) is c_T = (1/A) ∫ r dA, a length, docs/method.md
    (1.6). It is exact: the sum over triangles from the centroid to each edge. The edge has signed distance d, and its
    ends lie at s0 and s1 along it. Each triangle contributes, taken from s0 to s1,

        ∫ r dA = ∫ ρ³/3 dθ = (d/3) ∫ √(s² + d²) ds = (d/6) [s √(s² + d²) + d² asinh(s/d)].
    """
    p = polygons - centroid(polygons)[:, None]
    edge = np.roll(p, -1, axis=1) - p
    length = np.hypot(edge[..., 0], edge[..., 1])
    along = edge / np.where(length > 0.0, length, 1.0)[..., None]
    distance = p[..., 0] * along[..., 1] - p[..., 1] * along[..., 0]
    start = p[..., 0] * along[..., 0] + p[..., 1] * along[..., 1]
    total = _radial(distance, start + length) - _radial(distance, start)
    return np.asarray((distance * total).sum(axis=1) / (6.0 * area(polygons)))


def _radial(d: Floats, s: Floats) -> Floats:
    """Evaluate s √(s² + d²) + d² asinh(s/|d|), whose limit for d → 0 is s |s|."""
    apart = np.abs(d)
    through = apart <= 1e-150 * np.abs(s)
    ratio = s / np.where(through | (apart == 0.0), 1.0, apart)
    return np.asarray(s * np.hypot(s, d) + np.where(through, 0.0, d * d * np.arcsinh(ratio)))


def rectangle_torsion_length(l1: Floats, l2: Floats) -> Floats:
    """Compute the torsion length c_T, the mean distance from the centroid, of rectangles.

    l1, l2: (n,) side lengths, scene units. Returns (n,): c_T in closed form, scene units; 0.382598 for the unit square.
    Source: docs/method.md (1.5).
    """
    diagonal = np.hypot(l1, l2)
    ends = l1 * l1 / (12.0 * l2) * np.arcsinh(l2 / l1) + l2 * l2 / (12.0 * l1) * np.arcsinh(l1 / l2)
    return np.asarray(diagonal / 6.0 + ends)


def is_rectangle(polygons: Floats, tolerance: float) -> Bools:
    """Return a mask (n,) of the polygons that are rectangles.

    polygons: (n, k, d), without corners in straight edges. A rectangle has four corners, and equal diagonals that halve
    one another. tolerance: allowed difference of the diagonals' lengths, and twice the allowed distance of their
    middles, relative to the length of the first diagonal.
    """
    if polygons.shape[1] != 4:
        return np.zeros(len(polygons), dtype=bool)
    first, second = polygons[:, 2] - polygons[:, 0], polygons[:, 3] - polygons[:, 1]
    long, other = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    middle = np.linalg.norm(polygons[:, 0] + polygons[:, 2] - polygons[:, 1] - polygons[:, 3], axis=1)
    return np.asarray((middle <= tolerance * long) & (np.abs(long - other) <= tolerance * long))


def sizes(polygons: Floats) -> Floats:
    """Return the extents l1 and l2 (n, 2) of polygons (n, k, 2) along the axes e1 and e2."""
    return np.asarray(np.ptp(polygons, axis=1))


def corners(polygon: Floats, tolerance: float) -> Floats:
    """Remove the corners of a polygon (k, d) that lie in straight edges or are tips of spikes.

    polygon: simple, without bridges to holes. The order of the remaining corners is kept. tolerance: distance from the
    line of both neighbours up to which a corner is removed. A corner is the tip of a spike if one of its edges lies
    within this distance of the other.
    """
    points = np.asarray(polygon)
    while len(points) > 3:
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        off = np.minimum(_off_segment(points, before, after), _off_segment(after, before, points))
        off = np.minimum(off, _off_segment(before, points, after))
        # Remove the corner with the smallest distance first, so that the result does not depend on the first corner.
        least = int(np.argmin(off))
        if off[least] > tolerance:
            break
        points = np.delete(points, least, axis=0)
    return points


def keyhole(shell: Floats, holes: Sequence[Floats]) -> Floats:
    """Join a polygon and its holes to one closed outline, by bridges between nearest corners.

    shell: (k, d) outer corners. holes: corners of each hole, in the opposite sense of rotation. The outline runs along
    each bridge both ways. Integrals over the outline are therefore those of the area without its holes.
    """
    outline, left = shell, list(holes)
    while left:
        apart = [np.linalg.norm(outline[:, None] - hole[None], axis=2) for hole in left]
        nearest = int(np.argmin([table.min() for table in apart]))
        here, there = np.unravel_index(int(np.argmin(apart[nearest])), apart[nearest].shape)
        hole = left.pop(nearest)
        around = np.concatenate([hole[there:], hole[: there + 1]])
        outline = np.concatenate([outline[: here + 1], around, outline[here:]])
    return outline


def without_idle_corners(polygons: Sequence[Floats], tolerance: float) -> list[Floats]:
    """Remove corners in straight edges and tips of spikes from polygons (k, d).

    Polygons without such corners, the common case, are recognised in stacks and returned unchanged.
    tolerance: distance from the line of the neighbours, relative to each polygon's largest extent.
    """
    plain = list(polygons)
    for chosen, stack in by_corner_count(polygons):
        size = np.ptp(stack, axis=1).max(axis=1)
        chord = np.roll(stack, -1, axis=1) - np.roll(stack, 1, axis=1)
        arm = stack - np.roll(stack, 1, axis=1)
        length = np.linalg.norm(chord, axis=2)
        along = np.einsum("nkj,nkj->nk", arm, chord) / np.where(length > 0.0, length, 1.0)
        off = np.sqrt(np.maximum(np.einsum("nkj,nkj->nk", arm, arm) - along**2, 0.0))
        # A wide first test, so that rounding of the square root does not hide candidates of the exact test.
        for index in chosen[np.any(off <= 2.0 * max(tolerance, 1e-7) * size[:, None], axis=1)].tolist():
            plain[index] = corners(polygons[index], tolerance * float(np.ptp(polygons[index], axis=0).max()))
    return plain


def _off_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Compute the distances (k,) of points (k, d) from the segments between `start` and `end`."""
    chord, arm = end - start, points - start
    length = np.einsum("ij,ij->i", chord, chord)
    share = np.clip(np.einsum("ij,ij->i", arm, chord) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(arm - share[:, None] * chord, axis=1))


def hull(polygon: Floats) -> Floats:
    """Return the convex hull (h, 2) of points (k, 2), counter-clockwise.

    Points on its edges are left out. The first corner is the one of least x1, then of least x2.
    """
    ring = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(polygon)))[:-1]
    # Distances of points from an edge below this relative limit are rounding.
    found = corners(ring if area(ring[None])[0] > 0.0 else ring[::-1], 1e-12 * float(np.ptp(ring, axis=0).max()))
    return np.roll(found, -int(np.lexsort((found[:, 1], found[:, 0]))[0]), axis=0)


def hulls(polygons: Sequence[Floats]) -> list[Floats]:
    """Return the convex hulls of counter-clockwise polygons (k, 2).

    Convex polygons, the common case, are recognised in stacks and returned unchanged.
    """
    found = list(polygons)
    for chosen, stack in by_corner_count(polygons):
        edge = np.roll(stack, -1, axis=1) - stack
        onward = np.roll(edge, -1, axis=1)
        turn = edge[..., 0] * onward[..., 1] - edge[..., 1] * onward[..., 0]
        size = np.ptp(stack, axis=1).max(axis=1)
        # A star polygon also has left turns only; its turning angle exceeds one revolution.
        angle = np.arctan2(turn, np.einsum("nkj,nkj->nk", edge, onward)).sum(axis=1)
        convex = np.all(turn > 1e-12 * size[:, None] ** 2, axis=1) & (angle < 3.0 * np.pi)
        for index in chosen[~convex].tolist():
            found[index] = hull(polygons[index])
    return found


def hull_rows(hull_: Floats) -> Floats:
    """Return rows that keep a compressive resultant within a convex hull, one per edge.

    hull_: (h, 2) corners about the section's centroid, counter-clockwise. The rows (h, 3) act on (N, M1, M2) and are
    all ≥ 0 where the centre of pressure lies within the hull. It has coordinates x1 = −M2/N and x2 = M1/N. The
    condition a·x ≤ d on an edge of unit outward normal a becomes d N − a2 M1 + a1 M2 ≥ 0. Source: docs/method.md (2.3).
    """
    edge = np.roll(hull_, -1, axis=0) - hull_
    outward = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    distance = np.einsum("hi,hi->h", hull_, outward)
    return np.column_stack([distance, -outward[:, 1], outward[:, 0]])


def kern_rows(hull_: Floats, area_: float, moments: Floats) -> Floats:
    """Return rows that compute the elastic normal stress at hull corners, times the area.

    hull_: (h, 2) corners about the centroid. area_: A. moments: (2, 2) tensor S of second moments, so that e1, e2 need
    not be principal axes. The rows (h, 3) act on (N, M1, M2), with compression positive: σ(x) A = N + A x·S⁻¹(−M2, M1).
    An inner face of kern form requires rows ≥ −σt A: docs/method.md (2.6).
    """
    slope = area_ * np.linalg.solve(moments, hull_.T).T
    return np.column_stack([np.ones(len(hull_)), slope[:, 1], -slope[:, 0]])
