"""Spatial samples: two walls that meet at a bonded corner, and a room with a door and a window."""

from __future__ import annotations

import shapely

from jld_core import ParameterError, Scene, parameters
from jld_masonry import bonds
from jld_samples.stone import Stone, box, cap, check, count, scene_of


@parameters.typed
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
        for number, (x0, y0, x1, y1) in enumerate(bonds.corner_course(plan, k, bond, brick))
    ]
    low, high = (-brick, -brick, -height), (length + brick, width + brick, 0.0)
    elements.append(box("footing", low, high, support=True))
    return scene_of(f"corner in {bond} bond", elements, stone or Stone(), load)


def room(
    courses: int = 6,
    length: float = 2.4,
    width: float = 2.0,
    thickness: float = 0.2,
    brick: float = 0.4,
    height: float = 0.2,
    bond: str = "running",
    door: str = "0.8,0.6,0.8",
    window: str = "0.6,0.4,0.6,0.4",
    lintel: int = 1,
    bearing: float | None = None,
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make the four bonded walls of a room with a door and a window, on a footing.

    Parameters
    ----------
    courses: number of courses, from bottom to top.
    length: length of the walls along x, over the corners, m.
    width: length of the walls along y, over the corners, m.
    thickness: thickness of all walls, m.
    brick: length of a stretcher, m.
    height: height of a course, m.
    bond: running, third, stack, english or flemish.
    door: x,width,height of the door in the front wall, along x, m; none for no door. Heights are whole courses.
    window: y,sill,width,height of the window in the left wall, along y, m; none for no window.
    lintel: stones over an opening: 1 for a lintel, more for a flat arch of so many wedges between two skewbacks.
    bearing: least length by which lintels reach beyond the jambs, m; default half a stretcher, or a shorter pier.
    load: push (horizontal body load), crown or quarter (1 N downwards at that place).
    stone: material; None for the default of `Stone`.

    Returns
    -------
    Scene
        Validated scene in m and N.

    Raises
    ------
    InputError
        A dimension, count or name is invalid, or an opening does not fit.
    """
    check(length=length, width=width, thickness=thickness, brick=brick, height=height)
    count(1, courses=courses, lintel=lintel)
    cap(courses * 2.0 * ((length + width) / brick + 2))
    if bearing is not None:
        check(bearing=bearing)
    for name, value in (("length", length), ("width", width)):
        if value <= 2.0 * thickness:
            raise ParameterError(name, f"{value:g} is wrong", f"more than twice the thickness {thickness:g}")
    inside = shapely.box(thickness, thickness, length - thickness, width - thickness)
    plan = shapely.box(0.0, 0.0, length, width).difference(inside)
    inner = (length - 2.0 * thickness, width - 2.0 * thickness)
    sections = [plan] * courses
    for name, text, form, room_left in (
        ("door", door, "x,width,height", inner[0]),
        ("window", window, "y,sill,width,height", inner[1]),
    ):
        if text == "none":
            continue
        start, end, first, last = _opening(name, text, form, thickness, room_left, height, courses)
        gap = (start, 0.0, end, thickness) if name == "door" else (0.0, start, thickness, end)
        hole = shapely.box(*gap)
        sections[first:last] = [section.difference(hole) for section in sections[first:last]]
    beds = [k * height for k in range(courses + 1)]
    stones = bonds.bonded_walls(sections, beds, bond, brick, lintel=bonds.Lintel(lintel, bearing), name="room")
    elements = [
        {"id": f"c{k}b{number}", "vertices": corners.tolist(), "faces": [list(loop) for loop in bonds.FACES]}
        for k, row in enumerate(stones)
        for number, corners in enumerate(row)
    ]
    low, high = (-brick, -brick, -height), (length + brick, width + brick, 0.0)
    elements.append(box("footing", low, high, support=True))
    return scene_of(f"room in {bond} bond", elements, stone or Stone(), load)


def _opening(
    name: str, text: str, form: str, start: float, length: float, height: float, courses: int
) -> tuple[float, float, int, int]:
    """Return both jambs of an opening along its wall, its first course, and that of its lintel.

    text: position, sill, width and height, as in `form`.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
        place, *sill, wide, tall = numbers
    except ValueError:
        numbers = []
    if len(numbers) != form.count(",") + 1:
        raise ParameterError(name, f"{text!r} is no opening", f"{form}, or none")
    first = round(sill[0] / height) if sill else 0
    last = round(((sill[0] if sill else 0.0) + tall) / height)
    fits = place > start and wide > 0.0 and place + wide < start + length and 0 <= first < last < courses
    if not fits or (sill and first == 0):
        expected = "an opening between the corners with a course above it" + (" and below it" if sill else "")
        raise ParameterError(name, f"{text!r} does not fit", expected)
    return place, place + wide, first, last
