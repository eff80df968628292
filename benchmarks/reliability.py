"""Reliability: closed forms by both methods, and the time of samples of a layout of 88 faces.

Run ``python -m benchmarks.reliability``. A sliding block has the limit state μ W − H. Its index is known for normal and
for lognormal friction and push. The wall of 88 faces has shared values, or values of each face on its own.
"""

from __future__ import annotations

import math
import time
from typing import Any, Final

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.scenes import LARGE
from jld_core import build_assembly, parse_scene
from jld_core.batch.library import described
from jld_core.limit.analysis import LimitAnalysis
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_practice.reliability import ReliabilityOptions, analyse, random_structure

SAMPLES: Final = 100_000
"""Samples of every row."""

WEIGHT: Final = 2000.0 * 9.81
"""Weight of the sliding block, N."""


def vary(mean: Any, cov: float, kind: str = "lognormal", **more: Any) -> dict[str, Any]:
    """Return a value with uncertainty."""
    return {"mean": mean, "cov": cov, "kind": kind, **more}


def block(kind: str, push: float) -> dict[str, Any]:
    """Return a block of 1 × 2 that slides."""
    return {
        "elements": [
            {"id": "ground", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
            {"id": "block", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]], "weight": WEIGHT},
        ],
        "materials": {"dry": {"friction_coefficient": vary(0.6, 0.1, kind)}},
        "loads": {"live": [{"element": "block", "force": vary([push, 0.0], 0.2, kind), "at": [1.0, 0.1]}]},
    }


def exact(kind: str, push: float) -> float:
    """Return the index of the sliding block: Hasofer and Lind (1974); Rackwitz and Fiessler (1978)."""
    resistance = 0.6 * WEIGHT
    if kind == "normal":
        return (resistance - push) / math.hypot(0.1 * resistance, 0.2 * push)
    one, two = math.log(1.01), math.log(1.04)
    return (math.log(resistance / push) - 0.5 * (one - two)) / math.sqrt(one + two)


def wall(each: bool) -> dict[str, Any]:
    """Return the wall of 88 faces with lognormal friction, strengths and loads. each: faces have their own values."""
    scene = LARGE["planar 88 faces"]()
    document = scene if isinstance(scene, dict) else scene.model_dump(mode="json", exclude_defaults=True)
    own: dict[str, Any] = {"each": True} if each else {}
    document["materials"] |= {
        "density": vary(1400.0, 0.05, "normal"),
        "dry": {"friction_coefficient": vary(0.6, 0.1, **own)},
        "inner": {"tensile_strength": vary(2e5, 0.2, **own), "shear_strength": vary(2e4, 0.2)},
    }
    document["loads"]["live"] = [{"element": name, "force": vary([0.0, -1.0], 0.2)} for name in ("c3r0", "c4r0")]
    return dict(document)


def of_wall(each: bool, share: float) -> list[str]:
    """Return the row of the strongest of 40 random layouts. share: required λ over that of the means."""
    scene = parse_scene(wall(each))
    assembly = build_assembly(scene)
    layouts = make_driver("random", search_space(scene, assembly), 1).ask(40)
    analysis = LimitAnalysis(assembly)
    assert analysis.batch is not None
    low = analysis.batch.solve(layouts).low
    best = int(np.argmax(low))
    structure = random_structure(scene)
    required = share * float(low[best]) * analysis.template.scaling.load
    clock, processor = time.perf_counter(), time.process_time()
    found = analyse(structure, layouts[best], ReliabilityOptions(required, SAMPLES, 0, 2))
    seconds = time.perf_counter() - clock, time.process_time() - processor
    form, simulation = found.form, found.simulation
    return [
        f"88 faces, {len(structure.variables)} variables{', at a kink' if form.kink else ''}",
        "–",
        f"{form.beta:.4f}",
        f"{simulation.beta or math.nan:.4f}",
        f"{simulation.failures}",
        f"{simulation.resolved}, {simulation.undecided}",
        f"{seconds[1]:.1f} ({seconds[0]:.1f})",
    ]


def of_block(kind: str, push: float) -> list[str]:
    """Return the row of a sliding block."""
    structure = random_structure(parse_scene(block(kind, push)))
    clock, processor = time.perf_counter(), time.process_time()
    found = analyse(structure, structure.assembly.labels, ReliabilityOptions(1.0, SAMPLES, 0, 2))
    seconds = time.perf_counter() - clock, time.process_time() - processor
    simulation = found.simulation
    return [
        f"sliding block, {kind}, {push:g} N",
        f"{exact(kind, push):.4f}",
        f"{found.form.beta:.4f}",
        f"{simulation.beta or math.nan:.4f}",
        f"{simulation.failures}",
        f"{simulation.resolved}, {simulation.undecided}",
        f"{seconds[1]:.1f} ({seconds[0]:.1f})",
    ]


def main() -> None:
    """Compute all rows and write the table."""
    rows = [of_block(kind, push) for kind in ("normal", "lognormal") for push in (6000.0, 9000.0)]
    rows += [of_wall(each, share) for each in (False, True) for share in (0.65, 0.45)]
    head = ["structure", "β exact", "β first order", "β simulation", "failures", "solved again, undecided"]
    head += ["processor s (clock)"]
    text = f"{SAMPLES} samples each, two threads. {described().capitalize()}."
    write("reliability", "\n\n".join(["# Reliability", about(__doc__), table(head, rows), text]))


if __name__ == "__main__":
    main()
