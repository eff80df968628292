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
    cleaned = list(polygons)
    for positions, stack in measures.by_corner_count(polygons):
        step = np.linalg.norm(stack - np.roll(stack, 1, axis=1), axis=2)
        is_new = step > tolerances.ROUNDING * np.ptp(stack, axis=1).max(axis=1)[:, None]
        for row in np.flatnonzero(~is_new.all(axis=1)).tolist():
            cleaned[positions[row]] = stack[row][is_new[row]]
    return cleaned


_NO_AREA: Final = 1e-14  # area of a polygon, over the square of its extent, up to which it has none


def check_polygons(ids: list[str], polygons: list[Floats], within: float = 0.0) -> tuple[str, ...]:
    """Raise InputError for polygons not simple, without area, or overlapping; warn of overlaps up to `within`."""
    count = np.array([len(polygon) for polygon in polygons])
    for index in np.flatnonzero(count < 3)[:1].tolist():
        raise InputError(f"element {ids[index]!r}", "its polygon has no area", "three corners not in a line")
    least_area = _NO_AREA * _spans(polygons) ** 2
    hull = shapely.convex_hull(
        shapely.multipoints(np.concatenate(polygons), indices=np.repeat(np.arange(len(count)), count))
    )
    for index in np.flatnonzero(~(shapely.area(hull) > least_area))[:1].tolist():
        raise InputError(f"element {ids[index]!r}", "its polygon has no area", "three corners not in a line")
    shapes = _shapes(polygons)
    size = shapely.area(shapes)
    valid = shapely.is_valid(shapes)
    for index in np.flatnonzero(~valid | ~(size > least_area))[:1].tolist():
        if valid[index]:
            raise InputError(f"element {ids[index]!r}", "its polygon has no area", "a polygon with an area")
        reason = shapely.is_valid_reason(shapes[index]).split("[")[0].strip().lower() or "not simple"
        raise InputError(
            f"element {ids[index]!r}", f"its polygon is wrong ({reason})", "an outline that does not meet itself"
        )
    return _refuse_overlaps(ids, shapes, size, within)


def _refuse_overlaps(ids: list[str], shapes: Any, size: Floats, within: float) -> tuple[str, ...]:
    """Raise InputError for polygons (n,) that overlap, with depth and place; warn of depths up to `within`."""
    first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    first, second = first[first < second], second[first < second]
    # Pairs that only touch share no area: excluding them here saves intersections.
    only_touch = shapely.touches(shapes[first], shapes[second])
    first, second = first[~only_touch], second[~only_touch]
    allowed = tolerances.OVERLAP * np.minimum(size[first], size[second])
    # Test in floating point first, which is fast; confirm apparent overlaps on a grid.
    overlaps = shapely.area(shapely.intersection(shapes[first], shapes[second])) > allowed
    first, second, allowed = first[overlaps], second[overlaps], allowed[overlaps]
    regions = intersections(shapes[first], shapes[second])
    overlaps = np.flatnonzero(shapely.area(regions) > allowed)
    pairs = []
    for k in sorted(overlaps.tolist(), key=lambda k: (first[k], second[k])):
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
    corners = np.concatenate(polygons)
    start = np.cumsum([0, *(len(p) for p in polygons[:-1])])
    return np.asarray(np.hypot(*(np.maximum.reduceat(corners, start) - np.minimum.reduceat(corners, start)).T))


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
    following = np.arange(len(start)) + 1
    following[first[1:] - 1] = first[:-1]
    edge = start[following] - start
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
    start_along, start_height = np.einsum("ij,ij->i", offset, unit[i]), np.einsum("ij,ij->i", offset, outward[i])
    end_along = start_along + np.einsum("ij,ij->i", unit[i], edge[j])
    end_height = start_height + np.einsum("ij,ij->i", outward[i], edge[j])
    low = np.maximum(end_along, 0.0)
    high = np.minimum(start_along, length[i])
    # Distances are measured within the overlap: a long edge at a very small angle is thus judged by the contact, not by
    # its far end.
    slope = (end_height - start_height) / np.where(end_along == start_along, 1.0, end_along - start_along)
    end_heights = np.stack([start_height + slope * (low - start_along), start_height + slope * (high - start_along)])
    distance = abs(end_heights).max(axis=0)
    facing = np.flatnonzero((high - low > reach) & (distance <= reach))
    pair, i, j = pair[facing], i[facing], j[facing]
    ends = np.stack([start[i] + low[facing, None] * unit[i], start[i] + high[facing, None] * unit[i]], axis=1)
    first_height, last_height = end_heights[:, facing]
    smaller_height = np.where(first_height * last_height < 0.0, 0.0, abs(end_heights[:, facing]).min(axis=0))
    between, larger_height = _half_way(ends, outward[i], first_height, last_height)
    shorter = np.minimum(length[i], length[j])
    return _FacingEdges(pair, ends, outward[i], larger_height, smaller_height, shorter, between)


def _half_way(ends: Floats, outward: Floats, first_height: Floats, last_height: Floats) -> tuple[Floats, Floats]:
    """Return points (k, 2) between overlaps (k, 2, 2) and edges at these distances (k,), and the larger distances."""
    at_first = abs(first_height) >= abs(last_height)
    larger, smaller = np.where(at_first, first_height, last_height), np.where(at_first, last_height, first_height)
    # Edges that cross near their middle have no room there: the point moves towards the end that is farther apart.
    share = np.where(smaller * np.sign(larger) >= -0.5 * abs(larger), 0.5, 0.75)
    position = np.where(at_first, 1.0 - share, share)[:, None]
    half_way = 0.5 * (smaller + share * (larger - smaller))
    on_edge = ends[:, 0] + position * (ends[:, 1] - ends[:, 0])
    return np.asarray(on_edge + half_way[:, None] * outward), np.asarray(larger)


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
    nearly_touching = (gap > tolerances.CONTACT * length) & (touching | (gap <= tolerances.NEAR * length))
    rows = np.flatnonzero(nearly_touching)
    middles = facing.between[rows]
    # A middle within an element is no gap: a plate lies between, or both overlap by less than what is refused.
    covered = np.zeros(len(rows), dtype=bool)
    covered[shapely.STRtree(shapes).query(shapely.points(middles), predicate="within")[0]] = True
    rows, middles = rows[~covered], middles[~covered]
    overlap = np.hypot(*(facing.ends[rows, 1] - facing.ends[rows, 0]).T)
    angle = np.where(touching[rows], np.degrees(np.arctan2(gap[rows], overlap)), 0.0).tolist()
    first, second = near[facing.pair[rows]].T.tolist()
    misses = [NearMiss(*values) for values in zip(first, second, gap[rows].tolist(), middles, angle, strict=True)]
    return sorted(misses, key=lambda miss: (miss.a, miss.b))


def _join_in_line(pieces: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Join pieces (ends, outward normal) that continue one another in a straight line."""
    if len(pieces) == 1:
        return pieces
    joined: list[tuple[Floats, Floats]] = []
    for ends, normal in pieces:
        for index, (joined_ends, joined_normal) in enumerate(joined):
            longer = max(np.hypot(*(ends[1] - ends[0])), np.hypot(*(joined_ends[1] - joined_ends[0])))
            reach = tolerances.CONTACT * longer
            # Compare the sine of the kink: its cosine would accept angles up to the square root of the tolerance.
            sine = normal[0] * joined_normal[1] - normal[1] * joined_normal[0]
            if normal @ joined_normal <= 0.0 or abs(sine) > tolerances.CONTACT:
                continue
            if np.hypot(*(joined_ends[1] - ends[0])) <= reach:
                joined[index] = (np.array([joined_ends[0], ends[1]]), joined_normal)
                break
            if np.hypot(*(ends[1] - joined_ends[0])) <= reach:
                joined[index] = (np.array([ends[0], joined_ends[1]]), joined_normal)
                break
        else:
            joined.append((ends, normal))
    if len(joined) < len(pieces) and len(joined) > 1:  # the last piece may close the ring onto the first
        closed = _join_in_line(joined)
        return closed if len(closed) < len(joined) else joined
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
    first_vertex = np.concatenate([[0], np.cumsum([len(v) for v in vertices])])[:-1]
    lower = np.minimum.reduceat(surface.points, first_vertex)
    upper = np.maximum.reduceat(surface.points, first_vertex)
    pairs = (_equal_faces(surface, upper - lower), _touching_boxes(surface, lower, upper, vertices))
    return max(int(np.count_nonzero(~(support[first] & support[second]))) for first, second in pairs)


def _equal_faces(surface: Surface, sides: Floats) -> tuple[Ints, Ints]:
    """Return the pairs (p,) of elements that have a face of the same corners; sides: (n, 3) of boxes."""
    node = merge_points(surface.points, tolerances.FACE * float(sides.max(axis=1).min()))[surface.vertex]
    pairs = []
    for corners in np.unique(surface.count).tolist():
        faces = np.flatnonzero(surface.count == corners)
        keys = np.sort(node[surface.start[faces, None] + np.arange(corners)], axis=1)
        order = np.lexsort(keys.T)
        equal = np.flatnonzero(np.all(keys[order[1:]] == keys[order[:-1]], axis=1))
        owner = surface.element[faces[order]]
        pairs.append(np.sort(np.stack([owner[equal], owner[equal + 1]], axis=1), axis=1))
    all_pairs = np.concatenate(pairs)
    first, second = np.unique(all_pairs[all_pairs[:, 0] < all_pairs[:, 1]], axis=0).T
    return first, second


def _touching_boxes(surface: Surface, lower: Floats, upper: Floats, vertices: Sequence[Floats]) -> tuple[Ints, Ints]:
    """Return the pairs (p,) of boxes along the axes that touch along an area; corners (n, 3)."""
    size = (upper - lower).max(axis=1)
    owner = np.repeat(np.arange(len(size)), [len(v) for v in vertices])
    distance = np.minimum(np.abs(surface.points - lower[owner]), np.abs(upper[owner] - surface.points)).max(axis=1)
    off_box = np.bincount(owner, weights=distance > tolerances.FACE * size[owner], minlength=len(size))
    # Six faces whose corners are all corners of the bounding box, eight of them: a box.
    has_six_faces = np.bincount(surface.element, minlength=len(size)) == 6
    has_eight_corners = np.bincount(owner, minlength=len(size)) == 8
    box = np.flatnonzero((off_box == 0.0) & has_six_faces & has_eight_corners)
    if len(box) < 2:
        return box[:0], box[:0]
    reach = tolerances.FACE * size
    left, right = near_pairs(lower[box], upper[box], reach[box])
    first, second = box[left], box[right]
    depth = np.sort(np.minimum(upper[first], upper[second]) - np.maximum(lower[first], lower[second]), axis=1)
    touching = (np.abs(depth[:, 0]) <= np.minimum(reach[first], reach[second])) & (depth[:, 1] > 1e2 * reach[first])
    return first[touching], second[touching]
