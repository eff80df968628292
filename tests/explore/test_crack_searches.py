"""Searches with cracks by fields and by cells: the race against bounds of each layout, cells against refined scenes."""

from __future__ import annotations

import base64
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from command import Command
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.deadline import Deadline
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import Fields, FieldSetting
from jld_core.refinement.cells import crack_cells
from jld_explore import Exploration, ExploreSettings, explore, read_folder
from jld_explore.evaluation import pool as task_pool
from jld_explore.evaluation.field_evaluator import field_evaluation
from jld_explore.evaluation.field_pool import FieldPool, FieldRace
from jld_explore.report import words
from jld_explore.report.page_of_study import study_data
from jld_explore.space import from_string

PUSHED: list[dict[str, Any]] = [{"element": "c1r0", "force": [0, -1], "at": [0.15, 0.3]}]
FIELDS: dict[str, Any] = {"kind": "fields", "gap": 0.25}


def document(**more: Any) -> dict[str, Any]:
    """Six cells on two bearings under a force: 38 layouts."""
    return grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5, block_cells=[1, 4]) | more


def searched(folder: Path, cracks: Any, **more: Any) -> Exploration:
    settings = ExploreSettings(**{"jobs": 1, "pictures": False, "small": 100, **more})
    return explore(parse_scene(document(cracks=cracks)), folder, settings)


@pytest.fixture(scope="module")
def raced(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    return searched(tmp_path_factory.mktemp("raced") / "out", FIELDS)


def test_the_race_is_right(raced: Exploration) -> None:
    """Every bracket of the table agrees with the bounds of the layout alone, and none is stronger than said."""
    table, summary = raced.results, raced.summary.facts
    assert summary["cracks"] == FIELDS
    assert summary["race"]["decided"]
    assert summary["gap"] <= 0.25
    assert len(table) == summary["evaluated"] == 38
    best = table["bracket_lo"].max()
    assert summary["best"] == best == table["load_factor"][0]
    assert summary["bound"] == pytest.approx(table["bracket_hi"].max(), rel=1e-12)
    assert (table["load_factor"].dropna() == table["bracket_lo"][table["load_factor"].notna()]).all()
    ranked = table[table["rank"].notna()]
    # shared is the first rank by all that nothing is proven to be stronger than
    assert ((ranked["rank"] == 1) == (ranked["bracket_hi"] >= best)).all()
    some = table.iloc[[0, 1, *range(2, len(table), 6)]]
    for text, low, high in zip(some["labelling"], some["bracket_lo"], some["bracket_hi"], strict=True):
        alone = bounds_by_fields(raced.assembly, from_string(str(text)), gap=1e-9, most_triangles=1)
        assert np.isnan(low) or low <= alone.upper * (1 + 1e-9)
        if np.isfinite(alone.lower):
            assert alone.lower <= high * (1 + 1e-9)
            assert alone.lower <= summary["bound"] * (1 + 1e-9)
    # the front is that of the lower ends, with the best on it
    front = raced.front.sort_values("load_factor", ascending=False)
    assert front["load_factor"].iloc[0] == best
    assert front["dry_faces"].is_monotonic_increasing
    pruned = table[table["settled"] == "bound"]
    assert len(pruned) > 10
    assert (pruned["bracket_hi"] < best).all()


def test_summary_text_of_a_race(raced: Exploration) -> None:
    facts = words.facts_of_exploration(read_folder(raced.folder))
    assert "by fields" in facts["cracks"]
    assert "proven to within" in facts["best λ"]
    assert "discretisation" in facts["next"] or raced.summary.proven


def test_jobs_do_not_matter(raced: Exploration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_pool, "make_executor", ThreadPoolExecutor)  # processes take seconds to start
    other = searched(tmp_path / "out", FIELDS, jobs=2)
    columns = [name for name in raced.results.columns if name != "seconds"]
    pd.testing.assert_frame_equal(raced.results[columns], other.results[columns])


def test_data_for_processes_can_be_pickled(raced: Exploration) -> None:
    setting = FieldSetting.of(raced.assembly)
    again = cloudpickle.loads(cloudpickle.dumps(setting))
    labels = from_string(str(raced.results["labelling"][0]))
    bounds = [Fields.on(one, one.coarse, labels).bounds for one in (setting, again)]
    assert bounds[0] == bounds[1]


def test_no_time_leaves_one_layout(tmp_path: Path) -> None:
    done = searched(tmp_path / "out", FIELDS, seconds=0.0, driver="enumeration")
    assert done.summary.stop_reason == "time"
    assert done.summary.best is not None
    assert not done.summary.proven
    assert "of the search" in done.summary.next


def test_no_mesh_is_begun_that_would_be_late(raced: Exploration) -> None:
    """Where every mesh would take longer than what is left, bounds of the coarsest mesh remain, with any jobs."""
    labellings = np.array([from_string(str(text)) for text in raced.results["labelling"][:4]])
    pool = FieldPool(raced.assembly, labellings, Deadline(60.0), jobs=2)
    pool.rate = 1e9
    found = FieldRace(pool, 1e-3).run()
    assert found.refined == 0
    assert found.gap > 0.01
    assert np.isfinite(pool.low()).all()


def test_load_cases_race_by_the_governing_factor() -> None:
    """The race under two cases against the least over cases of bounds of each alone."""
    down = {"name": "down", "live": PUSHED, "required": 2.0}
    aside = {"name": "aside", "live": [{"body": [0.5, -1]}]}
    scene = parse_scene(document(loads={"cases": [down, aside]}))
    assembly = build_assembly(scene)
    rng = np.random.default_rng(1)
    labellings = rng.random((6, len(assembly.interfaces))) < 0.4
    pool = FieldPool(assembly, labellings)
    FieldRace(pool, 0.2).run()
    low, high = pool.low(), pool.high()
    assert (low <= high * (1 + 1e-9)).all()
    for row, labels in enumerate(labellings):
        alone = [bounds_by_fields(one, labels, gap=1e-9, most_triangles=1) for one in assembly.by_case]
        least = min(one.lower / factor for one, factor in zip(alone, assembly.required, strict=True))
        most = min(one.upper / factor for one, factor in zip(alone, assembly.required, strict=True))
        assert least <= high[row] * (1 + 1e-9)
        assert low[row] <= most * (1 + 1e-9)
    found = field_evaluation(np.array([4.0, 3.0]), np.array([6.0, 3.5]), np.array([2.0, 1.0]))
    assert (found.low, found.high, found.governing) == (2.0, 3.0, 0)
    assert found.cases == (4.0, 3.0)


def test_other_drivers_race_the_best_of_what_they_found(tmp_path: Path) -> None:
    """Brackets are no wider than those of the coarsest mesh, agree with them, and the best is refined to the gap."""
    done = searched(tmp_path / "out", FIELDS, driver="random", budget=4)
    ranked = done.results[done.results["rank"].notna()]
    assert len(ranked)
    for row in ranked.itertuples():
        alone = bounds_by_fields(done.assembly, from_string(str(row.labelling)), gap=1e-9, most_triangles=1)
        assert row.bracket_lo >= alone.lower * (1 - 1e-9)
        assert row.bracket_hi <= alone.upper * (1 + 1e-9)
        assert row.load_factor == row.bracket_lo
    best, rivals = ranked["bracket_lo"].max(), ranked["bracket_hi"].max()
    assert (rivals - best) / rivals <= FIELDS["gap"]
    assert done.summary.bound is None
    assert "exact" in done.summary.next


@pytest.mark.parametrize("driver", ["enumeration", "genetic"])
def test_searches_by_cells(driver: str, tmp_path: Path) -> None:
    """λ of each layout is that of the finer scene with the same labels on the pieces."""
    cracks = {"kind": "cells", "cell": 0.05}
    done = searched(tmp_path / "out", cracks, driver=driver, budget=None if driver == "enumeration" else 12)
    cells = crack_cells(done.scene, done.assembly, 0.05)
    for row in done.results.head(5).itertuples():
        alone = solve(cells.fine, cells.labels(from_string(str(row.labelling))))
        assert row.load_factor == pytest.approx(alone.load_factor, rel=1e-6)
    assert done.summary.facts["cracks"] == cracks
    assert done.result(1).load_factor == pytest.approx(done.results["load_factor"][0], rel=1e-6)


def test_a_candidate_of_one_face_changes_nothing(tmp_path: Path) -> None:
    """Cells as large as those of the joint grid: the table of a search by faces, bit for bit."""
    cells = searched(tmp_path / "cells", {"kind": "cells", "cell": 0.1})
    faces = searched(tmp_path / "faces", "faces", check_fields=0)
    columns = [name for name in faces.results.columns if name != "seconds"]
    pd.testing.assert_frame_equal(cells.results[columns], faces.results[columns], check_exact=True)


def test_options_for_cracks_by_faces_alone_are_refused(tmp_path: Path) -> None:
    cells = {"kind": "cells", "cell": 0.05}
    for cracks, more in (
        (cells, {"driver": "exact"}),
        (FIELDS, {"experiment": 1}),
        (FIELDS, {"certificate": tmp_path / "proof.jldcert"}),
    ):
        with pytest.raises(InputError) as refused:
            searched(tmp_path / "out", cracks, **more)
        assert "\n" not in str(refused.value)
        assert refused.value.parameter in {*more, "aim"}
    assert not (tmp_path / "proof.jldcert").exists()
    assert not (tmp_path / "out").exists()


def test_the_command_line_searches_by_fields(jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document()), encoding="utf-8")
    told = jld("explore", path, "--out", tmp_path / "out", "--cracks", "fields:0.4", "--jobs", "1", "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["cracks"] == {"kind": "fields", "gap": 0.4}
    # the folder remembers its crack model
    rank = json.loads(jld("solve", tmp_path / "out", "--rank", "1", "--json").out)
    assert rank["cracks"]["kind"] == "fields"
    assert (tmp_path / "out" / "best.png").exists()
    assert jld("plot", tmp_path / "out", "--rank", "1").code == 0
    assert (tmp_path / "out" / "layouts_1.png").stat().st_size > 10_000
    told = jld("plot", tmp_path / "out", "--format", "gif")
    assert told.code == 2
    assert "rigid elements" in told.err
    # the page shows the picture of the best layout
    data = study_data(read_folder(tmp_path / "out"))
    assert [base64.b64decode(one["png"]) for one in data["pictures"]] == [(tmp_path / "out" / "best.png").read_bytes()]
    assert len((tmp_path / "out" / "report.html").read_text(encoding="utf-8")) > len(data["pictures"][0]["png"])
