"""The batch solver beside one labelling at a time and the plain way; on hard labellings; and on one labelling alone.

`python -m benchmarks.batch_solver [many|hard|alone]` writes a table for each part.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from studies.scenes import corner

from benchmarks import large
from benchmarks.common import about, plainly, random_segmentations, run_parts, scene, table, write
from benchmarks.scenes import ENUMERATED, LARGE, built, cubes, grid, prism, stones, strength, wall
from jld_core import Assembly, Scene, build_assembly, parse_scene, samples
from jld_core.arrays import Bits
from jld_core.batch.library import described
from jld_core.limit import load_scale
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.batch import BatchAnalysis
from jld_core.limit.options import SolveOptions, Status
from jld_core.models import limit_analysis
from jld_core.models.case_analysis import solve
from jld_core.refinement import refine
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_samples import Stone, box

HARD_MANY: Final = 512
FEW: Final = 6  # of what is left, solved to say what it is


@dataclass(frozen=True)
class Hard:
    """A scene. any_label: faces are labelled by themselves, not by blocks. count: labellings. one: how many of them
    the usual way is timed on. kern: bending of inner faces in the kern form."""

    make: Callable[[], Assembly]
    any_label: bool = False
    count: int = HARD_MANY
    one: int = 24
    kern: bool = False


def cells_of(
    rows: list[str], live: list[dict[str, Any]] | None = None, *, friction: float = 0.6, **inner: float
) -> Assembly:
    """Cells pushed sideways unless said otherwise. inner: keys of the inner material, σt = τ = 20 kPa by default;
    crush: compressive strength of dry joints."""
    dry = {"friction_coefficient": friction}
    if "crush" in inner:
        dry["compressive_strength"] = inner.pop("crush")
    return build_assembly(grid(rows, live, strength(2e4) | inner, dry=dry))


def cut(what: Scene, size: tuple[float, ...], kind: str = "voronoi") -> Assembly:
    return build_assembly(refine(what, size, kind=kind).scene)


def drum(stone: Stone) -> Assembly:
    return cut(samples.grid(columns=1, rows=1, cell=1.6, height=1.2, stone=stone), (0.2, 0.2))


def cubes_of(*options: Any) -> Assembly:
    return build_assembly(cubes(*options))


def corner_of_studies() -> Assembly:
    return build_assembly(corner(4, np.radians(225.0), None))


def prisms(sides: int, wide: int, high: int, strong: float = 2e4) -> Assembly:
    """Columns of prisms over regular polygons that touch along their sides (six) or not at all, on a slab."""
    apothem = 0.1
    angles = np.pi / sides + 2.0 * np.pi * np.arange(sides) / sides
    outline = apothem / np.cos(np.pi / sides) * np.column_stack([np.cos(angles), np.sin(angles)])
    elements = [
        prism(f"p{i}.{k}", outline + np.array([2.0 * apothem * i, 0.0]), 0.15 * k, 0.15 * (k + 1))
        for i, k in itertools.product(range(wide), range(high))
    ]
    elements.append(box("slab", (-1.0, -1.0, -0.2), (2.0 * apothem * wide + 1.0, 1.0, 0.0), support=True))
    document = stones(elements, [{"body": [1.0, 0.4, 0.0]}], 0.6, strength(strong), density=2000)
    return build_assembly(parse_scene(document))


DOWN: Final = [{"element": "c2r0", "force": [0, -1]}]
WALL: Final = ["aaaaaa"] * 4 + ["######"]
BEAM: Final = ["#aaaaa#"] * 3
WEAK: Final = Stone(tension=2e3, shear=2e3)

SEGMENTED: Final[dict[str, Hard]] = {
    "wall 6 × 8": Hard(lambda: wall(6, 8)),
    "wall 6 × 8, 2 kPa": Hard(lambda: wall(6, 8, 2e3, 2e3)),
    "wall 5 × 5 on two supports": Hard(lambda: cells_of(["aaaaa"] * 5 + ["#...#"])),
    "arch of 3 rings of 20, pushed": Hard(lambda: build_assembly(samples.arch(rings=3, voussoirs=20))),
    "the same, pressed at a quarter": Hard(lambda: build_assembly(samples.arch(rings=3, voussoirs=20, load="quarter"))),
    "arch of 2 rings of 16, weak": Hard(lambda: build_assembly(samples.arch(rings=2, voussoirs=16, stone=WEAK))),
    "buttress": Hard(lambda: build_assembly(samples.buttress())),
    "polygons in a wall": Hard(lambda: drum(Stone())),
    "polygons in a weak wall": Hard(lambda: drum(WEAK)),
    "polygons of a flat arch": Hard(lambda: cut(samples.flat_arch(voussoirs=1), (0.15, 0.15))),
    "24 faces, flagship": Hard(lambda: scene("flat_beam_arch")),
}
HARD: Final[dict[str, Hard]] = {
    "flat arch between abutments": Hard(lambda: build_assembly(samples.flat_arch(rings=3))),
    "the same, any label": Hard(lambda: build_assembly(samples.flat_arch(rings=3)), any_label=True),
    "beam between abutments": Hard(lambda: cells_of(BEAM, DOWN)),
    "the beam, any label": Hard(lambda: cells_of(BEAM, DOWN), any_label=True),
    "the beam, inner faces rub": Hard(lambda: cells_of(BEAM, DOWN, friction_coefficient=0.5), any_label=True),
    "the beam, joints crush": Hard(lambda: cells_of(BEAM, DOWN, crush=5e4), any_label=True),
    "wall pressed down": Hard(lambda: cells_of(WALL, [{"body": [0, -1]}])),
    "wall without friction": Hard(lambda: cells_of(WALL, friction=0.0)),
    "without friction, any label": Hard(lambda: cells_of(WALL, friction=0.0), any_label=True),
    "wall, no shear strength": Hard(lambda: cells_of(WALL, shear_strength=0.0), any_label=True),
    "wall, no tensile strength": Hard(lambda: cells_of(WALL, tensile_strength=0.0), any_label=True),
    "wall that crushes": Hard(lambda: cells_of(WALL, crush=2e4, compressive_strength=1e5)),
    "overhang": Hard(lambda: cells_of(["aaaaaa", "aaaa..", "aa....", "##...."], [{"body": [0, -1]}])),
    "strengths of 1 GPa": Hard(
        lambda: cells_of(["aaaa"] * 4 + ["####"], tensile_strength=1e9, shear_strength=1e9), any_label=True
    ),
}
SPATIAL: Final[dict[str, Hard]] = {
    "cubes 3 × 3 × 3, 20 kPa": Hard(lambda: cubes_of(3, 2e4), count=256, one=12),
    "cubes 3 × 3 × 3, 200 Pa": Hard(lambda: cubes_of(3, 2e2), count=256, one=12),
    "cubes 3 × 3 × 3 pressed down": Hard(lambda: cubes_of(3, 2e4, (0.0, 0.0, -1.0)), count=256, one=12),
    "cubes 4 × 4 × 4": Hard(lambda: cubes_of(4, 2e4), count=96, one=4),
    "corner of the studies, 225°": Hard(corner_of_studies, count=256, one=20),
    "the same, kern form": Hard(corner_of_studies, count=256, one=20, kern=True),
    "hexagonal prisms": Hard(lambda: prisms(6, 4, 4), count=256, one=16),
    "octagonal prisms, weak": Hard(lambda: prisms(8, 4, 4, 2e3), count=256, one=16),
    "dome": Hard(lambda: build_assembly(samples.dome()), count=96, one=6),
    "barrel vault": Hard(lambda: build_assembly(samples.vault(voussoirs=6, courses=3)), count=128, one=8),
}


def machine_code() -> str:
    return f"{described().capitalize()}."


def labellings_of(assembly: Assembly, hard: Hard) -> Bits:
    if not hard.any_label:
        return random_segmentations(assembly, hard.count, seed=7)
    dice = np.random.default_rng(7)
    return dice.random((hard.count, len(assembly.interfaces))) < dice.random((hard.count, 1))


def measure_hard(name: str, hard: Hard) -> str:
    assembly = hard.make()
    analysis = limit_analysis(assembly, SolveOptions(inner_bending="kern") if hard.kern else SolveOptions())
    labellings = labellings_of(assembly, hard)
    batch = BatchAnalysis.of(analysis)
    faces = str(len(assembly.interfaces))
    if batch is None:
        return f"{name} | {faces} | {len(labellings)} | – | – | – | – | 100 | rows of another shape | – | – | –"
    batch.prove(labellings[:8])
    start = time.process_time()
    raw = batch.batch.solve(labellings)
    found = batch.prove(labellings)
    kernel = 0.5 * (time.process_time() - start) / len(labellings)
    left = np.flatnonzero(~found.settled)
    analysis.prove(labellings[0])
    start = time.process_time()
    known = Counter(str(analysis.prove(labellings[k]).status) for k in left[:FEW])
    each = (time.process_time() - start) / max(1, min(FEW, len(left)))
    start = time.process_time()
    for labels in labellings[: hard.one]:
        analysis.prove(labels)
    alone = (time.process_time() - start) / hard.one
    whole = kernel + each * len(left) / len(labellings)
    count = len(labellings)
    collapse = found.settled & ~found.falls & ~found.locked
    shares = [f"{100.0 * share.mean():.1f}" for share in (collapse, found.locked, found.falls)]
    said = ", ".join(f"{number} {status}" for status, number in sorted(known.items())) or "–"
    times = f"{1e3 * alone:.2f} | {1e6 * whole:.0f} | {alone / whole:.0f}"
    first, rest = f"{100.0 * (raw.tries == 1).mean():.0f}", f"**{100.0 * len(left) / count:.1f}**"
    return " | ".join([name, faces, str(count), first, *shares, rest, said, times])


def hard_labellings() -> None:
    """Hard labellings: what the batch solver answers scene by scene, and what is left to other methods.

    Random segmentations of walls, arches and polygons; then scenes in which forces may grow for ever, nothing rubs or
    something crushes, and faces labelled by themselves, which are no segmentations; then spatial ones. Shares are of
    all labellings of a scene: what the batch solver answers as a collapse with both bounds, as locked (a state and a
    ray), as unstable; the rest is left, and a few are said to be what they are. Times: processor time a labelling,
    what is left counted at the time of the other methods, beside the usual way on some of the same labellings.
    """
    head = (
        "scene | faces | labellings | first try, % | collapse, % | locked, % | unstable, % | left, % | what a few of "
    )
    head += "them are | one at a time, ms | by the batch solver, all in, µs | times"
    rows = []
    for title, scenes in (("", SEGMENTED), ("**hard**", HARD), ("**spatial**", SPATIAL)):
        if title:
            rows.append(title + " | " * head.count(" | "))
        for name, hard in scenes.items():
            rows.append(measure_hard(name, hard))
            print(rows[-1], flush=True)
    words = about(hard_labellings.__doc__)
    write("batch_solver_hard", "# Hard labellings by the batch solver", words, table(head, rows), machine_code())


TURNS: Final = 3
TURN: Final = 1024  # labellings of a turn of the batch solver


@dataclass(frozen=True)
class Case:
    """A scene and its labellings (k, m); one: how many of them one at a time in a turn; plain: how many plainly."""

    assembly: Assembly
    labellings: Bits
    one: int
    plain: int


def drawn(name: str, one: int, plain: int = 6, driver: str = "random", count: int = TURN) -> Case:
    """Segmentations that a driver asks first of a scene that searches are measured on."""
    assembly, space = built((ENUMERATED | LARGE)[name]())
    source = make_driver(driver, space, 0)
    found = np.zeros((0, len(assembly.interfaces)), dtype=bool)
    while len(found) < count:
        found = np.concatenate([found, source.ask(count)])
    return Case(assembly, found[:count], one, plain)


def walled(edge: int, one: int, count: int, plain: int = 1) -> Case:
    scene = parse_scene(large.document("planar", edge))
    assembly = build_assembly(scene)
    source = make_driver("random", search_space(scene, assembly), 0)
    found = np.concatenate([source.ask(count) for _ in range(3)])[:count]
    return Case(assembly, found, one, plain)


def segmented(assembly: Assembly, one: int, count: int = TURN, plain: int = 6) -> Case:
    return Case(assembly, random_segmentations(assembly, count, seed=7), one, plain)


CASES: Final[dict[str, Callable[[], Case]]] = {
    "24 faces, flagship": lambda: drawn("flagship", 150),
    "88 faces": lambda: drawn("planar 88 faces", 60),
    "278 faces": lambda: drawn("planar 278 faces", 20, 4),
    "946 faces": lambda: walled(22, 4, 128),
    "2 016 faces": lambda: walled(32, 2, 64),
    "3 × 3 × 3 cubes": lambda: drawn("spatial 3x3x3", 20, 4, count=512),
    "corner of the studies, 225°": lambda: segmented(corner_of_studies(), 20, 512, 4),
    "4 × 4 × 4 cubes": lambda: segmented(cubes_of(4, 2e4), 4, 128, 2),
}
HELD_OUT: Final[dict[str, Callable[[], Case]]] = {
    "wall 6 × 8, 2 MPa": lambda: segmented(wall(6, 8), 40),
    "wall 6 × 8, 20 kPa": lambda: segmented(wall(6, 8, 2e4, 2e4), 40),
    "wall 6 × 8, 2 kPa": lambda: segmented(wall(6, 8, 2e3, 2e3), 40),
    "wall 4 × 4, 200 Pa": lambda: segmented(wall(4, 4, 2e2, 2e2), 80),
    "bridge 7 × 3": lambda: drawn("bridge 7x3", 100),
    "hexagonal prisms": lambda: segmented(prisms(6, 4, 4), 20, 512, 4),
}


def measure_many(name: str, case: Case) -> str:
    assembly, labellings = case.assembly, case.labellings
    evaluator = Evaluator(assembly, EvaluatorSettings())
    analysis = LimitAnalysis(assembly)
    batch = BatchAnalysis.of(analysis)
    if batch is None:
        raise SystemExit(f"{name}: no batch solver is in use, or the scene does not fit it")
    evaluator.evaluate_all(labellings[:64])
    evaluator.evaluate(labellings[0])
    ratios, times_alone, alls, differ, same = [], [], [], 0.0, 0
    for turn in range(TURNS):
        chosen = labellings[turn * case.one : (turn + 1) * case.one]
        start = time.process_time()
        known = [evaluator.evaluate(labels) for labels in chosen]
        alone = (time.process_time() - start) / len(chosen)
        start = time.process_time()
        found = evaluator.evaluate_all(labellings)
        together = (time.process_time() - start) / len(labellings)
        ratios.append(alone / together)
        times_alone.append(alone)
        alls.append(together)
        for one, other in zip(known, found[turn * case.one :], strict=False):
            same += one.status is other.status
            if one.status is other.status is Status.COLLAPSE:
                size = max(abs(one.load_factor), load_scale(assembly))
                differ = max(differ, abs(one.load_factor - other.load_factor) / size)
    plain = float(np.mean([plainly(assembly, labels)[0] for labels in labellings[: case.plain]]))
    raw = batch.batch.solve(labellings)
    settled = batch.prove(labellings)
    bracket = settled.settled & ~settled.falls & ~settled.locked
    sizes = np.maximum(abs(settled.low), analysis.load_scale)
    width = ((settled.high - settled.low) / sizes)[bracket]
    spread = " / ".join(f"{value:.0e}" for value in np.quantile(width, [0.5, 0.99, 1.0])) if width.size else "–"
    alone, together = np.median(times_alone), np.median(alls)
    times = f"{1e3 * plain:.1f} | {1e3 * alone:.2f} | {1e6 * together:.1f} | **{np.median(ratios):.0f}**"
    shares = f"{100.0 * (raw.tries == 1).mean():.1f} | {100.0 * (~settled.settled).mean():.2f}"
    rest = f"{raw.iterations.mean():.1f} | {spread} | {same} of {TURNS * case.one} | {differ:.0e}"
    return f"{name} | {len(assembly.interfaces)} | {times} | {plain / together:.0f} | {shares} | {rest}"


def many_labellings() -> None:
    """Labellings by the batch solver, with all that it leaves open, beside one at a time and the plain way.

    One labelling at a time and the batch solver evaluate the same labellings in turns in one process, by processor
    time; the batch solver's time holds the tries it needs and the methods for what it leaves open. Ratios are medians
    of three turns. Plain: CVXPY with the program stated anew for each labelling (benchmarks/common.py). Scenes below
    the line were not looked at while settings were chosen. Scenes named on the command line are printed alone.
    """
    wanted = sys.argv[1:]
    head = "scene | faces | plain, ms | one at a time, ms | by the batch solver, all in, µs | times | times plain | "
    head += "first try, % | left open, % | iterations | bracket: median / 99 % / worst | same status | "
    head += "λ differs by, relative, at most"
    if wanted:
        print(table(head, [measure_many(name, (CASES | HELD_OUT)[name]()) for name in wanted]))
        return
    rows = [measure_many(name, make()) for name, make in CASES.items()]
    rows.append("**held out**" + " | " * head.count(" | "))
    rows += [measure_many(name, make()) for name, make in HELD_OUT.items()]
    text = about(many_labellings.__doc__).rpartition(" Scenes named")[0]
    write("batch_solver", "# Labellings by the batch solver", text, table(head, rows), machine_code())


ALONE: Final[dict[str, Callable[[], Assembly]]] = {
    "hexagonal prisms": lambda: prisms(6, 4, 4),
    "corner of the studies, 225°": corner_of_studies,
    "3 × 3 × 3 cubes": lambda: cubes_of(3, 2e4),
    "4 × 4 × 4 cubes": lambda: cubes_of(4, 2e4),
    "5 × 5 × 5 cubes": lambda: cubes_of(5, 2e4),
}
LABELLINGS: Final = 9
NO_SIZE: Final = (1, 0)  # faces for which the batch solver is asked
ALL_SIZES: Final = (0, 10**6)


def measure_single(name: str, assembly: Assembly) -> str:
    labellings = random_segmentations(assembly, LABELLINGS + 1, seed=7)
    times, widths, differ, same, left = [], [], 0.0, 0, 0
    for k, labels in enumerate(labellings):
        found = []
        for faces in (NO_SIZE, ALL_SIZES):
            with patch("jld_core.limit.analysis.FACES_WHERE_BATCH_IS_FASTER", faces):
                start = time.process_time()
                found.append((solve(assembly, labels), time.process_time() - start))
        if k == 0:
            continue  # what a process makes once
        (usual, before), (kernel, after) = found
        times.append((before, after))
        widths.append((usual.gap, kernel.gap))
        same += usual.status is kernel.status
        left += kernel.solve_log != ("batch solver",)
        differ = max(differ, abs(usual.load_factor - kernel.load_factor) / abs(usual.load_factor))
    before, after = np.median(times, axis=0)
    wide, narrow = np.nanmedian(widths, axis=0)
    ratio = np.median([one / other for one, other in times])
    shown = f"{name} | {len(assembly.interfaces)} | {1e3 * before:.1f} | {1e3 * after:.1f} | **{ratio:.1f}**"
    return f"{shown} | {left} of {LABELLINGS} | {wide:.0e} / {narrow:.0e} | {same} of {LABELLINGS} | {differ:.0e}"


def one_labelling() -> None:
    """One labelling alone: the whole of `solve` by the batch solver, its making included, beside the usual way.

    Processor time of `solve`, from the assembly to the result, on the same labellings in turns in one process;
    medians. Cubes are pushed at a top corner, with inner strength 20 kPa; random segmentations. Left: what the batch
    solver does not settle, or not narrowly, goes the usual way, and its time is in the batch solver's column.
    """
    head = "scene | faces | usual way, ms | batch solver, ms | times | left | bracket, usual / batch solver | "
    head += "same status | λ differs by, relative, at most"
    rows = [measure_single(name, make()) for name, make in ALONE.items()]
    write(
        "batch_solver_single", "# One labelling alone", about(one_labelling.__doc__), table(head, rows), machine_code()
    )


if __name__ == "__main__":
    run_parts(many=many_labellings, hard=hard_labellings, alone=one_labelling)
