"""Whole commands and searches: shares of processor time, a second job, size, what leaves the batch solver, plain CVXPY.

`python -m benchmarks.commands [shares|jobs|solve|explore|cliffs|throughput]` writes a table for each part.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import joblib
import numpy as np
from matplotlib.figure import Figure

from benchmarks import timed
from benchmarks.common import (
    RESULTS,
    ROOT,
    about,
    apart,
    load_of_machine,
    plainly,
    random_segmentations,
    run_parts,
    table,
    write,
)
from benchmarks.scenes import ENUMERATED, GRIDS, bonded, column, cubes, searched
from jld_core import Assembly, Scene, Status, build_assembly, parse_scene, solve
from jld_core.arrays import Bits, Floats
from jld_explore import explore
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.search.study import Study
from jld_explore.space import from_string
from jld_views.figures import save_figure


@dataclass(frozen=True)
class Command:
    """A search, or one layout solved where there is no driver."""

    make: Callable[[], Scene]
    driver: str = ""
    budget: int | None = None


def cells(columns: int, rows: int, most: int) -> Callable[[], Scene]:
    """A wall of cells on a row of supports, in blocks of up to `most`."""
    return searched(["a" * columns] * rows + ["#" * columns], [1, most])


def wall(side: int) -> Scene:
    return searched([*bonded(["a" * side] * side), "#" * side], [1, 6])()


def of_faces(faces: int) -> Callable[[], Scene]:
    return searched(GRIDS[faces], [2, 6])


SHARES: Final[dict[str, Command]] = {  # commands by name
    "`jld solve`, beam-arch": Command(ENUMERATED["flagship"]),
    "all 6 382 layouts of the beam-arch": Command(ENUMERATED["flagship"], "enumeration"),
    "exact, 4 × 4 cells in blocks of two": Command(cells(4, 4, 2), "exact"),
    **{f"random, 78 faces, {n} layouts": Command(cells(7, 6, 6), "random", n) for n in (6000, 10000, 60000)},
    "random, 1 128 faces, 256 layouts": Command(lambda: wall(24), "random", 256),
}


def spent(name: str) -> dict[str, float]:
    """Run a command in a process of its own; return its processor time, that of children, of search and solver, s."""
    command = SHARES[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.json"
        file.write_text(command.make().model_dump_json(exclude_unset=True), encoding="utf-8")
        options = [] if command.budget is None else ["--budget", str(command.budget)]
        search = ["explore", str(file), "--driver", command.driver, *options, "--jobs", "1", "-o", f"{folder}/out"]
        words = search if command.driver else ["solve", str(file)]
        run = [sys.executable, "-m", "benchmarks", "spent", *words]
        answer = subprocess.run(run, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
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
    title = "# The compiled solver's share of whole commands"
    write("shares", title, about(shares.__doc__), table(head, rows), load_of_machine())


JOBS: Final[dict[str, tuple[Command, float]]] = {  # searches by name, and what the second job is to be worth
    "enumeration, 88 faces": (Command(of_faces(88), "enumeration", 60_000), 1.7),
    "random, 88 faces": (Command(of_faces(88), "random", 80_000), 1.7),
    "random, 946 faces": (Command(lambda: wall(22), "random", 1_000), 1.7),
    "exact, 6 × 8 cells in blocks of up to three": (Command(cells(6, 8, 3), "exact"), 1.7),
    "genetic, 88 faces": (Command(of_faces(88), "genetic", 20_000), 1.5),
    "genetic, 946 faces": (Command(lambda: wall(22), "genetic", 800), 1.5),
    "portfolio, 278 faces": (Command(of_faces(278), "portfolio", 4_000), 1.5),
    "portfolio, 946 faces": (Command(lambda: wall(22), "portfolio", 800), 1.5),
}

TURNS: Final = 2
FILE: Final = RESULTS / "jobs.csv"


@contextmanager
def search_timed(clock: Callable[[], float]) -> Iterator[list[float]]:
    """Yield a list that then holds the seconds of a search, from the first labelling asked to the last one on disk."""
    alone = [0.0]
    with patch.object(Study, "run", timed(Study.run, clock, alone)):
        yield alone


def by_clock(name: str, jobs: int) -> tuple[float, float, str]:
    command = JOBS[name][0]
    with tempfile.TemporaryDirectory() as folder, search_timed(time.perf_counter) as alone:
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
    write("jobs", "# A second job by the clock", about(jobs.__doc__), table(head, rows), load_of_machine())


SIDES: Final = (10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 32, 36, 40)  # cells along a side of a wall
EDGES: Final = (3, 4, 5, 6, 7, 8, 9, 10)  # cubes along an edge of a stack
REPEATED: Final = 2.0  # processor seconds up to which a size is measured again
MOST: Final = 1.6  # largest ratio of the time of a size to that of the next larger one


def explored(scene: Scene) -> None:
    with tempfile.TemporaryDirectory() as folder:
        explore(scene, Path(folder) / "out", driver="random", budget=256, jobs=1)


def least_time(run: Callable[[Scene], object], scene: Scene) -> float:
    found: list[float] = []
    while not found or sum(found) < REPEATED:
        start = time.process_time()
        run(scene)
        found.append(time.process_time() - start)
    return min(found)


def by_size(name: str, run: Callable[[Scene], object], sides: tuple[int, ...], edges: tuple[int, ...]) -> None:
    """Time against size: no size takes more than 1.6 times the next larger one.

    Walls of n × n cells in blocks of two, and k × k × k cubes, under a horizontal body load. `solve`: λ of the layout
    as drawn, from the assembly, the least of several runs. `explore`: 256 random layouts from the start to the page.
    Times are processor seconds; ratio: to the next larger size; slope: of the logarithms, over all faces of a family.
    """
    figure = Figure(figsize=(7.0, 4.6), dpi=110, layout="constrained")
    ax, rows, slopes, worst = figure.add_subplot(), [], [], 0.0
    for family, make, sizes in ((f"{name}, wall", wall, sides), (f"{name}, cubes", cubes, edges)):
        run(make(3))  # imports and kernels
        found = []
        for size in sizes:
            scene = make(size)
            found.append((size, len(build_assembly(scene).interfaces), least_time(run, scene)))
            print(family, *found[-1], flush=True)
        ratios = [a[2] / b[2] for a, b in itertools.pairwise(found)]
        faces, seconds = np.array(found)[:, 1:].T
        slopes.append(f"{family} {np.polyfit(np.log(faces), np.log(seconds), 1)[0]:.2f}")
        worst = max([worst, *ratios])
        shown = [*(f"{ratio:.2f}" for ratio in ratios), ""]
        rows += [[family, str(n), str(m), f"{s:.3g}", r] for (n, m, s), r in zip(found, shown, strict=True)]
        ax.loglog(faces, seconds, "o-", label=slopes[-1])
    ax.set(xlabel="faces", ylabel="processor time, s")
    ax.grid(True, color="0.92", lw=0.6)
    ax.legend(frameon=False, fontsize=9, title="slope of the logarithms")
    save_figure(figure, RESULTS / f"monotony_{name}.png")
    verdict = f"Largest ratio {worst:.2f} (at most {MOST}: {'yes' if worst <= MOST else 'no'}); slopes: "
    body = table("family | size | faces | s | over the next larger", rows)
    said = f"{verdict}{', '.join(slopes)}."
    write(f"monotony_{name}", f"# Time against size: {name}", about(by_size.__doc__), said, body)


LAYOUTS: Final = 24


def pairs() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Scenes without and with what leaves the batch solver, by name."""
    found = {}
    for side in (3, 4):
        plain = json.loads(cubes(side).model_dump_json(exclude_defaults=True))
        crushing, strong = json.loads(json.dumps(plain)), json.loads(json.dumps(plain))
        crushing["materials"]["inner"]["compressive_strength"] = 1e7
        found[f"crushing, {side}³ cubes"] = (plain, crushing)
        strong["materials"]["inner"] |= {"tensile_strength": 5e6, "shear_strength": 5e6}
        found[f"strong, {side}³ cubes"] = found[f"strong, {side}³ cubes, few blocks"] = (plain, strong)
    return {**found, "corners, column of 12 drums": (column(8), column(16))}


def few_blocks(assembly: Assembly) -> Bits:
    """Labels (k, m) of layouts in two to eight blocks, cut by one to three planes through the middle."""
    random, centre = np.random.default_rng(0), assembly.elements.centroid
    found = []
    for _ in range(LAYOUTS):
        side = np.zeros(len(centre), dtype=int)
        for _ in range(random.integers(1, 4)):
            place = centre - centre.mean(axis=0) + 0.1 * random.normal(size=3)
            side = 2 * side + (place @ random.normal(size=3) > 0.0)
        found.append(side[assembly.interfaces.a] != side[assembly.interfaces.b])
    return np.array(found)


def evaluated(assembly: Assembly, name: str) -> tuple[float, float]:
    """Seconds of a layout, the least of three runs, and the mean λ."""
    evaluator = Evaluator(assembly, EvaluatorSettings())
    labellings = few_blocks(assembly) if "few blocks" in name else random_segmentations(assembly, LAYOUTS, 1)
    times, loads = [], [math.nan]
    for _ in range(3):
        start = time.process_time()
        loads = [one.load_factor for one in evaluator.evaluate_all(labellings)]
        times.append((time.process_time() - start) / LAYOUTS)
    return min(times), float(np.nanmean(loads))


def cliffs() -> None:
    """What leaves the batch solver, beside the same scene that does not: time of a layout and λ.

    Random layouts of spatial scenes, evaluated as a search does. `crushing`: inner faces with a compressive strength
    that no layout reaches. `strong`: inner faces of 5 MPa instead of 20 kPa, the same layouts; λ is another. `corners`:
    prisms on faces of sixteen corners instead of eight. Times are processor seconds of one layout, the least of three
    runs; ratio: over the scene without.
    """
    rows = []
    for name, documents in pairs().items():
        (one, first), (other, second) = (evaluated(build_assembly(parse_scene(scene)), name) for scene in documents)
        rows.append([name, f"{1e3 * one:.3g}", f"{1e3 * other:.3g}", f"{other / one:.2f}", f"{second / first:.9f}"])
        print(rows[-1], flush=True)
    head = "pair | ms without | ms with | ratio | λ with / without"
    write("cliffs", "# Where the batch solver ends", about(cliffs.__doc__), table(head, rows))


RATES: Final[dict[str, tuple[Callable[[], Scene], int, int]]] = {
    "flagship, 24 faces": (ENUMERATED["flagship"], 1500, 100),
    "grid, 33 faces": (of_faces(33), 1500, 80),
    "grid, 88 faces": (of_faces(88), 600, 40),
    "grid, 278 faces": (of_faces(278), 200, 20),
    "3 × 3 × 3 cubes": (cubes, 300, 20),
}
"""Scene, labellings, and how many of them for the plain way."""


def studied(scene: Scene, asked: int) -> tuple[float, Bits, Floats]:
    """Processor seconds of a study, its labellings (k, m), and their λ, NaN where they do not collapse."""
    with tempfile.TemporaryDirectory() as folder, search_timed(time.process_time) as alone:
        done = explore(scene, Path(folder) / "out", driver="random", budget=asked, jobs=1, pictures=False)
    found = done.results
    labellings = np.array([from_string(str(text)) for text in found["labelling"]])
    values = np.where(found["status"].astype(str) == str(Status.COLLAPSE), found["load_factor"], np.nan)
    return alone[0], labellings, values.astype(float)


def throughput() -> None:
    """Labellings per second and core by grid size, and the plain way beside it in the same run.

    Ours: a study with the random driver in one process, from the first labelling asked to the last one on disk, both
    bounds proven. Plain: the problem stated in CVXPY anew for each labelling (Clarabel, default tolerances) in joblib
    workers, which proves nothing, on a sample of the same labellings. Rates are per second of processor time, so per
    core.
    """
    jobs, rows = os.cpu_count() or 1, []
    for name, (make, asked, sample) in RATES.items():
        scene = make()
        assembly = build_assembly(scene)
        studied(scene, min(asked, 8))
        spent, labellings, values = studied(scene, asked)
        chosen = np.linspace(0, len(labellings) - 1, min(sample, len(labellings))).astype(int)
        with joblib.Parallel(n_jobs=jobs) as pool:
            pool(joblib.delayed(plainly)(assembly, labellings[0]) for _ in range(2 * jobs))
            times, others = np.array(pool(joblib.delayed(plainly)(assembly, labellings[k]) for k in chosen)).T
        known = np.isfinite(values[chosen]) & np.isfinite(others)
        ours, theirs = values[chosen][known], others[known]
        apart = float((abs(ours - theirs) / abs(ours)).max()) if known.any() else np.nan
        rate, plain = len(labellings) / spent, len(chosen) / times.sum()
        numbers = [str(len(assembly.interfaces)), str(len(labellings)), f"{rate:.3g}", f"{plain:.3g}"]
        rows.append([name, *numbers, f"{rate / plain:.1f}", f"{apart:.0e}"])
        print(rows[-1], flush=True)
    head = "scene | faces | labellings | ours, 1/s and core | plain CVXPY, 1/s and core | ours / plain | "
    head += "λ differs by, at most"
    note = f"Plain: {jobs} joblib workers. Blocks of 2 to 6 cells (cubes: any)."
    write("throughput", "# Search throughput", about(throughput.__doc__), table(head, rows), note, also=("joblib",))


if __name__ == "__main__":
    run_parts(
        shares=shares, jobs=jobs, cliffs=cliffs, throughput=throughput,
        solve=partial(by_size, "solve", lambda scene: solve(build_assembly(scene)), SIDES, EDGES),
        explore=partial(by_size, "explore", explored, SIDES[::2], EDGES[:5]),
    )  # fmt: skip
