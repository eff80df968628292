"""Parametric walls in running bond, for measurements and tests of any size."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.samples.stone import box
from jld_core.scene import Scene, parse_scene


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
    wide, height = 4.0, 1.75
    elements = [_rectangle("ground", -0.5 * wide, (bricks + 0.5) * wide, -1.0, 0.0, support=True)]
    for course in range(courses):
        first, last = _ends(2, wide, bricks)[(course + 1) % 2]
        for k, (a, b) in enumerate(zip(first, last, strict=True)):
            elements.append(_rectangle(f"c{course}b{k}", float(a), float(b), course * height, (course + 1) * height))
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    return parse_scene(
        {
            "name": f"wall of {bricks} × {courses} bricks",
            "materials": materials,
            "elements": elements,
            "loads": {"live": [{"body": [1.0, 0.0]}]},
        }
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
