"""Forty problems of joint layout design for others to enter, from 9 to 900 faces: see docs/guide/benchmark.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from studies import published_wall
from studies.scenes import corner, leonardo_flat_arch, polar_grid_arch, wall_with_opening

from benchmarks.common import ROOT
from benchmarks.scenes import cubes, grid, middle, strength, vault
from jld_core import Scene, load_scene, samples
from jld_core.scene.reading import parse_scene
from jld_maps.benchmark import PROBLEMS as _PACKAGED

FOLDER: Final = _PACKAGED
TOP: Final = {"element": "c0r0", "force": [1, 0]}
PUSH: Final = [{"body": [1, 0]}]


def wall(
    columns: int, rows: int, live: Any = None, base: str = "", weak: bool = True, **search: Any
) -> Callable[[], Scene]:
    """A wall of cells under a push at its top corner, or other loads.

    weak: inner faces crack under some times their weight, μ = 0.75; else the paper's stone.
    """
    lines = ["a" * columns] * rows + [base or "#" * columns]
    own: Any = {"inner": strength(2e4), "dry": {"friction_coefficient": 0.75}} if weak else {}
    return lambda: grid(lines, live or [TOP], search=search, **own)


def changed(make: Callable[[], Scene], name: str, **sections: Any) -> Callable[[], Scene]:
    """A scene with sections added or replaced."""

    def made() -> Scene:
        document = make().model_dump(mode="json", exclude_unset=True)
        own = document["materials"] | sections.get("materials", {})
        return parse_scene(document | sections | {"name": name, "materials": own})

    return made


def cases(**loads: list[dict[str, Any]]) -> dict[str, Any]:
    return {"cases": [{"name": name, "live": live} for name, live in loads.items()]}


ARCH: Final = ROOT / "scenes" / "flat_beam_arch.json"
OPENING: Final = ["aaaaaaa", "aaaaaaa", "aa...aa", "aa...aa", "#######"]
WEAK: Final = {"dry": {"friction_angle": 30, "cohesion": 500}, "inner": {**strength(2e4), "friction_coefficient": 0.4}}
AXLE: Final = {"name": "axle", "path": [[0.05, 0.3], [0.65, 0.3]], "axles": [{"weight": 1}], "steps": 4}
AWAY: Final = [{"element": "c4r0", "force": [-1, -1]}]


def pushed(course: int) -> dict[str, Any]:
    """A push outwards at the free end of the upper course of a corner."""
    return {"live": [{"element": f"p0k{course}", "force": [1, 0.3, 0]}]}


def fields(gap: float) -> dict[str, Any]:
    return {"kind": "fields", "gap": gap}


PROBLEMS: Final[dict[str, Callable[[], Scene]]] = {
    # one load
    "lintel-3x2": wall(3, 2, middle(1), "#.#"),
    "wall-3x3": wall(3, 3),
    "wall-4x3-corner": wall(4, 3, [{"element": "c0r0", "force": [1, -2]}]),
    "bridge-5x2": wall(5, 2, middle(2), "#...#"),
    "bridge-7x2": wall(7, 2, middle(3), "##...##"),
    "wall-4x4": wall(4, 4),
    "wall-5x4": wall(5, 4, block_cells=[1, 5]),
    "wall-6x5": wall(6, 5, block_cells=[1, 6]),
    "wall-8x6": wall(8, 6, block_cells=[1, 6]),
    "wall-12x8": wall(12, 8, block_cells=[2, 8]),
    "wall-20x12": wall(20, 12, block_cells=[2, 8]),
    "wall-30x15": wall(30, 15, block_cells=[2, 8]),
    # limits on the cells of blocks
    "beam-arch": lambda: load_scene(ARCH),
    "bridge-7x3": wall(7, 3, middle(2, 3, 4), "##...##", weak=False, block_cells=[3, 6]),
    "wall-6x4-corner": wall(6, 4, [{"element": "c1r0", "force": [1, -2]}], "##..##", weak=False, block_cells=[2, 3]),
    "leonardo-9x2": lambda: leonardo_flat_arch(search={"block_cells": [2, 4]}),
    "bridge-8x6": wall(8, 6, middle(3, 4), "###..###", weak=False, block_cells=[2, 6]),
    "bridge-15x10": wall(15, 10, middle(3, 4, 10, 11), "#......#......#", weak=False, block_cells=[2, 6]),
    "opening-7x4": lambda: wall_with_opening(OPENING, search={"block_cells": [1, 3]}),
    "overhang-6x3": wall(6, 3, middle(5), "####..", block_cells=[1, 4]),
    "cohesive-5x3": changed(wall(5, 3, block_cells=[1, 4]), "wall with cohesion", materials=WEAK),
    # several load cases
    "beam-arch-two-loads": changed(lambda: load_scene(ARCH), "beam-arch, two loads",
                                   loads=cases(left=middle(1), right=middle(3))),
    "wall-two-winds": lambda: load_scene(ROOT / "scenes" / "wall_in_two_winds.json"),
    "bridge-7x3-moving": changed(wall(7, 3, base="##...##", block_cells=[2, 6]), "bridge under a moving load",
                                 loads={"moving": [AXLE]}),
    "wall-5x4-three": changed(wall(5, 4, block_cells=[1, 4]), "wall, three loads",
                              loads=cases(right=[TOP], left=AWAY, both=[TOP, *AWAY])),
    # other limits
    "wall-4x4-two-shapes": wall(4, 4, block_cells=[2, 3], shapes=[1, 2]),
    "wall-4x4-many-joints": wall(4, 4, dry_faces=[14, None]),
    "bridge-7x3-five-blocks": wall(7, 3, middle(3), "##...##", blocks=[5, 5], block_cells=[2, 6]),
    "bridge-7x3-convex": wall(7, 3, middle(3), "##...##", convex_blocks=True, block_cells=[1, 6]),
    # others' structures
    "cap-wall-4x4": published_wall.wall,
    "arch-2x8": lambda: polar_grid_arch(2, 8, 0.16, [{"body": [1, 0]}], {"block_cells": [2, 4]}),
    "arch-2-rings": lambda: samples.arch(rings=2, voussoirs=14, thickness=0.24, bond="running", load="quarter"),
    # blocks that crack anywhere
    "lintel-3x2-fields": changed(wall(3, 2, middle(1), "#.#"), "lintel, cracks by fields", cracks=fields(0.05)),
    "wall-3x3-fields": changed(wall(3, 3, block_cells=[2, 4]), "wall, cracks by fields", cracks=fields(0.01)),
    # space
    "cubes-2": lambda: cubes(2),
    "cubes-3": lambda: cubes(3, search={"block_cells": [2, 6]}),
    "vault-9x3": vault,
    "corner-2": changed(lambda: corner(2, 0.0, None, {"block_cells": [1, 3]}), "corner-2", loads=pushed(1)),
    "corner-4": changed(lambda: corner(4, 0.0, None, {"block_cells": [1, 3]}), "corner-4", loads=pushed(3)),
    "dome": lambda: samples.dome(load="crown"),
}  # fmt: skip
"""Name → scene of each problem."""
