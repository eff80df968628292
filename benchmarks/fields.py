"""Bounds by fields: how fast they are, how wide in space, and the exact driver by them.

`python -m benchmarks.fields [speed|space|search|flagship]` writes a table for each part. The flagship alone is the beam
on bearings, whose blocks crack anywhere. It takes the place of its version with halved cells: fields let blocks crack
off the grid, and their labellings are still those of the faces of the grid.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import about, random_segmentations, run_parts, table, write
from benchmarks.scenes import ENUMERATED, bonded, box, grid, strength
from jld_core import Assembly, InputError, Scene, build_assembly, parse_scene, samples, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import CoarseBounds, FieldBounds, FieldSetting
from jld_core.scene.cracks import FieldCracks
from jld_core.threads import one_thread
from jld_explore import Exploration, ExploreSettings, explore
from jld_explore.space import from_string

BLOCKWORK: Final[dict[str, Any]] = {
    "cell": (0.4, 0.2),
    "thickness": 0.2,
    "density": 2000,
    "dry": {"friction_coefficient": 0.75},
}
"""Cells of walls."""

BEST: Final = "iiidididddddiididdidiiid"
"""Labels of the flagship's layout that is strongest by its own faces."""
WARM: Final = 100
"""Layouts bounded before times are taken."""
TIMED: Final = 100
"""Layouts whose times are taken."""
TOGETHER: Final = 16
"""Layouts that are bounded together, as by an evaluator."""


def masonry(strong: float = 20e3) -> Assembly:
    """A wall of 48 cells of 0.4 × 0.2 m in running bond under a horizontal body load; strength in Pa."""
    rows = bonded(["aaaaaaaa"] * 6 + ["########"])
    return build_assembly(grid(rows, inner=strength(strong), **BLOCKWORK))


def beam_arch() -> tuple[Assembly, Bits, Bits]:
    """The beam-arch, labels of its best layout by faces, and labels without cuts."""
    assembly = build_assembly(ENUMERATED["flagship"]())
    return assembly, from_string(BEST), ~assembly.free_faces


def to_gap(name: str, assembly: Assembly, labels: Bits, gap: float, goal: float) -> list[str]:
    """One row: a layout until its bracket is as narrow as a gap."""
    start = time.process_time()
    found = bounds_by_fields(assembly, labels, gap=gap, seconds=40.0 * goal)
    seconds = time.process_time() - start
    bracket = f"{found.lower:.4g} {found.upper:.4g}"
    meshes = f"{found.simplices} in {len(found.history)} meshes"
    return [name, f"{100 * found.gap:.2f} %", bracket, meshes, f"**{seconds:.2f} s**", f"{goal:g} s"]


def admissible() -> Bits:
    """Layouts of the flagship's search, drawn at random."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
        done = explore(ENUMERATED["flagship"](), Path(folder) / "search", settings)
    timed_rows = np.random.default_rng(3).permutation(len(done.results))[: WARM + TIMED]
    return np.array([from_string(str(text)) for text in done.results["labelling"].iloc[timed_rows]])


def of_wall(wall: Assembly) -> Bits:
    """Layouts of the wall, drawn at random."""
    return random_segmentations(wall, WARM + TIMED, seed=3)


def race_all(goal: float) -> list[str]:
    """One row: the time of a race over all layouts of the flagship, for each of them."""
    beam = by_fields(ENUMERATED["flagship"](), 0.05)
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
    """One row of many layouts: milliseconds for each, and the aim in seconds."""
    triangles = len(FieldSetting.of(assembly).coarse)
    return [name, "–", "–", f"{triangles} in 1 mesh", f"**{each:.1f} ms**", f"{1e3 * goal:g} ms"]


def timed_rows() -> dict[str, Callable[[], list[str]]]:
    """What is measured, by name."""
    assembly, best, uncut = beam_arch()
    wall = masonry()
    return {
        "flagship, best by faces, to 5 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.05, 5.0),
        "flagship, best by faces, to 2 %": lambda: to_gap("flagship, best by faces", assembly, best, 0.02, 60.0),
        "flagship, uncut, to 5 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.05, 5.0),
        "flagship, uncut, to 2 %": lambda: to_gap("flagship, uncut", assembly, uncut, 0.02, 60.0),
        "wall of 48 cells, to 5 %": lambda: to_gap("wall of 48 cells", wall, wall.labels, 0.05, 20.0),
        "flagship, many layouts": lambda: bound_many("flagship, a layout of many", assembly, admissible(), 0.01),
        "flagship, layouts alone": lambda: bound_alone("flagship, one layout at a time", assembly, admissible(), 0.01),
        "wall, many layouts": lambda: bound_many("wall of 48 cells, a layout of many", wall, of_wall(wall), 0.032),
        "wall, layouts alone": lambda: bound_alone("wall of 48 cells, one at a time", wall, of_wall(wall), 0.032),
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
        write("crack_fields", f"# Speed of bounds by fields\n\n{about(speed.__doc__)}\n\n{text}")


SPACE_GAP: Final = 0.15
"""Relative width at which refinement ends."""


@dataclass(frozen=True)
class Case:
    """One structure: name, what it is, how it is built, λ in closed form, and tetrahedra that no mesh exceeds."""

    name: str
    what: str
    build: Callable[[], Assembly]
    exact: str
    most: int


def assembled(elements: list[dict[str, Any]], live: list[Any], inner: dict[str, float], label: str) -> Assembly:
    """An assembly of elements of 2000 kg/m³."""
    document = {
        "elements": elements,
        "materials": {"density": 2000.0, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"live": live},
    }
    built = build_assembly(parse_scene(document))
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


@one_thread()
def bounds_of(assembly: Assembly, most: int) -> tuple[FieldBounds, float]:
    """Bounds of the labelling of a scene, and the processor time that they took."""
    start = time.process_time()
    found = bounds_by_fields(assembly, gap=SPACE_GAP, most=most)
    return found, time.process_time() - start


def space() -> None:
    """Bounds by fields in space: how wide after which time, for one layout of four structures, on one core.

    The cube and the cantilever have closed forms, which the brackets must hold. The corner and the arch have dry
    joints.
    """
    rows, steps = [], []
    for case in CASES:
        assembly = case.build()
        faces = solve(assembly).load_factor
        found, seconds = bounds_of(assembly, case.most)
        numbers = [f"{found.lower:.5g}", f"{found.upper:.5g}", f"{100.0 * found.gap:.1f} %", str(found.simplices)]
        rows.append([case.name, case.what, f"{faces:.5g}", case.exact, *numbers, f"{seconds:.0f}"])
        print(rows[-1], flush=True)
        steps += [[case.name, str(s.simplices), f"{s.lower:.5g}", f"{s.upper:.5g}"] for s in found.history]
    head = "structure | what | λ by faces | closed form | lower | upper | gap | tetrahedra | processor s"
    text = [
        "# Bounds by fields in space",
        about(space.__doc__),
        f"One layout each, refined to a gap of {100 * SPACE_GAP:.0f} % or the most tetrahedra of its case.",
        table(head, rows),
        "All meshes:",
        table("structure | tetrahedra | lower | upper", steps),
    ]
    write("space_fields", "\n\n".join(text))


GAP: Final = 0.05
"""Gap of the walls."""

WIDE: Final = 0.15
"""Gap of the random scenes."""

PROOF_SECONDS: Final = 300.0
"""Time limit of one proof, s by the clock."""

JOBS: Final = 2

RANDOM_SCENES: Final = 60

RANDOM_SECONDS: Final = 1800.0
"""Time after which no further random scene begins, s by the clock."""

SLACK: Final = 1e-9
"""Relative rounding that two bounds may differ by."""

WALLS: Final[dict[str, tuple[int, int, int, float]]] = {
    "4 × 6, s = 3, 5 kPa": (4, 6, 3, 5e3),
    "6 × 4, s = 3, 20 kPa": (6, 4, 3, 2e4),
    "4 × 6, s = 3, 20 kPa": (4, 6, 3, 2e4),
}
"""Cells across and up (the row of supports among them), largest block in cells, strength in Pa."""


def by_fields(scene: Scene, gap: float = GAP) -> Scene:
    """The same scene, whose blocks crack anywhere."""
    return scene.model_copy(update={"cracks": FieldCracks(kind="fields", gap=gap)})


def wall(across: int, up: int, cells: int, strong: float) -> Scene:
    """A wall of cells of 0.4 × 0.2 m, 0.2 m thick, on a row of supports, under a horizontal body load."""
    rows = ["a" * across] * (up - 1) + ["#" * across]
    made = grid(rows, None, strength(strong), {"block_cells": [1, cells]}, name=f"wall {across} × {up}", **BLOCKWORK)
    return by_fields(made)


def random_scene(seed: int) -> Scene:
    """A random grid of 2 × 2 to 3 × 3 cells with random strengths, loads, limits and load cases."""
    rng = np.random.default_rng([seed, 9])
    # two cells or, in a third of all scenes, three
    across, up = (2 + int(rng.random() < 0.35) for _ in range(2))
    low = 10.0 ** rng.uniform(3.3, 5.0)
    inner: dict[str, Any] = {"tensile_strength": low, "shear_strength": low * float(rng.uniform(0.5, 2.0))}
    dry: dict[str, Any] = {"friction_coefficient": float(rng.uniform(0.3, 0.9))}
    if rng.random() < 0.25:
        # the tensile strength may not lie beyond the apex of friction
        apex = (1.0 - SLACK) * inner["shear_strength"] / inner["tensile_strength"]
        inner["friction_coefficient"] = min(float(rng.uniform(0.1, 0.7)), apex)
    if rng.random() < 0.2:
        inner["compressive_strength"] = 8.0 * low
    if rng.random() < 0.2:
        dry["cohesion"] = 0.2 * low
    if rng.random() < 0.2:
        dry["compressive_strength"] = 8.0 * low
    loads: dict[str, Any] = {"live": _live(rng, across)}
    if rng.random() < 0.3:
        first = {"name": "one", "live": _live(rng, across), "required": float(rng.uniform(0.5, 2.0))}
        loads = {"cases": [first, {"name": "two", "live": _live(rng, across)}]}
    base = "".join(rng.choice(["#", "."], across, p=[0.8, 0.2]))
    rows = ["a" * across] * up + [base if "#" in base else "#" * across]
    return parse_scene(
        {
            "name": f"random {seed}",
            "grid": {"cell": [0.3, 0.2], "thickness": 0.1, "rows": rows},
            "materials": {"density": 1600, "dry": dry, "inner": inner},
            "loads": loads,
            "search": {"block_cells": [1, int(rng.integers(2, 4))]},
            "cracks": {"kind": "fields", "gap": WIDE},
        }
    )


def _live(rng: np.random.Generator, across: int) -> list[dict[str, Any]]:
    """A body load in a random direction, or a force on the top."""
    if rng.random() < 0.6:
        angle = float(rng.uniform(-0.5, 3.6))
        return [{"body": [math.cos(angle), -math.sin(angle)]}]
    column = int(rng.integers(across))
    return [{"element": f"c{column}r0", "force": [float(rng.uniform(-0.3, 0.3)), -1]}]


@dataclass(frozen=True)
class Comparison:
    """Two searches of one scene, and how they disagree, "" for not at all."""

    name: str
    raced: Exploration | None
    proven: Exploration | None
    problem: str


def compare(scene: Scene, seconds: float = 20.0) -> Comparison:
    """Race all layouts of a scene, prove its best by the exact driver, and hold the two against each other."""
    try:
        raced, proven = (_searched(scene, driver, seconds) for driver in ("enumeration", "exact"))
    except InputError as error:
        return Comparison(scene.name, None, None, f"refused: {error}")
    return Comparison(scene.name, raced, proven, _problem(raced, proven))


def _searched(scene: Scene, driver: str, seconds: float, jobs: int = 1) -> Exploration:
    with tempfile.TemporaryDirectory() as folder:
        return explore(scene, Path(folder) / "out", driver=driver, seconds=seconds, jobs=jobs, pictures=False)


def _problem(raced: Exploration, proven: Exploration) -> str:
    """Return how two searches disagree, "" for not at all."""
    for one, other in ((raced, proven), (proven, raced)):
        best, bound = one.summary.best, other.summary.bound
        if best is not None and bound is not None and best > bound + SLACK * abs(bound):
            return f"{one.summary.driver} found {best:.9g}, {other.summary.driver} bounds all by {bound:.9g}"
    if raced.summary.bound is not None and raced.summary.bound < 0.0 <= (proven.summary.best or -1.0):
        return "one search finds a layout that stands, the other proves that none does"
    check = proven.summary.facts.get("proof_check")
    if check is not None and not check["passed"]:
        return f"the proof did not pass its check: {check['problem']}"
    both = raced.results.merge(proven.results, on="labelling", suffixes=("", "_exact"))
    for low, high in (("bracket_lo", "bracket_hi_exact"), ("bracket_lo_exact", "bracket_hi")):
        wrong = both[both[low] > both[high] + SLACK * both[high].abs()]
        if len(wrong):
            return f"{len(wrong)} layouts have brackets that do not overlap"
    return ""


def random_part(count: int, seconds: float) -> str:
    """Compare searches of random scenes, none begun after some seconds by the clock."""
    rows, sizes = [], []
    ended = decided = disagreed = refused = 0
    start, began = time.process_time(), time.perf_counter()
    for seed in range(count):
        if time.perf_counter() - began > seconds:
            break
        found = compare(random_scene(seed))
        print(f"{found.name}: {found.problem or 'agree'}", flush=True)
        if found.raced is None or found.proven is None:
            refused += 1
            continue
        ended += 1
        sizes.append(len(found.raced.results))
        decided += bool(found.proven.summary.facts["race"]["decided"])
        disagreed += bool(found.problem)
        if found.problem:
            rows.append([found.name, found.problem])
    spent = time.process_time() - start
    text = (
        f"{ended} random scenes of {min(sizes)} to {max(sizes)} layouts ({refused} more were refused by the builder "
        f"or have none): {disagreed} disagreements. The exact driver ended within its gap of {WIDE:.0%} in {decided}. "
        f"{spent:.0f} s of one processor for both searches."
    )
    return text + ("\n\n" + table(["scene", "disagreement"], rows) if rows else "")


def _processor_time() -> float:
    """Seconds of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def proofs_part(seconds: float, jobs: int, scenes: dict[str, Scene]) -> str:
    """Prove scenes to the gap, each within a time by the clock."""
    rows = []
    for name, scene in scenes.items():
        before = _processor_time()
        done = _searched(scene, "exact", seconds, jobs)
        facts = done.summary.facts
        ends = ["none stands" if facts["best"] is None else f"{facts['best']:.4f}"]
        ends.append("–" if facts["bound"] is None else f"{facts['bound']:.4f}")
        ends.append("–" if facts["gap"] is None else f"{facts['gap']:.1%}")
        counts = [str(facts[key]) for key in ("stop_reason", "conflicts", "relaxations", "evaluated")]
        times = [f"{facts['seconds']:.0f}", f"{_processor_time() - before:.0f}"]
        rows.append([name, *ends, *counts, *times])
    head = "scene | best, at least | none more than | gap | ended | conflicts | programs | evaluated | s | CPU, s"
    return table(head, rows)


def _clock() -> str:
    """Gap, time limit and load of the machine, in words."""
    load = f"Load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    return f"Gap {GAP:.0%}, {PROOF_SECONDS:.0f} s by the clock at most, {JOBS} jobs. {load}"


def flagship() -> None:
    """Prove the beam on bearings by fields."""
    words = about(__doc__).partition("for each part. ")[2]
    clock = _clock()
    found = proofs_part(PROOF_SECONDS, JOBS, {"beam on bearings (flagship)": by_fields(ENUMERATED["flagship"]())})
    write("fields_flagship", "\n\n".join(["# The flagship by fields", words, found, clock]))


def search() -> None:
    """The exact driver by fields, against the race of all layouts on random scenes, and on walls beyond enumeration.

    Where blocks crack anywhere, every layout has a bracket and no exact λ. Two searches of one scene agree where
    neither best layout is proven to carry more than the other's bound on all layouts, and where brackets of each
    layout overlap. `python -m benchmarks.fields search WALL…` takes some of the walls.
    """
    head = ["# The exact driver by fields", about(search.__doc__), "## Against the race of all layouts"]
    parts = [*head, random_part(RANDOM_SCENES, RANDOM_SECONDS)]
    write("fields_search", "\n\n".join(parts))
    note = (
        "Cells of 0.4 × 0.2 m, 0.2 m thick, 2000 kg/m³, μ = 0.75, σt = τ, horizontal body load. CPU: seconds of all "
        "processes; other work on the machine takes the rest. A bound below 0: every layout falls by itself. "
    )
    walls = {name: wall(*WALLS[name]) for name in sys.argv[1:] or WALLS}
    parts += ["## Walls", proofs_part(PROOF_SECONDS, JOBS, walls), note + _clock()]
    write("fields_search", "\n\n".join(parts))


if __name__ == "__main__":
    run_parts(speed=speed, space=space, search=search, flagship=flagship)
