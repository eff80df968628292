"""What drivers and other optimisers reach in the same processor time on 24 scenes of 32 to 2 946 faces.

λ over the best single driver of jld on the same scene: its median of the seeds. The front is the volume below λ over at
least so many dry faces; seeds: the least λ of one driver over its largest, where a scene has several. Evaluations are
those of one evaluator of jld in one thread; pymoo and nevergrad choose labels as bits, which jld reads as the nearest
layout that keeps the limits; cpsat was a large neighbourhood search by OR-tools (`docs/notes/tried.md`).
`python -m benchmarks.drivers SECONDS SEEDS [METHODS [SCENES]]` (lists between commas) adds runs to `drivers.csv`;
without arguments table and picture are drawn.
"""

from __future__ import annotations

import csv
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import Voronoi

from benchmarks import timed
from benchmarks.common import RESULTS, about, load_of_machine, table, write
from benchmarks.scenes import ANGLE, STRENGTH, built, cubes, grid, middle, stacked, stones, strength, vault
from jld_core import Scene, parse_scene
from jld_core.arrays import Bits
from jld_core.limit.options import Status
from jld_explore.drivers import make_driver, operators
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.space.search_space import SearchSpace

WEAK: Final = strength(2e4)
SINGLE: Final = ("anneal", "genetic", "genetic:best", "hillclimb", "random", "optuna")
PEERS: Final = ("pymoo", "nevergrad")
METHODS: Final = ("portfolio", *SINGLE, *PEERS)
COLUMNS: Final = ("scene", "faces", "method", "seed", "seconds", "load_factor", "front", "evaluations", "share")
BATCH: Final = 32  # layouts that pymoo and nevergrad ask for at a time


def opened(across: int, up: int, *holes: tuple[int, int, int, int]) -> list[str]:
    rows = [["a"] * across for _ in range(up)]
    for left, right, top, low in holes:
        for row in rows[top:low]:
            row[left:right] = "." * (right - left)
    return ["".join(row) for row in rows] + ["#" * across]


def bridge(across: int, deep: int) -> list[str]:
    return ["a" * across] * deep + ["##" + "." * (across - 4) + "##"]


def viaduct(across: int, deck: int, pier: int) -> list[str]:
    """Rows of a deck on a pier in every eleventh column."""
    row = "".join("a" if column % 11 == 0 else "." for column in range(across))
    return ["a" * across] * deck + [row] * pier + [row.replace("a", "#")]


def searched(
    name: str, elements: list[dict[str, Any]], inner: dict[str, float], live: Any, cells: list[int], **keys: Any
) -> Scene:
    document = stones(elements, [live], ANGLE, inner, density=1400)
    return parse_scene({"name": name, "search": {"block_cells": cells}, **document, **keys})


def arch(along: int, rings: int, load: float, cells: list[int]) -> Scene:
    """A segment of 150° in rings, 0.3 m thick on a radius of 1 m, loaded at a share of its length."""
    half = np.radians(75.0)
    angles = np.linspace(np.pi / 2 + half, np.pi / 2 - half, along + 1)
    radii, step = np.linspace(0.85, 1.15, rings + 1), float(angles[0] - angles[1])

    def cell(low: float, high: float, a: float, b: float) -> list[list[float]]:
        return [[float(r * np.cos(t)), float(r * np.sin(t))] for r, t in ((low, b), (high, b), (high, a), (low, a))]

    elements: list[dict[str, Any]] = [
        {"id": f"v{k}r{r}", "polygon": cell(radii[r], radii[r + 1], angles[k], angles[k + 1])}
        for k in range(along)
        for r in range(rings)
    ]
    for name, at in (("left", float(angles[0]) + step), ("right", float(angles[-1]))):
        elements.append({"id": name, "polygon": cell(radii[0], radii[-1], at, at - step), "support": True})
    live = {"element": f"v{int(along * load)}r{rings - 1}", "force": [0, -1]}
    return searched(f"arch {along} x {rings}", elements, STRENGTH, live, cells, thickness=0.3)


def voronoi(count: int, seed: int, width: float, height: float) -> Scene:
    points = np.random.default_rng(seed).random((count, 2)) * [width, height]
    for _ in range(31):
        images = [points, points * [-1, 1], points * [1, -1], [2 * width, 0] - points * [1, -1]]
        found = Voronoi(np.concatenate([*images, [0, 2 * height] - points * [-1, 1]]))
        corners = [found.vertices[found.regions[found.point_region[k]]] for k in range(count)]
        points = np.array([one.mean(axis=0) for one in corners])
    elements: list[dict[str, Any]] = []
    for k, one in enumerate(corners):
        own = np.clip(np.round(one, 9), 0.0, [width, height])
        turn = np.arctan2(*(own - own.mean(axis=0)).T[::-1])
        elements.append({"id": f"v{k}", "polygon": own[np.argsort(turn)].tolist()})
    base = [[0, -0.1], [width, -0.1], [width, 0], [0, 0]]
    elements.append({"id": "base", "polygon": base, "support": True})
    top = int(np.argmax(10 * points[:, 1] - abs(points[:, 0] - 0.3 * width)))
    live = {"element": f"v{top}", "force": [0.5, -1]}
    return searched(f"voronoi {count}", elements, WEAK, live, [1, 4], thickness=0.1)


def stack(nx: int, ny: int, nz: int) -> Scene:
    live = {"element": f"c0.0.{nz - 1}", "force": [1, 0.3, 0]}
    return searched(f"stack {nx} x {ny} x {nz}", stacked(nx, ny, nz, "."), WEAK, live, [1, 6])


def wall(rows: int, across: int, cells: list[int], live: list[dict[str, Any]] | None = None, **keys: Any) -> Scene:
    return grid(["a" * across] * rows + ["#" * across], live, search={"block_cells": cells}, **keys)


def corner(column: int, row: int, down: float) -> list[dict[str, Any]]:
    return [{"element": f"c{column}r{row}", "force": [1, -down]}]


SCENES: Final[dict[str, Callable[[], Scene]]] = {
    "wall 6x8": lambda: grid(["a" * 8] * 6 + ["###..###"], middle(3, 4), search={"block_cells": [2, 6]}),
    "wall 10x15": lambda: grid(
        ["a" * 15] * 10 + ["#......#......#"], middle(3, 4, 10, 11), search={"block_cells": [2, 6]}
    ),
    "wall 20x25 weak": lambda: wall(20, 25, [1, 6], inner=WEAK),
    "wall 30x34": lambda: wall(30, 34, [1, 6], corner(0, 0, 0.3), inner=strength(1e5)),
    "wall 36x42 weak": lambda: wall(36, 42, [1, 8], inner=WEAK),
    "opening 12x9": lambda: grid(opened(12, 9, (4, 8, 3, 9)), search={"block_cells": [1, 4]}),
    "openings 20x14": lambda: grid(
        opened(20, 14, (3, 7, 5, 14), (12, 16, 5, 10)), middle(4, 5, 14), strength(2e5), {"block_cells": [1, 5]}
    ),
    "openings 30x18 weak": lambda: grid(
        opened(30, 18, (4, 9, 6, 18), (14, 18, 6, 12), (22, 26, 6, 12)), search={"block_cells": [2, 6]}, inner=WEAK
    ),
    "bridge 14x4": lambda: grid(bridge(14, 4), middle(6, 7), search={"block_cells": [2, 6]}),
    "bridge 26x6": lambda: grid(bridge(26, 6), middle(8, 9), search={"block_cells": [2, 8]}),
    "arch 19x3": lambda: arch(19, 3, 0.3, [1, 6]),
    "arch 41x4": lambda: arch(41, 4, 0.25, [1, 6]),
    "arch 60x6": lambda: arch(60, 6, 0.35, [2, 8]),
    "viaduct 34": lambda: grid(viaduct(34, 2, 4), middle(5, 6, 16), search={"block_cells": [1, 6]}),
    "viaduct 67": lambda: grid(viaduct(67, 3, 5), middle(5, 6, 27, 28), search={"block_cells": [1, 6]}),
    "tower 6x20": lambda: wall(20, 6, [1, 6], corner(0, 0, 0.5), inner=strength(5e4)),
    "tower 8x40 weak": lambda: wall(40, 8, [1, 5], corner(0, 3, 0.0), inner=WEAK),
    "voronoi 60": lambda: voronoi(60, 1, 1.6, 1.0),
    "voronoi 250": lambda: voronoi(250, 2, 2.4, 1.6),
    "cubes 3": lambda: cubes(3, search={"block_cells": [2, 6]}),
    "cubes 5": lambda: cubes(5, search={"block_cells": [1, 6]}),
    "stack 3x3x12": lambda: stack(3, 3, 12),
    "vault 9x3": vault,
    "vault 15x7": lambda: vault(15, 7, inner=5e4),
}


Told = Callable[[NDArray[np.float64]], None]  # takes the values (k,) of labellings that were asked


def of_driver(name: str, space: SearchSpace, evaluator: Evaluator, seed: int) -> Iterator[tuple[Bits, Told]]:
    name, _, aim = name.partition(":")
    driver = make_driver(name, space, seed, **({"aim": aim} if aim else {}))
    submitted = deque[Bits]()
    while True:
        while len(submitted) <= driver.ahead and len(asked := driver.ask()):  # as many ahead as a study asks
            submitted.append(asked)
        if not submitted:
            return
        rows = submitted.popleft()
        found = evaluator.evaluate_all(rows)
        driver.tell(rows, found)
        values = np.array([one.load_factor if one.status is Status.COLLAPSE else -np.inf for one in found])
        yield rows, cast(Any, values)


def bits_of(space: SearchSpace) -> tuple[int, Callable[[Any], Bits]]:
    """How many bits a layout has for pymoo and nevergrad, and the layout nearest to some (one each, or none)."""
    ways = operators(space)
    return ways.keys, lambda bits: ways.read(np.where(np.asarray(bits, dtype=bool), 0.75, 0.25)[None])[0]


def of_peer(name: str, space: SearchSpace, evaluator: Evaluator, seed: int) -> Iterator[tuple[Bits, Any]]:
    """Portions of labellings of pymoo's genetic algorithm, or of the optimiser that nevergrad chooses."""
    count, layout = bits_of(space)

    def values(chosen: list[Any]) -> tuple[Bits, Any, Any]:
        made = [layout(bits) for bits in chosen]
        rows = np.concatenate([one for one in made if len(one)] or [np.empty((0, len(space.fixed)), dtype=bool)])
        found = [one.load_factor if one.status is Status.COLLAPSE else -1.0 for one in evaluator.evaluate_all(rows)]
        left = iter(found)
        return rows, np.array(found), np.array([next(left) if len(one) else -2.0 for one in made])

    if name == "pymoo":
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.core.evaluator import Evaluator as Shell
        from pymoo.core.problem import Problem
        from pymoo.operators.crossover.ux import UniformCrossover
        from pymoo.operators.mutation.bitflip import BitflipMutation
        from pymoo.operators.sampling.rnd import BinaryRandomSampling
        from pymoo.problems.static import StaticProblem

        problem = Problem(n_var=count, n_obj=1, xl=0, xu=1, vtype=bool)
        how = {"sampling": BinaryRandomSampling(), "crossover": UniformCrossover(), "mutation": BitflipMutation()}
        search = GA(pop_size=2 * BATCH, **how)
        search.setup(problem, seed=seed, termination=("n_gen", 10**9), verbose=False)
        while True:
            asked = search.ask()
            rows, found, told = values(list(asked.get("X")))
            Shell().eval(StaticProblem(problem, F=-told[:, None]), asked)
            search.tell(infills=asked)
            yield rows, found
    import nevergrad

    bits = nevergrad.p.TransitionChoice([0, 1], repetitions=count)
    bits.random_state.seed(seed)
    optimiser = nevergrad.optimizers.registry["NGOpt"](bits, budget=10**5, num_workers=BATCH)
    while True:
        chosen = [optimiser.ask() for _ in range(BATCH)]
        rows, found, told = values([one.value for one in chosen])
        for one, value in zip(chosen, told.tolist(), strict=True):
            optimiser.tell(one, -value)
        yield rows, found


def run(name: str, method: str, times: list[float], seed: int) -> Iterator[dict[str, Any]]:
    """One method on one scene: best λ and volume of the front after each of some seconds of the processor."""
    assembly, space = built(SCENES[name]())
    evaluator = Evaluator(assembly, EvaluatorSettings())
    evaluator.evaluate_all(assembly.labels[None])
    inner = [0.0]
    evaluator.evaluate_all = timed(evaluator.evaluate_all, time.process_time, inner)  # type: ignore[method-assign]
    start, evaluated, left = time.process_time(), 0, sorted(times)
    front = np.full(int(space.candidates.sum()) + 1, 0.0)
    for rows, values in (of_peer if method in PEERS else of_driver)(method, space, evaluator, seed):
        evaluated += len(rows)
        np.maximum.at(front, (rows & space.candidates).sum(axis=1), np.nan_to_num(np.asarray(values), neginf=0.0))
        while left and (spent := time.process_time() - start) >= left[0]:
            volume = float(np.maximum.accumulate(front[::-1]).mean())
            shown = f"{front.max():.7g}", f"{volume:.7g}", evaluated, f"{inner[0] / spent:.3f}"
            yield dict(zip(COLUMNS, (name, len(front) - 1, method, seed, left.pop(0), *shown), strict=True))
        if not left:
            break


def draw(rows: pd.DataFrame) -> None:
    """Write the table, and the share of scenes on which a method comes within a ratio of the best, as a picture."""
    from matplotlib.figure import Figure

    parts: list[str] = []
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for seconds, own in rows.groupby("seconds"):
        values = own.groupby(["scene", "method"], sort=False)[["faces", "load_factor", "front"]]
        known = cast(Any, values.median().unstack())
        single = [name for name in known["load_factor"].columns if name in SINGLE]
        ratio = {
            value: known[value].div(known[value][single].max(axis=1), axis=0).replace([np.inf, -np.inf], np.nan)
            for value in ("load_factor", "front")
        }
        order = [name for name in (*METHODS, "cpsat") if name in ratio["load_factor"]]
        body = [
            [scene, f"{known['faces'].loc[scene].max():.0f}", f"{known['load_factor'].loc[scene][single].max():.5g}"]
            + ["" if np.isnan(v) else f"{v:.3f}" for v in ratio["load_factor"].loc[scene][order]]
            for scene in SCENES
            if scene in ratio["load_factor"].index
        ]
        for words, number in (("least", 0.0), ("median", 0.5)):
            for label, value in (("λ", "load_factor"), ("front", "front")):
                some = [ratio[value][name].dropna().quantile(number) for name in order]
                body.append([f"{words} of {label}", "", "", *(f"{one:.3f}" for one in some)])
        groups = own.groupby(["scene", "method"])["load_factor"]
        spread = (groups.min() / groups.max())[groups.size() > 1].unstack()
        for words, number in (("least", 0.0), ("median", 0.5)):
            some = [spread[name].dropna().quantile(number) if name in spread else np.nan for name in order]
            body.append([f"{words} of seeds", "", "", *("" if np.isnan(one) else f"{one:.3f}" for one in some)])
        seeds = own["seed"].nunique()
        parts.append(f"## {seconds:g} s of the processor, at most {seeds} seed{'s' * (seeds > 1)} a scene\n")
        parts.append(table(["scene", "faces", "best single driver", *order], body))
        if parts[2:]:
            continue  # the picture is that of the shortest time
        for ax, value, title in zip(axes, ratio, ("largest λ", "volume of the front"), strict=True):
            for name in order:
                away = known[value].max(axis=1) / known[value][name].dropna().clip(lower=1e-9)
                reached = np.append(np.sort(away.dropna()), 3.0)
                share = np.minimum(np.arange(1, len(reached) + 1) / (len(reached) - 1), 1.0)
                ax.step(reached, share, where="post", label=name, lw=2.2 if name == "portfolio" else 1.1)
            ax.set(xlim=(1.0, 2.0), xlabel="best of all over this one", title=f"{title}, {seconds:g} s")
        axes[0].set_ylabel("share of scenes")
        axes[1].legend(fontsize=7)
    figure.savefig(RESULTS / "drivers.png", dpi=130)
    also, text = ("pymoo", "nevergrad", "ortools"), "\n".join([*parts, load_of_machine()])
    write("drivers", "# What drivers reach in the same time", about(__doc__), text, also=also)


def main() -> None:
    path = RESULTS / "drivers.csv"
    if len(sys.argv) > 2:
        methods = sys.argv[3].split(",") if len(sys.argv) > 3 else METHODS
        scenes = sys.argv[4].split(",") if len(sys.argv) > 4 else list(SCENES)
        for seed in map(int, sys.argv[2].split(",")):
            for name in scenes:
                for method in methods:
                    for found in run(name, method, [float(one) for one in sys.argv[1].split(",")], seed):
                        sys.stderr.write(f"{found}\n")
                        with path.open("a", newline="", encoding="utf-8") as file:
                            csv.DictWriter(file, COLUMNS).writerow(found)
    draw(pd.read_csv(path))


if __name__ == "__main__":
    main()
