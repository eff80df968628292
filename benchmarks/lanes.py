"""Labellings in lanes: the batch solver, with all that it leaves open, beside one labelling at a time and the plain
way.

Today's way and the batch solver evaluate the same labellings in turns in one process, by processor time; the batch
solver's time
holds the tries it needs and the ladder for what it leaves open. Ratios are medians of three turns. Plain: CVXPY with
the program stated anew for each labelling (benchmarks/stated.py). Scenes below the line were not looked at while
settings were chosen.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks import growth
from benchmarks.common import random_segmentations, table, wall, write
from benchmarks.lanes_hard import corner_of_studies, cubes, prisms
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from benchmarks.stated import stated
from jld_core import build_assembly, parse_scene
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch.library import described
from jld_core.limit import BatchAnalysis, LimitAnalysis, Status, load_scale
from jld_explore.drivers import make_driver
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.evaluator import Evaluator
from jld_explore.space import search_space

TURNS: Final = 3
MANY: Final = 1024
"""Labellings of a turn of the batch solver."""


@dataclass(frozen=True)
class Case:
    """A scene and its labellings (k, m); one: how many of them one at a time in a turn; plain: how many plainly."""

    assembly: Assembly
    labellings: Bits
    one: int
    plain: int


def drawn(name: str, one: int, plain: int = 6, driver: str = "random", many: int = MANY) -> Case:
    """Segmentations that a driver asks first of a scene that searches are measured on."""
    assembly, space = built((ENUMERATED | LARGE)[name]())
    source = make_driver(driver, space, 0)
    found = np.zeros((0, len(assembly.interfaces)), dtype=bool)
    while len(found) < many:
        found = np.concatenate([found, source.ask(many)])
    return Case(assembly, found[:many], one, plain)


def walled(edge: int, one: int, many: int, plain: int = 1) -> Case:
    """Layouts of a square wall of benchmarks/growth.py in blocks of up to four cells, from the random driver."""
    scene = parse_scene(growth.document("planar", edge))
    assembly = build_assembly(scene)
    source = make_driver("random", search_space(scene, assembly), 0)
    found = np.concatenate([source.ask(many) for _ in range(3)])[:many]
    return Case(assembly, found, one, plain)


def segmented(assembly: Assembly, one: int, many: int = MANY, plain: int = 6) -> Case:
    """Random segmentations of any assembly."""
    return Case(assembly, random_segmentations(assembly, many, seed=7), one, plain)


CASES: Final[dict[str, Callable[[], Case]]] = {
    "24 faces, flagship": lambda: drawn("flagship", 150),
    "88 faces": lambda: drawn("planar 88 faces", 60),
    "278 faces": lambda: drawn("planar 278 faces", 20, 4),
    "946 faces": lambda: walled(22, 4, 128),
    "2 016 faces": lambda: walled(32, 2, 64),
    "3 × 3 × 3 cubes": lambda: drawn("spatial 3x3x3", 20, 4, many=512),
    "corner of the studies, 225°": lambda: segmented(corner_of_studies(), 20, 512, 4),
    "4 × 4 × 4 cubes": lambda: segmented(cubes(4, 2e4), 4, 128, 2),
}
HELD_OUT: Final[dict[str, Callable[[], Case]]] = {
    "wall 6 × 8, 2 MPa": lambda: segmented(wall(6, 8), 40),
    "wall 6 × 8, 20 kPa": lambda: segmented(wall(6, 8, 2e4, 2e4), 40),
    "wall 6 × 8, 2 kPa": lambda: segmented(wall(6, 8, 2e3, 2e3), 40),
    "wall 4 × 4, 200 Pa": lambda: segmented(wall(4, 4, 2e2, 2e2), 80),
    "bridge 7 × 3": lambda: drawn("bridge 7x3", 100),
    "hexagonal prisms": lambda: segmented(prisms(6, 4, 4), 20, 512, 4),
}


def measure(name: str, case: Case) -> list[str]:
    """One row of the table."""
    assembly, labellings = case.assembly, case.labellings
    evaluator = Evaluator(assembly, EvaluatorSettings())
    analysis = LimitAnalysis(assembly)
    batch = BatchAnalysis.of(analysis)
    if batch is None:
        raise SystemExit(f"{name}: no kernel is in use, or the scene does not fit it")
    evaluator.evaluate_all(labellings[:64])
    evaluator.evaluate(labellings[0])
    ratios, singles, alls, differ, same = [], [], [], 0.0, 0
    for turn in range(TURNS):
        chosen = labellings[turn * case.one : (turn + 1) * case.one]
        start = time.process_time()
        known = [evaluator.evaluate(labels) for labels in chosen]
        single = (time.process_time() - start) / len(chosen)
        start = time.process_time()
        found = evaluator.evaluate_all(labellings)
        together = (time.process_time() - start) / len(labellings)
        ratios.append(single / together)
        singles.append(single)
        alls.append(together)
        for one, other in zip(known, found[turn * case.one :], strict=False):
            same += one.status is other.status
            if one.status is other.status is Status.COLLAPSE:
                size = max(abs(one.load_factor), load_scale(assembly))
                differ = max(differ, abs(one.load_factor - other.load_factor) / size)
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inaccurate answers, which are among what it costs
        for labels in labellings[: case.plain]:
            try:
                stated(assembly, labels)
            except Exception:  # an unstable labelling may be a solver's failure
                continue
    plain = (time.process_time() - start) / case.plain
    raw = batch.batch.solve(labellings)
    settled = batch.prove(labellings)
    bracket = settled.settled & ~settled.falls & ~settled.locked
    sizes = np.maximum(abs(settled.low), analysis.load_scale)
    width = ((settled.high - settled.low) / sizes)[bracket]
    spread = " / ".join(f"{value:.0e}" for value in np.quantile(width, [0.5, 0.99, 1.0])) if width.size else "–"
    return [
        name,
        str(len(assembly.interfaces)),
        f"{1e3 * plain:.1f}",
        f"{1e3 * np.median(singles):.2f}",
        f"{1e6 * np.median(alls):.1f}",
        f"**{np.median(ratios):.0f}**",
        f"{plain / np.median(alls):.0f}",
        f"{100.0 * (raw.tries == 1).mean():.1f}",
        f"{100.0 * (~settled.settled).mean():.2f}",
        f"{raw.iterations.mean():.1f}",
        spread,
        f"{same} of {TURNS * case.one}",
        f"{differ:.0e}",
    ]


def main(wanted: Sequence[str] = ()) -> None:
    """Measure scenes; write benchmarks/results/lanes.md if all are measured, else print their rows.

    wanted: names of scenes; empty for all.
    """
    head = ["scene", "faces", "plain, ms", "one at a time, ms", "in lanes, all in, µs", "times", "times plain"]
    head += ["first try, %", "left open, %", "iterations", "bracket: median / 99 % / worst", "same status"]
    head += ["λ differs by, relative, at most"]
    if wanted:
        print(table(head, [measure(name, (CASES | HELD_OUT)[name]()) for name in wanted]))
        return
    rows = [measure(name, make()) for name, make in CASES.items()]
    rows.append(["**held out**", *[""] * (len(head) - 1)])
    rows += [measure(name, make()) for name, make in HELD_OUT.items()]
    text = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    parts = ["# Labellings in lanes", text, table(head, rows), f"{described().capitalize()}."]
    write("lanes", "\n\n".join(parts))


if __name__ == "__main__":
    main(sys.argv[1:])
