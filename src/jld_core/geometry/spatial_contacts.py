"""Where polyhedra touch: pairs of opposite coplanar facets to interfaces with local frames.

Candidates are found with bounding boxes over whole arrays; rectangles with parallel sides are cut by
comparing numbers, everything else by shapely in the plane of contact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.errors import InputError
from jld_core.geometry import polygons as measures
from jld_core.geometry.misfits import NearMiss
from jld_core.geometry.polyhedra import Facets, spread

# Facets further from opposite than this (cosine) cannot lie on one another within the tolerance of contact.
_OPPOSITE = -0.999
_PARALLEL = 1e-9
_AT_ONCE = 20_000  # pairs of elements: cubes make some 25 pairs of facets of each, a quarter of a kilobyte each


@dataclass(frozen=True)
class SpatialContact:
    """A plane contact: element indices, corners (k, 3) in order, and the unit normal from a to b."""

    a: int
    b: int
    polygon: Floats
    normal: Floats


def near_pairs(lower: Floats, upper: Floats, reach: Floats) -> tuple[Ints, Ints]:
    """Pairs a < b of boxes that touch or overlap, sorted.

    lower, upper: (n, 3) corners; reach: (n,) by how much each box is widened.
    """
    low, high = lower - reach[:, None], upper + reach[:, None]
    # boxes crowd together most along the axis that is dropped, so drop the one with the fewest layers
    layers = np.ptp(np.concatenate([low, high]), axis=0) / np.maximum((high - low).mean(axis=0), 1e-300)
    x, y = sorted(np.argsort(layers, kind="stable")[1:])
    z = 3 - x - y
    # sheets across that axis are laid side by side: a box then meets what is near it along that axis too
    bottom, span = low[:, z].min(), np.ptp(np.concatenate([low[:, z], high[:, z]]))
    step = max(2.0 * float((high - low)[:, z].mean()), float(span) / len(low)) or 1.0
    first = np.floor((low[:, z] - bottom) / step).astype(np.int64)
    count = np.floor((high[:, z] - bottom) / step).astype(np.int64) - first + 1
    owner, sheet = spread(first, count)
    wide = float(np.ptp(np.concatenate([low[:, x], high[:, x]])))
    aside = 2.0 * wide * sheet
    room = 1e-12 * (float(aside.max()) + float(abs(low[:, x]).max()) + wide)
    flat = shapely.box(low[owner, x] + aside - room, low[owner, y], high[owner, x] + aside + room, high[owner, y])
    tree, found = shapely.STRtree(flat), [np.empty((2, 0), dtype=np.int64)]
    for begin in range(0, len(flat), _AT_ONCE):
        one, two = tree.query(flat[begin : begin + _AT_ONCE])
        left, right = owner[one + begin], owner[two]
        kept = (left < right) & (sheet[two] == np.maximum(first[left], first[right]))
        left, right = left[kept], right[kept]
        near = np.all((low[left] <= high[right]) & (low[right] <= high[left]), axis=1)
        found.append(np.stack([left[near], right[near]]))
    left, right = np.concatenate(found, axis=1)
    order = np.lexsort((right, left))
    return left[order], right[order]


def find_spatial_contacts(facets: Facets, pairs: tuple[Ints, Ints]) -> list[SpatialContact]:
    """All plane contacts between polyhedra, in order of (a, b), then of the facets of a and of b.

    facets: of all elements, in their order; pairs: elements a < b worth looking at, sorted, each (p,).
    A contact in several parts, or with a hole, is several interfaces.
    Source: docs/method.md (1.1), normals from element faces.
    """
    one, two = _opposite_facets(facets, *pairs)
    if not len(one):
        return []
    frames = _Frames.on(facets)
    rectangle = frames.rectangle[one] & frames.rectangle[two]
    found: list[tuple[int, SpatialContact]] = []
    quick = np.flatnonzero(rectangle)
    settled = np.zeros(len(one), dtype=bool)
    if quick.size:
        aligned, hits = _cut_rectangles(facets, frames, one[quick], two[quick])
        settled[quick[aligned]] = True
        found += [(int(quick[position]), contact) for position, contact in hits]
    rest = np.flatnonzero(~settled)
    found += [
        (int(rest[position]), contact) for position, contact in _cut_polygons(facets, frames, one[rest], two[rest])
    ]
    found.sort(key=lambda entry: entry[0])
    return [contact for _, contact in found]


def near_solids(facets: Facets, pairs: tuple[Ints, Ints]) -> list[NearMiss]:
    """Parallel facets apart by less than `tolerances.NEAR` of the smaller one, overlapping in projection, no contact.

    facets: of all elements. pairs: elements a < b worth looking at, sorted, each (p,).
    """
    one, two = _opposite_facets(facets, *pairs, tolerances.NEAR)
    size = np.minimum(facets.size[one], facets.size[two])
    off = np.abs(np.einsum("ij,ij->i", facets.origin[two] - facets.origin[one], facets.normal[one]))
    parallel = np.einsum("ij,ij->i", facets.normal[one], facets.normal[two]) < -1.0 + tolerances.NEAR**2
    kept = parallel & (off > tolerances.FACE * size) & (off <= tolerances.NEAR * size)
    one, two, off, size = one[kept], two[kept], off[kept], size[kept]
    if not len(one):
        return []
    frames = _Frames.on(facets)
    shared = shapely.intersection(_regions(facets, frames, one, one), _regions(facets, frames, two, one))
    found = []
    for k in np.flatnonzero(shapely.area(shared) > (tolerances.NEAR * size) ** 2).tolist():
        flat = shapely.get_coordinates(shapely.point_on_surface(shared[k]))[0]
        facet = one[k]
        place = facets.origin[facet] + flat @ np.array([frames.e1[facet], frames.e2[facet]])
        found.append(NearMiss(int(facets.element[facet]), int(facets.element[two[k]]), float(off[k]), place))
    return sorted(found, key=lambda miss: (miss.a, miss.b))


def _opposite_facets(facets: Facets, a: Ints, b: Ints, share: float = tolerances.FACE) -> tuple[Ints, Ints]:
    """Pairs of facets of the element pairs that face one another in about one plane."""
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    reach = share * facets.size
    low, high = facets.lower - reach[:, None], facets.upper + reach[:, None]
    box_low, box_high = np.minimum.reduceat(low, start), np.maximum.reduceat(high, start)

    def within(element: Ints, other: Ints) -> tuple[Ints, Ints]:
        owner, facet = spread(start[element], count[element])
        inside = np.all((low[facet] <= box_high[other[owner]]) & (high[facet] >= box_low[other[owner]]), axis=1)
        return owner[inside], facet[inside]

    def facing(a: Ints, b: Ints) -> Ints:
        owner_a, facet_a = within(a, b)
        owner_b, facet_b = within(b, a)
        first = np.searchsorted(owner_b, np.arange(len(a)))
        amount = np.bincount(owner_b, minlength=len(a))
        repeat, position = spread(first[owner_a], amount[owner_a])
        one, two = facet_a[repeat], facet_b[position]
        kept = np.einsum("ij,ij->i", facets.normal[one], facets.normal[two]) < _OPPOSITE
        one, two = one[kept], two[kept]
        boxes = np.all((low[one] <= high[two]) & (low[two] <= high[one]), axis=1)
        one, two = one[boxes], two[boxes]
        apart = facets.origin[two] - facets.origin[one]
        off = np.abs(np.einsum("ij,ij->i", apart, facets.normal[one]))
        # as far from one another as the misalignment let through above allows; the gap itself is judged where
        # they overlap
        level = off <= 0.05 * (np.linalg.norm(apart, axis=1) + np.minimum(facets.size[one], facets.size[two]))
        return np.stack([one[level], two[level]])

    parts = [facing(a[k : k + _AT_ONCE], b[k : k + _AT_ONCE]) for k in range(0, len(a), _AT_ONCE)]
    one, two = np.concatenate([np.empty((2, 0), dtype=np.int64), *parts], axis=1)
    return one, two


@dataclass(frozen=True)
class _Frames:
    """Per facet: e1 (f, 3) along its longest edge, e2 = n × e1, and whether it is exactly a rectangle."""

    e1: Floats
    e2: Floats
    rectangle: Bools

    @classmethod
    def on(cls, facets: Facets) -> _Frames:
        e1 = np.empty((len(facets), 3))
        rectangle = np.zeros(len(facets), dtype=bool)
        for chosen, stack in measures.by_corner_count([loops[0] for loops in facets.loops]):
            e1[chosen] = _longest_edge(stack)
            simple = np.array([len(facets.loops[index]) == 1 for index in chosen])
            rectangle[chosen] = simple & measures.is_rectangle(stack, _PARALLEL)
        e1 = _unit(e1 - np.einsum("ij,ij->i", e1, facets.normal)[:, None] * facets.normal)
        return cls(e1, np.cross(facets.normal, e1), rectangle)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _longest_edge(polygons: Floats) -> Floats:
    """Unit direction (n, 3) of the longest edge of each polygon (n, k, 3), the first among equals."""
    edge = np.roll(polygons, -1, axis=1) - polygons
    length = np.linalg.norm(edge, axis=2)
    first = np.argmax(length >= (1.0 - 1e-9) * length.max(axis=1)[:, None], axis=1)
    return _unit(edge[np.arange(len(edge)), first])


def _cut_rectangles(
    facets: Facets, frames: _Frames, one: Ints, two: Ints
) -> tuple[Bools, list[tuple[int, SpatialContact]]]:
    """Overlaps of rectangles: mask of the pairs with parallel sides, settled ones, and their contacts."""
    first = np.array([facets.loops[index][0] for index in one])
    second = np.array([facets.loops[index][0] for index in two])
    origin, e1, e2, normal = facets.origin[one], frames.e1[one], frames.e2[one], facets.normal[one]
    side = np.abs(np.einsum("ij,ij->i", e1, frames.e1[two]))
    skew = np.minimum(side, np.abs(np.einsum("ij,ij->i", e2, frames.e1[two])))
    aligned = (skew <= _PARALLEL) & (np.einsum("ij,ij->i", normal, facets.normal[two]) < _PARALLEL - 1.0)

    def extent(stack: Floats, axis: Floats) -> tuple[Floats, Floats]:
        along = np.einsum("nkj,nj->nk", stack - origin[:, None], axis)
        return along.min(axis=1), along.max(axis=1)

    size = np.minimum(facets.size[one], facets.size[two])
    (l1, u1), (l2, u2) = extent(first, e1), extent(first, e2)
    (m1, v1), (m2, v2) = extent(second, e1), extent(second, e2)
    low, high = extent(second, normal)
    x0, x1, y0, y1 = np.maximum(l1, m1), np.minimum(u1, v1), np.maximum(l2, m2), np.minimum(u2, v2)
    reach = tolerances.FACE * size
    hit = aligned & (x1 - x0 > reach) & (y1 - y0 > reach) & (np.maximum(abs(low), abs(high)) <= reach)
    half = 0.5 * (low + high)
    corners = np.stack(
        [
            origin + x[:, None] * e1 + y[:, None] * e2 + half[:, None] * normal
            for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        ],
        axis=1,
    )
    element_a, element_b = facets.element[one].tolist(), facets.element[two].tolist()
    hits = [
        (k, SpatialContact(element_a[k], element_b[k], corners[k], normal[k])) for k in np.flatnonzero(hit).tolist()
    ]
    return aligned, hits


def _cut_polygons(facets: Facets, frames: _Frames, one: Ints, two: Ints) -> list[tuple[int, SpatialContact]]:
    """Overlaps of any facets, by shapely in the plane of the first."""
    if not len(one):
        return []
    first, second = _regions(facets, frames, one, one), _regions(facets, frames, two, one)
    shared = shapely.intersection(first, second)
    size = np.minimum(facets.size[one], facets.size[two])
    found = []
    for position in np.flatnonzero(shapely.area(shared) > 0.0).tolist():
        a, b, reach = one[position], two[position], tolerances.FACE * size[position]
        normal, origin = facets.normal[a], facets.origin[a]
        slope = facets.normal[b] / (facets.normal[b] @ normal)
        for part in _simple_parts(shared[position], reach):
            flat = measures.corners(part, reach)
            if 2.0 * abs(measures.area(flat[None])[0]) <= reach * float(np.ptp(flat, axis=0).max()):
                continue
            points = origin + flat @ np.array([frames.e1[a], frames.e2[a]])
            # the distance to the other facet's plane is taken where they overlap
            gap = (facets.origin[b] - points) @ slope
            if np.max(np.abs(gap)) > reach:
                continue
            middle = points + 0.5 * gap.mean() * normal
            found.append((position, SpatialContact(int(facets.element[a]), int(facets.element[b]), middle, normal)))
    return found


def _regions(facets: Facets, frames: _Frames, which: Ints, plane: Ints) -> Sequence[shapely.Geometry]:
    """Facets `which` as shapely polygons in the planes of facets `plane`."""
    shells = [facets.loops[index][0] for index in which]
    count = np.array([len(shell) for shell in shells])
    owner = np.repeat(np.arange(len(which)), count)
    flat = _project(np.concatenate(shells), facets, frames, plane[owner])
    regions = shapely.polygons(shapely.linearrings(flat, indices=owner))
    for position in [k for k, index in enumerate(which) if len(facets.loops[index]) > 1]:
        at = plane[position]
        rings = [_project(loop, facets, frames, np.full(len(loop), at)) for loop in facets.loops[which[position]]]
        regions[position] = shapely.Polygon(rings[0], rings[1:])
    bad = np.flatnonzero(~shapely.is_valid(regions))
    regions[bad] = shapely.make_valid(regions[bad])
    return regions  # type: ignore[no-any-return]


def _project(points: Floats, facets: Facets, frames: _Frames, plane: Ints) -> Floats:
    arm = points - facets.origin[plane]
    return np.column_stack([np.einsum("ij,ij->i", arm, frames.e1[plane]), np.einsum("ij,ij->i", arm, frames.e2[plane])])


def _simple_parts(region: shapely.Geometry, reach: float) -> list[Floats]:
    """Counter-clockwise outlines of the parts of a region, in order of place; a hole cuts its part in two."""
    outlines = []
    parts = [part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > 0.0]
    while parts:
        part = parts.pop()
        holes = [shapely.Polygon(ring) for ring in part.interiors]
        # holes narrower than the tolerance are rounding
        holes = [hole for hole in holes if 2.0 * hole.area > reach * hole.length]
        if holes:
            x0, y0, x1, y1 = part.bounds
            middle = holes[0].centroid.x
            for low, high in ((x0 - 1.0, middle), (middle, x1 + 1.0)):
                piece = shapely.intersection(part, shapely.box(low, y0 - 1.0, high, y1 + 1.0))
                parts += [p for p in shapely.get_parts(piece) if p.geom_type == "Polygon" and p.area > 0.0]
            continue
        ring = shapely.get_coordinates(shapely.Polygon(part.exterior))[:-1]
        outlines.append(ring if measures.area(ring[None])[0] > 0.0 else ring[::-1])
    return sorted(outlines, key=lambda ring: tuple(ring.mean(axis=0)))


def given_normals(polygons: list[Floats], a: Ints, facets: Facets, where: Callable[[int], str]) -> Floats:
    """Unit normals (m, 3) of stated contacts, out of the element a of each.

    polygons: m arrays (k, 3), k ≥ 3, corners in order; a: (m,) elements; where: the key of contact i, for
    complaints. The stated polygon decides the direction, the face of a it lies on only on which side the
    other element lies.
    Raises InputError: no area, or corners that do not lie in a plane.
    """
    normal, place, size = np.empty((len(a), 3)), np.empty((len(a), 3)), np.empty(len(a))
    for chosen, stack in measures.by_corner_count(polygons):
        arm = stack - stack[:, :1]
        vector = 0.5 * np.cross(arm, np.roll(arm, -1, axis=1)).sum(axis=1)
        amount = np.linalg.norm(vector, axis=1)
        extent = np.ptp(stack, axis=1).max(axis=1)
        for index in chosen[~(2.0 * amount > tolerances.FACE * extent**2)][:1]:
            raise InputError(f"{where(int(index))}.polygon", "it has no area", "three or more corners in order")
        normal[chosen] = vector / amount[:, None]
        height = np.abs(np.einsum("nkj,nj->nk", stack - stack.mean(axis=1)[:, None], normal[chosen])).max(axis=1)
        for index in chosen[height > tolerances.FACE * extent][:1]:
            raise InputError(f"{where(int(index))}.polygon", "its corners do not lie in a plane", "a plane polygon")
        place[chosen], size[chosen] = stack.mean(axis=1), extent
    return normal * _sides(normal, place, size, a, facets)[:, None]


def _sides(normal: Floats, place: Floats, size: Floats, a: Ints, facets: Facets) -> Floats:
    """+1 where a normal points out of element a at the face a place lies on, −1 where it points in."""
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    owner, facet = spread(start[a], count[a])
    cosine = np.einsum("ij,ij->i", normal[owner], facets.normal[facet])
    off = np.abs(np.einsum("ij,ij->i", place[owner] - facets.origin[facet], facets.normal[facet]))
    outside = np.maximum(facets.lower[facet] - place[owner], place[owner] - facets.upper[facet]).max(axis=1)
    # in one plane a body may face both ways, so a face counts as far away as the place lies outside of it
    far = np.where(np.abs(cosine) < 0.9, np.inf, off + np.maximum(outside, 0.0))
    best = np.minimum.reduceat(far, np.concatenate([[0], np.cumsum(count[a])])[:-1])
    close = far <= (best + tolerances.FACE * size)[owner]
    vote = np.where(close & np.isfinite(far), np.sign(cosine), 0.0)
    plus = np.bincount(owner, weights=np.maximum(vote, 0.0), minlength=len(a))
    minus = np.bincount(owner, weights=np.maximum(-vote, 0.0), minlength=len(a))
    side = np.where(plus >= minus, 1.0, -1.0)
    frames = _Frames.on(facets) if np.any((plus > 0.0) == (minus > 0.0)) else None
    for index in np.flatnonzero((plus > 0.0) == (minus > 0.0)).tolist():
        # boxes did not settle it: measure to the faces themselves, all of them if none is parallel
        rows = np.flatnonzero(owner == index)
        assert frames is not None
        distance = []
        for row in rows:
            which = facet[[row]]
            spot = _project(place[[index]], facets, frames, which)
            region = _regions(facets, frames, which, which)[0]
            distance.append(
                off[row] + shapely.distance(region, shapely.Point(spot[0])) + size[index] * (1.0 - abs(cosine[row]))
            )
        nearest = rows[int(np.argmin(distance))]
        side[index] = 1.0 if cosine[nearest] >= 0.0 else -1.0
    return np.asarray(side)


def spatial_interfaces(contacts: list[SpatialContact]) -> Interfaces:
    """Local frames and sections: origin at the centroid, e1 along the longest edge, e2 = n × e1.

    contacts: m of them. Returns Interfaces of dimension 3; sizes of rectangles are the means of opposite
    sides, of other polygons extents along e1 and e2. Source: docs/method.md (1.2), (2.2).
    """
    count = len(contacts)
    normal = np.array([c.normal for c in contacts]).reshape(-1, 3)
    polygons = [c.polygon for c in contacts]
    e1, rectangle = np.empty((count, 3)), np.zeros(count, dtype=bool)
    plain = measures.without_idle_corners(polygons, tolerances.FACE)
    for chosen, stack in measures.by_corner_count(plain):
        e1[chosen] = _longest_edge(stack)
        rectangle[chosen] = measures.is_rectangle(stack, tolerances.FACE)
    e1 = _unit(e1 - np.einsum("ij,ij->i", e1, normal)[:, None] * normal)
    e2 = np.cross(normal, e1)
    origin = np.empty((count, 3))
    l1, l2, area, c_t = (np.empty(count) for _ in range(4))
    for chosen, stack in measures.by_corner_count(polygons):
        base = stack[:, :1]
        frame = np.stack([e1[chosen], e2[chosen], normal[chosen]], axis=1)
        local = np.einsum("nkj,nij->nki", stack - base, frame)
        signed = measures.area(local[..., :2])
        turned = signed < 0.0
        local[turned] = local[turned][:, ::-1]
        flat = local[..., :2]
        middle = np.column_stack([measures.centroid(flat), local[..., 2].mean(axis=1)])
        origin[chosen] = base[:, 0] + np.einsum("ni,nij->nj", middle, frame)
        area[chosen] = np.abs(signed)
        c_t[chosen] = measures.torsion_length(flat)
        l1[chosen], l2[chosen] = measures.sizes(flat).T
        for index in chosen[turned]:
            polygons[index] = polygons[index][::-1]
    for chosen, stack in measures.by_corner_count([plain[i] for i in np.flatnonzero(rectangle)]):
        which = np.flatnonzero(rectangle)[chosen]
        one, two = (
            stack[:, 1] - stack[:, 0] + stack[:, 2] - stack[:, 3],
            stack[:, 2] - stack[:, 1] + stack[:, 3] - stack[:, 0],
        )
        along = np.abs(np.einsum("nj,nj->n", one, e1[which])) > np.abs(np.einsum("nj,nj->n", two, e1[which]))
        first, second = 0.5 * np.linalg.norm(one, axis=1), 0.5 * np.linalg.norm(two, axis=1)
        l1[which], l2[which] = np.where(along, first, second), np.where(along, second, first)
        c_t[which] = measures.rectangle_torsion_length(l1[which], l2[which])
    return Interfaces(
        a=np.array([c.a for c in contacts], dtype=np.int64),
        b=np.array([c.b for c in contacts], dtype=np.int64),
        origin=origin,
        normal=normal,
        e1=e1,
        e2=e2,
        l1=l1,
        l2=l2,
        area=area,
        c_t=c_t,
        rectangle=rectangle,
        polygon=tuple(polygons),
    )
