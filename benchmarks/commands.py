"""Whole commands: the compiled solver's share of their processor time, and what a second job is worth by the clock.

`python -m benchmarks.commands [shares|jobs]` writes a table for each part.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

from benchmarks.common import RESULTS, ROOT, about, apart, load_of_machine, run_parts, table, write
from benchmarks.monotony import wall
from benchmarks.scenes import GRIDS, grid
from jld_core import Scene, load_scene
from jld_explore import explore
from jld_explore.search.study import Study


@dataclass(frozen=True)
class Command:
    """A search, or one layout solved where there is no driver."""

    make: Callable[[], Scene]
    driver: str = ""
    budget: int | None = None


def cells(columns: int, rows: int, most: int) -> Scene:
    """A wall of cells on a row of supports, in blocks of up to `most`."""
    return grid(["a" * columns] * rows + ["#" * columns], search={"block_cells": [1, most]})


def flagship() -> Scene:
    """The beam-arch."""
    return load_scene(ROOT / "scenes" / "flat_beam_arch.json")


def of_faces(faces: int) -> Callable[[], Scene]:
    """Return what makes a grid in blocks of two to six cells."""
    return lambda: grid(GRIDS[faces], search={"block_cells": [2, 6]})


SHARES: Final[dict[str, Command]] = {
    "`jld solve`, beam-arch": Command(flagship),
    "all 6 382 layouts of the beam-arch": Command(flagship, "enumeration"),
    "exact, 4 × 4 cells in blocks of two": Command(lambda: cells(4, 4, 2), "exact"),
    **{f"random, 78 faces, {n} layouts": Command(lambda: cells(7, 6, 6), "random", n) for n in (6000, 10000, 60000)},
    "random, 1 128 faces, 256 layouts": Command(lambda: wall(24), "random", 256),
}
"""Commands by name."""


def spent(name: str) -> dict[str, float]:
    """Run a command in a process of its own; return its processor time, that of children, of search and solver, s."""
    command = SHARES[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.json"
        file.write_text(command.make().model_dump_json(exclude_unset=True), encoding="utf-8")
        options = [] if command.budget is None else ["--budget", str(command.budget)]
        search = ["explore", str(file), "--driver", command.driver, *options, "--jobs", "1", "-o", f"{folder}/out"]
        words = search if command.driver else ["solve", str(file)]
        answer = subprocess.run(
            [sys.executable, "-m", "benchmarks.spent", *words], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
        )
    found: dict[str, float] = json.loads(answer.stdout)
    return found


def shares() -> None:
    """Processor time of whole commands, from the start of Python to the page, and what of it the compiled solver has.

    Each command is a process of its own with one job. Pictures are drawn in a copy of it, which is part of the whole.
    Search: from the first labelling asked to the last one on disk. The least of three runs by the whole.
    """
    rows = []
    for name in SHARES:
        one = min((spent(name) for _ in range(3)), key=lambda found: found["total"])
        of_search = f"{one['solver'] / one['search']:.2f}" if one["search"] else "–"
        times = [f"{one[part]:.2f}" for part in ("total", "children", "search", "solver")]
        rows.append([name, *times, f"{one['solver'] / one['total']:.2f}", of_search])
        print(rows[-1], flush=True)
    head = "command | whole, s | of it pictures, s | search, s | compiled solver, s | of the whole | of the search"
    parts = ["# The compiled solver's share of whole commands", about(shares.__doc__), table(head, rows)]
    write("shares", "\n\n".join([*parts, load_of_machine()]))


JOBS: Final[dict[str, tuple[Command, float]]] = {
    "enumeration, 88 faces": (Command(of_faces(88), "enumeration", 60_000), 1.7),
    "random, 88 faces": (Command(of_faces(88), "random", 80_000), 1.7),
    "random, 946 faces": (Command(lambda: wall(22), "random", 1_000), 1.7),
    "exact, 6 × 8 cells in blocks of up to three": (Command(lambda: cells(6, 8, 3), "exact"), 1.7),
    "genetic, 88 faces": (Command(of_faces(88), "genetic", 20_000), 1.5),
    "genetic, 946 faces": (Command(lambda: wall(22), "genetic", 800), 1.5),
    "portfolio, 278 faces": (Command(of_faces(278), "portfolio", 4_000), 1.5),
    "portfolio, 946 faces": (Command(lambda: wall(22), "portfolio", 800), 1.5),
}
"""Searches by name, and what the second job is to be worth."""

TURNS: Final = 2
FILE: Final = RESULTS / "jobs.csv"


def by_clock(name: str, jobs: int) -> tuple[float, float, str]:
    """Seconds of a search by the clock, from the scene to its tables and alone; and its table without times."""
    command, run, alone = JOBS[name][0], Study.run, [0.0]

    def timed(study: Study) -> Any:
        start = time.perf_counter()
        try:
            return run(study)
        finally:
            alone[0] = time.perf_counter() - start

    with tempfile.TemporaryDirectory() as folder, patch.object(Study, "run", timed):
        start = time.perf_counter()
        options: dict[str, Any] = {"driver": command.driver, "budget": command.budget, "jobs": jobs}
        done = explore(command.make(), Path(folder) / "out", pictures=False, **options)
        seconds = time.perf_counter() - start
    return seconds, alone[0], done.results.drop(columns="seconds").to_csv(index=False)


def jobs() -> None:
    """What a second job is worth by the clock of two free cores: searches of one and of two jobs in turns.

    Each search is a process of its own, from the scene to all tables, without pictures; alone: from the first
    labelling asked to the last one on disk. The least of all turns in benchmarks/results/jobs.csv, to which each pair
    of runs is appended. Tables of one and of two jobs are compared, times apart.
    """
    for turn in range(TURNS):
        for name in JOBS:
            pair = [apart("commands.by_clock", name, number) for number in (1, 2)]
            shown = [f"{found[k]:.3f}" for k in (0, 1) for found in pair]
            row = [name, *shown, str(pair[0][2] == pair[1][2]), f"{os.getloadavg()[0]:.1f}"]
            with FILE.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file).writerow(row)
            print(turn, *row, flush=True)
    with FILE.open(newline="", encoding="utf-8") as file:
        known = list(csv.reader(file))
    rows = []
    for name, (command, least) in JOBS.items():
        runs = [run for run in known if run[0] == name]
        best = [min(float(run[k]) for run in runs) for k in range(1, 5)]
        gains = [f"{best[k] / best[k + 1]:.2f}" for k in (0, 2)]
        same = "yes" if all(run[5] == "True" for run in runs) else "no"
        layouts = "all" if command.budget is None else str(command.budget)
        shown = [f"{value:.2f}" for value in best]
        rows.append([name, layouts, *shown[:2], gains[0], *shown[2:], gains[1], f"{least}", same])
    head = (
        "search | layouts | one job, s | two, s | times | search, one job, s | two, s | times | to reach | same table"
    )
    parts = ["# A second job by the clock", about(jobs.__doc__), table(head, rows), load_of_machine()]
    write("jobs", "\n\n".join(parts))


if __name__ == "__main__":
    run_parts(shares=shares, jobs=jobs)
