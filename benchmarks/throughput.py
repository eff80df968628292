"""Labellings per second and core by grid size, where the time goes, and the plain way beside it in the same run.

Ours: a study with the random driver in one process, from the first labelling asked to the last one on disk, both
bounds proven. Plain: the problem stated in CVXPY anew for each labelling (Clarabel, default tolerances) in joblib
workers, which proves nothing, on a sample of the same labellings. Rates are per second of processor time, so per
core. Shares come from a second study with methods wrapped from outside, on the wall clock.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import clarabel
import highspy
import joblib
import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, ROOT, about, table, write
from benchmarks.scenes import GRIDS, cubes, grid
from benchmarks.stated import stated
from jld_core import Assembly, Scene, Status, build_assembly, load_scene
from jld_core.arrays import Bits, Floats
from jld_core.limit import Prover
from jld_core.limit.repair import Repair
from jld_core.program import Template
from jld_core.solvers.schur.interior_point import SchurSolver
from jld_core.views.figures import save_figure
from jld_explore.drivers import make_driver
from jld_explore.evaluation import Records
from jld_explore.evaluation.rows import evaluation_of
from jld_explore.settings import ExploreSettings
from jld_explore.space import search_space, unpack
from jld_explore.study import Study

PARTS: Final = ("solver", "proof", "assembly", "driver", "store", "other Python")
PROOF: Final = {
    Prover: ("state", "ray", "motion", "measure", "blend", "add_opening"),
    Repair: ("state", "boundary_state", "ray", "opening", "reduced"),
}
"""Methods whose time, less that of solvers within, is proof."""


@dataclass
class Stopwatch:
    """Seconds by part; time in a wrapped call made by another wrapped call counts for the inner one."""

    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    _parts: list[str] = field(default_factory=list)
    _since: float = 0.0

    def _charge(self) -> None:
        now = time.perf_counter()
        if self._parts:
            self.seconds[self._parts[-1]] += now - self._since
        self._since = now

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Charge what runs inside to a part."""
        self._charge()
        self._parts.append(name)
        try:
            yield
        finally:
            self._charge()
            self._parts.pop()

    def wrapped(self, call: Callable[..., Any], name: str) -> Callable[..., Any]:
        """The same call, charged to a part."""

        def run(*positional: Any, **keys: Any) -> Any:
            with self.part(name):
                return call(*positional, **keys)

        return run

    @contextlib.contextmanager
    def watching(self, targets: Sequence[tuple[Any, str, str]]) -> Iterator[None]:
        """Wrap (owner, attribute, part) while inside. AttributeError for an attribute that is not there."""
        with contextlib.ExitStack() as stack:
            for owner, attribute, name in targets:
                stack.enter_context(patch.object(owner, attribute, self.wrapped(getattr(owner, attribute), name)))
            yield

    def shares(self) -> dict[str, float]:
        """Part of the whole, by part."""
        total = sum(self.seconds.values())
        return {name: spent / total for name, spent in self.seconds.items()}


@dataclass(frozen=True)
class Throughput:
    """One scene: labellings a second and core, ours and plain; shares of time by part; most that λ differs."""

    name: str
    faces: int
    asked: int
    rate: float
    plain: float
    shares: dict[str, float]
    apart: float


def scenes() -> dict[str, tuple[Scene, int, int]]:
    """Scene, labellings, and how many of them for the plain way."""
    rule = {"block_cells": [2, 6]}
    found: dict[str, tuple[Scene, int, int]] = {
        "flagship, 24 faces": (load_scene(ROOT / "scenes" / "flat_beam_arch.json"), 1500, 100)
    }
    for faces, asked, sample in ((33, 1500, 80), (88, 600, 40), (278, 200, 20)):
        found[f"grid, {faces} faces"] = (grid(GRIDS[faces], search=rule), asked, sample)
    return {**found, "3 × 3 × 3 cubes": (cubes(), 300, 20)}


def study_of(scene: Scene, assembly: Assembly, folder: Path, asked: int) -> Study:
    """A study with the random driver, in this process."""
    space = search_space(scene, assembly)
    return Study(
        scene=scene,
        assembly=assembly,
        space=space,
        driver=make_driver("random", space, 0),
        folder=folder,
        settings=ExploreSettings(budget=asked),
    )


def run(scene: Scene, assembly: Assembly, asked: int) -> tuple[float, Bits, Floats]:
    """Processor seconds of a study, its labellings (k, m), and their λ, NaN where they do not collapse."""
    with tempfile.TemporaryDirectory() as folder:
        study = study_of(scene, assembly, Path(folder), asked)
        start = time.process_time()
        study.run()
        spent = time.process_time() - start
        rows = study.records.rows
        labellings = unpack(rows["labelling"], len(assembly.interfaces))
        found = [evaluation_of(row) for row in rows]
    values = [e.load_factor if e.status is Status.COLLAPSE else np.nan for e in found]
    return spent, labellings, np.array(values)


def shares_of(scene: Scene, assembly: Assembly, asked: int) -> dict[str, float]:
    """Share of each part in the wall time of a study."""
    watch = Stopwatch()
    # another assembly to the worker, which then makes a solver while it is watched
    assembly = replace(assembly, name=f"{assembly.name}, watched")

    class Timed:
        """Clarabel's solver, which is made, updated and run."""

        def __init__(self, *arguments: Any) -> None:
            with watch.part("solver"):
                self._solver = solver(*arguments)

        def update(self, **keys: Any) -> None:
            with watch.part("solver"):
                self._solver.update(**keys)

        def solve(self) -> Any:
            with watch.part("solver"):
                return self._solver.solve()

    solver = clarabel.DefaultSolver
    with tempfile.TemporaryDirectory() as folder:
        study = study_of(scene, assembly, Path(folder), asked)
        targets: list[tuple[Any, str, str]] = [
            (Template, "__init__", "assembly"),
            (Template, "program", "assembly"),
            (highspy.Highs, "passModel", "solver"),
            (highspy.Highs, "run", "solver"),
            (SchurSolver, "solve", "solver"),
            (Records, "append", "store"),
            (Records, "find", "store"),
            (study.driver, "ask", "driver"),
            (study.driver, "tell", "driver"),
            *((owner, name, "proof") for owner, names in PROOF.items() for name in names),
        ]
        clarabel.DefaultSolver = Timed
        try:
            with watch.watching(targets), watch.part("other Python"):
                study.run()
        finally:
            clarabel.DefaultSolver = solver
    shares = watch.shares()
    return {part: shares.get(part, 0.0) for part in PARTS}


def _plainly(assembly: Assembly, labels: Bits) -> tuple[float, float]:
    """Processor seconds and λ of the plain way."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inaccurate answers, which are among what it costs
        start = time.process_time()
        try:
            value = stated(assembly, labels)
        except Exception:  # an unstable labelling may be a solver's failure
            value = np.nan
        return time.process_time() - start, value


def plainly(assembly: Assembly, labellings: Bits, jobs: int) -> tuple[float, Floats]:
    """Labellings a second and core in joblib workers, and their λ."""
    with joblib.Parallel(n_jobs=jobs) as pool:
        pool(joblib.delayed(_plainly)(assembly, labellings[0]) for _ in range(2 * jobs))
        found = pool(joblib.delayed(_plainly)(assembly, labels) for labels in labellings)
    return len(found) / sum(spent for spent, _ in found), np.array([value for _, value in found])


def measure(name: str, scene: Scene, asked: int, sample: int, jobs: int) -> Throughput:
    """Ours, instrumented, and plain, one after the other."""
    assembly = build_assembly(scene)
    run(scene, assembly, min(asked, 8))
    spent, labellings, values = run(scene, assembly, asked)
    shares = shares_of(scene, assembly, asked)
    chosen = np.linspace(0, len(labellings) - 1, min(sample, len(labellings))).astype(int)
    rate, others = plainly(assembly, labellings[chosen], jobs)
    known = np.isfinite(values[chosen]) & np.isfinite(others)
    ours, theirs = values[chosen][known], others[known]
    apart = float((abs(ours - theirs) / abs(ours)).max()) if known.any() else np.nan
    faces = len(assembly.interfaces)
    return Throughput(name, faces, len(labellings), len(labellings) / spent, rate, shares, apart)


COLOURS: Final = ("#2166ac", "#92c5de", "#1b7837", "#a6dba0", "#c2a5cf", "#bdbdbd")
DEEP: Final = ("#2166ac", "#1b7837")
"""Colours on which digits are white."""


def draw(found: list[Throughput]) -> Figure:
    """Left the rates, right the shares, scenes from left to right and from top to bottom."""
    figure = Figure(figsize=(12.0, 4.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    place = np.arange(len(found))
    for name, colour, shift, values in (
        ("ours, both bounds proven", "#b2182b", -0.2, [one.rate for one in found]),
        ("plain CVXPY, nothing proven", "#2166ac", 0.2, [one.plain for one in found]),
    ):
        bars = left.bar(place + shift, values, 0.38, color=colour, label=name)
        left.bar_label(bars, [f"{value:.0f}" for value in values], fontsize=8)
    left.set_yscale("log")
    left.set_ylim(top=4.0 * max(one.rate for one in found))
    left.set_xticks(place, [one.name.replace(", ", "\n") for one in found], fontsize=8)
    left.set_ylabel("labellings per second and core")
    left.legend(frameon=False, fontsize=8)
    start = np.zeros(len(found))
    for part, colour in zip(PARTS, COLOURS, strict=True):
        share = np.array([100.0 * one.shares[part] for one in found])
        right.barh(place, share, 0.7, left=start, color=colour, label=part)
        for y, x, value in zip(place, start, share, strict=True):
            if value >= 5.0:
                ink = "white" if colour in DEEP else "black"
                right.text(x + 0.5 * value, y, f"{value:.0f}", color=ink, ha="center", va="center", fontsize=8)
        start += share
    right.set_yticks(place, [one.name for one in found], fontsize=8)
    right.invert_yaxis()
    right.set_xlim(0.0, 100.0)
    right.set_xlabel("share of our wall time, %")
    right.legend(loc="upper center", bbox_to_anchor=(0.5, 1.17), ncols=3, frameon=False, fontsize=8)
    return figure


def main() -> None:
    """Measure all scenes and write benchmarks/results/throughput.md and .png."""
    jobs = os.cpu_count() or 1
    found = [measure(name, *case, jobs) for name, case in scenes().items()]
    head = ["scene", "faces", "labellings", "ours, 1/s and core", "plain CVXPY, 1/s and core", "ours / plain"]
    head += [f"{part}, %" for part in PARTS] + ["λ differs by, at most"]
    rows = [
        [
            one.name,
            str(one.faces),
            str(one.asked),
            f"{one.rate:.3g}",
            f"{one.plain:.3g}",
            f"{one.rate / one.plain:.1f}",
            *(f"{100.0 * one.shares[part]:.0f}" for part in PARTS),
            f"{one.apart:.0e}",
        ]
        for one in found
    ]
    save_figure(draw(found), RESULTS / "throughput.png")
    text = about(__doc__)
    note = (
        f"Plain: {jobs} joblib workers. Solver: Clarabel, HiGHS and our own route themselves, set-up, update and run, "
        "for proofs too; proof: projections, slacks, dissipation and repairs; assembly: the numbers of each program; "
        "other Python: handing numbers to solvers and back, choosing routes, the study's loop. Blocks of 2 to 6 cells "
        "(cubes: any)."
    )
    picture = "![Labellings a second and core, and shares of time](throughput.png)"
    parts = ["# Search throughput", text, picture, table(head, rows), note]
    write("throughput", "\n\n".join(parts), also=("joblib",))


if __name__ == "__main__":
    main()
