"""Speed against error over many labellings, the batch solver among the routes: processor time of one, and its error of
λ.

The same random labellings of one assembly by every route, whatever can be made once made before. The error is that
against the intersection of all brackets proven in the run, and at least half its width: the median over labellings, and
the worst. Batch solver: its first pass alone at targets of the gap from 1e-4 to 1e-10, and as it is used (all passes,
target
1e-8 in the plane, 3e-8 in space), 512 at a time. One at a time: the same proofs by Clarabel, loose (1e-6), as without a
batch solver, and tight (1e-12, refined). Bare: Clarabel's answer believed, without a bracket. CVXPY: stated anew for
each
labelling, as one would write it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, about, table, write
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from benchmarks.stated import stated
from jld_core import Assembly
from jld_core.arrays import Bits, Floats
from jld_core.batch.batch_solver import PROVEN, SPATIAL_TRIES, TRIES, BatchSolver
from jld_core.batch.library import Try, described
from jld_core.limit import LimitAnalysis
from jld_core.solvers import ClarabelSolver
from jld_core.views.figures import save_figure
from jld_explore.drivers import make_driver

SCENES: Final = ("flagship", "planar 88 faces", "planar 278 faces", "spatial 3x3x3")
TARGETS: Final = (1e-4, 1e-6, 1e-8, 1e-10)
MANY: Final = 512
FEW: Final = 24
"""Labellings of the batch solver, and of the others, which are the first of these."""
BY_CVXPY: Final = 6

Bounds = tuple[Floats, Floats]


@dataclass(frozen=True)
class Route:
    """A route: seconds of one labelling, its λ scaled and bounds (k,), NaN where there are none. family: its mark."""

    name: str
    family: str
    seconds: float
    load: Floats
    low: Floats
    high: Floats


def timed(call: Callable[[], Bounds], count: int, turns: int = 3) -> tuple[float, Bounds]:
    """Seconds of the processor for each of `count`, the best of some turns, and the answer."""
    best = math.inf
    for _ in range(turns):
        start = time.process_time()
        found = call()
        best = min(best, (time.process_time() - start) / count)
    return best, found


def by_kernel(analysis: LimitAnalysis, rows: Bits) -> list[Route]:
    """The batch solver at its targets, one pass each, and as it is used."""
    opening = analysis.repair.opening()
    velocity = None if opening is None else opening.velocity
    first = (TRIES if analysis.assembly.dimension == 2 else SPATIAL_TRIES)[0]
    plain = {name: getattr(first, name) for name, _ in Try._fields_}
    ways: list[tuple[str, tuple[Try, ...]]] = [
        (f"kernel, {target:.0e}", (Try(**plain | {"target": target}),)) for target in TARGETS
    ]
    found = []
    for name, tries in [*ways, ("kernel, as used", ())]:
        batch = BatchSolver(analysis.template, velocity, zero=analysis.floor, tries=tries)

        def run(batch: BatchSolver = batch) -> Bounds:
            answers = batch.solve(rows)
            return answers.low, answers.high

        seconds, (low, high) = timed(run, len(rows))
        low, high = low[:FEW], high[:FEW]
        family = "kernel" if tries else "kernel, as used"
        found.append(Route(name, family, seconds, 0.5 * (low + high), low, high))
    return found


def by_proof(name: str, analysis: LimitAnalysis, rows: Bits) -> Route:
    """One labelling at a time, with both bounds."""

    def run() -> Bounds:
        low, high = zip(*(analysis.prove(labels).bracket for labels in rows), strict=True)
        return np.array(low), np.array(high)

    run()
    seconds, (low, high) = timed(run, len(rows), 2)
    return Route(name, "one at a time", seconds, 0.5 * (low + high), low, high)


def believed(name: str, solve: Callable[[Bits], float], rows: Bits) -> Route:
    """One labelling at a time, whose answer is believed."""
    none = np.full(FEW, math.nan)

    def run() -> Bounds:
        return np.array([solve(labels) for labels in rows]), none

    seconds, (load, _) = timed(run, len(rows), 2)
    return Route(name, name, seconds, np.concatenate([load, none])[:FEW], none, none)


def measured(assembly: Assembly, rows: Bits) -> list[Route]:
    """Every route on the same labellings."""
    default = LimitAnalysis(assembly, solver="clarabel")
    loose, tight = (
        LimitAnalysis(assembly, solver="clarabel", gap=g, margin=m) for g, m in ((1e-3, 1e-6), (1e-9, 1e-12))
    )
    loose.route, tight.route = ClarabelSolver(1e-6), ClarabelSolver(1e-12, iterative_refinement_enable=True)
    template, bare, scale = default.template, ClarabelSolver(1e-8), default.template.scaling.load
    few = rows[:FEW]
    return [
        *by_kernel(LimitAnalysis(assembly), rows),
        *(
            by_proof(f"one at a time, {n}", a, few)
            for n, a in (("loose", loose), ("default", default), ("tight", tight))
        ),
        believed("Clarabel, bare", lambda labels: float(bare.solve(template.program(labels)).point[-1]), few),
        believed("CVXPY", lambda labels: stated(assembly, labels, "CLARABEL") / scale, rows[:BY_CVXPY]),
    ]


def errors(routes: list[Route]) -> dict[str, tuple[float, float, float, float]]:
    """Of each route: median and worst error of λ, median width of the bracket, and the share that has one."""
    with np.errstate(invalid="ignore"):
        low = np.nanmax([np.where(np.isfinite(one.low), one.low, np.nan) for one in routes], axis=0)
        high = np.nanmin([np.where(np.isfinite(one.high), one.high, np.nan) for one in routes], axis=0)
    assert (low <= high * (1.0 + 1e-9)).all(), "two proven brackets exclude each other"
    middle, half = 0.5 * (low + high), 0.5 * abs(high - low)
    found = {}
    for one in routes:
        error = np.maximum(abs(one.load - middle), half) / abs(middle)
        width = (one.high - one.low) / abs(middle)
        proven = np.isfinite(width)
        known = np.isfinite(error)
        worst = (float(np.median(error[known])), float(error[known].max())) if known.any() else (math.nan, math.nan)
        found[one.name] = (*worst, float(np.median(width[proven])) if proven.any() else math.nan, float(proven.mean()))
    return found


MARKS: Final = {
    "kernel": ("o", "#2166ac", "kernel, one pass"),
    "kernel, as used": ("*", "#b2182b", "kernel, as used"),
    "one at a time": ("s", "#e08214", "one at a time, proven"),
    "Clarabel, bare": ("X", "#4d4d4d", "Clarabel, bare (no bracket)"),
    "CVXPY": ("v", "#8c8c8c", "CVXPY (no bracket)"),
}


def draw(found: dict[str, list[Route]]) -> Figure:
    """Time of a labelling against its error: a mark at the median, a line up to the worst."""
    figure = Figure(figsize=(10.0, 7.4), dpi=110, layout="constrained")
    axes = figure.subplots(2, 2)
    for ax, (name, routes) in zip(axes.flat, found.items(), strict=True):
        known = errors(routes)
        for family, (mark, colour, label) in MARKS.items():
            own = [one for one in routes if one.family == family and math.isfinite(known[one.name][0])]
            at = [1e3 * one.seconds for one in own]
            middle, worst = ([known[one.name][k] for one in own] for k in (0, 1))
            size = 190 if mark == "*" else 45
            ax.vlines(at, middle, worst, color=colour, linewidth=0.9)
            ax.scatter(at, middle, size, color=colour, marker=mark, label=label, zorder=3)
            if family == "kernel":
                for one, x, y in zip(own, at, middle, strict=True):
                    text = one.name.removeprefix("kernel, ")
                    # the finest below its mark: where two errors are alike, their words would lie on one another
                    down = -9 if one is min(own, key=lambda o: known[o.name][0]) else -3
                    ax.annotate(
                        text, (x, y), (-5, down), textcoords="offset points", fontsize=7, color=colour, ha="right"
                    )
        ax.set_xscale("log")
        ax.set_yscale("log")
        low, high = ax.get_xlim()
        ax.set_xlim(0.35 * low, high)
        ax.set_title(name, fontsize=10)
        ax.set_xlabel("processor time of a labelling [ms]")
        ax.set_ylabel("relative error of λ, median to worst")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8
    )
    return figure


def main() -> None:
    """Measure all scenes and write benchmarks/results/lanes_error.md and .png."""
    found: dict[str, list[Route]] = {}
    parts = []
    for name in SCENES:
        assembly, space = built((ENUMERATED | LARGE)[name]())
        drawn = make_driver("random", space, 0).ask(MANY)
        while len(drawn) < MANY:
            drawn = np.concatenate([drawn, make_driver("random", space, len(drawn)).ask(MANY - len(drawn))])
        # λ beside which an error is one of λ
        sound = BatchSolver(LimitAnalysis(assembly).template).solve(drawn)
        drawn = drawn[(sound.verdict == PROVEN) & (sound.low > 1e-3 * float(np.median(sound.low)))]
        found[name] = routes = measured(assembly, drawn)
        known = errors(routes)
        rows = []
        for one in routes:
            middle, worst, width, share = known[one.name]
            proven = f"{width:.0e}" if math.isfinite(width) else "none"
            rows.append([one.name, f"{1e3 * one.seconds:.3g}", f"{middle:.0e}", f"{worst:.0e}", proven, f"{share:.0%}"])
        head = ["route", "ms a labelling", "error, median", "error, worst", "bracket, median", "with a bracket"]
        parts.append(f"## {name}\n\n{table(head, rows)}")
        print(parts[-1], flush=True)
    save_figure(draw(found), RESULTS / "lanes_error.png")
    top = ["# Speed against error, over many labellings", about(__doc__), "![Time against error](lanes_error.png)"]
    write("lanes_error", "\n\n".join([*top, *parts, f"{described().capitalize()}."]))


if __name__ == "__main__":
    main()
