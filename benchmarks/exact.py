"""How large a wall can be cut optimally with proof, how long that takes, and what enumeration would take.

Walls of nx × ny cells, the bottom row supports, under a horizontal body load; blocks of 1 to s cells. Times are of the
whole command, pictures apart. `python -m benchmarks.exact SECONDS` gives every wall that long at the most.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from benchmarks.common import table, write
from jld_core import Scene, build_assembly, parse_scene
from jld_explore import explore as exploring
from jld_explore.candidates import search_space
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.explore import ExploreSettings

WALLS: Final = (
    (4, 6, 2, 2e4, "3 s"),
    (4, 6, 3, 2e4, "3 s"),
    (5, 7, 2, 2e4, "6 s"),
    (5, 7, 3, 2e4, "30 s"),
    (5, 7, 4, 2e4, "–"),
    (6, 8, 2, 2e4, "30 s"),
    (6, 8, 3, 2e4, "60 s"),
    (8, 10, 2, 2e4, "120 s"),
    (4, 6, 3, 5e3, "10 s"),
    (5, 7, 3, 5e3, "300 s"),
)
"""Cells across and up, cells in a block, σt = τ in Pa, time asked for."""

SECONDS: Final = 60.0
_RATE: Final = 1000.0
"""Labellings a second that enumeration is taken to evaluate on these walls."""
_COUNTED: Final = 3_000_000


def wall(across: int, up: int, cells: int, strength: float) -> Scene:
    """A wall with a row of supports at its foot."""
    document: dict[str, Any] = {
        "name": f"wall {across} × {up}",
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a" * across] * (up - 1) + ["#" * across]},
        "materials": {
            "density": 1400,
            "dry": {"friction_coefficient": 0.75},
            "inner": {"tensile_strength": strength, "shear_strength": strength},
        },
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"block_cells": [1, cells]},
    }
    return parse_scene(document)


def _size(scene: Scene) -> int | None:
    """Labellings of the space, None where there are more than can be counted soon."""
    total = 0
    for rows, _ in Enumeration(search_space(scene, build_assembly(scene))).batches():
        total += len(rows)
        if total > _COUNTED:
            return None
    return total


def main(seconds: float = SECONDS) -> None:
    """Prove every wall, or report the gap it got to."""
    rows = []
    for across, up, cells, strength, asked in WALLS:
        scene = wall(across, up, cells, strength)
        size = _size(scene)
        with tempfile.TemporaryDirectory() as folder:
            settings = ExploreSettings(driver="exact", jobs=1, seconds=seconds)
            facts = exploring.explore(scene, Path(folder) / "out", settings).summary
        bound, gap = facts["bound"], facts["gap"]
        rows.append(
            [
                f"{across} × {up}, s = {cells}, {strength / 1e3:g} kPa",
                f"more than {_COUNTED:.0e}" if size is None else str(size),
                "none" if facts["best"] is None else f"{facts['best']:.7f}",
                "none" if bound is None else f"{bound:.7f}",
                "–" if gap is None else f"{gap:.0e}",
                str(facts["stop_reason"]),
                str(facts["conflicts"]),
                str(facts["solved"]),
                f"{facts['seconds']:.1f}",
                asked,
                ("more than " if size is None else "") + f"{(size or _COUNTED) / _RATE:.0f}",
            ]
        )
        print(rows[-1], flush=True)
    head = ["wall", "space", "λ", "bound", "gap", "stopped", "conflicts", "solves", "s", "asked", "s to enumerate"]
    write("exact", f"# Proven optima of walls\n\n{table(head, rows)}\n\nAt most {seconds:g} s each, one thread.")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)
