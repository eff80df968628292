"""Contact detection of polygons by distance and overlap of their edges, and the resulting interfaces."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.errors import InputError
from jld_core.geometry import outlines as measures
from jld_core.geometry.outlines import intersections
from jld_core.geometry.polyhedra import Faces, Surface, lay_out, spread
from jld_core.geometry.spatial_contacts import merge_points, near_pairs
from jld_core.geometry.stated_fit import NearMiss, Overlap, refuse_overlaps


@dataclass(frozen=True)
class PlanarContact:
    # a, b: indices of the elements
    a: int
    b: int
    ends: Floats  # (2, 2) end points, scene units
    normal: Floats  # (2,) unit normal from a to b


def without_repeats(polygons: list[Floats]) -> list[Floats]:
    kept = list(polygons)
    for chosen, stack in measures.by_corner_count(polygons):
        step = np.linalg.norm(stack - np.roll(stack, 1, axis=1), axis=2)
        new = step > tolerances.ROUNDING * np.ptp(stack, axis=1).max(axis=1)[:, None]
        for row in np.flatnonzero(~new.all(axis=1)).tolist():
            kept[chosen[row]] = stack[row][new[row]]
    return kept


_NO_AREA: Final = 1e-14  # area of a polygon, over the square of its extent, up to which it has none


def check_polygons(ids: list[str], polygons: list[Floats], within: float = 0.0) -> tuple[str, ...]:
    """Raise InputError for polygons not simple, without area, or overlapping; warn of overlaps up to `within`."""
    count = np.array([len(polygon) for polygon in polygons])
    for few in np.flatnonzero(count < 3)[:1].tolist():
        raise InputError(f"element {ids[few]!r}", "its polygon has no area", "three corners not in a line")
    least_area = _NO_AREA * _spans(polygons) ** 2
    hull = shapely.convex_hull(
        shapely.multipoints(np.concatenate(polygons), indices=np.repeat(np.arange(len(count)), count))
    )
    for thin in np.flatnonzero(~(shapely.area(hull) > least_area))[:1].tolist():
        raise InputError(f"element {ids[thin]!r}", "its polygon has no area", "three corners not in a line")
    shapes = _shapes(polygons)
    size = shapely.area(shapes)
    valid = shapely.is_valid(shapes)
    for bad in np.flatnonzero(~valid | ~(size > least_area))[:1].tolist():
        if valid[bad]:
            raise InputError(f"element {ids[bad]!r}", "its polygon has no area", "a polygon with an area")
        reason = shapely.is_valid_reason(shapes[bad]).split("[")[0].strip().lower() or "not simple"
        raise InputError(
            f"element {ids[bad]!r}", f"its polygon is wrong ({reason})", "an outline that does not meet itself"
        )
    return _refuse_overlaps(ids, shapes, size, within)


def _refuse_overlaps(ids: list[str], shapes: Any, size: Floats, within: float) -> tuple[str, ...]:
    """Raise InputError for polygons (n,) that overlap, with depth and place; warn of depths up to `within`."""
    first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    first, second = first[first < second], second[first < second]
    # Pairs that only touch share no area: excluding them here saves intersections.
    apart = shapely.touches(shapes[first], shapes[second])
    first, second = first[~apart], second[~apart]
    allowed = tolerances.OVERLAP * np.minimum(size[first], size[second])
    # Test in floating point first, which is fast; confirm apparent overlaps on a grid.
    over = shapely.area(shapely.intersection(shapes[first], shapes[second])) > allowed
    first, second, allowed = first[over], second[over], allowed[over]
    regions = intersections(shapes[first], shapes[second])
    over = np.flatnonzero(shapely.area(regions) > allowed)
    pairs = []
    for k in sorted(over.tolist(), key=lambda k: (first[k], second[k])):
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(regions[k]))
        sides = np.hypot(*(box[1:3] - box[:2]).T) if len(box) > 3 else np.zeros(1)
        place = shapely.get_coordinates(shapely.point_on_surface(regions[k]))[0]
        pairs.append(Overlap(ids[first[k]], ids[second[k]], float(sides.min()), place))
    return refuse_overlaps(pairs, "elements that touch along edges at the most", within)


def find_planar_contacts(polygons: list[Floats]) -> list[PlanarContact]:
    """Find all straight contacts between counter-clockwise polygons (k, 2), by (a, b), then along the outline of a.

    Pieces that join end to end in a line are one contact, for example at a T-joint or at a vertex in a straight edge.
    Source: interface frame of Iannuzzo et al. 2024, with normals from element faces.
    """
    near = _near(_shapes(polygons), tolerances.CONTACT * _spans(polygons))
    contacts = []
    for pair, pieces in _touching_pieces(polygons, near):
        a, b = near[pair].tolist()
        contacts += [PlanarContact(a, b, ends, normal) for ends, normal in _join_in_line(pieces)]
    return contacts


def _near(shapes: Any, reach: Floats) -> Ints:
    """Return the sorted pairs (p, 2) with a < b of polygons whose enlarged boxes meet."""
    x0, y0, x1, y1 = shapely.bounds(shapes).T
    boxes = shapely.box(x0 - reach, y0 - reach, x1 + reach, y1 + reach)
    left, right = shapely.STRtree(shapes).query(boxes)
    low, high = np.minimum(left, right), np.maximum(left, right)
    return np.unique(np.column_stack([low, high])[low < high], axis=0).reshape(-1, 2)


def _spans(polygons: list[Floats]) -> Floats:
    """Return the diagonals (n,) of bounding boxes, which no edge exceeds."""
    every = np.concatenate(polygons)
    start = np.cumsum([0, *(len(p) for p in polygons[:-1])])
    return np.asarray(np.hypot(*(np.maximum.reduceat(every, start) - np.minimum.reduceat(every, start)).T))


def _shapes(polygons: list[Floats]) -> Any:
    count = np.array([len(polygon) for polygon in polygons])
    owner = np.repeat(np.arange(len(count)), count)
    return shapely.polygons(shapely.linearrings(np.concatenate(polygons), indices=owner))


@dataclass(frozen=True)
class _FacingEdges:
    """Pairs of opposite edges of near polygons, with the length over which they overlap."""

    pair: Ints  # (k,) row of the pair of polygons
    ends: Floats  # (k, 2, 2) of the overlap, on the edge of the first
    outward: Floats  # (k, 2) normal of that edge
    offset: Floats  # (k,) signed distance to the other edge, at the end of the overlap where it is larger in magnitude
    least: Floats  # (k,) smaller distance of both ends, without sign; 0 where the edges cross
    length: Floats  # (k,) of the shorter edge
    between: Floats  # (k, 2) point half-way between the edges, where they are at least a quarter of `offset` apart


def _facing_edges(polygons: list[Floats], near: Ints, share: float) -> _FacingEdges:
    """Find opposite edges of pairs (p, 2) that overlap and are close, relative to the shorter one."""
    count = np.array([len(polygon) for polygon in polygons])
    first = np.concatenate([[0], np.cumsum(count)])
    start = np.concatenate(polygons)
    onward = np.arange(len(start)) + 1
    onward[first[1:] - 1] = first[:-1]
    edge = start[onward] - start
    length = np.hypot(*edge.T)
    unit = edge / length[:, None]
    outward = np.column_stack([unit[:, 1], -unit[:, 0]])
    # Compare every edge i of the first polygon with every edge j of the second, pair by pair.
    pair, number = spread(np.zeros(len(near), dtype=np.int64), count[near[:, 0]] * count[near[:, 1]])
    of_second = count[near[pair, 1]]
    i, j = first[near[pair, 0]] + number // of_second, first[near[pair, 1]] + number % of_second
    opposite = np.einsum("ij,ij->i", unit[i], unit[j]) < 0.0
    pair, i, j = pair[opposite], i[opposite], j[opposite]
    reach = share * np.minimum(length[i], length[j])
    # ends of edge j along edge i from its start, and their signed distances from it
    offset = start[j] - start[i]
    along0, off0 = np.einsum("ij,ij->i", offset, unit[i]), np.einsum("ij,ij->i", offset, outward[i])
    along1 = along0 + np.einsum("ij,ij->i", unit[i], edge[j])
    off1 = off0 + np.einsum("ij,ij->i", outward[i], edge[j])
    low = np.maximum(along1, 0.0)
    high = np.minimum(along0, length[i])
    # Distances are measured within the overlap: a long edge at a very small angle is thus judged by the contact, not by
    # its far end.
    slope = (off1 - off0) / np.where(along1 == along0, 1.0, along1 - along0)
    ends_off = np.stack([off0 + slope * (low - along0), off0 + slope * (high - along0)])
    apart = abs(ends_off).max(axis=0)
    hit = np.flatnonzero((high - low > reach) & (apart <= reach))
    pair, i, j = pair[hit], i[hit], j[hit]
    ends = np.stack([start[i] + low[hit, None] * unit[i], start[i] + high[hit, None] * unit[i]], axis=1)
    first_off, last_off = ends_off[:, hit]
    smaller_off = np.where(first_off * last_off < 0.0, 0.0, abs(ends_off[:, hit]).min(axis=0))
    between, larger_off = _half_way(ends, outward[i], first_off, last_off)
    return _FacingEdges(pair, ends, outward[i], larger_off, smaller_off, np.minimum(length[i], length[j]), between)


def _half_way(ends: Floats, outward: Floats, first_off: Floats, last_off: Floats) -> tuple[Floats, Floats]:
    """Return points (k, 2) between overlaps (k, 2, 2) and edges at these distances (k,), and the larger distances."""
    at_first = abs(first_off) >= abs(last_off)
    far, close = np.where(at_first, first_off, last_off), np.where(at_first, last_off, first_off)
    # Edges that cross near their middle have no room there: the point moves towards the end that is farther apart.
    towards_far = np.where(close * np.sign(far) >= -0.5 * abs(far), 0.5, 0.75)
    place = np.where(at_first, 1.0 - towards_far, towards_far)[:, None]
    half_way = 0.5 * (close + towards_far * (far - close))
    return np.asarray(ends[:, 0] + place * (ends[:, 1] - ends[:, 0]) + half_way[:, None] * outward), np.asarray(far)


def _touching_pieces(polygons: list[Floats], near: Ints) -> Iterator[tuple[int, list[tuple[Floats, Floats]]]]:
    """Yield each touching pair of `near` (p, 2), with ends and outward normals of overlaps, in edge order."""
    facing = _facing_edges(polygons, near, tolerances.CONTACT)
    ends = facing.ends + (0.5 * facing.offset[:, None] * facing.outward)[:, None]
    cuts = np.flatnonzero(np.diff(facing.pair, prepend=-1)).tolist()
    for a, b in itertools.pairwise([*cuts, len(facing.pair)]):
        yield int(facing.pair[a]), [(ends[k], facing.outward[k]) for k in range(a, b)]


def near_misses(polygons: list[Floats]) -> list[NearMiss]:
    """Find edges that face one another and nearly touch, but form no contact."""
    # Edges nearly touch that are apart by less than `tolerances.NEAR` of their length. So do edges that touch at one
    # end and open by less than `tolerances.WEDGE` of it at the other. Gaps filled by another element are left out.
    shapes = _shapes(polygons)
    near = _near(shapes, tolerances.WEDGE * _spans(polygons))
    facing = _facing_edges(polygons, near, tolerances.WEDGE)
    gap, length = abs(facing.offset), facing.length
    touching = facing.least <= tolerances.CONTACT * length
    close = (gap > tolerances.CONTACT * length) & (touching | (gap <= tolerances.NEAR * length))
    kept = np.flatnonzero(close)
    middle = facing.between[kept]
    # A middle within an element is no gap: a plate lies between, or both overlap by less than what is refused.
    covered = np.zeros(len(kept), dtype=bool)
    covered[shapely.STRtree(shapes).query(shapely.points(middle), predicate="within")[0]] = True
    kept, middle = kept[~covered], middle[~covered]
    across = np.hypot(*(facing.ends[kept, 1] - facing.ends[kept, 0]).T)
    angle = np.where(touching[kept], np.degrees(np.arctan2(gap[kept], across)), 0.0).tolist()
    first, second = near[facing.pair[kept]].T.tolist()
    misses = [NearMiss(*values) for values in zip(first, second, gap[kept].tolist(), middle, angle, strict=True)]
    return sorted(misses, key=lambda miss: (miss.a, miss.b))


def _join_in_line(pieces: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Join pieces (ends, outward normal) that continue one another in a straight line."""
    if len(pieces) == 1:
        return pieces
    joined: list[tuple[Floats, Floats]] = []
    for ends, normal in pieces:
        for index, (others, other) in enumerate(joined):
            reach = tolerances.CONTACT * max(np.hypot(*(ends[1] - ends[0])), np.hypot(*(others[1] - others[0])))
            # Compare the sine of the kink: its cosine would accept angles up to the square root of the tolerance.
            if normal @ other <= 0.0 or abs(normal[0] * other[1] - normal[1] * other[0]) > tolerances.CONTACT:
                continue
            if np.hypot(*(others[1] - ends[0])) <= reach:
                joined[index] = (np.array([others[0], ends[1]]), other)
                break
            if np.hypot(*(ends[1] - others[0])) <= reach:
                joined[index] = (np.array([ends[0], others[1]]), other)
                break
        else:
            joined.append((ends, normal))
    if len(joined) < len(pieces) and len(joined) > 1:  # the last piece may close the ring onto the first
        again = _join_in_line(joined)
        return again if len(again) < len(joined) else joined
    return joined


def planar_interfaces(contacts: list[PlanarContact], thickness: float) -> Interfaces:
    """Compute frames and sizes of straight contacts: origin at mid-length, e1 = normal turned by +90°."""
    ends = np.array([c.ends for c in contacts]).reshape(-1, 2, 2)
    normal = np.array([c.normal for c in contacts]).reshape(-1, 2)
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    count = len(contacts)
    return Interfaces(
        a=np.array([c.a for c in contacts], dtype=np.int64),
        b=np.array([c.b for c in contacts], dtype=np.int64),
        origin=ends.mean(axis=1),
        normal=normal,
        e1=np.column_stack([-normal[:, 1], normal[:, 0]]),
        e2=np.empty((count, 0)),
        l1=length,
        l2=np.full(count, thickness),
        area=length * thickness,
        c_t=np.zeros(count),
        rectangle=np.ones(count, dtype=bool),
        polygon=tuple(ends),
    )


def certain_contacts(vertices: list[Floats], faces: list[Faces], support: Bools) -> int:
    """Return a lower bound on contacts between polyhedra: faces of equal corners, or boxes along the axes."""
    surface = lay_out(vertices, faces)
    begin = np.concatenate([[0], np.cumsum([len(v) for v in vertices])])[:-1]
    lower = np.minimum.reduceat(surface.points, begin)
    upper = np.maximum.reduceat(surface.points, begin)
    found = (_equal_faces(surface, upper - lower), _touching_boxes(surface, lower, upper, vertices))
    return max(int(np.count_nonzero(~(support[one] & support[two]))) for one, two in found)


def _equal_faces(surface: Surface, sides: Floats) -> tuple[Ints, Ints]:
    """Return the pairs (p,) of elements that have a face of the same corners; sides: (n, 3) of boxes."""
    node = merge_points(surface.points, tolerances.FACE * float(sides.max(axis=1).min()))[surface.vertex]
    pairs = []
    for corners in np.unique(surface.count).tolist():
        which = np.flatnonzero(surface.count == corners)
        keys = np.sort(node[surface.start[which, None] + np.arange(corners)], axis=1)
        order = np.lexsort(keys.T)
        same = np.flatnonzero(np.all(keys[order[1:]] == keys[order[:-1]], axis=1))
        owner = surface.element[which[order]]
        pairs.append(np.sort(np.stack([owner[same], owner[same + 1]], axis=1), axis=1))
    all_pairs = np.concatenate(pairs)
    first, second = np.unique(all_pairs[all_pairs[:, 0] < all_pairs[:, 1]], axis=0).T
    return first, second


def _touching_boxes(surface: Surface, lower: Floats, upper: Floats, vertices: Sequence[Floats]) -> tuple[Ints, Ints]:
    """Return the pairs (p,) of boxes along the axes that touch along an area; corners (n, 3)."""
    size = (upper - lower).max(axis=1)
    owner = np.repeat(np.arange(len(size)), [len(v) for v in vertices])
    off = np.minimum(np.abs(surface.points - lower[owner]), np.abs(upper[owner] - surface.points)).max(axis=1)
    wrong = np.bincount(owner, weights=off > tolerances.FACE * size[owner], minlength=len(size))
    # Six faces whose corners are all corners of the bounding box, eight of them: a box.
    six = np.bincount(surface.element, minlength=len(size)) == 6
    eight = np.bincount(owner, minlength=len(size)) == 8
    box = np.flatnonzero((wrong == 0.0) & six & eight)
    if len(box) < 2:
        return box[:0], box[:0]
    reach = tolerances.FACE * size
    left, right = near_pairs(lower[box], upper[box], reach[box])
    first, second = box[left], box[right]
    depth = np.sort(np.minimum(upper[first], upper[second]) - np.maximum(lower[first], lower[second]), axis=1)
    touching = (np.abs(depth[:, 0]) <= np.minimum(reach[first], reach[second])) & (depth[:, 1] > 1e2 * reach[first])
    return first[touching], second[touching]
