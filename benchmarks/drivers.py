"""How soon each driver finds the best labelling and the front, on scenes small enough to enumerate.

λ is read from the enumerated table, so that thousands of runs are cheap. `python -m benchmarks.drivers` writes tables
(CSV and Markdown) into `benchmarks/results/`.
"""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmarks.common import RESULTS
from benchmarks.scenes import ENUMERATED, built
from jld_core.arrays import Bits, Floats
from jld_core.errors import InputError
from jld_core.limit.options import Status
from jld_explore.drivers import make_driver
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.report.tables import on_front
from jld_explore.space import keys
from jld_explore.space.counts import counts
from jld_explore.space.search_space import SearchSpace

CHECKPOINTS: Final = (100, 1_000, 10_000)
DRIVERS: Final = ("random", "hillclimb", "genetic", "genetic:best")
SEEDS: Final = 10
SAMPLERS: Final = {"Random": (3, 1_000), "NSGAII": (1, 1_000), "TPE": (1, 100), "GP": (1, 100)}
"""Seeds and evaluations that are affordable: a trial takes NSGA-II 20 ms, TPE half a second once it has seen many."""

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


def known(name: str) -> Known:
    """Enumerate a scene and solve all its classes (seconds in the batch solver)."""
    assembly, space = built(ENUMERATED[name]())
    solver = Evaluator(assembly, EvaluatorSettings())
    rows = np.concatenate([rows for rows, _ in Enumeration(space).batches()])
    table = dict(zip(keys(rows), solver.evaluate_all(rows), strict=True))
    values = load_factors(list(table.values()))
    front = on_front(values, counts(assembly, rows, space.graph)["dry_faces"].astype(float), "max")
    return Known(name, space, table, float(np.nanmax(values)), frozenset(np.array(list(table))[front].tolist()))


def load_factors(evaluations: list[Evaluation]) -> Floats:
    """λ of those that collapse, NaN for all others."""
    return np.array([e.load_factor if e.status is Status.COLLAPSE else np.nan for e in evaluations])


def driver_of(name: str, space: SearchSpace, seed: int) -> Driver:
    """A driver, "genetic:AIM" or "optuna:SAMPLER". Raises InputError for a sampler that lacks its package."""
    name, _, option = name.partition(":")
    key = "aim" if name == "genetic" else "sampler"
    return make_driver(name, space, seed, **({key: option} if option else {}))


@dataclass(frozen=True)
class Run:
    """What one run asked, in order. overhead: seconds of the driver, for all of it."""

    asked: list[bytes]
    values: Floats
    overhead: float


def search(
    driver: Driver, evaluate: Callable[[bytes, Bits], Evaluation], budget: int, patience: float = math.inf
) -> Run:
    """Ask and tell up to a budget; the driver's own processor time is taken apart from that of evaluation.

    patience: seconds of the driver's own after which it is not asked any more.
    """
    asked: list[bytes] = []
    values: list[Floats] = []
    waiting: deque[Bits] = deque()
    overhead, ended, count = 0.0, False, 0
    while True:
        start = time.process_time()
        while not ended and len(waiting) <= driver.ahead and count < budget:  # as a study asks
            rows = driver.ask(budget - count)
            ended = not len(rows) or overhead + time.process_time() - start > patience
            count += len(rows)
            if len(rows):
                waiting.append(rows)
        overhead += time.process_time() - start
        if not waiting:
            break
        rows = waiting.popleft()
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


def target(rows: pd.DataFrame, scene: Known, name: str) -> str:
    """In how many seeds a driver reaches the best within 5 % of the space or 500 evaluations."""
    within = max(500, len(scene.table) // 20)
    first = rows[(rows["scene"] == scene.name) & (rows["driver"] == name)].groupby("seed")["first best"].first()
    good = int((first <= within).sum())
    return f"{scene.name}: {name} at the best of {len(scene.table)} within {within} in {good} of {len(first)} seeds"


def main() -> None:
    """Run all drivers on all scenes, and write the tables."""
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    lacking: dict[str, None] = {}
    for name in ENUMERATED:
        scene = known(name)
        for driver in DRIVERS:
            rows += judge(scene, driver, SEEDS, CHECKPOINTS[-1])
        for sampler, (seeds, evaluations) in SAMPLERS.items():
            try:
                rows += judge(scene, f"optuna:{sampler}", seeds, evaluations)
            except InputError as error:
                lacking[f"Not measured: {error}."] = None
        lines += [target(pd.DataFrame(rows), scene, driver) for driver in DRIVERS if "genetic" in driver]
        sys.stderr.write("\n".join(lines[-2:]) + "\n")
    table = summarise(pd.DataFrame(rows))
    pd.DataFrame(rows).to_csv(RESULTS / "drivers_runs.csv", index=False, float_format="%.6g")
    table.to_csv(RESULTS / "drivers.csv", index=False, float_format="%.6g")
    text = ["# What drivers find", *(f"- {line}" for line in lines), *lacking, markdown(table)]
    (RESULTS / "drivers.md").write_text("\n\n".join(text) + "\n", encoding="utf-8")


def markdown(table: pd.DataFrame) -> str:
    """A table as Markdown, numbers with four digits."""

    def shown(value: Any) -> str:
        return "" if pd.isna(value) else f"{value:.4g}" if isinstance(value, float) else str(value)

    body = [[shown(value) for value in row] for row in table.to_numpy(dtype=object)]
    lines = [list(table.columns), ["---"] * len(table.columns), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


if __name__ == "__main__":
    main()
