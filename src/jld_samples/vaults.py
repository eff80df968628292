"""Spatial samples: barrel and cross vaults, faceted domes, bonded corners and a room."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from jld_core import ParameterError, Scene, parameters
from jld_masonry import bonds
from jld_samples.stone import Stone, box, cap, check, choose, count, scene_of, steps, swept


@parameters.typed
def vault(
    kind: str = "barrel",
    radius: float = 1.5,
    thickness: float = 0.25,
    length: float = 2.0,
    voussoirs: int = 8,
    courses: int = 4,
    springing: float = 0.0,
    bond: str = "stack",
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make a semicircular vault: a barrel along y, or two barrels crossing over a square bay.

    Parameters
    ----------
    kind: barrel or cross.
    radius: radius of the centreline, m.
    thickness: thickness of the shell, m.
    length: length of the barrel, m; cross: extension of each web beyond the outside of the springing, on either side.
    voussoirs: number of cells from springing to springing; cross: even, half of them in each half web.
    courses: number of cells along the barrel, or along each half web from the groin outwards.
    springing: angle at which the vault begins, degrees above the horizontal; supports lie below.
    bond: stack, or running (barrel: every second course shifted by half a voussoir).
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
    check(radius=radius, thickness=thickness, length=length)
    count(1, voussoirs=voussoirs, courses=courses)
    cap(voussoirs * courses * (4 if kind == "cross" else 1))
    choose("kind", kind, ("barrel", "cross"))
    choose("bond", bond, ("stack", "running"))
    if thickness >= 2.0 * radius:
        raise ParameterError("thickness", f"{thickness:g} is wrong", "less than two radii")
    if not 0.0 <= springing < 90.0:
        raise ParameterError("springing", f"{springing:g} is wrong", "an angle from 0 to less than 90")
    inner, outer = radius - thickness / 2.0, radius + thickness / 2.0
    if kind == "cross":
        if voussoirs % 2:
            raise ParameterError("voussoirs", f"{voussoirs} is odd", "an even number, for a joint along each ridge")
        elements = _cross(inner, outer, length, voussoirs // 2, courses, np.radians(springing))
    else:
        elements = _barrel(inner, outer, length, voussoirs, courses, np.radians(springing), bond == "running")
    return scene_of(f"{kind} vault of {len(elements)} cells", elements, stone or Stone(), load)


def _barrel(
    inner: float, outer: float, length: float, voussoirs: int, courses: int, first: float, running: bool
) -> list[dict[str, Any]]:
    """Return the elements of a barrel vault along y.

    first: angle of the springing, radians. running: head joints alternate.
    """
    fine = 2 if running else 1
    angles = np.linspace(np.pi - first, first, fine * voussoirs + 1)
    spread = float(angles[0] - angles[fine])
    places = np.linspace(0.0, length, courses + 1)

    def cell(name: str, at: np.ndarray[Any, Any], y0: float, y1: float, **keys: Any) -> dict[str, Any]:
        corners = ((inner, y0), (outer, y0), (outer, y1), (inner, y1))
        sections = np.array([[[r * np.cos(a), y, r * np.sin(a)] for r, y in corners] for a in at])
        return swept(name, sections, **keys)

    elements = []
    for course, (y0, y1) in enumerate(zip(places[:-1].tolist(), places[1:].tolist(), strict=True)):
        parts = steps(voussoirs, course % 2 == 1) if running else [(k, k + 1) for k in range(voussoirs)]
        elements += [cell(f"v{k}c{course}", angles[list(part)], y0, y1) for k, part in enumerate(parts)]
    for name, a, b in (("left", angles[0] + spread, angles[0]), ("right", angles[-1], angles[-1] - spread)):
        elements.append(cell(name, np.array([a, b]), 0.0, length, support=True))
    return elements


def _cross(inner: float, outer: float, reach: float, half: int, courses: int, first: float) -> list[dict[str, Any]]:
    """Return the elements of a cross vault: eight half webs, from groin to end."""
    # The lowest cells of each half web stand on separate supports.
    end = outer + reach
    angles = np.linspace(first, np.pi / 2.0, half + 1)
    spread = float(angles[1] - angles[0])
    shares = np.linspace(0.0, 1.0, courses + 1)
    elements = []
    # along: axis of the barrel; side: half of the web; way: direction of its end
    for along in (0, 1):
        for way in (1, -1):
            for side in (1, -1):

                def point(
                    angle: float, radius: float, share: float, along: int = along, way: int = way, side: int = side
                ) -> list[float]:
                    across = radius * np.cos(angle)
                    # at the groin both barrels have the same distance from the middle
                    run = share * end + (1.0 - share) * across
                    place = [way * run, side * across] if along == 0 else [side * across, way * run]
                    return [float(place[0]), float(place[1]), float(radius * np.sin(angle))]

                mark = f"{'xy'[along]}{'+' if way > 0 else '-'}{'+' if side > 0 else '-'}"
                rows = [(angles[0] - spread, angles[0]), *zip(angles[:-1].tolist(), angles[1:].tolist(), strict=True)]
                for row, (low, high) in enumerate(rows):
                    for course, (s, t) in enumerate(zip(shares[:-1].tolist(), shares[1:].tolist(), strict=True)):
                        sections = np.array(
                            [
                                [point(a, r, share) for r, share in ((inner, s), (outer, s), (outer, t), (inner, t))]
                                for a in (low, high)
                            ]
                        )
                        name = f"{mark}v{row - 1}c{course}" if row else f"{mark}s{course}"
                        elements.append(swept(name, sections, **({} if row else {"support": True})))
    return elements


@parameters.typed
def dome(
    radius: float = 1.5,
    thickness: float = 0.25,
    meridians: int = 8,
    parallels: int = 4,
    springing: float = 0.0,
    oculus: float = 25.0,
    bond: str = "stack",
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make a faceted dome of cells between meridians and parallels, with an oculus.

    Its lowest ring stands on a ring of supports.

    Parameters
    ----------
    radius: radius of the middle surface, m.
    thickness: thickness of the shell, m.
    meridians: number of cells in a ring.
    parallels: number of rings of cells.
    springing: angle at which the dome begins, degrees above the horizontal.
    oculus: half angle of the opening at the top, degrees from the vertical.
    bond: stack, or running (every second ring shifted by half a cell).
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
    check(radius=radius, thickness=thickness, oculus=oculus)
    count(3, meridians=meridians)
    count(1, parallels=parallels)
    cap(meridians * parallels)
    choose("bond", bond, ("stack", "running"))
    if thickness >= 2.0 * radius:
        raise ParameterError("thickness", f"{thickness:g} is wrong", "less than two radii")
    if not (springing >= 0.0 and springing + oculus < 90.0):
        raise ParameterError(
            "oculus", f"{oculus:g} is wrong", "an angle that leaves something between springing and oculus"
        )
    inner, outer = radius - thickness / 2.0, radius + thickness / 2.0
    fine = 2 if bond == "running" else 1
    turns = 2.0 * np.pi * np.arange(fine * meridians) / (fine * meridians)
    heights = np.linspace(np.radians(springing), np.radians(90.0 - oculus), parallels + 1)
    spread = float(heights[1] - heights[0])

    def cell(name: str, at: list[int], low: float, high: float, **keys: Any) -> dict[str, Any]:
        """Return one cell between two heights, through the given meridians."""
        corners = ((inner, low), (inner, high), (outer, high), (outer, low))
        sections = [
            [[r * np.cos(h) * np.cos(t), r * np.cos(h) * np.sin(t), r * np.sin(h)] for r, h in corners]
            for t in turns[at]
        ]
        return swept(name, np.array(sections), **keys)

    elements = []
    rows = [(heights[0] - spread, heights[0]), *zip(heights[:-1].tolist(), heights[1:].tolist(), strict=True)]
    for row, (low, high) in enumerate(rows):
        shift = 1 if fine == 2 and row % 2 == 0 and row else 0
        for k in range(meridians):
            at = [(fine * k + shift + step) % (fine * meridians) for step in range(fine + 1)]
            name = f"m{k}p{row - 1}" if row else f"s{k}"
            elements.append(cell(name, at, float(low), float(high), **({} if row else {"support": True})))
    return scene_of(f"dome of {meridians} × {parallels} cells", elements, stone or Stone(), load)


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
