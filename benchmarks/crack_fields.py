"""How fast blocks are bounded by fields: one layout to a gap, a wall to a gap, and many layouts on the coarsest mesh.

Processor time on one core, each row in a process that has imported everything. To a gap: the whole of
`bounds_by_fields`, from the assembly to the bracket, on adaptive meshes. Many layouts: both bounds on four triangles a
cell, programs set up once, after the first hundred, sixteen together (mean) or one at a time (median); layouts of the
flagship's search drawn at random, and random segmentations of the wall. Race: a whole search of the flagship by fields,
over its number of layouts.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT, about, random_segmentations, scene, table, write
from benchmarks.scenes import bonded
from jld_core import Assembly, build_assembly, load_scene, parse_scene
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.fields.adaptive import CoarseBounds, FieldSetting
from jld_core.scene import parse_cracks
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string

BEST: Final = "iiidididddddiididdidiiid"
"""Labels of the flagship's layout that is strongest by its own faces."""
WARM: Final = 100
"""Layouts bounded before times are taken."""
TIMED: Final = 100
"""Layouts whose times are taken."""
TOGETHER: Final = 16
"""Layouts that are bounded together, as by an evaluator."""


def masonry(strength: float = 20e3) -> Assembly:
    """A wall of 48 cells of 0.4 × 0.2 m in running bond under a horizontal body load; strength in Pa."""
    document: dict[str, Any] = {
        "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": bonded(["aaaaaaaa"] * 6 + ["########"])},
        "materials": {
            "density": 2000,
            "dry": {"friction_coefficient": 0.75},
            "inner": {"tensile_strength": strength, "shear_strength": strength},
        },
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return build_assembly(parse_scene(document))


def flagship() -> tuple[Assembly, Bits, Bits]:
    """The beam-arch, labels of its best layout by faces, and labels without cuts."""
    assembly = scene("flat_beam_arch")
    return assembly, from_string(BEST), ~assembly.free_faces


def to_gap(name: str, assembly: Assembly, labels: Bits, gap: float, goal: float) -> list[str]:
    """One row: a layout until its bracket is as narrow as a gap."""
    start = time.process_time()
    found = bounds_by_fields(assembly, labels, gap=gap, seconds=40.0 * goal)
    seconds = time.process_time() - start
    bracket = f"{found.lower:.4g} {found.upper:.4g}"
    meshes = f"{found.triangles} in {len(found.history)} meshes"
    return [name, f"{100 * found.gap:.2f} %", bracket, meshes, f"**{seconds:.2f} s**", f"{goal:g} s"]


def admissible() -> Bits:
    """Layouts of the flagship's search, drawn at random."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
        done = explore(load_scene(ROOT / "scenes" / "flat_beam_arch.json"), Path(folder) / "search", settings)
    rows = np.random.default_rng(3).permutation(len(done.results))[: WARM + TIMED]
    return np.array([from_string(str(text)) for text in done.results["labelling"].iloc[rows]])


def of_wall(wall: Assembly) -> Bits:
    """Layouts of the wall, drawn at random."""
    return random_segmentations(wall, WARM + TIMED, seed=3)


def race(goal: float) -> list[str]:
    """One row: the time of a race over all layouts of the flagship, for each of them."""
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json").model_copy(update={"cracks": parse_cracks("fields")})
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        done = explore(scene, Path(folder) / "search", ExploreSettings(jobs=1, pictures=False))
        seconds = time.process_time() - start
    facts, count = done.summary.facts, len(done.results)
    bracket = f"{facts['best']:.4g} {facts['bound']:.4g}"
    programs = f"{facts['race']['programs']} programs, {seconds:.0f} s"
    name = f"flagship, race of {count} layouts, a layout"
    return [
        name,
        f"{100 * facts['gap']:.2f} %",
        bracket,
        programs,
        f"**{1e3 * seconds / count:.1f} ms**",
        f"{1e3 * goal:g} ms",
    ]


def many(name: str, assembly: Assembly, labellings: Bits, goal: float) -> list[str]:
    """One row: both bounds of many layouts on the coarsest mesh, several at a time as an evaluator has them."""
    coarse = CoarseBounds(FieldSetting.of(assembly))
    coarse.both(labellings[:WARM])
    start = time.process_time()
    for first in range(WARM, WARM + TIMED, TOGETHER):
        low, high = coarse.both(labellings[first : first + TOGETHER])
        if (low > np.where(high > 0.0, high * (1.0 + 1e-9), np.inf)).any():
            raise AssertionError(f"lower bounds {low} above upper bounds {high}")
    each = 1e3 * (time.process_time() - start) / TIMED
    return _row(name, assembly, each, goal)


def alone(name: str, assembly: Assembly, labellings: Bits, goal: float) -> list[str]:
    """One row: both bounds of many layouts on the coarsest mesh, one at a time as a race asks for them."""
    coarse = CoarseBounds(FieldSetting.of(assembly))
    times = []
    for labels in labellings:
        start = time.process_time()
        low, high = coarse.lower(labels)[0], coarse.upper(labels)[0]
        times.append(time.process_time() - start)
        if low > high * (1.0 + 1e-9) and high > 0.0:
            raise AssertionError(f"lower bound {low} above upper bound {high}")
    return _row(name, assembly, 1e3 * float(np.median(times[WARM:])), goal)


def _row(name: str, assembly: Assembly, each: float, goal: float) -> list[str]:
    """One row of many layouts: milliseconds for each, and the aim in seconds."""
    triangles = len(FieldSetting.of(assembly).coarse)
    return [name, "–", "–", f"{triangles} in 1 mesh", f"**{each:.1f} ms**", f"{1e3 * goal:g} ms"]


def rows() -> dict[str, Callable[[], list[str]]]:
    """What is measured, by name."""
    assembly, best, uncut = flagship()
    wall = masonry()
    return {
        "flagship, best by faces, to 5 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.05, 5.0),
        "flagship, best by faces, to 2 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.02, 60.0),
        "flagship, uncut, to 5 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.05, 5.0),
        "flagship, uncut, to 2 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.02, 60.0),
        "wall of 48 cells, to 5 %": lambda: to_gap("wall of 48 cells", wall, wall.labels, 0.05, 20.0),
        "flagship, many layouts": lambda: many("flagship, a layout of many", assembly, admissible(), 0.01),
        "flagship, layouts alone": lambda: alone("flagship, one layout at a time", assembly, admissible(), 0.01),
        "wall, many layouts": lambda: many("wall of 48 cells, a layout of many", wall, of_wall(wall), 0.032),
        "wall, layouts alone": lambda: alone("wall of 48 cells, one layout at a time", wall, of_wall(wall), 0.032),
        "flagship, race": lambda: race(0.01),
    }


def main() -> None:
    """Measure and write benchmarks/results/crack_fields.md; names on the command line choose rows and write nothing."""
    wanted, known = sys.argv[1:], rows()
    found = [measured() for name, measured in known.items() if not wanted or any(part in name for part in wanted)]
    text = table(["what", "gap reached", "bracket", "triangles", "processor time", "aim"], found)
    if wanted:
        print(text)
    else:
        write("crack_fields", f"# Speed of bounds by fields\n\n{about(__doc__)}\n\n{text}")


if __name__ == "__main__":
    main()
