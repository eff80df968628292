"""The exact driver's relaxations in the kernel's lanes, and one at a time: the same ones in one run, and their verdicts.

Asked for as the driver does, by shrinking labellings that are too weak at a threshold, until enough are collected. In
lanes: 32 at a time, with everything it takes to trust one: the kernel, its motion weighed by the core's own support
functions, and the other route for what the kernel leaves open. The kernel alone stands beside it. One at a time: by
Clarabel, as without a kernel, and by HiGHS where the rows are linear, each weighed alike. Processor time, the best of
three turns; a verdict is whether the threshold is refuted.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.exact import wall
from benchmarks.search_scenes import ENUMERATED, LARGE
from jld_core import Scene, build_assembly
from jld_core.arrays import Bits, Bools, Floats
from jld_core.lanes import described
from jld_core.limit import LimitAnalysis, Relaxation
from jld_core.solvers import make_solver
from jld_explore.drivers import Formula, possible_blocks
from jld_explore.drivers.exact.hunting import Hunt
from jld_explore.space import search_space

CASES: Final[dict[str, tuple[Scene, float]]] = {
    "wall 6 × 8, s = 3, 20 kPa": (wall(6, 8, 3, 2e4), 0.7164),
    "wall 5 × 7, s = 3, 5 kPa": (wall(5, 7, 3, 5e3), 0.6495),
    "wall 8 × 10, s = 3, 20 kPa": (wall(8, 10, 3, 2e4), 0.70),
    "flagship, 24 faces": (ENUMERATED["flagship"](), 12.7),
    "cubes 3 × 3 × 3": (LARGE["spatial 3x3x3"](), 62.0),
}
"""Scene and threshold on λ."""

COUNT: Final = 1_500
ALONE: Final = 300
"""Relaxations collected, and how many of them are solved one at a time as well."""

TOGETHER: Final = 32


@dataclass(frozen=True)
class Asked:
    """Labellings and undecided faces (k, m), thresholds (k,)."""

    labels: Bits
    undecided: Bools
    thresholds: Floats


def collected(scene: Scene, load: float) -> tuple[Relaxation, Asked]:
    """What a driver asks of a scene."""
    assembly = build_assembly(scene)
    space, relaxation = search_space(scene, assembly), Relaxation(LimitAnalysis(assembly))
    parts: list[tuple[Bits, Bools, Floats]] = []
    refute = relaxation.refute_all

    def listening(labels: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None) -> object:
        parts.append((labels, undecided, thresholds))
        return refute(labels, undecided, thresholds, thorough)

    formula = Formula(space, possible_blocks(space))
    hunt = Hunt(relaxation, space.candidates, 0)
    hunt.begin(formula)
    with patch.object(relaxation, "refute_all", listening):
        while sum(len(part[0]) for part in parts) < COUNT:
            if hunt.step(load / relaxation.template.scaling.load).exhausted:
                break
    formula.close()
    return relaxation, Asked(*(np.concatenate(column)[:COUNT] for column in zip(*parts, strict=True)))


def timed(relaxation: Relaxation, asked: Asked, rows: slice, kernel_alone: bool = False) -> tuple[float, list[bool]]:
    """Seconds of the processor for each relaxation, the best of three turns, and what was refuted."""
    best, refuted = np.inf, []
    count = len(asked.labels[rows])
    for _ in range(3):
        start, refuted = time.process_time(), []
        for low in range(0, count, TOGETHER):
            part = slice(low, min(low + TOGETHER, count))
            given = [column[rows][part] for column in (asked.labels, asked.undecided, asked.thresholds)]
            if kernel_alone:
                assert relaxation._lanes is not None
                relaxation._lanes.solve(given[0], undecided=given[1], thresholds=given[2], vectors=True)
            else:
                refuted += [one is not None for one in relaxation.refute_all(*given)]
        best = min(best, (time.process_time() - start) / count)
    return best, refuted


def measured(scene: Scene, load: float) -> list[str]:
    """A row of the table."""
    relaxation, asked = collected(scene, load)
    some, every = slice(0, ALONE), slice(0, None)
    lanes, together = timed(relaxation, asked, every)
    alone, _ = timed(relaxation, asked, every, kernel_alone=True)
    cells = [str(len(asked.labels)), f"{np.mean(together):.0%}", f"{1e6 * alone:.0f}", f"{1e6 * lanes:.0f}"]
    with patch.object(relaxation, "_lanes", None):
        clarabel, one_by_one = timed(relaxation, asked, some)
        highs, other = np.nan, one_by_one
        if not relaxation.template.structure.cones:
            with patch.object(relaxation, "_route", make_solver("highs")):
                highs, other = timed(relaxation, asked, some)
    same = sum(a == b for a, b in zip(together, one_by_one, strict=False))
    less = sum(b and not a for a, b in zip(together, one_by_one, strict=False))
    cells += [f"{1e6 * clarabel:.0f}", "" if np.isnan(highs) else f"{1e6 * highs:.0f}", f"{clarabel / alone:.0f}"]
    cells += [f"**{clarabel / lanes:.0f}**", f"{same} of {len(one_by_one)}", str(less)]
    return [*cells, f"{sum(a == b for a, b in zip(together, other, strict=False))} of {len(other)}"]


def main() -> None:
    """Measure all cases and write benchmarks/results/relaxing.md."""
    rows = []
    for name, (scene, load) in CASES.items():
        rows.append([name, *measured(scene, load)])
        print(rows[-1], flush=True)
    head = ["scene", "relaxations", "refuted", "kernel alone, µs", "in lanes, all in, µs", "Clarabel, µs", "HiGHS, µs"]
    head += ["times, kernel alone", "times, all in", "same verdict as Clarabel", "refuted by Clarabel alone"]
    head += ["same as HiGHS"]
    text = ["# Relaxations in lanes", about(__doc__), table(head, rows), f"{described().capitalize()}."]
    write("relaxing", "\n\n".join(text))


if __name__ == "__main__":
    main()
