"""Where the proof is in reach: which spaces the exact driver settles while one waits.

Walls of nx × ny cells under a horizontal body load, beams on two bearings under a force, and blocks of cubes, each
with blocks of up to s cells and weak, middling and strong inner faces. What comes out is the rule of
`jld_explore.drivers.choice`, by which a driver is taken when none is named.
`python -m benchmarks.reach SECONDS` gives every space that much processor time at the most, on however busy a machine.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import table, write
from jld_core import Scene, build_assembly, parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.drivers.choice import REACH
from jld_explore.drivers.enumeration import size_up_to
from jld_explore.settings import SMALL
from jld_explore.space import search_space
from jld_explore.study_state import Interrupted, Progress

SECONDS: Final = 10.0

WALLS: Final = ((4, 6), (5, 7), (6, 8), (8, 10), (10, 12))
BEAMS: Final = ((7, 3), (9, 4), (12, 5))
CUBES: Final = ((2, 2, 3), (3, 2, 3), (3, 3, 3))
MOST: Final = (2, 3, 4, 6)
STRENGTHS: Final = (5e3, 2e4, 2e6)
"""σt and τ of inner faces, Pa."""


def _grid(name: str, rows: list[str], live: dict[str, Any], strength: float, most: int) -> Scene:
    return parse_scene(
        {
            "name": name,
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
            "materials": _materials(strength),
            "loads": {"live": [live]},
            "search": {"block_cells": [1, most]},
        }
    )


def _materials(strength: float) -> dict[str, Any]:
    inner = {"tensile_strength": strength, "shear_strength": strength}
    return {"density": 1400, "dry": {"friction_coefficient": 0.75}, "inner": inner}


def _cubes(size: tuple[int, int, int], strength: float, most: int) -> Scene:
    """Cubes of 0.1 m on a slab, under a horizontal body load."""

    def box(name: str, low: Any, high: Any, **more: Any) -> dict[str, Any]:
        corners = [[float(v) for v in corner] for corner in itertools.product(*zip(low, high, strict=True))]
        faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        return {"id": name, "vertices": corners, "faces": faces, **more}

    cells = [
        box("".join(map(str, at)), 0.1 * np.array(at), 0.1 * (np.array(at) + 1))
        for at in itertools.product(*map(range, size))
    ]
    slab = box("slab", (0.0, 0.0, -0.1), (0.1 * size[0], 0.1 * size[1], 0.0), support=True)
    return parse_scene(
        {
            "name": "cubes",
            "elements": [slab, *cells],
            "materials": _materials(strength),
            "loads": {"live": [{"body": [1, 0, 0]}]},
            "search": {"block_cells": [1, most]},
        }
    )


def spaces() -> Iterator[tuple[str, int, float, Scene]]:
    """Name, limit on cells, strength, scene."""
    for most, strength in itertools.product(MOST, STRENGTHS):
        for across, up in WALLS:
            rows = ["a" * across] * (up - 1) + ["#" * across]
            name = f"wall {across} × {up}"
            yield name, most, strength, _grid(name, rows, {"body": [1, 0]}, strength, most)
        for across, up in BEAMS:
            rows = ["a" * across] * up + ["#" + "." * (across - 2) + "#"]
            name, load = f"beam {across} × {up}", {"element": f"c{across // 2}r0", "force": [0, -100]}
            yield name, most, strength, _grid(name, rows, load, strength, most)
        for size in CUBES:
            yield "cubes " + " × ".join(map(str, size)), most, strength, _cubes(size, strength, most)


def measured(seconds: float, only: str = "") -> list[list[str]]:
    """A row a space that is not enumerated anyway."""
    rows = []
    for name, most, strength, scene in spaces():
        if not name.startswith(only):
            continue
        space = search_space(scene, build_assembly(scene))
        if size_up_to(space, SMALL) is not None:
            continue
        facts, took = _proof(scene, seconds)
        gap = "–" if facts["gap"] is None else f"{max(facts['gap'], 0.0):.1%}"
        spent = f"{took:.1f}" if facts["proven"] else f"no: {gap}"
        rows.append([name, str(int(space.candidates.sum())), str(most), f"{strength / 1e3:g}", spent])
        print("\t".join(rows[-1]), flush=True)
    return rows


def _proof(scene: Scene, seconds: float) -> tuple[dict[str, Any], float]:
    """What a search by the exact driver says in the end, and the processor seconds it took, `seconds` at the most."""
    began = time.process_time()

    def stop(now: Progress) -> None:
        if time.process_time() - began > seconds:
            raise Interrupted

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        with contextlib.suppress(Interrupted):
            explore(scene, out, ExploreSettings(driver="exact", jobs=1, pictures=False), stop)
        return json.loads((out / "summary.json").read_text()), time.process_time() - began


def main(seconds: float = SECONDS) -> None:
    """Measure, and write one row a structure and limit, one column a strength."""
    keep(measured(seconds), seconds)


def keep(measurements: list[list[str]], seconds: float) -> None:
    """Write the page of rows as `measured` gives them."""
    found = {(name, int(faces), int(most), strength): spent for name, faces, most, strength, spent in measurements}
    order = sorted({key[:3] for key in found}, key=lambda key: (key[1], key[0], key[2]))
    strengths = [f"{strength / 1e3:g}" for strength in STRENGTHS]
    rows = [[*map(str, key), *(found.get((*key, one), "enumerated") for one in strengths)] for key in order]
    head = ["space", "faces", "most cells", *(f"{strength} kPa" for strength in strengths)]
    within = [spent for (_, faces, _, _), spent in found.items() if faces <= REACH]
    beyond = [spent for (_, faces, _, _), spent in found.items() if REACH < faces <= 1.5 * REACH]
    note = (
        f"Processor seconds to the proof, or `no` and the gap that is left after {seconds:g}, looked at now and then; "
        "one thread. Faces: those that may be dry or inner. Spaces of at most 20 000 classes are enumerated whatever "
        f"the driver. Of spaces of at most {REACH} faces {proofs(within)} are proven, of those of up to "
        f"{1.5 * REACH:g} {proofs(beyond)}: up to {REACH} faces the exact driver is taken unasked."
    )
    write("reach", "\n\n".join(["# Where the proof is in reach", note, table(head, rows)]))


def proofs(spent: list[str]) -> str:
    """How many of them are proofs, and what the longest took."""
    took = [float(one) for one in spent if not one.startswith("no")]
    return f"{len(took)} of {len(spent)}" + (f" (the longest in {max(took):.1f} s)" if took else "")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)
