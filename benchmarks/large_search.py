"""A search at 2 500 planar cells: processor time of a layout, proven to 1e-6, and layouts a minute on two free cores.

The square wall of benchmarks/growth.py with 50 cells along an edge, blocks of up to four cells: as it is, under a push
to each side with mirror images merged, and with supports along one side as well. Layouts are those that the random
driver asks for first. Each wall is a process of its own with one thread, and layouts are solved one after another as a
worker does; the first one, which prepares what all share, is not counted. Layouts a minute: two workers at this rate.
`python -m benchmarks.large_search [LAYOUTS]` writes the table.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Final

from benchmarks.common import ROOT, about, table, write
from benchmarks.growth import document
from jld_core import build_assembly, parse_scene
from jld_core.threads import one_thread
from jld_explore.drivers import make_driver
from jld_explore.evaluation import Evaluation, EvaluatorSettings, evaluator_of
from jld_explore.space import search_space

EDGE: Final = 50
"""Cells along an edge of the wall."""

LAYOUTS: Final = 20
"""Layouts that are counted of each wall."""

Content = dict[str, Any]


def plain(content: Content) -> None:
    """As it is."""


def symmetric(content: Content) -> None:
    """Pushed to each side, mirror images merged: two load cases a layout."""
    sides = {"right": [1, 0], "left": [-1, 0]}
    content["loads"] = {"cases": [{"name": name, "live": [{"body": way}]} for name, way in sides.items()]}
    content["search"]["symmetry"] = "mirror-x"


def supported(content: Content) -> None:
    """Supported along its left side as well."""
    content["grid"]["rows"] = ["#" + row for row in content["grid"]["rows"]]


WALLS: Final[dict[str, Callable[[Content], None]]] = {one.__name__: one for one in (plain, symmetric, supported)}
"""Changes of the scene by name."""

BEFORE: Final = "1.45 to 1.9"
"""Processor seconds of a layout of the wall as it is, before directions were corrected for longer steps."""


def measure(name: str, layouts: int) -> dict[str, Any]:
    """Solve layouts of one wall; return their mean processor time, and how many have a bracket or a proof."""
    content = document("planar", EDGE)
    WALLS[name](content)
    scene = parse_scene(content)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    driver, spent = make_driver("random", space, 0), 0.0
    found: list[Evaluation] = []
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    while len(found) <= layouts:
        asked = driver.ask(layouts + 1 - len(found))
        if not len(asked):
            break
        with one_thread():
            for labels in asked:
                start = time.process_time()
                found += evaluator.evaluate_all(labels[None])
                spent += (time.process_time() - start) * (len(found) > 1)
    widths = [(one.high - one.low) / abs(one.high) for one in found if str(one.status) == "collapse"]
    proven = sum(str(one.status) != "uncertified" for one in found)
    return {"seconds": spent / (len(found) - 1), "layouts": len(found) - 1, "open": len(found) - proven,
            "width": max(widths, default=math.nan)}  # fmt: skip


def main(layouts: int = LAYOUTS) -> None:
    """Measure all walls and write the table."""
    rows = []
    for name, change in WALLS.items():
        command = [sys.executable, "-m", "benchmarks.large_search", name, str(layouts)]
        one = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
        before = BEFORE if name == "plain" else "–"
        numbers = [before, f"{one['seconds']:.2f}", f"{120.0 / one['seconds']:.0f}"]
        rows.append(
            [(change.__doc__ or "").rstrip("."), str(one["layouts"]), *numbers, f"{one['width']:.0e}", str(one["open"])]
        )
        print(rows[-1], flush=True)
    head = ["wall", "layouts", "before, s", "s of a layout", "layouts a minute", "widest bracket", "uncertified"]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    write("large_search", "\n\n".join(["# A search at 2 500 cells", about(__doc__), table(head, rows), load]))


if __name__ == "__main__":
    if len(sys.argv) > 2:
        print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
    else:
        main(*map(int, sys.argv[1:]))
