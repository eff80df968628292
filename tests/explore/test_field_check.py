"""The check by fields at the end of a search by faces: columns, findings, and what it leaves alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from jld_core import build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_explore import Exploration, ExploreSettings, explore, read_folder, search_space
from jld_explore.evaluation.field_evaluator import COARSE_RATE, mesh_seconds, time_rate
from jld_explore.report import words
from jld_explore.space import from_string
from jld_explore.steps.field_check import _findings, plan_check

PUSHED: list[dict[str, Any]] = [{"element": "c1r0", "force": [0, -1], "at": [0.15, 0.3]}]


def searched(folder: Path, **more: Any) -> Exploration:
    """Six cells on two bearings under a force, of which every layout is evaluated."""
    document = grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5)
    settings = ExploreSettings(driver="enumeration", jobs=1, pictures=False, **more)
    return explore(parse_scene(document), folder, settings)


def test_the_best_are_bounded_by_fields(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", check_fields=3)
    table = pd.read_csv(tmp_path / "a" / "results.csv")
    known = table["fields_lo"].notna()
    assert known.tolist() == [True] * 3 + [False] * (len(table) - 3)
    for row in range(3):
        labels = from_string(str(table["labelling"][row]))
        alone = bounds_by_fields(done.assembly, labels, gap=1e-9, most_triangles=1)
        assert table["fields_lo"][row] == pytest.approx(alone.lower, rel=1e-9)
        assert table["fields_hi"][row] == pytest.approx(alone.upper, rel=1e-9)
    space = search_space(done.scene, done.assembly)
    whole = bounds_by_fields(done.assembly, space.fixed & ~space.candidates, gap=1e-9, most_triangles=1)
    assert done.summary.facts["fields"]["uncut"] == pytest.approx([whole.lower, whole.upper], rel=1e-9)
    facts = words.facts_of_exploration(read_folder(tmp_path / "a"))
    assert done.summary.facts["fields"]["findings"]
    assert facts["by fields"].endswith("--cracks fields --out DIR searches by fields")
    assert json.loads((tmp_path / "a" / "columns.json").read_text("utf-8"))["results.csv"]["fields_hi"]


def test_without_a_check_there_are_no_columns(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", check_fields=0)
    assert "fields_lo" not in done.results
    assert "fields" not in done.summary.facts


def test_a_time_limit_skips_the_check_by_fields_with_a_sentence(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", seconds=0.0)
    assert done.summary.facts["fields"]["skipped"]
    assert done.results["fields_lo"].isna().all()
    assert "not checked" in words.facts_of_exploration(done)["by fields"]


def test_large_scenes_are_checked_less() -> None:
    """The expected time decides before anything is solved, so that a table does not depend on the machine."""
    counts = []
    for columns in (3, 12, 40):
        scene = parse_scene(grid_document(["a" * columns] * 8 + ["#" * columns]))
        assembly = build_assembly(scene)
        plan = plan_check(scene, assembly, search_space(scene, assembly), ExploreSettings())
        counts.append(plan.count)
        assert plan.seconds <= 2.0
    assert counts[0] == 10 > counts[1] > counts[2] == 0
    assert "1280 triangles" in plan.skipped


def test_scenes_beyond_fields_are_left_alone() -> None:
    document = grid_document(["aaa", "aaa", "###"])
    for change in ({"cracks": {"kind": "cells", "cell": 0.05}}, {"search": {"void": {"cells": ["c0r0"]}}}):
        scene = parse_scene({**document, **change})
        assembly = build_assembly(scene)
        assert plan_check(scene, assembly, search_space(scene, assembly), ExploreSettings()) is None


def test_findings() -> None:
    """Said is what the bounds prove: a fall of more than 5 %, another order, and that no cut is better."""
    values, low, high = np.array([10.0, 9.0, 8.0]), np.array([9.0, 8.0, 7.0]), np.array([9.8, 8.9, 8.0])
    assert _findings(values, low, high, (8.0, 12.0)) == []
    fallen = _findings(values, low, np.array([9.2, 8.9, 5.0]), None)
    assert fallen == [
        "the blocks of the best carry at most 9.2, 8% less than by faces, and 1 more of the best 3 fall by over 5%"
    ]
    falling = _findings(values, low, np.array([-73.48, 8.9, -5.0]), None)
    assert (
        falling[0] == "wherever its blocks crack, the best falls under its own weight, and so do 1 more of the best 3"
    )
    later = _findings(values, low, np.array([9.8, 8.9, 5.0]), None)
    assert later == ["1 of the best 3 carry over 5% less than by faces"]
    order = _findings(values, np.array([9.0, 8.0, 9.9]), np.array([9.8, 8.9, 10.0]), None)
    assert order == ["row 3 carries at least 9.9, more than the best can"]
    assert _findings(values, low, high, (9.9, 12.0)) == [
        "without cuts it carries at least 9.9, more than any of the best 3"
    ]


def test_time_of_a_mesh_follows_from_that_of_another() -> None:
    """The measured times of a wall of 12 × 9 cells, 432 and 3 315 triangles, on the safe side by less than twice."""
    expected = mesh_seconds(time_rate(0.42, 432), 3315)
    assert 5.3 < expected < 2.0 * 5.3
    assert mesh_seconds(COARSE_RATE, 60) == pytest.approx(0.024)
