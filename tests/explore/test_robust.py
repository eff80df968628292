"""Material values with a low one: λ at the low values ranks, and that at the nominal ones stands beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from command import Command
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.build import build_robust
from jld_core.scene.reading import at_low
from jld_core.strengths import Route
from jld_explore import ExploreSettings, explore, read_folder
from jld_explore.space import from_string

ROUTE = Route("a test")

ROWS = ["aaa", "aaa", "###"]


def document(dry: dict[str, Any] | None = None, inner: dict[str, Any] | None = None, **search: Any) -> dict[str, Any]:
    found = grid_document(ROWS, **{"block_cells": [1, 3], **search})
    found["materials"]["dry"] = dry or {"friction_coefficient": {"nominal": 0.75, "low": 0.4}}
    found["materials"]["inner"] |= inner or {"tensile_strength": {"nominal": 2e4, "low": 500}}
    return found


def plain(low: bool) -> Any:
    mu, tension = (0.4, 500) if low else (0.75, 2e4)
    return parse_scene(document({"friction_coefficient": mu}, {"tensile_strength": tension}))


def test_the_nominal_value_is_built_and_the_low_one_kept() -> None:
    scene = parse_scene(document())
    assert parse_scene(json.loads(scene.model_dump_json())) == scene
    assert scene.fingerprint != plain(False).fingerprint
    nominal, robust = build_assembly(scene), build_robust(scene)
    assert solve(nominal).load_factor == solve(build_assembly(plain(False))).load_factor
    assert solve(robust).load_factor == solve(build_assembly(plain(True))).load_factor
    assert solve(robust.at_nominal).load_factor == solve(nominal).load_factor
    angle = parse_scene(document({"friction_angle": {"nominal": 40, "low": 30}}))
    assert build_robust(angle).strengths(ROUTE).friction == pytest.approx(np.tan(np.radians(30)))
    assert at_low(scene).materials.dry == plain(True).materials.dry


@pytest.mark.parametrize("driver", ["enumeration", "exact", "genetic"])
def test_ranked_by_the_low_values(driver: str, tmp_path: Path) -> None:
    settings = ExploreSettings(pictures=False, driver=driver, robust=True, budget=30 if driver == "genetic" else None)
    done = explore(parse_scene(document()), tmp_path / "out", settings)
    low, nominal = build_assembly(plain(True)), build_assembly(plain(False))
    ranked = done.results[done.results["status"] == "collapse"]
    for _, row in ranked.iloc[::7].iterrows():
        labels = from_string(row["labelling"])
        assert row["load_factor"] == pytest.approx(solve(low, labels).load_factor, rel=1e-6)
        assert row["load_factor_nominal"] == pytest.approx(solve(nominal, labels).load_factor, rel=1e-6)
        assert row["load_factor"] <= row["load_factor_nominal"] * (1.0 + 1e-6)
    best = explore(plain(True), tmp_path / "low", ExploreSettings(pictures=False, driver="enumeration")).summary.best
    if driver != "genetic":
        assert done.summary.proven
        assert done.summary.best == pytest.approx(best, rel=2e-6)
    assert done.summary.facts["robust"] is True
    assert done.summary.facts["best_nominal"] == pytest.approx(ranked["load_factor_nominal"].iloc[0])
    back = read_folder(done.folder)
    assert back.result(1).load_factor == pytest.approx(done.summary.best, rel=1e-6)
    assert json.loads((done.folder / "columns.json").read_text())["results.csv"]["load_factor_nominal"]


def test_with_load_cases(tmp_path: Path) -> None:
    content = document()
    content["loads"] = {
        "cases": [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [-1, 0]}]}]
    }
    settings = ExploreSettings(pictures=False, driver="random", budget=5, robust=True)
    done = explore(parse_scene(content), tmp_path / "out", settings)
    row = done.results.iloc[0]
    assert row["load_factor"] == pytest.approx(min(row["load_factor[a]"], row["load_factor[b]"]), rel=1e-6)
    assert row["load_factor_nominal"] > row["load_factor"]
    again = explore(parse_scene(content), tmp_path / "out", ExploreSettings(**{**vars(settings), "resume": True}))
    assert again.results["load_factor_nominal"].equals(done.results["load_factor_nominal"])


@pytest.mark.parametrize(
    ("dry", "words"),
    [
        ({"friction_coefficient": {"nominal": 0.4, "low": 0.5}}, "low, 0.5, is above nominal, 0.4"),
        ({"friction_coefficient": {"nominal": 0.4}}, "one of two values is missing"),
        ({"friction_coefficient": {"nominal": 0.4, "low": 0.3, "high": 1}}, '"high" stands there'),
        ({"friction_coefficient": {"nominal": 0.4, "low": -1}}, "-1"),
        ({"friction_angle": {"nominal": 95, "low": 30}}, "95"),
        ({"friction_coefficient": {"nominal": 0.4, "low": "less"}}, "less"),
    ],
)
def test_wrong_values(dry: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_scene(document(dry))
    assert "materials.dry.friction" in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("without_pictures")
def test_the_command_line(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(document()))
    found = json.loads(jld("solve", file, "--robust", "--json").out)
    assert found["load_factor"] < found["load_factor_nominal"]
    assert found["load_factor_nominal"] == pytest.approx(solve(build_assembly(plain(False))).load_factor)
    out = jld("explore", file, "--robust", "--out", tmp_path / "out", "--budget", "5").out
    assert "at nominal" in out
    file.write_text(json.dumps(grid_document(ROWS)))
    failed = jld("explore", file, "--robust", "--out", tmp_path / "no").err
    assert "no material value of the scene has a low one" in failed
