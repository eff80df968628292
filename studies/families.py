"""Families of structures to measure a method on: walls and arches of any size, and walls drawn from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jld_core import Scene, parse_scene
from jld_core.arrays import Floats
from jld_samples import box

_LEAST = 0.35  # shortest piece of a block, in block lengths; a shorter one joins its neighbour


def random_wall(seed: int) -> Scene:
    """A dry wall of 4–8 courses of running bond under a horizontal body load.

    seed: of the numpy generator that draws course number and height, wall length, the offset of every joint
    from its place in the bond, friction 0.4–0.8, and none to two openings, each under a lintel. Lengths in
    blocks, forces in weights of a cubic block; the wall stands on one support.
    """
    rng = np.random.default_rng(seed)
    courses, length = int(rng.integers(4, 9)), int(rng.integers(3, 7))
    height = float(rng.uniform(0.3, 0.6))
    rows = [_course(rng, k, length) for k in range(courses)]
    for _ in range(int(rng.integers(0, 3))):
        rows = _with_opening(rng, rows, length)
    elements: list[dict[str, Any]] = [
        {"id": "ground", "support": True, "polygon": [[-1, -1], [length + 1, -1], [length + 1, 0], [-1, 0]]}
    ]
    for k, row in enumerate(rows):
        for j, (left, right) in enumerate(row):
            low, high = k * height, (k + 1) * height
            polygon = [[left, low], [right, low], [right, high], [left, high]]
            elements.append({"id": f"c{k}b{j}", "polygon": polygon})
    return parse_scene(
        {
            "name": f"random wall {seed}",
            "elements": elements,
            "materials": {
                "density": 1.0,
                "gravity": 1.0,
                "dry": {"friction_coefficient": float(rng.uniform(0.4, 0.8))},
            },
            "loads": {"live": [{"body": [1.0, 0.0]}]},
        }
    )


def _course(rng: np.random.Generator, course: int, length: int) -> Floats:
    """(k, 2) ends of the blocks of one course, joints up to 0.2 off the bond."""
    joints = np.arange(1, length) + 0.5 * (course % 2) + rng.uniform(-0.2, 0.2, length - 1)
    joints = joints[joints < length - _LEAST]
    ends = np.concatenate([[0.0], joints, [float(length)]])
    return np.column_stack([ends[:-1], ends[1:]])


def _with_opening(rng: np.random.Generator, rows: list[Floats], length: int) -> list[Floats]:
    """The courses with one opening cut out and a lintel over it; unchanged where there is no room for it."""
    tall = int(rng.integers(1, 3))
    low = int(rng.integers(0, max(1, len(rows) - tall - 1)))
    wide = float(rng.uniform(0.5, 0.9))
    left = float(rng.uniform(1.0, max(1.0, length - 1.0 - wide)))
    if any(np.diff(row, axis=1).sum() < length - 1e-9 for row in rows[max(0, low - 1) : low + tall + 1]):
        return rows
    cut = [_without(row, left, left + wide) for row in rows[low : low + tall]]
    above = rows[low + tall]
    spanned = (above[:, 1] > left - _LEAST) & (above[:, 0] < left + wide + _LEAST)
    lintel = np.array([[above[spanned, 0].min(), above[spanned, 1].max()]])
    first = int(np.flatnonzero(spanned)[0])
    whole = np.concatenate([above[:first], lintel, above[first + int(spanned.sum()) :]])
    return [*rows[:low], *cut, whole, *rows[low + tall + 1 :]]


def _without(row: Floats, left: float, right: float) -> Floats:
    """A course with [left, right] taken out; pieces shorter than the least join the block beside them."""
    sides = []
    for part, at_left in ((row[row[:, 0] < left], True), (row[row[:, 1] > right], False)):
        part = part.copy()
        if at_left:
            part[-1, 1] = left
            if left - part[-1, 0] < _LEAST and len(part) > 1:
                part = np.concatenate([part[:-2], [[part[-2, 0], left]]])
        else:
            part[0, 0] = right
            if part[0, 1] - right < _LEAST and len(part) > 1:
                part = np.concatenate([[[right, part[1, 1]]], part[2:]])
        sides.append(part)
    return np.concatenate(sides)


def semicircular_arch(
    voussoirs: int | Sequence[float],
    thickness: float,
    friction: float,
    live: list[dict[str, Any]] | None = None,
    **dry: float,
) -> Scene:
    """A semicircular arch of radial joints under self-weight spread along its centreline.

    voussoirs: how many equal ones, or the joints of one half beside crown and springing, degrees from the crown.
    thickness: over the radius of the centreline, which is the unit of length; the weight of the half arch is the unit
    of force. friction: coefficient. live: load entries, default a horizontal body load. dry: further keys of the dry
    material.
    Source: Cocchetti & Rizzi, Frattura ed Integrità Strutturale 51 (2020) 356–375.
    """
    if isinstance(voussoirs, int):
        angles = np.linspace(0.0, np.pi, voussoirs + 1)
    else:
        angles = np.radians(np.unique([0.0, 180.0, *(90.0 + s * one for one in (0.0, *voussoirs) for s in (1, -1))]))
    inner, outer = 1.0 - thickness / 2.0, 1.0 + thickness / 2.0
    elements: list[dict[str, Any]] = []
    for k, spread in enumerate(np.diff(angles).tolist()):
        reach = np.sin(spread / 2.0) / (spread / 2.0)  # centre of mass of an arc of the centreline
        ends = np.array([[np.cos(a), np.sin(a)] for a in angles[[k, k + 1]]])
        middle = 0.5 * (angles[k] + angles[k + 1])
        polygon = [*(inner * ends[::-1]).tolist(), *(outer * ends).tolist()]
        centroid = [reach * float(np.cos(middle)), reach * float(np.sin(middle))]
        elements.append({"id": f"v{k}", "polygon": polygon, "weight": 2.0 * spread / np.pi, "centroid": centroid})
    for name, side in (("right", 1.0), ("left", -1.0)):
        corners = [[side * inner, 0.0], [side * outer, 0.0], [side * outer, -thickness], [side * inner, -thickness]]
        elements.append({"id": name, "polygon": corners, "support": True})
    return parse_scene(
        {
            "name": f"semicircular arch of {len(angles) - 1} voussoirs",
            "elements": elements,
            "materials": {"dry": {"friction_coefficient": friction, **dry}},
            "loads": {"live": live or [{"body": [1.0, 0.0]}]},
        }
    )


def running_bond(
    courses: int,
    *,
    direction: tuple[float, float, float] = (0.0, 1.0, 0.0),
    wythes: int = 2,
    friction: float = 0.65,
    brick: tuple[float, float, float] = (0.2, 0.1, 0.06),
) -> Scene:
    """A wall of dry bricks on a slab, half as many bricks long as it has courses, under a body load.

    courses: even; the wall then has wythes · courses (courses + 1) / 2 blocks, every second course ending in half
    bricks: 110, 420, 1 640, 3 660, 10 100 blocks for 10, 20, 40, 60, 100 courses of two wythes. direction: of the
    load, x along the wall, y out of its plane. brick: length, width, height in metres. Wythes are in step and
    joined by friction alone.
    """
    length, width, height = brick
    total = courses // 2 * length
    elements = [box("slab", (0.0, 0.0, -height), (total, wythes * width, 0.0), support=True)]
    for course, (first, last) in enumerate(_ends(courses, length)):
        for wythe in range(wythes):
            for k, (a, b) in enumerate(zip(first, last, strict=True)):
                low = (float(a), wythe * width, course * height)
                high = (float(b), (wythe + 1) * width, (course + 1) * height)
                elements.append(box(f"c{course}w{wythe}b{k}", low, high))
    return parse_scene({**_document(friction), "elements": elements, "loads": {"live": [{"body": list(direction)}]}})


def planar_running_bond(courses: int, *, length: int | None = None, friction: float = 0.65) -> Scene:
    """The same in the plane, one wythe, pushed along x. length: bricks in a course, default half the courses."""
    wide, height = 0.2, 0.06
    count = length or courses // 2
    elements: list[dict[str, Any]] = [_rectangle("slab", 0.0, count * wide, -height, 0.0, support=True)]
    for course, (first, last) in enumerate(_ends(courses, wide, count)):
        low = course * height
        for k, (a, b) in enumerate(zip(first, last, strict=True)):
            elements.append(_rectangle(f"c{course}b{k}", float(a), float(b), low, low + height))
    return parse_scene(
        {**_document(friction), "thickness": 0.1, "elements": elements, "loads": {"live": [{"body": [1.0, 0.0]}]}}
    )


def halved_bond(bricks: int, courses: int, friction: float = 0.65) -> Scene:
    """A small planar wall whose lowest course begins and ends in half bricks, pushed along x by its own weight.

    bricks: in a whole course. Bricks of 4 × 1.75 and unit density, as in the walls of Ferris & Tin-Loi 2001.
    """
    rows = ([1.0] * bricks, [0.5, *[1.0] * (bricks - 1), 0.5])
    lengths = [rows[(course + 1) % 2] for course in range(courses)]
    return wall_of_courses(lengths, friction, f"wall of {bricks} × {courses} bricks")


HALVES, WHOLE = (0.5, 1.0, 1.0, 0.5), (1.0, 1.0, 1.0)
PIERS, HALVED_PIERS = (1.0, -1.0, 1.0), (0.5, 0.5, -1.0, 0.5, 0.5)
"""Courses of three bricks, and such beside an opening one brick wide, as in wall 5 of Ferris & Tin-Loi 2001."""


def opened_wall(below: int, above: int, height: int = 3, friction: float = 0.65) -> Scene:
    """A wall of three bricks with one opening of so many courses, with courses below and above it; pushed along x."""
    base = [(HALVES, WHOLE)[course % 2] for course in range(below)]
    piers = [(PIERS, HALVED_PIERS)[course % 2] for course in range(height)]
    top = [(HALVES, WHOLE)[course % 2] for course in range(above)]
    return wall_of_courses(
        [*base, *piers, *top], friction, f"wall with one opening, {below} + {height} + {above} courses"
    )


def wall_of_courses(courses: Sequence[Sequence[float]], friction: float = 0.65, name: str = "wall") -> Scene:
    """A planar wall pushed along x by its own weight, its courses as lengths in bricks, negative: left out.

    Bricks of 4 × 1.75 and unit density, as in the walls of Ferris & Tin-Loi 2001.
    """
    wide, height = 4.0, 1.75
    whole = sum(abs(length) for length in courses[0])
    elements = [_rectangle("ground", -0.5 * wide, (whole + 0.5) * wide, -1.0, 0.0, support=True)]
    for course, lengths in enumerate(courses):
        ends = np.cumsum([0.0, *map(abs, lengths)]) * wide
        bricks = [(a, b) for a, b, length in zip(ends, ends[1:], lengths, strict=False) if length > 0.0]
        for k, (a, b) in enumerate(bricks):
            elements.append(_rectangle(f"c{course}b{k}", float(a), float(b), course * height, (course + 1) * height))
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    return parse_scene(
        {"name": name, "materials": materials, "elements": elements, "loads": {"live": [{"body": [1.0, 0.0]}]}}
    )


def _ends(courses: int, length: float, count: int | None = None) -> list[tuple[Any, Any]]:
    """Where bricks begin and end, course by course."""
    whole = np.arange((count or courses // 2) + 1) * length
    halved = np.concatenate([[0.0], whole[:-1] + 0.5 * length, whole[-1:]])
    return [(row[:-1], row[1:]) for row in (whole, halved) * (courses // 2)]


def _rectangle(name: str, x0: float, x1: float, y0: float, y1: float, **keys: Any) -> dict[str, Any]:
    return {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], **keys}


def _document(friction: float) -> dict[str, Any]:
    materials = {"density": 1800.0, "dry": {"friction_coefficient": friction}}
    return {"name": "wall in running bond", "materials": materials, "labels": {"default": "dry"}}
