"""Samples: arches, buttresses, walls in bonds and grids in the plane; vaults, domes, corners, a room in space."""

from __future__ import annotations

import itertools
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, ParameterError, Scene, parameters, parse_scene
from jld_masonry import bonds
from jld_samples.stone import Stone, box, cap, check, choose, count, materials, scene_of, steps, swept

_RINGS: Final = ("stack", "running")  # names of the bonds of an arch


@parameters.typed
def arch(
    radius: float = 1.0,
    thickness: float = 0.2,
    embrace: float = 180.0,
    voussoirs: int = 12,
    rings: int = 1,
    depth: float = 0.2,
    bond: str = "stack",
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make a circular arch of voussoirs in rings, between two springers that are supports.

    Parameters
    ----------
    radius: radius of the centreline, m.
    thickness: thickness of all rings together, m.
    embrace: angle from springing to springing, degrees; 180 is a semicircle.
    voussoirs: number of cells along the arch.
    rings: number of cells across the arch; ring 0 is the innermost.
    depth: out-of-plane depth, m.
    bond: stack (joints of all rings in line) or running (every second ring shifted by half a voussoir).
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
    check(radius=radius, thickness=thickness, depth=depth)
    count(1, voussoirs=voussoirs, rings=rings)
    cap(voussoirs * rings)
    choose("bond", bond, _RINGS)
    if not 0.0 < embrace < 360.0 or thickness >= 2.0 * radius:
        wrong, limit = (
            (embrace, "an angle between 0 and 360") if thickness < 2.0 * radius else (thickness, "less than two radii")
        )
        raise ParameterError("embrace" if thickness < 2.0 * radius else "thickness", f"{wrong:g} is wrong", limit)
    half = np.radians(embrace) / 2.0
    fine = bond == "running"
    angles = np.linspace(np.pi / 2.0 + half, np.pi / 2.0 - half, (2 if fine else 1) * voussoirs + 1)
    radii = np.linspace(radius - thickness / 2.0, radius + thickness / 2.0, rings + 1)
    elements: list[dict[str, Any]] = []
    for ring in range(rings):
        offset = fine and ring % 2 == 1
        parts = steps(voussoirs, offset) if fine else [(k, k + 1) for k in range(voussoirs)]
        for number, part in enumerate(parts):
            inner, outer = (_on_circle(r, angles[list(part)]) for r in radii[ring : ring + 2])
            elements.append({"id": f"v{number}r{ring}", "polygon": [*outer.tolist(), *inner[::-1].tolist()]})
    spread = float(angles[0] - angles[1]) * (2 if fine else 1)
    for name, a, b in (("left", angles[0], angles[0] + spread), ("right", angles[-1], angles[-1] - spread)):
        inner, outer = (_on_circle(r, np.array([a, b])) for r in (radii[0], radii[-1]))
        elements.append({"id": name, "polygon": [*outer.tolist(), *inner[::-1].tolist()], "support": True})
    title = f"arch of {voussoirs} voussoirs" + (f" in {rings} rings" if rings > 1 else "")
    return scene_of(title, elements, stone or Stone(), load, depth=depth)


def _on_circle(radius: float, angles: Floats) -> Floats:
    """Return the points (k, 2) at angles (k,) on a circle about the origin."""
    return float(radius) * np.column_stack([np.cos(angles), np.sin(angles)])


@parameters.typed
def flat_arch(
    span: float = 2.0,
    height: float = 0.4,
    voussoirs: int = 7,
    rings: int = 1,
    focus: float = 1.5,
    depth: float = 0.3,
    load: str = "crown",
    stone: Stone | None = None,
) -> Scene:
    """Make a flat arch of wedges between raked springers, with joints directed to one point.

    Parameters
    ----------
    span: clear span at the soffit, m.
    height: height of the arch, m.
    voussoirs: number of wedges.
    rings: number of layers of cells over the height.
    focus: distance below the soffit of the point where the joints would meet, m.
    depth: out-of-plane depth, m.
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
    check(span=span, height=height, focus=focus, depth=depth)
    count(1, voussoirs=voussoirs, rings=rings)
    cap(voussoirs * rings)
    levels = np.linspace(0.0, height, rings + 1)
    soffit = np.linspace(-span / 2.0, span / 2.0, voussoirs + 1)

    def at(x: float, y: float) -> list[float]:
        """Return the point at height y on the joint line through x at the soffit."""
        return [float(x * (focus + y) / focus), float(y)]

    elements: list[dict[str, Any]] = [
        {"id": f"v{k}r{r}", "polygon": [at(a, low), at(b, low), at(b, high), at(a, high)]}
        for r, (low, high) in enumerate(itertools.pairwise(levels))
        for k, (a, b) in enumerate(itertools.pairwise(soffit))
    ]
    far = at(span / 2.0, height)[0] + height
    end = span / 2.0
    left = [[-far, 0.0], at(-end, 0.0), at(-end, height), [-far, height]]
    right = [at(end, 0.0), [far, 0.0], [far, height], at(end, height)]
    elements += [{"id": "left", "polygon": left, "support": True}, {"id": "right", "polygon": right, "support": True}]
    return scene_of(f"flat arch of {voussoirs} wedges", elements, stone or Stone(), load, depth=depth)


@parameters.typed
def buttress(
    height: float = 4.0,
    base: float = 1.6,
    top: float = 0.8,
    courses: int = 8,
    columns: int = 2,
    thrust: float = 0.8,
    rise: float = 0.0,
    depth: float = 1.0,
    stone: Stone | None = None,
) -> Scene:
    """Make a buttress with a battered back on a footing, under a thrust on its upright face.

    Parameters
    ----------
    height: height above the footing, m.
    base: width at the foot, m.
    top: width at the top, m.
    courses: number of rows of cells.
    columns: number of cells in a row.
    thrust: height of the thrust, as a share of the height.
    rise: slope of the thrust, vertical over horizontal, positive downwards.
    depth: out-of-plane depth, m.
    stone: material; None for the default of `Stone`.

    Returns
    -------
    Scene
        Validated scene in m and N.

    Raises
    ------
    InputError
        A dimension or count is invalid.
    """
    check(height=height, base=base, top=top, depth=depth)
    count(1, courses=courses, columns=columns)
    cap(courses * columns)
    if not 0.0 <= thrust <= 1.0:
        raise ParameterError("thrust", f"{thrust:g} is wrong", "a share of the height, from 0 to 1")
    levels = np.linspace(0.0, height, courses + 1)
    width = base + (top - base) * levels / height

    def at(level: int, column: int) -> list[float]:
        return [float(width[level] * column / columns), float(levels[level])]

    elements: list[dict[str, Any]] = [
        {"id": f"c{k}b{j}", "polygon": [at(k, j), at(k, j + 1), at(k + 1, j + 1), at(k + 1, j)]}
        for k in range(courses)
        for j in range(columns)
    ]
    footing = [[-0.25 * base, -0.2 * base], [1.25 * base, -0.2 * base], [1.25 * base, 0.0], [-0.25 * base, 0.0]]
    elements.append({"id": "footing", "polygon": footing, "support": True})
    course = min(int(thrust * courses), courses - 1)
    return parse_scene(
        {
            "name": f"buttress of {courses} courses",
            "elements": elements,
            "thickness": depth,
            "materials": materials(stone or Stone()),
            "loads": {"live": [{"element": f"c{course}b0", "force": [1.0, -rise], "at": [0.0, thrust * height]}]},
        },
        "buttress",
    )


@parameters.typed
def wall(
    courses: int = 6,
    length: float = 2.4,
    brick: float = 0.4,
    height: float = 0.2,
    bond: str = "running",
    depth: float = 0.2,
    opening: str | None = None,
    bearing: float = 0.2,
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make a wall of courses in a bond on a footing, optionally with an opening and lintel.

    Parameters
    ----------
    courses: number of courses, from bottom to top.
    length: length of the wall, m.
    brick: length of a stretcher, m; a header is half as long.
    height: height of a course, m.
    bond: running, third, stack, english or flemish.
    depth: out-of-plane depth, m.
    opening: x,y,width,height: lower left corner and size, m; rounded to whole courses.
    bearing: length by which the lintel extends into the wall on either side, m.
    load: push (horizontal body load), crown or quarter (1 N downwards at that place).
    stone: material; None for the default of `Stone`.

    Returns
    -------
    Scene
        Validated scene in m and N.

    Raises
    ------
    InputError
        A dimension, count or name is invalid, or the opening does not fit.
    """
    check(length=length, brick=brick, height=height, depth=depth, bearing=bearing)
    count(1, courses=courses)
    cap(courses * length / brick)
    rows = [bonds.course(bond, k, length, brick) for k in range(courses)]
    hole = _opening(opening, courses, height, length) if opening is not None else None
    elements: list[dict[str, Any]] = []
    for k, ends in enumerate(rows):
        pieces = list(itertools.pairwise(ends))
        names: list[str | None] = [None] * len(pieces)
        if hole is not None and hole[2] <= k < hole[3]:
            pieces = bonds.without(pieces, hole[0], hole[1], 0.25 * brick)
            names = [None] * len(pieces)
        if hole is not None and k == hole[3]:
            left, right = max(0.0, hole[0] - bearing), min(length, hole[1] + bearing)
            pieces = sorted([*bonds.without(pieces, left, right, 0.25 * brick), (left, right)])
            names = ["lintel" if a == left else None for a, _ in pieces]
        for number, ((a, b), name) in enumerate(zip(pieces, names, strict=True)):
            low, high = k * height, (k + 1) * height
            polygon = [[float(x), float(y)] for x, y in ((a, low), (b, low), (b, high), (a, high))]
            elements.append({"id": name or f"c{k}b{number}", "polygon": polygon})
    ground = [[-brick, -height], [length + brick, -height], [length + brick, 0.0], [-brick, 0.0]]
    elements.append({"id": "footing", "polygon": ground, "support": True})
    return scene_of(f"wall in {bond} bond", elements, stone or Stone(), load, depth=depth)


def _opening(text: str, courses: int, height: float, length: float) -> tuple[float, float, int, int]:
    """Return left, right, first course and lintel course of an opening; raise ParameterError if it does not fit."""
    try:
        x, y, wide, tall = (float(part) for part in text.split(","))
    except ValueError:
        raise ParameterError("opening", f"{text!r} is no opening", "x,y,width,height, as 1.0,0.4,0.8,0.6") from None
    first, last = round(y / height), round((y + tall) / height)
    if not (x > 0.0 and wide > 0.0 and x + wide < length and 0 <= first < last < courses):
        raise ParameterError(
            "opening", f"{text!r} does not fit", "an opening inside the wall with a course above it for the lintel"
        )
    return x, x + wide, first, last


@parameters.typed
def grid(
    columns: int = 8,
    rows: int = 4,
    cell: float = 0.2,
    height: float | None = None,
    depth: float = 0.2,
    support: str = "bottom",
    block: int = 1,
    load: str = "push",
    stone: Stone | None = None,
) -> Scene:
    """Make a rectangle of equal cells.

    Parameters
    ----------
    columns: number of cells in a row.
    rows: number of rows of cells.
    cell: width of a cell, m.
    height: height of a cell, m; default its width.
    depth: out-of-plane depth, m.
    support: bottom (a row below), ends (a column at either side), or bearings (one cell below either end).
    block: number of consecutive cells of a row that form a block of the scene's own labelling.
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
    tall = cell if height is None else height
    check(cell=cell, height=tall, depth=depth)
    count(1, columns=columns, rows=rows, block=block)
    cap(columns * rows)
    choose("support", support, ("bottom", "ends", "bearings"))
    letters = "abcdefghijklmnopqrstuvwxyz"
    lines = ["".join(letters[(c // block + 7 * r) % 26] for c in range(columns)) for r in range(rows)]
    left = 0
    if support == "ends":
        lines, left = ["#" + line + "#" for line in lines], 1
    elif columns > 1 and support == "bearings":
        lines.append("#" + "." * (columns - 2) + "#")
    else:
        lines.append("#" * columns)
    choose("load", load, ("push", "crown", "quarter"))
    live: dict[str, Any] = {"body": [1.0, 0.0]}
    if load != "push":
        share = 0.5 if load == "crown" else 0.25
        x, top = cell * (left + share * columns), tall * len(lines)
        column = left + min(int(share * columns), columns - 1)
        live = {"element": f"c{column}r0", "force": [0.0, -1.0], "at": [x, top]}
    return parse_scene(
        {
            "name": f"grid of {columns} × {rows} cells",
            "grid": {"cell": [cell, tall], "thickness": depth, "rows": lines},
            "materials": materials(stone or Stone()),
            "loads": {"live": [live]},
        },
        "grid",
    )


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
    joints = np.linspace(0.0, length, courses + 1)

    def cell(name: str, at: np.ndarray[Any, Any], y0: float, y1: float, **keys: Any) -> dict[str, Any]:
        corners = ((inner, y0), (outer, y0), (outer, y1), (inner, y1))
        sections = np.array([[[r * np.cos(a), y, r * np.sin(a)] for r, y in corners] for a in at])
        return swept(name, sections, **keys)

    elements = []
    for course, (y0, y1) in enumerate(zip(joints[:-1].tolist(), joints[1:].tolist(), strict=True)):
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
    # along: axis of the barrel; side: half of the web; sign: direction of its end
    for along in (0, 1):
        for sign in (1, -1):
            for side in (1, -1):

                def point(
                    angle: float, radius: float, share: float, along: int = along, sign: int = sign, side: int = side
                ) -> list[float]:
                    across = radius * np.cos(angle)
                    # at the groin both barrels have the same distance from the middle
                    run = share * end + (1.0 - share) * across
                    xy = [sign * run, side * across] if along == 0 else [side * across, sign * run]
                    return [float(xy[0]), float(xy[1]), float(radius * np.sin(angle))]

                mark = f"{'xy'[along]}{'+' if sign > 0 else '-'}{'+' if side > 0 else '-'}"
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
        start, end, first, last = _opening_of_text(name, text, form, thickness, room_left, height, courses)
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


def _opening_of_text(
    name: str, text: str, form: str, start: float, length: float, height: float, courses: int
) -> tuple[float, float, int, int]:
    """Return both jambs of an opening along its wall, its first course, and that of its lintel."""
    # text: position, sill, width and height, as in `form`.
    try:
        numbers = [float(part) for part in text.split(",")]
        position, *sill, wide, tall = numbers
    except ValueError:
        numbers = []
    if len(numbers) != form.count(",") + 1:
        raise ParameterError(name, f"{text!r} is no opening", f"{form}, or none")
    first = round(sill[0] / height) if sill else 0
    last = round(((sill[0] if sill else 0.0) + tall) / height)
    fits = position > start and wide > 0.0 and position + wide < start + length and 0 <= first < last < courses
    if not fits or (sill and first == 0):
        expected = "an opening between the corners with a course above it" + (" and below it" if sill else "")
        raise ParameterError(name, f"{text!r} does not fit", expected)
    return position, position + wide, first, last
