"""What a second job is worth: `python -m benchmarks.jobs`.

One search with one job and with two, timed after its first labellings, so that what it begins with does not
count. Two jobs are threads of one process where the batch solver solves, and processes where it does not. Besides
wall-clock rates, which other processes on the machine disturb, it counts processor time: what the first thread, which
asks and records, spends on a labelling is serial, the rest is shared out. The rate that two free cores allow is the
smaller of one over the first thread's time and two over the sum of all.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Final

import psutil

from benchmarks.common import about, table, write
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from jld_core.batch.library import described
from jld_core.scene import Scene
from jld_explore.drivers import make_driver
from jld_explore.settings import ExploreSettings
from jld_explore.study import Progress, Study

WARM: Final = 500
BUDGETS: Final = {"flagship, 24 faces": 6_000, "planar, 88 faces": 6_000}
DRIVERS: Final = ("random", "genetic")


def _scenes() -> dict[str, Scene]:
    return {"flagship, 24 faces": ENUMERATED["flagship"](), "planar, 88 faces": LARGE["planar 88 faces"]()}


def _processor() -> tuple[float, float]:
    """Processor seconds of this thread, and of this process with its children that run."""
    own = psutil.Process()
    used = time.process_time()
    for child in own.children(recursive=True):
        try:
            times = child.cpu_times()
        except psutil.NoSuchProcess:
            continue
        used += times.user + times.system
    return time.thread_time(), used


def run(scene: Scene, driver: str, jobs: int, budget: int) -> tuple[float, float, float]:
    """Wall-clock, processor time of the first thread and of all for each labelling after WARM of them, s."""
    assembly, space = built(scene)
    begun: list[tuple[int, float, float, float]] = []
    ended: list[tuple[int, float, float, float]] = []

    def look(now: Progress) -> None:
        if not begun and now.done >= WARM:
            begun.append((now.done, time.perf_counter(), *_processor()))
        if not ended and now.done >= budget:
            ended.append((now.done, time.perf_counter(), *_processor()))

    with tempfile.TemporaryDirectory() as folder:
        make = make_driver(driver, space, 0)
        study = Study(
            scene, assembly, space, make, Path(folder) / "out", ExploreSettings(jobs=jobs, budget=budget), report=look
        )
        study.run()
    (first, *start), (last, *end) = begun[0], ended[0]
    wall, first_thread, everything = ((b - a) / (last - first) for a, b in zip(start, end, strict=True))
    return wall, first_thread, everything


def main() -> None:
    """Measure every scene and driver with one job and with two."""
    rows = []
    for name, scene in _scenes().items():
        for driver in DRIVERS:
            alone, _, single = run(scene, driver, 1, BUDGETS[name])
            wall, own, both = run(scene, driver, 2, BUDGETS[name])
            possible = single / max(own, 0.5 * both)
            rows.append(
                [
                    name,
                    driver,
                    f"{1.0 / alone:.0f}",
                    f"{1.0 / wall:.0f}",
                    f"{alone / wall:.2f}",
                    f"{1e3 * single:.3f}",
                    f"{1e3 * own:.3f}",
                    f"{1e3 * both:.3f}",
                    f"{own / both:.0%}",
                    f"{possible:.2f}",
                ]
            )
    head = [
        "scene",
        "driver",
        "labellings / s, 1 job",
        "2 jobs",
        "times",
        "processor ms, 1 job",
        "first thread, 2 jobs",
        "all, 2 jobs",
        "serial share",
        "times that two free cores allow",
    ]
    load = psutil.getloadavg()[0]
    note = (
        f"After the first {WARM} labellings. Load of the machine at the end: {load:.1f} on {psutil.cpu_count()} cores; "
        "above 2, rates are those of what was left, and the last column is the one to read."
    )
    write(
        "jobs",
        "\n\n".join(["# One job and two", about(__doc__), table(head, rows), note, f"{described().capitalize()}."]),
    )


if __name__ == "__main__":
    main()
