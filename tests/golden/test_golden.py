"""Results of ten scenes under every driver, kept so that a change of names or structure changes no number.

`python tests/golden/test_golden.py` writes `values.json` anew. A number that changes on purpose is written anew in the
commit that changes it, and the commit says why.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from cases import CASES, grid_scene  # noqa: E402
from jld_core import Scene, build_assembly, load_scene, solve  # noqa: E402
from jld_explore import ExploreSettings, explore  # noqa: E402
from jld_explore.drivers import DRIVERS  # noqa: E402

SCENES = HERE.parents[1] / "scenes"
SMALL = ("wall", "weak arch", "crushable wall", "no friction", "overhang", "mortar", "rough cracks", "cantilever")
FILES = ("flat_beam_arch", "wall_in_two_winds")
BUDGET = 24
KEPT = ("best", "bound", "proven", "unbounded", "evaluated", "counts_by_status", "stop_reason")


def scene_of(name: str) -> Scene:
    """One of the ten scenes; the small ones limit blocks to three cells."""
    if name in FILES:
        return load_scene(SCENES / f"{name}.json")
    rows, options = CASES[name]
    return grid_scene(rows, **{"block_cells": [1, 3], **options})


def results(name: str) -> dict[str, Any]:
    """λ, bracket and status of the scene's own layout where it has one load, and the summary of every driver."""
    scene = scene_of(name)
    assembly = build_assembly(scene)
    found: dict[str, Any] = {}
    if not assembly.cases:
        own = solve(assembly)
        found["solve"] = {"status": str(own.status), "load_factor": own.load_factor, "bracket": list(own.bracket)}
    for driver in DRIVERS:
        with tempfile.TemporaryDirectory() as folder:
            settings = ExploreSettings(driver=driver, budget=BUDGET, small=0, pictures=False, check_fields=0)
            summary = explore(scene, Path(folder) / "out", settings).summary.facts
        found[driver] = {key: summary[key] for key in KEPT}
    return json.loads(json.dumps(found))


def differences(found: Any, kept: Any, place: str = "") -> list[str]:
    """Where results differ: numbers by more than the width of a bracket, anything else at all."""
    if isinstance(kept, dict) and isinstance(found, dict):
        keys = sorted(kept.keys() | found.keys())
        return [one for key in keys for one in differences(found.get(key), kept.get(key), f"{place}/{key}")]
    if isinstance(kept, list) and isinstance(found, list) and len(kept) == len(found):
        return [
            one for k, pair in enumerate(zip(found, kept, strict=True)) for one in differences(*pair, f"{place}/{k}")
        ]
    if isinstance(kept, float) and isinstance(found, float):
        return (
            []
            if found == pytest.approx(kept, rel=2e-6, abs=1e-9, nan_ok=True)
            else [f"{place}: {found!r}, kept {kept!r}"]
        )
    return [] if found == kept else [f"{place}: {found!r}, kept {kept!r}"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [*SMALL, *FILES])
def test_results_are_those_that_were_kept(name: str) -> None:
    kept = json.loads((HERE / "values.json").read_text(encoding="utf-8"))
    assert differences(results(name), kept[name]) == []


if __name__ == "__main__":
    values = {name: results(name) for name in (*SMALL, *FILES)}
    (HERE / "values.json").write_text(json.dumps(values, indent=1, sort_keys=True) + "\n", encoding="utf-8")
