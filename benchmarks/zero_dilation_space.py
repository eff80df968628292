"""How low collapse without dilation goes in space: found, and bounded from below with certificates, as far as it goes.

`python -m benchmarks.zero_dilation_space [SECONDS]` writes benchmarks/results/zero_dilation_space.md; SECONDS of
processor time for each floor (60). In closed form: cubes slide at μ and topple at b/h; walls with a depth, pushed
along, have the value of the plane.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from studies.families import halved_bond
from studies.scenes import corner

from jld_core import Scene, build_assembly, load_scene, parse_scene, solve
from jld_core.samples import box

ROOT = Path(__file__).resolve().parent


def cubes(places: list[tuple[float, float, float]], friction: float, degrees: float) -> Scene:
    """Unit cubes of unit weight on a slab, pushed under an angle to x."""
    angle = np.radians(degrees)
    elements = [box("ground", (-3, -3, -1), (5, 5, 0), support=True)]
    elements += [box(f"b{k}", low, tuple(x + 1 for x in low)) for k, low in enumerate(places)]
    return scene(elements, friction, (float(np.cos(angle)), float(np.sin(angle)), 0.0))


def wall(bricks: int, courses: int, depth: float, live: tuple[float, float, float]) -> Scene:
    """The planar wall of `halved_bond` with a depth."""
    elements = [box("ground", (-3, -3, -1), (4 * bricks + 3, depth + 3, 0), support=True)]
    for element in (halved_bond(bricks, courses).elements or [])[1:]:
        outline = np.array(element.polygon or [])
        low, high = outline.min(axis=0), outline.max(axis=0)
        elements.append(box(element.id, (low[0], 0.0, low[1]), (high[0], depth, high[1])))
    return scene(elements, 0.65, live)


def scene(elements: list[dict[str, Any]], friction: float, live: tuple[float, float, float]) -> Scene:
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    return parse_scene({"elements": elements, "materials": materials, "loads": {"live": [{"body": list(live)}]}})


def scenes() -> Iterator[tuple[str, Scene, str]]:
    """Name, scene, and what is known of it."""
    low, high, beside = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    yield "cube, μ 0.3, at 30°", cubes([low], 0.3, 30.0), "μ = 0.3"
    yield "cube, μ 1.5, at 30°", cubes([low], 1.5, 30.0), "1/cos 30° = 1.154701"
    yield "two cubes, one on the other, at 30°", cubes([low, high], 0.7, 30.0), "1/(2 cos 30°) = 0.577350"
    yield "two cubes, side by side, along", cubes([low, beside], 0.7, 0.0), "at most 0.7"
    yield "two cubes, side by side, at 30°", cubes([low, beside], 0.7, 30.0), "at most 0.7"
    yield "the given cubes", load_scene(ROOT.parent / "scenes" / "spatial_cubes.json"), "associative 0.3239797"
    along, askew, out = (1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 1.0, 0.0)
    for bricks, courses in ((1, 1), (1, 2), (2, 2), (2, 3), (2, 4)):
        yield f"wall {bricks} × {courses}, along", wall(bricks, courses, 2.0, along), "plane: 0.65"
    yield "wall 1 × 2, askew", wall(1, 2, 1.0, askew), "starts: 0.357143"
    yield "wall 1 × 2, out of plane", wall(1, 2, 1.0, out), "starts: 0.285714"
    yield "corner of cells, along", corner(1, 0.0, None), ""
    yield "corner of blocks, at 0.5 rad", corner(1, 0.5, "plain"), ""
    yield "corner of two courses, at 0.5 rad", corner(2, 0.5, "interlocking"), ""


def row(name: str, scene: Scene, known: str, seconds: float) -> str:
    """One line of the table."""
    assembly = build_assembly(scene)
    start = time.process_time()
    started = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0).extra["lowest_found"]
    search = time.process_time() - start
    extra = solve(assembly, friction="zero-dilation", range=True, floor_seconds=seconds).extra
    bound, tolerance = extra["lowest_bound"], extra["bound_tolerance"]
    said = "proven, closed" if extra["closed"] else "proven"
    if not extra["proven"]:
        said = f"not proven, within {tolerance:g}" if tolerance > 0.0 else "nothing above 0"
    low, most, spent = extra["lowest_found"], extra["associative_load_factor"], extra["floor_seconds"]
    return (
        f"| {name} | {len(assembly.labels)} | {most:.7g} | {started:.7g} | {low:.9g} | {bound:.9g} | {said} | {known} "
        f"| {search:.1f} | {spent:.1f} |"
    )


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    lines = [
        "# How low collapse without dilation goes in space",
        "",
        "Starts: the lowest that proximal steps from four starts find. Found: with states of the relaxation certified "
        "as well. Bound: by frozen friction, products with polygons around the circles of friction, and parts; proven: "
        "with certificates checked in exact arithmetic, else the share it may be off by a solver's word. Closed: it "
        f"meets the lowest found within 1e-6. Seconds of processor time, one thread, {seconds:g} for a floor.",
        "",
        "| scene | faces | associative | starts | lowest found | bound | | known | search s | floor s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    target = ROOT / "results" / "zero_dilation_space.md"
    target.parent.mkdir(exist_ok=True)
    for name, scene, known in scenes():
        lines.append(row(name, scene, known, seconds))
        print(lines[-1], flush=True)
        target.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
