"""What a second job brings to searches with the batch solver, by the clock of two free cores.

A search with one and with two jobs at 88 faces, each in a process of its own, in turns. The least and the median of
all turns are given. Read it on a quiet machine only.
`python -m benchmarks.two_jobs` writes the table.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE

SCENE: Final = "planar 88 faces"
"""Scene that is searched."""

BUDGET: Final = {"genetic": 6000, "hillclimb": 6000, "random": 30000}
"""Classes evaluated by each driver."""

TURNS: Final = 9
"""Searches of each kind."""


def search(driver: str, jobs: int) -> dict[str, Any]:
    """Search, and return the best λ and the seconds of the search by the clock and by the processor."""
    from jld_explore.explore import explore
    from jld_explore.settings import ExploreSettings
    from jld_explore.study import Study

    found, run = dict[str, Any](), Study.run

    def timed(study: Any) -> Any:
        clock, processor = time.perf_counter(), time.process_time()
        reason = run(study)
        found["clock"], found["processor"] = time.perf_counter() - clock, time.process_time() - processor
        return reason

    settings = ExploreSettings(driver=driver, budget=BUDGET[driver], jobs=jobs, pictures=False)
    with tempfile.TemporaryDirectory() as folder, patch.object(Study, "run", timed):
        done = explore(LARGE[SCENE](), Path(folder) / "study", settings)
    return found | {"best": done.summary.best}


def elsewhere(driver: str, jobs: int) -> dict[str, Any]:
    """Search in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.two_jobs", driver, str(jobs)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Write benchmarks/results/two_jobs.md."""
    rows = []
    for driver in BUDGET:
        turns = [(elsewhere(driver, 1), elsewhere(driver, 2)) for _ in range(TURNS)]
        assert len({one["best"] for pair in turns for one in pair}) == 1
        clock = np.array([[one["clock"] for one in pair] for pair in turns])
        spent = np.median([[one["processor"] for one in pair] for pair in turns], axis=0)
        least, middle = clock.min(axis=0), np.median(clock, axis=0)
        rows.append(
            [
                driver,
                *(f"{low:.2f}, {usual:.2f}" for low, usual in zip(least, middle, strict=True)),
                f"**{least[0] / least[1]:.2f}**, {middle[0] / middle[1]:.2f}",
                *(f"{value:.2f}" for value in spent),
            ]
        )
        print(rows[-1], flush=True)
    head = [
        "driver",
        "1 job: least, median, s",
        "2 jobs: least, median, s",
        "times",
        "processor, 1 job, s",
        "processor, 2 jobs, s",
    ]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    write("two_jobs", "\n\n".join(["# Two jobs", about(__doc__), table(head, rows), load]))


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.stdout.write(json.dumps(search(sys.argv[1], int(sys.argv[2]))) + "\n")
    else:
        main()
