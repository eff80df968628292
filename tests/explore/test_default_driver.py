"""The default driver: a proof begins with labellings of the genetic driver, and counting takes a small share."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cases import grid_document
from jld_core import SolveOptions, build_assembly, parse_scene
from jld_core.deadline import Deadline
from jld_explore import ExploreSettings, driver_choice, explore, search_space
from jld_explore.drivers.choice import driver_for
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation.records import RECORDS_FILE

ROWS = ["aaaa", "aaaa", "#..#"]


def test_a_proof_begins_with_the_genetic_driver() -> None:
    """The first labellings of the default are those of the genetic driver with the same seed."""
    scene = parse_scene(grid_document(ROWS, block_cells=[2, 4]))
    space = search_space(scene, build_assembly(scene))
    chosen = driver_for(space, 3, SolveOptions(), None, {}, many=False)
    assert isinstance(chosen, Exact)
    np.testing.assert_array_equal(chosen.ask(48), Genetic(space, 3).ask(48))


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_the_default_driver_proves_the_same_as_exact(tmp_path: Path) -> None:
    """With and without the start the same λ is proven, that of enumeration."""
    scene = parse_scene(grid_document(ROWS, block_cells=[2, 4]))
    found = [
        explore(scene, tmp_path / name, ExploreSettings(driver=driver, small=small)).summary.to_json()
        for name, driver, small in (("default", None, 0), ("exact", "exact", 0), ("all", None, 20_000))
    ]
    assert [one["driver"] for one in found] == ["exact", "exact", "enumeration"]
    assert all(one["proven"] for one in found)
    assert [one["best"] for one in found] == pytest.approx([found[2]["best"]] * 3, rel=1e-6)


def test_the_default_driver_does_what_the_genetic_one_does(tmp_path: Path) -> None:
    """Where the default is the genetic driver, both see the same layouts in the same order, with the same name."""
    scene = parse_scene(grid_document(["a" * 8] * 6 + ["###..###"], block_cells=[2, 4]))
    facts, orders = [], []
    for driver in (None, "genetic"):
        settings = ExploreSettings(driver=driver, budget=100, jobs=1, pictures=False, check_fields=0)
        done = explore(scene, tmp_path / str(driver), settings)
        facts.append([done.summary.facts[key] for key in ("driver", "evaluated", "best", "classes")])
        with closing(sqlite3.connect(done.folder / RECORDS_FILE)) as file:
            orders.append(file.execute("SELECT labelling FROM evaluations ORDER BY id").fetchall())
    assert facts[0] == facts[1] == ["genetic", 100, facts[0][2], None]
    assert orders[0] == orders[1]
    assert len(orders[0]) == 100


def test_counting_takes_a_small_share_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 10 s a count has 0.6 s; beyond the reach of a proof it is quick, since the genetic driver needs the time."""
    left: list[float] = []
    quick_counts: list[bool] = []

    def count(*_: object, quick: bool) -> None:
        from jld_core.deadline import time_left

        left.append(time_left())
        quick_counts.append(quick)

    monkeypatch.setattr(driver_choice, "size_up_to", count)
    for rows in (ROWS, ["a" * 8] * 6 + ["###..###"]):
        scene = parse_scene(grid_document(rows, block_cells=[2, 4]))
        driver_choice.choose_driver(search_space(scene, build_assembly(scene)), ExploreSettings(), Deadline(10.0))
    assert left == pytest.approx([0.6, 0.6], rel=0.2)
    assert quick_counts == [False, True]
