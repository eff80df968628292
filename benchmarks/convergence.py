"""How drivers converge on scenes beyond enumeration: `python -m benchmarks.convergence [--full]`.

Every labelling is solved, and every driver has the same number of evaluations; a driver that needs more than
PATIENCE seconds of its own is stopped there. Best λ so far against solves and seconds, as pictures and CSV, and what
drivers add to the time of evaluation. Without --full the smallest scene only, and few evaluations.
"""

from __future__ import annotations

import argparse
import time
from typing import Final

import numpy as np
import pandas as pd

from benchmarks.common import RESULTS, table, write
from benchmarks.drivers import driver_of, search
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from jld_core.arrays import Bits, Bools
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.scene import Scene
from jld_core.views.figures import save_figure
from jld_explore.evaluation import Evaluation, EvaluatorSettings
from jld_explore.evaluation.evaluator import Evaluator
from jld_explore.report.pictures import plot_convergence
from jld_explore.space import SearchSpace

NAMES: Final = ("random", "hillclimb", "genetic", "exact", "optuna:Random", "optuna:NSGAII", "optuna:TPE")
PATIENCE: Final = 30.0
BUDGET: Final = 500


def converge(assembly: Assembly, space: SearchSpace, budget: int, name: str) -> tuple[pd.DataFrame, list[str]]:
    """Best λ so far against solves and seconds, solver and driver together, and a row of the table of overheads."""
    solver, start = Evaluator(assembly, EvaluatorSettings()), time.perf_counter()
    seconds: list[float] = []
    spent = [0.0]

    def evaluate(_: bytes, labels: Bits) -> Evaluation:
        begun = time.process_time()
        found = solver.evaluate(labels)
        spent[0] += time.process_time() - begun
        seconds.append(time.perf_counter() - start)
        return found

    run = search(driver_of(name, space, 0), evaluate, budget, PATIENCE)
    best = np.fmax.accumulate(run.values)
    step: Bools = np.concatenate([[True], best[1:] > best[:-1]])
    step[-1] = True
    places = np.flatnonzero(step)
    count = len(run.asked)
    row = [
        name,
        str(count),
        f"{best[-1]:.5g}",
        f"{1e3 * spent[0] / count:.2f}",
        f"{1e3 * run.overhead / count:.2f}",
        f"{run.overhead / spent[0]:.0%}",
    ]
    columns = {"solves": places + 1, "seconds": np.array(seconds)[places], "best": best[places]}
    return pd.DataFrame(columns), row


def scenes(full: bool) -> dict[str, Scene]:
    """The scenes by name; the enumerated ones for their overheads alone."""
    chosen = {**ENUMERATED, **LARGE} if full else dict(list(LARGE.items())[:1])
    return {name: make() for name, make in chosen.items()}


def main(arguments: list[str] | None = None) -> None:
    """Run what was asked for and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="all scenes, with equal budgets")
    asked = parser.parse_args(arguments)
    rows: list[list[str]] = []
    for name, scene in scenes(asked.full).items():
        assembly, space = built(scene)
        histories: dict[str, pd.DataFrame] = {}
        for driver in NAMES if name in LARGE else ("genetic",):
            try:
                histories[driver], row = converge(assembly, space, BUDGET if asked.full else 200, driver)
            except InputError as error:
                row = [driver, str(error), *[""] * 4]
            rows.append([name, *row])
        if asked.full and name in LARGE:
            stem = "convergence_" + name.replace(" ", "_")
            save_figure(plot_convergence(histories), RESULTS / f"{stem}.png")
            parts = [history.assign(driver=driver) for driver, history in histories.items()]
            pd.concat(parts).to_csv(RESULTS / f"{stem}.csv", index=False, float_format="%.6g")
    head = ["scene", "driver", "evaluations", "best λ", "evaluation ms", "driver ms", "driver / evaluation"]
    note = f"One seed; milliseconds are processor time for each labelling. Stopped after {PATIENCE:.0f} s of its own."
    write(
        "convergence" if asked.full else "convergence_quick",
        f"# Convergence and overhead\n\n{table(head, rows)}\n\n{note}",
    )


if __name__ == "__main__":
    main()
