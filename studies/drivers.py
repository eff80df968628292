"""How good the drivers are: each on one scene, against the optimum that the exact one proves.

Source: none but the method; the scene and its materials are ours. Long tables over more scenes are a benchmark's.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jld_core import build_assembly, parse_scene, solve
from jld_core.arrays import Floats
from jld_core.scene import Scene
from jld_core.views.figures import draw_assembly, draw_mechanism
from jld_explore import Exploration, ExploreSettings
from jld_explore.space import from_string
from jld_explore.study_state import Progress
from studies.report import (
    GREY,
    PAIRED,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    searched,
    without_legend,
    write,
)

NAME: Final = "drivers"
SAME: Final = 1e-6
"""Relative difference below which two load factors are one: the width their brackets are allowed."""

BUDGETS: Final = {"random": 5000, "hillclimb": 5000, "genetic": 5000, "optuna TPE": 200, "optuna NSGAII": 200}
"""Labellings solved; samplers of optuna take a hundred times as long to propose one as the program to solve it."""

SEEDS: Final = {"random": 5, "hillclimb": 5, "genetic": 5, "optuna TPE": 3, "optuna NSGAII": 3}
LOOK: Final = dict(zip((*BUDGETS, "exact"), (*PAIRED, ("#E69F00", "solid", "*")), strict=True))


@dataclass(frozen=True)
class Run:
    """One search. steps: (k, 3) labellings solved, processor seconds and best λ so far, after every batch."""

    driver: str
    seed: int
    done: Exploration
    steps: Floats

    def row(self, optimum: float) -> dict[str, Any]:
        """The run's row of the table; how soon it came to its own best."""
        best = float(self.done.summary.facts["best"])
        first = int(np.argmax(self.steps[:, 2] >= best))
        return {
            "driver": self.driver,
            "seed": self.seed,
            "solves": int(self.steps[-1, 0]),
            "seconds": float(self.steps[-1, 1]),
            "best": best,
            "below_optimum": max(0.0, 1.0 - best / optimum),
            "reached": bool(best >= optimum * (1.0 - SAME)),
            "solves_to_best": int(self.steps[first, 0]),
            "seconds_to_best": float(self.steps[first, 1]),
            "proven": bool(self.done.summary.proven),
        }


def scene(quick: bool) -> Scene:
    """A wall over two bearings, pushed sideways and down at its top; blocks of two or three cells."""
    rows = ["aaaa"] * 3 + ["#..#"] if quick else ["aaaaaa"] * 4 + ["##..##"]
    return parse_scene(
        {
            "name": "wall over two bearings",
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
            "materials": {
                "density": 1400,
                "dry": {"friction_angle": 30},
                "inner": {"tensile_strength": 2e6, "shear_strength": 2e5},
            },
            "loads": {"live": [{"element": "c1r0", "force": [1, -2]}]},
            "search": {"block_cells": [2, 3]},
        }
    )


def search(wall: Scene, driver: str, seed: int, budget: int | None) -> Run:
    """One run, by name and sampler, in one process."""
    name, _, sampler = driver.partition(" ")
    steps: list[tuple[float, float, float]] = []
    start = time.process_time()  # other work on the machine must not decide a comparison

    def note(progress: Progress) -> None:
        if progress.solved:
            steps.append((progress.solved, time.process_time() - start, progress.best))

    options = {"sampler": sampler} if sampler else {}
    settings = ExploreSettings(driver=name, budget=budget, seed=seed, jobs=1, options=options)
    done = searched(wall, settings, report=note)
    # a search may be over before it is time to report
    steps.append((done.summary.solved, time.process_time() - start, float(done.summary.facts["best"])))
    return Run(driver, seed, done, np.array(steps))


def run(out: Path, quick: bool = False) -> pd.DataFrame:
    """Search with every driver, write table, picture and page into a folder; returns the table of the runs."""
    wall = scene(quick)
    exact = search(wall, "exact", 0, None)
    optimum = float(exact.done.summary.facts["best"])
    runs = [
        search(wall, driver, seed, min(budget, 20) if quick else budget)
        for driver, budget in BUDGETS.items()
        for seed in range(1 if quick else SEEDS[driver])
    ]
    table = pd.DataFrame([each.row(optimum) for each in (*runs, exact)])
    report = Report(
        name=NAME,
        title="How good the drivers are",
        question="One wall, one question, six ways of searching: who finds the strongest cut, after how many solves "
        "and seconds, and who can say that it is the strongest?",
        source="No published numbers: the question of the method, answered by this project's drivers.",
        model=f"Ours: {'4 by 3' if quick else '6 by 4'} cells of 0.1 m on two bearings, materials of the flat "
        "beam-arch, live load (1, −2) N times λ on the second cell of the top row, blocks of two or three cells, no "
        "symmetry. One process; seconds are of its processor time, solver and driver together. "
        "Solves count labellings; the programs that the exact driver solves to bound whole groups of layouts are in "
        "its seconds alone.",
        agrees=_findings(table, exact, optimum),
        differs=(
            "One scene ranks no drivers for another; the benchmarks hold more scenes and seeds.",
            "Budgets differ, since proposals of optuna cost far more than solves here: compare at equal solves in the "
            "left picture and at equal seconds in the right one.",
            "Where a driver that proves nothing ends at the optimum, only the exact one's proof says so.",
        ),
        pictures={"": "Best λ so far against solves and seconds, one thin line a seed, the median thick; the optimum."},
    )
    write(out, report, table, {"": _picture(runs, exact, optimum)})
    return table


def _findings(table: pd.DataFrame, exact: Run, optimum: float) -> tuple[str, ...]:
    facts, own = exact.done.summary.facts, exact.row(optimum)
    found = [
        f"The exact driver proves λ = {optimum:.4f} (bound {float(facts['bound']):.4f}) after {own['solves']} solves "
        f"and {own['seconds']:.1f} s, {own['seconds_to_best']:.1f} s of which it took to find it.",
    ]
    for driver in BUDGETS:
        part = table[table["driver"] == driver]
        text = (
            f"{driver}: at the optimum in {int(part['reached'].sum())} of {len(part)} seeds within "
            f"{int(part['solves'].max())} solves ({part['seconds'].median():.1f} s); "
            f"median {100.0 * part['below_optimum'].median():.1f} % below it, worst "
            f"{100.0 * part['below_optimum'].max():.1f} %"
        )
        if part["reached"].any():
            hits = part[part["reached"]]
            text += f"; where reached, after {hits['solves_to_best'].median():.0f} solves in the median"
        found.append(text + ".")
    return tuple(found)


def _picture(runs: list[Run], exact: Run, optimum: float) -> Figure:
    figure = figure_of(12.4, 8.35)
    columns = (("labellings solved", 0), ("processor time [s], solver and driver", 1))
    for k, (label, column) in enumerate(columns):
        ax = axes_at(figure, 0.85 + 5.85 * k, 4.05, 5.35, 3.75)
        _curves(ax, runs, exact, column)
        ax.axhline(optimum, color=GREY, lw=1.0, ls=(0, (4, 2)), zorder=0.5)
        ax.set_xscale("log")
        ax.set_ylim(0.0, 1.08 * optimum)
        ax.set_xlabel(label, fontsize=9)
        if k == 0:
            ax.set_ylabel("best load factor λ so far [–], live load in N", fontsize=9)
        else:
            ax.tick_params(labelleft=False)
    handles = [
        Line2D([], [], color=LOOK[name][0], ls=LOOK[name][1], marker=LOOK[name][2], ms=7 if name == "exact" else 4.5,
               lw=1.8, label=f"{name}, ends proven" if name == "exact" else name)
        for name in LOOK
    ]  # fmt: skip
    handles.append(Line2D([], [], color=GREY, ls=(0, (4, 2)), lw=1.0, label="proven optimum"))
    legend_at(figure, handles, 0.85, 3.1, 7)
    result = solve(build_assembly(exact.done.scene), from_string(str(exact.done.summary.best_labelling)))
    for k, draw in enumerate((draw_assembly, draw_mechanism)):
        ax = axes_at(figure, 2.3 + 4.6 * k, 0.8, 3.2, 1.95)
        draw(ax, result.assembly, result.labels) if draw is draw_assembly else draw_mechanism(ax, result)
        title = f"strongest layout, λ = {optimum:.1f}" if k == 0 else "its mechanism"
        without_legend(ax, title)
        ax.set_xlabel("x [m]", fontsize=8)
        ax.set_ylabel("y [m]" if k == 0 else "", fontsize=8)
    names = ("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest")
    legend_at(figure, drawing_handles(*names), 2.6, 0.0, 7)
    figure.suptitle("Six drivers on one wall", fontsize=12, y=0.985)
    return figure


def _curves(ax: Axes, runs: list[Run], exact: Run, column: int) -> None:
    for driver in BUDGETS:
        colour, dash, marker = LOOK[driver]
        own = [each.steps for each in runs if each.driver == driver]
        for steps in own if len(own) > 1 else ():
            ax.plot(steps[:, column], steps[:, 2], color=colour, lw=0.6, alpha=0.35, drawstyle="steps-post")
        x = np.unique(np.concatenate([steps[:, column] for steps in own]))
        x = x[(x >= max(steps[0, column] for steps in own)) & (x <= min(steps[-1, column] for steps in own))]
        best = [steps[np.searchsorted(steps[:, column], x, side="right") - 1, 2] for steps in own]
        end: dict[str, Any] = {"marker": marker, "ms": 5.0, "markevery": [len(x) - 1]}
        ax.plot(x, np.median(best, axis=0), color=colour, ls=dash, lw=1.8, drawstyle="steps-post", **end)
    colour, dash, marker = LOOK["exact"]
    steps = exact.steps
    end = {"marker": marker, "ms": 11.0, "mec": "#1B1B1B", "mew": 0.6, "markevery": [len(steps) - 1]}
    ax.plot(steps[:, column], steps[:, 2], color=colour, ls=dash, lw=1.8, drawstyle="steps-post", zorder=3.0, **end)
