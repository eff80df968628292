"""`jld solve --cracks fields` on spatial scenes: what is printed, and what is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cases import box
from command import Command
from jld_core import build_assembly, parse_scene
from jld_core.limit.options import Status
from jld_core.models import solve_by_fields

SCENE: dict[str, Any] = {
    "name": "cube",
    "elements": [box("base", [0, 0, -1], [1, 1, 0], support=True), box("cube", [0, 0, 0], [1, 1, 1])],
    "materials": {
        "density": 0.0,
        "dry": {"friction_coefficient": 0.5},
        "inner": {"tensile_strength": 0.7, "shear_strength": 1.0},
    },
    "loads": {"live": [{"element": "cube", "force": [0, 0, 1], "at": [0.5, 0.5, 1.0]}]},
    "labels": {"default": "inner", "inner": [["base", "cube"]]},
}


def written(folder: Path, document: dict[str, Any]) -> Path:
    path = folder / "scene.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_both_bounds_are_printed(jld: Command, tmp_path: Path) -> None:
    """A cube pulled to σt A: the keys of planar scenes, with tetrahedra in the place of triangles."""
    path = written(tmp_path, SCENE)
    found = json.loads(jld("solve", path, "--cracks", "fields:0.01", "--json").out)
    assert found["cracks"] == {"kind": "fields", "gap": 0.01}
    assert (found["status"], found["dimension"]) == ("collapse", 3)
    assert found["load_factor"] == found["bracket"][0] <= 0.7 * (1 + 1e-9)
    assert found["bracket"][1] >= 0.7 * (1 - 1e-9)
    assert found["tetrahedra"] == found["history"][-1]["tetrahedra"] == 24
    assert "tetrahedra" in jld("solve", path, "--cracks", "fields:0.01").out


def test_models_that_fields_do_not_support_are_refused_in_one_line(jld: Command, tmp_path: Path) -> None:
    path = written(tmp_path, SCENE)
    for more in (["--contact", "concave"], ["--effective-area"], ["--inner-bending", "kern"]):
        found = jld("solve", path, "--cracks", "fields", *more)
        assert (found.code, found.out) == (2, "")
        assert found.err.startswith(f"jld: {more[0]}: cracks by fields")
        assert found.err.count("\n") == 1
    found = jld("explore", path, "--cracks", "fields", "--out", tmp_path / "out")
    assert (found.code, found.out) == (2, "")
    assert found.err.startswith("jld: --cracks: ")
    assert found.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_load_cases_in_space() -> None:
    """λ is the least over cases of λ / required."""
    live = SCENE["loads"]["live"]
    sideways = [{"element": "cube", "force": [0, 0, 0.5], "at": [0.5, 0.5, 1.0]}]
    cases = [{"name": "one", "live": live}, {"name": "half", "live": sideways, "required": 4.0}]
    found = solve_by_fields(build_assembly(parse_scene({**SCENE, "loads": {"cases": cases}})), gap=0.01)
    assert found.status is Status.COLLAPSE
    assert np.isclose(found.decided.low, 1.4 / 4.0, rtol=1e-3)
