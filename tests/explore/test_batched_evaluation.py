"""Studies whose labellings the batch solver settles: the same answers as one by one, whatever the jobs; never mixed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import CASES, grid_document
from jld_core import InputError, LimitAnalysis, SolveOptions, Status, blocks_of, build_assembly, parse_scene
from jld_core.batch import batch_solver, chosen
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import BufferedRandom, operators
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.space import feasible

SETTINGS = EvaluatorSettings()


pytestmark = pytest.mark.skipif(chosen() is None, reason="no compiled solver")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["wall", "beam", "overhang", "arch", "no friction", "crushable arch", "pressed"])
def test_evaluation_in_a_batch_equals_evaluation_one_by_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rows, options = CASES[name]
    assembly = build_assembly(parse_scene(grid_document(rows, **options)))
    dice = np.random.default_rng(2)
    asked = dice.random((12, len(assembly.interfaces))) < dice.random((12, 1))
    many = Evaluator(assembly, SETTINGS).evaluate_all(asked)
    monkeypatch.setenv("JLD_KERNEL", "off")
    single = Evaluator(assembly, SETTINGS)
    for labels, found in zip(asked, many, strict=True):
        known = single.evaluate(labels)
        assert found.status is known.status
        if known.status is Status.COLLAPSE:
            assert found.load_factor == pytest.approx(known.load_factor, rel=1e-6, abs=1e-9)
            assert found.low <= known.high + 1e-9
            assert found.high >= known.low - 1e-9
        elif known.status is Status.UNSTABLE:
            assert math.isnan(found.load_factor)


def test_the_batch_solver_is_used_where_it_settles() -> None:
    wall, pressed = (build_assembly(parse_scene(grid_document(*CASES[name][:1]))) for name in ("wall", "beam"))
    assert Evaluator(wall, SETTINGS).settles_nearly_all
    assert Evaluator(pressed, SETTINGS).settles_nearly_all
    assert not Evaluator(wall, EvaluatorSettings(use_batch_solver=False)).settles_nearly_all
    assert not Evaluator(wall, EvaluatorSettings(SolveOptions(friction="zero-dilation"))).settles_nearly_all
    rows, options = CASES["crushable wall"]
    assert Evaluator(build_assembly(parse_scene(grid_document(rows, **options))), SETTINGS).settles_nearly_all
    assert 0.8 <= batch_solver.BatchSolver(LimitAnalysis(wall).template).settled_fraction <= 1.0


def test_one_batch_solver_serves_all_analyses_of_an_assembly_in_use() -> None:
    scene = parse_scene(grid_document(["aaa", "aaa", "###"]))
    one, other = build_assembly(scene), build_assembly(scene)
    made = LimitAnalysis(one).batch
    assert LimitAnalysis(one, gap=1e-3).batch is made
    for analysis in (LimitAnalysis(one, inner_bending="kern"), LimitAnalysis(other)):
        assert made is None or analysis.batch is not made


def test_a_twin_answers_alike_by_the_same_kernel() -> None:
    wall = build_assembly(parse_scene(grid_document(*CASES["wall"][:1])))
    one = Evaluator(wall, SETTINGS)
    other = one.twin()
    assert other._batch is one._batch
    rows = np.random.default_rng(0).random((20, len(wall.interfaces))) < 0.5
    assert [replace(e, seconds=0.0) for e in one.evaluate_all(rows)] == [
        replace(e, seconds=0.0) for e in other.evaluate_all(rows)
    ]


def searched(folder: Path, jobs: int, budget: int, **more: Any) -> pd.DataFrame:
    scene = parse_scene(grid_document(["aaaa", "aaaa", "aaaa", "####"], block_cells=[1, 4]))
    settings = ExploreSettings(
        driver="genetic", seed=1, jobs=jobs, budget=budget, pictures=False, check_fields=0, **more
    )
    return explore(scene, folder, settings).results.drop(columns="seconds")


def test_jobs_and_interruptions_change_nothing(tmp_path: Path) -> None:
    whole = searched(tmp_path / "one", 1, 200)
    assert searched(tmp_path / "two", 2, 200).equals(whole)
    searched(tmp_path / "half", 1, 80)
    assert searched(tmp_path / "half", 2, 200, resume=True).equals(whole)


def test_a_study_goes_on_with_its_own_kernel_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched(tmp_path / "out", 1, 20)
    monkeypatch.setenv("JLD_KERNEL", "off")
    with pytest.raises(InputError, match="versions"):
        searched(tmp_path / "out", 1, 40, resume=True)


@pytest.mark.parametrize("search", [{"block_cells": [2, 4]}, {"candidates": "all+supports"}], ids=str)
def test_operators_draw_the_same_without_the_kernel(search: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = parse_scene(grid_document(["aabb", "aabb", "aabb", "#.##"], **search))
    space = search_space(scene, build_assembly(scene))

    def drawn() -> list[Any]:
        tools, chance = operators(space), BufferedRandom(np.random.default_rng(4))
        first = tools.draw(60, chance)
        bred = tools.breed(first[:20], first[20:40], first[:30], chance)
        return [first, bred, [blocks_of(space.assembly, labels) for labels in bred], feasible(space, bred)]

    quick = drawn()
    monkeypatch.setenv("JLD_KERNEL", "off")
    for one, other in zip(quick, drawn(), strict=True):
        assert np.array_equal(one, other)
