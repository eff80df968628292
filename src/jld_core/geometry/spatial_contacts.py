"""Contact detection of polyhedra: overlaps of opposite, coplanar facets, found by bounding boxes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Interfaces
from jld_core.geometry import outlines as measures
from jld_core.geometry.outlines import clean_parts, intersections
from jld_core.geometry.polyhedra import (
    PARALLEL,
    FacetFrames,
    Facets,
    longest_edge,
    regions_in_planes,
    spread,
    unit_vectors,
)
from jld_core.geometry.stated_fit import NearMiss, Overlap, refuse_overlaps
from jld_core.linalg import components

# Cosine between two facet normals above which the facets cannot be in contact within the tolerance.
_OPPOSITE = -0.999
_LEVEL = 0.05  # distance of two facets from one plane, over their distance and size, up to which they are compared
_AT_ONCE = 20_000  # pairs of elements per batch: cubes have about 25 pairs of facets each, 0.25 kB per pair


@dataclass(frozen=True)
class SpatialContact:
    # a, b: indices of the elements
    a: int
    b: int
    polygon: Floats  # (k, 3) corners in order, scene units
    normal: Floats  # (3,) unit normal from a to b
    holes: tuple[Floats, ...] = ()  # corners of each hole, in the opposite sense of rotation


class _SlicedBoxes(NamedTuple):
    """Boxes cut to slices across one axis and laid out side by side in the plane of the other two."""

    flat: Any  # (s,) rectangles of all slices of all boxes
    owner: Ints  # (s,) box of each
    sheet: Ints  # (s,) slice that it lies in
    first: Ints  # (n,) first slice of each box

    @classmethod
    def of(cls, low: Floats, high: Floats) -> _SlicedBoxes:
        """Slice boxes with corners `low`, `high` (n, 3)."""
        # The search tree is planar: slice the axis with the fewest layers, along which fewest boxes lie above one
        # another. Boxes then meet only those near them along that axis.
        layers = np.ptp(np.concatenate([low, high]), axis=0) / np.maximum((high - low).mean(axis=0), 1e-300)
        x, y = sorted(np.argsort(layers, kind="stable")[1:])
        z = 3 - x - y
        bottom, height = low[:, z].min(), np.ptp(np.concatenate([low[:, z], high[:, z]]))
        step = max(2.0 * float((high - low)[:, z].mean()), float(height) / len(low)) or 1.0
        first = np.floor((low[:, z] - bottom) / step).astype(np.int64)
        count = np.floor((high[:, z] - bottom) / step).astype(np.int64) - first + 1
        owner, sheet = spread(first, count)
        width = float(np.ptp(np.concatenate([low[:, x], high[:, x]])))
        shift = 2.0 * width * sheet
        rounding = 1e-12 * (float(shift.max()) + float(abs(low[:, x]).max()) + width)
        left, right = low[owner, x] + shift - rounding, high[owner, x] + shift + rounding
        return cls(shapely.box(left, low[owner, y], right, high[owner, y]), owner, sheet, first)


def near_pairs(
    lower: Floats, upper: Floats, reach: Floats, keep: Callable[[Ints, Ints], Bools] | None = None
) -> tuple[Ints, Ints]:
    """Find the pairs left < right (p,), sorted, of boxes that touch or overlap when enlarged by `reach` (n,).

    keep: further condition on pairs, a mask (k,), tested before all pairs are stored.
    """
    low, high = lower - reach[:, None], upper + reach[:, None]
    boxes = _SlicedBoxes.of(low, high)
    tree, pairs = shapely.STRtree(boxes.flat), [np.empty((2, 0), dtype=np.int64)]
    for begin in range(0, len(boxes.flat), _AT_ONCE):
        queried, hit = tree.query(boxes.flat[begin : begin + _AT_ONCE])
        left, right = boxes.owner[queried + begin], boxes.owner[hit]
        # a pair that meets in several slices is taken in the first of them
        in_first_slice = (left < right) & (boxes.sheet[hit] == np.maximum(boxes.first[left], boxes.first[right]))
        left, right = left[in_first_slice], right[in_first_slice]
        touching = np.all((low[left] <= high[right]) & (low[right] <= high[left]), axis=1)
        left, right = left[touching], right[touching]
        if keep is not None:
            accepted = keep(left, right)
            left, right = left[accepted], right[accepted]
        pairs.append(np.stack([left, right]))
    left, right = np.concatenate(pairs, axis=1)
    order = np.lexsort((right, left))
    return left[order], right[order]


def nearer_pairs(lower: Floats, upper: Floats, reach: Floats, pairs: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """Select the pairs (p,) of boxes that touch or overlap within a shorter reach."""
    low, high = lower - reach[:, None], upper + reach[:, None]
    left, right = pairs
    touching = np.all((low[left] <= high[right]) & (low[right] <= high[left]), axis=1)
    return left[touching], right[touching]


def find_spatial_contacts(facets: Facets, pairs: tuple[Ints, Ints]) -> list[SpatialContact]:
    """Find all plane contacts between polyhedra, among sorted pairs a < b; those in several parts are several.

    Source: docs/method.md (1.1), with normals from element faces.
    """
    facet_a, facet_b = _opposite_facets(facets, *pairs)
    if not len(facet_a):
        return []
    frames = FacetFrames.on(facets)
    rectangle = frames.rectangle[facet_a] & frames.rectangle[facet_b]
    contacts: list[tuple[int, SpatialContact]] = []
    rectangular = np.flatnonzero(rectangle)
    is_cut = np.zeros(len(facet_a), dtype=bool)
    if rectangular.size:
        aligned, hits = _cut_rectangles(facets, frames, facet_a[rectangular], facet_b[rectangular])
        is_cut[rectangular[aligned]] = True
        contacts += [(int(rectangular[position]), contact) for position, contact in hits]
    uncut = np.flatnonzero(~is_cut)
    contacts += [
        (int(uncut[position]), contact)
        for position, contact in _cut_polygons(facets, frames, facet_a[uncut], facet_b[uncut])
    ]
    contacts.sort(key=lambda entry: entry[0])
    return [contact for _, contact in contacts]


def near_solids(facets: Facets, pairs: tuple[Ints, Ints]) -> list[NearMiss]:
    """Find facets that face one another, overlap in projection and nearly touch."""
    # Contacts are left out. Facets nearly touch that are apart by less than `tolerances.NEAR` of the smaller one's
    # size. So do facets that touch at one end and open by less than `tolerances.WEDGE` of it at the other.
    facet_a, facet_b = _opposite_facets(facets, *pairs, tolerances.WEDGE)
    size = np.minimum(facets.size[facet_a], facets.size[facet_b])
    cosine = np.einsum("ij,ij->i", facets.normal[facet_a], facets.normal[facet_b])
    parallel = cosine < -1.0 + tolerances.WEDGE**2
    parallel[parallel] = ~_touches_throughout(facets, facet_a[parallel], facet_b[parallel], size[parallel])
    facet_a, facet_b, size = facet_a[parallel], facet_b[parallel], size[parallel]
    if not len(facet_a):
        return []
    frames = FacetFrames.on(facets)
    first, second = (regions_in_planes(facets, frames, chosen, facet_a) for chosen in (facet_a, facet_b))
    shared = intersections(first, second)
    overlapping = np.flatnonzero(shapely.area(shared) > (tolerances.NEAR * size) ** 2).tolist()
    misses = (_near_miss(facets, frames, facet_a[k], facet_b[k], shared[k], size[k]) for k in overlapping)
    return sorted((miss for miss in misses if miss is not None), key=lambda miss: (miss.a, miss.b))


def _touches_throughout(facets: Facets, first: Ints, second: Ints, size: Floats) -> Bools:
    """Return a mask (p,) of facet pairs without a gap; size: of the smaller facet."""
    # All four corners of the second facet lie within half the tolerance of the plane of the first. The mask is False if
    # the second facet has holes or not four corners.
    touches = np.zeros(len(first), dtype=bool)
    row, stack = facets.four
    four_cornered = np.flatnonzero(row[second] >= 0)
    if len(four_cornered):
        corners = stack[row[second[four_cornered]]]
        arm = corners - facets.origin[first[four_cornered], None]
        height = np.abs(np.einsum("nki,ni->nk", arm, facets.normal[first[four_cornered]])).max(axis=1)
        # Half of the tolerance leaves room for rounding.
        touches[four_cornered] = height <= 0.5 * tolerances.FACE * size[four_cornered]
    return touches


def _near_miss(
    facets: Facets, frames: FacetFrames, first: int, second: int, shared: shapely.Geometry, size: float
) -> NearMiss | None:
    """Measure the gap between two facets over a region; None for a contact or a wide gap."""
    axes, normal, slope = np.array([frames.e1[first], frames.e2[first]]), facets.normal[first], facets.normal[second]
    flat = np.concatenate([shapely.get_coordinates(shapely.point_on_surface(shared)), shapely.get_coordinates(shared)])
    points = facets.origin[first] + flat @ axes
    gap = (facets.origin[second] - points) @ slope / (slope @ normal)
    crossing = gap[1:].min() * gap[1:].max() < 0.0
    widest, narrowest = float(abs(gap[1:]).max()), 0.0 if crossing else float(abs(gap[1:]).min())
    touching = narrowest <= tolerances.FACE * size
    if widest <= tolerances.FACE * size or widest > (tolerances.WEDGE if touching else tolerances.NEAR) * size:
        return None
    angle = float(np.degrees(np.arccos(min(1.0, -float(normal @ slope))))) if touching else 0.0
    place = points[0] + 0.5 * gap[0] * normal
    return NearMiss(int(facets.element[first]), int(facets.element[second]), widest, place, angle)


def _opposite_facets(facets: Facets, a: Ints, b: Ints, share: float = tolerances.FACE) -> tuple[Ints, Ints]:
    """Return pairs of facets (r,) of elements a, b (p,) that face one another in nearly one plane.

    share: enlargement of boxes, in facet sizes.
    """
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    reach = share * facets.size
    low, high = facets.lower - reach[:, None], facets.upper + reach[:, None]
    box_low, box_high = np.minimum.reduceat(low, start), np.maximum.reduceat(high, start)

    def within(element: Ints, other: Ints) -> tuple[Ints, Ints]:
        """Return pair positions and facets of elements that meet the box of the other element."""
        owner, facet = spread(start[element], count[element])
        meets = np.all((low[facet] <= box_high[other[owner]]) & (high[facet] >= box_low[other[owner]]), axis=1)
        return owner[meets], facet[meets]

    def facing(a: Ints, b: Ints) -> Ints:
        """Return the opposite facets (2, r) of a batch of element pairs (p,)."""
        owner_a, facet_a = within(a, b)
        owner_b, facet_b = within(b, a)
        # all facets of b for each facet of a of the same pair
        first_b, count_b = np.searchsorted(owner_b, np.arange(len(a))), np.bincount(owner_b, minlength=len(a))
        repeat, position = spread(first_b[owner_a], count_b[owner_a])
        first, second = facet_a[repeat], facet_b[position]
        opposite = np.einsum("ij,ij->i", facets.normal[first], facets.normal[second]) < _OPPOSITE
        first, second = first[opposite], second[opposite]
        boxes = np.all((low[first] <= high[second]) & (low[second] <= high[first]), axis=1)
        first, second = first[boxes], second[boxes]
        offset = facets.origin[second] - facets.origin[first]
        distance = np.abs(np.einsum("ij,ij->i", offset, facets.normal[first]))
        # A wide limit that covers the misalignment accepted above; the gap itself is checked where the facets overlap.
        reach = _LEVEL * (np.linalg.norm(offset, axis=1) + np.minimum(facets.size[first], facets.size[second]))
        return np.stack([first[distance <= reach], second[distance <= reach]])

    batches = [facing(a[k : k + _AT_ONCE], b[k : k + _AT_ONCE]) for k in range(0, len(a), _AT_ONCE)]
    first, second = np.concatenate([np.empty((2, 0), dtype=np.int64), *batches], axis=1)
    return first, second


def _cut_rectangles(
    facets: Facets, frames: FacetFrames, first_facet: Ints, second_facet: Ints
) -> tuple[Bools, list[tuple[int, SpatialContact]]]:
    """Intersect pairs (p,) of parallel rectangles; return their mask (p,) and contacts by position."""
    row, stack = facets.four
    first, second = stack[row[first_facet]], stack[row[second_facet]]
    origin, normal = facets.origin[first_facet], facets.normal[first_facet]
    e1, e2 = frames.e1[first_facet], frames.e2[first_facet]
    side = np.abs(np.einsum("ij,ij->i", e1, frames.e1[second_facet]))
    skew = np.minimum(side, np.abs(np.einsum("ij,ij->i", e2, frames.e1[second_facet])))
    aligned = (skew <= PARALLEL) & (np.einsum("ij,ij->i", normal, facets.normal[second_facet]) < PARALLEL - 1.0)

    def extent(stack: Floats, axis: Floats) -> tuple[Floats, Floats]:
        coordinate = np.einsum("nkj,nj->nk", stack - origin[:, None], axis)
        return coordinate.min(axis=1), coordinate.max(axis=1)

    size = np.minimum(facets.size[first_facet], facets.size[second_facet])
    # sides of the overlap in the frame of the first rectangle, and heights of the second one above it
    (low_1, high_1), (low_2, high_2) = extent(first, e1), extent(second, e1)
    x0, x1 = np.maximum(low_1, low_2), np.minimum(high_1, high_2)
    (low_1, high_1), (low_2, high_2) = extent(first, e2), extent(second, e2)
    y0, y1 = np.maximum(low_1, low_2), np.minimum(high_1, high_2)
    low, high = extent(second, normal)
    reach = tolerances.FACE * size
    in_contact = aligned & (x1 - x0 > reach) & (y1 - y0 > reach) & (np.maximum(abs(low), abs(high)) <= reach)
    mean_height = 0.5 * (low + high)
    corners = np.stack(
        [
            origin + x[:, None] * e1 + y[:, None] * e2 + mean_height[:, None] * normal
            for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        ],
        axis=1,
    )
    element_a, element_b = facets.element[first_facet].tolist(), facets.element[second_facet].tolist()
    hits = [
        (k, SpatialContact(element_a[k], element_b[k], corners[k], normal[k]))
        for k in np.flatnonzero(in_contact).tolist()
    ]
    return aligned, hits


def _cut_polygons(
    facets: Facets, frames: FacetFrames, first_facet: Ints, second_facet: Ints
) -> list[tuple[int, SpatialContact]]:
    """Intersect pairs of facets (p,) of any shape in the plane of the first, with positions."""
    if not len(first_facet):
        return []
    first = regions_in_planes(facets, frames, first_facet, first_facet)
    second = regions_in_planes(facets, frames, second_facet, first_facet)
    shared = intersections(first, second)
    size = np.minimum(facets.size[first_facet], facets.size[second_facet])
    contacts = []
    for position in np.flatnonzero(shapely.area(shared) > 0.0).tolist():
        a, b, reach = first_facet[position], second_facet[position], tolerances.FACE * size[position]
        normal, origin = facets.normal[a], facets.origin[a]
        slope = facets.normal[b] / (facets.normal[b] @ normal)
        axes = np.array([frames.e1[a], frames.e2[a]])
        for shell, holes in clean_parts(shared[position], reach):
            points = origin + shell @ axes
            # the distance to the other facet's plane is measured where both overlap
            gap = (facets.origin[b] - points) @ slope
            if np.max(np.abs(gap)) > reach:
                continue
            lift = 0.5 * gap.mean() * normal
            inner = tuple(origin + hole @ axes + lift for hole in holes)
            contact = SpatialContact(int(facets.element[a]), int(facets.element[b]), points + lift, normal, inner)
            contacts.append((position, contact))
    return contacts


def merge_points(points: Floats, tolerance: float) -> Ints:
    """Assign points to numbered nodes; a point joins the first node within the tolerance.

    Nodes are more than the tolerance apart, and no point is further than the tolerance from its node: chains of
    points do not merge.

    Parameters
    ----------
    points : (n, d) array
        Coordinates.
    tolerance : float
        Length; 0 merges equal points only.

    Returns
    -------
    (n,) int array
        Node of each point, numbered by first appearance.
    """
    unique, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    point = rank[inverse.reshape(-1)]
    if tolerance <= 0.0:
        return point
    ordered = unique[order]
    cluster = _clusters(ordered, tolerance)
    leader = np.unique(cluster, return_index=True)[1][cluster]
    # Points all within the tolerance of the first one of their cluster join it.
    chain = np.zeros(len(leader), dtype=bool)
    chain[leader[np.linalg.norm(ordered - ordered[leader], axis=1) > tolerance]] = True
    chained = np.flatnonzero(chain[leader])
    leader[chained] = chained[_first_within(ordered[chained], tolerance)]
    return np.unique(leader, return_inverse=True)[1][point]


def _clusters(points: Floats, tolerance: float) -> Ints:
    """Return the cluster (n,) of each point (n, d); clusters are further apart than the tolerance."""
    firsts, seconds = [], []
    # Coordinates that differ by less than half a box lie in one box of one of two grids shifted by half a box.
    with np.errstate(over="ignore"):
        scaled = points / max(2.01 * tolerance, 1e-300)
    for shift in itertools.product((0.0, 0.5), repeat=points.shape[1]):
        box = np.floor(scaled + np.array(shift))
        order = np.lexsort(box.T)
        equal = np.flatnonzero(np.all(box[order[1:]] == box[order[:-1]], axis=1))
        firsts.append(order[equal])
        seconds.append(order[equal + 1])
    return components(len(points), np.concatenate(firsts), np.concatenate(seconds))


def _first_within(points: Floats, tolerance: float) -> Ints:
    """Return the point (n,) that each point (n, d) joins, one after the other."""
    # A point joins the first one within the tolerance that joined none, else it joins none and keeps its own index.
    width = max(tolerance, 1e-300)
    # Boxes are as wide as the tolerance, so that all candidates lie in neighbouring boxes: no search is needed.
    boxes: dict[tuple[int, ...], list[int]] = {}
    joined = np.arange(len(points))
    steps = np.array(np.meshgrid(*[[-1, 0, 1]] * points.shape[1])).reshape(points.shape[1], -1).T
    for index, point in enumerate(points):
        with np.errstate(over="ignore"):
            box = np.floor(point / width)
        candidates = [k for step in steps for k in boxes.get(tuple(box + step), ())]
        within = [k for k in candidates if np.linalg.norm(points[k] - point) <= tolerance]
        if within:
            joined[index] = min(within)
        else:
            boxes.setdefault(tuple(box), []).append(index)
    return joined


class _Heights:
    """Heights of the vertices of elements above planes of facets."""

    def __init__(self, vertices: list[Floats], facets: Facets) -> None:
        self._points, self._facets = np.concatenate(vertices), facets
        self._count = np.array([len(v) for v in vertices])
        self._first = np.concatenate([[0], np.cumsum(self._count)])[:-1]

    def of(self, facet: Ints, element: Ints) -> tuple[Floats, Floats]:
        """Return the least and the greatest height (k,) of an element's vertices above each facet's plane."""
        owner, corner = spread(self._first[element], self._count[element])
        arm = self._points[corner] - self._facets.origin[facet[owner]]
        height = np.einsum("ij,ij->i", arm, self._facets.normal[facet[owner]])
        begin = np.concatenate([[0], np.cumsum(self._count[element])])[:-1]
        return np.minimum.reduceat(height, begin), np.maximum.reduceat(height, begin)

    def are_convex(self, start: Ints, span: Floats) -> Bools:
        """Return a mask (n,) of elements none of whose vertices lies before a facet; start: first facet of each."""
        parts = np.array_split(np.arange(len(self._facets)), 1 + len(self._facets) // _FACETS_AT_ONCE)
        bulge = np.concatenate([self.of(part, self._facets.element[part])[1] for part in parts])
        return np.asarray(np.maximum.reduceat(bulge, start) <= tolerances.FACE * span)


# Facets and pairs of elements whose heights are computed at once, for the sake of memory
_FACETS_AT_ONCE = 50_000
_PAIRS_AT_ONCE = 10_000


def check_overlaps(
    ids: list[str], vertices: list[Floats], facets: Facets, pairs: tuple[Ints, Ints], within: float = 0.0
) -> tuple[str, ...]:
    """Raise InputError for convex polyhedra that share a volume; warn of overlaps up to `within`."""
    # Pairs with a polyhedron that is not convex are not checked. Two elements are apart where all of one lies in front
    # of a facet of the other. For the few remaining pairs, a linear program finds the largest ball within both.
    lower = np.array([v.min(axis=0) for v in vertices])
    upper = np.array([v.max(axis=0) for v in vertices])
    span = (upper - lower).max(axis=1)
    a, b = pairs
    reach = tolerances.FACE * np.minimum(span[a], span[b])
    boxes_overlap = np.all(np.minimum(upper[a], upper[b]) - np.maximum(lower[a], lower[b]) > reach[:, None], axis=1)
    a, b, reach = a[boxes_overlap], b[boxes_overlap], reach[boxes_overlap]
    if not len(a):
        return ()
    heights = _Heights(vertices, facets)
    count = np.bincount(facets.element, minlength=len(ids))
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    convex = heights.are_convex(start, span)
    both_convex = convex[a] & convex[b]
    a, b, reach = a[both_convex], b[both_convex], reach[both_convex]
    overlaps = []
    for part in np.array_split(np.arange(len(a)), 1 + len(a) // _PAIRS_AT_ONCE):
        is_separate = np.zeros(len(part), dtype=bool)
        for element, other in ((a[part], b[part]), (b[part], a[part])):
            if len(part):
                owner, facet = spread(start[element], count[element])
                lowest = heights.of(facet, other[owner])[0]
                is_separate |= np.bincount(owner, weights=lowest >= -reach[part][owner], minlength=len(part)) > 0.0
        for index in part[~is_separate].tolist():
            planes = np.flatnonzero((facets.element == a[index]) | (facets.element == b[index]))
            radius, place = _ball(facets, planes)
            if radius > 0.5 * reach[index]:
                overlaps.append(Overlap(ids[a[index]], ids[b[index]], 2.0 * radius, place))
    return refuse_overlaps(overlaps, "elements that touch along faces at the most", within)


def _ball(facets: Facets, planes: Ints) -> tuple[float, Floats]:
    """Return radius and centre of the largest ball behind all planes."""
    # The radius is negative where no such ball exists.
    normal, centre = facets.normal[planes], facets.origin[planes].mean(axis=0)
    distances = np.einsum("ij,ij->i", facets.origin[planes] - centre, normal)
    rows = np.column_stack([normal, np.ones(len(planes))])
    from scipy.optimize import linprog  # loaded on first use: it takes longer than reading most scenes

    answer = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=distances, bounds=[(None, None)] * 4)
    ball_centre = centre if answer.x is None else centre + answer.x[:3]
    return -float(answer.fun or 0.0), np.asarray(ball_centre)


def spatial_interfaces(contacts: list[SpatialContact]) -> Interfaces:
    """Compute frames and sections of contacts without holes; sizes: means of opposite sides, else extents."""
    # The origin lies at the centroid; e1 runs along the longest edge, e2 = n × e1. Source: docs/method.md (1.2), (2.2).
    count = len(contacts)
    normal = np.array([c.normal for c in contacts]).reshape(-1, 3)
    polygons = [measures.keyhole(c.polygon, c.holes) for c in contacts]
    without_holes = np.array([not c.holes for c in contacts], dtype=bool)
    e1, rectangle = np.empty((count, 3)), np.zeros(count, dtype=bool)
    cleaned = measures.without_idle_corners([c.polygon for c in contacts], tolerances.FACE)
    for positions, stack in measures.by_corner_count(cleaned):
        e1[positions] = longest_edge(stack)
        rectangle[positions] = measures.is_rectangle(stack, tolerances.FACE) & without_holes[positions]
    e1 = unit_vectors(e1 - np.einsum("ij,ij->i", e1, normal)[:, None] * normal)
    e2 = np.cross(normal, e1)
    sections = _sections(polygons, e1, e2, normal)
    _set_rectangle_sizes(sections, cleaned, rectangle, e1)
    return Interfaces(
        a=np.array([c.a for c in contacts], dtype=np.int64),
        b=np.array([c.b for c in contacts], dtype=np.int64),
        origin=sections.origin,
        normal=normal,
        e1=e1,
        e2=e2,
        l1=sections.l1,
        l2=sections.l2,
        area=sections.area,
        c_t=sections.c_t,
        rectangle=rectangle,
        polygon=tuple(sections.polygons),
    )


class _Sections(NamedTuple):
    """Centroids (m, 3), extents, areas and torsion lengths (m,) of contacts, and their corners, counter-clockwise."""

    origin: Floats
    l1: Floats
    l2: Floats
    area: Floats
    c_t: Floats
    polygons: list[Floats]


def _sections(polygons: list[Floats], e1: Floats, e2: Floats, normal: Floats) -> _Sections:
    """Compute the sections of contacts with corners (k, 3) and frames (m, 3)."""
    count, polygons = len(polygons), list(polygons)
    origin = np.empty((count, 3))
    l1, l2, area, c_t = (np.empty(count) for _ in range(4))
    for positions, stack in measures.by_corner_count(polygons):
        base = stack[:, :1]
        frame = np.stack([e1[positions], e2[positions], normal[positions]], axis=1)
        local = np.einsum("nkj,nij->nki", stack - base, frame)
        signed = measures.area(local[..., :2])
        is_clockwise = signed < 0.0
        local[is_clockwise] = local[is_clockwise][:, ::-1]
        flat = local[..., :2]
        local_centroid = np.column_stack([measures.centroid(flat), local[..., 2].mean(axis=1)])
        origin[positions] = base[:, 0] + np.einsum("ni,nij->nj", local_centroid, frame)
        area[positions] = np.abs(signed)
        c_t[positions] = measures.torsion_length(flat)
        l1[positions], l2[positions] = measures.sizes(flat).T
        for index in positions[is_clockwise]:
            polygons[index] = polygons[index][::-1]
    return _Sections(origin, l1, l2, area, c_t, polygons)


def _set_rectangle_sizes(sections: _Sections, cleaned: list[Floats], rectangle: Bools, e1: Floats) -> None:
    """Replace extents of rectangles (m,) by means of opposite sides; cleaned: corners but those in straight edges."""
    for positions, stack in measures.by_corner_count([cleaned[i] for i in np.flatnonzero(rectangle)]):
        faces = np.flatnonzero(rectangle)[positions]
        # sums of two opposite sides
        first = stack[:, 1] - stack[:, 0] + stack[:, 2] - stack[:, 3]
        second = stack[:, 2] - stack[:, 1] + stack[:, 3] - stack[:, 0]
        along_e1 = np.abs(np.einsum("nj,nj->n", first, e1[faces])) > np.abs(np.einsum("nj,nj->n", second, e1[faces]))
        first_size, second_size = (0.5 * np.linalg.norm(side, axis=1) for side in (first, second))
        sections.l1[faces] = np.where(along_e1, first_size, second_size)
        sections.l2[faces] = np.where(along_e1, second_size, first_size)
        sections.c_t[faces] = measures.rectangle_torsion_length(sections.l1[faces], sections.l2[faces])
