"""Spatial sample: two walls that meet at a bonded corner."""

from __future__ import annotations

import shapely

from jld_core.errors import ParameterError
from jld_core.samples.corner_bonds import corner_course
from jld_core.samples.stone import Stone, box, cap, check, count, scene_of
from jld_core.scene import Scene


def corner(
    courses: int = 4,
    length: float = 1.6,
    width: float = 1.2,
    thickness: float = 0.2,
    brick: float = 0.4,
    height: float = 0.2,
    bond: str = "running",
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make two walls that meet at a bonded corner, on a footing: quoins alternate from course to course.

    Parameters
    ----------
    courses: number of courses, from bottom to top.
    length: length of the wall along x, over the corner, m.
    width: length of the wall along y, over the corner, m.
    thickness: thickness of both walls, m.
    brick: length of a stretcher, m.
    height: height of a course, m.
    bond: running, third, stack, english or flemish; the corner is bonded in each of them.
    load: push (horizontal body load), crown or quarter (1 N downwards at that place).
    stone: material; None for the default of `Stone`.

    Returns
    -------
    Scene
        Validated scene in m and N.

    Raises
    ------
    InputError
        A dimension, count or name is invalid.
    """
    check(length=length, width=width, thickness=thickness, brick=brick, height=height)
    count(1, courses=courses)
    cap(courses * ((length + width) / brick + 2))
    for name, value in (("length", length), ("width", width)):
        if value <= thickness:
            raise ParameterError(name, f"{value:g} is wrong", f"more than the thickness {thickness:g}")
    plan = shapely.Polygon(
        [(0.0, 0.0), (length, 0.0), (length, thickness), (thickness, thickness), (thickness, width), (0.0, width)]
    )
    elements = [
        box(f"c{k}b{number}", (x0, y0, k * height), (x1, y1, (k + 1) * height))
        for k in range(courses)
        for number, (x0, y0, x1, y1) in enumerate(corner_course(plan, k, bond, brick))
    ]
    low, high = (-brick, -brick, -height), (length + brick, width + brick, 0.0)
    elements.append(box("footing", low, high, support=True))
    return scene_of(f"corner in {bond} bond", elements, stone or Stone(), load)
