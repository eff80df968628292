"""Without dilation only what can still matter is solved; the rest is recorded with its bound, apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases import grid_document
from jld_core import InputError, SolveOptions, Status, build_assembly, load_scene, parse_scene
from jld_explore import Evaluation, ExploreSettings, explore, search_space
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.cases import IncumbentFront
from jld_explore.evaluation.protocol import BOUND, Evaluator
from jld_explore.evaluation.ranking import comparison_value, sort_key, status_ranks
from paths import SCENES

NAN = float("nan")


def test_floor_is_the_best_with_as_good_a_count() -> None:
    space = search_space(scene := parse_scene(grid_document(["aa", "aa", "##"])), build_assembly(scene))
    rows = np.zeros((4, len(space.fixed)), dtype=bool)
    free = np.flatnonzero(space.assembly.free_faces)
    for row, dry in enumerate((0, 1, 2, 3)):
        rows[row, free[:dry]] = True
    floor = IncumbentFront(space)
    assert floor.thresholds(rows).tolist() == [-np.inf] * 4
    collapse = [Evaluation(Status.COLLAPSE, v, v, v) for v in (5.0, 4.0, 7.0)]
    floor.learn(rows[:3], collapse)
    assert floor.thresholds(rows).tolist() == [7.0, 7.0, 7.0, -np.inf]
    floor.learn(rows[3:], [Evaluation(Status.COLLAPSE, 1.0, 1.0, 1.0)])
    assert floor.thresholds(rows).tolist() == [7.0, 7.0, 7.0, 1.0]


def test_an_evaluation_by_a_bound_has_no_load_factor_and_guides_drivers() -> None:
    found = Evaluation(Status.UNCERTIFIED, NAN, 3.0, 2.9, settled=BOUND)
    assert np.isnan(found.load_factor)
    assert comparison_value(found) == 3.0
    assert sort_key(found) == (0, -3.0)
    assert status_ranks([found]).tolist() == [0]


def test_evaluator_stops_at_the_associative_bound() -> None:
    scene = parse_scene(grid_document(["aa", "aa", "##"]))
    assembly = build_assembly(scene)
    evaluator = Evaluator(assembly, EvaluatorSettings(SolveOptions(friction="zero-dilation")))
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    full = evaluator.evaluate(labels)
    assert full.status is Status.COLLAPSE
    spared = evaluator.evaluate(labels, pruning_threshold=1.01 * full.associative)
    assert (spared.settled, spared.status) == (BOUND, Status.UNCERTIFIED)
    assert spared.high == pytest.approx(full.associative, rel=1e-6)
    assert np.isnan(spared.zero_dilation)
    assert evaluator.evaluate(labels, pruning_threshold=0.99 * full.associative).settled == "solve"


@pytest.mark.parametrize("driver", ["enumeration", "genetic"])
def test_best_and_front_are_those_of_all_solves(driver: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))
    settings = ExploreSettings(driver=driver, model=SolveOptions(friction="zero-dilation"), pictures=False)
    monkeypatch.setattr("jld_explore.study.PORTION", 16)
    spared = explore(scene, tmp_path / "spared", settings)
    monkeypatch.setattr(IncumbentFront, "thresholds", lambda self, rows: np.full(len(rows), -np.inf))
    solved = explore(scene, tmp_path / "solved", settings)
    assert spared.summary.pruned > 0
    assert solved.summary.pruned == 0
    assert spared.summary.evaluated == solved.summary.evaluated
    assert spared.summary.best == pytest.approx(solved.summary.best, rel=1e-6)
    assert spared.front["dry_faces"].tolist() == solved.front["dry_faces"].tolist()
    assert spared.front["load_factor"].tolist() == pytest.approx(solved.front["load_factor"].tolist(), rel=1e-6)
    apart = spared.results[spared.results["settled"] == BOUND]
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
