"""How large a structure can be cut optimally with proof, how long that takes, and what enumeration would take.

Walls of nx × ny cells, the bottom row supports, under a horizontal body load, blocks of 1 to s cells; then a beam on
two bearings, a flat arch between abutments, a larger wall. Times are of the whole command, pictures apart. Then whole
fronts, the best for every number of dry faces.
Then how far drivers that prove nothing stay below the best known in equal time (`… 120 600 rivals`, or one of them
anew, `… rivals anneal`).
`python -m benchmarks.exact SECONDS LONG proofs` gives every wall and every other scene that long at the most, and
measures that section alone; `… two` proves what a time was asked for by two jobs, by the clock, on a quiet machine, and
`… lasts` follows a proof of half an hour.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from studies.scenes import corner

from benchmarks.common import RESULTS, about, table, write
from benchmarks.scenes import ANGLE, ENUMERATED, STRENGTH, cubes, grid, strength, vault
from jld_core import Scene, build_assembly, parse_scene
from jld_core.limit import LimitAnalysis
from jld_core.limit.block_relaxation import BlockRelaxation, applies_to
from jld_core.limit.relaxation import Relaxation
from jld_explore import ExploreSettings, explore
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.space import search_space

WALLS: Final = (
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
"""Cells across and up, cells in a block, σt = τ in Pa, time asked for."""

LARGE: Final = ((10, 12, 2, 2e4, "30 s"), (8, 10, 3, 2e4, "240 s, to 5 %"))
"""The same of walls that get `LONG` seconds."""

SECONDS: Final = 120.0
LONG: Final = 600.0
"""Seconds for the scenes that are no walls of the list, unless another number is given."""

_RATE: Final = 1000.0
"""Labellings a second that enumeration is taken to evaluate."""

_COUNTED: Final = 300_000
_LISTED: Final = 4000
"""Possible blocks above which the relaxation by blocks is left out."""

RIVALS: Final[tuple[tuple[str, dict[str, str]], ...]] = (
    ("anneal", {}),
    ("genetic", {"aim": "best"}),
    ("hillclimb", {}),
    ("optuna", {"sampler": "TPE"}),
)
"""Drivers without proof, and their options."""

SEEDS: Final = 3
EQUAL: Final = 5.0
"""Processor seconds that each of them gets."""

COMPARED: Final = (
    *(f"{across} × {up}, s = {cells}, {strength / 1e3:g} kPa" for across, up, cells, strength, _ in (*WALLS, *LARGE)),
    "beam on bearings (flagship), blocks of 2–6",
    "wall of 88 faces, 6 × 9, s = 4, 20 kPa",
    "flat arch, 67 faces, σc = 5 MPa, blocks of 2–6",
)
"""Scenes on which they are compared."""

FRONTS: Final = (
    "4 × 6, s = 2, 20 kPa",
    "4 × 6, s = 3, 20 kPa",
    "5 × 7, s = 2, 20 kPa",
    "5 × 7, s = 3, 20 kPa",
    "6 × 8, s = 2, 20 kPa",
    "beam on bearings (flagship), blocks of 2–6",
)
"""Scenes whose whole front is proven."""

TWO: Final = {
    "6 × 8, s = 3, 20 kPa": 60.0,
    "6 × 8, s = 3, 20 kPa, two cases": 60.0,
    "5 × 7, s = 3, 5 kPa": 60.0,
    "8 × 10, s = 2, 20 kPa": 60.0,
    "10 × 12, s = 2, 20 kPa": 180.0,
    "8 × 10, s = 3, 20 kPa": 240.0,
    "flat arch, 67 faces, σc = 5 MPa, blocks of 2–6": 600.0,
}
"""Scenes that two jobs prove, and seconds by the clock for each."""

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
    """A flat arch of 67 faces between abutments, all of it crushable, under a force on its middle."""
    load = [{"element": "c5r0", "force": [0, -1000]}]
    crush, search = {"compressive_strength": 5e6}, {"block_cells": [2, 6]}
    rows = ["#aaaaaaaaa#"] * 4
    return grid(rows, load, STRENGTH | crush, search, dry=ANGLE | crush, name="flat arch between abutments")


def winds() -> Scene:
    """The wall of 6 × 8 cells in blocks of up to three, pushed from either side, nine tenths as hard from the right."""
    document = wall(6, 8, 3, 2e4).model_dump(mode="json", exclude_defaults=True)
    left, right = ({"name": name, "live": [{"body": [push, 0]}]} for name, push in (("left", 1), ("right", -0.9)))
    return parse_scene(document | {"loads": {"cases": [left, right]}})


def in_space() -> dict[str, Scene]:
    """Spatial scenes by name."""
    document = corner(5, math.radians(225.0), None).model_dump(mode="json", exclude_defaults=True)
    limit = {"block_cells": [1, 4]}
    return {
        "3 × 3 × 3 cubes, blocks of 1–4, 20 kPa": cubes(search=limit),
        "corner of five courses, blocks of 1–4, 0.2 MPa": parse_scene(document | {"search": limit}),
        "barrel vault, 21 voussoirs, blocks of 1–3, 20 kPa": vault(),
    }


def scenes() -> dict[str, tuple[Scene, float, str]]:
    """Scenes by name, with the seconds each may take and the time asked for."""
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


def proofs(most: float, long: float) -> list[list[str]]:
    """Rows of the table. most, long: seconds for a wall, others."""
    return [proof(name, most, long) for name in scenes()]


def proof(name: str, most: float, long: float) -> list[str]:
    """The row of one scene."""
    scene, seconds, asked = scenes()[name]
    size = _size(scene)
    facts = summary_of(scene, driver="exact", seconds=min(seconds, most if seconds == SECONDS else long))
    bound, gap = facts["bound"], facts["gap"]
    row = [
        name,
        f"more than {_COUNTED:.0e}" if size is None else str(size),
        "none" if facts["best"] is None else f"{facts['best']:.7g}",
        "none" if bound is None else f"{bound:.7g}",
        "–" if gap is None else f"{gap:.0e}",
        str(facts["stop_reason"]),
        str(facts["conflicts"]),
        str(facts["relaxations"]),
        str(facts["solved"]),
        f"{facts['seconds']:.1f}",
        asked,
        ("more than " if size is None else "") + f"{(size or _COUNTED) / _RATE:.0f}",
    ]
    print(row, flush=True)
    return row


def by_two() -> list[list[str]]:
    """Rows of the table of two jobs, by the clock."""
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


def roots(best: dict[str, float]) -> list[list[str]]:
    """Rows of the table of bounds that proofs of walls begin at, face by face and block by block. best: λ found."""
    rows = []
    for name, (scene, _, _) in scenes().items():
        assembly = build_assembly(scene)
        if assembly.cases:
            continue
        space, analysis = search_space(scene, assembly), LimitAnalysis(assembly)
        blocks, scale = possible_blocks(space), analysis.template.scaling.load
        if name not in best or blocks is None or not applies_to(analysis) or len(blocks) > _LISTED:
            continue
        faces = Relaxation(analysis).bound(space.fixed, space.candidates)
        every = np.ones(len(blocks), dtype=bool)
        choice = BlockRelaxation(analysis, blocks.members, blocks.inside).choose(every, best[name] / scale, faces)
        found = [faces * scale, choice.bound * scale]
        above = [f"{bound:.4f} ({bound / best[name] - 1.0:.1%})" for bound in found]
        rows.append([name, str(len(blocks)), f"{best[name]:.4f}", *above])
        print(rows[-1], flush=True)
    return rows


def fronts() -> list[list[str]]:
    """Rows of the table of whole fronts."""
    rows = []
    for name in FRONTS:
        facts = summary_of(scenes()[name][0], driver="exact", options={"aim": "front"}, seconds=SECONDS)
        points = facts["front"]
        proven = sum(bool(point["proven"]) for point in points)
        counts = [point["count"] for point in points]
        rows.append(
            [
                name,
                f"{min(counts)}–{max(counts)}",
                f"{proven} of {len(points)}",
                f"{facts['best']:.7g}",
                str(facts["conflicts"]),
                str(facts["relaxations"]),
                f"{facts['seconds']:.1f}",
            ]
        )
        print(rows[-1], flush=True)
    return rows


def rival(name: str, which: int, seed: int) -> float:
    """λ that a rival ends with, −inf where it found nothing."""
    driver, options = RIVALS[which]
    facts = summary_of(scenes()[name][0], driver=driver, options=options, seconds=EQUAL, seed=seed)
    return -math.inf if facts["best"] is None else float(facts["best"])


def distances(known: dict[str, float], measured: list[int], kept: dict[str, list[str]]) -> list[list[str]]:
    """How far below the best λ known each rival ends, percent, median and worst over seeds; two processes at work.

    measured: which of RIVALS, the others have their cells of rows that are kept.
    """
    rows = []
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        asked = {
            (name, which): [pool.submit(rival, name, which, seed) for seed in range(SEEDS)]
            for name in known
            for which in measured
        }
        for name, best in known.items():
            row = [name]
            for which in range(len(RIVALS)):
                if which not in measured:
                    row.append(kept[name][which] if name in kept else "–")
                    continue
                # −0 is 0
                gaps = sorted(round(100.0 * (1.0 - one.result() / best), 4) + 0.0 for one in asked[name, which])
                row.append(f"{gaps[SEEDS // 2]:.2g} / {gaps[-1]:.2g}")
            rows.append(row)
            print(row, flush=True)
    return rows


HEADS: Final = {
    "two": "Two jobs",
    "starts": "Where proofs start",
    "fronts": "Whole fronts",
    "rivals": "How far below the best known the others end",
    "lasts": "A proof that lasts",
}
"""Sections behind the first, `proofs`, by the word that asks for them."""


def sections(text: str) -> dict[str, str]:
    """The sections of a file of results, by head, the first under its own."""
    first, *others = text.split("\n\n## ")
    kept = {"": first}
    for part in others:
        head, _, body = part.partition("\n\n")
        kept[head] = body
    return kept


LASTING: Final = 1800.0
"""Length of the run, s by the clock."""

ROW_TIMES: Final = (30.0, 60.0, 120.0, 240.0, 480.0, 720.0, 960.0, 1200.0, 1500.0)
"""Times of the rows, s by the clock; one more row is taken at the end."""

COLUMNS: Final = ("s by the clock", "processor s", "load", "λ", "bound", "gap", "conflicts", "relaxations")


def row_of_history(driver: Exact, begun: float) -> list[str]:
    """What the proof has come to. begun: time of the clock at which it began, s."""
    best = driver.found[None]
    gap = (best.bound - best.load_factor) / best.bound if math.isfinite(best.bound) else math.nan
    found = [
        f"{time.perf_counter() - begun:.0f}",
        f"{time.process_time():.0f}",
        f"{os.getloadavg()[0]:.1f}",
        f"{best.load_factor:.7g}",
        f"{best.bound:.7g}",
        f"{gap:.2%}",
        str(driver.conflicts),
        str(driver.relaxations),
    ]
    print(found, flush=True)
    return found


def history(seconds: float) -> list[list[str]]:
    """Rows of how the gap of a proof narrows that lasts some seconds: 8 × 10 cells in blocks of three, two threads.

    Rows are of one run, and each was taken when the clock had reached its time. Processor seconds are those of both
    threads, and load is the mean number of processes that asked for the two cores in the minute before: other users
    had the rest of them. Processor seconds therefore say more than the clock.
    """
    scene = wall(8, 10, 3, 2e4)
    driver = Exact(search_space(scene, build_assembly(scene)))
    begun, ended, rows = time.perf_counter(), threading.Event(), list[list[str]]()

    def watch() -> None:
        for at in ROW_TIMES:
            if at >= seconds or ended.wait(max(0.0, begun + at - time.perf_counter())):
                return
            rows.append(row_of_history(driver, begun))

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            settings = ExploreSettings(jobs=2, pictures=False, seconds=seconds)
            explore(scene, Path(folder) / "out", settings, driver=driver)
    finally:
        ended.set()
        watcher.join()
    return [*rows, row_of_history(driver, begun)]


def main(seconds: float = SECONDS, long: float = LONG, *wanted: str) -> None:
    """Prove every scene, or report the gap it got to; then hold the other drivers against what is proven.

    wanted: sections to be measured anew, all without any; the others stay as they are in the file.
    """
    wanted = wanted or ("proofs", "starts", "fronts", "rivals", "two")
    path = RESULTS / "exact.md"
    parts = sections(path.read_text(encoding="utf-8").rpartition("\n\n")[0]) if path.exists() else {}
    head = "scene | space | λ | bound | gap | stopped | conflicts | relaxations | solves | s | asked | s to enumerate"
    if "proofs" in wanted:
        rows = proofs(seconds, long)
        said = parts.get("", "").rpartition("\n\n")[2]  # what was found, by hand
        parts[""] = "\n\n".join(("# Proven optima", table(head, rows), NOTE.format(seconds, long), said))
    if "two" in wanted:
        found = table(["scene", "λ", "bound", "gap", "stopped", "s by the clock", "asked"], by_two())
        parts[HEADS["two"]] = f"The whole command with `--jobs 2`, on a machine with nothing else to do.\n\n{found}"
    best: dict[str, float] = {}
    for head_of, column in (("", 2), (HEADS["two"], 1)):
        rows = [line.strip("| ").split(" | ") for line in parts.get(head_of, "").splitlines() if line.startswith("| ")]
        for row in rows[2:]:
            if row[column] != "none":
                best[row[0]] = max(float(row[column]), best.get(row[0], 0.0))
    if "starts" in wanted:
        found = table(["scene", "possible blocks", "best λ", "relaxed face by face", "block by block"], roots(best))
        words = "Bounds on all labellings at once, and how far above the best λ known."
        parts[HEADS["starts"]] = f"{words}\n\n{found}"
    if "fronts" in wanted:
        columns = ["scene", "dry faces", "points proven", "best λ", "conflicts", "relaxations", "s"]
        found = table(columns, fronts())
        words = (
            "The best labelling for every number of dry faces at which anything stands, each with its bound. What a "
            "conflict rules out it rules out at every number that is to exceed its bound: all points share them, and "
            "one formula with all that the solver learns."
        )
        parts[HEADS["fronts"]] = f"{words}\n\n{found}"
    if "rivals" in wanted:
        known = {row: best[row] for row in COMPARED if row in best}
        names = [" ".join((driver, *options.values())) for driver, options in RIVALS]
        measured = [k for k, (driver, _) in enumerate(RIVALS) if driver in wanted] or list(range(len(RIVALS)))
        words = (
            f"Percent of the best λ known, median / worst of {SEEDS} seeds, after {EQUAL:g} s of one processor each: "
            f"{len(known) * len(RIVALS) * SEEDS * EQUAL / 120:.0f} minutes in two processes. Below 0: stronger than it."
        )
        lines = [line.strip("| ").split(" | ") for line in parts.get(HEADS["rivals"], "").splitlines()]
        kept = {name: cells for name, *cells in lines if len(cells) == len(RIVALS)}
        parts[HEADS["rivals"]] = f"{words}\n\n{table(['scene', *names], distances(known, measured, kept))}"
    if "lasts" in wanted:
        parts[HEADS["lasts"]] = f"{about(history.__doc__)}\n\n{table(COLUMNS, history(LASTING))}"
    write("exact", "\n\n## ".join([parts.pop(""), *(f"{head}\n\n{body}" for head, body in parts.items())]))


if __name__ == "__main__":
    limits = [float(text) for text in sys.argv[1:3]] + [SECONDS, LONG][len(sys.argv[1:3]) :]
    main(limits[0], limits[1], *sys.argv[3:])
