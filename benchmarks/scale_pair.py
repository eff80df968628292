"""Walls of benchmarks/scale.py before and after, in turns.

Each wall from the document to the bracket by the Schur solver, in a process of its own, by processor time: with the
sources of another checkout and with those of this one, in alternating order. Ratios are medians over the pairs.
`python -m benchmarks.scale_pair CHECKOUT` writes the table; CHECKOUT is a folder that holds the sources of an older
commit, and without it nothing is measured.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

from benchmarks.common import ROOT, about, table, write
from benchmarks.scale import proof_time

WALLS: Final = tuple(
    (case, courses, turns)
    for case, sizes in (
        ("in plane", ((10, 5), (20, 5), (40, 3), (60, 2))),
        ("out of plane", ((10, 5), (20, 5), (40, 3), (60, 2))),
        ("planar", ((20, 5), (60, 5), (100, 3), (140, 2))),
    )
    for courses, turns in sizes
)
"""Case, courses and number of pairs of the walls that take 0.1 to 20 s."""


def run(tree: Path, case: str, courses: int) -> dict[str, Any]:
    """Measure one wall with the sources of a checkout."""
    found: dict[str, Any] = json.loads(
        subprocess.run(
            [sys.executable, "-m", "benchmarks.scale_one", case, str(courses), "schur"],
            cwd=tree,
            env=dict(os.environ, PYTHONPATH=os.pathsep.join((str(tree / "src"), str(tree)))),
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()[-1]
    )
    return found


def row(other: Path, case: str, courses: int, turns: int) -> list[str]:
    """Measure one wall with both checkouts in turns; return the row of the table."""
    found: tuple[list[dict[str, Any]], list[dict[str, Any]]] = [], []
    for turn in range(turns):
        for side in (0, 1) if turn % 2 == 0 else (1, 0):
            found[side].append(run((other, ROOT)[side], case, courses))
    old, new = ([proof_time(one) for one in side] for side in found)
    ratio = statistics.median(b / a for a, b in zip(old, new, strict=True))
    steps = " → ".join(str(side[0]["iterations"]) for side in found)
    return [case, str(courses), f"{statistics.median(old):.2f}", f"{statistics.median(new):.2f}", f"{ratio:.2f}", steps]


def main() -> None:
    """Measure all walls and write the table."""
    if len(sys.argv) < 2:
        print("scale_pair: not measured; give the folder of an older checkout")
        return
    rows = [row(Path(sys.argv[1]).resolve(), *wall) for wall in WALLS]
    head = ["wall", "courses", "before, s", "now, s", "ratio", "iterations"]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    write("scale_pair", "\n\n".join(["# Scale, before and after", about(__doc__), table(head, rows), load]))


if __name__ == "__main__":
    main()
