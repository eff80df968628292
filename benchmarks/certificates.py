"""What the pool of certificates saves on whole enumerations, and against the plain way, in one run.

The same enumeration with and without the pool: labellings solved, largest difference of λ, time by the clock from
the first labelling asked to the last table made, start of workers included. The plain way builds the problem in CVXPY
anew for each labelling, in as many joblib workers, which run already; it is timed on a sample. All three are timed in
turn, several times over. Processor time besides, which others at work on the machine change least: the whole command
with the pool, building and tables included, against the statements and solves alone of the plain way.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import joblib
import numpy as np
import pandas as pd

from benchmarks.common import ROOT, table, write
from benchmarks.stated import stated
from jld_core import Assembly, Scene, build_assembly, load_scene, parse_scene
from jld_core.arrays import Bits
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string

JOBS: Final = 2
SAMPLE: Final = 300
TURNS: Final = 3


def _wall() -> Scene:
    document: dict[str, Any] = {
        "name": "wall 5 × 3",
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["aaaaa"] * 3 + ["#####"]},
        "materials": {
            "density": 1400,
            "dry": {"friction_coefficient": 0.75},
            "inner": {"tensile_strength": 2e4, "shear_strength": 2e4},
        },
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"block_cells": [2, 5]},
    }
    return parse_scene(document)


def _scenes() -> dict[str, Scene]:
    flagship = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    document = json.loads(flagship.model_dump_json(exclude_defaults=True))
    document["search"]["symmetry"] = "none"
    return {
        "flagship": flagship,
        "flagship, symmetry not used": parse_scene(document),
        "wall 5 × 3, blocks of 2 to 5, 20 kPa": _wall(),
    }


def _run(scene: Scene, certificates: bool) -> tuple[pd.DataFrame, int, float, float]:
    """Table, labellings solved, seconds by the clock, processor seconds of this process."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(pictures=False, driver="enumeration", jobs=JOBS, certificates=certificates)
        start = time.process_time()
        done = explore(scene, Path(folder) / "out", settings)
        spent = time.process_time() - start
    table_ = done.results.set_index("labelling").sort_index()
    return table_, int(done.summary.solved), float(done.summary.seconds), spent


def _timed(assembly: Assembly, labels: Bits) -> float:
    """Processor seconds of one labelling the plain way."""
    start = time.process_time()
    stated(assembly, labels)
    return time.process_time() - start


def _plainly(assembly: Assembly, labellings: list[Bits]) -> tuple[float, float]:
    """Seconds by the clock and processor seconds for each labelling the plain way."""
    with joblib.Parallel(n_jobs=JOBS) as pool:
        pool(joblib.delayed(_timed)(assembly, labels) for labels in labellings[: 4 * JOBS])
        start = time.perf_counter()
        spent = pool(joblib.delayed(_timed)(assembly, labels) for labels in labellings)
        return (time.perf_counter() - start) / len(labellings), sum(spent) / len(labellings)


def _apart(pooled: pd.DataFrame, plain: pd.DataFrame) -> float:
    """Largest relative difference of λ; what is settled with certificates has the same status as what is solved."""
    assert (pooled["status"] == plain["status"]).all()
    one, other = pooled["load_factor"].to_numpy(float), plain["load_factor"].to_numpy(float)
    known = np.isfinite(other)
    floor = 1e-3 * float(np.nanmax(abs(other)))
    return float((abs(one - other)[known] / np.maximum(abs(other[known]), floor)).max())


def main() -> None:
    """Enumerate every scene both ways, and time the plain way on a sample, in turn."""
    rows = []
    for name, scene in _scenes().items():
        assembly = build_assembly(scene)
        times = np.empty((TURNS, 5))
        for turn in range(TURNS):
            pooled, solved, times[turn, 0], times[turn, 3] = _run(scene, True)
            plain, every, times[turn, 1], _ = _run(scene, False)
            standing = plain.index[np.isfinite(plain["load_factor"].to_numpy(float))]
            sample = standing[:: max(1, len(standing) // SAMPLE)][:SAMPLE]
            times[turn, [2, 4]] = len(plain) * np.array(_plainly(assembly, [from_string(text) for text in sample]))
        quick, slow, stating, spent, spent_stating = np.median(times, axis=0)
        ratios = times[:, 2] / times[:, 0]
        rows.append(
            [
                name,
                str(len(pooled)),
                str(every),
                str(solved),
                f"{every / solved:.1f}",
                f"{1.0 - solved / every:.0%}",
                f"{_apart(pooled, plain):.0e}",
                f"{slow:.1f}",
                f"{quick:.1f}",
                f"{stating:.0f}",
                f"{np.median(ratios):.0f} ({ratios.min():.0f} to {ratios.max():.0f})",
                f"{spent:.1f}",
                f"{spent_stating:.0f}",
                f"{spent_stating / spent:.0f}",
            ]
        )
    head = [
        "scene",
        "classes",
        "solves without",
        "solves with",
        "times fewer",
        "settled",
        "largest difference of λ",
        "s without",
        "s with",
        "s plain CVXPY (from a sample)",
        "plain / with",
        "processor s with",
        "processor s plain",
        "plain / with, processor",
    ]
    note = (
        f"{JOBS} workers everywhere; medians of {TURNS} turns by the clock, in brackets the range. With the pool these "
        "scenes are solved by two threads of one process: a labelling is solved sooner than it is sent."
    )
    write("certificates", f"# Certificates on whole enumerations\n\n{table(head, rows)}\n\n{note}")


if __name__ == "__main__":
    main()
