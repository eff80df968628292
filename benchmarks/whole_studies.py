"""Whole studies by the clock: from the first labelling asked to the last one on disk, with the kernel and without.

The same scene, driver, seed and budget once with the kernel and one job, once without it (`JLD_KERNEL=off`, one
job), so nothing but what the kernel does differs: λ of nearly all labellings, and the joining of cells to blocks.
Seconds are those of the clock on a machine with nothing else to do. Kernel alone: the share of the clock that is
spent in solving. Two jobs are threads of the same process; their ratio is taken on a longer study of the same kind,
`labellings, 2 jobs` long, with both numbers of jobs.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Final
from unittest.mock import patch

from matplotlib.figure import Figure

from benchmarks.common import RESULTS, about, table, write
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from benchmarks.stopwatch import Stopwatch
from jld_core.lanes import Lanes, described
from jld_core.lanes.library import SWITCH
from jld_core.threads import one_thread
from jld_core.views.figures import save_figure
from jld_explore.drivers import make_driver
from jld_explore.study import ExploreSettings, Study

STUDIES: Final = (
    ("flagship", "random", 1024, 4096),
    ("flagship", "genetic", 1024, 4096),
    ("planar 88 faces", "random", 2048, 24_576),
    ("planar 88 faces", "genetic", 2048, 8192),
    ("planar 278 faces", "random", 256, 2048),
    ("planar 278 faces", "genetic", 256, 1024),
    ("spatial 3x3x3", "random", 512, 4096),
    ("spatial 3x3x3", "genetic", 512, 2048),
)
"""Scene, driver, labellings of the comparison, and of that of one job and two."""


def clock(name: str, driver: str, budget: int, jobs: int, kernel: bool = True) -> tuple[float, float]:
    """Seconds of a study by the clock, and the share of them in which the kernel solves."""
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
        start = time.perf_counter()
        if jobs == 1:
            with watch.watching([(Lanes, "solve", "kernel")]), watch.part("rest"):
                study.run()
        else:
            study.run()
        spent = time.perf_counter() - start
    return spent, watch.shares().get("kernel", 0.0) if jobs == 1 else 0.0


def measure(name: str, driver: str, budget: int, longer: int) -> dict[str, float]:
    """What a row of the table needs."""
    clock(name, driver, 64, 1)
    with_kernel, share = min(clock(name, driver, budget, 1) for _ in range(2))
    without, _ = clock(name, driver, budget, 1, kernel=False)
    pairs = [(clock(name, driver, longer, 1)[0], clock(name, driver, longer, 2)[0]) for _ in range(2)]
    one, two = (min(turn) for turn in zip(*pairs, strict=True))
    return {
        "off": without / budget,
        "on": with_kernel / budget,
        "share": share,
        "one": one / longer,
        "two": two / longer,
    }


def draw(found: dict[str, dict[str, float]]) -> Figure:
    """Labellings a second of each study: without the kernel, with it, with two jobs."""
    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    ax = figure.subplots()
    kinds = (("off", "one at a time", "#bdbdbd", ""), ("one", "kernel, one job", "#92c5de", "//"))
    for shift, (key, label, colour, hatch) in zip(
        (-0.27, 0.0, 0.27), (*kinds, ("two", "kernel, two jobs", "#2166ac", "")), strict=True
    ):
        values = [1.0 / row[key] for row in found.values()]
        places = [place + shift for place in range(len(found))]
        bars = ax.bar(places, values, 0.25, color=colour, hatch=hatch, edgecolor="black", linewidth=0.5, label=label)
        ax.bar_label(bars, [f"{value:,.0f}".replace(",", " ") for value in values], fontsize=7, rotation=90, padding=2)
    ax.set_yscale("log")
    ax.set_ylim(top=12.0 * max(1.0 / row["two"] for row in found.values()))
    ax.set_xticks(range(len(found)), [name.replace(", ", "\n") for name in found], fontsize=8)
    ax.set_ylabel("labellings per second, by the clock")
    ax.legend(frameon=False, fontsize=9, ncols=3, loc="upper right")
    return figure


def main() -> None:
    """Measure all studies and write benchmarks/results/whole_studies.md and .png."""
    found = {f"{name}, {driver}": measure(name, driver, *sizes) for name, driver, *sizes in STUDIES}
    save_figure(draw(found), RESULTS / "whole_studies.png")
    head = ["study", "labellings", "one at a time, ms each", "kernel, ms each", "times", "in the kernel"]
    head += ["labellings, 2 jobs", "1 job, ms each", "2 jobs, ms each", "times"]
    rows = [
        [
            key,
            str(budget),
            f"{1e3 * row['off']:.2f}",
            f"{1e3 * row['on']:.3f}",
            f"**{row['off'] / row['on']:.1f}**",
            f"{row['share']:.0%}",
            str(longer),
            f"{1e3 * row['one']:.3f}",
            f"{1e3 * row['two']:.3f}",
            f"**{row['one'] / row['two']:.2f}**",
        ]
        for (key, row), (_, _, budget, longer) in zip(found.items(), STUDIES, strict=True)
    ]
    picture = "![Labellings a second of whole studies](whole_studies.png)"
    parts = ["# Whole studies, with the kernel and without", about(__doc__), picture, table(head, rows)]
    write("whole_studies", "\n\n".join([*parts, f"{described().capitalize()}."]))


if __name__ == "__main__":
    main()
