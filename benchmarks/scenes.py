"""Scenes that several benchmarks measure on: grids of cells, brick walls, cubes, and those of searches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT
from jld_core import Assembly, Floats, Scene, build_assembly, load_scene, parse_scene
from jld_explore import search_space
from jld_explore.space.search_space import SearchSpace
from jld_samples import box

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

    def letter(column: int, row: int) -> str:
        return LETTERS[((column + (length // 2) * (row % 2)) // length + 3 * row) % 26]

    return [
        "".join(letter(column, row) if cell == "a" else cell for column, cell in enumerate(line))
        for row, line in enumerate(rows)
    ]


def grid(
    rows: list[str], live: Any = None, inner: Any = STRENGTH, search: Any = None, *, dry: Any = ANGLE, **keys: Any
) -> Scene:
    """Cells of the paper's stone unless other values are given. live: default a horizontal body load."""
    own = {"cell": (0.1, 0.1), "name": f"grid of {len(rows) - 1} rows", "search": search or {}} | keys
    cell, loads = list(own.pop("cell")), {"live": live or [{"body": [1, 0]}]}
    return parse_scene(cells(rows, cell, dry, inner, loads, **own))


def cells(
    rows: list[str], cell: Any, dry: Any, inner: Any, loads: Any, thickness: Any = 0.1, density: Any = 1400, **keys: Any
) -> dict[str, Any]:
    materials = {"density": density, "dry": dry, "inner": inner}
    return {
        "grid": {"cell": cell, "thickness": thickness, "rows": rows},
        "materials": materials,
        "loads": loads,
        **keys,
    }


def names_of(rows: Sequence[Sequence[str]]) -> list[str]:
    """Names of the cells of a grid."""
    return [f"c{x}r{y}" for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "a"]


def stones(elements: list[Any], live: Any, dry: Any = 0.6, inner: Any = None, **materials: Any) -> dict[str, Any]:
    """Document of elements under live loads. dry: friction coefficient, or values. materials: others, as density."""
    own = {"dry": dry if isinstance(dry, dict) else {"friction_coefficient": dry}, **materials}
    own |= {} if inner is None else {"inner": inner}
    return {"elements": elements, "materials": own, "loads": {"live": live}}


def strength(value: float) -> dict[str, float]:
    return {"tensile_strength": value, "shear_strength": value}


def wall(rows: int, columns: int, tension: float = 2e6, shear: float = 2e5) -> Assembly:
    """A wall of cells of 0.1 m on a row of supports under a horizontal body load; 6 × 8 cells have 90 faces."""
    inner = {"tensile_strength": tension, "shear_strength": shear}
    return build_assembly(grid(["a" * columns] * rows + ["#" * columns], inner=inner))


def brick_wall(courses: int, bricks: int, length: float = 1.0, force: float = 1.0) -> Scene:
    """A dry wall of two wythes in running bond under a load out of its plane; friction 0.65. 10 × 5, 20 × 10 and
    40 × 20 bricks are 110, 420 and 1 640 blocks. Half bricks end every other course; wythes are half a brick apart.

    length, force: of one metre and one newton in other units.
    """
    long, wide, high = 0.2, 0.1, 0.06
    places: list[tuple[str, tuple[float, ...], tuple[float, ...]]] = []
    for course, wythe in itertools.product(range(courses), range(2)):
        ends = np.arange(bricks + 1) * long
        if (course + wythe) % 2:
            ends = np.concatenate([[0.0], ends[:-1] + 0.5 * long, [bricks * long]])
        for k, (left, right) in enumerate(itertools.pairwise(ends.tolist())):
            low = (left, wythe * wide, course * high)
            places.append((f"b{course}.{wythe}.{k}", low, (right, (wythe + 1) * wide, (course + 1) * high)))
    places.append(("slab", (-long, -long, -high), (bricks * long + long, 2 * wide + long, 0.0)))
    elements = [box(name, *([length * x for x in corner] for corner in corners)) for name, *corners in places]
    elements[-1]["support"] = True
    document = stones(elements, [{"body": [0, 1, 0]}], 0.65, density=2000.0 * force / length**3)
    return parse_scene({"name": f"brick wall of {len(elements) - 1} blocks, out of plane", **document})


def cubes(side: int = 3, inner: float = 2e4, load: Any = (1.0, 0.3, 0.0), search: Any = None) -> Scene:
    """side³ cubes of 0.1 m on a slab, pushed at an upper corner; inner: σt = τ, Pa."""
    elements = stacked(side, side, side)
    live = [{"element": f"c00{side - 1}", "force": list(load)}]
    document = stones(elements, live, ANGLE, strength(inner), density=1400)
    return parse_scene({"name": f"cubes {side}×{side}×{side}", "search": search or {}, **document})


def stacked(nx: int, ny: int, nz: int, between: str = "") -> list[dict[str, Any]]:
    """Cubes of 0.1 m on a base, layer by layer; between: what stands between the numbers of a name."""
    elements = [
        box(
            "c" + between.join(f"{k}" for k in (x, y, z)),
            *((0.1 * (x + k), 0.1 * (y + k), 0.1 * (z + k)) for k in (0, 1)),
        )
        for z, y, x in itertools.product(range(nz), range(ny), range(nx))
    ]
    return [*elements, box("base", (0.0, 0.0, -0.1), (0.1 * nx, 0.1 * ny, 0.0), support=True)]


def vault(across: int = 9, deep: int = 3, inner: float = 2e4) -> Scene:
    """A barrel vault over 0.4 m, 0.1 m thick, from 20° to 160°, its springings supports, in blocks of up to three
    voussoirs of 0.15 m, under a force on the edge of its haunch; inner: σt = τ, Pa."""
    angles = np.radians(np.linspace(20.0, 160.0, across + 1))
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    elements = []
    for k, y in itertools.product(range(across), range(deep)):
        ends = ((0.6, 0.7), (0.15 * y, 0.15 * (y + 1)), (float(angles[k]), float(angles[k + 1])))
        corners = [[-r * math.cos(at), far, r * math.sin(at)] for r, far, at in itertools.product(*ends)]
        ends_of = k in (0, across - 1)
        elements.append({"id": f"v{k}y{y}", "vertices": corners, "faces": faces, "support": ends_of})
    live = [{"element": f"v{across // 4}y0", "force": [0, 0, -10]}]
    document = stones(elements, live, 0.75, strength(inner), density=1400)
    search = {"block_cells": [1, 3]}
    return parse_scene({"name": f"barrel vault of {across} × {deep} voussoirs", "search": search, **document})


def column(corners: int, drums: int = 12) -> dict[str, Any]:
    angle = 2.0 * math.pi * np.arange(corners) / corners
    ring = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    elements = [prism(f"d{level}", ring, 0.3 * level, 0.3 * (level + 1)) for level in range(drums + 1)]
    elements[0]["support"] = True
    return stones(elements, [{"body": [1, 0, 0]}], ANGLE, strength(2e4), density=1400)


def prism(name: str, outline: Floats, low: float, top: float) -> dict[str, Any]:
    """An upright prism over an outline (k, 2), counter-clockwise."""
    n = len(outline)
    vertices = [[x, y, z] for z in (low, top) for x, y in outline.tolist()]
    around = [[k, (k + 1) % n, (k + 1) % n + n, k + n] for k in range(n)]
    return {"id": name, "vertices": vertices, "faces": [list(range(n))[::-1], list(range(n, 2 * n)), *around]}


def middle(*columns: int) -> list[dict[str, Any]]:
    return [{"element": f"c{column}r0", "force": [0, -1]} for column in columns]


def searched(rows: list[str], cells: list[int], live: list[dict[str, Any]] | None = None) -> Callable[[], Scene]:
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
    assembly = build_assembly(scene)
    return assembly, search_space(scene, assembly)
