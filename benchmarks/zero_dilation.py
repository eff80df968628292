"""How low collapse without dilation goes: found from every side, bounded from below with certificates, and in searches.

`python -m benchmarks.zero_dilation [SECONDS [SCENE…]]` writes the table; SECONDS of processor time for the floor of
walls 1, 3, 4 and 5 (600; less: none), thrice as many for wall 2, none for wall 6. With scenes named, only their rows
are made again; the others, and what is written below them, stand.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

from studies.by_scheme import solve_zero_dilation
from studies.families import halved_bond, opened_wall
from studies.scenes import leonardo_flat_arch

from benchmarks.common import RESULTS, ROOT
from jld_core import LimitAnalysis, Scene, SolveOptions, build_assembly, load_scene, solve
from jld_explore import search_space
from jld_explore.drivers.searcher import Random

WALLS = {1: 1.0, 2: 3.0, 3: 1.0, 4: 1.0, 5: 1.0, 6: 0.0}  # times as many seconds as are given for their floors
OPENED = ((0, 1), (1, 1), (0, 2))  # courses below and above an opening of three, in a wall of three bricks
WANTED = {"2 × 5": 0.6112957, "2 × 6": 0.5450550, "2 × 7": 0.4897959, "2 × 8": 0.4439197, "flat arch": 1305.8653}
HEAD = (
    "# How low collapse without dilation goes",
    "",
    "Found: by proximal steps from four starts and pivots between forces and mechanisms, each end certified. "
    "Bound: by frozen friction, products and sweeps; proven: with certificates checked in exact arithmetic. "
    "Seconds of processor time, one thread.",
    "",
    "| scene | faces | associative | highest found | lowest found | bound | | wanted | search s | floor s |",
    "|---|---|---|---|---|---|---|---|---|---|",
)
# random labellings of the beam-arch that collapse, on which the search is held against the gravity start alone
LABELLINGS = 200
DRAWN = 1000  # random labellings drawn for that; many are unstable


def scenes(most: float) -> Iterator[tuple[str, Scene, float]]:
    for courses in (4, 5, 6, 7, 8):
        yield f"2 × {courses}", halved_bond(2, courses), 120.0
    yield "flat arch", leonardo_flat_arch(), 20.0
    yield "3 × 6", halved_bond(3, 6), 300.0
    for below, above in OPENED:
        yield f"opening {below} + 3 + {above}", opened_wall(below, above), 120.0
    for wall, times in WALLS.items():
        yield f"wall {wall}", load_scene(ROOT / "scenes" / f"ferris_tinloi_{wall}.json"), times * most


def row_of(name: str, scene: Scene, seconds: float) -> str:
    start = time.process_time()
    result = solve(build_assembly(scene), friction="zero-dilation", range=True, floor_seconds=seconds)
    spent, extra = time.process_time() - start, result.facts
    bound = extra["lowest_bound"]
    said = "not sought" if bound is None else ("proven" if extra["proven"] else "bound, not proven")
    return (
        f"| {name} | {len(result.labels)} | {extra['associative_load_factor']:.7g} | {extra['highest_found']:.7g} "
        f"| {extra['lowest_found']:.10g} | {'' if bound is None else f'{bound:.10g}'} | {said} "
        f"| {WANTED.get(name, '')} | {spent - extra['floor_seconds']:.1f} | {extra['floor_seconds']:.1f} |"
    )


def beam_arch() -> list[str]:
    """The lowest found beside what the gravity start alone finds, and how many stay uncertified."""
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    model = SolveOptions(friction="zero-dilation", range=True, floor_seconds=0.0)
    above = lower = solved = open_ = open_before = 0
    start = time.process_time()
    for labels in Random(search_space(scene, assembly), seed=0, size=DRAWN).propose()[:DRAWN]:
        if solved == LABELLINGS:
            break
        associative = LimitAnalysis(assembly, reference=labels).solve(labels, stands=False)
        if str(associative.status) not in ("collapse", "locked"):
            continue
        solved += 1
        gravity = solve_zero_dilation(assembly, labels, start="gravity")
        found = solve(assembly, labels, **model.facts())
        open_before += str(gravity.status) == "uncertified"
        open_ += str(found.status) == "uncertified"
        if str(gravity.status) == str(found.status) == "collapse":
            above += found.load_factor > gravity.load_factor * (1.0 + 1e-9)
            lower += found.load_factor < gravity.load_factor * (1.0 - 1e-6)
    spent = time.process_time() - start
    return [
        f"{solved} random labellings of the beam-arch that collapse or lock: above the gravity start {above}, lower "
        f"than it {lower}; uncertified {open_}, by the gravity start alone {open_before}; {spent:.0f} s for both and "
        "the associative solves."
    ]


def main() -> None:
    most = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    named = sys.argv[2:]
    target = RESULTS / "zero_dilation_floor.md"
    made = {name: (scene, seconds) for name, scene, seconds in scenes(most)}
    unknown = [name for name in named if name not in made]
    if unknown:
        sys.exit(f"no scene {unknown[0]!r}: there are {', '.join(made)}")
    before = target.read_text(encoding="utf-8").splitlines() if named else []
    rows = {line.split("|")[1].strip(): line for line in before if line.startswith("| ")}
    # what is written below the table, by hand too, stands where rows are named
    last = max((k for k, line in enumerate(before) if line.startswith("| ")), default=-1)
    below = before[last + 1 :] if named else ["", *beam_arch()]
    print(*below, sep="\n", flush=True)
    for name in named or made:
        rows[name] = row_of(name, *made[name])
        print(rows[name], flush=True)
        table = [rows[name] for name in made if name in rows]
        target.write_text("\n".join([*HEAD, *table, *below, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
