"""A search under any model: what was modelled travels with the study, and its pictures draw what was solved."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner, grid_document
from cases_spatial import box
from command import Command
from jld_core import InputError, LimitAnalysisResult, Scene, SolveOptions, parse_scene, solve
from jld_explore import Exploration, ExploreSettings, explore, read_folder
from jld_explore.report import write_pictures
from jld_explore.space import from_string

# what blocks that crack anywhere carry, test_field_check.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

SPATIAL = [
    SolveOptions(contact="concave"),
    SolveOptions(inner_bending="kern"),
    SolveOptions(effective_area=True),
    SolveOptions(friction="zero-dilation", contact="concave"),
]


def table() -> Scene:
    """Two legs and a two-part slab, pushed aside: few labellings, all resultants."""
    boxes = [
        box("ground", [0, 0, -0.2], [3, 1, 0], support=True),
        box("left", [0, 0, 0], [1, 1, 1]),
        box("right", [2, 0, 0], [3, 1, 1]),
        box("near", [0, 0, 1], [1.5, 1, 1.6]),
        box("far", [1.5, 0, 1], [3, 1, 1.6]),
    ]
    document: dict[str, Any] = {
        "name": "table",
        "elements": boxes,
        "materials": dry_and_inner(2000, 0.6, 8e3, 9e3),
        "loads": {
            "live": [{"body": [0.3, 0.1, 0.0]}, {"element": "far", "force": [0.0, 9e3, 0.0], "at": [3.0, 0.5, 1.3]}]
        },
    }
    return parse_scene(document)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[LimitAnalysisResult]:
    """Results that were drawn as the best; the page draws them once more, and is left out."""
    from jld_explore.report import pictures

    monkeypatch.setattr(import_module("jld_explore.explore"), "write_report", lambda *_, **__: None)
    seen: list[LimitAnalysisResult] = []
    real = pictures.plot_best
    monkeypatch.setattr(pictures, "plot_best", lambda result: (seen.append(result), real(result))[1])
    return seen


def test_the_picture_of_a_study_without_dilation_is_without_dilation(
    tmp_path: Path, drawn: list[LimitAnalysisResult]
) -> None:
    """It was solved again with associative friction, which is another structure's answer."""
    scene = parse_scene(grid_document(["aab", "abb", "###"], block_cells=[2, 4], friction=0.4))
    model = SolveOptions(friction="zero-dilation")
    done = explore(scene, tmp_path / "study", ExploreSettings(model=model))
    write_pictures(read_folder(done.folder))
    assert [result.friction for result in drawn] == ["zero-dilation"] * 2
    for result in drawn:
        assert result.load_factor == pytest.approx(done.summary.best, rel=1e-6)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    """The search under the model that a scene has unless it says otherwise."""
    return explore(table(), tmp_path_factory.mktemp("plain") / "out", ExploreSettings(pictures=False, check_fields=0))


@pytest.mark.parametrize(
    "model",
    [SPATIAL[0], *(pytest.param(one, marks=pytest.mark.long) for one in SPATIAL[1:3]), SPATIAL[3]],
    ids=["concave", "kern", "effective area", "concave without dilation"],
)
def test_a_search_and_solve_give_the_same_load_factors(
    model: SolveOptions, tmp_path: Path, drawn: list[LimitAnalysisResult], plain: Exploration
) -> None:
    done = explore(table(), tmp_path / "study", ExploreSettings(model=model))
    found = done.results[done.results["status"] == "collapse"]
    assert len(found) > 3
    for row in found.iloc[:: max(1, len(found) // 4)].itertuples():
        one = solve(done.assembly, from_string(str(row.labelling)), **vars(model))
        assert row.load_factor == pytest.approx(one.load_factor, rel=1e-6, abs=1e-9)
    assert drawn[0].model == model
    assert read_folder(done.folder).model == model
    same = plain.results.set_index("labelling")["load_factor"].reindex(done.results["labelling"]).to_numpy()
    assert not np.allclose(same, done.results["load_factor"], rtol=1e-5, equal_nan=True)
    assert done.summary.proven is (model.friction == "associative" and not model.effective_area)


def test_the_exact_driver_refuses_a_model_it_has_no_bounds_for(tmp_path: Path) -> None:
    settings = ExploreSettings(driver="exact", model=SolveOptions(inner_bending="kern"))
    with pytest.raises(InputError, match="exact has no bounds for this model"):
        explore(table(), tmp_path / "study", settings)


@pytest.mark.usefixtures("without_pictures")
def test_the_command_line_offers_the_model(tmp_path: Path, jld: Command) -> None:
    scene = tmp_path / "table.json"
    scene.write_text(table().model_dump_json(exclude_defaults=True), encoding="utf-8")
    out = tmp_path / "study"
    done = jld("explore", scene, "--out", out, "--contact", "concave", "--jobs", "1", "--budget", "8")
    assert done.code == 0, done.err
    assert read_folder(out).model == SolveOptions(contact="concave")
    other = jld("explore", scene, "--out", out, "--resume", "--jobs", "1", "--budget", "8")
    assert other.code == 2
    assert "contact" in other.err
    wrong = jld("explore", scene, "--out", tmp_path / "x", "--contact", "concave", "--effective-area")
    assert wrong.code == 2
    assert "point contacts have no effective area" in wrong.err
    assert not (tmp_path / "x").exists()
