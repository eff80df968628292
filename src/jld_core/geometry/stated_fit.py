"""Misfit between contacts that a scene states and the faces of their elements."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.errors import InputError
from jld_core.geometry import outlines as measures
from jld_core.geometry.outlines import area, area_of, intersections
from jld_core.geometry.polyhedra import FacetFrames, Facets, project, regions_in_planes, spread
from jld_core.geometry.vectors import across

_ALONG: Final = 0.95  # cosine of the angle between two normals from which a stated contact can lie on a face (18°)

_OFF: Final = 0.1  # distance, relative to the contact's size, up to which a stated contact can lie on a face


@dataclass(frozen=True)
class Fit:
    """Misfit of a stated contact and one of its elements, lengths in scene units."""

    size: float  # largest extent of the contact
    # length or distance by which the contact exceeds the faces of the element, see `fit_of_line` and `fit_of_polygon`
    beyond: float
    depth: float  # largest distance of the contact inside the element
    gap: float  # largest distance in front of the element


def fit_of_line(ends: Floats, outward: Floats, outline: Floats) -> Fit:
    """Measure the misfit of a stated contact (2, 2) and the edges of a polygon (k, 2); outward: (2,)."""
    # plain numbers: outlines have few corners, for which arrays take ten times as long
    (x, y), (x1, y1) = ends.tolist()
    out_x, out_y = outward.tolist()
    length = math.hypot(x1 - x, y1 - y)
    along_x, along_y = (x1 - x) / length, (y1 - y) / length
    # edges under the contact: heights at the ends of the common length, and these ends
    edges = list[tuple[list[float], float, float]]()
    corners = outline.tolist()
    for (start_x, start_y), (end_x, end_y) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge_x, edge_y = end_x - start_x, end_y - start_y
        if not edge_y * out_x - edge_x * out_y > _ALONG * math.hypot(edge_x, edge_y):
            continue
        first, reach = (start_x - x) * along_x + (start_y - y) * along_y, edge_x * along_x + edge_y * along_y
        height, slope = (start_x - x) * out_x + (start_y - y) * out_y, (edge_x * out_x + edge_y * out_y) / reach
        low, high = max(min(first, first + reach), 0.0), min(max(first, first + reach), length)
        heights = [height + slope * (coordinate - first) for coordinate in (low, high)]
        if high > low and max(abs(height) for height in heights) <= _OFF * length:
            edges.append((heights, low, high))
    uncovered, heights_at_contact = [(0.0, length)], list[float]()
    # an edge beside the contact, as that of a step, counts only where no nearer one lies
    for heights, low, high in sorted(edges, key=lambda edge: max(abs(height) for height in edge[0])):
        if any(min(high, b) - max(low, a) > tolerances.FACE * length for a, b in uncovered):
            heights_at_contact += heights
        uncovered = [part for a, b in uncovered for part in ((a, min(b, low)), (max(a, high), b)) if part[1] > part[0]]
    beyond = sum(b - a for a, b in uncovered)
    return Fit(length, beyond, max([0.0, *heights_at_contact]), max([0.0, *(-height for height in heights_at_contact)]))


_GRID: Final = 1e-3  # grid of regions, as a share of what contacts may be off


def fit_of_polygon(polygon: Floats, outward: Floats, loops: Sequence[tuple[Floats, ...]], normals: Floats) -> Fit:
    """Measure the misfit of a stated plane contact (k, 3) and the facets of a solid.

    loops: rings of each facet, the outer one first; normals: (f, 3).
    """
    axes, origin = across(outward), polygon[0]
    stated = area_of(shapely.Polygon((polygon - origin) @ axes.T))
    size = float(np.ptp(polygon, axis=0).max())
    # facets under the contact: heights of their common region, the facet enlarged by rounding, the region
    facets = list[tuple[Floats, shapely.Polygon, shapely.Geometry]]()
    for rings, normal in zip(loops, normals, strict=True):
        if normal @ outward < _ALONG:
            continue
        flat = [(ring - origin) @ axes.T for ring in rings]
        region = area_of(shapely.Polygon(flat[0], flat[1:]))
        shared = intersections([stated], [region])[0]
        if not shared.area > tolerances.FACE**2 * stated.area:
            continue
        points = origin + shapely.get_coordinates(shared) @ axes
        # heights of the facet over the contact, > 0 where the contact lies in the element
        heights = (rings[0].mean(axis=0) - points) @ normal / (outward @ normal)
        if abs(heights).max() <= _OFF * size:
            facets.append((heights, shapely.buffer(region, tolerances.FACE * size, join_style="mitre"), shared))
    grid = _GRID * tolerances.FACE * size
    regions, heights_at_contact = list[shapely.Geometry](), list[float]()
    # as for lines, a facet counts only where no nearer one lies
    for heights, region, shared in sorted(facets, key=lambda facet: float(abs(facet[0]).max())):
        covered = shapely.union_all(regions, grid_size=grid) if regions else None
        if covered is None or (
            shapely.difference(area_of(shared), covered, grid_size=grid).area > tolerances.FACE * stated.area
        ):
            heights_at_contact += heights.tolist()
        regions.append(region)
    beyond = 0.0 if regions else size
    if regions and not any(shapely.covers(region, stated) for region in regions):
        faces = shapely.union_all(regions, grid_size=grid)
        outside = shapely.get_coordinates(shapely.difference(stated, faces, grid_size=grid))
        beyond = float(shapely.distance(shapely.points(outside), faces).max(initial=0.0))
    return Fit(size, beyond, max([0.0, *heights_at_contact]), max([0.0, *(-height for height in heights_at_contact)]))


class Misfit(InputError):
    """Error for contacts or elements that fit poorly, but within a tolerance above `most`."""

    def __init__(self, where: str, problem: str, expected: str, most: float = 0.0) -> None:
        super().__init__(where, problem, expected)
        self.most = most


def judge_fits(fits: Sequence[tuple[str, str, Fit]], tolerance: float | None, unit: str) -> tuple[str, ...]:
    """Return warnings about poor fits (key, element, fit); InputError, or `Misfit` if a larger tolerance takes all."""
    # misfits that are refused: no tolerance takes them, size, key, problem
    warnings, refused = list[str](), list[tuple[bool, float, str, str]]()
    for where, name, fit in fits:
        allowed = max(tolerances.FACE * fit.size, tolerance or 0.0)
        no_face = fit.beyond >= fit.size
        cases = (
            (fit.beyond, f"element {name!r} has no face there", no_face),
            (fit.beyond, f"it reaches {fit.beyond:.4g} {unit} beyond the face of element {name!r}", not no_face),
            (fit.depth, f"it lies up to {fit.depth:.4g} {unit} inside element {name!r}", True),
        )
        exceeded = [(misfit, problem) for misfit, problem, applies in cases if applies and misfit > allowed]
        if not exceeded:
            if fit.gap > allowed:
                warnings.append(f"{where}: it lies {fit.gap:.4g} {unit} in front of element {name!r}")
            continue
        misfit, problem = exceeded[0] if no_face else max(exceeded)
        if misfit > max(tolerances.NEAR * fit.size, tolerance or 0.0):
            refused.append((misfit > _OFF * fit.size, misfit, where, problem))
        else:
            warnings.append(f"{where}: {problem}")
    if refused:
        # what no tolerance takes first, then the largest misfit
        not_on_face, misfit, where, problem = max(refused, key=lambda misfit: misfit[:2])
        count = len({key for _, _, key, _ in refused})
        count_in_words = f", the largest misfit of {count} interfaces" if count > 1 and not not_on_face else ""
        remedy = "" if not_on_face else f', or a "tolerance" above {misfit:.2g}'
        expected = f"an interface on the common boundary of its elements{remedy}"
        if not_on_face:
            raise InputError(where, problem, expected)
        raise Misfit(where, problem + count_in_words, expected, misfit)
    return tuple(warnings)


def refuse_crossing(where: str, polygon: Floats, normal: Floats) -> None:
    """Raise InputError for a stated plane contact (k, 3) whose outline crosses itself."""
    flat = (polygon - polygon[0]) @ across(normal).T
    signed = abs(float(area(flat[None])[0]))
    total = float(area_of(shapely.Polygon(flat)).area)
    if abs(total - signed) > tolerances.FACE * total:
        raise InputError(where, "its outline crosses itself", "corners in order around the interface")


def refuse_repeated(pairs: Sequence[tuple[int, int]], places: Sequence[Floats]) -> None:
    """Raise InputError for two contacts of one pair of elements that share more than an end or an edge."""
    contacts_of_pair: dict[tuple[int, int], list[int]] = {}
    for second, (a, b) in enumerate(pairs):
        earlier = contacts_of_pair.setdefault((min(a, b), max(a, b)), [])
        for first in earlier:
            if _cover(places[first], places[second]):
                problem = f"it covers interfaces[{first}] between the same elements"
                raise InputError(f"interfaces[{second}]", problem, "every contact stated once")
        earlier.append(second)


def _cover(first: Floats, second: Floats) -> bool:
    """Return True if two stated contacts, (2, 2) or (k, 3), share more than an end or an edge."""
    size = min(float(np.linalg.norm(np.ptp(points, axis=0))) for points in (first, second))
    reach = tolerances.FACE * size
    if first.shape[1] == 2:
        direction = (first[1] - first[0]) / np.hypot(*(first[1] - first[0]))
        distance = (second - first[0]) @ np.array([direction[1], -direction[0]])
        (low, high), (start, end) = (sorted(((points - first[0]) @ direction).tolist()) for points in (first, second))
        return bool(abs(distance).max() <= reach and min(high, end) - max(low, start) > reach)
    arm = first - first[0]
    vector = sum((np.cross(a, b) for a, b in pairwise(arm)), start=np.zeros(3))
    normal = vector / np.linalg.norm(vector)
    if abs((second - first[0]) @ normal).max() > reach:
        return False
    axes = across(normal)
    regions = [area_of(shapely.Polygon((points - first[0]) @ axes.T)) for points in (first, second)]
    return bool(intersections(regions[:1], regions[1:])[0].area > reach * size)


_NAMED: Final = 10  # largest number of pairs named in an error message
_SHOWN: Final = 3  # largest number of pairs named in a warning


@dataclass(frozen=True)
class Overlap:
    """Two elements that share an area or a volume."""

    # a, b: names of the elements
    a: str
    b: str
    depth: float  # depth of the overlap, length
    place: Floats  # (d,) a point of the overlap


@dataclass(frozen=True)
class NearMiss:
    """Two elements with faces that nearly touch."""

    # a, b: indices of the elements
    a: int
    b: int
    gap: float  # largest distance of the faces, length
    place: Floats  # (d,) a point between them
    angle: float = 0.0  # between faces that touch at one end and open towards the other, degrees; else 0


def refuse_overlaps(pairs: Sequence[Overlap], expected: str, within: float) -> tuple[str, ...]:
    """Return a warning about overlaps up to `within`; Misfit for more, naming up to ten pairs."""
    deepest = max((pair.depth for pair in pairs), default=0.0)
    if not pairs or deepest <= within:
        return (f"{len(pairs)} pairs of elements overlap, by up to {deepest:.3g}",) if pairs else ()
    places_in_words = [f"by {pair.depth:.3g} at ({_point(pair.place)})" for pair in pairs]
    first = pairs[0]
    named = zip(pairs[1:_NAMED], places_in_words[1:_NAMED], strict=True)
    further = [f"{p.a!r} and {p.b!r} {place}" for p, place in named]
    unnamed = len(pairs) - _NAMED
    problem = f"they overlap {places_in_words[0]}" + ("; so do " + ", ".join(further) if further else "")
    problem += f" and {unnamed} more pairs" if unnamed > 0 else ""
    where = f"elements {first.a!r} and {first.b!r}"
    raise Misfit(where, problem, f'{expected}, or a "tolerance" above {deepest:.2g}', deepest)


_CLOSES: Final = 1.1  # factor on the widest gap for a tolerance that closes it


def words_of(misses: Sequence[NearMiss], ids: Sequence[str], unit: str) -> tuple[str, ...]:
    """Describe near misses in one sentence, with their number and the first places."""
    if not misses:
        return ()
    named = ", ".join(f"{ids[m.a]!r} and {ids[m.b]!r} {_gap(m, unit)}" for m in misses[:_SHOWN])
    widest = max(miss.gap for miss in misses)
    count = (
        f"{len(misses)} pairs of faces nearly touch and are"
        if len(misses) > 1
        else "a pair of faces nearly touches and is"
    )
    ellipsis = ", …" if len(misses) > _SHOWN else ""
    return (f'{count} not joined: {named}{ellipsis}; "tolerance": {_CLOSES * widest:.2g} closes such gaps',)


def _gap(miss: NearMiss, unit: str) -> str:
    if miss.angle > 0.0:
        return f"touch at one end and open by {miss.gap:.3g} {unit} ({miss.angle:.2g}°) at ({_point(miss.place)})"
    return f"are {miss.gap:.3g} {unit} apart at ({_point(miss.place)})"


def _point(place: Floats) -> str:
    return ", ".join(f"{value:.{5 if abs(value) < 1e4 else 10}g}" for value in place)


def given_normals(polygons: list[Floats], a: Ints, facets: Facets, where: Callable[[int], str]) -> Floats:
    """Compute outward unit normals (m, 3) of stated contacts; InputError without area, or if not plane."""
    # The stated polygon gives the direction. The face of a that it lies on only gives the sign.
    normal, centre, size = np.empty((len(a), 3)), np.empty((len(a), 3)), np.empty(len(a))
    for positions, stack in measures.by_corner_count(polygons):
        arm = stack - stack[:, :1]
        vector = 0.5 * np.cross(arm, np.roll(arm, -1, axis=1)).sum(axis=1)
        area = np.linalg.norm(vector, axis=1)
        extent = np.ptp(stack, axis=1).max(axis=1)
        for index in positions[~(2.0 * area > tolerances.FACE * extent**2)][:1]:
            raise InputError(f"{where(int(index))}.polygon", "it has no area", "three or more corners in order")
        normal[positions] = vector / area[:, None]
        height = np.abs(np.einsum("nkj,nj->nk", stack - stack.mean(axis=1)[:, None], normal[positions])).max(axis=1)
        for index in positions[height > tolerances.FACE * extent][:1]:
            raise InputError(f"{where(int(index))}.polygon", "its corners do not lie in a plane", "a plane polygon")
        centre[positions], size[positions] = stack.mean(axis=1), extent
    return normal * _sides(normal, centre, size, a, facets)[:, None]


_PARALLEL: Final = 0.9  # cosine from which a face is parallel to a contact


def _sides(normal: Floats, centre: Floats, size: Floats, a: Ints, facets: Facets) -> Floats:
    """Return +1 (m,) for normals (m, 3) that point out of element a of the contact, else −1."""
    # The nearest face of a decides.
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    owner, facet = spread(start[a], count[a])
    cosine = np.einsum("ij,ij->i", normal[owner], facets.normal[facet])
    distance = np.abs(np.einsum("ij,ij->i", centre[owner] - facets.origin[facet], facets.normal[facet]))
    outside = np.maximum(facets.lower[facet] - centre[owner], centre[owner] - facets.upper[facet]).max(axis=1)
    # A body may have faces of both directions in one plane: count the distance of the place from a face's box too.
    total_distance = np.where(np.abs(cosine) < _PARALLEL, np.inf, distance + np.maximum(outside, 0.0))
    least = np.minimum.reduceat(total_distance, np.concatenate([[0], np.cumsum(count[a])])[:-1])
    nearest_faces = total_distance <= (least + tolerances.FACE * size)[owner]
    vote = np.where(nearest_faces & np.isfinite(total_distance), np.sign(cosine), 0.0)
    votes_for = np.bincount(owner, weights=np.maximum(vote, 0.0), minlength=len(a))
    votes_against = np.bincount(owner, weights=np.maximum(-vote, 0.0), minlength=len(a))
    side = np.where(votes_for >= votes_against, 1.0, -1.0)
    unclear = np.flatnonzero((votes_for > 0.0) == (votes_against > 0.0)).tolist()
    if not unclear:
        return side
    frames = FacetFrames.on(facets)
    for index in unclear:
        # Boxes are ambiguous here: measure distances to the faces themselves, of any direction if none is parallel.
        rows = np.flatnonzero(owner == index)
        distance_to_face = []
        for row in rows:
            facet_row = facet[[row]]
            point = project(centre[[index]], facets, frames, facet_row)
            region = regions_in_planes(facets, frames, facet_row, facet_row)[0]
            distance_to_face.append(
                distance[row]
                + shapely.distance(region, shapely.Point(point[0]))
                + size[index] * (1.0 - abs(cosine[row]))
            )
        nearest = rows[int(np.argmin(distance_to_face))]
        side[index] = 1.0 if cosine[nearest] >= 0.0 else -1.0
    return np.asarray(side)
