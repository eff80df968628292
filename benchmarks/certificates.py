"""What the pool of certificates saves on whole enumerations, and against the plain way, in one run.

The same enumeration with and without the pool: labellings solved, largest difference of λ, processor time. The
plain way builds the problem in CVXPY anew for each labelling, in as many joblib workers; it is timed on a sample.
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
from jld_core import Scene, build_assembly, load_scene, parse_scene
from jld_explore import explore as exploring
from jld_explore.explore import ExploreSettings
from jld_explore.labelling import from_string

JOBS: Final = 2
SAMPLE: Final = 300


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


def _run(scene: Scene, certificates: bool) -> tuple[pd.DataFrame, int, float]:
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", jobs=JOBS, certificates=certificates)
        start = time.perf_counter()
        done = exploring.explore(scene, Path(folder) / "out", settings)
        # what pictures and tables take is the same for both
        seconds = float(done.summary["seconds"])
        assert seconds <= time.perf_counter() - start
    return done.results.set_index("labelling").sort_index(), int(done.summary["solved"]), seconds


def main() -> None:
    """Enumerate every scene both ways, then time the plain way on a sample."""
    rows = []
    for name, scene in _scenes().items():
        pooled, solved, quick = _run(scene, True)
        plain, every, slow = _run(scene, False)
        assert (pooled["status"] == plain["status"]).all()
        one, other = pooled["load_factor"].to_numpy(float), plain["load_factor"].to_numpy(float)
        known = np.isfinite(other)
        floor = 1e-3 * float(np.nanmax(abs(other)))
        apart = float((abs(one - other)[known] / np.maximum(abs(other[known]), floor)).max())
        assembly = build_assembly(scene)
        standing = pooled.index[known]
        sample = standing[:: max(1, len(standing) // SAMPLE)][:SAMPLE]
        labellings = [from_string(text) for text in sample]
        with joblib.Parallel(n_jobs=JOBS) as pool:
            pool(joblib.delayed(stated)(assembly, labels) for labels in labellings[: 4 * JOBS])
            start = time.perf_counter()
            pool(joblib.delayed(stated)(assembly, labels) for labels in labellings)
            each = (time.perf_counter() - start) / len(labellings)
        rows.append(
            [
                name,
                str(len(pooled)),
                str(every),
                str(solved),
                f"{every / solved:.1f}",
                f"{1.0 - solved / every:.0%}",
                f"{apart:.0e}",
                f"{slow:.1f}",
                f"{quick:.1f}",
                f"{len(pooled) * each:.0f}",
                f"{len(pooled) * each / quick:.0f}",
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
    ]
    note = f"A solve with the pool is up to three linear programs. {JOBS} workers everywhere."
    write("certificates", f"# Certificates on whole enumerations\n\n{table(head, rows)}\n\n{note}")


if __name__ == "__main__":
    main()
