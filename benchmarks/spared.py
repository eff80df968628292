"""What each driver is spared: labellings settled by certificates, or pruned by the associative bound.

Certificates: what past solves prove settles a labelling without solving it; every driver asks for the same number of
classes with and without them. Pruning: with the objective "zero-dilation", labellings whose associative λ is no
larger than an answer already known are not solved without dilation.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from benchmarks.common import table, write
from benchmarks.search_scenes import ENUMERATED, grid
from jld_core.limit import SolveOptions
from jld_core.scene import Scene, parse_scene
from jld_explore import ExploreSettings, explore

DRIVERS: Final = ("enumeration", "random", "hillclimb", "genetic", "exact")
JOBS: Final = 2
BUDGET: Final = 1_000
PRUNING: Final = 300
SECONDS: Final = 60.0
"""After which a search is stopped: the exact driver proves for longer than the others search."""


def wall() -> Scene:
    """A wall of 5 × 3 cells under a horizontal body load, inner faces of 20 kPa."""
    weak = {"tensile_strength": 2e4, "shear_strength": 2e4}
    return parse_scene(grid(["a" * 5] * 3 + ["#" * 5], [2, 5], [{"body": [1, 0]}], **weak))


def summary(scene: Scene, **settings: Any) -> dict[str, Any]:
    """The summary of one search."""
    sys.stderr.write(f"{scene.name}: {settings}\n")
    with tempfile.TemporaryDirectory() as folder:
        chosen = ExploreSettings(jobs=JOBS, seconds=SECONDS, **settings)
        return explore(scene, Path(folder) / "out", chosen).summary.facts


def settled_shares(scenes: dict[str, Scene]) -> list[list[str]]:
    """A row for each scene and driver."""
    rows = []
    for name, scene in scenes.items():
        for driver in DRIVERS:
            plain = summary(scene, driver=driver, budget=BUDGET)
            pooled = summary(scene, driver=driver, budget=BUDGET, certificates=True)
            rows.append(
                [
                    name,
                    driver,
                    str(pooled["evaluated"]),
                    str(pooled["solved"]),
                    f"{pooled['settled'] / pooled['evaluated']:.0%}",
                    f"{plain['best']:.6g}",
                    f"{pooled['best']:.6g}",
                    f"{plain['seconds']:.1f}",
                    f"{pooled['seconds']:.1f}",
                ]
            )
    return rows


def pruned_shares(scenes: dict[str, Scene]) -> list[list[str]]:
    """A row for each scene and driver."""
    rows = []
    for name, scene in scenes.items():
        for driver in ("enumeration", "random", "hillclimb", "genetic"):
            found = summary(scene, driver=driver, budget=PRUNING, model=SolveOptions(friction="zero-dilation"))
            share = f"{found['pruned'] / found['evaluated']:.0%}"
            rows.append([name, driver, str(found["evaluated"]), str(found["pruned"]), share, f"{found['seconds']:.1f}"])
    return rows


def main() -> None:
    """Measure both."""
    scenes = {"flagship": ENUMERATED["flagship"](), "wall 5 × 3, 20 kPa": wall()}
    head = ["scene", "driver", "classes", "solved", "settled", "best λ without", "with", "s without", "s with"]
    first = table(head, settled_shares(scenes))
    second = table(["scene", "driver", "classes", "pruned", "share", "s"], pruned_shares(scenes))
    note = (
        f"{JOBS} workers, one seed; {BUDGET} and {PRUNING} classes and {SECONDS:.0f} s at the most, by the clock, "
        "start of workers included. With certificates scenes this small are solved by two threads of one process."
    )
    write(
        "spared", f"# What drivers are spared\n\n## Certificates\n\n{first}\n\n## Zero dilation\n\n{second}\n\n{note}"
    )


if __name__ == "__main__":
    main()
