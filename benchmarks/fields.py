"""Bounds by fields: how fast they are, and how wide in space.

`python -m benchmarks.fields [speed|space]` writes a table for each part.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import about, random_segmentations, run_parts, table, write
from benchmarks.scenes import ENUMERATED, bonded, grid, stones, strength
from jld_core import Assembly, build_assembly, parse_scene, samples, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import CoarseBounds, FieldSetting
from jld_core.scene.cracks import FieldCracks
from jld_core.threads import one_thread
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string
from jld_samples import box

BEST: Final = "iiidididddddiididdidiiid"  # labels of the flagship's layout that is strongest by its own faces
WARM: Final = 100  # layouts bounded before times are taken
TIMED: Final = 100  # layouts whose times are taken
TOGETHER: Final = 16  # layouts that are bounded together, as by an evaluator


def masonry(strong: float = 20e3) -> Assembly:
    """A wall of 48 cells of 0.4 × 0.2 m in running bond under a horizontal body load; strength in Pa."""
    rows = bonded(["aaaaaaaa"] * 6 + ["########"])
    dry = {"friction_coefficient": 0.75}
    return build_assembly(grid(rows, None, strength(strong), cell=(0.4, 0.2), thickness=0.2, density=2000, dry=dry))


def to_gap(name: str, assembly: Assembly, labels: Bits, gap: float, goal: float) -> list[str]:
    """One row: a layout until its bracket is as narrow as a gap."""
    start = time.process_time()
    found = bounds_by_fields(assembly, labels, gap=gap, seconds=40.0 * goal)
    seconds = time.process_time() - start
    bracket = f"{found.lower:.4g} {found.upper:.4g}"
    meshes = f"{found.simplices} in {len(found.history)} meshes"
    return [name, f"{100 * found.gap:.2f} %", bracket, meshes, f"**{seconds:.2f} s**", f"{goal:g} s"]


def admissible() -> Bits:
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
        done = explore(ENUMERATED["flagship"](), Path(folder) / "search", settings)
    timed_rows = np.random.default_rng(3).permutation(len(done.results))[: WARM + TIMED]
    return np.array([from_string(str(text)) for text in done.results["labelling"].iloc[timed_rows]])


def race_all(goal: float) -> list[str]:
    """One row: the time of a race over all layouts of the flagship, for each of them."""
    beam = ENUMERATED["flagship"]().model_copy(update={"cracks": FieldCracks(kind="fields", gap=0.05)})
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        done = explore(beam, Path(folder) / "search", ExploreSettings(jobs=1, pictures=False))
        seconds = time.process_time() - start
    facts, count = done.summary.facts, len(done.results)
    bracket = f"{facts['best']:.4g} {facts['bound']:.4g}"
    programs = f"{facts['race']['programs']} programs, {seconds:.0f} s"
    name = f"flagship, race of {count} layouts, a layout"
    each = f"**{1e3 * seconds / count:.1f} ms**"
    return [name, f"{100 * facts['gap']:.2f} %", bracket, programs, each, f"{1e3 * goal:g} ms"]


def bound_many(name: str, assembly: Assembly, labellings: Bits, goal: float) -> list[str]:
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


def bound_alone(name: str, assembly: Assembly, labellings: Bits, goal: float) -> list[str]:
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
    triangles = len(FieldSetting.of(assembly).coarse)
    return [name, "–", "–", f"{triangles} in 1 mesh", f"**{each:.1f} ms**", f"{1e3 * goal:g} ms"]


def timed_rows() -> dict[str, Callable[[], list[str]]]:
    assembly, wall = build_assembly(ENUMERATED["flagship"]()), masonry()
    best, uncut = from_string(BEST), ~assembly.free_faces
    drawn = partial(random_segmentations, count=WARM + TIMED, seed=3)
    return {
        "flagship, best by faces, to 5 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.05, 5.0),
        "flagship, best by faces, to 2 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.02, 60.0),
        "flagship, uncut, to 5 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.05, 5.0),
        "flagship, uncut, to 2 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.02, 60.0),
        "wall of 48 cells, to 5 %": lambda: to_gap("wall of 48 cells", wall, wall.labels, 0.05, 20.0),
        "flagship, many layouts": lambda: bound_many("flagship, a layout of many", assembly, admissible(), 0.01),
        "flagship, layouts alone": lambda: bound_alone("flagship, one layout at a time", assembly, admissible(), 0.01),
        "wall, many layouts": lambda: bound_many("wall of 48 cells, a layout of many", wall, drawn(wall), 0.032),
        "wall, layouts alone": lambda: bound_alone("wall of 48 cells, one at a time", wall, drawn(wall), 0.032),
        "flagship, race": lambda: race_all(0.01),
    }


def speed() -> None:
    """How fast blocks are bounded by fields: one layout or a wall to a gap, many layouts on the coarsest mesh.

    Processor time on one core, each row in a process that has imported everything. To a gap: the whole of
    `bounds_by_fields`, from the assembly to the bracket, on adaptive meshes. Many layouts: both bounds on four
    triangles a cell, programs set up once, after the first hundred, sixteen together (mean) or one at a time (median);
    layouts of the flagship's search drawn at random, and random segmentations of the wall. Race: a whole search of the
    flagship by fields, over its number of layouts. Names on the command line choose rows and write nothing.
    """
    wanted, known = sys.argv[1:], timed_rows()
    found = [measured() for name, measured in known.items() if not wanted or any(part in name for part in wanted)]
    text = table("what | gap reached | bracket | triangles | processor time | aim", found)
    if wanted:
        print(text)
    else:
        write("crack_fields", "# Speed of bounds by fields", about(speed.__doc__), text)


SPACE_GAP: Final = 0.15  # relative width at which refinement ends


@dataclass(frozen=True)
class Case:
    """One structure: name, what it is, how it is built, λ in closed form, and tetrahedra that no mesh exceeds."""

    name: str
    what: str
    build: Callable[[], Assembly]
    exact: str
    most: int


def assembled(elements: list[dict[str, Any]], live: list[Any], inner: dict[str, float], label: str) -> Assembly:
    built = build_assembly(parse_scene(stones(elements, live, 0.6, inner, density=2000.0)))
    return replace(built, labels=np.full(len(built.interfaces), label == "dry"))


def cube() -> Assembly:
    """A flat stone glued to its support under a horizontal body load: λ W = τ A where it shears off."""
    parts = [box("base", (0, 0, -1), (1, 1, 0), support=True), box("stone", (0, 0, 0), (1, 1, 0.1))]
    strength = {"tensile_strength": 5e4, "shear_strength": 1e4}
    return assembled(parts, [{"body": [1, 0, 0]}], strength, "inner")


def cantilever() -> Assembly:
    """A cantilever of 2.0 × 0.25 × 0.5 m under a force at its end: λ between M/l and M/(l − h/2), M = σt b h²/4."""
    parts = [box("wall", (-0.5, 0, 0), (0, 0.25, 0.5), support=True)]
    parts.append(box("beam", (0, 0, 0), (2.0, 0.25, 0.5), weight=0.0))
    strength = {"tensile_strength": 2e5, "shear_strength": 1e5}
    return assembled(parts, [{"element": "beam", "force": [0, 0, -1], "at": [2.0, 0.125, 0.25]}], strength, "inner")


def corner() -> Assembly:
    """A corner of two walls of five courses, two and a half stones long, bonded in turn, pushed along its bisector."""
    long, wide, high, reach = 0.4, 0.2, 0.2, 0.8
    parts = [box("ground", (-0.2, -0.2, -0.2), (1.0, 1.0, 0.0), support=True)]
    for course in range(5):
        low, top = course * high, (course + 1) * high
        for axis in (0, 1):
            # the wall along x has the corner in even courses, the wall along y in odd ones
            ends = [0.0 if course % 2 == axis else wide]
            while reach - ends[-1] > 1.5 * long - 1e-9:
                ends.append(ends[-1] + long)
            for k, (start, end) in enumerate(zip(ends, [*ends[1:], reach], strict=True)):
                lower, upper = [start, 0.0, low], [end, wide, top]
                if axis:
                    lower[:2], upper[:2] = lower[1::-1], upper[1::-1]
                parts.append(box(f"{'xy'[axis]}{course}.{k}", tuple(lower), tuple(upper)))
    strength = {"tensile_strength": 2e5, "shear_strength": 5e5, "friction_coefficient": 0.5}
    return assembled(parts, [{"body": [0.7071, 0.7071, 0.0]}], strength, "dry")


def arch() -> Assembly:
    """A semicircular arch of seven voussoirs, 0.3 m thick and 0.5 m deep, under a horizontal body load."""
    stone = samples.Stone(tension=1e6, shear=2e6)
    made = samples.vault(voussoirs=7, courses=1, length=0.5, radius=1.5, thickness=0.3, load="push", stone=stone)
    return build_assembly(made)


CASES: Final = (
    Case("cube under shear", "a stone 1 × 1 × 0.1 m glued to its support", cube, "5.0968", 250),
    Case("cantilever", "2.0 × 0.25 × 0.5 m, plastic bending", cantilever, "1562.5 to 1785.7", 250),
    Case("corner", "25 stones in five courses, dry joints", corner, "–", 1700),
    Case("arch", "seven voussoirs, dry joints, σt = 1 MPa, τ = 2 MPa", arch, "–", 500),
)


def space() -> None:
    """Bounds by fields in space: how wide after which time, for one layout of four structures, on one core.

    The cube and the cantilever have closed forms, which the brackets must hold. The corner and the arch have dry
    joints.
    """
    rows, steps = [], []
    for case in CASES:
        assembly = case.build()
        faces = solve(assembly).load_factor
        start = time.process_time()
        with one_thread():
            found = bounds_by_fields(assembly, gap=SPACE_GAP, most=case.most)
        seconds = time.process_time() - start
        numbers = [f"{found.lower:.5g}", f"{found.upper:.5g}", f"{100.0 * found.gap:.1f} %", str(found.simplices)]
        rows.append([case.name, case.what, f"{faces:.5g}", case.exact, *numbers, f"{seconds:.0f}"])
        print(rows[-1], flush=True)
        steps += [[case.name, str(s.simplices), f"{s.lower:.5g}", f"{s.upper:.5g}"] for s in found.history]
    head = "structure | what | λ by faces | closed form | lower | upper | gap | tetrahedra | processor s"
    said = f"One layout each, refined to a gap of {100 * SPACE_GAP:.0f} % or the most tetrahedra of its case."
    meshes = table("structure | tetrahedra | lower | upper", steps)
    title = "# Bounds by fields in space"
    write("space_fields", title, about(space.__doc__), said, table(head, rows), "All meshes:", meshes)


if __name__ == "__main__":
    run_parts(speed=speed, space=space)
