"""What the instructions of a processor, its linear algebra and threads change in digits of experiments and of λ.

``python -m benchmarks.experiment_digits`` runs the same experiments and the same search in processes whose compiled
parts are those of other machines. Other operating systems, C libraries and processor families cannot be tried here.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from typing import Any, Final

import numpy as np
from studies.scenes import leonardo_flat_arch, stacked_cubes

from benchmarks.common import ROOT, about, table, write
from jld_core import build_assembly, load_scene
from jld_experiment import Joints, Settings, run_experiment
from jld_explore import ExploreSettings, explore

VECTORS: Final = "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"
"""Instructions beyond SSE 4.2 among which NumPy chooses when it is loaded."""

MACHINES: Final[tuple[tuple[str, dict[str, str]], ...]] = (
    ("this machine", {}),
    ("one thread of BLAS", {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}),
    ("two threads of BLAS", {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}),
    ("BLAS for a processor of 2013 (Haswell)", {"OPENBLAS_CORETYPE": "Haswell"}),
    ("BLAS for a processor without AVX (Nehalem)", {"OPENBLAS_CORETYPE": "Nehalem"}),
    ("NumPy without AVX2 and AVX-512", {"NPY_DISABLE_CPU_FEATURES": VECTORS}),
    ("batch solver for AVX2", {"JLD_KERNEL": "avx2"}),
    ("batch solver for any x86-64 processor", {"JLD_KERNEL": "base"}),
    ("time steps compiled for any x86-64 processor", {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}),
)
"""Machines by name, as environment variables."""

EXPERIMENTS: Final = ("planar", "planar, moving geometry", "spatial")
LAYOUTS: Final = 300
"""Labellings of the beam-arch whose λ are compared."""


def digest() -> dict[str, Any]:
    """Return a hash of all digits of each experiment, brittle and without dilation, and λ in brackets by labelling."""
    flat = build_assembly(leonardo_flat_arch())
    cubes = build_assembly(stacked_cubes(2, friction=0.7, tension=1.0, shear=1.0, base="dry", direction=0.3))
    short = Settings(periods=20.0)
    found: dict[str, Any] = {}
    for name, assembly, settings in zip(
        EXPERIMENTS, (flat, flat, cubes), (short, Settings(periods=20.0, moving=True), short), strict=True
    ):
        curve = run_experiment(assembly, joints=Joints(), settings=settings)
        arrays = (curve.distance, curve.load_factor, curve.at_end, curve.energy_error)
        found[name] = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()[:16]
    asked = ExploreSettings(driver="random", budget=LAYOUTS, seed=0, pictures=False, check_fields=0)
    results = explore(load_scene(ROOT / "scenes" / "flat_beam_arch.json"), None, asked).results
    brackets = results[["bracket_lo", "load_factor", "bracket_hi"]].astype(float).to_numpy().tolist()
    return found | {"λ": dict(zip(results["labelling"], brackets, strict=True))}


def on(changed: dict[str, str]) -> dict[str, Any]:
    """Return `digest` of a process with changed environment variables."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, **changed}
        if "NUMBA_CPU_NAME" in changed:
            environment["NUMBA_CACHE_DIR"] = cache
        code = "import json; from benchmarks.experiment_digits import digest; print(json.dumps(digest()))"
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
        )
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def compared(found: dict[str, list[float]], first: dict[str, list[float]]) -> tuple[str, str]:
    """Return in words how many λ differ and by how much, relatively, and how many brackets share no number."""
    if found.keys() != first.keys():
        return "other layouts", "–"
    ours, theirs = np.array(list(found.values())), np.array([first[key] for key in found])
    finite = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
    ours, theirs = ours[finite], theirs[finite]
    apart = np.abs(ours[:, 1] - theirs[:, 1]) / np.maximum(np.abs(theirs[:, 1]), 1e-300)
    parted = int((np.maximum(ours[:, 0], theirs[:, 0]) > np.minimum(ours[:, 2], theirs[:, 2])).sum())
    return f"{int((apart > 0.0).sum())} of {len(apart)}, by {apart.max():.0e} at most", f"{parted}"


def main() -> None:
    """Run all machines and write the page."""
    rows: list[list[str]] = []
    first: dict[str, Any] = {}
    for name, changed in MACHINES:
        found = on(changed)
        first = first or found
        changes, meet = compared(found["λ"], first["λ"])
        rows.append([name, *(found[one] for one in EXPERIMENTS), changes, meet])
        print(rows[-1], flush=True)
    same = all(row[1:4] == rows[0][1:4] for row in rows)
    write(
        "experiment_digits",
        "\n\n".join(
            [
                "# Digits on other machines",
                about(__doc__),
                "Hashes of all digits of three experiments, and relative differences of λ of "
                f"{len(first['λ'])} layouts of the beam-arch from the first row.",
                table(["machine", *EXPERIMENTS, "λ that differ", "brackets that share no λ"], rows),
                "All experiments have the same digits." if same else "Digits of experiments differ.",
                "Not tried, for want of such machines: processors of other families (ARM), other operating systems and "
                "C libraries (sines and cosines of moving geometry), other versions of the compilers.",
            ]
        ),
        ("numba",),
    )


if __name__ == "__main__":
    main()
