"""Scenes that searches are measured on: three small enough to enumerate, and three beyond that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.scene import Scene, load_scene, parse_scene
from jld_explore.space import SearchSpace, search_space


def grid(rows: list[str], cells: list[int], live: list[dict[str, Any]], **inner: float) -> dict[str, Any]:
    """A scene of 0.1 m cells with the flagship's materials, or other strengths of the inner faces."""
    return {
        "name": " ".join(rows),
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": {
            "density": 1400,
            "dry": {"friction_angle": 30},
            "inner": {"tensile_strength": 2e6, "shear_strength": 2e5, **inner},
        },
        "loads": {"live": live},
        "search": {"block_cells": cells},
    }


def middle(*columns: int) -> list[dict[str, Any]]:
    """Equal loads on the top of some columns."""
    return [{"element": f"c{column}r0", "force": [0, -1]} for column in columns]


def _spatial() -> Scene:
    """3×3×3 cubes on a base, pushed at the middle of a top edge."""
    weak = {"tensile_strength": 2e4, "shear_strength": 2e4}
    cells = [(x, y, z) for z in range(3) for y in range(3) for x in range(3)]
    cube = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    sides = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    elements: list[dict[str, Any]] = [
        {"id": f"c{x}{y}{z}", "vertices": (0.1 * np.add(cube, [x, y, z])).tolist(), "faces": sides} for x, y, z in cells
    ]
    base = (np.array(cube) * [0.3, 0.3, 0.1] - [0.0, 0.0, 0.1]).tolist()
    elements.append({"id": "base", "vertices": base, "faces": sides, "support": True})
    document = grid([], [2, 6], [{"element": "c002", "force": [1, 0.3, 0]}], **weak)
    del document["grid"]
    return parse_scene(document | {"name": "cubes 3x3x3", "elements": elements})


ENUMERATED: Final[dict[str, Callable[[], Scene]]] = {
    "flagship": lambda: load_scene(ROOT / "scenes" / "flat_beam_arch.json"),
    "bridge 7x3": lambda: parse_scene(grid(["a" * 7] * 3 + ["##...##"], [3, 6], middle(2, 3, 4))),
    # pushed at its top left corner: no symmetry, and a best that is no sliding of the whole
    "wall 6x4": lambda: parse_scene(grid(["a" * 6] * 4 + ["##..##"], [2, 3], [{"element": "c1r0", "force": [1, -2]}])),
}
"""6 382, 42 764 and 115 958 classes."""

LARGE: Final[dict[str, Callable[[], Scene]]] = {
    "planar 88 faces": lambda: parse_scene(grid(["a" * 8] * 6 + ["###..###"], [2, 6], middle(3, 4))),
    "planar 278 faces": lambda: parse_scene(grid(["a" * 15] * 10 + ["#......#......#"], [2, 6], middle(3, 4, 10, 11))),
    "spatial 3x3x3": _spatial,
}


def built(scene: Scene) -> tuple[Assembly, SearchSpace]:
    """Assembly and search space of a scene."""
    assembly = build_assembly(scene)
    return assembly, search_space(scene, assembly)
