"""How large the certificate of a proven optimum is, and how long it takes to write and to check, beside the search.

Scenes are those of `benchmarks.exact`; one whose search runs out of time has a certificate of the bound it got to.
`python -m benchmarks.certified SECONDS` gives every search that long at the most.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from benchmarks.common import table, write
from benchmarks.exact import scenes
from jld_core import Scene
from jld_explore import ExploreSettings, explore
from jld_explore.verification import verify

SECONDS: Final = 60.0

_LEFT: Final = ("10 × 12", "8 × 10, s = 3", "flat arch", "barrel vault")
"""Scenes that take minutes, left to `benchmarks.exact`, and one whose faces are no rectangles: no certificate."""


def row(name: str, scene: Scene, seconds: float) -> list[str]:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "proof.jld"
        start = time.perf_counter()
        settings = ExploreSettings(jobs=1, pictures=False, driver="exact", seconds=seconds, certificate=path)
        facts = explore(scene, Path(folder) / "out", settings).summary.facts
        spent = time.perf_counter() - start
        done = verify(path, scene)
    return [
        name,
        f"{facts['best']:.7g}",
        f"{done.claim.bound:.7g}",
        "yes" if facts["proven"] else "no",
        str(facts["conflicts"]),
        f"{facts['seconds']:.1f}",
        f"{max(spent - facts['seconds'], 0.0):.1f}",
        str(done.mechanisms),
        str(done.rules),
        str(done.lemmas),
        f"{done.size / 1e3:.0f}",
        f"{done.seconds:.2f}",
    ]


def main(seconds: float = SECONDS) -> None:
    """Prove, write and check every scene."""
    rows = []
    for name, (scene, _, _) in scenes().items():
        if not name.startswith(_LEFT):
            rows.append(row(name, scene, seconds))
            print(rows[-1], flush=True)
    head = ["scene", "λ", "bound checked", "proven", "conflicts", "s to search", "s to write"]
    head += ["mechanisms", "rules", "lemmas", "kB", "s to check"]
    note = (
        f"At most {seconds:g} s to search, one thread. Only what the refutation needs is written, each mechanism found "
        "again. Checking is plain Python in whole numbers, without any solver."
    )
    write("certified", "\n\n".join(("# Certificates of proven optima", table(head, rows), note)))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)
