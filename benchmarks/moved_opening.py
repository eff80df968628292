"""Measure labels and geometry searched together: ``python -m benchmarks.moved_opening``.

A wall of 2 × 1.2 m, 0.3 m thick, over a semicircular opening of radius 0.7 m, in running bond of bricks 0.4 × 0.2 m
that are cut into half bricks. 10 kN on 0.2 m at quarter span and a push of 0.05 g; the worse counts. Blocks weigh
56 kg at the most. λ by fields, with blocks that crack anywhere; one clock of 600 s on two cores, then both brackets
refined. Joints move by fields as well: steps raise the bound from above on meshes that move with the blocks.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from benchmarks.common import table, write
from jld_core import build_assembly, parse_scene
from jld_core.assembly import Assembly
from jld_core.fields import bounds_by_fields
from jld_core.scene import Scene
from jld_explore import ExploreSettings
from jld_explore.moved_search import explore_and_move

LENGTH, HEIGHT, RADIUS, CELL, MASS = 2.0, 1.2, 0.7, 0.2, 56.0
"""Wall, opening and half brick, m; largest mass of a block, kg."""

SECONDS: Final = 600.0
"""Time limit of the search, s."""

REFINED: Final = (150.0, 30.0)
"""Time for refined bounds under the force and under the push, s."""


def opening() -> shapely.Polygon:
    """Return the opening, with corners where its circle meets the lines of the half bricks."""
    middle = 0.5 * LENGTH
    lines = [round(float(x), 12) for x in np.arange(0.4, 1.7, CELL)]
    points = {(x, float(np.sqrt(RADIUS**2 - (x - middle) ** 2))) for x in lines}
    for y in (round(float(y), 12) for y in np.arange(0.0, RADIUS, CELL)):
        half = float(np.sqrt(RADIUS**2 - y**2))
        points |= {(middle - half, y), (middle + half, y)}
    arc = sorted(points, key=lambda point: -np.arctan2(point[1], point[0] - middle))
    return shapely.Polygon([*arc, (middle + RADIUS, -1.0), (middle - RADIUS, -1.0)])


def pieces(width: float, shift: float) -> list[shapely.Polygon]:
    """Return bricks of a width around the opening, odd courses shifted; those below a quarter cell join a neighbour."""
    hole, found = opening(), []
    for course in range(round(HEIGHT / CELL)):
        for left in np.arange(-shift if course % 2 else 0.0, LENGTH - 1e-9, width):
            ends = (max(left, 0.0), course * CELL, min(left + width, LENGTH), (course + 1) * CELL)
            brick = shapely.box(*(round(float(end), 12) for end in ends))  # corners of the arc lie on these lines
            rest = brick.difference(hole)
            found += [(course, part) for part in getattr(rest, "geoms", [rest]) if part.area > 1e-6]
    while min(part.area for _, part in found) < 0.25 * CELL**2:
        course, small = found.pop(min(range(len(found)), key=lambda k: found[k][1].area))

        def contact(k: int, course: int = course, small: shapely.Polygon = small) -> float:
            """Length of the contact with a piece; pieces of the same course come first."""
            length = float(found[k][1].buffer(1e-9).intersection(small).length)
            return length + (1.0 if found[k][0] == course and length > 0.01 else 0.0)

        best = max(range(len(found)), key=contact)
        found[best] = (found[best][0], shapely.union_all([found[best][1], small]))
    return [part for _, part in found]


def corners(part: shapely.Polygon) -> list[list[float]]:
    """Return the corners of a piece, counter-clockwise, without those on straight edges."""
    ring = np.array(shapely.geometry.polygon.orient(part).exterior.coords)[:-1]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    bent = abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > 1e-9
    return np.asarray(ring[bent].round(12)).tolist()  # type: ignore[no-any-return]


def wall() -> Scene:
    """Return the wall of half bricks in running bond."""
    bricks = pieces(2 * CELL, CELL)
    elements: list[dict[str, Any]] = []
    for k, part in enumerate(pieces(CELL, 0.0)):
        block = max(range(len(bricks)), key=lambda k, part=part: bricks[k].intersection(part).area)  # type: ignore[misc]
        elements.append({"id": f"e{k}", "polygon": corners(part), "block": f"b{block}"})
    for k, left in enumerate((0.0, LENGTH - 0.3)):
        outline = [[left, -0.1], [left + 0.3, -0.1], [left + 0.3, 0.0], [left, 0.0]]
        elements.append({"id": f"s{k}", "polygon": outline, "support": True})
    loaded = next(
        one["id"] for one in elements if {(0.4, HEIGHT), (0.6, HEIGHT)} <= {(x, y) for x, y in one["polygon"]}
    )
    force = {"element": loaded, "force": [0.0, -1e4], "at": [0.5, HEIGHT], "width": 0.2}
    document = {
        "name": "wall with an opening",
        "elements": elements,
        "thickness": 0.3,
        "materials": {
            "density": 2000.0,
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": 3e5, "shear_strength": 5e5},
        },
        "loads": {"cases": [{"name": "force", "live": [force]}, {"name": "push", "live": [{"body": [0.05, 0.0]}]}]},
        "search": {"block_mass": [None, MASS]},
        "move": {"inner": "follow", "straight": False, "along": [{"circle": [0.5 * LENGTH, 0.0]}]},
    }
    return parse_scene(document)


def refined(assembly: Assembly) -> tuple[float, float]:
    """Return bounds on the governing λ by fields."""
    found = [
        bounds_by_fields(case, assembly.labels, gap=0.05, seconds=seconds)
        for case, seconds in zip(assembly.by_case, REFINED, strict=True)
    ]
    return min(one.lower for one in found), min(one.upper for one in found)


def _row(name: str, end: str, bounds: tuple[float, float], bond: tuple[float, float]) -> list[str]:
    """Return the row of a layout: its bounds, and the lower one over both bounds of the running bond."""
    numbers = [f"{value:.4g}" for value in bounds]
    return [name, end, *numbers, *(f"{bounds[0] / value:.3g}" for value in bond)]


def main() -> None:
    """Search, refine and write the table."""
    scene = wall()
    start, busy = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(seconds=SECONDS, jobs=2, pictures=False)
        done = explore_and_move(scene, Path(folder) / "out", 3, settings, print)
    load = os.getloadavg()[2]
    seconds, cores = time.perf_counter() - start, time.process_time() - busy
    best = done.best
    low, high = refined(build_assembly(scene))
    better_low, better_high = refined(build_assembly(best.scene))
    rows = [
        ["running bond", "–", f"{low:.4g}", f"{high:.4g}", "1", "–"],
        _row("best moved, as ranked", best.end, (best.low, best.high), (low, high)),
        _row("best moved, refined", "–", (better_low, better_high), (low, high)),
    ]
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    text = "# Labels and geometry together\n\nWritten by `python -m benchmarks.moved_opening`. " + about + "\n\n"
    text += table(
        [
            "layout",
            "ended",
            "λ by fields, at least",
            "at most",
            "over the bond, lower bounds",
            "over the most that the bond carries",
        ],
        rows,
    )
    text += f"\n\n{len(done.rounds)} rounds, {len(done.layouts)} layouts moved, {seconds:.0f} s (this process: "
    text += f"{cores:.0f} s of a core), ended: {done.stop}. Load average of the machine: {load:.1f}."
    write("moved_opening", text)


if __name__ == "__main__":
    main()
