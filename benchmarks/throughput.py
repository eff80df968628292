"""Labellings per second and core by grid size, and the plain way beside it in the same run.

Ours: a study with the random driver in one process, from the first labelling asked to the last one on disk, both
bounds proven. Plain: the problem stated in CVXPY anew for each labelling (Clarabel, default tolerances) in joblib
workers, which proves nothing, on a sample of the same labellings. Rates are per second of processor time, so per
core.
"""

from __future__ import annotations

import os
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import joblib
import numpy as np

from benchmarks.common import ROOT, about, stated, table, write
from benchmarks.scenes import GRIDS, cubes, grid
from jld_core import Assembly, Scene, Status, build_assembly, load_scene
from jld_core.arrays import Bits, Floats
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_explore.evaluation.protocol import evaluation_of
from jld_explore.search.settings import ExploreSettings
from jld_explore.search.study import Study
from jld_explore.space import unpack


@dataclass(frozen=True)
class Throughput:
    """One scene: labellings a second and core, ours and plain; most that λ differs."""

    name: str
    faces: int
    asked: int
    rate: float
    plain: float
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


def run(scene: Scene, assembly: Assembly, asked: int) -> tuple[float, Bits, Floats]:
    """Processor seconds of a study, its labellings (k, m), and their λ, NaN where they do not collapse."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study(
            scene=scene,
            assembly=assembly,
            space=(space := search_space(scene, assembly)),
            driver=make_driver("random", space, 0),
            folder=Path(folder),
            settings=ExploreSettings(budget=asked),
        )
        start = time.process_time()
        study.run()
        spent = time.process_time() - start
        rows = study.records.rows
        labellings = unpack(rows["labelling"], len(assembly.interfaces))
        found = [evaluation_of(row) for row in rows]
    values = [e.load_factor if e.status is Status.COLLAPSE else np.nan for e in found]
    return spent, labellings, np.array(values)


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
    """Ours and plain, one after the other."""
    assembly = build_assembly(scene)
    run(scene, assembly, min(asked, 8))
    spent, labellings, values = run(scene, assembly, asked)
    chosen = np.linspace(0, len(labellings) - 1, min(sample, len(labellings))).astype(int)
    rate, others = plainly(assembly, labellings[chosen], jobs)
    known = np.isfinite(values[chosen]) & np.isfinite(others)
    ours, theirs = values[chosen][known], others[known]
    apart = float((abs(ours - theirs) / abs(ours)).max()) if known.any() else np.nan
    faces = len(assembly.interfaces)
    return Throughput(name, faces, len(labellings), len(labellings) / spent, rate, apart)


def main() -> None:
    """Measure all scenes and write benchmarks/results/throughput.md."""
    jobs = os.cpu_count() or 1
    rows = []
    for name, case in scenes().items():
        one = measure(name, *case, jobs)
        rates = [f"{one.rate:.3g}", f"{one.plain:.3g}", f"{one.rate / one.plain:.1f}"]
        rows.append([one.name, str(one.faces), str(one.asked), *rates, f"{one.apart:.0e}"])
    head = "scene | faces | labellings | ours, 1/s and core | plain CVXPY, 1/s and core | ours / plain | "
    head += "λ differs by, at most"
    note = f"Plain: {jobs} joblib workers. Blocks of 2 to 6 cells (cubes: any)."
    parts = ["# Search throughput", about(__doc__), table(head, rows), note]
    write("throughput", "\n\n".join(parts), also=("joblib",))


if __name__ == "__main__":
    main()
