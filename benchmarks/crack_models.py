"""How much λ depends on the cracks that are allowed: own faces, halved and quartered cells, and fields.

Flagship: layouts of the full enumeration by their place in it, and one uncut block. Walls: the best layout of the exact
search with blocks of at most three cells; an upper bound below 0 means that the blocks fall under their own weight.
Fields: uniform meshes of 60, 240, 540 and 960 triangles. In brackets stands the value of an independent trial by a
modelling language, where it has one; the last line names the largest difference; its 540
triangles divide cells otherwise.
"""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from studies.crack_models import HALVES, QUARTERS, Cells, by_cells, finer, value, wall

from benchmarks.common import ROOT, about, table, write
from jld_core import Assembly, Scene, build_assembly, load_scene, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string

TRIAL: Final[dict[int, tuple[float, ...]]] = {
    0: (11.8764, 11.8764, 11.8764, 7.28, 7.81, 8.02, 8.12, 9.18, 8.80, 8.67, 8.59),
    1: (12.6222, 11.8970, 11.8867, 5.06, 5.73, 5.90, math.nan, 7.16, 6.80, 6.68, 6.63),
    2: (12.4825, 11.9176, 11.8970, 4.32, 5.33, 5.55, math.nan, 7.16, 6.65, 6.50, 6.41),
    9: (11.9898, 11.2647, 11.2544, 4.40, 5.49, 5.74, math.nan, 7.16, 6.74, 6.59, 6.52),
    31: (11.8764, 11.8764, 11.8764, 4.72, 5.89, 6.06, math.nan, 7.16, 6.84, 6.69, 6.67),
    201: (9.9716, 9.9725, 9.9657, 2.73, 4.10, 4.27, math.nan, 5.79, 5.46, 5.30, 5.17),
    1001: (7.9333, math.nan, math.nan, 2.64, 4.05, math.nan, math.nan, 5.84, 5.21, 5.14, 5.04),
    2001: (5.2738, 5.2715, 5.2704, 3.20, 3.87, math.nan, math.nan, 4.93, 4.59, 4.50, 4.47),
}
"""Values of the trial by place in the enumeration, 0 for the uncut block: λ by own faces, cells / 2, cells / 4, fields
lower and upper on 60, 240, 540 and 960 triangles."""
WALLS: Final = ((4, 6, 5e3), (5, 7, 5e3), (6, 8, 20e3))
"""Rows, columns, and strength in Pa."""
THIRDS: Final = Cells("cells / 3", 3)


def flagship() -> tuple[list[list[str]], float]:
    """Rows of the flagship's layouts, and the largest difference from the trial."""
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    with TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
        ranked = explore(scene, Path(folder) / "search", settings).results["labelling"].tolist()
    rows, worst = [], 0.0
    for place, known in TRIAL.items():
        labels = from_string(str(ranked[place - 1])) if place else ~assembly.free_faces
        found = [*_by_cells(scene, assembly, labels, (HALVES, QUARTERS)), *_by_fields(assembly, labels)]
        rows.append(["uncut" if place == 0 else str(place), *(_cell(*pair) for pair in zip(found, known, strict=True))])
        gaps = [abs(one / other - 1.0) for one, other in zip(found, known, strict=True) if math.isfinite(other)]
        worst = max(worst, *gaps)
    return rows, worst


def _cell(found: float, known: float) -> str:
    return f"{found:.5g}" + (f" ({known:.5g})" if math.isfinite(known) else "")


def _by_cells(scene: Scene, assembly: Assembly, labels: Bits, kinds: tuple[Cells, ...]) -> list[float]:
    """λ by own faces and by finer cells."""
    finer_ones = [by_cells(finer(scene, assembly, cells), labels) for cells in kinds]
    return [value(result) for result in (solve(assembly, labels), *finer_ones)]


def _by_fields(assembly: Assembly, labels: Bits) -> list[float]:
    """Lower bounds on four uniform meshes, then upper bounds."""
    refined = bounds_by_fields(assembly, labels, gap=1e-9, adaptive=False, most_triangles=960).history
    thirds = bounds_by_fields(assembly, labels, gap=1e-9, parts=3, most_triangles=1)
    found = sorted([*refined, *thirds.history], key=lambda step: step.triangles)
    return [one.lower for one in found] + [one.upper for one in found]


def walls() -> list[list[str]]:
    """Rows of the walls' best layouts."""
    rows = []
    for height, width, strength in WALLS:
        scene = wall(height, width, strength, {"block_cells": [1, 3]})
        assembly = build_assembly(scene)
        with TemporaryDirectory() as folder:
            settings = ExploreSettings(driver="exact", jobs=1, seconds=20.0, pictures=False, check_fields=0)
            done = explore(scene, Path(folder) / "search", settings)
        labels = from_string(str(done.results["labelling"].iloc[0]))
        cells = _by_cells(scene, assembly, labels, (HALVES, THIRDS, QUARTERS))
        found = bounds_by_fields(assembly, labels, gap=0.05, seconds=20.0)
        ends = ["none" if math.isinf(end) else f"{end:.4f}" for end in (found.lower, found.upper)]
        numbers = [*(f"{number:.4f}" for number in cells), *ends]
        proven = "proven" if done.summary.proven else "best found"
        rows.append([f"{height} × {width}, {strength / 1e3:g} kPa, {proven}", *numbers, str(found.triangles)])
    return rows


def main() -> None:
    """Solve all layouts and write benchmarks/results/crack_models.md."""
    rows, worst = flagship()
    counts = (60, 240, 540, 960)
    head = ["place", "own faces", "cells / 2", "cells / 4", *(f"≥, {n}" for n in counts), *(f"≤, {n}" for n in counts)]
    low = np.array([[float(cell.split()[0]) for cell in row[4:8]] for row in rows])
    high = np.array([[float(cell.split()[0]) for cell in row[8:]] for row in rows])
    if (low.max(axis=1) > high.min(axis=1)).any():
        raise AssertionError("a lower bound by fields is above an upper one")
    wide = ["wall", "own faces", "cells / 2", "cells / 3", "cells / 4", "fields ≥", "fields ≤", "triangles"]
    write(
        "crack_models",
        f"# λ by the cracks that are allowed\n\n{about(__doc__)}\n\n{table(head, rows)}\n\n"
        f"Largest difference from the trial: {100 * worst:.2f} %.\n\n{table(wide, walls())}",
    )


if __name__ == "__main__":
    main()
