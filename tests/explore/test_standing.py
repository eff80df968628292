"""Layouts that fall under their dead load alone rank after those that stand, and are called so everywhere."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmarks.common import random_segmentations, scene

from cases import dry_and_inner, grid_document
from command import Command
from jld_core import SolveOptions, build_assembly, parse_scene, solve
from jld_explore import Exploration, explore, read_folder
from jld_explore.evaluation.cases import Standing
from jld_explore.report.words import facts_of_exploration

DRIVERS = ("enumeration", "random", "hillclimb", "anneal", "genetic", "optuna", "exact")


def slope(shear: float, candidates: str = "all+supports") -> dict[str, Any]:
    """Two stones on a slope of 45°, steeper than friction: a push into the slope holds them from some λ on.

    With dry joints a push of λ = (1 + μ) / (1 − μ) = 4 slides them upwards. Glued to the slope they stand without
    a push where the shear strength suffices, and carry less of one.
    """
    return {
        "name": "slope",
        "elements": [
            {"id": "slope", "support": True, "polygon": [[0, 0], [4, 0], [4, 4]]},
            {"id": "a", "polygon": [[1, 1], [2, 2], [1.5, 2.5], [0.5, 1.5]]},
            {"id": "b", "polygon": [[2, 2], [3, 3], [2.5, 3.5], [1.5, 2.5]]},
        ],
        "materials": dry_and_inner(2000, 0.6, 1e6, shear, gravity=9.81),
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"candidates": candidates, "segmentation": False, "symmetry": "none"},
    }


def alone(document: dict[str, Any]) -> dict[str, tuple[float, bool | None]]:
    """Return λ and whether it stands of each labelling, solved alone."""
    assembly = build_assembly(parse_scene(document))
    found = {}
    for letters in product("di", repeat=len(assembly.interfaces)):
        result = solve(assembly, "".join(letters))
        found["".join(letters)] = result.load_factor, result.stands_at_zero
    return found


def found_by(driver: str, document: dict[str, Any], folder: Path, **settings: Any) -> Exploration:
    return explore(parse_scene(document), folder / "out", driver=driver, pictures=False, budget=64, **settings)


@pytest.mark.usefixtures("without_field_check")
@pytest.mark.parametrize("driver", DRIVERS)
def test_best_of_those_that_stand(driver: str, tmp_path: Path) -> None:
    """The strongest layout has dry joints and falls without the push."""
    oracle = alone(slope(19620.0))
    best = max(load for load, stands in oracle.values() if stands)
    assert best < 3.8 < max(load for load, _ in oracle.values())
    done = found_by(driver, slope(19620.0), tmp_path)
    table = done.results
    assert done.summary.best == pytest.approx(best, rel=1e-6)
    assert done.summary.stands_at_zero is True
    for name, stands in zip(table["labelling"], table["stands_at_zero"], strict=True):
        assert oracle[name][1] is None or bool(stands) is oracle[name][1]
    ranked = table[table["status"] == "collapse"]
    falls = ~ranked["stands_at_zero"].astype(bool).to_numpy()
    assert falls.tolist() == sorted(falls)
    assert ranked["rank"].is_monotonic_increasing
    strongest = ranked["load_factor"].max()
    assert strongest == pytest.approx(4.0, rel=1e-6)
    assert done.summary.facts["falling"] == int(falls.sum()) > 0
    assert "ranked last" in facts_of_exploration(done)
    front = pd.read_csv(tmp_path / "out" / "pareto.csv")
    assert front["stands_at_zero"].all()
    if done.summary.proven:
        assert done.summary.bound == pytest.approx(best, rel=1e-5)
        assert done.summary.facts.get("proof_check", {"passed": True})["passed"]


@pytest.mark.usefixtures("without_field_check")
@pytest.mark.parametrize("driver", ["enumeration", "exact", "genetic"])
def test_nothing_stands(driver: str, tmp_path: Path) -> None:
    done = found_by(driver, slope(1e3, "all"), tmp_path)
    assert done.summary.best == pytest.approx(4.0, rel=1e-6)
    assert done.summary.stands_at_zero is False
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert said["stands_at_zero"] is False
    assert "falls under its own weight" in facts_of_exploration(done)["best λ"]
    assert "falls" in repr(done)
    assert not done.results["stands_at_zero"].fillna(True).any()
    assert repr(read_folder(tmp_path / "out")) == repr(done)


@pytest.mark.usefixtures("without_field_check")
def test_a_resumed_search_ranks_alike(tmp_path: Path) -> None:
    first = found_by("exact", slope(19620.0), tmp_path)
    again = found_by("exact", slope(19620.0), tmp_path, resume=True)
    assert again.results["labelling"].tolist() == first.results["labelling"].tolist()
    assert again.summary.best == first.summary.best


@pytest.mark.usefixtures("without_field_check")
def test_a_required_load_factor_is_not_met_by_what_falls(tmp_path: Path) -> None:
    document = slope(19620.0)
    document["search"]["require"] = {"load_factor": 3.9}
    for driver in ("enumeration", "exact"):
        done = found_by(driver, document, tmp_path / driver)
        assert not done.results["meets"].any()
        assert done.summary.facts["require"]["best"] is None


@pytest.mark.usefixtures("without_field_check")
def test_cells_and_cases(tmp_path: Path) -> None:
    document = slope(19620.0)
    live = document["loads"].pop("live")
    document["loads"]["cases"] = [{"name": "push", "live": live}, {"name": "more", "live": live, "required": 2}]
    done = found_by("exact", document, tmp_path)
    best = max(load for load, stands in alone(document).values() if stands)
    assert done.summary.best == pytest.approx(best, rel=1e-6)
    assert done.summary.stands_at_zero is True


@pytest.mark.parametrize(
    ("rows", "friction"), [(["aab", "abb", "###"], 0.3), (["ab", "##"], 0.6), (["a.b", "aab", "#.#"], 0.2)]
)
def test_equals_a_solve_of_each_labelling(rows: list[str], friction: float) -> None:
    """States and mechanisms of other labellings decide as the labelling's own analysis does."""
    document = grid_document(rows, friction=friction, tension=2e3, shear=2e3)
    document["materials"]["gravity"] = [5.0, -9.0]
    assembly = build_assembly(parse_scene(document))
    labels = np.random.default_rng(3).random((24, len(assembly.interfaces))) < 0.6
    found = Standing(assembly, SolveOptions()).of(labels, np.full(len(labels), np.nan))
    for row, stands in zip(labels, found, strict=True):
        own = solve(assembly, row).stands_at_zero
        assert own is None or bool(stands) is own


def test_many_layouts_of_an_arch_equal_a_solve_of_each(tmp_path: Path) -> None:
    """So many different states are needed that most answers come from bounds in both directions of the live load."""
    assembly = scene("flat_beam_arch")
    labellings = random_segmentations(assembly, 80, seed=3)
    standing = Standing(assembly, SolveOptions())
    alone = [solve(assembly, labels) for labels in labellings]
    expected = [float(one.stands_at_zero) for one in alone]
    low = np.array([one.bracket[0] for one in alone])
    assert 10 < sum(expected) < 70
    assert standing.of(labellings, low).tolist() == expected
    assert standing.of(labellings, low).tolist() == expected
    other = Standing(assembly, SolveOptions())
    assert other.of(labellings[::-1], np.full(len(low), np.nan)).tolist() == expected[::-1]


def test_printed(jld: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(slope(1e3, "all")))
    done = jld("explore", tmp_path / "scene.json", "-o", tmp_path / "out", "--check-fields", "0")
    assert done.code == 0
    assert "falls under its own weight" in done.out
    assert "proven strongest" not in done.out
