"""Ten solids for `jld cut`, lengths in m: each with its box, load and least load factor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from manifold3d import CrossSection, Manifold


@dataclass(frozen=True)
class Case:
    """A solid, the box of its parts, m, and its loads, N."""

    solid: Callable[[], Any]
    fit: float
    loads: tuple[str, ...]


def block(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> Any:
    return Manifold.cube((x1 - x0, y1 - y0, z1 - z0)).translate((x0, y0, z0))


def standing(outline: list[tuple[float, float]], width: float) -> Any:
    """Extrude an outline in x and z along y."""
    return CrossSection([np.array(outline)]).extrude(width).rotate((90, 0, 0)).translate((0, width, 0))


def bench() -> Any:
    return block(0, 0, 0.4, 1.8, 0.4, 0.5) + block(0.1, 0, 0, 0.3, 0.4, 0.41) + block(1.5, 0, 0, 1.7, 0.4, 0.41)


def bridge() -> Any:
    """A footbridge: a segment of a circle below, a hump above."""
    angle = np.linspace(np.pi / 2 + 0.9, np.pi / 2 - 0.9, 24)
    radius = 1.5 / np.sin(0.9)
    low = [(1.5 + radius * np.cos(a), radius * (np.sin(a) - np.cos(0.9))) for a in angle]
    high = [(3.4, 0.0), (3.4, 0.4), (3.0, 1.0), (1.5, 1.15), (0.0, 1.0), (-0.4, 0.4), (-0.4, 0.0)]
    return standing([*low, *high], 1.0)


def shell() -> Any:
    dome = Manifold.sphere(1.6, 48) - Manifold.sphere(1.4, 48)
    half = dome ^ block(-2, -2, 0, 2, 2, 2)
    for turn in range(2):
        half -= Manifold.cylinder(4, 0.85, 0.85, 32, True).rotate((90, 0, 90 * turn))
    return half


def arch() -> Any:
    outer = CrossSection.circle(2.0, 48) - CrossSection.circle(1.3, 48)
    ring = outer.extrude(0.7) ^ block(-3, 0, -1, 3, 3, 1)
    standing_arch = ring.rotate((90, 0, 0))
    return standing_arch - Manifold.cylinder(2, 0.16, 0.16, 24, True).rotate((90, 0, 0)).translate((0, 0, 1.66))


def stair() -> Any:
    whole = Manifold.cylinder(2.0, 0.25, 0.25, 32)
    for k in range(10):
        step = CrossSection([np.array([(0, -0.02), (1.1, -0.25), (1.1, 0.25), (0, 0.02)])]).extrude(0.3)
        whole += step.rotate((0, 0, 36 * k)).translate((0, 0, 0.2 * k - (0.1 if k else 0.0)))
    return whole


def table() -> Any:
    top = Manifold.cylinder(0.08, 0.7, 0.7, 48).translate((0, 0, 0.7))
    legs = [Manifold.cylinder(0.71, 0.09, 0.07, 16).translate((x, y, 0)) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    return Manifold.batch_boolean([top, *legs], _add())


def _add() -> Any:
    from manifold3d import OpType

    return OpType.Add


def chair() -> Any:
    seat = block(0, 0, 0.4, 0.5, 0.5, 0.48) + block(0, 0.42, 0.4, 0.5, 0.5, 1.0)
    legs = [block(x, y, 0, x + 0.08, y + 0.08, 0.41) for x in (0, 0.42) for y in (0, 0.42)]
    return Manifold.batch_boolean([seat, *legs], _add())


def column() -> Any:
    parts = [Manifold.cylinder(1.2, 0.22, 0.18, 24)]
    for k in range(4):
        ball = Manifold.sphere(0.18, 16)
        parts.append(
            (
                ball.translate((0, 0, 1.15))
                + ball.scale((0.7, 0.7, 0.7))
                .rotate((0, 0, 90 * k))
                .translate((0.75 * np.cos(k * np.pi / 2), 0.75 * np.sin(k * np.pi / 2), 2.1))
            ).hull()
        )
    return Manifold.batch_boolean(parts, _add()) ^ block(-2, -2, 0, 2, 2, 2.15)


def corbel() -> Any:
    outline = [(0, 0), (0.5, 0), (0.5, 1.0), (0.7, 1.0), (0.7, 1.3), (0.95, 1.3), (0.95, 1.6), (0, 1.6)]
    return standing(outline, 0.5)


def dome() -> Any:
    whole = Manifold.sphere(2.0, 48) - Manifold.sphere(1.7, 48)
    return (whole ^ block(-3, -3, 0, 3, 3, 3)) - Manifold.cylinder(3, 0.45, 0.45, 32)


SOLIDS: Final[dict[str, Case]] = {
    "bench": Case(bench, 0.95, ("0,0,-1000@0.6,-1,0.49,1.2,1,0.51",)),
    "bridge": Case(bridge, 1.7, ("0,0,-20000@1.2,-1,0.9,1.8,2,2",)),
    "shell": Case(shell, 1.3, ("0,0,-10000@-2,-2,1.2,2,2,2",)),
    "arch": Case(arch, 1.4, ("0,0,-10000@-0.4,-2,1.9,0.4,2,2.1",)),
    "stair": Case(stair, 0.9, ("0,0,-500@0.6,-2,0,2,2,2.5",)),
    "table": Case(table, 0.75, ("0,0,-1000@-0.2,-0.2,0.7,0.2,0.2,1",)),
    "chair": Case(chair, 0.6, ("0,0,-1000@0,0,0.4,0.5,0.4,0.5",)),
    "column": Case(column, 1.0, ("0,0,-4000@-2,-2,2.1,2,2,3",)),
    "corbel": Case(corbel, 0.7, ("0,0,-2000@0.7,-1,1.5,1,2,2",)),
    "dome": Case(dome, 2.0, ("0,0,-20000@-2,-2,1.6,2,2,3",)),
}
