"""Where elements touch: planar polygons to interfaces with local frames.

Contact is a matter of edges, not of areas, so it is decided by the distance and the overlap of edge pairs
within a tolerance relative to the edges; shapely finds the pairs worth looking at and judges polygons.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.errors import InputError
from jld_core.geometry import polygons as measures
from jld_core.geometry.misfits import NearMiss, Overlap, refuse_overlaps
from jld_core.geometry.overlay import intersections
from jld_core.geometry.polyhedra import spread


@dataclass(frozen=True)
class PlanarContact:
    """A straight contact: element indices, end points (2, 2), and the unit normal from a to b."""

    a: int
    b: int
    ends: Floats
    normal: Floats


def without_repeats(polygons: list[Floats]) -> list[Floats]:
    """Outlines (k, 2) without corners that repeat the one before, such as the first given again at the end."""
    kept = list(polygons)
    for chosen, stack in measures.by_corner_count(polygons):
        step = np.linalg.norm(stack - np.roll(stack, 1, axis=1), axis=2)
        new = step > tolerances.ROUNDING * np.ptp(stack, axis=1).max(axis=1)[:, None]
        for row in np.flatnonzero(~new.all(axis=1)).tolist():
            kept[chosen[row]] = stack[row][new[row]]
    return kept


def check_polygons(ids: list[str], polygons: list[Floats]) -> None:
    """Refuse polygons that are not simple, have no area, or cover one another.

    ids: (n,) names; polygons: n arrays (k, 2), any unit, either sense of rotation.
    Raises InputError naming the element or the pair.
    """
    count = np.array([len(polygon) for polygon in polygons])
    for few in np.flatnonzero(count < 3)[:1].tolist():
        raise InputError(f"element {ids[few]!r}", "its polygon has no area", "three corners not in a line")
    least = 1e-14 * _spans(polygons) ** 2
    hull = shapely.convex_hull(
        shapely.multipoints(np.concatenate(polygons), indices=np.repeat(np.arange(len(count)), count))
    )
    for thin in np.flatnonzero(~(shapely.area(hull) > least))[:1].tolist():
        raise InputError(f"element {ids[thin]!r}", "its polygon has no area", "three corners not in a line")
    shapes = _shapes(polygons)
    size = shapely.area(shapes)
    valid = shapely.is_valid(shapes)
    for bad in np.flatnonzero(~valid | ~(size > least))[:1].tolist():
        if valid[bad]:
            raise InputError(f"element {ids[bad]!r}", "its polygon has no area", "a polygon with an area")
        reason = shapely.is_valid_reason(shapes[bad]).split("[")[0].strip().lower() or "not simple"
        raise InputError(
            f"element {ids[bad]!r}",
            f"its polygon is wrong ({reason})",
            "an outline that does not meet itself",
        )
    _refuse_overlaps(ids, shapes, size)


def _refuse_overlaps(ids: list[str], shapes: Any, size: Floats) -> None:
    """Raise InputError naming the pairs that share an area, with depth and place."""
    left, right = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    left, right = left[left < right], right[left < right]
    # what only touches shares no area: sorting these out first spares the intersections
    apart = shapely.touches(shapes[left], shapes[right])
    left, right = left[~apart], right[~apart]
    most = tolerances.OVERLAP * np.minimum(size[left], size[right])
    # in floating point, fast, and on a grid what seems to overlap
    over = shapely.area(shapely.intersection(shapes[left], shapes[right])) > most
    left, right, most = left[over], right[over], most[over]
    regions = intersections(shapes[left], shapes[right])
    over = np.flatnonzero(shapely.area(regions) > most)
    pairs = []
    for k in sorted(over.tolist(), key=lambda k: (left[k], right[k])):
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(regions[k]))
        sides = np.hypot(*(box[1:3] - box[:2]).T) if len(box) > 3 else np.zeros(1)
        place = shapely.get_coordinates(shapely.point_on_surface(regions[k]))[0]
        pairs.append(Overlap(ids[left[k]], ids[right[k]], float(sides.min()), place))
    refuse_overlaps(pairs, "elements that touch along edges at the most")


def find_planar_contacts(polygons: list[Floats]) -> list[PlanarContact]:
    """All straight contacts between polygons, in order of (a, b) and then along the outline of a.

    polygons: n arrays (k, 2), counter-clockwise. Pieces of one contact that join end to end in a line
    (a corner hanging on the middle of an edge, a vertex without a corner) are one contact; pieces apart
    from one another or around a corner are several.
    Source: interface frame of Iannuzzo et al. 2024, normals from element faces.
    """
    near = _near(_shapes(polygons), tolerances.CONTACT * _spans(polygons))
    found = []
    for pair, pieces in _touching_pieces(polygons, near):
        a, b = near[pair].tolist()
        found += [PlanarContact(a, b, ends, normal) for ends, normal in _join_in_line(pieces)]
    return found


def _near(shapes: Any, reach: Floats) -> Ints:
    """(p, 2) pairs a < b of polygons whose boxes, widened by their reach, meet, sorted."""
    x0, y0, x1, y1 = shapely.bounds(shapes).T
    boxes = shapely.box(x0 - reach, y0 - reach, x1 + reach, y1 + reach)
    left, right = shapely.STRtree(shapes).query(boxes)
    low, high = np.minimum(left, right), np.maximum(left, right)
    return np.unique(np.column_stack([low, high])[low < high], axis=0).reshape(-1, 2)


def _spans(polygons: list[Floats]) -> Floats:
    """(n,) larger side of the bounding box of each polygon."""
    every = np.concatenate(polygons)
    start = np.cumsum([0, *(len(p) for p in polygons[:-1])])
    return np.asarray((np.maximum.reduceat(every, start) - np.minimum.reduceat(every, start)).max(axis=1))


def _shapes(polygons: list[Floats]) -> Any:
    """(n,) shapely polygons."""
    count = np.array([len(polygon) for polygon in polygons])
    owner = np.repeat(np.arange(len(count)), count)
    return shapely.polygons(shapely.linearrings(np.concatenate(polygons), indices=owner))


@dataclass(frozen=True)
class _FacingEdges:
    """Pairs of edges of near polygons that face one another, where they do.

    pair: (k,) row of the pair of polygons. ends: (k, 2, 2) of the overlap, on the edge of the first. outward: (k, 2)
    normal of that edge. offset: (k,) signed distance to the other edge, the larger one of both ends. least: (k,) the
    smaller one, without sign; 0 where the edges cross. length: (k,) of the shorter edge.
    """

    pair: Ints
    ends: Floats
    outward: Floats
    offset: Floats
    least: Floats
    length: Floats


def _facing_edges(polygons: list[Floats], near: Ints, share: float) -> _FacingEdges:
    """Edges that run against one another within a share of the shorter one's length, in order of pairs and edges."""
    count = np.array([len(polygon) for polygon in polygons])
    first = np.concatenate([[0], np.cumsum(count)])
    start = np.concatenate(polygons)
    onward = np.arange(len(start)) + 1
    onward[first[1:] - 1] = first[:-1]
    edge = start[onward] - start
    length = np.hypot(*edge.T)
    unit = edge / length[:, None]
    outward = np.column_stack([unit[:, 1], -unit[:, 0]])
    # every edge of the first against every edge of the second, pair by pair
    pair, number = spread(np.zeros(len(near), dtype=np.int64), count[near[:, 0]] * count[near[:, 1]])
    of_second = count[near[pair, 1]]
    i, j = first[near[pair, 0]] + number // of_second, first[near[pair, 1]] + number % of_second
    opposite = np.einsum("ij,ij->i", unit[i], unit[j]) < 0.0
    pair, i, j = pair[opposite], i[opposite], j[opposite]
    reach = share * np.minimum(length[i], length[j])
    offset = start[j] - start[i]
    along0, off0 = np.einsum("ij,ij->i", offset, unit[i]), np.einsum("ij,ij->i", offset, outward[i])
    along1 = along0 + np.einsum("ij,ij->i", unit[i], edge[j])
    off1 = off0 + np.einsum("ij,ij->i", outward[i], edge[j])
    low = np.maximum(along1, 0.0)
    high = np.minimum(along0, length[i])
    # the distance between the edges is measured where they face one another, so that an edge that is long
    # and turned by a hair is judged by the contact and not by its far end
    slope = (off1 - off0) / np.where(along1 == along0, 1.0, along1 - along0)
    ends_off = np.stack([off0 + slope * (low - along0), off0 + slope * (high - along0)])
    apart = abs(ends_off).max(axis=0)
    hit = np.flatnonzero((high - low > reach) & (apart <= reach))
    pair, i, j = pair[hit], i[hit], j[hit]
    ends = np.stack([start[i] + low[hit, None] * unit[i], start[i] + high[hit, None] * unit[i]], axis=1)
    far = np.where(abs(ends_off[0]) >= abs(ends_off[1]), ends_off[0], ends_off[1])[hit]
    least = np.where(ends_off[0] * ends_off[1] < 0.0, 0.0, abs(ends_off).min(axis=0))[hit]
    return _FacingEdges(pair, ends, outward[i], far, least, np.minimum(length[i], length[j]))


def _touching_pieces(polygons: list[Floats], near: Ints) -> Iterator[tuple[int, list[tuple[Floats, Floats]]]]:
    """Overlaps of the edges of pairs of polygons: (ends along the first's outline, outward normal of the first).

    near: (p, 2) indices of polygons. Yields the pairs that touch, ascending, with their overlaps in order of the
    edges of the first, then of the second.
    """
    facing = _facing_edges(polygons, near, tolerances.CONTACT)
    ends = facing.ends + (0.5 * facing.offset[:, None] * facing.outward)[:, None]
    cuts = np.flatnonzero(np.diff(facing.pair, prepend=-1)).tolist()
    for a, b in itertools.pairwise([*cuts, len(facing.pair)]):
        yield int(facing.pair[a]), [(ends[k], facing.outward[k]) for k in range(a, b)]


def near_misses(polygons: list[Floats]) -> list[NearMiss]:
    """Find edges that run against one another, nearly touch, and are no contact.

    polygons: n arrays (k, 2), counter-clockwise. Edges nearly touch that are apart by less than `tolerances.NEAR` of
    their length, and those that touch at one end and open by less than `tolerances.WEDGE` of it at the other. What has
    another element in between is left out.
    """
    shapes = _shapes(polygons)
    near = _near(shapes, tolerances.WEDGE * _spans(polygons))
    facing = _facing_edges(polygons, near, tolerances.WEDGE)
    gap, length = abs(facing.offset), facing.length
    touching = facing.least <= tolerances.CONTACT * length
    close = (gap > tolerances.CONTACT * length) & (touching | (gap <= tolerances.NEAR * length))
    kept = np.flatnonzero(close)
    middle = facing.ends[kept].mean(axis=1) + 0.5 * facing.offset[kept, None] * facing.outward[kept]
    # inside of an element there is no gap: a plate lies between, or the two overlap by less than is refused
    covered = np.zeros(len(kept), dtype=bool)
    covered[shapely.STRtree(shapes).query(shapely.points(middle), predicate="within")[0]] = True
    kept, middle = kept[~covered], middle[~covered]
    across = np.hypot(*(facing.ends[kept, 1] - facing.ends[kept, 0]).T)
    angle = np.where(touching[kept], np.degrees(np.arctan2(gap[kept], across)), 0.0).tolist()
    one, two = near[facing.pair[kept]].T.tolist()
    found = [NearMiss(*found) for found in zip(one, two, gap[kept].tolist(), middle, angle, strict=True)]
    return sorted(found, key=lambda miss: (miss.a, miss.b))


def _join_in_line(pieces: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Join pieces that continue one another in a straight line."""
    if len(pieces) == 1:
        return pieces
    joined: list[tuple[Floats, Floats]] = []
    for ends, normal in pieces:
        for index, (others, other) in enumerate(joined):
            reach = tolerances.CONTACT * max(np.hypot(*(ends[1] - ends[0])), np.hypot(*(others[1] - others[0])))
            # the sine of the kink: its cosine would let angles pass that are the root of the tolerance
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
    """Local frames of straight contacts: origin at mid-length, e1 = normal turned +90°.

    contacts: m of them; thickness: out-of-plane depth, scene units. Returns Interfaces of dimension 2.
    """
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
