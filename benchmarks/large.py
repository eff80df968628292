"""Large scenes before and after: contacts, first layout, and λ of one layout, by processor time and memory.

The scenes of benchmarks/growth.py: square walls on a row of supports and cubes of cubes on a slab, blocks of up to four
cells that may crack, under a horizontal body load. Each size is a process of its own with one thread. λ runs from the
assembly to a bracket that the prover has checked. Before: version 0.2, as benchmarks/results/growth.md recorded it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Final

from benchmarks.common import about, table, write
from benchmarks.growth import Found, run

SIZES: Final = (
    ("planar", 32),
    ("planar", 100),
    ("planar", 178),
    ("spatial", 5),
    ("spatial", 10),
    ("spatial", 16),
    ("spatial", 22),
)
"""Kind and cells along an edge, up to 31 684 planar cells and 10 648 cubes."""

BEFORE: Final = {
    ("planar", 32): ("0.06", "0.08", "2.79", "272"),
    ("planar", 100): ("0.75", "2.52", "188.32, uncertified", "637"),
    ("planar", 178): ("3.04", "23.35", "over 120", "–"),
    ("spatial", 5): ("0.10", "0.01", "2.49", "250"),
    ("spatial", 10): ("1.00", "0.07", "85.86", "3177"),
    ("spatial", 16): ("4.90", "0.58", "over 150", "–"),
    ("spatial", 22): ("15.87", "3.40", "over 150", "–"),
}
"""Contacts, first layout and λ in seconds, and the highest memory in MB, of version 0.2."""

NUMBERS: Final = (
    ("1", "10 000 planar cells, one layout, s", "15", "188, uncertified", "12.7", "large"),
    ("1", "31 684 planar cells, s", "80", "over 120", "33.9", "large"),
    ("1", "1 000 cubes, s and MB", "6, 400", "85.9, 3 177", "3.6, 323", "large"),
    ("1", "4 096 cubes, s and MB", "60, 1 500", "over 150", "56.8, 941", "large"),
    ("1", "10 648 cubes, s and MB", "400, 4 000", "over 150", "325.8, 3 190", "large"),
    ("1", "walls of scale.md, time after for time before", "1.03", "1", "0.74 to 0.91", "scale_pair CHECKOUT"),
    (
        "1",
        "3 025 cells: crushing, load cases, locked, unstable, λ = 0, s",
        "–",
        "–",
        "13, 7, 9, 1, 10",
        "large_answers",
    ),
    ("1", "3 025 cells between supports, s", "–", "over 110", "3 to 11", "large_answers"),
    ("2", "2 500 cells, s of the processor a layout", "1.2", "1.45 to 1.9", "1.01", "large_search"),
    ("2", "the same, two load cases; supported beside", "1.2", "–", "1.89, not reached; 0.95", "large_search"),
    ("2", "10 000 cells, first layout, s", "1", "2.5", "0.18", "large"),
    ("2", "contacts of 103 823 cubes, s", "60", "103", "40", "growth"),
    ("2", "solved again after a local change", "measured", "–", "in its table", "local_change"),
    ("3", "946 faces, ms a layout by the batch solver", "half of before", "37.7", "7.4", "lanes"),
    ("3", "2 016 faces, ms a layout by the batch solver", "fifth of before", "130.1", "13.4", "lanes"),
    ("4", "genetic, 88 faces, two jobs, times by the clock", "1.5", "1.2", "1.62", "two_jobs"),
    ("4", "random, 88 faces, two jobs, times by the clock", "as before", "1.83", "1.81", "two_jobs"),
    ("5", "jld solve on a small scene, s", "0.8", "1.27", "0.60", "start_up"),
    ("5", "jld --help, s", "0.3", "0.03", "0.03", "start_up"),
    ("5", "make demo in a fresh clone, s", "60", "–", "43 (setup and search by the clock, once)", "start_up --demo"),
    ("6", "gap of the 8 × 10 wall, blocks of three, after 240 s, %", "2", "3.4", "in its table", "exact"),
    ("6", "flagship by fields, in place of halved cells", "replaced", "halved", "in its table", "fields_search"),
    ("7", "a million rows, GB", "1.2", "1.50", "0.95", "million"),
    ("7", "their tables, s", "12", "25.5", "9.5", "million"),
    ("7", "page of 20 000 rows opens, s", "2", "–", "1.15", "page_rows"),
)
"""Numbers asked for: part, what, asked, before and now as last measured, and the module that measures the last."""


def others() -> str:
    """Return the table of `NUMBERS`."""
    head = ["part", "number", "asked", "before", "now", "`python -m benchmarks.NAME`"]
    return "## All numbers, each by one command\n\n" + table(head, NUMBERS)


def row(kind: str, edge: int, found: Found) -> list[str]:
    """Return the row of one size: each number of version 0.2 and of now."""
    seconds, memory = found["seconds"], found["memory"]
    now = [f"{seconds[phase]:.2f}" if phase in seconds else "–" for phase in ("contacts", "driver", "λ")]
    now.append(f"{memory['λ']:.0f}" if "λ" in memory else "–")
    cells = f"{edge ** (2 if kind == 'planar' else 3):,}".replace(",", " ")
    pairs = [f"{old} → {new}" for old, new in zip(BEFORE[kind, edge], now, strict=True)]
    return [kind, cells, *pairs, f"{found['width']:.0e}" if "width" in found else "–", found.get("status", "–")]


def main(wanted: Sequence[str] = ()) -> None:
    """Measure sizes and write the table. wanted: names such as planar-100; empty for all."""
    chosen = [(kind, edge) for kind, edge in SIZES if not wanted or f"{kind}-{edge}" in wanted]
    rows = [row(kind, edge, run(kind, edge, seconds=900)) for kind, edge in chosen]
    head = ["kind", "cells", "contacts, s", "first layout, s", "λ, s", "MB", "relative width", "status"]
    text = "Times before and after were measured on machines of one type; it was idle after."
    write("large", "\n\n".join(["# Large scenes", about(__doc__), text, table(head, rows), others()]))


if __name__ == "__main__":
    main(sys.argv[1:])
