"""Compare the default driver with the genetic one in equal processor time: `python -m benchmarks.default_driver`.

Each search runs in this process alone, without pictures, by a clock of its processor time: other work on the machine
does not count. The same seeds for both. Columns: the driver that is chosen, and the best λ of both at each limit, the
least over the seeds; `proven` where the default proves it. Where the default is the genetic driver, both see the same
layouts in the same order, and are compared after equal numbers of them. The table is a section of
`benchmarks/results/drivers.md`.
"""

from __future__ import annotations

import csv
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.common import RESULTS, about, table
from benchmarks.search_scenes import ENUMERATED, LARGE
from jld_core import samples
from jld_core.scene import Scene
from jld_explore.explore import explore
from jld_explore.settings import ExploreSettings

LIMITS: Final = (1.0, 4.0)
"""Processor times of one search, s."""

SEEDS: Final = (0, 1)
"""Seeds of both drivers."""

SAME: Final = 1e-6
"""Relative difference of λ up to which two searches are alike: the width of brackets."""

SECTION: Final = "## The default driver beside `genetic`"
"""Heading of the section, which ends the page."""


def scenes() -> dict[str, Callable[[], Scene]]:
    """Return the scenes that searches are measured on, and samples below and above the reach of proofs."""
    return {
        **ENUMERATED,
        **LARGE,
        "wall of 4 courses": lambda: samples.wall(courses=4, length=2.0, load="quarter"),
        "arch, 2 rings": lambda: samples.arch(voussoirs=13, rings=2, thickness=0.3, load="quarter"),
        "grid 6x4": lambda: samples.grid(columns=6, rows=4, load="quarter"),
        "flat arch": lambda: samples.flat_arch(voussoirs=9, rings=2, load="quarter"),
    }


@dataclass(frozen=True)
class Search:
    """Outcome of a search.

    Attributes
    ----------
    best : float
        Best λ, infinite for locked layouts, NaN without one.
    driver : str
        Name of the driver.
    proven : bool
        Whether the best is proven.
    count : int
        Number of layouts evaluated.
    course : list of (int, float)
        Number of layouts so far and best λ, at each improvement.
    """

    best: float
    driver: str
    proven: bool
    count: int
    course: list[tuple[int, float]]

    def after(self, count: int) -> float:
        """Return the best λ of the first `count` layouts, NaN if none of them has one."""
        return max((best for number, best in self.course if number <= count), default=math.nan)


def searched(scene: Scene, driver: str | None, seconds: float, seed: int) -> Search:
    """Run a search."""
    settings = ExploreSettings(driver=driver, seconds=seconds, jobs=1, seed=seed, pictures=False, check_fields=0)
    with tempfile.TemporaryDirectory() as folder:
        facts = explore(scene, Path(folder) / "out", settings, started=time.perf_counter()).summary.to_json()
        with (Path(folder) / "out" / "convergence.csv").open(encoding="utf-8") as file:
            course = [(int(row["solves"]), float(row["best"] or "nan")) for row in csv.DictReader(file)]
    best = float("inf") if facts["unbounded"] else facts["best"]
    value = math.nan if best is None else float(best)
    return Search(value, str(facts["driver"]), bool(facts["proven"]), int(facts["evaluated"]), course)


def is_worse(ours: Search, theirs: Search) -> bool:
    """Return True if a search found less than another one.

    Searches by one driver see the same layouts in the same order: how many more one of them sees, is decided by the
    clock. They are compared after equal numbers of layouts.
    """
    one, other = ours.best, theirs.best
    if ours.driver == theirs.driver:
        count = min(ours.count, theirs.count)
        one, other = ours.after(count), theirs.after(count)
    # locked layouts have an infinite λ, and a search without a layout has none
    return one != other and not math.isnan(other) and not one >= other - SAME * abs(other)


def compared(wanted: list[str]) -> tuple[list[list[str]], list[str]]:
    """Return the rows of the table, and the cases in which the default is worse."""
    rows, worse = [], []
    for name, make in scenes().items():
        if wanted and name not in wanted:
            continue
        scene = make()
        searched(scene, None, 0.1, SEEDS[0])  # the first search of a scene in a process takes 0.05 s more
        row = [name, ""]
        for seconds in LIMITS:
            found = [[searched(scene, driver, seconds, seed) for seed in SEEDS] for driver in (None, "genetic")]
            ours, theirs = (min(one.best for one in runs) for runs in found)
            for one, other in zip(*found, strict=True):
                if is_worse(one, other):
                    worse.append(f"{name}, {seconds:g} s: {one.best:.6g} beside {other.best:.6g}")
            row[1] = found[0][0].driver
            proven = " proven" if all(one.proven for one in found[0]) else ""
            row += [f"{ours:.6g}{proven}", f"{theirs:.6g}"]
        rows.append(row)
        sys.stderr.write("  ".join(row) + "\n")
    return rows, worse


def main() -> None:
    """Measure, and replace the section of the page."""
    time.perf_counter = time.process_time
    wanted = sys.argv[1:]
    rows, worse = compared(wanted)
    if wanted:
        sys.stderr.write("\n".join(["worse:", *worse]) + "\n")
        return
    head = ["scene", "default"] + [f"{who}, {s:g} s" for s in LIMITS for who in ("default", "genetic")]
    verdict = f"Worse in {len(worse)} of {len(rows) * len(LIMITS) * len(SEEDS)} pairs: {'; '.join(worse) or 'none'}."
    words = f"Written by `python -m benchmarks.default_driver`. {about(__doc__)}"
    page = RESULTS / "drivers.md"
    before = page.read_text(encoding="utf-8").partition(SECTION)[0].rstrip() if page.exists() else ""
    text = f"{before}\n\n{SECTION}\n\n{words}\n\n{table(head, rows)}\n\n{verdict}\n"
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
