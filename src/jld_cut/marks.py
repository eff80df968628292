"""Tenons between parts, and numbers with an arrow cut into them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, Ints
from jld_cut.cells import Joint
from jld_cut.meshes import manifold3d, surface_of
from jld_cut.parts import Part

_TENON: Final = 0.3  # half the side of a tenon, over the radius of the circle that its joint holds
_LONG: Final = 1.5  # length of a tenon over half its side
_TAPER: Final = 0.9  # its end over its foot, so that it finds its way
_WALL: Final = 0.5  # what is left around a mortise, over half the side of the tenon
_PLAY: Final = 4.0  # least half side of a tenon, over the gap of joints
_PARALLEL: Final = 1e-9  # 1 − cosine up to which a part comes along the normal of a joint

_SEGMENTS: Final = ("abcdef", "bc", "abged", "abgcd", "fgbc", "afgcd", "afgcde", "abc", "abcdefg", "abcdfg")
_STROKE: Final = 0.16  # of a number, over its height
_HIGH: Final = 0.15  # largest height of a number, over the longest side of its part
_DEEP: Final = 3.0  # least height of a number, over its depth


def add_tenons(
    parts: list[Part], block: Ints, joints: list[Joint], clearance: float, fits: Callable[[Part], bool]
) -> int:
    """Give joints that are closed along their normal a tenon on the part that is laid first; return how many.

    block: (n,) names of the parts of cells. fits: whether a part with a tenon still fits where it is made. A joint too
    small, or whose parts a mortise would break, has none.
    """
    of = {int(block[part.cells[0]]): part for part in parts}
    faces: dict[tuple[int, int, tuple[float, ...]], tuple[Floats, list[Floats]]] = {}
    for joint in joints:
        pair = [of.get(int(block[k])) if 0 <= k < len(block) else None for k in (joint.a, joint.b)]
        first, last = pair if pair[0] is None or pair[1] is None or pair[0].step < pair[1].step else pair[::-1]
        if first is None or last is None or not 0 < first.step < last.step:
            continue
        normal = joint.normal * (1.0 if first is pair[0] else -1.0)  # from the first to the last
        if last.direction @ normal < _PARALLEL - 1.0:  # the last comes against the normal, and does not slide past
            plane = (*np.round(normal, 6).tolist(), float(np.round(normal @ joint.polygon[0], 6)))
            faces.setdefault((first.number, last.number, plane), (normal, []))[1].append(joint.polygon)
    by_number = {part.number: part for part in parts}
    return sum(
        _tenon(by_number[first], by_number[last], *faces[first, last, plane], clearance, fits)
        for first, last, plane in sorted(faces)
    )


def _frame(normal: Floats, along: Floats) -> Floats:
    """Return a rotation (3, 3) with rows right, up, normal; up is nearest to a direction."""
    up = along - (along @ normal) * normal
    if np.linalg.norm(up) < 0.1:
        up = np.eye(3)[int(np.argmin(np.abs(normal)))]
        up = up - (up @ normal) * normal
    up = up / np.linalg.norm(up)
    return np.array([np.cross(up, normal), up, normal])


def _prism(plan: Any, height: float, frame: Floats, at: Floats, taper: float = 1.0) -> Any:
    """Return the prism over a plan in the first axes of a frame, from a point (3,) along the third."""
    rings = [
        np.asarray(ring.coords)[:-1] for part in shapely.get_parts(plan) for ring in (part.exterior, *part.interiors)
    ]
    section = manifold3d().CrossSection(rings, manifold3d().FillRule.EvenOdd)
    solid = manifold3d().Manifold.extrude(section, height, 0, 0.0, (taper, taper))
    return solid.transform(np.column_stack([frame.T, at]))


def _tenon(
    first: Part,
    last: Part,
    normal: Floats,
    polygons: list[Floats],
    clearance: float,
    fits: Callable[[Part], bool],
) -> int:
    """Add a tenon of `first` into a mortise of `last`; return whether there is room."""
    edge = polygons[0][1] - polygons[0][0]
    frame = _frame(normal, edge / np.linalg.norm(edge))
    plan = shapely.union_all([shapely.polygons(polygon @ frame[:2].T) for polygon in polygons], grid_size=1e-9)
    circle = shapely.maximum_inscribed_circle(plan)
    middle, reach = shapely.get_coordinates(circle)[0], float(circle.length)
    half = _TENON * reach
    if half < _PLAY * clearance or not half > 0.0:
        return 0
    length = _LONG * half
    foot = frame[:2].T @ middle + (normal @ polygons[0][0]) * normal

    def square(side: float, low: float, high: float, taper: float = 1.0) -> Any:
        """Return a prism of half a side between heights over the joint."""
        return _prism(shapely.box(-side, -side, side, side), high - low, frame, foot + low * normal, taper)

    play = max(clearance, 1e-4 * half)
    room = square((1.0 + _WALL) * half, 0.5 * clearance, length + play + _WALL * half)
    if (room ^ last.solid).volume() < (1.0 - 1e-6) * room.volume():
        return 0
    root = square(half, -half, -0.5 * clearance)
    if (root ^ first.solid).volume() < (1.0 - 1e-6) * root.volume():
        return 0
    tenon, mortise = square(half, -half, length, _TAPER), square(half + play, -half, length + play)
    whole, holed = first.solid + tenon, last.solid - mortise
    tried = replace(first, solid=whole, tenons=tenon if first.tenons is None else first.tenons + tenon)
    if len(whole.decompose()) != 1 or len(holed.decompose()) != 1 or not fits(tried):
        return 0
    first.solid, first.tenons, first.box, first.bed = tried.solid, tried.tenons, tried.box, tried.bed
    last.solid = holed
    return 1


def _text(number: int) -> Any:
    """Return a number of height 1 in seven-segment digits, with an arrow up on its right, about its middle."""
    t, wide = _STROKE, 0.55
    bars = {
        "a": (0.0, 1.0 - t, wide, 1.0),
        "b": (wide - t, 0.5 - t / 2, wide, 1.0),
        "c": (wide - t, 0.0, wide, 0.5 + t / 2),
        "d": (0.0, 0.0, wide, t),
        "e": (0.0, 0.0, t, 0.5 + t / 2),
        "f": (0.0, 0.5 - t / 2, t, 1.0),
        "g": (0.0, 0.5 - t / 2, wide, 0.5 + t / 2),
    }
    shapes, at = [], 0.0
    for digit in str(number):
        shapes += [shapely.box(bars[k][0] + at, bars[k][1], bars[k][2] + at, bars[k][3]) for k in _SEGMENTS[int(digit)]]
        at += wide + 0.25
    middle = at + 0.2
    shapes.append(shapely.box(middle - t / 2, 0.0, middle + t / 2, 0.6))
    shapes.append(shapely.polygons([(middle - 0.2, 0.6), (middle + 0.2, 0.6), (middle, 1.0)]))
    return shapely.affinity.translate(shapely.union_all(shapes), -(middle + 0.2) / 2, -0.5)


def _flats(solid: Any) -> Iterator[tuple[Floats, float, Any, Floats]]:
    """Yield normal, offset, plan and frame of the plane faces of a solid, the largest first."""
    points, triangles = surface_of(solid)
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-300)[:, None]
    size = float(np.ptp(points, axis=0).max())
    offset = np.einsum("ij,ij->i", unit, corners[:, 0]) / size
    kinds, kind = np.unique(np.round(np.column_stack([unit, offset]), 5), axis=0, return_inverse=True)
    share = np.bincount(kind.reshape(-1), area, len(kinds))
    for k in np.argsort(-share)[:12].tolist():
        mine = np.flatnonzero(kind.reshape(-1) == k)
        up = unit[mine[np.argmax(area[mine])]]
        frame = _frame(up, np.array([0.0, 0.0, 1.0]))
        plan = shapely.union_all(shapely.polygons(corners[mine] @ frame[:2].T), grid_size=1e-9 * size)
        yield up, float(offset[mine].mean() * size), plan, frame


def engrave(part: Part, joints: list[Floats], depth: float) -> bool:
    """Cut the number of a part, and an arrow that points up where it stands, into a plane face; whether one has room.

    joints: (4,) unit normal and offset of the joints of the part, whose faces are taken only where no other has room.
    On a level face the arrow points along an axis.
    """
    text = _text(part.number)
    low, _, high, _ = text.bounds
    half = float(np.hypot(high - low, 1.0)) / 2  # of a diagonal, over the height
    longest = float(np.ptp(surface_of(part.solid)[0], axis=0).max())
    found: list[tuple[Any, ...]] = []
    for up, offset, plan, frame in _flats(part.solid):
        region = max(shapely.get_parts(plan), key=lambda one: one.area)
        circle = shapely.maximum_inscribed_circle(region)
        height = min(0.9 * float(circle.length) / half, _HIGH * longest)
        hidden = any(
            abs(abs(up @ q[:3]) - 1.0) < 1e-6 and abs(abs(offset) - abs(q[3])) < 0.02 * longest for q in joints
        )
        if height > _DEEP * depth:
            found.append((hidden, -height, len(found), up, offset, shapely.get_coordinates(circle)[0], frame))
    for _, height, _, up, offset, middle, frame in sorted(found, key=lambda one: one[:3]):
        scaled = shapely.affinity.scale(text, -height, -height, origin=(0, 0))
        at = frame[:2].T @ middle + offset * up
        wall = _prism(scaled, 3.0 * depth, frame, at - 3.0 * depth * up)  # as much is left behind the mark
        if (wall ^ part.solid).volume() < (1.0 - 1e-5) * wall.volume():
            continue
        marked = part.solid - _prism(scaled, 2.0 * depth, frame, at - depth * up)
        if len(marked.decompose()) == 1:
            part.solid = marked
            return True
    return False
