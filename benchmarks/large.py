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

COMMANDS: Final = (
    ("contacts of 103 823 cubes, s of the processor", "103", "40", "growth (all sizes)"),
    (
        "3 025 cells: crushing, load cases, locked, unstable, without friction, s",
        "–",
        "12, 7, 7, 1, 9",
        "large_answers",
    ),
    ("time a layout of 24 to 2 016 faces, batch solver", "", "", "lanes, throughput"),
    ("genetic and random search with two jobs", "", "", "two_jobs"),
    ("start of the commands, demo", "", "", "start_up"),
    ("a million rows: memory, tables, page", "", "", "million"),
    ("gap of the 8 × 10 wall", "", "", "exact"),
    ("flagship by fields, in place of halved cells", "", "", "fields_search"),
)
"""Other numbers of large scenes: what, before and after as recorded once, modules of benchmarks that measure them."""


def others() -> str:
    """Return the table of `COMMANDS`."""
    head = ["number", "version 0.2", "now", "`python -m benchmarks.NAME`, and its table"]
    return "## Other numbers, by one command each\n\n" + table(
        head, [[old or "in its table" for old in row] for row in COMMANDS]
    )


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
