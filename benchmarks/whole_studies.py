"""Whole studies: from the first labelling asked to the last one on disk, with the batch solver and without.

The same scene, driver, seed and budget once with the batch solver and one job, once without it (`JLD_KERNEL=off`, one
job), so nothing but what the batch solver does differs: λ of nearly all labellings, and the joining of cells to blocks.
Times of one job are processor times, which are those of the clock on a core with nothing else to do; by the clock
of this run stands beside them. In the batch solver: the share of solving. Two jobs are threads of one process: the
thread
that asks and records, and those that solve. On two cores with nothing else to do a study takes half of their
processor time together, or that of the first thread where it is more; the column says what that makes of one job's
time, and the clock's own ratio stands beside it.
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from unittest.mock import patch

from matplotlib.figure import Figure

from benchmarks.common import RESULTS, about, table, write
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from benchmarks.stopwatch import Stopwatch
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.library import SWITCH, described
from jld_core.threads import one_thread
from jld_core.views.figures import save_figure
from jld_explore.drivers import make_driver
from jld_explore.settings import ExploreSettings
from jld_explore.study import Study

STUDIES: Final = (
    ("flagship", "random", 512, 1024),
    ("flagship", "genetic", 512, 1024),
    ("planar 88 faces", "random", 1024, 6144),
    ("planar 88 faces", "genetic", 1024, 3072),
    ("planar 278 faces", "random", 64, 512),
    ("planar 278 faces", "genetic", 64, 256),
    ("spatial 3x3x3", "random", 128, 512),
    ("spatial 3x3x3", "genetic", 128, 512),
)
"""Scene, driver, labellings of the comparison, and of that of one job and two."""


@dataclass(frozen=True)
class Spent:
    """Seconds of a study by the clock, of the processor, of its first thread; the share in which the batch solver
    solves."""

    clock: float
    processor: float
    first: float
    kernel: float


def spent(name: str, driver: str, budget: int, jobs: int, kernel: bool = True) -> Spent:
    """What a study takes."""
    scene = (ENUMERATED | LARGE)[name]()
    assembly, space = built(scene)
    watch = Stopwatch()
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict(os.environ, {SWITCH: ""} if kernel else {SWITCH: "off"}),
        one_thread(),
    ):
        make = make_driver(driver, space, 0)
        study = Study(scene, assembly, space, make, Path(folder) / "out", ExploreSettings(budget=budget, jobs=jobs))
        clock, processor, first = time.perf_counter(), time.process_time(), time.thread_time()
        if jobs == 1:
            with watch.watching([(BatchSolver, "solve", "kernel")]), watch.part("rest"):
                study.run()
        else:
            study.run()
        ends = time.perf_counter() - clock, time.process_time() - processor, time.thread_time() - first
    return Spent(*ends, watch.shares().get("kernel", 0.0) if jobs == 1 else 0.0)


def measure(name: str, driver: str, budget: int, longer: int) -> dict[str, float]:
    """What a row of the table needs, seconds of a labelling."""
    spent(name, driver, 64, 1)
    quick = min((spent(name, driver, budget, 1) for _ in range(2)), key=lambda one: one.processor)
    slow = spent(name, driver, budget, 1, kernel=False)
    one, two = spent(name, driver, longer, 1), spent(name, driver, longer, 2)
    return {
        "off": slow.processor / budget,
        "on": quick.processor / budget,
        "clock": slow.clock / quick.clock,
        "share": quick.kernel,
        "one": one.processor / longer,
        "two": max(two.first, 0.5 * two.processor) / longer,
        "clocks": one.clock / two.clock,
    }


def draw(found: dict[str, dict[str, float]]) -> Figure:
    """Labellings a second of each study: without the batch solver, with it, with two jobs."""
    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    ax = figure.subplots()
    kinds = (("off", "one at a time", "#bdbdbd", ""), ("one", "kernel, one job", "#92c5de", "//"))
    for shift, (key, label, colour, hatch) in zip(
        (-0.27, 0.0, 0.27), (*kinds, ("two", "kernel, two jobs on two cores", "#2166ac", "")), strict=True
    ):
        values = [1.0 / row[key] for row in found.values()]
        places = [place + shift for place in range(len(found))]
        bars = ax.bar(places, values, 0.25, color=colour, hatch=hatch, edgecolor="black", linewidth=0.5, label=label)
        ax.bar_label(bars, [f"{value:,.0f}".replace(",", " ") for value in values], fontsize=7, rotation=90, padding=2)
    ax.set_yscale("log")
    ax.set_ylim(top=12.0 * max(1.0 / row["two"] for row in found.values()))
    ax.set_xticks(range(len(found)), [name.replace(", ", "\n") for name in found], fontsize=8)
    ax.set_ylabel("labellings per second, on free cores")
    ax.legend(frameon=False, fontsize=9, ncols=3, loc="upper right")
    return figure


def main() -> None:
    """Measure all studies and write benchmarks/results/whole_studies.md and .png."""
    found = {f"{name}, {driver}": measure(name, driver, *sizes) for name, driver, *sizes in STUDIES}
    save_figure(draw(found), RESULTS / "whole_studies.png")
    head = ["study", "labellings", "one at a time, ms each", "kernel, ms each", "times", "by the clock"]
    head += ["in the kernel", "labellings, 2 jobs", "1 job, ms each", "2 jobs on two free cores, ms each", "times"]
    head += ["by the clock"]
    rows = [
        [
            key,
            str(budget),
            f"{1e3 * row['off']:.2f}",
            f"{1e3 * row['on']:.3f}",
            f"**{row['off'] / row['on']:.1f}**",
            f"{row['clock']:.1f}",
            f"{row['share']:.0%}",
            str(longer),
            f"{1e3 * row['one']:.3f}",
            f"{1e3 * row['two']:.3f}",
            f"**{row['one'] / row['two']:.2f}**",
            f"{row['clocks']:.2f}",
        ]
        for (key, row), (_, _, budget, longer) in zip(found.items(), STUDIES, strict=True)
    ]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    load += " On a machine shared with others two jobs may come out at more than twice one: single runs, a tenth or "
    load += "two apart."
    picture = "![Labellings a second of whole studies](whole_studies.png)"
    parts = ["# Whole studies, with the kernel and without", about(__doc__), picture, table(head, rows)]
    write("whole_studies", "\n\n".join([*parts, f"{described().capitalize()}. {load}"]))


if __name__ == "__main__":
    main()
