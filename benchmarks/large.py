"""Large scenes: how reading and searching grow with the number of cells, and every kind of answer.

`python -m benchmarks.large [growth|answers]` writes a table for each part. Square walls of cells on a row of supports,
and cubes of cubes on a slab, under a horizontal body load, with blocks of up to four cells; and walls in running bond
whose every face is dry.
"""

from __future__ import annotations

import json
import math
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from studies.families import planar_running_bond, running_bond

from benchmarks.common import ROOT, about, apart, run_parts, table, write
from benchmarks.scenes import stacked, strength
from jld_core import build_assembly, load_scene, parse_scene, solve
from jld_core.scene.schema import Scene
from jld_core.threads import one_thread
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.space.symmetry import symmetry_group

Found = dict[str, Any]

DRY_WALLS: Final[dict[str, Callable[[int], Scene]]] = {
    "dry, out of plane": lambda courses: running_bond(courses, direction=(0.0, 1.0, 0.0)),
    "dry, in plane": lambda courses: running_bond(courses, direction=(1.0, 0.0, 0.0)),
    "dry, planar": planar_running_bond,
}
SIZES: Final = {  # cells along an edge, up to 80 089 and 13 824 cells; courses of dry walls, up to 10 100 blocks
    "planar": (10, 32, 100, 178, 200, 224, 245, 283),
    "spatial": (5, 10, 16, 20, 24),
    **dict.fromkeys(DRY_WALLS, (10, 20, 40, 60, 100)),
}

PHASES: Final = ("scene", "contacts", "symmetry", "space", "driver", "λ")
SECONDS: Final = 600  # processor time of one size
BYTES: Final = 16 << 30  # address space of one size


def document(kind: str, edge: int) -> dict[str, Any]:
    if kind in DRY_WALLS:
        return DRY_WALLS[kind](edge).model_dump(mode="json", exclude_unset=True)
    common = {
        "materials": {"density": 1400, "dry": {"friction_coefficient": 0.75}, "inner": strength(2e6)},
        "loads": {"live": [{"body": [1, 0] if kind == "planar" else [1, 0, 0]}]},
        "search": {"block_cells": [1, 4]},
    }
    if kind == "planar":
        rows = ["a" * edge] * edge + ["#" * edge]
        return {"name": f"{edge} × {edge}", "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows}, **common}
    return {"name": f"{edge} × {edge} × {edge}", "elements": stacked(edge, edge, edge, "-"), **common}


def phases(file: Path, evaluate: bool = True) -> Iterator[Found]:
    spent = time.process_time()

    def ended(name: str, **more: Any) -> Found:
        nonlocal spent
        now = time.process_time()
        seconds, spent = now - spent, now
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        return {"phase": name, "seconds": seconds, "memory": memory, **more}

    scene = load_scene(file)
    yield ended("scene")
    assembly = build_assembly(scene)
    yield ended("contacts", cells=len(assembly.elements.free), faces=len(assembly.interfaces))
    labelling = assembly.labels[None]
    if "search" in scene.model_fields_set:
        space = search_space(scene, assembly)
        both = ended("space")
        group = symmetry_group(assembly, scene, space.candidates, space.fixed)
        alone = ended("symmetry", group=len(group))
        yield alone
        yield {**both, "seconds": max(both["seconds"] - alone["seconds"], 0.0)}
        labelling = make_driver("random", space, 0).ask(1)
        yield ended("driver")
    if evaluate:
        with one_thread():
            found = evaluator_of(assembly, EvaluatorSettings()).evaluate_all(labelling)[0]
        width = (found.high - found.low) / abs(found.high) if found.high else math.nan
        yield ended("λ", load_factor=found.load_factor, status=str(found.status), width=width)


def run(kind: str, edge: int, seconds: int = SECONDS, most: int = BYTES) -> Found:
    """One size in a process of its own: seconds and memory by phase, as far as it came."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.json"
        file.write_text(json.dumps(document(kind, edge)))
        command = [sys.executable, "-m", "benchmarks.large", "one", str(file), str(seconds), str(most)]
        answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    found: Found = {"kind": kind, "edge": edge, "seconds": {}, "memory": {}}
    for line in answer.stdout.splitlines():
        ended = json.loads(line)
        phase = ended.pop("phase")
        found["seconds"][phase], found["memory"][phase] = ended.pop("seconds"), ended.pop("memory")
        found |= ended
    if answer.returncode:
        said = answer.stderr.strip().splitlines()
        # native code that is given no memory ends by a signal
        native = answer.returncode in (-signal.SIGSEGV, -signal.SIGABRT)
        memory = native or "memory" in (said[-1].lower() if said else "")
        found["ended"] = f"{most / 2**30:g} GB" if memory else f"{seconds} s"
    print(row_of(found), flush=True)
    return found


def row_of(found: Found) -> list[str]:
    seconds, memory = found["seconds"], found["memory"]
    sizes = [f"{found.get(key, 0):,}".replace(",", " ") if key in found else "–" for key in ("cells", "faces")]
    times = [f"{seconds[phase]:.2f}" if phase in seconds else "–" for phase in PHASES]
    before = f"{memory['driver']:.0f}" if "driver" in memory else "–"
    after = f"{memory['λ']:.0f}" if "λ" in memory else f"over {found.get('ended', 'the limit')}"
    return [found["kind"], *sizes, *times, before, after]


def exponent(series: list[Found], phase: str) -> str:
    """Exponent of cells by least squares on logarithms, of sizes above 900 cells and a hundredth of a second."""
    points = [(f["cells"], f["seconds"][phase]) for f in series if phase in f["seconds"] and f["cells"] > 900]
    points = [(cells, seconds) for cells, seconds in points if seconds > 0.01]
    if len(points) < 2:
        return "–"
    cells, seconds = np.log(np.array(points)).T
    return f"{np.polyfit(cells, seconds, 1)[0]:.2f}"


def growth() -> None:
    """How reading and searching grow: phase by phase, planar, spatial and dry walls, to 80 000 cells.

    Each size is a process of its own with its own limit of processor time and of memory; what it had not reached by
    then is a dash. Scene: the file read and validated. Contacts: from it to the assembly. Symmetry: the isometries
    looked for. Space: limits and connectivity, what may be labelled. Driver: the random driver up to its first
    labelling. λ: that labelling solved and proven; of dry walls, which nothing is searched for in, their own.
    """
    results = {kind: [run(kind, edge) for edge in sizes] for kind, sizes in SIZES.items()}
    head = ["kind", "cells", "faces", *(f"{phase}, s" for phase in PHASES), "MB before λ", "MB with λ"]
    rows = [row_of(found) for series in results.values() for found in series]
    powers = [[kind, *(exponent(series, phase) for phase in PHASES)] for kind, series in results.items()]
    limits = f"Limits of one size: {SECONDS} s and {BYTES / 2**30:g} GB, or what its row says. Memory is the highest "
    limits += "so far, of which Python and its libraries are some 200 MB."
    said = "Exponents of the number of cells, from 1 000 cells up (1: linear):"
    head_of_all, words = "# Growth with the number of cells", about(growth.__doc__)
    write("growth", head_of_all, words, limits, table(head, rows), said, table(["kind", *PHASES], powers))


def _one(file: str, seconds: str, most: str) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    resource.setrlimit(resource.RLIMIT_AS, (int(most), int(most)))
    for phase in phases(Path(file)):
        print(json.dumps(phase), flush=True)


ANSWER_EDGE: Final = 55  # cells along an edge of the wall
Content = dict[str, Any]


def live(*loads: int) -> Content:
    return {"loads": {"live": [{"body": list(loads)}]}}


def held(rows: list[str], below: bool) -> Content:
    """A wall held along both sides, and below or not."""
    return {"grid": {"rows": ["#" + row + "#" for row in (rows if below else rows[:-1])]}}


CRUSH: Final = {"compressive_strength": 2e6}
SIDES: Final = [{"name": name, "live": [{"body": way}]} for name, way in (("right", [1, 0]), ("left", [-1, 0]))]
ROWS: Final = ["a" * ANSWER_EDGE] * ANSWER_EDGE + ["#" * ANSWER_EDGE]

KINDS: Final[dict[str, tuple[str, Content]]] = {  # what changes in the scene, and its keys, by name
    "crushing": ("Stone and joints crush at 2 MPa", {"materials": {"dry": CRUSH, "inner": CRUSH}}),
    "two_cases": ("A push to each side", {"loads": {"cases": SIDES, "live": None}}),
    "locked": ("A load straight down: no collapse at any λ", live(0, -1)),
    "unstable": (
        "A dead load that pushes sideways by three times the weight: no λ ≥ 0 is admissible",
        {"materials": {"gravity": [30, -9.81]}},
    ),
    "frictionless": ("No friction in dry joints: λ = 0", {"materials": {"dry": {"friction_coefficient": 0.0}}}),
    "lifted": ("Supported on both sides and below, lifted: stones break", held(ROWS, True) | live(0, 1)),
    "lifted_aslant": ("The same, lifted at 45°", held(ROWS, True) | live(1, 1)),
    "hung_lifted": ("Supported on both sides alone, lifted", held(ROWS, False) | live(0, 1)),
    "hung_pressed": ("Supported on both sides alone, pressed down", held(ROWS, False) | live(0, -1)),
    "hung_weightless": (
        "Supported on both sides alone, without weight, lifted",
        held(ROWS, False) | {"loads": {"dead": [{"body": [0, 1]}], "live": [{"body": [0, 1]}]}},
    ),
    "surrounded": ("Supported all around, lifted: no collapse at any λ", held([ROWS[-1], *ROWS], True) | live(0, 1)),
    "weighed": (
        "Supported on the left side alone, lifted by its own weight: λ = 1",
        {"grid": {"rows": ["#" + row for row in ROWS[:-1]]}} | live(0, 1),
    ),
}

# status of each kind where it is not collapse
EXPECTED: Final = {"locked": "locked", "surrounded": "locked", "unstable": "unstable"}


def merged(content: Content, changes: Content) -> Content:
    """A document with keys replaced at any depth; None removes one."""
    found = dict(content)
    for key, value in changes.items():
        found[key] = merged(found.get(key, {}), value) if isinstance(value, dict) else value
    return {key: value for key, value in found.items() if value is not None}


def solve_kind(kind: str) -> dict[str, Any]:
    """Solve one kind in this process; return seconds, MB, status and bracket."""
    scene = parse_scene(merged(document("planar", ANSWER_EDGE), KINDS[kind][1]))
    assembly = build_assembly(scene)
    labels = make_driver("random", search_space(scene, assembly), 0).ask(1)[0]
    start = time.process_time()
    with one_thread():
        found = solve(assembly, labels)
    seconds = time.process_time() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return {"seconds": seconds, "memory": memory, "status": str(found.status), "bracket": found.bracket}


def answers() -> None:
    """One layout of 3 025 cells in blocks of up to four, for each kind of answer: from crushing to λ = 0.

    The square wall with 55 cells along an edge, and one change each. Each case is a process of its own with one
    thread: processor time from the assembly to a checked answer, and the highest memory.
    """
    rows = []
    for kind, (words, _) in KINDS.items():
        one = apart("large.solve_kind", kind)
        if one["status"] != EXPECTED.get(kind, "collapse"):
            raise SystemExit(f"{kind}: {one['status']}, expected {EXPECTED.get(kind, 'collapse')}")
        ends = ["–" if end is None or end != end else f"{end:.9g}" for end in one["bracket"]]
        rows.append([words, one["status"], *ends, f"{one['seconds']:.1f}", f"{one['memory']:.0f}"])
        print(rows[-1], flush=True)
    found = table("scene | status | lower bound | upper bound | s | MB", rows)
    write("large_answers", "# Answers of large scenes", about(answers.__doc__), found)


if __name__ == "__main__":
    if sys.argv[1:2] == ["one"]:
        _one(*sys.argv[2:])
    else:
        run_parts(growth=growth, answers=answers)
