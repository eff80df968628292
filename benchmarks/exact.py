"""How large a structure can be cut optimally with proof, how long that takes, and what enumeration would take.

Walls of nx × ny cells, the bottom row supports, under a horizontal body load, blocks of 1 to s cells; then a beam on
two bearings, a flat arch between abutments, a larger wall. Times are of the whole command, pictures apart. Then whole
fronts, the best for every number of dry faces.
`python -m benchmarks.exact SECONDS LONG proofs` gives every wall and every other scene that long at the most, and
measures that section alone; `… two` proves what a time was asked for by two jobs, by the clock, on a quiet machine.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

from studies.scenes import corner

from benchmarks import drivers
from benchmarks.common import RESULTS, table, write
from benchmarks.scenes import ANGLE, ENUMERATED, STRENGTH, cubes, grid, strength, vault
from jld_core import Scene, SolveOptions, build_assembly, parse_scene
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.choice import bound_of_all
from jld_explore.drivers.enumeration import Enumeration

WALLS: Final = (  # cells across and up, cells in a block, σt = τ in Pa, time asked for
    (4, 6, 2, 2e4, "3 s"),
    (4, 6, 3, 2e4, "3 s"),
    (5, 7, 2, 2e4, "6 s"),
    (5, 7, 3, 2e4, "30 s"),
    (5, 7, 4, 2e4, "–"),
    (6, 8, 2, 2e4, "30 s"),
    (6, 8, 3, 2e4, "3 s"),
    (8, 10, 2, 2e4, "8 s"),
    (4, 6, 3, 5e3, "10 s"),
    (5, 7, 3, 5e3, "3 s"),
)

LARGE: Final = ((10, 12, 2, 2e4, "30 s"), (8, 10, 3, 2e4, "240 s, to 5 %"))  # the same of walls that get `LONG` seconds
SECONDS: Final = 120.0
LONG: Final = 600.0  # seconds for the scenes that are no walls of the list, unless another number is given
_RATE: Final = 1000.0  # labellings a second that enumeration is taken to evaluate
_COUNTED: Final = 300_000
FRONTS: Final = (  # scenes whose whole front is proven
    "4 × 6, s = 2, 20 kPa",
    "4 × 6, s = 3, 20 kPa",
    "5 × 7, s = 2, 20 kPa",
    "5 × 7, s = 3, 20 kPa",
    "6 × 8, s = 2, 20 kPa",
    "beam on bearings (flagship), blocks of 2–6",
)

TWO: Final = {  # scenes that two jobs prove, and seconds by the clock for each
    "6 × 8, s = 3, 20 kPa": 60.0,
    "6 × 8, s = 3, 20 kPa, two cases": 60.0,
    "5 × 7, s = 3, 5 kPa": 60.0,
    "8 × 10, s = 2, 20 kPa": 60.0,
    "10 × 12, s = 2, 20 kPa": 180.0,
    "8 × 10, s = 3, 20 kPa": 240.0,
    "flat arch, 67 faces, σc = 5 MPa, blocks of 2–6": 600.0,
}

NOTE: Final = (
    "At most {:g} s for a wall, {:g} s for a large one and the others, of one processor. Conflicts: partial "
    "labellings ruled out; relaxations: programs solved to find them; solves: labellings evaluated."
)


def wall(across: int, up: int, cells: int, strong: float) -> Scene:
    """A wall with a row of supports at its foot."""
    rows = ["a" * across] * (up - 1) + ["#" * across]
    dry, search = {"friction_coefficient": 0.75}, {"block_cells": [1, cells]}
    return grid(rows, None, strength(strong), search, dry=dry, name=f"wall {across} × {up}")


def arch() -> Scene:
    load = [{"element": "c5r0", "force": [0, -1000]}]
    crush, search = {"compressive_strength": 5e6}, {"block_cells": [2, 6]}
    rows = ["#aaaaaaaaa#"] * 4
    return grid(rows, load, STRENGTH | crush, search, dry=ANGLE | crush, name="flat arch between abutments")


def winds() -> Scene:
    document = wall(6, 8, 3, 2e4).model_dump(mode="json", exclude_defaults=True)
    left, right = ({"name": name, "live": [{"body": [push, 0]}]} for name, push in (("left", 1), ("right", -0.9)))
    return parse_scene(document | {"loads": {"cases": [left, right]}})


def in_space() -> dict[str, Scene]:
    document = corner(5, math.radians(225.0), None).model_dump(mode="json", exclude_defaults=True)
    limit = {"block_cells": [1, 4]}
    return {
        "3 × 3 × 3 cubes, blocks of 1–4, 20 kPa": cubes(search=limit),
        "corner of five courses, blocks of 1–4, 0.2 MPa": parse_scene(document | {"search": limit}),
        "barrel vault, 21 voussoirs, blocks of 1–3, 20 kPa": vault(),
    }


def scenes() -> dict[str, tuple[Scene, float, str]]:
    found: dict[str, tuple[Scene, float, str]] = {
        f"{across} × {up}, s = {cells}, {strength / 1e3:g} kPa": (wall(across, up, cells, strength), most, asked)
        for walls, most in ((WALLS, SECONDS), (LARGE, LONG))
        for across, up, cells, strength, asked in walls
    }
    found["beam on bearings (flagship), blocks of 2–6"] = (ENUMERATED["flagship"](), LONG, "600 s")
    found["6 × 8, s = 3, 20 kPa, two cases"] = (winds(), SECONDS, "twice one")
    found["wall of 88 faces, 6 × 9, s = 4, 20 kPa"] = (wall(6, 9, 4, 2e4), LONG, "600 s")
    found["flat arch, 67 faces, σc = 5 MPa, blocks of 2–6"] = (arch(), LONG, "600 s, to 5 %")
    found |= {name: (scene, LONG, "600 s") for name, scene in in_space().items()}
    return found


def _size(scene: Scene) -> int | None:
    """Labellings of the space, None where there are more than can be counted soon."""
    total = 0
    for rows, _ in Enumeration(search_space(scene, build_assembly(scene))).batches():
        total += len(rows)
        if total > _COUNTED:
            return None
    return total


def summary_of(scene: Scene, **settings: Any) -> dict[str, Any]:
    """What a study of a scene comes to, its seconds those of one processor."""
    # one process: its own seconds say the same whoever else is at work on the machine
    with tempfile.TemporaryDirectory() as folder, patch("time.perf_counter", time.process_time):
        return explore(scene, Path(folder) / "out", ExploreSettings(jobs=1, pictures=False, **settings)).summary.facts


def proof(name: str, most: float, long: float) -> list[str]:
    """The row of one scene. most, long: seconds for a wall, others."""
    scene, seconds, asked = scenes()[name]
    size = _size(scene)
    facts = summary_of(scene, driver="exact", seconds=min(seconds, most if seconds == SECONDS else long))
    bound, gap = facts["bound"], facts["gap"]
    more, size = ("more than ", _COUNTED) if size is None else ("", size)
    ends = ["none" if value is None else f"{value:.7g}" for value in (facts["best"], bound)]
    counts = [str(facts[key]) for key in ("stop_reason", "conflicts", "relaxations", "solved")]
    space = f"{more}{size:.0e}" if more else str(size)
    row = [name, space, *ends, "–" if gap is None else f"{gap:.0e}", *counts]
    row += [f"{facts['seconds']:.1f}", asked, f"{more}{size / _RATE:.0f}"]
    print(row, flush=True)
    return row


def by_two() -> list[list[str]]:
    rows = []
    for name, most in TWO.items():
        scene, _, asked = scenes()[name]
        with tempfile.TemporaryDirectory() as folder:
            settings = ExploreSettings(jobs=2, pictures=False, driver="exact", seconds=most)
            facts = explore(scene, Path(folder) / "out", settings).summary.facts
        ends = [f"{facts[key]:.7g}" for key in ("best", "bound")]
        row = [name, *ends, f"{facts['gap']:.1%}", str(facts["stop_reason"]), f"{facts['seconds']:.1f}", asked]
        rows.append(row)
        print(row, flush=True)
    return rows


def fronts() -> list[str]:
    rows = []
    for name in FRONTS:
        facts = summary_of(scenes()[name][0], driver="exact", options={"aim": "front"}, seconds=SECONDS)
        points = facts["front"]
        proven = sum(bool(point["proven"]) for point in points)
        counts = [point["count"] for point in points]
        found = f"{min(counts)}–{max(counts)} | {proven} of {len(points)} | {facts['best']:.7g}"
        rows.append(f"{name} | {found} | {facts['conflicts']} | {facts['relaxations']} | {facts['seconds']:.1f}")
        print(rows[-1], flush=True)
    return rows


def bounds() -> list[list[str]]:
    rows = []
    for name, scene in (
        ("arch 19 × 3, blocks of 2–5", drivers.arch(19, 3, 0.3, [2, 5])),
        ("arch 41 × 4, blocks of 2–5", drivers.arch(41, 4, 0.25, [2, 5])),
        ("viaduct 34, blocks of 1–6", drivers.SCENES["viaduct 34"]()),
    ):
        space = search_space(scene, build_assembly(scene))
        whole = bound_of_all(space, SolveOptions()) or math.inf
        facts = summary_of(scene, driver="exact", seconds=LONG)
        best, bound = facts["best"], facts["bound"]
        faces = str(int(space.candidates.sum()))
        numbers = [f"{whole:.5g}", f"{bound:.5g}", f"{bound / best:.2f}", f"{facts['seconds']:.0f}"]
        rows.append([name, faces, f"{best:.5g}", *numbers])
        print(rows[-1], flush=True)
    return rows


# sections behind the first, `proofs`, by the word that asks for them
HEADS: Final = {"two": "Two jobs", "fronts": "Whole fronts", "bounds": "Arches and a viaduct"}


def sections(text: str) -> dict[str, str]:
    first, *others = text.split("\n\n## ")
    return {"": first, **dict(part.split("\n\n", 1) for part in others)}


def main(seconds: float = SECONDS, long: float = LONG, *wanted: str) -> None:
    """Prove every scene, or report the gap it got to.

    wanted: sections to be measured anew, all without any; the others stay as they are in the file.
    """
    wanted = wanted or ("proofs", *HEADS)
    path = RESULTS / "exact.md"
    parts = sections(path.read_text(encoding="utf-8").rpartition("\n\n")[0]) if path.exists() else {}
    head = "scene | space | λ | bound | gap | stopped | conflicts | relaxations | solves | s | asked | s to enumerate"
    if "proofs" in wanted:
        rows = [proof(name, seconds, long) for name in scenes()]
        said = parts.get("", "").rpartition("\n\n")[2]  # what was found, by hand
        parts[""] = "\n\n".join(("# Proven optima", table(head, rows), NOTE.format(seconds, long), said))
    if "two" in wanted:
        found = table("scene | λ | bound | gap | stopped | s by the clock | asked", by_two())
        parts[HEADS["two"]] = f"The whole command with `--jobs 2`, on a machine with nothing else to do.\n\n{found}"
    if "fronts" in wanted:
        found = table("scene | dry faces | points proven | best λ | conflicts | relaxations | s", fronts())
        words = (
            "The best labelling for every number of dry faces at which anything stands, each with its bound. What a "
            "conflict rules out it rules out at every number that is to exceed its bound: all points share them, and "
            "one formula with all that the solver learns."
        )
        parts[HEADS["fronts"]] = f"{words}\n\n{found}"
    if "bounds" in wanted:
        found = table("scene | faces | λ | bound face by face | bound | bound over λ | s", bounds())
        words = "The process beside a search alone: what the exact driver proves in that time of one processor."
        parts[HEADS["bounds"]] = f"{words}\n\n{found}"
    write("exact", "\n\n## ".join([parts.pop(""), *(f"{head}\n\n{body}" for head, body in parts.items())]))


if __name__ == "__main__":
    limits = [float(text) for text in sys.argv[1:3]] + [SECONDS, LONG][len(sys.argv[1:3]) :]
    main(limits[0], limits[1], *sys.argv[3:])
