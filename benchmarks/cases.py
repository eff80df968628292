"""What a second load case costs: one load, and that load with its mirror image, searched by every kind of driver.

Processor time of one process, in turn, several times over. The mirror maps the two cases onto one another, so with both
the scene is symmetric: half as many layouts are looked at, each under two loads.
"""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import ROOT, table, write
from jld_core import Scene, load_scene, parse_scene
from jld_explore import ExploreSettings, explore

TURNS: Final = 3
MOST: Final = 1.5
"""Times one load's that two mirrored ones may take."""

Loads = tuple[list[dict[str, Any]], list[dict[str, Any]]]


def _wall(width: int, height: int, most: int) -> dict[str, Any]:
    return {
        "name": f"wall {width} × {height}",
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a" * width] * height + ["#" * width]},
        "materials": {
            "density": 1400,
            "dry": {"friction_coefficient": 0.75},
            "inner": {"tensile_strength": 2e4, "shear_strength": 2e4},
        },
        "search": {"block_cells": [1, most]},
    }


def scenes() -> dict[str, tuple[dict[str, Any], Loads]]:
    """By name: the scene without loads, and a load with its mirror image."""
    wind: Loads = ([{"body": [1, 0]}], [{"body": [-1, 0]}])
    arch = json.loads(load_scene(ROOT / "scenes" / "flat_beam_arch.json").model_dump_json(exclude_defaults=True))
    rows = arch["grid"]["rows"]
    cells = [(c, r) for r, row in enumerate(rows) for c, letter in enumerate(row) if letter.isalpha()]
    width = len(rows[0])
    columns = [c for c, r in cells if r == 0 and 2 * c + 1 < width]
    left, right = (
        [{"element": f"c{c}r0", "force": [0.0, -1.0]} for c in side]
        for side in (columns, [width - 1 - c for c in columns])
    )
    return {
        "wall 4 × 3 in wind, blocks up to 3": (_wall(4, 3, 3), wind),
        "beam-arch, one half loaded": (arch, (left, right)),
    }


def of(document: dict[str, Any], loads: Loads, both: bool) -> Scene:
    """The scene under the first load, or under both as cases."""
    one, other = loads
    cases = [{"name": "left", "live": one}, {"name": "right", "live": other}]
    return parse_scene({**document, "loads": {"cases": cases} if both else {"live": one}})


def timed(scene: Scene, settings: ExploreSettings) -> tuple[float, dict[str, Any]]:
    """Processor seconds of a search, and its summary."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        done = explore(scene, Path(folder) / "out", settings)
        return time.process_time() - start, done.summary.facts


def settings_of(kind: str) -> ExploreSettings:
    """How each kind is searched."""
    return ExploreSettings(pictures=False, driver=kind, jobs=1, budget=2000 if kind == "genetic" else None)


KINDS: Final = ("enumeration", "exact", "genetic")


def pooled(document: dict[str, Any], loads: Loads) -> tuple[float, float]:
    """Processor seconds of an enumeration under one load, plain and with certificates."""
    scene = of(document, loads, False)
    settings = settings_of("enumeration")
    return timed(scene, settings)[0], timed(scene, replace(settings, certificates=True))[0]


def main() -> None:
    """Time every kind of search on every scene, with one load and with two."""
    rows = []
    for name, (document, loads) in scenes().items():
        for kind in KINDS:
            times = np.empty((TURNS, 2))
            for turn in range(TURNS):
                times[turn, 0], one = timed(of(document, loads, False), settings_of(kind))
                times[turn, 1], two = timed(of(document, loads, True), settings_of(kind))
            single, double = np.median(times, axis=0)
            ratio = float(np.median(times[:, 1] / times[:, 0]))
            rows.append(
                [
                    name,
                    kind,
                    f"{one['evaluated']}",
                    f"{two['evaluated']}",
                    f"{single:.2f}",
                    f"{double:.2f}",
                    f"{ratio:.2f}",
                    "yes" if ratio <= MOST else "no",
                ]
            )
    head = ["scene", "search", "layouts, one", "layouts, two", "s one", "s two", "two / one", f"≤ {MOST:g}"]
    beside = []
    for name, (document, loads) in scenes().items():
        plain, pool = np.median([pooled(document, loads) for _ in range(TURNS)], axis=0)
        beside.append(f"{name}: {plain:.2f} s without, {pool:.2f} s with")
    note = f"Processor seconds of one process, medians of {TURNS} turns; λ of every case is in the tables."
    why = (
        "**Why cases take no certificates.** The kernel solves a layout sooner than a pool of certificates is asked "
        f"about it. Enumerations under one load, {'; '.join(beside)}. "
        "With cases a pool would have to settle every one of them."
    )
    write("cases", f"# Two mirrored load cases beside one load\n\n{table(head, rows)}\n\n{note}\n\n{why}")


if __name__ == "__main__":
    main()
