"""How soon each driver finds the best labelling and the front: `python -m benchmarks.drivers [--full]`.

On scenes small enough to enumerate, λ is read from the enumerated table, so that thousands of runs are cheap;
on larger ones every labelling is solved, with equal budgets. Writes tables (CSV and Markdown) and pictures into
`benchmarks/results/`. Without --full only the two smaller scenes, fewer evaluations and three seeds.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core.assembly import Assembly, Bits, Bools, Floats
from jld_core.build import build_assembly
from jld_core.plotting import save_figure
from jld_core.scene import load_scene, parse_scene
from jld_core.solvers.status import Status
from jld_explore.candidates import SearchSpace, search_space
from jld_explore.constraints import counts
from jld_explore.drivers import make_driver
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.evaluator import Evaluation, Evaluator, EvaluatorSettings
from jld_explore.labelling import keys
from jld_explore.pareto import on_front
from jld_explore.plotting import plot_convergence

ROOT: Final = Path(__file__).resolve().parent
RESULTS: Final = ROOT / "results"
FLAGSHIP: Final = ROOT.parent / "scenes" / "flat_beam_arch.json"
CHECKPOINTS: Final = (100, 1_000, 10_000)
DRIVERS: Final = ("random", "hillclimb", "genetic")
SAMPLERS: Final = ("Random", "NSGAII", "TPE")
SAME: Final = 1e-6
"""Relative difference below which two load factors are one: the width their brackets are allowed."""


@dataclass(frozen=True)
class Known:
    """A scene of which everything is known.

    table: class → evaluation. best: largest λ. front: classes on the front of λ against dry faces.
    """

    name: str
    space: SearchSpace
    table: dict[bytes, Evaluation]
    best: float
    front: frozenset[bytes]


def grid(rows: list[str], cells: list[int], live: list[dict[str, Any]], **inner: float) -> dict[str, Any]:
    """A scene of 0.1 m cells with the flagship's materials, or other strengths of the inner faces."""
    return {
        "name": " ".join(rows),
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": {
            "density": 1400,
            "dry": {"friction_angle": 30},
            "inner": {"tensile_strength": 2e6, "shear_strength": 2e5, **inner},
        },
        "loads": {"live": live},
        "search": {"block_cells": cells},
    }


def middle(*columns: int) -> list[dict[str, Any]]:
    """Equal loads on the top of some columns."""
    return [{"element": f"c{column}r0", "force": [0, -1]} for column in columns]


SCENES: Final[dict[str, Callable[[], tuple[Assembly, SearchSpace]]]] = {
    "flagship": lambda: _read(load_scene(FLAGSHIP)),
    "bridge 7x3": lambda: _read(parse_scene(grid(["a" * 7] * 3 + ["##...##"], [3, 6], middle(2, 3, 4)))),
    # a wall pushed at its top left corner: no symmetry, and a best that is no sliding of the whole
    "wall 6x4": lambda: _read(
        parse_scene(grid(["a" * 6] * 4 + ["##..##"], [2, 3], [{"element": "c1r0", "force": [1, -2]}]))
    ),
}


def _read(scene: Any) -> tuple[Assembly, SearchSpace]:
    assembly = build_assembly(scene)
    return assembly, search_space(scene, assembly)


def known(name: str) -> Known:
    """Enumerate a scene and solve all its classes (a minute for 40 000)."""
    assembly, space = SCENES[name]()
    solver = Evaluator(assembly, EvaluatorSettings())
    rows = np.concatenate([rows for rows, _ in Enumeration(space).batches()])
    table = {key: solver.evaluate(labels) for key, labels in zip(keys(rows), rows, strict=True)}
    values = load_factors(list(table.values()))
    front = on_front(values, counts(assembly, rows, space.graph).dry_faces.astype(float), "max")
    return Known(name, space, table, float(np.nanmax(values)), frozenset(np.array(list(table))[front].tolist()))


def load_factors(evaluations: list[Evaluation]) -> Floats:
    """λ of those that collapse, NaN for all others."""
    return np.array([e.load_factor if e.status is Status.COLLAPSE else np.nan for e in evaluations])


def driver_of(name: str, space: SearchSpace, seed: int) -> Driver:
    """A driver, or "optuna:SAMPLER"."""
    name, _, sampler = name.partition(":")
    return make_driver(name, space, seed, **({"sampler": sampler} if sampler else {}))


@dataclass(frozen=True)
class Run:
    """What one run asked, in order. overhead: seconds of the driver, for all of it."""

    asked: list[bytes]
    values: Floats
    overhead: float


def search(driver: Driver, evaluate: Callable[[bytes, Bits], Evaluation], budget: int) -> Run:
    """Ask and tell up to a budget; the driver's own processor time is taken apart from that of evaluation."""
    asked: list[bytes] = []
    values: list[Floats] = []
    overhead = 0.0
    while len(asked) < budget:
        start = time.process_time()
        rows = driver.ask(budget - len(asked))
        overhead += time.process_time() - start
        if not len(rows):
            break
        named = keys(rows)
        evaluations = [evaluate(key, labels) for key, labels in zip(named, rows, strict=True)]
        start = time.process_time()
        driver.tell(rows, evaluations)
        overhead += time.process_time() - start
        asked += named
        values.append(load_factors(evaluations))
    return Run(asked, np.concatenate(values) if values else np.empty(0), overhead)


def judge(scene: Known, name: str, seeds: int, budget: int) -> list[dict[str, Any]]:
    """Rows of the table: one for each seed and number of evaluations."""
    found = []
    for seed in range(seeds):
        run = search(driver_of(name, scene.space, seed), lambda key, _: scene.table[key], budget)
        hit = np.flatnonzero(run.values >= scene.best - SAME * abs(scene.best))
        for evaluations in CHECKPOINTS:
            if evaluations > budget:
                break
            seen = run.asked[:evaluations]
            gap = 1.0 - np.nanmax(run.values[:evaluations], initial=0.0) / scene.best
            found.append(
                {
                    "scene": scene.name,
                    "driver": name,
                    "seed": seed,
                    "evaluations": evaluations,
                    "front": len(scene.front.intersection(seen)) / len(scene.front),
                    "gap": max(0.0, float(gap)),
                    "first best": int(hit[0]) + 1 if len(hit) else None,
                    "ms per labelling": 1e3 * run.overhead / max(1, len(run.asked)),
                }
            )
    return found


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Median and worst over the seeds."""
    groups = rows.groupby(["scene", "driver", "evaluations"], sort=False)
    return groups.agg(
        seeds=("seed", "size"),
        front_median=("front", "median"),
        front_worst=("front", "min"),
        gap_median=("gap", "median"),
        gap_worst=("gap", "max"),
        best_found=("first best", "count"),
        best_median=("first best", "median"),
        best_latest=("first best", "max"),
        driver_ms=("ms per labelling", "median"),
    ).reset_index()


def target(rows: pd.DataFrame, scene: Known, name: str = "genetic") -> str:
    """In how many seeds a driver reaches the best within 5 % of the space or 500 evaluations."""
    within = max(500, len(scene.table) // 20)
    first = rows[(rows["scene"] == scene.name) & (rows["driver"] == name)].groupby("seed")["first best"].first()
    good = int((first <= within).sum())
    return f"{scene.name}: {name} at the best of {len(scene.table)} within {within} in {good} of {len(first)} seeds"


def converge(assembly: Assembly, space: SearchSpace, budget: int, names: list[str]) -> dict[str, pd.DataFrame]:
    """Best λ so far against solves and seconds, solver and driver together; every driver with one seed."""
    histories = {}
    for name in names:
        solver, start = Evaluator(assembly, EvaluatorSettings()), time.perf_counter()
        seconds: list[float] = []

        def evaluate(
            _: bytes, labels: Bits, solver: Evaluator = solver, seconds: list[float] = seconds, start: float = start
        ) -> Evaluation:
            found = solver.evaluate(labels)
            seconds.append(time.perf_counter() - start)
            return found

        run = search(driver_of(name, space, 0), evaluate, budget)
        best = np.fmax.accumulate(run.values)
        step: Bools = np.concatenate([[True], best[1:] > best[:-1]])
        step[-1] = True
        places = np.flatnonzero(step)
        histories[name] = pd.DataFrame(
            {"solves": places + 1, "seconds": np.array(seconds)[places], "best": best[places]}
        )
    return histories


def large() -> dict[str, tuple[Assembly, SearchSpace]]:
    """Grids beyond enumeration: 88 and 278 planar faces, and 3×3×3 cubes."""
    weak = {"tensile_strength": 2e4, "shear_strength": 2e4}
    cells = [(x, y, z) for z in range(3) for y in range(3) for x in range(3)]
    cube = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    sides = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    elements: list[dict[str, Any]] = [
        {"id": f"c{x}{y}{z}", "vertices": (0.1 * np.add(cube, [x, y, z])).tolist(), "faces": sides} for x, y, z in cells
    ]
    base = (np.array(cube) * [0.3, 0.3, 0.1] - [0.0, 0.0, 0.1]).tolist()
    elements.append({"id": "base", "vertices": base, "faces": sides, "support": True})
    spatial = grid([], [2, 6], [{"element": "c002", "force": [1, 0.3, 0]}], **weak)
    del spatial["grid"]
    spatial |= {"name": "cubes 3x3x3", "elements": elements}
    return {
        "planar 88 faces": _read(parse_scene(grid(["a" * 8] * 6 + ["###..###"], [2, 6], middle(3, 4)))),
        "planar 278 faces": _read(
            parse_scene(grid(["a" * 15] * 10 + ["#......#......#"], [2, 6], middle(3, 4, 10, 11)))
        ),
        "spatial 3x3x3": _read(parse_scene(spatial)),
    }


def main(arguments: list[str] | None = None) -> None:
    """Run what was asked for and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="three scenes, 10 seeds, up to 10 000 evaluations")
    parser.add_argument("--scenes", nargs="*", choices=list(SCENES), help="these enumerated scenes, or none")
    parser.add_argument("--curves", type=int, default=300, help="evaluations of the convergence curves; 0: none")
    asked = parser.parse_args(arguments)
    RESULTS.mkdir(exist_ok=True)
    seeds, budget = (10, CHECKPOINTS[-1]) if asked.full else (3, 1_000)
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    chosen = list(SCENES)[: 3 if asked.full else 2] if asked.scenes is None else asked.scenes
    for name in chosen:
        scene = known(name)
        for driver in DRIVERS:
            rows += judge(scene, driver, seeds, budget)
        for sampler in SAMPLERS:
            slow = sampler == "TPE"  # half a second for each trial
            rows += judge(scene, f"optuna:{sampler}", 1 if slow else min(seeds, 3), 100 if slow else 1_000)
        lines.append(target(pd.DataFrame(rows), scene))
        sys.stderr.write(lines[-1] + "\n")
    if rows:
        table = summarise(pd.DataFrame(rows))
        pd.DataFrame(rows).to_csv(RESULTS / "drivers_runs.csv", index=False, float_format="%.6g")
        table.to_csv(RESULTS / "drivers.csv", index=False, float_format="%.6g")
        (RESULTS / "drivers.md").write_text("\n".join([*lines, "", markdown(table), ""]), encoding="utf-8")
    if asked.curves:
        names = [*DRIVERS, "optuna:NSGAII"]
        for name, (assembly, space) in large().items():
            histories = converge(assembly, space, asked.curves, names)
            stem = "convergence_" + name.replace(" ", "_")
            save_figure(plot_convergence(histories), RESULTS / f"{stem}.png")
            parts = [history.assign(driver=driver) for driver, history in histories.items()]
            pd.concat(parts).to_csv(RESULTS / f"{stem}.csv", index=False, float_format="%.6g")


def markdown(table: pd.DataFrame) -> str:
    """A table as Markdown, numbers with four digits."""

    def shown(value: Any) -> str:
        return "" if pd.isna(value) else f"{value:.4g}" if isinstance(value, float) else str(value)

    body = [[shown(value) for value in row] for row in table.to_numpy(dtype=object)]
    lines = [list(table.columns), ["---"] * len(table.columns), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


if __name__ == "__main__":
    main()
