"""A load factor is required and a count is made best: every driver, and the exact one against brute force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from jld_core import InputError, parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.report import words

# what blocks that crack anywhere carry, test_field_check.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

WALL = ["aaa", "aaa", "###"]
REQUIRED = (0.3, 0.52, 0.66, 0.75, 2.0)
"""Load factors that all, most, some, few and none of the layouts have."""
WINDS = [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [-1, 0]}], "required": 1.1}]


def scene_of(count: str, sense: str, least: float, *, cases: bool = False, limits: dict[str, Any] | None = None) -> Any:
    document = grid_document(
        WALL,
        **{"block_cells": [1, 3], **(limits or {})},
        front={"count": count, "sense": sense},
        require={"load_factor": least},
    )
    if cases:
        document["loads"] = {"cases": WINDS}
    return parse_scene(document)


def best_of(results: pd.DataFrame, count: str, sense: str, least: float) -> float | None:
    """By brute force, from the numbers of the table."""
    good = results[(results["status"] == "collapse") & (results["bracket_lo"] >= least * (1.0 - 1e-6))]
    good = pd.concat([good, results[results["status"] == "locked"]])
    if good.empty:
        return None
    return float(good[count].min() if sense == "min" else good[count].max())


@pytest.mark.parametrize(
    ("count", "sense", "cases", "required"),
    [
        ("blocks", "min", False, REQUIRED),
        ("dry_faces", "max", False, REQUIRED),
        ("shapes", "min", False, REQUIRED[::3]),
        ("blocks", "max", True, REQUIRED[1::3]),
    ],
)
def test_exact_is_brute_force(count: str, sense: str, cases: bool, required: tuple[float, ...], tmp_path: Path) -> None:
    wide = {"block_cells": [1, 2]}
    for number, least in enumerate(required):
        scene = scene_of(count, sense, least, cases=cases, limits=wide)
        every = explore(scene, tmp_path / f"every{number}", ExploreSettings(pictures=False, driver="enumeration"))
        found = explore(scene, tmp_path / f"exact{number}", ExploreSettings(pictures=False, driver="exact"))
        expected = best_of(every.results, count, sense, least)
        for done in (every, found):
            asked = done.summary.facts["require"]
            assert done.summary.proven is asked["proven"] is True
            assert asked["best"] == expected
            if expected is not None:
                row = done.results.iloc[0]
                assert row["meets"]
                assert row[count] == expected
                assert row["labelling"] == asked["best_labelling"] == done.summary.best_labelling
        assert ("proven that there is none" in words.facts_of_exploration(found)["required"]) == (expected is None)


@pytest.mark.parametrize("driver", ["genetic", "hillclimb", "random", "optuna"])
def test_other_drivers_optimise_the_count_among_layouts_that_meet_the_requirement(driver: str, tmp_path: Path) -> None:
    scene = scene_of("blocks", "min", 0.6)
    settings = ExploreSettings(pictures=False, driver=driver, budget=25, seed=1)
    done = explore(scene, tmp_path / "out", settings)
    asked = done.summary.facts["require"]
    met = done.results[done.results["meets"]]
    assert asked["met"] == len(met) > 0
    assert asked["best"] == met["blocks"].min() == done.results.iloc[0]["blocks"]
    assert not asked["proven"]
    assert not done.summary.proven
    # what meets it stands first, and by the count
    ranked = done.results[done.results["status"] == "collapse"]
    assert (np.diff(ranked["meets"].astype(int)) <= 0).all()
    assert (np.diff(ranked[ranked["meets"]]["blocks"]) >= 0).all()


@pytest.mark.parametrize(
    ("require", "words"),
    [
        ({"load_factor": 0}, "search.require.load_factor"),
        ({"load_factor": "much"}, "search.require.load_factor"),
        ({}, "search.require.load_factor: missing"),
        ({"load_factor": 1, "blocks": 3}, "search.require.blocks: unknown key"),
    ],
)
def test_wrong_requirements(require: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_scene(grid_document(WALL, require=require))
    assert words in str(caught.value)


def test_a_front_is_refused_where_a_load_factor_is_required(tmp_path: Path) -> None:
    settings = ExploreSettings(pictures=False, driver="exact", options={"aim": "front"})
    with pytest.raises(InputError, match=r"search\.require"):
        explore(scene_of("blocks", "min", 0.5), tmp_path / "out", settings)
