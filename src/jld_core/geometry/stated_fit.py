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
        heights = [height + slope * (place - first) for place in (low, high)]
        if high > low and max(abs(one) for one in heights) <= _OFF * length:
            edges.append((heights, low, high))
    uncovered, off = [(0.0, length)], list[float]()
    # an edge beside the contact, as that of a step, counts only where no nearer one lies
    for heights, low, high in sorted(edges, key=lambda edge: max(abs(height) for height in edge[0])):
        if any(min(high, b) - max(low, a) > tolerances.FACE * length for a, b in uncovered):
            off += heights
        uncovered = [part for a, b in uncovered for part in ((a, min(b, low)), (max(a, high), b)) if part[1] > part[0]]
    beyond = sum(b - a for a, b in uncovered)
    return Fit(length, beyond, max([0.0, *off]), max([0.0, *(-height for height in off)]))


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
    regions, off = list[shapely.Geometry](), list[float]()
    # as for lines, a facet counts only where no nearer one lies
    for heights, region, shared in sorted(facets, key=lambda facet: float(abs(facet[0]).max())):
        near = shapely.union_all(regions, grid_size=grid) if regions else None
        if near is None or (
            shapely.difference(area_of(shared), near, grid_size=grid).area > tolerances.FACE * stated.area
        ):
            off += heights.tolist()
        regions.append(region)
    beyond = 0.0 if regions else size
    if regions and not any(shapely.covers(region, stated) for region in regions):
        faces = shapely.union_all(regions, grid_size=grid)
        outside = shapely.get_coordinates(shapely.difference(stated, faces, grid_size=grid))
        beyond = float(shapely.distance(shapely.points(outside), faces).max(initial=0.0))
    return Fit(size, beyond, max([0.0, *off]), max([0.0, *(-height for height in off)]))


class Misfit(InputError):
    """Error for contacts or elements that fit poorly, but within a tolerance above `most`."""

    def __init__(self, where: str, problem: str, expected: str, most: float = 0.0) -> None:
        super().__init__(where, problem, expected)
        self.most = most


def judge_fits(fits: Sequence[tuple[str, str, Fit]], tolerance: float | None, unit: str) -> tuple[str, ...]:
    """Return warnings about poor fits (key, element, fit); InputError, or `Misfit` if a larger tolerance takes all."""
    # misfits that are refused: no tolerance takes them, size, key, problem
    warnings, wrong = list[str](), list[tuple[bool, float, str, str]]()
    for where, name, fit in fits:
        allowed = max(tolerances.FACE * fit.size, tolerance or 0.0)
        no_face = fit.beyond >= fit.size
        cases = (
            (fit.beyond, f"element {name!r} has no face there", no_face),
            (fit.beyond, f"it reaches {fit.beyond:.4g} {unit} beyond the face of element {name!r}", not no_face),
            (fit.depth, f"it lies up to {fit.depth:.4g} {unit} inside element {name!r}", True),
        )
        poor = [(misfit, problem) for misfit, problem, applies in cases if applies and misfit > allowed]
        if not poor:
            if fit.gap > allowed:
                warnings.append(f"{where}: it lies {fit.gap:.4g} {unit} in front of element {name!r}")
            continue
        misfit, problem = poor[0] if no_face else max(poor)
        if misfit > max(tolerances.NEAR * fit.size, tolerance or 0.0):
            wrong.append((misfit > _OFF * fit.size, misfit, where, problem))
        else:
            warnings.append(f"{where}: {problem}")
    if wrong:
        # what no tolerance takes first, then the largest misfit
        far, misfit, where, problem = max(wrong, key=lambda misfit: misfit[:2])
        count = len({key for _, _, key, _ in wrong})
        others = f", the largest misfit of {count} interfaces" if count > 1 and not far else ""
        accept = "" if far else f', or a "tolerance" above {misfit:.2g}'
        expected = f"an interface on the common boundary of its elements{accept}"
        if far:
            raise InputError(where, problem, expected)
        raise Misfit(where, problem + others, expected, misfit)
    return tuple(warnings)


def refuse_crossing(where: str, polygon: Floats, normal: Floats) -> None:
    """Raise InputError for a stated plane contact (k, 3) whose outline crosses itself."""
    flat = (polygon - polygon[0]) @ across(normal).T
    signed = abs(float(area(flat[None])[0]))
    whole = float(area_of(shapely.Polygon(flat)).area)
    if abs(whole - signed) > tolerances.FACE * whole:
        raise InputError(where, "its outline crosses itself", "corners in order around the interface")


def refuse_repeated(pairs: Sequence[tuple[int, int]], places: Sequence[Floats]) -> None:
    """Raise InputError for two contacts of one pair of elements that share more than an end or an edge."""
    known: dict[tuple[int, int], list[int]] = {}
    for second, (a, b) in enumerate(pairs):
        others = known.setdefault((min(a, b), max(a, b)), [])
        for first in others:
            if _cover(places[first], places[second]):
                problem = f"it covers interfaces[{first}] between the same elements"
                raise InputError(f"interfaces[{second}]", problem, "every contact stated once")
        others.append(second)


def _cover(one: Floats, other: Floats) -> bool:
    """Return True if two stated contacts, (2, 2) or (k, 3), share more than an end or an edge."""
    size = min(float(np.linalg.norm(np.ptp(points, axis=0))) for points in (one, other))
    reach = tolerances.FACE * size
    if one.shape[1] == 2:
        along = (one[1] - one[0]) / np.hypot(*(one[1] - one[0]))
        off = (other - one[0]) @ np.array([along[1], -along[0]])
        (low, high), (start, end) = (sorted(((points - one[0]) @ along).tolist()) for points in (one, other))
        return bool(abs(off).max() <= reach and min(high, end) - max(low, start) > reach)
    arm = one - one[0]
    vector = sum((np.cross(a, b) for a, b in pairwise(arm)), start=np.zeros(3))
    normal = vector / np.linalg.norm(vector)
    if abs((other - one[0]) @ normal).max() > reach:
        return False
    axes = across(normal)
    regions = [area_of(shapely.Polygon((points - one[0]) @ axes.T)) for points in (one, other)]
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
    named = [f"by {pair.depth:.3g} at ({_point(pair.place)})" for pair in pairs]
    first = pairs[0]
    also = [f"{p.a!r} and {p.b!r} {how}" for p, how in zip(pairs[1:_NAMED], named[1:_NAMED], strict=True)]
    unnamed = len(pairs) - _NAMED
    problem = f"they overlap {named[0]}" + ("; so do " + ", ".join(also) if also else "")
    problem += f" and {unnamed} more pairs" if unnamed > 0 else ""
    where = f"elements {first.a!r} and {first.b!r}"
    raise Misfit(where, problem, f'{expected}, or a "tolerance" above {deepest:.2g}', deepest)


_CLOSES: Final = 1.1  # factor on the widest gap for a tolerance that closes it


def words_of(misses: Sequence[NearMiss], ids: Sequence[str], unit: str) -> tuple[str, ...]:
    """Describe near misses in one sentence, with their number and the first places."""
    if not misses:
        return ()
    shown = ", ".join(f"{ids[m.a]!r} and {ids[m.b]!r} {_gap(m, unit)}" for m in misses[:_SHOWN])
    widest = max(miss.gap for miss in misses)
    count = (
        f"{len(misses)} pairs of faces nearly touch and are"
        if len(misses) > 1
        else "a pair of faces nearly touches and is"
    )
    more = ", …" if len(misses) > _SHOWN else ""
    return (f'{count} not joined: {shown}{more}; "tolerance": {_CLOSES * widest:.2g} closes such gaps',)


def _gap(miss: NearMiss, unit: str) -> str:
    if miss.angle > 0.0:
        return f"touch at one end and open by {miss.gap:.3g} {unit} ({miss.angle:.2g}°) at ({_point(miss.place)})"
    return f"are {miss.gap:.3g} {unit} apart at ({_point(miss.place)})"


def _point(place: Floats) -> str:
    return ", ".join(f"{value:.{5 if abs(value) < 1e4 else 10}g}" for value in place)


def given_normals(polygons: list[Floats], a: Ints, facets: Facets, where: Callable[[int], str]) -> Floats:
    """Compute outward unit normals (m, 3) of stated contacts; InputError without area, or if not plane."""
    # The stated polygon gives the direction. The face of a that it lies on only gives the sign.
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


_PARALLEL: Final = 0.9  # cosine from which a face is parallel to a contact


def _sides(normal: Floats, place: Floats, size: Floats, a: Ints, facets: Facets) -> Floats:
    """Return +1 (m,) for normals (m, 3) that point out of element a of the contact, else −1."""
    # The nearest face of a decides.
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    owner, facet = spread(start[a], count[a])
    cosine = np.einsum("ij,ij->i", normal[owner], facets.normal[facet])
    off = np.abs(np.einsum("ij,ij->i", place[owner] - facets.origin[facet], facets.normal[facet]))
    outside = np.maximum(facets.lower[facet] - place[owner], place[owner] - facets.upper[facet]).max(axis=1)
    # A body may have faces of both directions in one plane: count the distance of the place from a face's box too.
    far = np.where(np.abs(cosine) < _PARALLEL, np.inf, off + np.maximum(outside, 0.0))
    best = np.minimum.reduceat(far, np.concatenate([[0], np.cumsum(count[a])])[:-1])
    close = far <= (best + tolerances.FACE * size)[owner]
    vote = np.where(close & np.isfinite(far), np.sign(cosine), 0.0)
    plus = np.bincount(owner, weights=np.maximum(vote, 0.0), minlength=len(a))
    minus = np.bincount(owner, weights=np.maximum(-vote, 0.0), minlength=len(a))
    side = np.where(plus >= minus, 1.0, -1.0)
    unclear = np.flatnonzero((plus > 0.0) == (minus > 0.0)).tolist()
    if not unclear:
        return side
    frames = FacetFrames.on(facets)
    for index in unclear:
        # Boxes are ambiguous here: measure distances to the faces themselves, of any direction if none is parallel.
        rows = np.flatnonzero(owner == index)
        distance = []
        for row in rows:
            which = facet[[row]]
            spot = project(place[[index]], facets, frames, which)
            region = regions_in_planes(facets, frames, which, which)[0]
            distance.append(
                off[row] + shapely.distance(region, shapely.Point(spot[0])) + size[index] * (1.0 - abs(cosine[row]))
            )
        nearest = rows[int(np.argmin(distance))]
        side[index] = 1.0 if cosine[nearest] >= 0.0 else -1.0
    return np.asarray(side)
