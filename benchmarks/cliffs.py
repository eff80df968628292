"""What leaves the batch solver, beside the same scene that does not: time of a layout and λ.

Random layouts of spatial scenes, evaluated as a search does. `crushing`: inner faces with a compressive strength that
no layout reaches. `strong`: inner faces of 5 MPa instead of 20 kPa, the same layouts; λ is another. `corners`: prisms
on faces of sixteen corners instead of eight. Times are processor seconds of one layout, the least of three runs; ratio:
over the scene without.
"""

from __future__ import annotations

import json
import math
import time
from typing import Any, Final

import numpy as np

from benchmarks.common import about, random_segmentations, table, write
from benchmarks.scenes import ANGLE, cubes, strength
from jld_core import Assembly, build_assembly, parse_scene
from jld_core.arrays import Bits
from jld_explore.evaluation import Evaluator, EvaluatorSettings

LAYOUTS: Final = 24
RUNS: Final = 3


def column(corners: int, drums: int = 12) -> dict[str, Any]:
    """A column of drums, regular prisms of 1 m across and 0.3 m high, pushed sideways."""
    angle = 2.0 * math.pi * np.arange(corners) / corners
    ring = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    around = [[k, (k + 1) % corners, (k + 1) % corners + corners, k + corners] for k in range(corners)]
    faces = [list(range(corners))[::-1], list(range(corners, 2 * corners)), *around]
    elements = []
    for level in range(drums + 1):
        vertices = [[x, y, 0.3 * (level + up)] for up in (0, 1) for x, y in ring.tolist()]
        elements.append(
            {"id": f"d{level}", "vertices": vertices, "faces": faces, **({} if level else {"support": True})}
        )
    materials = {"density": 1400, "dry": ANGLE, "inner": strength(2e4)}
    return {"elements": elements, "materials": materials, "loads": {"live": [{"body": [1, 0, 0]}]}}


def pairs() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Scenes without and with what leaves the batch solver, by name."""
    found = {}
    for side in (3, 4):
        plain = json.loads(cubes(side).model_dump_json(exclude_defaults=True))
        crushing = json.loads(json.dumps(plain))
        crushing["materials"]["inner"]["compressive_strength"] = 1e7
        found[f"crushing, {side}³ cubes"] = (plain, crushing)
        strong = json.loads(json.dumps(plain))
        strong["materials"]["inner"] |= {"tensile_strength": 5e6, "shear_strength": 5e6}
        found[f"strong, {side}³ cubes"] = found[f"strong, {side}³ cubes, few blocks"] = (plain, strong)
    return {**found, "corners, column of 12 drums": (column(8), column(16))}


def few_blocks(assembly: Assembly) -> Bits:
    """Labels (k, m) of layouts in two to eight blocks, cut by one to three planes through the middle."""
    random, centre = np.random.default_rng(0), assembly.elements.centroid
    found = []
    for _ in range(LAYOUTS):
        side = np.zeros(len(centre), dtype=int)
        for _ in range(random.integers(1, 4)):
            place = centre - centre.mean(axis=0) + 0.1 * random.normal(size=3)
            side = 2 * side + (place @ random.normal(size=3) > 0.0)
        found.append(side[assembly.interfaces.a] != side[assembly.interfaces.b])
    return np.array(found)


def measured(assembly: Assembly, name: str) -> tuple[float, float]:
    """Seconds of a layout, and the mean λ."""
    evaluator = Evaluator(assembly, EvaluatorSettings())
    labellings = few_blocks(assembly) if "few blocks" in name else random_segmentations(assembly, LAYOUTS, 1)
    times, loads = [], [math.nan]
    for _ in range(RUNS):
        start = time.process_time()
        loads = [one.load_factor for one in evaluator.evaluate_all(labellings)]
        times.append((time.process_time() - start) / LAYOUTS)
    return min(times), float(np.nanmean(loads))


def main() -> None:
    """Measure every pair in this process, and write the table."""
    rows = []
    for name, documents in pairs().items():
        (plain, first), (other, second) = (measured(build_assembly(parse_scene(one)), name) for one in documents)
        rows.append([name, f"{1e3 * plain:.3g}", f"{1e3 * other:.3g}", f"{other / plain:.2f}", f"{second / first:.9f}"])
        print(rows[-1], flush=True)
    head = "pair | ms without | ms with | ratio | λ with / without"
    write("cliffs", f"# Where the batch solver ends\n\n{about(__doc__)}\n\n{table(head, rows)}")


if __name__ == "__main__":
    main()
