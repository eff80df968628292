"""How low collapse without dilation goes in space: found, and bounded from below with certificates, as far as it goes.

`python -m studies.spatial_bound.scenes [SECONDS [COUNT [NAME …]]]` writes scenes.md beside this file;
SECONDS of processor time for each floor (60), COUNT random labellings of each family (10). With names only the rows
that begin so are made again, in the table there is. In closed form: cubes slide at μ and
topple at b/h; walls with a depth, pushed along, have the value of the plane; a brick that stands on one of two halves
alone holds its turn by friction as well, λ = μ / (1 + e / c_T).
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jld_core import LimitAnalysis, Scene, Status, build_assembly, load_scene, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.limit import Proof
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.range import RangeOptions, load_range
from jld_core.models.zero_dilation.starts import starts
from jld_core.samples import box
from studies.families import halved_bond
from studies.report import SCENES
from studies.scenes import corner
from studies.spatial_bound import bound_in_space, range_in_space

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
    yield "the given cubes", load_scene(SCENES / "spatial_cubes.json"), "associative 0.3239797"
    along, askew, out = (1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 1.0, 0.0)
    for bricks, courses in ((1, 1), (1, 2), (2, 2), (2, 3), (2, 4)):
        yield f"wall {bricks} × {courses}, along", wall(bricks, courses, 2.0, along), "plane: 0.65"
    yield "wall 1 × 2, askew", wall(1, 2, 1.0, askew), "0.276767, by statics"
    yield "wall 1 × 2, out of plane", wall(1, 2, 1.0, out), "0.242025, by statics"
    yield "corner of cells, along", corner(1, 0.0, None), ""
    yield "corner of blocks, at 0.5 rad", corner(1, 0.5, "plain"), ""
    yield "corner of two courses, at 0.5 rad", corner(2, 0.5, "interlocking"), ""


def labelled(count: int) -> Iterator[tuple[str, LimitAnalysis, Bits, Proof]]:
    """Random labellings that collapse: family, analysis, labels and associative proof, `count` of each family.

    Walls of 2 × 2 bricks and corners of five cells under a random push, every joint dry or glued by a coin; the shelf
    of COMPAS CRA with μ 0.6 likewise.
    """
    for family in ("wall of 2 × 2", "corner of cells", "shelf"):
        rng, found = np.random.default_rng(5), 0
        while found < count:
            assembly = build_assembly(_of_family(family, float(rng.random() * np.pi)))
            free = assembly.free_faces
            labels = np.where(free, rng.random(len(free)) < 0.7, assembly.labels)
            analysis = LimitAnalysis(assembly)
            proof = analysis.prove(labels)
            if proof.status is Status.COLLAPSE and proof.load_factor > 0.0:
                found += 1
                yield family, analysis, labels, proof


def _of_family(family: str, angle: float) -> Scene:
    push = (float(np.cos(angle)), float(np.sin(angle)), 0.0)
    if family == "wall of 2 × 2":
        one = wall(2, 2, 1.0, push)
    elif family == "corner of cells":
        one = corner(1, angle, None)
    else:
        one = load_scene(SCENES / "spatial_shelf.json")
        one = one.model_copy(update={"loads": None})
    document = json.loads(one.model_dump_json(exclude_defaults=True))
    document["materials"] = {**document.get("materials", {}), "dry": {"friction_coefficient": 0.6}}
    document["materials"].setdefault("inner", {"tensile_strength": 20.0, "shear_strength": 20.0})
    document["loads"] = {"live": [{"body": list(push)}]}
    return parse_scene(document)


def row(name: str, scene: Scene, known: str, seconds: float) -> str:
    """One line of the table."""
    assembly = build_assembly(scene)
    start = time.process_time()
    started = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0).facts["lowest_found"]
    search = time.process_time() - start
    extra = range_in_space(assembly, seconds)
    bound, tolerance = extra["lowest_bound"], extra["bound_tolerance"]
    said = "proven, closed" if extra["closed"] else "proven"
    if not extra["proven"]:
        said = f"not proven, within {tolerance:g}" if tolerance > 0.0 else "nothing above 0"
    low, most, spent = extra["lowest_found"], extra["associative_load_factor"], extra["floor_seconds"]
    return (
        f"| {name} | {len(assembly.labels)} | {most:.7g} | {started:.7g} | {low:.9g} | {bound:.9g} | {said} | {known} "
        f"| {search:.1f} | {spent:.1f} |"
    )


def rows_of_labellings(count: int, seconds: float) -> Iterator[str]:
    """Random labellings, a line for each family: what states of little pressure find below four starts, and what the
    floor's own states find below those."""
    gains: dict[str, list[tuple[float, float, float, float]]] = {}
    for family, analysis, labels, proof in labelled(count):
        side = MultiStartSearch(analysis, labels, ProximalOptions(), proof)
        start = time.process_time()
        for forces in starts(side.fixed_point, proof):
            side.search_from(forces)
        started, low = time.process_time() - start, side.found.lowest_load
        side.search_low_compression()
        more, lower = time.process_time() - start - started, side.found.lowest_load
        extra = (
            load_range(analysis, labels, ProximalOptions(), proof, RangeOptions(seconds, bound=bound_in_space)).extra
            if family != "shelf"
            else {}
        )
        least = (extra.get("lowest_found") or math.inf) / analysis.template.scaling.load
        gains.setdefault(family, []).append((_share(lower, low), _share(least, lower), started, more))
    for family, table in gains.items():
        press, floor, started, more = np.array(table).T
        won = press[press > 1e-5]
        new = int((press == 1.0).sum())
        some = won[won < 1.0]
        yield (
            f"| {family} | {len(press)} | {len(won)} | {new} | {100.0 * some.mean() if len(some) else 0.0:.1f} % | "
            f"{100.0 * some.max(initial=0.0):.1f} % | {started.mean():.2f} | {more.mean():.2f} | "
            + (f"{int((floor > 1e-5).sum())}, by {100.0 * floor.max():.1f} % at most |" if family != "shelf" else "– |")
        )


def _share(lower: float, low: float) -> float:
    """How much lower, relative; 1 where nothing was found before, 0 where nothing is found."""
    if not math.isfinite(lower):
        return 0.0
    return 1.0 - lower / low if math.isfinite(low) else 1.0


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    count, short = (10, 5.0) if len(sys.argv) < 3 else (int(sys.argv[2]), 2.0 if int(sys.argv[2]) < 10 else 5.0)
    again, target = sys.argv[3:], ROOT / "scenes.md"
    head, little = _heads(seconds, short)
    lines = target.read_text(encoding="utf-8").splitlines() if again else head
    if not set(head) <= set(lines):
        raise SystemExit(f"{target}: a table of other seconds than {seconds:g}; make it whole, without names")

    def put(line: str) -> None:
        """In the place of the row of that name, else at the end."""
        name = line[: line.index("|", 1)]
        place = next((k for k, old in enumerate(lines) if old.startswith(name)), len(lines))
        lines[place : place + 1] = [line]
        print(line, flush=True)
        target.write_text("\n".join([*lines, ""]), encoding="utf-8")

    for name, scene, known in scenes():
        if not again or any(name.startswith(one) for one in again):
            put(row(name, scene, known, seconds))
    if not again:
        lines += little
        for line in rows_of_labellings(count, short):
            put(line)


def _heads(seconds: float, short: float) -> tuple[list[str], list[str]]:
    """What stands over the two tables."""
    return [
        "# How low collapse without dilation goes in space",
        "",
        "Starts: the lowest that proximal steps from four starts find and states of little pressure (below): what an "
        "objective ranks by. Found: with states of the relaxation certified as well. Bound: by frozen friction, "
        "products with polygons around the circles of friction, and parts; proven: with certificates checked in exact "
        "arithmetic, else the share it may be off by a solver's word. Closed: it meets the lowest found within 1e-6. "
        f"Seconds of processor time, one thread, {seconds:g} for a floor.",
        "",
        "| scene | faces | associative | starts | lowest found | bound | | known | search s | floor s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ], [
        "",
        "## States of little pressure",
        "",
        "Random labellings under a random push: how often search from states that press little on faces drawn at "
        "random ends below four starts, in how many of these those found nothing, by how much in the others, mean and "
        "most, what that takes, seconds of processor time a labelling, and how often the states of a floor of "
        f"{short:g} s lie lower still.",
        "",
        "| family | labellings | lower | found first | mean | most | starts s | more s | floor lower |",
        "|---|---|---|---|---|---|---|---|---|",
    ]


if __name__ == "__main__":
    main()
