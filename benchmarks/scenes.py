"""Scenes that several benchmarks measure on: grids of cells, brick walls, cubes, and those of searches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT
from jld_core import Assembly, Scene, build_assembly, load_scene, parse_scene
from jld_explore import search_space
from jld_explore.space.search_space import SearchSpace

LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
GRIDS: Final = {  # rows of cells by the number of faces they make
    33: ["a" * 6] * 3 + ["######"],
    88: ["a" * 6] * 8 + ["######"],
    278: ["a" * 15] * 10 + ["#......#......#"],
    2025: ["a" * 41] * 25 + ["#" * 41],
}

STRENGTH: Final = {"tensile_strength": 2e6, "shear_strength": 2e5}
ANGLE: Final[dict[str, float]] = {"friction_angle": 30}  # inner and dry faces of the paper's stone


def bonded(rows: list[str], length: int = 2) -> list[str]:
    """The same cells as blocks of `length` cells in running bond; neighbours have different letters."""
    return [
        "".join(
            LETTERS[((column + (length // 2) * (row % 2)) // length + 3 * row) % 26] if cell == "a" else cell
            for column, cell in enumerate(line)
        )
        for row, line in enumerate(rows)
    ]


def grid(
    rows: list[str],
    live: list[dict[str, Any]] | None = None,
    inner: dict[str, float] = STRENGTH,
    search: dict[str, Any] | None = None,
    *,
    cell: tuple[float, float] = (0.1, 0.1),
    thickness: float = 0.1,
    density: float = 1400,
    dry: dict[str, float] = ANGLE,
    name: str = "",
) -> Scene:
    """Cells of the paper's stone unless other values are given. live: default a horizontal body load."""
    return parse_scene(
        {
            "name": name or f"grid of {len(rows) - 1} rows",
            "grid": {"cell": list(cell), "thickness": thickness, "rows": rows},
            "materials": {"density": density, "dry": dry, "inner": inner},
            "loads": {"live": live or [{"body": [1, 0]}]},
            "search": search or {},
        }
    )


def strength(value: float) -> dict[str, float]:
    """Equal tensile and shear strength of inner faces, Pa."""
    return {"tensile_strength": value, "shear_strength": value}


def wall(rows: int, columns: int, tension: float = 2e6, shear: float = 2e5) -> Assembly:
    """A wall of cells of 0.1 m on a row of supports under a horizontal body load; 6 × 8 cells have 90 faces."""
    inner = {"tensile_strength": tension, "shear_strength": shear}
    return build_assembly(grid(["a" * columns] * rows + ["#" * columns], inner=inner))


def box(name: str, low: tuple[float, ...], high: tuple[float, ...], **keys: Any) -> dict[str, Any]:
    """A spatial element between two corners."""
    ends = (low, high)
    corners = [[ends[i][0], ends[j][1], ends[k][2]] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"id": name, "vertices": corners, "faces": faces, **keys}


def brick_boxes(
    courses: int, bricks: int, wythes: int = 2, brick: tuple[float, float, float] = (0.2, 0.1, 0.06)
) -> list[tuple[str, tuple[float, ...], tuple[float, ...]]]:
    """Names and corners of the bricks of a wall in running bond, half bricks at the ends of every other course;
    wythes are half a brick out of step. The last entry is the slab it stands on."""
    length, width, height = brick
    boxes: list[tuple[str, tuple[float, ...], tuple[float, ...]]] = []
    for course in range(courses):
        for wythe in range(wythes):
            ends = np.arange(bricks + 1) * length
            if (course + wythe) % 2:
                ends = np.concatenate([[0.0], ends[:-1] + 0.5 * length, [bricks * length]])
            for k, (left, right) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
                low = (left, wythe * width, course * height)
                boxes.append((f"b{course}.{wythe}.{k}", low, (right, (wythe + 1) * width, (course + 1) * height)))
    wide = max(brick)
    slab = ((-wide, -wide, -height), (bricks * length + wide, wythes * width + wide, 0.0))
    return [*boxes, ("slab", *slab)]


def brick_wall(
    courses: int,
    bricks: int,
    direction: str = "out of plane",
    wythes: int = 2,
    brick: tuple[float, float, float] = (0.2, 0.1, 0.06),
) -> Scene:
    """A dry wall in running bond under a horizontal body load; friction 0.65. 10 × 5, 20 × 10 and 40 × 20 bricks
    in two wythes are 110, 420 and 1 640 blocks.

    direction: "out of plane" or "in plane". brick: length, width, height, m.
    """
    elements = [
        box(name, low, high, **({"support": True} if name == "slab" else {}))
        for name, low, high in brick_boxes(courses, bricks, wythes, brick)
    ]
    along = [0.0, 1.0, 0.0] if direction == "out of plane" else [1.0, 0.0, 0.0]
    return parse_scene(
        {
            "name": f"brick wall of {len(elements) - 1} blocks, {direction}",
            "elements": elements,
            "materials": {"density": 2000, "dry": {"friction_coefficient": 0.65}},
            "loads": {"live": [{"body": along}]},
        }
    )


def cubes(
    side: int = 3,
    inner: float = 2e4,
    load: tuple[float, float, float] = (1.0, 0.3, 0.0),
    search: dict[str, Any] | None = None,
) -> Scene:
    """side³ cubes of 0.1 m on a slab, pushed at an upper corner; inner: σt = τ, Pa."""
    elements = [
        box(f"c{x}{y}{z}", (0.1 * x, 0.1 * y, 0.1 * z), (0.1 * (x + 1), 0.1 * (y + 1), 0.1 * (z + 1)))
        for z in range(side)
        for y in range(side)
        for x in range(side)
    ]
    elements.append(box("base", (0.0, 0.0, -0.1), (0.1 * side, 0.1 * side, 0.0), support=True))
    return parse_scene(
        {
            "name": f"cubes {side}×{side}×{side}",
            "elements": elements,
            "materials": {"density": 1400, "dry": ANGLE, "inner": strength(inner)},
            "loads": {"live": [{"element": f"c00{side - 1}", "force": list(load)}]},
            "search": search or {},
        }
    )


def vault(across: int = 9, deep: int = 3, inner: float = 2e4) -> Scene:
    """A barrel vault over 0.4 m, 0.1 m thick, from 20° to 160°, its springings supports, in blocks of up to three
    voussoirs of 0.15 m, under a force on the edge of its haunch; inner: σt = τ, Pa."""
    angles = np.radians(np.linspace(20.0, 160.0, across + 1))
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    elements = []
    for k, y in itertools.product(range(across), range(deep)):
        ends = ((0.6, 0.7), (0.15 * y, 0.15 * (y + 1)), (float(angles[k]), float(angles[k + 1])))
        corners = [[-r * math.cos(at), far, r * math.sin(at)] for r, far, at in itertools.product(*ends)]
        own = {"id": f"v{k}y{y}", "vertices": corners, "faces": faces, "support": k in (0, across - 1)}
        elements.append(own)
    return parse_scene(
        {
            "name": f"barrel vault of {across} × {deep} voussoirs",
            "elements": elements,
            "materials": {"density": 1400, "dry": {"friction_coefficient": 0.75}, "inner": strength(inner)},
            "loads": {"live": [{"element": f"v{across // 4}y0", "force": [0, 0, -10]}]},
            "search": {"block_cells": [1, 3]},
        }
    )


def column(corners: int, drums: int = 12) -> dict[str, Any]:
    """A column of drums, regular prisms of 1 m across and 0.3 m high, pushed sideways."""
    angle = 2.0 * math.pi * np.arange(corners) / corners
    ring = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    around = [[k, (k + 1) % corners, (k + 1) % corners + corners, k + corners] for k in range(corners)]
    faces = [list(range(corners))[::-1], list(range(corners, 2 * corners)), *around]
    elements = []
    for level in range(drums + 1):
        vertices = [[x, y, 0.3 * (level + up)] for up in (0, 1) for x, y in ring.tolist()]
        elements.append(
            {"id": f"d{level}", "vertices": vertices, "faces": faces, **({} if level else {"support": True})}
        )
    materials = {"density": 1400, "dry": ANGLE, "inner": strength(2e4)}
    return {"elements": elements, "materials": materials, "loads": {"live": [{"body": [1, 0, 0]}]}}


def middle(*columns: int) -> list[dict[str, Any]]:
    """Equal loads on the top of some columns."""
    return [{"element": f"c{column}r0", "force": [0, -1]} for column in columns]


def searched(rows: list[str], cells: list[int], live: list[dict[str, Any]]) -> Callable[[], Scene]:
    """A grid whose blocks have so many cells."""
    return lambda: grid(rows, live, search={"block_cells": cells})


ENUMERATED: Final[dict[str, Callable[[], Scene]]] = {
    "flagship": lambda: load_scene(ROOT / "scenes" / "flat_beam_arch.json"),
    "bridge 7x3": searched(["a" * 7] * 3 + ["##...##"], [3, 6], middle(2, 3, 4)),
    # pushed at its top left corner: no symmetry, and a best that is no sliding of the whole
    "wall 6x4": searched(["a" * 6] * 4 + ["##..##"], [2, 3], [{"element": "c1r0", "force": [1, -2]}]),
}
"""Scenes that searches are measured on, small enough to enumerate: 6 382, 42 764 and 115 958 classes."""

LARGE: Final[dict[str, Callable[[], Scene]]] = {  # scenes beyond that
    "planar 88 faces": searched(["a" * 8] * 6 + ["###..###"], [2, 6], middle(3, 4)),
    "planar 278 faces": searched(["a" * 15] * 10 + ["#......#......#"], [2, 6], middle(3, 4, 10, 11)),
    "spatial 3x3x3": lambda: cubes(search={"block_cells": [2, 6]}),
}


def built(scene: Scene) -> tuple[Assembly, SearchSpace]:
    """Assembly and search space of a scene."""
    assembly = build_assembly(scene)
    return assembly, search_space(scene, assembly)
