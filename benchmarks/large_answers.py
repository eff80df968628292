"""One layout of 3 025 cells in blocks of up to four, for each kind of answer: from crushing to λ = 0.

The square wall of benchmarks/growth.py with 55 cells along an edge, and one change each. Each case is a process of its
own with one thread: processor time from the assembly to a checked answer, and the highest memory.
`python -m benchmarks.large_answers` writes the table.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Final

from benchmarks.common import ROOT, about, table, write
from benchmarks.growth import document
from jld_core import build_assembly, parse_scene, solve
from jld_core.threads import one_thread
from jld_explore.drivers import make_driver
from jld_explore.space import search_space

EDGE: Final = 55
"""Cells along an edge of the wall."""

Content = dict[str, Any]


def crushing(content: Content) -> None:
    """Stone and joints crush at 2 MPa."""
    content["materials"]["dry"]["compressive_strength"] = 2e6
    content["materials"]["inner"]["compressive_strength"] = 2e6


def two_cases(content: Content) -> None:
    """A push to each side."""
    sides = {"right": [1, 0], "left": [-1, 0]}
    content["loads"] = {"cases": [{"name": name, "live": [{"body": way}]} for name, way in sides.items()]}


def locked(content: Content) -> None:
    """A load straight down: no collapse at any λ."""
    content["loads"] = {"live": [{"body": [0, -1]}]}


def unstable(content: Content) -> None:
    """A dead load that pushes sideways by three times the weight: no λ ≥ 0 is admissible."""
    content["materials"]["gravity"] = [30, -9.81]


def frictionless(content: Content) -> None:
    """No friction in dry joints: λ = 0."""
    content["materials"]["dry"]["friction_coefficient"] = 0.0


def _held(content: Content, below: bool, live: list[int]) -> None:
    """Hold a wall along both sides, and below or not; live: body load."""
    rows = ["#" + row + "#" for row in content["grid"]["rows"]]
    content["grid"]["rows"] = rows if below else rows[:-1]
    content["loads"] = {"live": [{"body": live}]}


def lifted(content: Content) -> None:
    """Supported on both sides and below, lifted: stones break."""
    _held(content, True, [0, 1])


def lifted_aslant(content: Content) -> None:
    """The same, lifted at 45°."""
    _held(content, True, [1, 1])


def hung_lifted(content: Content) -> None:
    """Supported on both sides alone, lifted."""
    _held(content, False, [0, 1])


def hung_pressed(content: Content) -> None:
    """Supported on both sides alone, pressed down."""
    _held(content, False, [0, -1])


def hung_weightless(content: Content) -> None:
    """Supported on both sides alone, without weight, lifted."""
    _held(content, False, [0, 1])
    content["loads"]["dead"] = [{"body": [0, 1]}]


def surrounded(content: Content) -> None:
    """Supported all around, lifted: no collapse at any λ."""
    _held(content, True, [0, 1])
    rows = content["grid"]["rows"]
    content["grid"]["rows"] = [rows[-1], *rows]


def weighed(content: Content) -> None:
    """Supported on the left side alone, lifted by its own weight: λ = 1."""
    content["grid"]["rows"] = ["#" + row for row in content["grid"]["rows"][:-1]]
    content["loads"] = {"live": [{"body": [0, 1]}]}


KINDS: Final[dict[str, Callable[[Content], None]]] = {
    function.__name__: function
    for function in (
        *(crushing, two_cases, locked, unstable, frictionless),
        *(lifted, lifted_aslant, hung_lifted, hung_pressed, hung_weightless, surrounded, weighed),
    )
}
"""Changes of the scene by name."""

EXPECTED: Final = {"locked": "locked", "surrounded": "locked", "unstable": "unstable"}
"""Status of each kind where it is not collapse."""


def measure(kind: str) -> dict[str, Any]:
    """Solve one kind in this process; return seconds, MB, status and bracket."""
    content = document("planar", EDGE)
    KINDS[kind](content)
    scene = parse_scene(content)
    assembly = build_assembly(scene)
    labels = make_driver("random", search_space(scene, assembly), 0).ask(1)[0]
    start = time.process_time()
    with one_thread():
        found = solve(assembly, labels)
    seconds = time.process_time() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return {"seconds": seconds, "memory": memory, "status": str(found.status), "bracket": found.bracket}


def main() -> None:
    """Measure all kinds and write the table."""
    rows = []
    for kind, change in KINDS.items():
        command = [sys.executable, "-m", "benchmarks.large_answers", kind]
        one = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
        if one["status"] != EXPECTED.get(kind, "collapse"):
            raise SystemExit(f"{kind}: {one['status']}, expected {EXPECTED.get(kind, 'collapse')}")
        low, high = ("–" if end is None or end != end else f"{end:.9g}" for end in one["bracket"])
        rows.append(
            [
                (change.__doc__ or "").rstrip("."),
                one["status"],
                low,
                high,
                f"{one['seconds']:.1f}",
                f"{one['memory']:.0f}",
            ]
        )
        print(rows[-1], flush=True)
    head = ["scene", "status", "lower bound", "upper bound", "s", "MB"]
    write("large_answers", "\n\n".join(["# Answers of large scenes", about(__doc__), table(head, rows)]))


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1]))) if len(sys.argv) > 1 else main()
