"""Labellings in lanes, hard ones: what the batch solver answers scene by scene, and what is left to the ladder.

Random segmentations of walls, arches and polygons; then scenes in which forces may grow for ever, nothing rubs or
something crushes, and faces labelled by themselves, which are no segmentations; then spatial ones. Shares are of all
labellings of a scene: what the batch solver answers as a collapse with both bounds, as locked (a state and a ray), as
unstable; the rest is left to the ladder, which says of a few what they are. Times: processor time a labelling, what is
left counted at the ladder's time, beside the usual way on some of the same labellings.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from studies.scenes import corner

from benchmarks.common import about, random_segmentations, scene, table, wall, write
from benchmarks.scenes import box
from jld_core import Assembly, Scene, build_assembly, parse_scene, samples
from jld_core.arrays import Bits
from jld_core.batch.library import described
from jld_core.limit import BatchAnalysis, SolveOptions
from jld_core.models import limit_analysis
from jld_core.refinement import refine
from jld_core.samples import Stone

MANY: Final = 512
FEW: Final = 6
"""Of what is left, solved to say what it is."""


@dataclass(frozen=True)
class Hard:
    """A scene. any_label: faces are labelled by themselves, not by blocks. many: labellings. one: how many of them
    the usual way is timed on. kern: bending of inner faces in the kern form."""

    make: Callable[[], Assembly]
    any_label: bool = False
    many: int = MANY
    one: int = 24
    kern: bool = False


def grid(
    rows: list[str], live: list[dict[str, Any]] | None = None, *, friction: float = 0.6, **inner: float
) -> Assembly:
    """Cells of 0.1 m, 1400 kg/m³, pushed sideways unless said otherwise. inner: keys of the inner material, σt = τ = 20
    kPa by default; crush: compressive strength of dry joints."""
    dry = {"friction_coefficient": friction} | (
        {"compressive_strength": inner.pop("crush")} if "crush" in inner else {}
    )
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": {
            "density": 1400,
            "dry": dry,
            "inner": {"tensile_strength": 2e4, "shear_strength": 2e4, **inner},
        },
        "loads": {"live": live or [{"body": [1, 0]}]},
    }
    return build_assembly(parse_scene(document))


def cells(what: Scene, size: tuple[float, ...], kind: str = "voronoi") -> Assembly:
    """A scene cut into cells, every face free to be dry or inner."""
    return build_assembly(refine(what, size, kind=kind).scene)


def drum(stone: Stone) -> Assembly:
    """A wall of one leaf that is cut into polygons, about 60."""
    return cells(samples.grid(columns=1, rows=1, cell=1.6, height=1.2, stone=stone), (0.2, 0.2))


def cubes(size: int, strength: float, load: tuple[float, float, float] = (1.0, 0.3, 0.0)) -> Assembly:
    """Cubes of 0.1 m on a base, pushed at a top corner."""
    places = [(x, y, z) for z in range(size) for y in range(size) for x in range(size)]
    elements = [
        box(f"c{x}{y}{z}", (0.1 * x, 0.1 * y, 0.1 * z), (0.1 * (x + 1), 0.1 * (y + 1), 0.1 * (z + 1)))
        for x, y, z in places
    ]
    elements.append(box("base", (-0.1, -0.1, -0.1), (0.1 * (size + 1), 0.1 * (size + 1), 0.0), support=True))
    document = {
        "elements": elements,
        "materials": {
            "density": 1400,
            "dry": {"friction_angle": 30},
            "inner": {"tensile_strength": strength, "shear_strength": strength},
        },
        "loads": {"live": [{"element": f"c00{size - 1}", "force": list(load)}]},
    }
    return build_assembly(parse_scene(document))


def corner_of_studies() -> Assembly:
    """The corner of two walls, every cell by itself, pushed outwards."""
    return build_assembly(corner(4, np.radians(225.0), None))


def prisms(sides: int, wide: int, high: int, strength: float = 2e4) -> Assembly:
    """Columns of prisms over regular polygons that touch along their sides (six) or not at all, on a slab."""
    apothem = 0.1
    radius = apothem / np.cos(np.pi / sides)
    turn = np.pi / sides
    angles = turn + 2.0 * np.pi * np.arange(sides) / sides
    outline = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    elements: list[dict[str, Any]] = []
    for i in range(wide):
        for k in range(high):
            low, top = 0.15 * k, 0.15 * (k + 1)
            placed = outline + np.array([2.0 * apothem * i, 0.0])
            points = np.concatenate([np.column_stack([placed, np.full(sides, z)]) for z in (low, top)])
            ring = list(range(sides))
            faces = [
                ring[::-1],
                [sides + j for j in ring],
                *([j, (j + 1) % sides, sides + (j + 1) % sides, sides + j] for j in ring),
            ]
            elements.append({"id": f"p{i}.{k}", "vertices": points.tolist(), "faces": faces})
    elements.append(box("slab", (-1.0, -1.0, -0.2), (2.0 * apothem * wide + 1.0, 1.0, 0.0), support=True))
    document = {
        "elements": elements,
        "materials": {
            "density": 2000,
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": strength, "shear_strength": strength},
        },
        "loads": {"live": [{"body": [1.0, 0.4, 0.0]}]},
    }
    return build_assembly(parse_scene(document))


DOWN: Final = [{"element": "c2r0", "force": [0, -1]}]
WEAK: Final = Stone(tension=2e3, shear=2e3)

SEGMENTED: Final[dict[str, Hard]] = {
    "wall 6 × 8": Hard(lambda: wall(6, 8)),
    "wall 6 × 8, 2 kPa": Hard(lambda: wall(6, 8, 2e3, 2e3)),
    "wall 5 × 5 on two supports": Hard(lambda: grid(["aaaaa"] * 5 + ["#...#"])),
    "arch of 3 rings of 20, pushed": Hard(lambda: build_assembly(samples.arch(rings=3, voussoirs=20))),
    "the same, pressed at a quarter": Hard(lambda: build_assembly(samples.arch(rings=3, voussoirs=20, load="quarter"))),
    "arch of 2 rings of 16, weak": Hard(lambda: build_assembly(samples.arch(rings=2, voussoirs=16, stone=WEAK))),
    "buttress": Hard(lambda: build_assembly(samples.buttress())),
    "polygons in a wall": Hard(lambda: drum(Stone())),
    "polygons in a weak wall": Hard(lambda: drum(WEAK)),
    "polygons of a flat arch": Hard(lambda: cells(samples.flat_arch(voussoirs=1), (0.15, 0.15))),
    "24 faces, flagship": Hard(lambda: scene("flat_beam_arch")),
}
HARD: Final[dict[str, Hard]] = {
    "flat arch between abutments": Hard(lambda: build_assembly(samples.flat_arch(rings=3))),
    "the same, any label": Hard(lambda: build_assembly(samples.flat_arch(rings=3)), any_label=True),
    "beam between abutments": Hard(lambda: grid(["#aaaaa#"] * 3, DOWN)),
    "the beam, any label": Hard(lambda: grid(["#aaaaa#"] * 3, DOWN), any_label=True),
    "the beam, inner faces rub": Hard(lambda: grid(["#aaaaa#"] * 3, DOWN, friction_coefficient=0.5), any_label=True),
    "the beam, joints crush": Hard(lambda: grid(["#aaaaa#"] * 3, DOWN, crush=5e4), any_label=True),
    "wall pressed down": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], [{"body": [0, -1]}])),
    "wall without friction": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], friction=0.0)),
    "without friction, any label": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], friction=0.0), any_label=True),
    "wall, no shear strength": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], shear_strength=0.0), any_label=True),
    "wall, no tensile strength": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], tensile_strength=0.0), any_label=True),
    "wall that crushes": Hard(lambda: grid(["aaaaaa"] * 4 + ["######"], crush=2e4, compressive_strength=1e5)),
    "overhang": Hard(lambda: grid(["aaaaaa", "aaaa..", "aa....", "##...."], [{"body": [0, -1]}])),
    "strengths of 1 GPa": Hard(
        lambda: grid(["aaaa"] * 4 + ["####"], tensile_strength=1e9, shear_strength=1e9), any_label=True
    ),
}
SPATIAL: Final[dict[str, Hard]] = {
    "cubes 3 × 3 × 3, 20 kPa": Hard(lambda: cubes(3, 2e4), many=256, one=12),
    "cubes 3 × 3 × 3, 200 Pa": Hard(lambda: cubes(3, 2e2), many=256, one=12),
    "cubes 3 × 3 × 3 pressed down": Hard(lambda: cubes(3, 2e4, (0.0, 0.0, -1.0)), many=256, one=12),
    "cubes 4 × 4 × 4": Hard(lambda: cubes(4, 2e4), many=96, one=4),
    "corner of the studies, 225°": Hard(corner_of_studies, many=256, one=20),
    "the same, kern form": Hard(corner_of_studies, many=256, one=20, kern=True),
    "hexagonal prisms": Hard(lambda: prisms(6, 4, 4), many=256, one=16),
    "octagonal prisms, weak": Hard(lambda: prisms(8, 4, 4, 2e3), many=256, one=16),
    "dome": Hard(lambda: build_assembly(samples.dome()), many=96, one=6),
    "barrel vault": Hard(lambda: build_assembly(samples.vault(voussoirs=6, courses=3)), many=128, one=8),
}


def labellings_of(assembly: Assembly, hard: Hard) -> Bits:
    """Segmentations, or labels face by face."""
    if not hard.any_label:
        return random_segmentations(assembly, hard.many, seed=7)
    dice = np.random.default_rng(7)
    return dice.random((hard.many, len(assembly.interfaces))) < dice.random((hard.many, 1))


def measure(name: str, hard: Hard) -> list[str]:
    """One row of the table."""
    assembly = hard.make()
    analysis = limit_analysis(assembly, SolveOptions(inner_bending="kern") if hard.kern else SolveOptions())
    labellings = labellings_of(assembly, hard)
    batch = BatchAnalysis.of(analysis)
    faces = str(len(assembly.interfaces))
    if batch is None:
        return [name, faces, str(len(labellings)), *["–"] * 4, "100", "rows of another shape", *["–"] * 3]
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
    single = (time.process_time() - start) / hard.one
    whole = kernel + each * len(left) / len(labellings)
    count = len(labellings)
    collapse = found.settled & ~found.falls & ~found.locked
    return [
        name,
        faces,
        str(count),
        f"{100.0 * (raw.tries == 1).mean():.0f}",
        *(f"{100.0 * share.mean():.1f}" for share in (collapse, found.locked, found.falls)),
        f"**{100.0 * len(left) / count:.1f}**",
        ", ".join(f"{number} {status}" for status, number in sorted(known.items())) or "–",
        f"{1e3 * single:.2f}",
        f"{1e6 * whole:.0f}",
        f"{single / whole:.0f}",
    ]


def main() -> None:
    """Measure all scenes and write benchmarks/results/lanes_hard.md."""
    head = [
        "scene",
        "faces",
        "labellings",
        "first try, %",
        "collapse, %",
        "locked, %",
        "unstable, %",
        "left to the ladder, %",
    ]
    head += ["what a few of them are", "one at a time, ms", "in lanes, all in, µs", "times"]
    rows = []
    for title, scenes in (("", SEGMENTED), ("**hard**", HARD), ("**spatial**", SPATIAL)):
        if title:
            rows.append([title, *[""] * (len(head) - 1)])
        for name, hard in scenes.items():
            rows.append(measure(name, hard))
            print(" | ".join(rows[-1]), flush=True)
    write(
        "lanes_hard",
        f"# Hard labellings in lanes\n\n{about(__doc__)}\n\n{table(head, rows)}\n\n{described().capitalize()}.",
    )


if __name__ == "__main__":
    main()
