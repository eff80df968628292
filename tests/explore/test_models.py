"""A search under any model: what was modelled travels with the study, and its pictures draw what was solved."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import Tally
from benchmarks.claims.answers import case_symmetry

from cases import ROUTE, box, dry_and_inner, grid_document
from command import SCENES, Command, refused, saved
from jld_core import (
    InputError,
    LimitAnalysisResult,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    solve,
)
from jld_core.build import build_robust
from jld_explore import Exploration, ExploreSettings, explore, read_folder, search_space
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.space import from_string
from jld_views import write_pictures

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
    from jld_views import pictures

    monkeypatch.setattr(import_module("jld_views"), "write_report", lambda *_, **__: None)
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
    done = explore(scene, tmp_path / "study", ExploreSettings(model=model, pictures=False))
    for study in (done, read_folder(done.folder)):
        write_pictures(study)
    assert [result.friction for result in drawn] == ["zero-dilation"] * 2
    for result in drawn:
        assert result.load_factor == pytest.approx(done.summary.best, rel=1e-6)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    """The search under the model that a scene has unless it says otherwise."""
    return explore(table(), tmp_path_factory.mktemp("plain") / "out", ExploreSettings(pictures=False, check_fields=0))


@pytest.mark.sampled(2)
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize(
    "model",
    [SPATIAL[0], *(pytest.param(one, marks=pytest.mark.long) for one in SPATIAL[1:3]), SPATIAL[3]],
    ids=["concave", "kern", "effective area", "concave without dilation"],
)
def test_a_search_and_solve_give_the_same_load_factors(
    model: SolveOptions, tmp_path: Path, drawn: list[LimitAnalysisResult], plain: Exploration
) -> None:
    done = explore(table(), tmp_path / "study", ExploreSettings(model=model, pictures=False))
    found = done.results[done.results["status"] == "collapse"]
    assert len(found) > 3
    for row in found.iloc[:: max(1, len(found) // 4)].itertuples():
        one = solve(done.assembly, from_string(str(row.labelling)), **vars(model))
        assert row.load_factor == pytest.approx(one.load_factor, rel=1e-6, abs=1e-9)
    write_pictures(done)
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
    scene = saved(tmp_path / "table.json", table())
    out = tmp_path / "study"
    jld("explore", scene, "--out", out, "--contact", "concave", "--jobs", "1", "--budget", "8").done()
    assert read_folder(out).model == SolveOptions(contact="concave")
    jld("explore", scene, "--out", out, "--resume", "--jobs", "1", "--budget", "8").refused("contact")
    jld("explore", scene, "--out", tmp_path / "x", "--contact", "concave", "--effective-area").refused(
        "point contacts have no effective area"
    )
    assert not (tmp_path / "x").exists()


# Layouts are merged as mirror images only where the model that answers cannot tell them apart.


Document = dict[str, Any]
Change = Callable[[Document], None]


def lintel(cracks: Any = "faces", **more: Any) -> Document:
    """A lintel of 4 cells of 1 m on two supports under two equal forces."""
    return {
        "grid": {"cell": [1.0, 1.0], "rows": ["aaaa", "#..#"]},
        "materials": dry_and_inner(2000.0, 0.6, 1e5, 2e5),
        "loads": {
            "live": [{"element": f"c{k}r0", "force": [0, -1e3], "at": [x, 2.0]} for k, x in ((1, 1.35), (2, 2.65))]
        },
        "search": {"segmentation": False},
        "cracks": cracks,
        **more,
    }


def group_of(document: Document) -> int:
    """Number of symmetries, with the identity."""
    scene = parse_scene(document)
    return len(search_space(scene, build_assembly(scene)).group)


def widths(document: Document) -> None:
    for entry, width in zip(document["loads"]["live"], (0.8, 0.1), strict=True):
        entry["width"] = width


def equal_widths(document: Document) -> None:
    for entry in document["loads"]["live"]:
        entry["width"] = 0.4


def halves(document: Document) -> None:
    """The same resultant on a shorter part of the right cell."""
    parts = [([1.1, 1.9], 1e3), ([2.3, 2.7], 2e3)]
    document["loads"]["live"] = [
        {"face": {"along": [[x, 2.0] for x in ends]}, "pressure": value} for ends, value in parts
    ]


def slopes(document: Document) -> None:
    """Pressures that rise towards the middle, stated from left to right: their own mirror image."""
    parts = [([1.0, 2.0], [0.0, 1e3]), ([2.0, 3.0], [1e3, 0.0])]
    document["loads"]["live"] = [
        {"face": {"along": [[x, 2.0] for x in ends]}, "pressure": values} for ends, values in parts
    ]


def tie_on_one_side(document: Document) -> None:
    anchors = [{"element": "c0r0", "at": [0.25, 1.75]}, {"element": "c0r1", "at": [0.75, 0.5]}]
    document["members"] = [{"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 1e3}]


def ties(document: Document) -> None:
    tie_on_one_side(document)
    anchors = [{"element": "c3r0", "at": [3.75, 1.75]}, {"element": "c3r1", "at": [3.25, 0.5]}]
    document["members"].append({"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 1e3})


def one_load_varies(document: Document) -> None:
    document["loads"]["live"][0]["force"] = [0, {"mean": -1e3, "cov": 0.3, "kind": "normal"}]


def both_loads_vary(document: Document) -> None:
    for entry in document["loads"]["live"]:
        entry["force"] = {"mean": [0, -1e3], "cov": 0.3, "kind": "lognormal"}


def one_joint_varies(document: Document) -> None:
    """The mean friction of one joint is that of the others."""
    friction = {"mean": 0.6, "cov": 0.2, "kind": "normal"}
    document["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "dry": {"friction_coefficient": friction}}]


def all_joints_vary(document: Document) -> None:
    document["materials"]["dry"]["friction_coefficient"] = {"mean": 0.6, "cov": 0.2, "kind": "normal", "each": True}


def joint_beside_varying_ones(document: Document) -> None:
    all_joints_vary(document)
    document["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "dry": {"friction_coefficient": 0.6}}]


def cases(document: Document) -> None:
    """Two load cases that are each other's mirror image."""
    entries = document["loads"]["live"]
    document["loads"] = {"cases": [{"name": f"{k}", "live": [entry]} for k, entry in enumerate(entries)]}


def cases_of_other_widths(document: Document) -> None:
    widths(document)
    cases(document)


CELLS, FIELDS = {"kind": "cells", "cell": 0.5}, {"kind": "fields", "gap": 0.1}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("cracks", "change", "count"),
    [
        ("faces", widths, 2),
        (FIELDS, widths, 1),
        (FIELDS, equal_widths, 2),
        ("faces", halves, 2),
        (CELLS, halves, 1),
        (FIELDS, halves, 1),
        (CELLS, slopes, 2),
        (FIELDS, slopes, 2),
        ("faces", tie_on_one_side, 1),
        ("faces", ties, 2),
        (CELLS, ties, 2),
        ("faces", one_load_varies, 1),
        ("faces", both_loads_vary, 2),
        ("faces", one_joint_varies, 1),
        ("faces", all_joints_vary, 2),
        ("faces", joint_beside_varying_ones, 1),
        ("faces", cases, 2),
        (FIELDS, cases, 2),
        (FIELDS, cases_of_other_widths, 1),
    ],
)
def test_symmetry_is_that_of_the_model(cracks: Any, change: Change, count: int) -> None:
    document = copy.deepcopy(lintel(cracks))
    change(document)
    assert group_of(document) == count
    document["search"]["symmetry"] = "mirror-x"
    if count > 1:
        assert group_of(document) == 2
    else:
        with pytest.raises(InputError, match="the scene has no mirror-x symmetry: "):
            group_of(document)


def test_an_objective_of_the_user_is_asked_for_each_mirror_image() -> None:
    """The function sees the left end only; the right one is better where it says so."""

    def left_joint(evaluation: Any, assembly: Any, labels: Any) -> float:
        return evaluation.load_factor * (2.0 if labels[0] else 1.0)

    scene = parse_scene(lintel() | {"search": {"segmentation": False, "dry_faces": [1, 1]}})
    all_of_them = explore(scene, driver="enumeration", objective=left_joint, pictures=False)
    left_joint.symmetric = True
    merged = explore(scene, driver="enumeration", objective=left_joint, pictures=False)
    assert all_of_them.summary.evaluated == 3
    assert merged.summary.evaluated == 2


def test_merged_layouts_have_one_load_factor() -> None:
    """A share of `python -m benchmarks.claims symmetry`: cases by faces and cells."""
    tally = Tally("")
    assert [case_symmetry(seed, tally) for seed in (0, 1, 6, 40)] == [""] * 4
    assert tally.notes["cells: merged"] > 0


# Without dilation only what can still matter is solved; the rest is recorded with its bound, apart.


def test_evaluator_stops_at_the_associative_bound() -> None:
    scene = parse_scene(grid_document(["aa", "aa", "##"]))
    assembly = build_assembly(scene)
    evaluator = Evaluator(assembly, EvaluatorSettings(SolveOptions(friction="zero-dilation")))
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    full = evaluator.evaluate(labels)
    assert full.status is Status.COLLAPSE
    spared = evaluator.evaluate(labels, pruning_threshold=1.01 * full.associative)
    assert (spared.settled, spared.status) == ("bound", Status.UNCERTIFIED)
    assert spared.high == pytest.approx(full.associative, rel=1e-6)
    assert np.isnan(spared.zero_dilation)
    assert evaluator.evaluate(labels, pruning_threshold=0.99 * full.associative).settled == "solve"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("driver", ["enumeration", "genetic"])
def test_best_and_front_are_those_of_all_solves(driver: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))
    settings = ExploreSettings(driver=driver, model=SolveOptions(friction="zero-dilation"), pictures=False)
    monkeypatch.setattr("jld_explore.search.study.PORTION", 16)
    spared = explore(scene, tmp_path / "spared", settings)
    path = "jld_explore.evaluation.cases.IncumbentFront.thresholds"
    monkeypatch.setattr(path, lambda self, rows: np.full(len(rows), -np.inf))
    solved = explore(scene, tmp_path / "solved", settings)
    assert spared.summary.pruned > 0
    assert solved.summary.pruned == 0
    assert spared.summary.evaluated == solved.summary.evaluated
    assert spared.summary.best == pytest.approx(solved.summary.best, rel=1e-6)
    assert spared.front["dry_faces"].tolist() == solved.front["dry_faces"].tolist()
    assert spared.front["load_factor"].tolist() == pytest.approx(solved.front["load_factor"].tolist(), rel=1e-6)
    apart = spared.results[spared.results["settled"] == "bound"]
    assert apart["load_factor"].isna().all()
    assert apart["rank"].isna().all()
    assert apart["bracket_lo"].isna().all()
    assert (apart["bracket_hi"] >= apart["load_factor_associative"]).all()


def test_a_proven_floor_is_refused_in_space(tmp_path: Path) -> None:
    """Spatial scenes have no bound without dilation, so no layout could be ranked by it."""
    model = SolveOptions(friction="zero-dilation", range=True, floor_seconds=1.0)
    scene = load_scene(SCENES / "spatial_cubes.json")
    with pytest.raises(InputError, match="objective: spatial scenes have no bound without dilation"):
        explore(scene, tmp_path / "out", ExploreSettings(model=model))
    assert not (tmp_path / "out").exists()


# Material values with a low one: λ at the low values ranks, and that at the nominal ones stands beside it.


ROWS = ["aaa", "aaa", "###"]


def document(dry: dict[str, Any] | None = None, inner: dict[str, Any] | None = None, **search: Any) -> dict[str, Any]:
    found = grid_document(ROWS, **{"block_cells": [1, 3], **search})
    found["materials"]["dry"] = dry or {"friction_coefficient": {"nominal": 0.75, "low": 0.4}}
    found["materials"]["inner"] |= inner or {"tensile_strength": {"nominal": 2e4, "low": 500}}
    return found


def plain_robust(low: bool) -> Any:
    mu, tension = (0.4, 500) if low else (0.75, 2e4)
    return parse_scene(document({"friction_coefficient": mu}, {"tensile_strength": tension}))


def test_the_nominal_value_is_built_and_the_low_one_kept() -> None:
    scene = parse_scene(document())
    assert parse_scene(json.loads(scene.model_dump_json())) == scene
    assert scene.fingerprint != plain_robust(False).fingerprint
    nominal, robust = build_assembly(scene), build_robust(scene)
    assert solve(nominal).load_factor == solve(build_assembly(plain_robust(False))).load_factor
    assert solve(robust).load_factor == solve(build_assembly(plain_robust(True))).load_factor
    assert solve(robust.at_nominal).load_factor == solve(nominal).load_factor
    angle = parse_scene(document({"friction_angle": {"nominal": 40, "low": 30}}))
    assert build_robust(angle).strengths(ROUTE).friction == pytest.approx(np.tan(np.radians(30)))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("driver", ["enumeration", "exact", "genetic"])
def test_ranked_by_the_low_values(driver: str, tmp_path: Path) -> None:
    settings = ExploreSettings(pictures=False, driver=driver, robust=True, budget=30 if driver == "genetic" else None)
    done = explore(parse_scene(document()), tmp_path / "out", settings)
    low, nominal = build_assembly(plain_robust(True)), build_assembly(plain_robust(False))
    ranked = done.results[done.results["status"] == "collapse"]
    for _, row in ranked.iloc[::7].iterrows():
        labels = from_string(row["labelling"])
        assert row["load_factor"] == pytest.approx(solve(low, labels).load_factor, rel=1e-6)
        assert row["load_factor_nominal"] == pytest.approx(solve(nominal, labels).load_factor, rel=1e-6)
        assert row["load_factor"] <= row["load_factor_nominal"] * (1.0 + 1e-6)
    best = explore(
        plain_robust(True), tmp_path / "low", ExploreSettings(pictures=False, driver="enumeration")
    ).summary.best
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
    with refused("materials.dry.friction", words):
        parse_scene(document(dry))


@pytest.mark.usefixtures("without_pictures")
def test_the_command_line(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "scene.json", document())
    found = json.loads(jld("solve", file, "--robust", "--json").out)
    assert found["load_factor"] < found["load_factor_nominal"]
    assert found["load_factor_nominal"] == pytest.approx(solve(build_assembly(plain_robust(False))).load_factor)
    out = jld("explore", file, "--robust", "--out", tmp_path / "out", "--budget", "5").out
    assert "at nominal" in out
    file.write_text(json.dumps(grid_document(ROWS)))
    failed = jld("explore", file, "--robust", "--out", tmp_path / "no").err
    assert "no material value of the scene has a low one" in failed
