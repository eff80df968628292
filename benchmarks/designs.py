"""Designs: `jld design` on four outlines, and what moved joints gain.

`python -m benchmarks.designs [examples [NAME…|--table]|joints]` writes a table for each part.
"""

from __future__ import annotations

import itertools
import json
import shlex
import shutil
import subprocess
import sys
import time
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT, about, run_parts, table, write
from jld_core import build_assembly, parse_scene, samples, solve
from jld_core.threads import one_thread
from jld_geometry import GeometrySearch, check_proof, move_joints, prove_box
from jld_geometry.search import MovedJoints

# options of the stone, the same for all outlines
STONE: Final = "--friction 0.6 --density 2000 --tension 3e5 --shear 5e5"

COMMANDS: Final = {  # outline and options of each example
    "wall": f'wall.svg --load "10 kN" --places 0.25 --push 0.05 --block-mass 56 --thickness 0.3 {STONE} --seconds 480',
    "bridge": f'bridge.csv --load "40 kN" --places 0.25,0.5 --block-mass 2500 --thickness 1 {STONE} --seconds 240',
    "jack_arch": f'jack_arch.csv --load "20 kN" --places 0.25,0.5 --block-mass 60 --thickness .3 {STONE} --seconds 120',
    "vault": f'vault.obj --load "5 kN" --places 0.25 --block-mass 600 {STONE} --seconds 240',
}

RUNS: Final = ROOT / "out" / "examples"


def run(name: str) -> None:
    """Design one outline and print it, as a user does; keep the lines with their times."""
    folder = RUNS / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    file, *options = shlex.split(COMMANDS[name])
    command = [sys.executable, "-m", "jld_explore", "design", f"scenes/outlines/{file}", "-o", str(folder), *options]
    start, lines = time.perf_counter(), []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        for line in process.stdout or ():
            lines.append((round(time.perf_counter() - start, 1), line.rstrip()))
            print(line, end="")
    if process.returncode:
        raise SystemExit(process.returncode)
    (folder / "log.json").write_text(json.dumps(lines), encoding="utf-8")
    subprocess.run([sys.executable, "-m", "jld_explore", "report", str(folder), "--pdf"], check=True, cwd=ROOT)


def row_of(name: str) -> list[str]:
    facts: dict[str, Any] = json.loads((RUNS / name / "summary.json").read_text(encoding="utf-8"))

    def span(bounds: list[float | None] | None) -> str:
        low, high = bounds or [None, None]
        if low is None:
            return "–" if high is None else "does not stand" if high < 0.0 else f"at most {high:.4g}"
        return f"{low:.4g}" + ("" if high is None else f" to {high:.4g}")

    usual, gain = facts["usual"] or {}, facts["gain"]
    best = f"{facts['tessellation']}, {facts['kind']}"
    asked = shlex.split(COMMANDS[name])[-1]
    blocks = len((RUNS / name / "blocks.csv").read_text(encoding="utf-8").splitlines()) - 1
    factors = [f"{one:.4g}" if one is not None else "–" for one in (usual.get("load_factor"), facts["load_factor"])]
    numbers = [factors[0], span(usual.get("fields")), best, str(blocks), factors[1], span(facts["fields"])]
    return [name.replace("_", " "), *numbers, "–" if gain is None else f"{gain:.3g}", asked, f"{facts['seconds']:.0f}"]


def examples() -> None:
    """Four designs by one command each.

    Each outline of `scenes/outlines` is designed by one command and printed by another; `tools/record_design.py` draws
    their pictures and the recording of the wall. `--table` writes the table of the runs in `out/examples`.
    """
    for name in [] if "--table" in sys.argv else sys.argv[1:] or COMMANDS:
        run(name)
    done = [name for name in COMMANDS if (RUNS / name / "summary.json").exists()]
    head = "outline | usual bond by faces | by fields | best | blocks | by faces | by fields | proven gain | "
    words = f"Written by `python -m benchmarks.designs`, beside other work. {about(examples.__doc__)}"
    rows = [row_of(name) for name in done]
    lines = "\n".join(f"jld design scenes/outlines/{COMMANDS[name]} -o out/{name}" for name in done)
    text = f"# Four designs by one command each\n\n{words}\n\n```sh\n{lines}\n```\n\n"
    write("design_examples", text + table(head + "time asked, s | time, s", rows))


Document = dict[str, Any]
CIRCLE: Final = [{"circle": [0.0, 0.0]}]  # joints that slide on the circles of an arch about the origin
SECONDS: Final = 60.0  # time limit of one search, s
TRIED: Final = 8  # number of steps of which times are taken


def arch(voussoirs: int, thickness: float, friction: float, load: str, **move: Any) -> Document:
    scene = samples.arch(voussoirs=voussoirs, thickness=thickness, load="push")
    document = json.loads(scene.model_dump_json(exclude_defaults=True))
    document["thickness"] = 1.0
    document["materials"] = {"density": 1000.0 / 9.81, "dry": {"friction_coefficient": friction}}
    if load == "quarter":
        name = f"v{voussoirs // 4}r0"
        outline = next(np.array(one["polygon"]) for one in document["elements"] if one["id"] == name)
        place = outline[np.linalg.norm(outline, axis=1) > 1.0].mean(axis=0)
        document["loads"] = {"live": [{"element": name, "force": [0.0, -1.0], "at": place.tolist()}]}
    return {**document, "move": {"along": CIRCLE, **move}}


def wall(friction: float, courses: int = 6, bricks: int = 4, **move: Any) -> Document:
    """Return a wall of 1.6 × 1.2 m in running bond, bricks of 0.4 × 0.2 m, pushed to either side."""
    length = 0.4 * bricks
    ground = [[-0.5, -0.2], [length + 0.5, -0.2], [length + 0.5, 0.0], [-0.5, 0.0]]
    elements: list[Document] = [{"id": "ground", "polygon": ground, "support": True}]
    for course in range(courses):
        cuts = [0.0, *np.arange(0.2 if course % 2 else 0.4, length - 0.1, 0.4).tolist(), length]
        low, high = 0.2 * course, 0.2 * (course + 1)
        for k, (a, b) in enumerate(itertools.pairwise(cuts)):
            elements.append({"id": f"c{course}b{k}", "polygon": [[a, low], [b, low], [b, high], [a, high]]})
    cases = [{"name": name, "live": [{"body": [sign, 0.0]}]} for name, sign in (("right", 1.0), ("left", -1.0))]
    materials = {"density": 1800.0, "dry": {"friction_coefficient": friction}}
    return {"name": "wall", "elements": elements, "materials": materials, "loads": {"cases": cases}, "move": move}


SPAN, HEIGHT, WIDE, DEEP = 2.0, 0.4, 1.0, 5.0


def flat_arch(parameters: int, angle: float = 15.0) -> Document:
    """Return the flat arch: tops of springings, of the key's joints, and their bottoms are parameters.

    angle: of friction, degrees.
    """
    half, wide, top, crown, root = 0.5 * SPAN, 0.5 * SPAN + WIDE, 1.2, 0.2, 0.1
    pier = [[half, -DEEP], [wide, -DEEP], [wide, HEIGHT], [top, HEIGHT], [half, 0.0]]
    wedge = [[root, 0.0], [half, 0.0], [top, HEIGHT], [crown, HEIGHT]]
    elements: list[Document] = [
        {"id": "key", "polygon": [[-root, 0.0], [root, 0.0], [crown, HEIGHT], [-crown, HEIGHT]]}
    ]
    for name, polygon in (("pier", pier), ("wedge", wedge)):
        elements += [{"id": f"{name} right", "polygon": polygon}]
        elements += [{"id": f"{name} left", "polygon": [[-x, y] for x, y in polygon[::-1]]}]
    ground = [[-5.0, -DEEP - 0.5], [5.0, -DEEP - 0.5], [5.0, -DEEP], [-5.0, -DEEP]]
    elements.append({"id": "ground", "polygon": ground, "support": True})
    ends = ((top, HEIGHT), (crown, HEIGHT), (root, 0.0))[:parameters]
    along = [{"at": [s * x, y], "direction": [s, 0.0]} for x, y in ends for s in (1, -1)]
    return {
        "elements": elements,
        "materials": {"density": 1000.0, "dry": {"friction_angle": angle}},
        "loads": {"live": [{"element": "key", "force": [0.0, -1.0], "at": [0.0, HEIGHT]}]},
        "move": {"along": along, "ties": "mirror-x"},
    }


def searches() -> list[tuple[str, Document, int, str]]:
    found = []
    for friction, wanted in ((0.35, "≥ 286"), (0.45, "≥ 605"), (0.70, "≥ 840")):
        found.append((f"semicircle n = 18, t/R .18, μ {friction:g}: λ", arch(18, 0.18, friction, "quarter"), 4, wanted))
    turned = [{"circle": [0.0, 0.0], "supports": True}]
    for name, along in (("springings stay", CIRCLE), ("springings turn", turned)):
        document = arch(24, 0.15, 0.5, "push", maximise="least_friction", along=along)
        found.append((f"friction of a semicircle, t/R .15, {name}: μ", document, 1, "≤ .136"))
    thin = arch(28, 0.12, 0.8, "push", maximise="least_thickness")
    found.append(("thickness of a semicircle, μ .8: t/R", thin, 1, "3 % below .10671"))
    found.append(("shear wall, μ .8, two ways: λ", wall(0.8), 1, ".8000"))
    key = json.loads((ROOT / "benchmarks" / "corpus" / "scenes" / "key.json").read_text(encoding="utf-8"))
    found.append(("key, cracks by faces: kN", key, 1, "≥ 13.1"))
    return found


def search(document: Document, starts: int) -> tuple[MovedJoints, float]:
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    start = time.process_time()
    done = move_joints(scene, assembly, assembly.labels, seconds=SECONDS, starts=starts)
    return done, time.process_time() - start


def proofs() -> list[list[str]]:
    rows = []
    boxes = {1: ([-0.15], [0.3]), 2: ([-0.15, -0.05], [0.3, 0.25]), 3: ([-0.1, -0.05, -0.05], [0.3, 0.2, 0.1])}
    for count, (low, high) in boxes.items():
        scene = parse_scene(flat_arch(count))
        assembly = build_assembly(scene)
        start = time.process_time()
        done = prove_box(scene, assembly, assembly.labels, (np.array(low), np.array(high)), seconds=300.0)
        seconds = time.process_time() - start
        best = ", ".join(f"{value:.4f}" for value in done.parameters)
        numbers = [f"{done.load_factor:.6g}", f"{done.bound:.6g}", f"{done.gap:.1e}", str(done.boxes)]
        passed, spent, _ = check_proof(done)
        checked = f"{spent:.1f}" if passed else "not passed"
        rows.append([str(count), *numbers, f"{seconds:.1f}", checked, best])
    return rows


def step_times() -> list[list[str]]:
    rows = []
    scenes = [("semicircle of 23 voussoirs, quarter load", arch(23, 0.18, 0.35, "quarter"))]
    scenes += [("wall of 11 courses of 6 bricks, two ways", wall(0.8, 11, 6))]
    for name, document in scenes:
        scene = parse_scene(document)
        assembly = build_assembly(scene)
        search = GeometrySearch(scene, assembly, assembly.labels)
        times: list[float] = []
        clock = time.process_time
        with one_thread():
            point = search.first()
            for _ in range(TRIED):
                assert point is not None
                start = clock()
                new, _ = search._try(point, 0.1 * search.unit)
                times.append(clock() - start)
                point = new or point
        faces = len(assembly.interfaces)
        sizes = [str(faces), str(len(assembly.by_case)), str(search.variables.basis.shape[1])]
        rows.append([name, *sizes, f"{np.median(times):.3f}", f"{max(times):.3f}"])
    return rows


def joints() -> None:
    """What moving joints gains, and how fast positions are proven.

    Structures are those of the trial on version 0.2. Loads of arches act on the middle of the extrados of the voussoir
    at 45°, weights are 1 kN/m² of elevation. Every value is a proven lower bound on λ, or stands with proof.
    """
    rows = []
    for name, document, starts, wanted in searches():
        done, seconds = search(document, starts)
        steps = len(done.points) - len({point.start for point in done.points})
        solves = done.points[-1].solves
        again = solve(done.scene)
        stands = "yes" if all(one.stands_at_zero for one in (again.cases.values() or [again])) else "no"
        counts = [str(starts), str(steps), str(solves), f"{seconds:.1f}", done.end]
        rows.append([name, f"{done.start:.5g}", f"{done.value:.6g}", wanted, *counts, stands])
        print(rows[-1], flush=True)
    head = "what | start | end | to reach | starts | steps | solves | s | ended | dead load stands"
    text = "# Joints that move\n\nWritten by `python -m benchmarks.designs joints`; one thread, processor time.\n\n"
    text += table(head, rows) + "\n\n## Proofs over boxes\n\nFlat arch on piers at 15°, gap asked for 1e-3.\n\n"
    text += table("parameters | λ found | bound | gap | boxes | s | checked in [s] | best position", proofs())
    text += "\n\n## Steps\n\nProcessor time of one step: a program over forces and positions, and a proven solve.\n\n"
    head = "scene | faces | cases | variables | median [s] | largest [s]"
    write("moving_joints", text + table(head, step_times()))


if __name__ == "__main__":
    run_parts(examples=examples, joints=joints)
