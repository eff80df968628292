"""The exact driver by fields: against the race of all layouts on random scenes, and on walls too large to enumerate.

Where blocks crack anywhere, every layout has a bracket and no exact λ. Two searches of one scene agree where neither
best layout is proven to carry more than the other's bound on all layouts, and where brackets of each layout overlap.
`python -m benchmarks.fields_search --flagship` proves the flagship alone, into a table of its own.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT, about, table, write
from jld_core import InputError, Scene, load_scene, parse_scene
from jld_core.scene.cracks import FieldCracks
from jld_explore import Exploration, explore

GAP: Final = 0.05
"""Gap of the walls."""

WIDE: Final = 0.15
"""Gap of the random scenes."""

SLACK: Final = 1e-9
"""Relative rounding that two bounds may differ by."""

WALLS: Final[dict[str, tuple[int, int, int, float]]] = {
    "4 × 6, s = 3, 5 kPa": (4, 6, 3, 5e3),
    "6 × 4, s = 3, 20 kPa": (6, 4, 3, 2e4),
    "4 × 6, s = 3, 20 kPa": (4, 6, 3, 2e4),
}
"""Cells across and up (the row of supports among them), largest block in cells, strength in Pa."""


def wall(across: int, up: int, cells: int, strength: float) -> Scene:
    """A wall of cells of 0.4 × 0.2 m, 0.2 m thick, on a row of supports, under a horizontal body load."""
    return parse_scene(
        {
            "name": f"wall {across} × {up}",
            "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["a" * across] * (up - 1) + ["#" * across]},
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": 0.75},
                "inner": {"tensile_strength": strength, "shear_strength": strength},
            },
            "loads": {"live": [{"body": [1, 0]}]},
            "search": {"block_cells": [1, cells]},
            "cracks": {"kind": "fields", "gap": GAP},
        }
    )


def random_scene(seed: int) -> Scene:
    """A random grid of 2 × 2 to 3 × 3 cells with random strengths, loads, limits and load cases."""
    rng = np.random.default_rng([seed, 9])
    # two cells or, in a third of all scenes, three
    across, up = (2 + int(rng.random() < 0.35) for _ in range(2))
    low = 10.0 ** rng.uniform(3.3, 5.0)
    inner: dict[str, Any] = {"tensile_strength": low, "shear_strength": low * float(rng.uniform(0.5, 2.0))}
    dry: dict[str, Any] = {"friction_coefficient": float(rng.uniform(0.3, 0.9))}
    if rng.random() < 0.25:
        # the tensile strength may not lie beyond the apex of friction
        apex = (1.0 - SLACK) * inner["shear_strength"] / inner["tensile_strength"]
        inner["friction_coefficient"] = min(float(rng.uniform(0.1, 0.7)), apex)
    if rng.random() < 0.2:
        inner["compressive_strength"] = 8.0 * low
    if rng.random() < 0.2:
        dry["cohesion"] = 0.2 * low
    if rng.random() < 0.2:
        dry["compressive_strength"] = 8.0 * low
    loads: dict[str, Any] = {"live": _live(rng, across)}
    if rng.random() < 0.3:
        first = {"name": "one", "live": _live(rng, across), "required": float(rng.uniform(0.5, 2.0))}
        loads = {"cases": [first, {"name": "two", "live": _live(rng, across)}]}
    base = "".join(rng.choice(["#", "."], across, p=[0.8, 0.2]))
    rows = ["a" * across] * up + [base if "#" in base else "#" * across]
    return parse_scene(
        {
            "name": f"random {seed}",
            "grid": {"cell": [0.3, 0.2], "thickness": 0.1, "rows": rows},
            "materials": {"density": 1600, "dry": dry, "inner": inner},
            "loads": loads,
            "search": {"block_cells": [1, int(rng.integers(2, 4))]},
            "cracks": {"kind": "fields", "gap": WIDE},
        }
    )


def _live(rng: np.random.Generator, across: int) -> list[dict[str, Any]]:
    """A body load in a random direction, or a force on the top."""
    if rng.random() < 0.6:
        angle = float(rng.uniform(-0.5, 3.6))
        return [{"body": [math.cos(angle), -math.sin(angle)]}]
    column = int(rng.integers(across))
    return [{"element": f"c{column}r0", "force": [float(rng.uniform(-0.3, 0.3)), -1]}]


@dataclass(frozen=True)
class Comparison:
    """Two searches of one scene, and how they disagree, "" for not at all."""

    name: str
    raced: Exploration | None
    proven: Exploration | None
    problem: str


def compare(scene: Scene, seconds: float = 20.0) -> Comparison:
    """Race all layouts of a scene, prove its best by the exact driver, and hold the two against each other."""
    try:
        raced, proven = (_searched(scene, driver, seconds) for driver in ("enumeration", "exact"))
    except InputError as error:
        return Comparison(scene.name, None, None, f"refused: {error}")
    return Comparison(scene.name, raced, proven, _problem(raced, proven))


def _searched(scene: Scene, driver: str, seconds: float, jobs: int = 1) -> Exploration:
    with tempfile.TemporaryDirectory() as folder:
        return explore(scene, Path(folder) / "out", driver=driver, seconds=seconds, jobs=jobs, pictures=False)


def _problem(raced: Exploration, proven: Exploration) -> str:
    """Return how two searches disagree, "" for not at all."""
    for one, other in ((raced, proven), (proven, raced)):
        best, bound = one.summary.best, other.summary.bound
        if best is not None and bound is not None and best > bound + SLACK * abs(bound):
            return f"{one.summary.driver} found {best:.9g}, {other.summary.driver} bounds all by {bound:.9g}"
    if raced.summary.bound is not None and raced.summary.bound < 0.0 <= (proven.summary.best or -1.0):
        return "one search finds a layout that stands, the other proves that none does"
    check = proven.summary.facts.get("proof_check")
    if check is not None and not check["passed"]:
        return f"the proof did not pass its check: {check['problem']}"
    both = raced.results.merge(proven.results, on="labelling", suffixes=("", "_exact"))
    for low, high in (("bracket_lo", "bracket_hi_exact"), ("bracket_lo_exact", "bracket_hi")):
        wrong = both[both[low] > both[high] + SLACK * both[high].abs()]
        if len(wrong):
            return f"{len(wrong)} layouts have brackets that do not overlap"
    return ""


def random_part(count: int, seconds: float) -> str:
    """Compare searches of random scenes, none begun after some seconds by the clock."""
    rows, sizes = [], []
    ended = decided = disagreed = refused = 0
    start, began = time.process_time(), time.perf_counter()
    for seed in range(count):
        if time.perf_counter() - began > seconds:
            break
        found = compare(random_scene(seed))
        print(f"{found.name}: {found.problem or 'agree'}", flush=True)
        if found.raced is None or found.proven is None:
            refused += 1
            continue
        ended += 1
        sizes.append(len(found.raced.results))
        decided += bool(found.proven.summary.facts["race"]["decided"])
        disagreed += bool(found.problem)
        if found.problem:
            rows.append([found.name, found.problem])
    spent = time.process_time() - start
    text = (
        f"{ended} random scenes of {min(sizes)} to {max(sizes)} layouts ({refused} more were refused by the builder "
        f"or have none): {disagreed} disagreements. The exact driver ended within its gap of {WIDE:.0%} in {decided}. "
        f"{spent:.0f} s of one processor for both searches."
    )
    return text + ("\n\n" + table(["scene", "disagreement"], rows) if rows else "")


def _processor_time() -> float:
    """Seconds of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def flagship() -> Scene:
    """The beam on bearings, whose blocks crack anywhere. It takes the place of its version with halved cells: fields
    let blocks crack off the grid, and their labellings are still those of the faces of the grid."""
    return load_scene(ROOT / "scenes" / "flat_beam_arch.json").model_copy(
        update={"cracks": FieldCracks(kind="fields", gap=GAP)}
    )


def proofs_part(seconds: float, jobs: int, scenes: dict[str, Scene]) -> str:
    """Prove scenes to the gap, each within a time by the clock."""
    rows = []
    for name, scene in scenes.items():
        before = _processor_time()
        done = _searched(scene, "exact", seconds, jobs)
        facts = done.summary.facts
        rows.append(
            [
                name,
                "none stands" if facts["best"] is None else f"{facts['best']:.4f}",
                "–" if facts["bound"] is None else f"{facts['bound']:.4f}",
                "–" if facts["gap"] is None else f"{facts['gap']:.1%}",
                facts["stop_reason"],
                str(facts["conflicts"]),
                str(facts["relaxations"]),
                str(facts["evaluated"]),
                f"{facts['seconds']:.0f}",
                f"{_processor_time() - before:.0f}",
            ]
        )
    head = [
        "scene",
        "best, at least",
        "none more than",
        "gap",
        "ended",
        "conflicts",
        "programs",
        "evaluated",
        "s",
        "CPU, s",
    ]
    return table(head, rows)


def main() -> None:
    """Run both parts and write benchmarks/results/fields_search.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--random-seconds", type=float, default=1800.0)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--walls", nargs="*", default=list(WALLS))
    parser.add_argument("--flagship", action="store_true", help="prove the flagship alone")
    given = parser.parse_args()
    clock = f"Gap {GAP:.0%}, {given.seconds:.0f} s by the clock at most, {given.jobs} jobs. "
    clock += f"Load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    if given.flagship:
        text = str(flagship.__doc__).replace("\n    ", " ")
        found = proofs_part(given.seconds, given.jobs, {"beam on bearings (flagship)": flagship()})
        write("fields_flagship", "\n\n".join(["# The flagship by fields", text, found, clock]))
        return
    head = ["# The exact driver by fields", about(__doc__), "## Against the race of all layouts"]
    parts = [*head, random_part(given.scenes, given.random_seconds)]
    write("fields_search", "\n\n".join(parts))
    note = (
        f"Cells of 0.4 × 0.2 m, 0.2 m thick, 2000 kg/m³, μ = 0.75, σt = τ, horizontal body load, gap {GAP:.0%}; "
        f"{given.seconds:.0f} s by the clock at most, {given.jobs} jobs. CPU: seconds of all processes; other work on "
        "the machine takes the rest. A bound below 0: every layout falls by itself."
    )
    walls = {name: wall(*WALLS[name]) for name in given.walls}
    parts += ["## Walls", proofs_part(given.seconds, given.jobs, walls), note]
    write("fields_search", "\n\n".join(parts))


if __name__ == "__main__":
    main()
