"""Geometric factor of safety (Heyman): thickness over the least thickness at which a structure stands."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Assembly, Bits, Floats, InputError, Model, ParameterError, Scene, build_assembly, parse_scene
from jld_core.mechanics import require_materials
from jld_core.models import limit_analysis

_NEAR: Final = 1e-6  # distance, relative to the size of a structure, up to which points are one
_SHARP: Final = 0.6  # turn of an outline, radians, from which on it is a corner
Map = Callable[[Floats], Floats]  # points (k, 2) on the middle line for points of a structure
Sizes = tuple[float, float]  # least and largest thickness


@dataclass(frozen=True)
class Middles:
    """Points of each element, those halfway through the thickness, and what the thickness is."""

    # points, middle: (k, d) corners of each element, and where each corner is at thickness 0
    points: list[Floats]
    middle: list[Floats]
    thickness: tuple[float, float]  # least and largest
    across: str  # of what it is the thickness
    near: float  # length below which points coincide

    def scaled(self, element: int, points: Floats, scale: float) -> Floats:
        """Return where points on the outline of an element are when the thickness is scaled."""
        middle = _between(points, self.points[element], self.middle[element], self.near)
        return middle + scale * (points - middle)


def middles_of(assembly: Assembly) -> Middles:
    """Find the middle line or surface; raise InputError where there is none."""
    planar, near = assembly.dimension == 2, _NEAR * assembly.size
    try:
        middles = _chain(assembly, near) if planar else _middles_of_prisms(assembly, near)
    except InputError:
        middles = _whole(assembly, near) if planar else _by_blocks(assembly, near)
    _carry_supports(assembly, middles)
    return middles


def _carry_supports(assembly: Assembly, found: Middles) -> None:
    """Let supports grow with the blocks that they meet."""
    support = assembly.elements.support
    vertices, middles = (
        np.concatenate([points for points, is_support in zip(part, support, strict=True) if not is_support])
        for part in (found.points, found.middle)
    )
    for k in np.flatnonzero(support).tolist():
        away = np.linalg.norm(found.points[k][:, None] - vertices, axis=2)
        meets = away.min(axis=1) <= found.near
        found.middle[k][meets] = middles[away.argmin(axis=1)][meets]


def _between(points: Floats, corners: Floats, middle: Floats, near: float) -> Floats:
    """Return the middles of points on an outline: those of its corners, and of edges in the same proportion."""
    away = np.linalg.norm(points[:, None] - corners, axis=2)
    nearest = np.array(middle[away.argmin(axis=1)])
    for k in np.flatnonzero(away.min(axis=1) > near).tolist():
        best = np.inf
        for i, j in itertools.combinations(range(len(corners)), 2):
            edge = corners[j] - corners[i]
            part = float(np.clip((points[k] - corners[i]) @ edge / (edge @ edge), 0.0, 1.0))
            off = float(np.linalg.norm(corners[i] + part * edge - points[k]))
            if off < best:
                best, nearest[k] = off, (1.0 - part) * middle[i] + part * middle[j]
    return np.asarray(nearest)


# --- blocks one after the other ----------------------------------------------------------------------------


def _joints_of(assembly: Assembly, element: int) -> list[Floats]:
    faces = assembly.interfaces
    joints = np.flatnonzero((faces.a == element) | (faces.b == element)).tolist()
    return [faces.polygon[face] for face in joints if face < assembly.faces]


def _chain(assembly: Assembly, near: float) -> Middles:
    """Return the middle lines of blocks in a row, each between two joints that are whole sides of it."""
    elements, faces = assembly.elements, assembly.interfaces
    middle = [points.copy() for points in elements.shape]
    for k in elements.free.tolist():
        joints = _joints_of(assembly, k)
        middle[k] = _middle_line(elements.shape[k], joints, near, f"element {elements.ids[k]!r}")
    sizes = faces.l1[: assembly.faces]
    return Middles(list(elements.shape), middle, (float(sizes.min()), float(sizes.max())), "blocks", near)


def _middle_line(points: Floats, joints: list[Floats], near: float, where: str) -> Floats:
    """Return the points (k, 2) of a block between two joints that are halfway to its other side."""
    count = len(points)
    edges = [
        i
        for joint in joints
        for i in range(count)
        if {0, 1} == {int(np.argmin(np.linalg.norm(joint - p, axis=1))) for p in (points[i], points[(i + 1) % count])}
        and all(np.linalg.norm(joint - p, axis=1).min() <= near for p in (points[i], points[(i + 1) % count]))
    ]
    if len(edges) == len(joints) == 1 and count == 4:
        edges.append((edges[0] + 2) % 4)  # a free end
    if len(edges) != 2 or len(joints) > 2:
        problem = f"it has {len(joints)} joints, {len(edges)} of which are whole sides of it: no middle line"
        raise InputError(where, problem, "blocks one after the other, each between two joints across the thickness")
    first, second = edges
    side_a = [(first + 1 + j) % count for j in range((second - first - 1) % count + 1)]
    side_b = [(first - j) % count for j in range((first - second - 1) % count + 1)]
    middle = points.copy()
    for side, other in itertools.permutations((side_a, side_b)):
        shares, other_shares = (_along(points[indices]) for indices in (side, other))
        opposite = np.column_stack([np.interp(shares, other_shares, points[other][:, axis]) for axis in (0, 1)])
        middle[side] = 0.5 * (points[side] + opposite)
    return middle


def _along(line: Floats) -> Floats:
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return np.asarray(length / (length[-1] or 1.0))


# --- several blocks through the thickness ------------------------------------------------------------------


def _whole(assembly: Assembly, near: float) -> Middles:
    """Find the middle of a wall, a beam or an arch of several blocks through the thickness, in the plane."""
    elements, faces = assembly.elements, assembly.interfaces
    support = elements.support
    joints = np.flatnonzero((support[faces.a] | support[faces.b])[: assembly.faces]).tolist()
    outlines = [elements.shape[k] for k in elements.free.tolist()]
    middle_of, thickness, across = _of_body(outlines, [faces.polygon[face] for face in joints], near)
    exact = _exact(middle_of, outlines, near)
    middle = [exact(points) if across == "wall" or not is_support else points.copy()
              for points, is_support in zip(elements.shape, support, strict=True)]  # fmt: skip
    return Middles(list(elements.shape), middle, thickness, across, near)


def _exact(middle_of: Map, outlines: Sequence[Floats], near: float) -> Map:
    """Let corners of a block that lie on sides of others stay there."""
    starts = np.concatenate(outlines)
    ends = np.concatenate([np.roll(outline, -1, axis=0) for outline in outlines])
    edges, size = ends - starts, np.linalg.norm(ends - starts, axis=1)

    def middles(points: Floats, depth: int = 8) -> Floats:
        middle = middle_of(points)
        for k, point in enumerate(points) if depth else ():
            part = ((point - starts) * edges).sum(axis=1) / size**2
            off = np.linalg.norm(starts + part[:, None] * edges - point, axis=1)
            inside = np.flatnonzero((off <= near) & (part * size > near) & ((1.0 - part) * size > near))
            if len(inside):
                edge = int(inside[size[inside].argmax()])
                first, second = middles(np.stack([starts[edge], ends[edge]]), depth - 1)
                middle[k] = (1.0 - part[edge]) * first + part[edge] * second
        return middle

    return middles


def _of_body(outlines: Sequence[Floats], contacts: Sequence[Floats], near: float) -> tuple[Map, Sizes, str]:
    """Return the middle line of a body on supports, its least and largest thickness, and what it is."""
    body = shapely.union_all([shapely.Polygon(ring) for ring in outlines], grid_size=1e-3 * near)
    lines = shapely.line_merge(
        shapely.union_all([shapely.LineString(contact) for contact in contacts], grid_size=1e-3 * near)
    )
    straight = [np.array(line.coords) for line in getattr(lines, "geoms", [lines])]
    if body.geom_type != "Polygon":
        raise InputError("elements", "free elements are in several parts: no middle line", "one body on its supports")
    if any(abs(_in_frame(line, line[0], line[-1])[:, 1]).max() > near for line in straight):
        raise InputError("elements", "a contact with supports is bent: no middle line", "straight contacts")
    ends = [line[[0, -1]] for line in straight]
    outline = np.array(body.exterior.simplify(1e-2 * near).coords)[:-1]
    if len(ends) == 1:
        return (*_wall(outline, ends[0], near), "wall")
    base, along = ends[0][0], _unit(ends[0][1] - ends[0][0])
    (reach, off), heights = _in_frame(np.concatenate(ends), *ends[0]).T, _in_frame(outline, *ends[0])[:, 1]
    underside = shapely.LineString(base + np.outer([reach.min(), reach.max()], along))
    if abs(off).max() <= near and body.exterior.buffer(near).covers(underside):
        depth = float(np.ptp(heights))
        return lambda points: base + np.outer((points - base) @ along, along), (depth, depth), "beam"
    if len(ends) > 2:
        raise InputError("elements", f"it rests on supports at {len(ends)} places: no middle line", "one or two")
    return (*_arch(body, outline, ends, near), "arch")


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _in_frame(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return points (k, 2) along a line and to the left of it."""
    direction = _unit(end - start)
    return np.asarray((points - start) @ np.array([direction, [-direction[1], direction[0]]]).T)


def _wall(outline: Floats, base: Floats, near: float) -> tuple[Map, Sizes]:
    """Return the middle of each course of a wall on one support; outline: (k, 2)."""
    if _in_frame(outline, *base)[:, 1].mean() < 0.0:
        base = base[::-1]
    x, y = _in_frame(outline, *base).T
    if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() < 0.0:
        x, y = x[::-1], y[::-1]
    low, high = (np.flatnonzero(abs(y - end) <= near) for end in (0.0, y.max()))

    def side(first: int, last: int) -> Any:
        return (first + np.arange((last - first) % len(x) + 1)) % len(x)

    reach = _in_frame(base, *base)[:, 0]
    if abs(np.sort(reach) - [x[low].min(initial=0.0), x[low].max(initial=0.0)]).max() > near:
        raise InputError("elements", "it does not stand on a whole side: no middle line", "a wall on its support")
    right = side(low[x[low].argmax()], high[x[high].argmax()])
    left = side(high[x[high].argmin()], low[x[low].argmin()])[::-1]
    if y.min() < -near or any((np.diff(y[side_points]) <= near).any() for side_points in (left, right)):
        problem = "its outline has steps, or hangs over its support: no middle line"
        raise InputError("elements", problem, "a wall with two sides from its support to its top")
    direction, levels = _unit(base[1] - base[0]), np.concatenate([y[left], y[right]])

    def halves(height: Floats) -> list[Floats]:
        return [np.interp(height, y[side_points], x[side_points]) for side_points in (left, right)]

    def middle(points: Floats) -> Floats:
        along, height = _in_frame(points, *base).T
        return np.asarray(points + np.outer(0.5 * sum(halves(height)) - along, direction))

    widths = np.subtract(*halves(levels)[::-1])
    return middle, (float(widths.min()), float(widths.max()))


def _arch(body: Any, outline: Floats, ends: Sequence[Floats], near: float) -> tuple[Map, Sizes]:
    """Return the middle line of an arch or frame between its contacts (2, 2) with two supports; outline: (k, 2)."""
    # The outline has two sides between the contacts. Corners of both, equally many, are paired, and points between them
    # by their share of length: this gives chords, and the middle of a point is that of the chord through it.
    points = np.concatenate([*ends, outline])
    owner = np.repeat([0, 1, -1], [2, 2, len(outline)])  # contacts may end within a side of the outline
    order = np.argsort([body.exterior.project(shapely.Point(xy)) for xy in points], kind="stable")
    steps = np.linalg.norm(points[order] - np.roll(points[order], 1, axis=0), axis=1) <= near
    order = order[~(steps & (owner[order] < 0))]
    # a side runs from a contact to the other one
    stops, sides = np.flatnonzero(owner[order] >= 0), []
    for first, last in zip(stops, np.roll(stops, -1), strict=True):
        if owner[order[first]] != owner[order[last]]:
            line = points[order[(first + np.arange((last - first) % len(order) + 1)) % len(order)]]
            sides.append(line[:: 1 if owner[order[first]] == 0 else -1])
    corners = [_corners(side) for side in sides]
    if len(sides) != 2 or len(corners[0]) != len(corners[1]):
        problem = "the corners of its two sides do not match: no middle line"
        raise InputError("elements", problem, "an arch or a frame on two supports")
    positions = []
    for side, own_corners in zip(sides, corners, strict=True):
        pieces = itertools.pairwise([0, *own_corners, len(side) - 1])
        parts = [k + _along(side[i : j + 1]) for k, (i, j) in enumerate(pieces)]
        positions.append(np.concatenate([parts[0], *(part[1:] for part in parts[1:])]))
    chords = _Chords(sides, positions, near, near * body.length)
    sizes = np.linalg.norm(np.subtract(*chords.ends(chords.marks)), axis=1)

    def middles(points: Floats) -> Floats:
        return np.array([chords.middle(point) for point in points])

    return middles, (float(sizes.min()), float(sizes.max()))


@dataclass(frozen=True)
class _Chords:
    """Chords between both sides of an arch; a place on a side counts its corners, and shares of length between them."""

    sides: list[Floats]  # (k, 2) points
    places: list[Floats]  # (k,) their places
    near: float  # distance of points that coincide
    area: float  # area of a chord and a point that lie in line

    @cached_property
    def marks(self) -> Floats:
        """Return the places of all points of either side, ascending."""
        return np.unique(np.concatenate(self.places))

    def ends(self, position: Floats) -> tuple[Floats, Floats]:
        """Return the ends (k, 2) on both sides of chords at places (k,)."""
        start, end = (
            np.column_stack([np.interp(position, own_places, side[:, axis]) for axis in (0, 1)])
            for own_places, side in zip(self.places, self.sides, strict=True)
        )
        return start, end

    def _area(self, position: Floats, point: Floats) -> Floats:
        """Return the signed area between chords and a point, zero where it lies in their line."""
        start, end = self.ends(position)
        chord, arm = end - start, point - start
        return np.asarray(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0])

    def middle(self, point: Floats) -> Floats:
        """Return the middle of the chord through a point; itself outside of the arch."""
        areas = self._area(self.marks, point)
        crossed = np.flatnonzero(areas[:-1] * areas[1:] <= 0.0)
        low, high, sign = self.marks[crossed], self.marks[crossed + 1], np.sign(areas[crossed])
        for _ in range(60):  # halving to rounding
            half = 0.5 * (low + high)
            same = np.sign(self._area(half, point)) == sign
            low, high = np.where(same, half, low), np.where(same, high, half)
        start, end = self.ends(np.concatenate([low, high, self.marks[abs(areas) <= self.area]]))
        chord = end - start
        share = np.clip(((point - start) * chord).sum(axis=1) / (chord**2).sum(axis=1), 0.0, 1.0)
        distance = np.linalg.norm(start + share[:, None] * chord - point, axis=1)
        best = int(distance.argmin()) if len(distance) else -1
        return 0.5 * (start[best] + end[best]) if best >= 0 and distance[best] <= 10.0 * self.near else point


def _corners(line: Floats) -> list[int]:
    steps = np.diff(line, axis=0)
    turns = abs(np.angle(np.exp(1j * np.diff(np.arctan2(steps[:, 1], steps[:, 0])))))
    return (np.flatnonzero(turns > _SHARP) + 1).tolist()


# --- space -------------------------------------------------------------------------------------------------


def _middles_of_prisms(assembly: Assembly, near: float) -> Middles:
    """Return the middles of prisms along one direction: a wall, vault or beam with one outline all along."""
    elements, faces = assembly.elements, assembly.interfaces
    free, support = elements.free.tolist(), elements.support
    corners = np.concatenate([elements.shape[k] for k in free])
    body = elements.shape[free[0]]
    directions = [
        _unit(body[j] - body[i]) for face in elements.faces[free[0]] for i, j in itertools.pairwise((*face, face[0]))
    ]
    best: tuple[float, Floats] | None = None
    for direction in directions:
        reach = float(np.ptp(corners @ direction))
        if (best is None or reach > best[0] * (1 + 1e-9)) and all(_end(assembly, k, direction, near) for k in free):
            best = reach, direction
    if best is None:
        raise InputError("elements", "they are no prisms along one direction", "prisms across the thickness")
    reach, direction = best
    axis = np.eye(3)[int(abs(direction).argmin())]
    frame = np.array([_unit(axis - (axis @ direction) * direction), np.zeros(3)])
    frame[1] = np.cross(direction, frame[0])
    on_supports = np.flatnonzero((support[faces.a] | support[faces.b])[: assembly.faces]).tolist()
    contacts = []
    for face in on_supports:
        if abs(faces.normal[face] @ direction) > _NEAR:
            raise InputError("elements", "a contact with a support is no strip along its prisms", "whole strips")
        along = faces.polygon[face] @ np.cross(direction, faces.normal[face])
        contacts.append(faces.polygon[face][[along.argmin(), along.argmax()]] @ frame.T)
    outlines = [elements.shape[k][list(_end(assembly, k, direction, near))] @ frame.T for k in free]
    middle_of, thickness, across = _of_body(outlines, contacts, near)
    length = shapely.union_all([shapely.LineString(contact) for contact in contacts], grid_size=1e-3 * near).length
    if abs(faces.area[on_supports].sum() - reach * length) > 1e-3 * reach * length:
        raise InputError("elements", "it does not rest on supports all along: no middle line", "a straight wall")
    exact = _exact(middle_of, outlines, near)
    middle = []
    for points, fixed in zip(elements.shape, support, strict=True):
        flat = points @ frame.T
        moved = flat if fixed and across != "wall" else exact(flat)
        middle.append(points + (moved - flat) @ frame)
    return Middles(list(elements.shape), middle, thickness, across, near)


def _end(assembly: Assembly, element: int, direction: Floats, near: float) -> tuple[int, ...]:
    """Return the corners of an end of a prism along a direction; () where it is none."""
    points = assembly.elements.shape[element]
    heights = points @ direction
    low = heights <= heights.min() + near
    if not (low | (heights >= heights.max() - near)).all() or 2 * low.sum() != len(points):
        return ()
    shift = (heights.max() - heights.min()) * direction
    if np.linalg.norm(points[low][:, None] + shift - points[~low], axis=2).min(axis=1).max() > near:
        return ()
    return next((face for face in assembly.elements.faces[element] if low[list(face)].all()), ())


def _by_blocks(assembly: Assembly, near: float) -> Middles:
    """Return the middles of the blocks of a shell, halfway between two opposite free faces of each."""
    elements = assembly.elements
    middle = [points.copy() for points in elements.shape]
    for k in elements.free.tolist():
        joints = _joints_of(assembly, k)
        outline = [list(face) for face in elements.faces[k]]
        middle[k] = _middle_surface(elements.shape[k], outline, joints, near, f"element {elements.ids[k]!r}")
    depths = np.concatenate([2.0 * np.linalg.norm(elements.shape[k] - middle[k], axis=1) for k in elements.free])
    depths = depths[depths > near]
    thickness = (float(depths.min()), float(depths.max()))
    return Middles(list(elements.shape), middle, thickness, "blocks", near)


def _middle_surface(points: Floats, faces: list[list[int]], joints: list[Floats], near: float, where: str) -> Floats:
    """Return the points (k, 3) halfway to the opposite free face; of several pairs of faces the nearest."""
    free = []
    for face in faces:
        corner, normal = points[face[0]], np.zeros(3)
        for second, third in itertools.pairwise(face[1:]):
            normal += np.cross(points[second] - corner, points[third] - corner)
        normal /= np.linalg.norm(normal)
        if not any(abs((joint - corner) @ normal).max() <= near for joint in joints):
            free.append(face)
    edges = {frozenset(pair) for face in faces for pair in zip(face, face[1:] + face[:1], strict=True)}
    best: tuple[float, Floats] | None = None
    for inside, outside in itertools.combinations(free, 2):
        if set(inside) & set(outside) or len(inside) + len(outside) != len(points):
            continue
        links = [[b for b in outside if frozenset((a, b)) in edges] for a in inside]
        if any(len(link) != 1 for link in links) or len({link[0] for link in links}) != len(outside):
            continue
        middle = points.copy()
        for a, (b,) in zip(inside, links, strict=True):
            middle[[a, b]] = 0.5 * (points[a] + points[b])
        size = float(np.linalg.norm(points - middle, axis=1).mean())
        if best is None or size < best[0]:
            best = size, middle
    if best is None:
        problem = "no two free faces lie opposite each other: no middle surface"
        raise InputError(where, problem, "prisms across the thickness")
    return best[1]


_TOLERANCE: Final = 1e-6  # relative width of the bracket to aim at
_FIRST: Final = ((1.0, 2.0, 4.0, 8.0), tuple(0.5**k for k in range(11)))  # scales tried where it falls, and stands
_PARTS: Final = (0.5, 0.4, 0.6, 0.25, 0.75)  # of a bracket, tried in turn where it is not decided whether it stands


@dataclass(frozen=True)
class GeometricSafety:
    """Thickness of a structure over its least one, as a bracket; NaN for an end that is not proven."""

    factor: tuple[float, float]
    # least scale of the thickness: it falls at the first, and stands at the second
    scale: tuple[float, float]
    thickness: tuple[float, float]  # least and largest thickness, scene units
    across: str  # what is scaled

    def to_json(self) -> dict[str, Any]:
        ends = [None if math.isnan(end) else end for end in self.factor]
        least = [None if math.isnan(end) else end for end in self.scale]
        return {"factor": ends, "least_scale": least, "thickness": list(self.thickness), "across": self.across}

    def __str__(self) -> str:
        low, high = self.factor
        if math.isnan(high):
            return f"above {low:.6g}" if low == low else "unknown"
        return f"below {high:.6g}" if math.isnan(low) else f"{0.5 * (low + high):.6g} in [{low:.9g}, {high:.9g}]"


def geometric_safety(scene: Scene, labels: Bits, model: Model) -> GeometricSafety:
    """Compute the geometric factor of safety of one labelling under its dead loads.

    The structure is scaled across its middle line or surface; volumes and weights from a density follow. Raises
    InputError where it has no such line or surface, or for a model that is not of rigid elements with dilation.
    """
    assembly = build_assembly(scene)
    if (model.cracks or assembly.cracks) != "faces":
        raise ParameterError(
            "geometric", "thickness is scaled of blocks that crack along their faces", "cracks by faces"
        )
    if model.friction != "associative" or model.effective_area or model.contact != "convex":
        raise ParameterError("geometric", "it is for friction with dilation on whole faces", "no other model")
    middles = middles_of(assembly)
    document = _document(scene, assembly)

    def stands(scale: float) -> bool | None:
        """Return whether it stands at a scale of its thickness; None where undecided."""
        try:
            scaled = build_assembly(parse_scene(_scaled_scene(document, middles, assembly, scale)))
        except InputError:
            if scale == 1.0:
                raise
            return None  # what is too thick overlaps, what is too thin has no joints left
        # faces may come in another order
        pairs, pairs_scaled = _pairs(assembly), _pairs(scaled)
        order, order_scaled = np.lexsort(pairs), np.lexsort(pairs_scaled)
        if not np.array_equal(pairs[:, order], pairs_scaled[:, order_scaled]):
            raise InputError("elements", "other faces touch where the thickness is scaled", "blocks with whole joints")
        labels_scaled = np.empty_like(labels)
        labels_scaled[order_scaled] = labels[order]
        require_materials(scaled, labels_scaled, ~labels_scaled)
        verdicts = [limit_analysis(case, model, single_labelling=True).stands(labels_scaled) for case in scaled.by_case]
        return False if False in verdicts else None if None in verdicts else True

    # largest scale at which it falls, and least at which it stands: first by steps from 1, then by halving
    fall, stand = math.nan, math.nan
    first = stands(1.0)
    for scale in _FIRST[bool(first)]:
        verdict = first if scale == 1.0 else stands(scale)
        if verdict is None:
            break
        fall, stand = (fall, scale) if verdict else (scale, stand)
        if verdict != first:
            break
    while stand - fall > _TOLERANCE * stand:
        for share in _PARTS:  # other places where the middle is undecided
            middle = fall + share * (stand - fall)
            verdict = stands(middle)
            if verdict is not None:
                break
        if verdict is None:
            break
        fall, stand = (fall, middle) if verdict else (middle, stand)
    return GeometricSafety((1.0 / stand, 1.0 / fall), (fall, stand), middles.thickness, middles.across)


def _pairs(assembly: Assembly) -> Any:
    """Return the larger and smaller element (2, m) of each face."""
    ends = np.stack([assembly.interfaces.a, assembly.interfaces.b])
    return np.stack([ends.max(axis=0), ends.min(axis=0)])


def _document(scene: Scene, assembly: Assembly) -> dict[str, Any]:
    """Return a scene of elements under its dead loads: live loads, which have places, become one force."""
    document = scene.model_dump(mode="json", exclude_unset=True)
    grid, elements = document.pop("grid", None), assembly.elements
    if grid is not None:
        document["thickness"] = grid.get("thickness", 1.0)
        document["elements"] = [
            {"id": name, "polygon": [], "support": bool(is_support)}
            for name, is_support in zip(elements.ids, elements.support, strict=True)
        ]
    loads, force = document["loads"], [1.0, *[0.0] * (assembly.dimension - 1)]
    live = [{"element": elements.ids[elements.free[0]], "force": force}]
    cases = [{**case, "live": live} for case in loads.get("cases", ()) if case.get("dead")]
    own = {"cases": cases} if cases else {"live": live}
    document["loads"] = own | ({"dead": loads["dead"]} if "dead" in loads else {})
    for name in ("labels", "search", "move", "settlements"):
        document.pop(name, None)
    return document


def _scaled_scene(document: dict[str, Any], middles: Middles, assembly: Assembly, scale: float) -> dict[str, Any]:
    """Return the scene scaled across its middle lines."""
    changed, elements = deepcopy(document), assembly.elements
    for k, (entry, points) in enumerate(zip(changed["elements"], elements.shape, strict=True)):
        key = "polygon" if assembly.dimension == 2 else "vertices"
        entry[key] = middles.scaled(k, points, scale).tolist()
        if elements.faces:
            entry["faces"] = [list(face) for face in elements.faces[k]]
        if "volume" in entry:
            entry["volume"] *= scale
    for entry in changed.get("interfaces") or ():
        free = next(k for k in map(elements.index.__getitem__, entry["elements"]) if not elements.support[k])
        entry["polygon"] = middles.scaled(free, np.array(entry["polygon"]), scale).tolist()
    return changed
