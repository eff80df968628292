"""One labelling alone: the whole of `solve` by the batch solver, its making included, beside the usual way.

Processor time of `solve`, from the assembly to the result, on the same labellings in turns in one process; medians.
Cubes are pushed at a top corner, with inner strength 20 kPa; random segmentations. Left: what the batch solver does not
settle, or not narrowly, goes the usual way, and its time is in the batch solver's column.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import about, random_segmentations, table, write
from benchmarks.lanes_hard import corner_of_studies, cubes, prisms
from jld_core.assembly import Assembly
from jld_core.batch.library import described
from jld_core.models import solve

SCENES: Final[dict[str, Callable[[], Assembly]]] = {
    "hexagonal prisms": lambda: prisms(6, 4, 4),
    "corner of the studies, 225°": corner_of_studies,
    "3 × 3 × 3 cubes": lambda: cubes(3, 2e4),
    "4 × 4 × 4 cubes": lambda: cubes(4, 2e4),
    "5 × 5 × 5 cubes": lambda: cubes(5, 2e4),
}
LABELLINGS: Final = 9
NONE: Final = (1, 0)  # faces for which the batch solver is asked
ALL: Final = (0, 10**6)


def measure(name: str, assembly: Assembly) -> list[str]:
    """One row of the table."""
    labellings = random_segmentations(assembly, LABELLINGS + 1, seed=7)
    times, widths, differ, same, left = [], [], 0.0, 0, 0
    for k, labels in enumerate(labellings):
        found = []
        for faces in (NONE, ALL):
            with patch("jld_core.limit.analysis.FACES_WHERE_BATCH_IS_FASTER", faces):
                start = time.process_time()
                found.append((solve(assembly, labels), time.process_time() - start))
        if k == 0:
            continue  # what a process makes once
        (usual, before), (kernel, after) = found
        times.append((before, after))
        widths.append((usual.gap, kernel.gap))
        same += usual.status is kernel.status
        left += kernel.solve_log != ("batch solver",)
        differ = max(differ, abs(usual.load_factor - kernel.load_factor) / abs(usual.load_factor))
    before, after = np.median(times, axis=0)
    wide, narrow = np.nanmedian(widths, axis=0)
    return [
        name,
        str(len(assembly.interfaces)),
        f"{1e3 * before:.1f}",
        f"{1e3 * after:.1f}",
        f"**{np.median([one / other for one, other in times]):.1f}**",
        f"{left} of {LABELLINGS}",
        f"{wide:.0e} / {narrow:.0e}",
        f"{same} of {LABELLINGS}",
        f"{differ:.0e}",
    ]


def main() -> None:
    """Measure all scenes and write benchmarks/results/lanes_single.md."""
    head = ["scene", "faces", "usual way, ms", "kernel, ms", "times", "left", "bracket, usual / kernel", "same status"]
    head += ["λ differs by, relative, at most"]
    rows = [measure(name, make()) for name, make in SCENES.items()]
    parts = ["# One labelling alone", about(__doc__), table(head, rows), f"{described().capitalize()}."]
    write("lanes_single", "\n\n".join(parts))


if __name__ == "__main__":
    main()
