"""What a cluster of many cores would do: a simulation from measured tasks.

Measured here: how long a task of labellings takes in a worker, and how long a scheduler of dask with workers on this
machine takes to hand out one that does nothing. Simulated: portions of labellings that a driver asks together, their
tasks handed out one after the other, each to the worker that is free first, the next portion when all are back; and
cubes of a proof, each lent for the same moment again and again, as long as there are enough of them.
"""

from __future__ import annotations

import heapq
import time
from typing import Any, Final

import distributed
import joblib
import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, random_segmentations, scene, table, wall, write
from jld_core import Assembly
from jld_core.arrays import Floats
from jld_core.views.figures import save_figure
from jld_explore.drivers.exact.cube_workers import MOMENT
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.workers import WorkerSpec, batch_size, evaluate_batch

WORKERS: Final = (1, 10, 100)
DRAWN: Final = (1, 2, 4, 8, 16, 32, 64, 100)
"""Cores in the picture."""

PORTIONS: Final = (64, 1024)
"""Labellings asked together: about a generation of a population, and what an enumeration asks."""

MOMENTS: Final = 4096
"""Moments that a proof is taken to last, at 0.3 s each: 20 minutes of one core."""

_IDLE: Final = 300
_TASKS: Final = 6


def nothing() -> int:
    """A task that does nothing."""
    return 0


def handing() -> float:
    """Seconds a scheduler takes for each of many tasks that do nothing."""
    library: Any = distributed  # without types of its own
    cluster = library.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, worker_dashboard_address=None
    )
    try:
        with library.Client(cluster), joblib.parallel_config(backend="dask"):
            parallel = joblib.Parallel(batch_size=1, return_as="generator_unordered")
            list(parallel(joblib.delayed(nothing)() for _ in range(20)))
            start = time.perf_counter()
            list(parallel(joblib.delayed(nothing)() for _ in range(_IDLE)))
            return (time.perf_counter() - start) / _IDLE
    finally:
        cluster.close()


def tasks(assembly: Assembly, portion: int) -> tuple[int, Floats]:
    """Labellings of a task, and seconds of some of them."""
    size = batch_size(len(assembly.interfaces), portion)
    rows = random_segmentations(assembly, size * _TASKS, seed=1)
    recipe = WorkerSpec.of(assembly, EvaluatorSettings())
    evaluate_batch(recipe, 0, rows[:1])  # makes the evaluator
    found = []
    for k in range(_TASKS):
        start = time.perf_counter()
        evaluate_batch(recipe, k, rows[k * size : (k + 1) * size])
        found.append(time.perf_counter() - start)
    return size, np.array(found)


def makespan(durations: Floats, workers: int, handed: float) -> float:
    """Seconds until all tasks are back."""
    free = [0.0] * workers
    last = 0.0
    for number, duration in enumerate(durations.tolist()):
        start = max(heapq.heappop(free), (number + 1) * handed)
        heapq.heappush(free, start + duration)
        last = max(last, start + duration)
    return last


def main() -> None:
    """Measure, simulate, write."""
    handed = handing()
    rng = np.random.default_rng(0)
    scenes = {
        "wall, 90 faces": wall(6, 8),
        "wall, 713 faces": wall(18, 20),
        "shelf in space, 23 faces": scene("spatial_shelf"),
    }
    rows = []
    gains: dict[str, list[float]] = {}

    def spend(durations: Floats, workers: int) -> float:
        return makespan(durations, workers, handed if workers > 1 else 0.0)

    for name, assembly in scenes.items():
        for portion in PORTIONS:
            size, measured = tasks(assembly, portion)
            durations = rng.choice(measured, -(-portion // size))
            spent = {w: spend(durations, w) for w in WORKERS}
            gains[f"{name}, {portion}"] = [spent[1] / spend(durations, w) for w in DRAWN]
            row = [name, str(portion), str(size), f"{1e3 * measured.mean():.1f}"]
            row += [f"{portion / spent[w]:.0f}" for w in WORKERS] + [f"{spent[1] / spent[100]:.1f}"]
            rows.append(row)
            print(row, flush=True)
    moments = np.full(MOMENTS, MOMENT)
    gains["cubes of a proof"] = [spend(moments, 1) / spend(moments, w) for w in DRAWN]
    picture(gains)
    head = ["scene", "asked together", "labellings a task", "ms a task"]
    head += [f"labellings a second, {w} core{'s' * (w > 1)}" for w in WORKERS] + ["gain of 100"]
    note = (
        f"Handing out a task: {1e3 * handed:.1f} ms, measured with two workers here; durations are drawn from "
        f"{_TASKS} measured tasks of each scene, the rest is simulated. One core: in this process, task by task."
    )
    proof = (
        f"Cubes of a proof are lent for {MOMENT:g} s at a time: 10 cores gain {gain_of(moments, 10, handed):.1f}, 100 "
        f"gain {gain_of(moments, 100, handed):.0f}, where there are cubes enough and conflicts found elsewhere at the "
        "same time are worth as much as those found one after the other; neither is measured beyond two cores."
    )
    parts = ("# What a hundred cores would do", table(head, rows), note, proof, "![gain](machines.png)")
    write("machines", "\n\n".join(parts))


def gain_of(durations: Floats, workers: int, handed: float) -> float:
    """How much sooner many workers are done than one."""
    return makespan(durations, 1, 0.0) / makespan(durations, workers, handed)


def picture(gains: dict[str, list[float]]) -> None:
    """Gain against cores, a line for each kind of task."""
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(DRAWN, DRAWN, color="0.7", linestyle=":", label="as many times as cores")
    for mark, (name, values) in zip("os^vD*P", gains.items(), strict=False):
        axes.plot(DRAWN, values, marker=mark, label=name)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    ticks = [str(count) for count in DRAWN]
    axes.set_xticks(DRAWN, ticks)
    axes.set_yticks(DRAWN, ticks)
    axes.set_xlabel("cores of a cluster")
    axes.set_ylabel("times as fast as one core (simulated)")
    axes.legend(title="scene, labellings asked together", fontsize=8)
    save_figure(figure, RESULTS / "machines.png")


if __name__ == "__main__":
    main()
