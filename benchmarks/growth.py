"""How reading and searching grow with the number of cells: phase by phase, planar and spatial, to 10⁵ cells.

Square walls of cells on a row of supports, and cubes of cubes on a slab, under a horizontal body load, with blocks of
up to four cells. Each size is a process of its own with its own limit of processor time and of memory; what it had
not reached by then is a dash. Scene: the file read and validated. Contacts: from it to the assembly. Symmetry: the
isometries looked for. Space: limits and connectivity, what may be labelled. Driver: the random driver up to its first
labelling. λ: that labelling solved and proven.
"""

from __future__ import annotations

import itertools
import json
import math
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, ROOT, about, table, write
from jld_core import build_assembly, load_scene
from jld_core.threads import one_thread
from jld_explore.drivers import make_driver
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.space import search_space
from jld_explore.space.symmetry import symmetry_group

SIZES: Final = {"planar": (10, 32, 100, 178, 317), "spatial": (5, 10, 16, 22, 47)}
"""Cells along an edge: up to 100 489 and 103 823 cells."""

PHASES: Final = ("scene", "contacts", "symmetry", "space", "driver", "λ")

SECONDS: Final = 300
"""Processor time of one size."""

BYTES: Final = 12 << 30
"""Address space of one size."""

Found = dict[str, Any]


def document(kind: str, edge: int) -> dict[str, Any]:
    """The scene of a kind with so many cells along an edge, supports beside them."""
    strong = {"tensile_strength": 2e6, "shear_strength": 2e6}
    common = {
        "materials": {"density": 1400, "dry": {"friction_coefficient": 0.75}, "inner": strong},
        "loads": {"live": [{"body": [1, 0] if kind == "planar" else [1, 0, 0]}]},
        "search": {"block_cells": [1, 4]},
    }
    if kind == "planar":
        rows = ["a" * edge] * edge + ["#" * edge]
        return {"name": f"{edge} × {edge}", "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows}, **common}
    cells = [_box(at, np.add(at, 1)) for at in itertools.product(range(edge), repeat=3)]
    slab = _box((0, 0, -1), (edge, edge, 0)) | {"support": True}
    return {"name": f"{edge} × {edge} × {edge}", "elements": [slab, *cells], **common}


def _box(low: Any, high: Any) -> dict[str, Any]:
    corners = [[0.1 * float(v) for v in corner] for corner in itertools.product(*zip(low, high, strict=True))]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return {"id": "-".join(str(v) for v in low), "vertices": corners, "faces": faces}


def phases(file: Path, evaluate: bool = True) -> Iterator[Found]:
    """What each phase takes, as it ends. evaluate: solve the first labelling too."""
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
        command = [sys.executable, "-m", "benchmarks.growth", str(file), str(seconds), str(most)]
        answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    found: Found = {"kind": kind, "edge": edge, "seconds": {}, "memory": {}}
    for line in answer.stdout.splitlines():
        told = json.loads(line)
        phase = told.pop("phase")
        found["seconds"][phase], found["memory"][phase] = told.pop("seconds"), told.pop("memory")
        found |= told
    if answer.returncode:
        said = answer.stderr.strip().splitlines()
        # native code that is given no memory ends by a signal
        native = answer.returncode in (-signal.SIGSEGV, -signal.SIGABRT)
        memory = native or "memory" in (said[-1].lower() if said else "")
        found["ended"] = f"{most / 2**30:g} GB" if memory else f"{seconds} s"
    print(row_of(found), flush=True)
    return found


def row_of(found: Found) -> list[str]:
    """A row of the table."""
    seconds, memory = found["seconds"], found["memory"]
    return [
        found["kind"],
        f"{found.get('cells', found['edge'] ** (2 if found['kind'] == 'planar' else 3)):,}".replace(",", " "),
        f"{found['faces']:,}".replace(",", " ") if "faces" in found else "–",
        *(f"{seconds[phase]:.2f}" if phase in seconds else "–" for phase in PHASES),
        f"{memory['driver']:.0f}" if "driver" in memory else "–",
        f"{memory['λ']:.0f}" if "λ" in memory else f"over {found.get('ended', 'the limit')}",
    ]


def growth(series: list[Found], phase: str) -> str:
    """Exponent of cells by least squares on logarithms, of sizes above 900 cells and a hundredth of a second."""
    points = [(f["cells"], f["seconds"][phase]) for f in series if phase in f["seconds"] and f["cells"] > 900]
    points = [(cells, seconds) for cells, seconds in points if seconds > 0.01]
    if len(points) < 2:
        return "–"
    cells, seconds = np.log(np.array(points)).T
    return f"{np.polyfit(cells, seconds, 1)[0]:.2f}"


def draw(results: dict[str, list[Found]]) -> Figure:
    """Seconds of each phase over cells, planar and spatial side by side."""
    figure = Figure(figsize=(11.0, 4.6), dpi=110, layout="constrained")
    marks = dict(zip(PHASES, "osv^Dx", strict=True))
    for axes, (kind, series) in zip(
        figure.subplots(1, len(results), sharey=True, squeeze=False)[0], results.items(), strict=True
    ):
        for phase in PHASES:
            points = [(f["cells"], f["seconds"].get(phase, 0.0)) for f in series]
            points = [(cells, seconds) for cells, seconds in points if seconds > 1e-3]  # the clock's own steps
            if points:
                axes.loglog(*zip(*points, strict=True), marker=marks[phase], markersize=5, label=phase)
        most = max(f["cells"] for f in series)
        axes.loglog([most / 1e3, most], [1e-2, 10.0], color="0.6", linestyle=":", linewidth=1.0, label="linear")
        axes.set(title=kind, xlabel="cells")
        axes.grid(True, which="major", color="0.9")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("processor time, s")
    figure.axes[0].legend(fontsize=8, frameon=False)
    return figure


def report(results: dict[str, list[Found]]) -> str:
    """The page: one row a size, and the exponents."""
    head = ["kind", "cells", "faces", *(f"{phase}, s" for phase in PHASES), "MB before λ", "MB with λ"]
    rows = [row_of(found) for series in results.values() for found in series]
    powers = [[kind, *(growth(series, phase) for phase in PHASES)] for kind, series in results.items()]
    return "\n\n".join(
        [
            "# Growth with the number of cells",
            about(__doc__),
            f"Limits of one size: {SECONDS} s and {BYTES / 2**30:g} GB, or what its row says. Memory is the highest so "
            "far, of which Python and its libraries are some 200 MB.",
            "![seconds of each phase over cells](growth.png)",
            table(head, rows),
            "Exponents of the number of cells, from 1 000 cells up (1: linear):",
            table(["kind", *PHASES], powers),
        ]
    )


def main() -> None:
    """Measure all sizes; write the table and the picture."""
    results = {kind: [run(kind, edge) for edge in sizes] for kind, sizes in SIZES.items()}
    keep(results)


def keep(results: dict[str, list[Found]]) -> None:
    """Write the page and its picture."""
    figure = draw(results)
    FigureCanvasAgg(figure)
    RESULTS.mkdir(parents=True, exist_ok=True)
    figure.savefig(RESULTS / "growth.png")
    write("growth", report(results))


def _one(file: str, seconds: str, most: str) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    resource.setrlimit(resource.RLIMIT_AS, (int(most), int(most)))
    for phase in phases(Path(file)):
        print(json.dumps(phase), flush=True)


if __name__ == "__main__":
    _one(*sys.argv[1:]) if len(sys.argv) > 1 else main()
