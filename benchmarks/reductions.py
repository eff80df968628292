"""Only what a scene needs: what each reduction removes and saves, and that λ stays.

Each pair is solved both ways, set-up included, and compared; why λ cannot change stands beside. Times are processor
times, means over runs that fill half a second. Differences of λ are relative;
brackets on either side overlap unless it says otherwise.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from studies.by_scheme import zero_dilation

from benchmarks.common import RESULTS, about, random_segmentations, table, wall, write
from benchmarks.scenes import GRIDS, STRENGTH, bonded, box, brick_wall, grid
from jld_core import Assembly, LimitAnalysis, LimitAnalysisResult, build_assembly, parse_scene
from jld_core.models import solve
from jld_core.models.rigid_blocks import rigid_blocks
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver
from jld_core.strengths import Route
from jld_core.views.figures import save_figure

ROUTE = Route("a benchmark")

ENOUGH: Final = 0.5
"""Processor seconds that runs of one measurement fill."""


@dataclass(frozen=True)
class Reduction:
    """One reduction on one scene: sizes, seconds and λ with all and with less, why λ stays, and who does it.

    unit: what the sizes count. changed: relative difference of λ.
    """

    name: str
    scene: str
    unit: str
    sizes: tuple[int, int]
    seconds: tuple[float, float]
    changed: float
    why: str
    offered: str


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Mean seconds of a piece of work, and its answer."""
    start, runs, spent = time.process_time(), 0, 0.0
    while not runs or spent < ENOUGH:
        answer = work()
        runs, spent = runs + 1, time.process_time() - start
    return spent / runs, answer


def full(assembly: Assembly) -> LimitAnalysisResult:
    """Everything modelled, from the assembly on."""
    return LimitAnalysis(assembly, reference=assembly.labels).solve(stands=False)


def unknowns(assembly: Assembly) -> int:
    """Columns of its program."""
    return Template(assembly).columns


def apart(one: LimitAnalysisResult, other: LimitAnalysisResult) -> float:
    """Relative difference of two λ; AssertionError where their brackets exclude each other."""
    assert max(one.bracket[0], other.bracket[0]) <= min(one.bracket[1], other.bracket[1]) * (1 + 1e-9)
    return abs(one.load_factor - other.load_factor) / abs(one.load_factor)


def extruded(rows: list[str]) -> Assembly:
    """A planar grid of `scenes.grid` as boxes 0.1 m deep, with the same blocks, materials and load."""
    elements = []
    for r, line in enumerate(rows):
        for c, letter in enumerate(line):
            low = (0.1 * c, 0.0, 0.1 * (len(rows) - 1 - r))
            kind: dict[str, Any] = {"support": True} if letter == "#" else {"block": f"{letter}{r}"}
            high = tuple(round(x + 0.1, 12) for x in low)
            elements.append(box(f"c{c}r{r}", tuple(round(x, 12) for x in low), high, **kind))
    document = {
        "elements": elements,
        "materials": {"density": 1400, "dry": {"friction_angle": 30}, "inner": STRENGTH},
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }
    return build_assembly(parse_scene(document))


def planar(faces: int = 88) -> Reduction:
    """A wall loaded in its plane as a planar scene instead of a spatial one."""
    rows = bonded(GRIDS[faces])
    solid, flat = extruded(rows), build_assembly(grid(rows))
    slow, before = timed(lambda: full(solid))
    quick, after = timed(lambda: full(flat))
    return Reduction(
        "planar instead of spatial",
        f"grid of {faces} faces, load in its plane",
        "unknowns",
        (unknowns(solid), unknowns(flat)),
        (slow, quick),
        apart(before, after),
        "the mean of a state and its mirror image in the mid-plane is a state, and has V2 = M1 = MT = 0",
        "by stating the scene with polygons",
    )


def without_torsion(program: ConicProgram, faces: int) -> ConicProgram:
    """The program with MT = 0 on every face: their columns go."""
    s = program.structure
    keep = np.ones(s.shape[1], dtype=bool)
    keep[5 : 6 * faces : 6] = False
    rows = program.matrix[:, keep]
    return pack(rows, program.rhs, program.objective[keep], s.equalities, s.linear, s.cones)


def torsion_free(assembly: Assembly, name: str, why: str) -> Reduction:
    """The solve alone, believed at 1e-11, with and without MT; measured from outside."""
    template = Template(assembly)
    program = template.program(assembly.labels)
    less = without_torsion(program, len(assembly.interfaces))
    slow, before = timed(lambda: ClarabelSolver(1e-11).solve(program).point[-1])
    quick, after = timed(lambda: ClarabelSolver(1e-11).solve(less).point[-1])
    sizes = (program.structure.shape[1], less.structure.shape[1])
    changed = abs(after - before) / abs(before)
    return Reduction(
        "torsion-free", name, "unknowns", sizes, (slow, quick), changed, why, "no: where it is exact, planar saves more"
    )


def twisted() -> Assembly:
    """A brick on a slab, pushed across at one end: it slides and turns about the vertical."""
    elements = [
        box("brick", (0.0, 0.0, 0.0), (0.2, 0.1, 0.06)),
        box("slab", (-0.1, -0.1, -0.1), (0.3, 0.2, 0.0), support=True),
    ]
    document = {
        "elements": elements,
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.65}},
        "loads": {"live": [{"element": "brick", "force": [0, 1, 0], "at": [0.2, 0.05, 0.0]}]},
    }
    return build_assembly(parse_scene(document))


def condensed(faces: int = 278) -> Reduction:
    """Blocks whose inner faces need not yield, as rigid bodies."""
    assembly = build_assembly(grid(bonded(GRIDS[faces])))
    slow, before = timed(lambda: full(assembly))
    quick, after = timed(lambda: solve(assembly, condense="on"))
    rigid = rigid_blocks(assembly, assembly.labels, np.zeros(0, dtype=np.int64))
    return Reduction(
        "condensed",
        f"running bond of {faces} faces, σt 2 MPa",
        "unknowns",
        (unknowns(assembly), unknowns(rigid.assembly)),
        (slow, quick),
        apart(before, after),
        "rigid blocks bound λ from above; admissible forces found inside every block bound it from below",
        "`--condense auto` above a strength of 300 force scales, and where the full model is not certified",
    )


def halved(courses: int = 8, half: int = 6) -> tuple[Assembly, Assembly]:
    """A beam on two bearings under a load in the middle, whole, and its left half against the plane of symmetry.

    Blocks of two cells, mirrored; every other course has one across the plane. The half leans on supports: without
    friction where the plane is a dry joint; where it cuts a block, on an inner face that holds any N and M and no V.
    """
    left = []
    for r in range(courses):
        # blocks are counted from the plane, half a block further in every other course
        left.append("".join("abcdefghij"[((half - 1 - c) + (r % 2)) // 2 + (0 if r % 2 else 5)] for c in range(half)))
    whole = [line + line[::-1].translate(_MIRROR if r % 2 == 0 else _ACROSS) for r, line in enumerate(left)]
    bearing = "#" * 3 + "." * (half - 3)
    load = [{"element": f"c{half - 1}r0", "force": [0, -1]}]
    both = [*load, {"element": f"c{half}r0", "force": [0, -1]}]
    entire = build_assembly(grid([*whole, bearing + bearing[::-1]], both))
    part = build_assembly(grid([*(line + "#" for line in left), bearing + "."], load))
    faces, elements, strengths = part.interfaces, part.elements, part.strengths(ROUTE)
    plane = np.flatnonzero(np.isclose(faces.origin[:, 0], 0.1 * half) & (abs(faces.normal[:, 0]) > 0.5))
    pairs = zip(faces.a[plane], faces.b[plane], strict=True)
    row = np.array([int(elements.ids[b if elements.support[a] else a].split("r")[1]) for a, b in pairs])
    cut = plane[row % 2 == 1]
    friction, tension, shear = strengths.friction.copy(), strengths.tension.copy(), strengths.shear.copy()
    labels = part.labels.copy()
    friction[plane], shear[plane], tension[cut] = 0.0, 0.0, 1e9
    labels[plane], labels[cut] = True, False
    leaning = replace(strengths, friction=friction, tension=tension, shear=shear)
    return entire, replace(part.with_strengths(leaning), labels=labels)


_MIRROR: Final = str.maketrans("fghij", "vwxyz")
"""Blocks beside the plane: each side has its own."""
_ACROSS: Final = str.maketrans("bcdefghij", "rstuvwxyz")
"""Blocks across the plane: the first is one block with its mirror image."""


def half_model() -> Reduction:
    """Half of a symmetric scene under a symmetric load."""
    whole, half = halved()
    slow, before = timed(lambda: full(whole))
    quick, after = timed(lambda: full(half))
    return Reduction(
        "symmetric half",
        f"beam of {len(whole.interfaces)} faces on two bearings, load in the middle",
        "unknowns",
        (unknowns(whole), unknowns(half)),
        (slow, quick),
        apart(before, after),
        "the mean of a state and its mirror image is a state, and has V = 0 on the plane",
        "as a scene: faces on the plane against supports, given `friction_coefficient` 0, or where a block is cut, "
        "label inner, `shear_strength` 0 and a large `tensile_strength`; not by itself, as few loads are symmetric",
    )


def zero_dilation_skipped(count: int = 60) -> Reduction:
    """The best labelling without dilation, solved only where the associative λ leaves it a chance."""
    assembly = wall(4, 4, 2e4, 2e4)
    analysis = LimitAnalysis(assembly)
    scale = analysis.template.scaling.load
    labellings = random_segmentations(assembly, count, seed=5)

    def best(skip: bool) -> tuple[float, int]:
        found = [(analysis.prove(labels), labels) for labels in labellings]
        found.sort(key=lambda pair: -np.nan_to_num(pair[0].load_factor, nan=-np.inf))
        most, solved = -np.inf, 0
        for result, labels in found:
            if np.isnan(result.load_factor) or (skip and result.bracket[1] * scale <= most):
                continue
            without = zero_dilation(analysis, labels, associative=result, stands=False)
            most, solved = max(most, without.load_factor), solved + 1
        return most, solved

    slow, (before, every) = timed(lambda: best(False))
    quick, (after, some) = timed(lambda: best(True))
    return Reduction(
        "zero dilation skipped",
        f"best of {count} segmentations of 4 × 4 cells",
        "solves without dilation",
        (every, some),
        (slow, quick),
        abs(after - before) / before,
        "associative λ bounds every solution without dilation from above",
        "`--objective zero-dilation` does so as it goes",
    )


def measured(small: bool = False) -> list[Reduction]:
    """All of them; small: on the smallest scenes, for a test."""
    bricks = build_assembly(brick_wall(4, 2, "in plane", 1) if small else brick_wall(10, 5, "in plane", 1))
    across = build_assembly(brick_wall(2, 2) if small else brick_wall(10, 5))
    exact = "as for planar; MT is zero in the mean of a state and its mirror image"
    chance = "nothing twists here; in general MT = 0 only restricts, and λ may come out too low"
    inexact = "**λ changes**: MT = 0 only restricts, and here λ comes out too low"
    found = [
        planar(33 if small else 88),
        torsion_free(bricks, f"{len(bricks.elements) - 1} bricks, one wythe, load in its plane", exact),
        torsion_free(across, f"{len(across.elements) - 1} bricks, two wythes, load out of plane", chance),
        torsion_free(twisted(), "one brick, pushed at its end", inexact),
        condensed(33 if small else 278),
        half_model(),
        zero_dilation_skipped(8 if small else 60),
    ]
    if not small:
        found += [condensed(2025)]
    return sorted(found, key=lambda one: one.name)


def draw(found: list[Reduction]) -> Figure:
    """Bars: what is left of size and time."""
    figure = Figure(figsize=(9.0, 0.62 * len(found) + 1.4), dpi=110, layout="constrained")
    ax = figure.add_subplot()
    place = np.arange(len(found))
    parts = (
        ("size left (unknowns, or solves)", "#92c5de", [one.sizes[1] / one.sizes[0] for one in found], -0.19),
        ("time left", "#2166ac", [one.seconds[1] / one.seconds[0] for one in found], 0.19),
    )
    for name, colour, values, up in parts:
        bars = ax.barh(place + up, values, 0.36, color=colour, label=name)
        ax.bar_label(bars, [f"{value:.2f}" for value in values], padding=3, fontsize=8)
    names = [f"{one.name}\n{one.scene}" for one in found]
    ax.set_yticks(place, names, fontsize=7.5)
    ax.invert_yaxis()
    ax.axvline(1.0, color="0.4", lw=0.8)
    ax.set_xlabel("share of what it is without the reduction")
    ax.margins(x=0.12)
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Measure all and write benchmarks/results/reductions.md and .png."""
    found = measured()
    head = [
        "reduction",
        "scene",
        "removes",
        "s without",
        "s with",
        "times faster",
        "λ differs by",
        "because",
        "offered",
    ]
    rows = [
        [
            one.name,
            one.scene,
            f"{one.unit}: {one.sizes[0]} → {one.sizes[1]}",
            f"{one.seconds[0]:.3g}",
            f"{one.seconds[1]:.3g}",
            f"{one.seconds[0] / one.seconds[1]:.1f}",
            f"{one.changed:.0e}",
            one.why,
            one.offered,
        ]
        for one in found
    ]
    save_figure(draw(found), RESULTS / "reductions.png")
    text = about(__doc__)
    picture = "![Size and time with each reduction, relative to without](reductions.png)"
    write("reductions", f"# Only what a scene needs\n\n{text}\n\n{picture}\n\n{table(head, rows)}")


if __name__ == "__main__":
    main()
