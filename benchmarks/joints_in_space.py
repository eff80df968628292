"""Measure what moving joints gains in space, beside the virtual experiment: ``python -m benchmarks.joints_in_space``.

A strip of a barrel vault of six voussoirs, and two opposite sectors of a dome with their keystone. Joints turn and
shift within 0.15 m as planes; their 20 and 24 corners slide along the outline, and a row for each joint keeps it plane.
"""

from __future__ import annotations

import itertools
import json
import time
from typing import Any

import numpy as np

from benchmarks.common import about, table, write
from jld_core import Scene, build_assembly, parse_scene, samples
from jld_core.geometry_optimisation.optimise import move_joints
from jld_core.models import solve
from jld_core.samples import Stone
from jld_core.samples.stone import scene_of, swept
from jld_experiment import Joints, run_experiment


def strip(load: str) -> Scene:
    """Return the strip under a load."""
    scene = samples.vault(
        voussoirs=6, courses=1, length=1.0, load="push" if load == "skew push" else load, springing=20.0
    )
    return _with_move(scene, load)


def _with_move(scene: Scene, load: str) -> Scene:
    """Return a scene with the key "move", and with the skew push as load if that is asked for."""
    document: dict[str, Any] = json.loads(scene.model_dump_json(exclude_defaults=True))
    document["move"] = {"box": 0.15}
    if load == "skew push":
        document["loads"] = {"live": [{"body": [1.0, 0.5, 0.0]}]}
    return parse_scene(document)


def lune(load: str) -> Scene:
    """Return two opposite sectors of 22.5° of a dome with a keystone: seven voussoirs that taper to the crown.

    Radius 1.5 m, thickness 0.25 m, from 20° above the springing; sides are meridian planes.
    """
    inner, outer, taper = 1.375, 1.625, float(np.tan(np.radians(11.25)))
    angles = np.radians([0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0, 160.0, 180.0])
    elements = list[dict[str, Any]]()
    for k, (low, high) in enumerate(itertools.pairwise(angles.tolist())):
        ring = ((inner, low), (inner, high), (outer, high), (outer, low))
        corners = np.array([[r * np.cos(a), r * np.sin(a)] for r, a in ring])
        sections = [[[x, side * abs(x) * taper, z] for x, z in corners] for side in (-1.0, 1.0)]
        elements.append(swept(f"v{k}", np.array(sections), **({"support": True} if k in (0, 8) else {})))
    scene = scene_of("sectors of a dome", elements, Stone(), "push" if load == "skew push" else load)
    return _with_move(scene, load)


def main() -> None:
    """Move, test both ends, and write the table."""
    rows = []
    cases = itertools.product((("vault", strip), ("dome", lune)), ("quarter", "skew push"))
    for (name, make), load in cases:
        scene = make(load)
        assembly = build_assembly(scene)
        start = time.perf_counter()
        done = move_joints(scene, assembly, assembly.labels, seconds=60.0)
        seconds = time.perf_counter() - start
        corners = [build_assembly(one) for one in (scene, done.scene)]
        points = [solve(one, one.labels, contact="concave").load_factor for one in corners]
        tests = [" → ".join(f"{value:.5g}" for value in points)]
        for dilation in ("friction", 0.0):
            joints = Joints(dilation=dilation)
            found = [run_experiment(build_assembly(one), joints=joints).collapse_load for one in (scene, done.scene)]
            tests.append(" → ".join(f"{value:.5g}" if np.isfinite(value) else "none found" for value in found))
        values = [f"{done.start:.5g}", f"{done.value:.5g}", f"{done.value / done.start:.3g}"]
        effort = [str(len(done.points) - 1), str(done.points[-1].solves), f"{seconds:.1f}", done.end]
        rows.append([name, load, *values, *tests, *effort])
        print(rows[-1], flush=True)
    head = [
        "structure",
        "load",
        "λ before",
        "λ moved",
        "gain",
        "λ of contact at corners",
        "experiment, dilation as in λ",
        "experiment without dilation",
    ]
    head += ["steps", "solves", "s", "ended"]
    text = 'Loads are in N, pushes in weights. The experiment is accurate to 1 %; "none found": its λ goes on rising.'
    text += " It resists torsion by friction at the corners of joints, as `contact: concave` does: where structures"
    text += " twist, as the dome under the skew push, λ of contact at corners is what to compare it with."
    write("joints_in_space", f"# Joints that move in space\n\n{about(__doc__)}\n\n{text}\n\n{table(head, rows)}")


if __name__ == "__main__":
    main()
