"""Time against size: no size takes more than 1.6 times the next larger one.

Walls of n × n cells in blocks of two, and k × k × k cubes, under a horizontal body load. `solve`: λ of the layout as
drawn, from the assembly, the least of several runs. `explore`: 256 random layouts from the start to the page. Times are
processor seconds; ratio: to the next larger size; slope: of the logarithms, over all faces of a family.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, about, run_parts, table, write
from benchmarks.scenes import bonded, cubes, grid
from jld_core import Scene, build_assembly, solve
from jld_explore import explore
from jld_views.figures import save_figure

SIDES: Final = (10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 32, 36, 40)
"""Cells along a side of a wall."""
EDGES: Final = (3, 4, 5, 6, 7, 8, 9, 10)
"""Cubes along an edge of a stack."""
LAYOUTS: Final = 256
REPEATED: Final = 2.0
"""Processor seconds up to which a size is measured again."""
MOST: Final = 1.6
"""Largest ratio of the time of a size to that of the next larger one."""


def wall(side: int) -> Scene:
    """A wall of side × side cells in blocks of two on a row of supports."""
    return grid([*bonded(["a" * side] * side), "#" * side], search={"block_cells": [1, 6]})


def solved(scene: Scene) -> None:
    """λ of the layout as drawn."""
    solve(build_assembly(scene))


def explored(scene: Scene) -> None:
    """A study of random layouts, from the start to the page."""
    with tempfile.TemporaryDirectory() as folder:
        explore(scene, Path(folder) / "out", driver="random", budget=LAYOUTS, jobs=1)


def least_time(run: Callable[[Scene], None], scene: Scene) -> float:
    """Processor seconds, the least of as many runs as fit into `REPEATED`."""
    found: list[float] = []
    while not found or sum(found) < REPEATED:
        start = time.process_time()
        run(scene)
        found.append(time.process_time() - start)
    return min(found)


def curve(run: Callable[[Scene], None], name: str, make: Callable[[int], Scene], sizes: tuple[int, ...]) -> Curve:
    """Faces and times of one family of scenes by one command."""
    run(make(3))  # imports and kernels
    found = []
    for size in sizes:
        scene = make(size)
        found.append((size, len(build_assembly(scene).interfaces), least_time(run, scene)))
        print(name, *found[-1], flush=True)
    return Curve(name, found)


class Curve:
    """Times of one command on one family of scenes: name, and (size, faces, seconds) by size."""

    def __init__(self, name: str, found: list[tuple[int, int, float]]) -> None:
        self.name, self.found = name, found

    @property
    def ratios(self) -> list[float]:
        """Time of each size but the last over that of the next larger one."""
        return [a[2] / b[2] for a, b in zip(self.found, self.found[1:], strict=False)]

    @property
    def slope(self) -> float:
        """Slope of the logarithm of the time over that of the number of faces."""
        faces, seconds = (np.log([one[k] for one in self.found]) for k in (1, 2))
        return float(np.polyfit(faces, seconds, 1)[0])

    def rows(self) -> list[list[str]]:
        """Return the rows of a table."""
        ratios = [*(f"{r:.2f}" for r in self.ratios), ""]
        return [
            [self.name, str(size), str(faces), f"{seconds:.3g}", ratio]
            for (size, faces, seconds), ratio in zip(self.found, ratios, strict=True)
        ]


def draw(curves: list[Curve]) -> Figure:
    """Time against faces, one line for each curve."""
    figure = Figure(figsize=(7.0, 4.6), dpi=110, layout="constrained")
    ax = figure.add_subplot()
    for one in curves:
        ax.loglog([f[1] for f in one.found], [f[2] for f in one.found], "o-", label=f"{one.name}, {one.slope:.2f}")
    ax.set_xlabel("faces")
    ax.set_ylabel("processor time, s")
    ax.grid(True, color="0.92", lw=0.6)
    ax.legend(frameon=False, fontsize=9, title="slope of the logarithms")
    return figure


def measure(name: str, run: Callable[[Scene], None], sides: tuple[int, ...], edges: tuple[int, ...]) -> None:
    """Measure one command on both families, and write table and picture."""
    curves = [
        curve(run, f"{name}, wall", wall, sides),
        curve(run, f"{name}, cubes", lambda edge: cubes(edge), edges),
    ]
    worst = max(ratio for one in curves for ratio in one.ratios)
    slopes = ", ".join(f"{one.name} {one.slope:.2f}" for one in curves)
    save_figure(draw(curves), RESULTS / f"monotony_{name}.png")
    head = "family | size | faces | s | over the next larger"
    body = table(head, [row for one in curves for row in one.rows()])
    verdict = f"Largest ratio {worst:.2f} (at most {MOST}: {'yes' if worst <= MOST else 'no'}); slopes: {slopes}."
    assert math.isfinite(worst)
    write(f"monotony_{name}", f"# Time against size: {name}\n\n{about(__doc__)}\n\n{verdict}\n\n{body}")


if __name__ == "__main__":
    run_parts(
        solve=lambda: measure("solve", solved, SIDES, EDGES),
        explore=lambda: measure("explore", explored, SIDES[::2], EDGES[:5]),
    )
