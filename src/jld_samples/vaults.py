"""Spatial samples: barrel and cross vaults, faceted domes."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core import ParameterError, Scene, parameters
from jld_samples.stone import Stone, cap, check, choose, count, scene_of, steps, swept


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
