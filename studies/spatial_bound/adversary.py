"""An adversary of the bound in space: no solution without dilation, wherever it comes from, may lie below it.

`python -m studies.spatial_bound.adversary [COUNT [SECONDS]]` writes adversary.md beside this file: COUNT
random scenes of two to nine faces of each family (30), SECONDS of processor time a floor (3). Joints are dry or inner
by a coin, gravity is tilted, friction and push are drawn. Solutions are sought by the search itself, from forces drawn
at random and from states of little pressure of other seeds; walls with a depth are held against those of the plane as
well, whose solutions are solutions in space. All of them are certified apart from the bound: forces inside the true
cones, a mechanism that does not dilate, Γ = 0.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import LimitAnalysis, Scene, Status, build_assembly, parse_scene, solve
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.range import RangeOptions, load_range
from jld_core.models.zero_dilation.starts import low_compression_states
from jld_core.samples import box
from studies.families import halved_bond
from studies.spatial_bound import bound_in_space, range_in_space
from studies.spatial_bound.scenes import wall

TARGET: Final = Path(__file__).resolve().parent / "adversary.md"
_CERTIFIED: Final = 2e-6  # relative: twice what forces and mechanism of a certified solution may leave between them
_MOST: Final = 9  # faces
_SEEDS: Final = 10  # states of little pressure, and forces drawn at random, of each scene


def pile(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Two or three boxes of random sizes on one another, each set back or out by chance."""
    out, low = list[dict[str, Any]](), np.zeros(3)
    for k in range(int(rng.integers(2, 4))):
        size = rng.uniform(0.6, 1.4, 3)
        out.append(box(f"b{k}", tuple(low), tuple(low + size)))
        low = low + np.array([*rng.uniform(-0.2, 0.3, 2), size[2]])
    return out


def row(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Two to four boxes side by side, round a corner where there are more than two."""
    places = [(1, 0), (0, 0), (0, 1), (1, 1)][: int(rng.integers(2, 5))]
    high = float(rng.uniform(0.5, 2.0))
    return [box(f"b{k}", (i, j, 0.0), (i + 1.0, j + 1.0, high)) for k, (i, j) in enumerate(places)]


def bond(rng: np.random.Generator) -> list[dict[str, Any]]:
    """One or two bricks on halves, or on one another, of a random depth."""
    depth, low = float(rng.uniform(0.6, 2.0)), -float(rng.uniform(0.0, 0.3))
    out = [box("b0", (0.0, 0.0, 0.0), (1.0, depth, 1.0)), box("b1", (1.0, 0.0, 0.0), (2.0, depth, 1.0))]
    out.append(box("b2", (0.0, low, 1.0), (2.0, low + depth, 2.0)))
    if rng.random() < 0.5:
        out.append(box("b3", (0.5, 0.0, 2.0), (1.5, depth, 2.6)))
    return out


FAMILIES: Final[dict[str, Callable[[np.random.Generator], list[dict[str, Any]]]]] = {
    "pile": pile,
    "row": row,
    "bond": bond,
}


def drawn(family: str, rng: np.random.Generator) -> Scene:
    """A scene of a family on a slab, its gravity up to some 8° off the vertical."""
    angle, tilt = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.1, 0.1, 2)
    ground = box("ground", (-3.0, -3.0, -1.0), (6.0, 6.0, 0.0), support=True)
    return parse_scene(
        {
            "elements": [ground, *FAMILIES[family](rng)],
            "materials": {
                "density": 1.0,
                "gravity": 1.0,
                "dry": {"friction_coefficient": float(rng.uniform(0.3, 0.9))},
                "inner": {"tensile_strength": float(rng.choice([0.3, 3.0, 30.0])), "shear_strength": 3.0},
            },
            "loads": {
                "dead": [{"body": [float(tilt[0]), float(tilt[1]), 0.0]}],
                "live": [{"body": [math.cos(angle), math.sin(angle), 0.0]}],
            },
        }
    )


def others(side: MultiStartSearch, rng: np.random.Generator) -> list[float]:
    """λ ≥ 0, scaled, of certified solutions that other seeds and random forces lead to."""
    most = min(side.found.lowest_load, side.associative.bracket[1])
    size = float(abs(side.found.lowest.state.forces).max()) if side.found.lowest is not None else 1.0
    for _ in range(_SEEDS):
        pair = low_compression_states(side.fixed_point, float(rng.random()) * most, rng)
        if pair is not None:
            side.found.offer(pair)
        side.search_from(size * rng.normal(size=side.fixed_point.count), thorough=False)
    return [load for load in side.found.loads if load >= 0.0]


def of_family(family: str, count: int, seconds: float) -> str:
    """A line of the table."""
    rng = np.random.default_rng(18)
    done = solutions = closed = proven = lower = wrong = 0
    worst, spent = -math.inf, time.process_time()
    while done < count:
        assembly = build_assembly(drawn(family, rng))
        labels = np.where(assembly.free_faces, rng.random(len(assembly.labels)) < 0.7, assembly.labels)
        analysis = LimitAnalysis(assembly)
        proof = analysis.prove(labels)
        if len(labels) > _MOST or proof.status is not Status.COLLAPSE or not proof.load_factor > 0.0:
            continue
        done += 1
        extra = load_range(
            analysis, labels, ProximalOptions(), proof, RangeOptions(seconds, bound=bound_in_space)
        ).extra
        if extra["lowest_proven"] is None:
            continue
        side = MultiStartSearch(analysis, labels, ProximalOptions(), proof)
        side.search()
        unit = analysis.template.scaling.load
        loads = [load * unit for load in others(side, rng)] + [extra["lowest_found"]]
        bound, least = extra["lowest_proven"], min(loads)
        proven, closed, solutions = proven + 1, closed + extra["closed"], solutions + len(loads)
        lower += least < extra["lowest_found"] * (1.0 - 1e-5)
        worst = max(worst, bound / least - 1.0)
        wrong += bound > least * (1.0 + _CERTIFIED)
    mean = (time.process_time() - spent) / count
    return f"| {family} | {count} | {proven} | {closed} | {solutions} | {lower} | {worst:.1e} | {wrong} | {mean:.1f} |"


def of_the_plane(count: int, seconds: float) -> str:
    """Walls of the plane, which are scenes in space once they have a depth."""
    rng, started = np.random.default_rng(5), time.process_time()
    closed = wrong = lower = solutions = 0
    worst = -math.inf
    shapes = [(1, 1), (1, 2)]
    for turn in range(count):
        bricks, courses = shapes[turn % 2]
        friction = float(rng.uniform(0.3, 0.9))
        plane = solve(build_assembly(_with(halved_bond(bricks, courses), friction)), **_range(seconds)).facts
        deep = _with(wall(bricks, courses, float(rng.uniform(0.6, 3.0)), (1.0, 0.0, 0.0)), friction)
        space = range_in_space(build_assembly(deep), seconds)
        if space["lowest_proven"] is None:
            continue
        worst = max(worst, space["lowest_proven"] / plane["lowest_found"] - 1.0)
        wrong += space["lowest_proven"] > plane["lowest_found"] * (1.0 + _CERTIFIED)
        lower += space["lowest_found"] < plane["lowest_proven"] * (1.0 - 1e-5)
        closed, solutions = closed + space["closed"], solutions + 1
    mean = (time.process_time() - started) / count
    return (
        f"| walls of the plane | {count} | {solutions} | {closed} | {solutions} | {lower} | {worst:.1e} | {wrong} "
        f"| {mean:.1f} |"
    )


def _with(scene: Scene, friction: float) -> Scene:
    document = scene.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    document["materials"] = {**document["materials"], "dry": {"friction_coefficient": friction}}
    return parse_scene(document)


def _range(seconds: float) -> dict[str, Any]:
    return {"friction": "zero-dilation", "range": True, "floor_seconds": seconds}


def _table(count: int, seconds: float) -> Iterator[str]:
    yield from (of_family(name, count, seconds) for name in FAMILIES)
    yield of_the_plane(max(count // 3, 2), seconds)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 3.0
    lines = [
        "# No solution below the bound in space",
        "",
        f"Random scenes of at most {_MOST} faces, {seconds:g} s a floor: in how many there is a bound above zero, how "
        "many close, certified solutions held against the bound, scenes in which one of these lies below what the "
        "search had found (by more than 1e-5), how far the bound stands above the lowest of all at the most, relative, "
        f"and how often by more than {_CERTIFIED:g}. Walls of the plane with a depth: against the lowest found in the "
        "plane.",
        "",
        "| family | scenes | bounded | closed | solutions | lower | bound above, most | wrong | s each |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for line in _table(count, seconds):
        lines.append(line)
        print(line, flush=True)
        TARGET.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
