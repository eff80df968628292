"""How the gap of a proof that lasts narrows: the wall of 8 × 10 cells in blocks of up to three, by two threads.

Rows are of one run, and each was taken when the clock had reached its time. Processor seconds are those of both
threads, and load is the mean number of processes that asked for the two cores in the minute before: other users had
the rest of them. Processor seconds therefore say more than the clock.
`python -m benchmarks.long_proof` writes the section of benchmarks/results/exact.md; `… 240` stops after 240 s.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Final

from benchmarks.common import RESULTS, about, table, write
from benchmarks.exact import sections, wall
from jld_core import build_assembly
from jld_explore import ExploreSettings, explore
from jld_explore.drivers.exact.driver import Exact
from jld_explore.space import search_space

SECONDS: Final = 1800.0
"""Length of the run, s by the clock."""

TIMES: Final = (30.0, 60.0, 120.0, 240.0, 480.0, 720.0, 960.0, 1200.0, 1500.0)
"""Times of the rows, s by the clock; one more row is taken at the end."""

HEAD: Final = "A proof that lasts"
"""Section of exact.md that is written."""

COLUMNS: Final = ("s by the clock", "processor s", "load", "λ", "bound", "gap", "conflicts", "relaxations")


def row(driver: Exact, begun: float) -> list[str]:
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
    """Rows of one run of some seconds by the clock."""
    scene = wall(8, 10, 3, 2e4)
    driver = Exact(search_space(scene, build_assembly(scene)))
    begun, ended, rows = time.perf_counter(), threading.Event(), list[list[str]]()

    def watch() -> None:
        for at in TIMES:
            if at >= seconds or ended.wait(max(0.0, begun + at - time.perf_counter())):
                return
            rows.append(row(driver, begun))

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            settings = ExploreSettings(jobs=2, pictures=False, seconds=seconds)
            explore(scene, Path(folder) / "out", settings, driver=driver)
    finally:
        ended.set()
        watcher.join()
    return [*rows, row(driver, begun)]


def main(seconds: float = SECONDS) -> None:
    """Run the proof once and write its section; the other sections stay as they are in the file."""
    parts = sections((RESULTS / "exact.md").read_text(encoding="utf-8").rpartition("\n\n")[0])
    words = about(__doc__).partition(" `python")[0]
    parts[HEAD] = f"{words}\n\n{table(COLUMNS, history(seconds))}"
    write("exact", "\n\n## ".join([parts.pop(""), *(f"{head}\n\n{body}" for head, body in parts.items())]))


if __name__ == "__main__":
    main(*(float(text) for text in sys.argv[1:2]))
