"""Labellings a second and core, from the plain way to the arithmetic limit.

The same random segmentations (blocks of 2 to 6 cells) by every route, processor time of one core: **plain**, stated
in CVXPY anew for each labelling and solved by Clarabel in joblib workers, proving nothing; **bare Clarabel**, one
call with default settings on the numbers that we have laid out, proving nothing; **one at a time**, our routes
without the batch solver, both bounds proven; **the batch solver**, all in, with what it leaves open. The **limit** is
what the
arithmetic of the batch solver's own method takes at the peak of the processor: additions, products, divisions and roots
counted by compiling the same source with numbers that count (benchmarks/counted.h), a division or root as one; the
peak measured in the same run, by chains of fused products in registers. What the batch solver takes beyond it
was not taken apart.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import joblib
import numpy as np
from matplotlib.figure import Figure

from benchmarks.build_once import bare
from benchmarks.common import RESULTS, about, table, write
from benchmarks.lanes import Case, drawn
from benchmarks.stated import stated
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch import build, chosen
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.library import SWITCH, described, library
from jld_core.limit import LimitAnalysis
from jld_core.program import Template
from jld_core.views.figures import save_figure
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.evaluator import Evaluator

HERE: Final = Path(__file__).parent
CASES: Final[dict[str, Callable[[], Case]]] = {
    "24 faces, flagship": lambda: drawn("flagship", 200, 60),
    "88 faces": lambda: drawn("planar 88 faces", 100, 40),
    "278 faces": lambda: drawn("planar 278 faces", 30, 20),
    "3 × 3 × 3 cubes, 63 faces": lambda: drawn("spatial 3x3x3", 40, 20, many=512),
}
COUNTED: Final = 48
"""Labellings whose arithmetic is counted."""

CHAINS: Final = 16
ROUNDS: Final = 20_000_000


def compiled(source: Path, target: Path, *extra: str) -> Path:
    """A shared library of one source file, by the first compiler there is."""
    command = [*build.compilers()[0], *build.FLAGS, "-fPIC", "-shared", f"-I{build.SOURCE}", *extra, str(source)]
    subprocess.run([*command, "-o", str(target)], check=True)
    return target


def peak(folder: Path) -> float:
    """Additions and products a second of one core, with the instructions of the batch solver in use."""
    made = compiled(HERE / "peak.cpp", folder / "peak.so", *build.VARIANT_FLAGS[chosen() or "base"])
    loaded = ctypes.CDLL(str(made))
    loaded.jld_peak.restype, loaded.jld_peak.argtypes = ctypes.c_double, (ctypes.c_int64,)
    loaded.jld_peak(ROUNDS // 10)
    best = float("inf")
    for _ in range(5):
        start = time.process_time()
        loaded.jld_peak(ROUNDS // 5)
        best = min(best, time.process_time() - start)
    width = int(library(chosen() or "").jld_lanes_width())
    return 2.0 * CHAINS * width * (ROUNDS // 5) / best


def arithmetic(analysis: LimitAnalysis, labellings: Bits, path: Path) -> tuple[float, float]:
    """Operations (of which divisions and roots) of one labelling, mean."""
    opening = analysis.repair.opening()
    lanes = BatchSolver(
        analysis.template, None if opening is None else opening.velocity, zero=analysis.floor, variant=str(path)
    )
    counter = library(str(path))
    found = (ctypes.c_uint64 * 3)()
    counter.jld_counted(found)
    lanes.solve(labellings)
    counter.jld_counted(found)
    return (found[0] + found[1]) / len(labellings), found[1] / len(labellings)


def timed(work: Callable[[Any], Any], items: Any) -> float:
    """Processor seconds of each call, mean."""
    start = time.process_time()
    for item in items:
        work(item)
    return (time.process_time() - start) / len(items)


def _plainly(assembly: Assembly, labels: Bits) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inaccurate answers, which are among what it costs
        start = time.process_time()
        with contextlib.suppress(Exception):  # an unstable labelling may be a solver's failure
            stated(assembly, labels)
        return time.process_time() - start


def plainly(case: Case) -> float:
    """Processor seconds of each labelling in joblib workers, one for each core."""
    with joblib.Parallel(n_jobs=os.cpu_count() or 1) as pool:
        pool(joblib.delayed(_plainly)(case.assembly, case.labellings[0]) for _ in range(4))
        return float(np.mean(pool(joblib.delayed(_plainly)(case.assembly, x) for x in case.labellings[: case.plain])))


def measure(case: Case, counted: Path, most: float) -> dict[str, float]:
    """Seconds of a labelling by every route, and its operations."""
    assembly, labellings = case.assembly, case.labellings
    template = Template(assembly)
    programs = [template.program(labels) for labels in labellings[: case.one]]
    bare(programs[0])
    evaluator = Evaluator(assembly, EvaluatorSettings())
    evaluator.evaluate_all(labellings[:64])
    together = min(timed(evaluator.evaluate_all, [labellings]) for _ in range(3)) / len(labellings)
    with patch.dict(os.environ, {SWITCH: "off"}):
        single = Evaluator(assembly, EvaluatorSettings())
        single.evaluate(labellings[0])
        alone = timed(single.evaluate, labellings[: case.one])
    operations, hard = arithmetic(LimitAnalysis(assembly), labellings[:COUNTED], counted)
    return {
        "plain": plainly(case),
        "bare": timed(bare, programs),
        "alone": alone,
        "kernel": together,
        "limit": operations / most,
        "operations": operations,
        "hard": hard,
    }


WAYS: Final = {
    "plain": ("plain CVXPY in joblib (nothing proven)", "#d9d9d9", ""),
    "bare": ("bare Clarabel (nothing proven)", "#969696", ".."),
    "alone": ("jld, one at a time", "#92c5de", "//"),
    "kernel": ("jld, kernel, all in", "#2166ac", ""),
    "limit": ("its arithmetic at the processor's peak", "white", "xx"),
}


def draw(found: dict[str, dict[str, float]]) -> Figure:
    """Labellings a second and core of every scene by every route."""
    figure = Figure(figsize=(10.0, 4.6), dpi=110, layout="constrained")
    ax = figure.subplots()
    for place, (key, (label, colour, hatch)) in enumerate(WAYS.items()):
        values = [1.0 / row[key] for row in found.values()]
        x = np.arange(len(found)) + 0.17 * (place - 2)
        bars = ax.bar(x, values, 0.16, color=colour, hatch=hatch, edgecolor="black", linewidth=0.5, label=label)
        words = [f"{value:,.0f}".replace(",", " ") for value in values]
        ax.bar_label(bars, words, fontsize=8, rotation=90, padding=3)
    ax.set_yscale("log")
    ax.set_ylim(top=20.0 * max(1.0 / row["limit"] for row in found.values()))
    ax.set_xticks(np.arange(len(found)), list(found), fontsize=9)
    ax.set_ylabel("labellings per second and core")
    ax.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")
    return figure


def main() -> None:
    """Measure all scenes and write benchmarks/results/arithmetic.md and .png."""
    if chosen() is None or not build.compilers():
        raise SystemExit("no kernel is in use, or no compiler to count with")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        counted = compiled(build.SOURCE / "kernel.cpp", folder / "counted.so", f'-DJLD_COUNTED="{HERE / "counted.h"}"')
        most = peak(folder)
        found = {name: measure(make(), counted, most) for name, make in CASES.items()}
    save_figure(draw(found), RESULTS / "arithmetic.png")
    head = [
        "scene",
        "plain, ms",
        "bare Clarabel, ms",
        "one at a time, ms",
        "kernel, µs",
        "times plain",
        "times Clarabel",
    ]
    head += ["times one at a time", "operations, million", "of them ÷ and √, thousand", "kernel, Gflop/s"]
    head += ["limit, µs", "share of the limit"]
    rows = [
        [
            name,
            *(f"{1e3 * row[key]:.2f}" for key in ("plain", "bare", "alone")),
            f"{1e6 * row['kernel']:.1f}",
            *(f"{row[key] / row['kernel']:.0f}" for key in ("plain", "bare", "alone")),
            f"{1e-6 * row['operations']:.2f}",
            f"{1e-3 * row['hard']:.0f}",
            f"{1e-9 * row['operations'] / row['kernel']:.0f}",
            f"{1e6 * row['limit']:.1f}",
            f"{row['limit'] / row['kernel']:.0%}",
        ]
        for name, row in found.items()
    ]
    picture = "![Labellings a second and core by every route](arithmetic.png)"
    note = f"{described().capitalize()}; peak measured: {1e-9 * most:.0f} Gflop/s a core."
    parts = ["# From the plain way to the arithmetic limit", about(__doc__), picture, table(head, rows), note]
    write("arithmetic", "\n\n".join(parts), also=("joblib",))


if __name__ == "__main__":
    main()
