"""Searches under several load cases: every driver, every row, and proofs by whichever case refutes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import every_layout, grid_document
from jld_core import SolveOptions, Status, build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.space import from_string

# what blocks that crack anywhere carry, test_field_check.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

RIGHT, LEFT, DOWN = [{"body": [1, 0]}], [{"body": [-1, 0]}], [{"body": [0, -1]}]
WINDS = [{"name": "left", "live": RIGHT}, {"name": "right", "live": LEFT}]

SCENES: dict[str, tuple[list[str], list[dict[str, Any]], dict[str, Any]]] = {
    "two winds": (["aaa", "aaa", "###"], WINDS, {"block_cells": [1, 3]}),
    "unequal winds": (
        ["aaa", "aaa", "##."],
        [{"name": "left", "live": RIGHT, "required": 0.5}, {"name": "right", "live": LEFT, "required": 0.8}],
        {"block_cells": [1, 3]},
    ),
    "bridge": (
        ["aaaa", "a..a", "#..#"],
        [
            {"name": "left half", "live": [{"element": "c1r0", "force": [0, -400]}]},
            {"name": "right half", "live": [{"element": "c2r0", "force": [0, -400]}]},
            {"name": "wind", "live": RIGHT, "required": 0.05},
        ],
        {"block_cells": [1, 4]},
    ),
    "snow": (
        ["aaa", "a.a", "###"],
        [{"name": "wind", "live": RIGHT}, {"name": "wind in snow", "live": LEFT, "dead": DOWN, "required": 0.9}],
        {"block_cells": [1, 2]},
    ),
    "four sides": (
        ["aa", "aa", "##"],
        [*WINDS, {"name": "lean", "live": [{"body": [1, -0.5]}]}, {"name": "lift", "live": [{"body": [-1, 0.3]}]}],
        {},
    ),
    "overhang": (
        ["aaa", "aaa", "##."],
        [{"name": "down", "live": DOWN}, {"name": "wind", "live": LEFT, "required": 0.1}],
        {},
    ),
}


def scene_of(name: str, **more: Any) -> Any:
    rows, cases, search = SCENES[name]
    return parse_scene({**grid_document(rows), "loads": {"cases": cases}, "search": {**search, **more}})


@pytest.mark.parametrize("name", SCENES)
def test_exact_proves_the_same_as_enumeration(name: str, tmp_path: Path) -> None:
    scene = scene_of(name)
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    found = explore(scene, tmp_path / "exact", ExploreSettings(pictures=False, driver="exact"))
    assert every.summary.proven
    assert found.summary.proven
    assert found.summary.best == pytest.approx(every.summary.best, rel=2e-6)
    assembly = build_assembly(scene)
    names = [case.name for case in assembly.cases]
    ranked = every.results[every.results["status"] == "collapse"]
    for _, row in ranked.iloc[:: max(1, len(ranked) // 12)].iterrows():
        result = solve(assembly, from_string(row["labelling"]))
        assert row["load_factor"] == pytest.approx(result.load_factor, rel=1e-6)
        for each in names:
            own = result.cases[each].load_factor
            assert row[f"load_factor[{each}]"] == pytest.approx(own, rel=1e-6, nan_ok=True)
        least = [result.cases[each].load_factor / factor for each, factor in zip(names, assembly.required, strict=True)]
        governed = least[names.index(row["governing"])]
        assert governed == pytest.approx(np.nanmin(least), rel=1e-6)


def test_fronts_of_cases(tmp_path: Path) -> None:
    scene = scene_of("unequal winds")
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    settings = ExploreSettings(pictures=False, driver="exact", options={"aim": "front"})
    found = explore(scene, tmp_path / "exact", settings)
    count = scene.search.front.count
    known = every.results[every.results["status"] == "collapse"].groupby(count)["load_factor"].max()
    proven = {row["count"]: row["load_factor"] for row in found.summary.facts["best_by_count"]}
    assert found.summary.proven
    assert proven == pytest.approx({k: v for k, v in known.items() if k in proven}, rel=1e-5)
    assert set(known.index) <= set(proven)


@pytest.mark.parametrize("name", ["two winds", "unequal winds"])
def test_a_tree_of_blocks_under_cases_proves_the_same_as_enumeration(name: str) -> None:
    scene = scene_of(name)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    driver = Exact(space, by_blocks="on", search=0)
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    while len(rows := driver.ask()):
        driver.tell(rows, evaluator.evaluate_all(rows))
    every = every_layout(space)
    best = max(found.load_factor for found in evaluator.evaluate_all(every) if found.status is Status.COLLAPSE)
    assert driver.finished
    assert driver.relaxations > 0
    assert driver.found[None].load_factor == pytest.approx(best, rel=2e-6)
    assert driver.found[None].bound >= best * (1.0 - 1e-9)


def test_a_case_that_cannot_matter_is_not_solved() -> None:
    """Unstable under one case: the others need no solve, and whoever asks again is told the same."""
    assembly = build_assembly(scene_of("overhang"))
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    slow = evaluator_of(assembly, EvaluatorSettings(SolveOptions(friction="zero-dilation")))
    quick = evaluator_of(assembly, EvaluatorSettings())
    found, whole = slow.evaluate(labels), quick.evaluate_all(labels[None])[0]
    assert found.status is whole.status is Status.UNSTABLE
    assert np.isnan(found.cases).all()


def test_a_mirror_maps_winds_onto_one_another() -> None:
    scene = scene_of("two winds")
    assert len(search_space(scene, build_assembly(scene)).group) == 2
    other = scene_of("unequal winds")
    assert len(search_space(other, build_assembly(other)).group) == 1


@pytest.mark.parametrize("driver", ["genetic", "random", "hillclimb", "anneal"])
def test_other_drivers_rank_by_the_governing_factor(driver: str, tmp_path: Path) -> None:
    scene = scene_of("bridge")
    done = explore(scene, tmp_path / "out", ExploreSettings(pictures=False, driver=driver, budget=40, jobs=1))
    assembly = build_assembly(scene)
    best = done.results.iloc[0]
    assert best["load_factor"] == pytest.approx(solve(assembly, from_string(best["labelling"])).load_factor, rel=1e-6)


def test_without_dilation_the_least_case_governs(tmp_path: Path) -> None:
    scene = scene_of("two winds")
    settings = ExploreSettings(pictures=False, driver="random", budget=6, model=SolveOptions(friction="zero-dilation"))
    done = explore(scene, tmp_path / "out", settings)
    for _, row in done.results[done.results["status"] == "collapse"].iterrows():
        each = [row["load_factor[left]"], row["load_factor[right]"]]
        assert row["load_factor"] == pytest.approx(min(each), rel=1e-6)
        assert row["load_factor"] <= row["load_factor_associative"] * (1.0 + 1e-6)
