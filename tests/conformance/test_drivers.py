"""What every driver owes a study, whichever it is: one suite, and a table of λ in the place of the solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import canonical, every_layout, grid_document
from jld_core import Assembly, Scene, Status, build_assembly, parse_scene
from jld_explore import Driver, Evaluation, ExploreSettings, Interrupted, SearchSpace, StopReason, search_space
from jld_explore.drivers import DRIVERS, make_driver
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.report import tables
from jld_explore.search.study import Study
from jld_explore.space import feasible, keys

NAMES = [*(name for name in DRIVERS if name not in ("optuna", "exact")), "optuna:Random", "optuna:NSGAII"]
DOWN = [{"element": "c1r0", "force": [0, -1]}]
SCENES: dict[str, dict[str, Any]] = {
    "sizes": {"block_cells": [2, 4]},
    "one size": {"block_cells": [3, 3]},
    "numbers": {"blocks": [2, 4], "dry_faces": [3, 8]},
    "extent": {"block_extent": [0.2, 0.3], "candidates": "all+supports"},
    "weight": {"block_weight": [20.0, 60.0], "keep": {"dry": [["c0r0", "c1r0"]], "inner": [["c1r1", "c2r1"]]}},
    "loose": {"segmentation": False, "block_cells": [1, 4], "dry_faces": [3, 7]},
}


FEW = ("one size", "weight", "loose")
EVERY = [(name, scene) for name in NAMES for scene in SCENES if not name.startswith("optuna:") or scene in FEW]
"""Drivers and the spaces that they ask for to the end. Optuna draws the last of a large space many times over."""
LOCAL, LARGE = ("random", "hillclimb", "anneal", "portfolio"), ("numbers", "extent")
"""Drivers that take long to the end of spaces, and spaces that genetic and enumeration are asked for beside sizes."""


@dataclass(frozen=True)
class Case:
    scene: Scene
    assembly: Assembly
    space: SearchSpace


@cache
def case(name: str) -> Case:
    rows = {"sizes": ["aaaa", "aaaa", "aaaa", "#..#"], "loose": ["aaa", "aaa", "#.#"]}
    document = grid_document(rows.get(name, ["aaa", "aaa", "aaa", "#.#"]), live=DOWN, **SCENES[name])
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return Case(scene, assembly, search_space(scene, assembly))


def driver_of(name: str, space: SearchSpace, seed: int) -> Driver:
    name, _, sampler = name.partition(":")
    return make_driver(name, space, seed, **({"sampler": sampler} if sampler else {}))


class Table:
    """A stand-in for the solver: λ and status from the labelling, smooth enough to be searched."""

    calls = 0
    after: Callable[[int], None] | None = None

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self.weight = np.random.default_rng(3).normal(size=len(assembly.interfaces))

    def evaluate(self, labels: np.ndarray, *_: object) -> Evaluation:
        """λ = 5 + w·labels; every eleventh class has no number."""
        type(self).calls += 1
        if Table.after is not None:
            Table.after(Table.calls)
        value = 5.0 + float(self.weight @ labels)
        number = int(np.packbits(labels).astype(int) @ (1 + np.arange(len(np.packbits(labels))))) % 22
        if number in (0, 11):
            status = Status.UNSTABLE if number else Status.LOCKED
            return Evaluation(status, np.nan, np.nan, np.nan)
        return Evaluation(Status.COLLAPSE, value, value, value)

    def evaluate_all(self, labellings: np.ndarray, floors: object = None, deadline: Any = None) -> list[Evaluation]:
        """One after the other, up to the deadline."""
        found = []
        for labels in labellings:
            if deadline is not None and deadline.passed():
                break
            found.append(self.evaluate(labels))
        return found


@pytest.fixture(autouse=True)
def table() -> Iterator[type[Table]]:
    """Workers make a Table where they would make an evaluator."""
    Table.calls, Table.after = 0, None
    yield Table
    Table.after = None


def explored(found: Case, name: str, folder: Path, *, seed: int = 1, **limits: Any) -> tuple[Study, StopReason]:
    # a digest of its own for each run, so that no evaluator is left over from another
    driver = driver_of(name, found.space, seed)
    study = Study(
        found.scene, found.assembly, found.space, driver, folder, ExploreSettings(seed=seed, **limits), make=Table
    )
    return study, study.run()


def rows_of(study: Study) -> list[tuple[Any, ...]]:
    """The table without clocks."""
    table = tables.results_table(study.records, study.assembly, study.space, "any").drop(columns="seconds")
    return list(table.astype(str).itertuples(index=False, name=None))


def front_of(study: Study) -> list[tuple[str, float]]:
    table = tables.results_table(study.records, study.assembly, study.space, "any")
    front = study.scene.search.front
    kept = tables.front_table(table, front.axes)
    return list(zip(kept["labelling"], kept["load_factor"], strict=True))


def talk(driver: Driver, found: Case, budget: int, portion: int | None = None) -> list[bytes]:
    """Ask and tell until the budget; every answer is checked on the way."""
    solver, asked = Table(found.assembly, EvaluatorSettings()), []
    while len(asked) < budget:
        labellings = driver.ask(min(budget - len(asked), portion or budget))
        if not len(labellings):
            break
        assert labellings.shape[1] == len(found.assembly.interfaces)
        assert len(labellings) <= min(budget - len(asked), portion or budget)
        assert feasible(found.space, labellings).all()
        assert np.array_equal(canonical(labellings, found.space.group), labellings)
        asked += keys(labellings)
        driver.tell(labellings, [solver.evaluate(labels) for labels in labellings])
    return asked


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("name", "scene"),
    [pytest.param(*one, marks=pytest.mark.long) if one[0] in LOCAL and one[1] in LARGE else one for one in EVERY],
)
def test_all_of_a_small_space_and_nothing_else_or_twice(name: str, scene: str) -> None:
    found = case(scene)
    every = set(keys(every_layout(found.space)))
    driver = driver_of(name, found.space, 0)
    asked = talk(driver, found, len(every) + 100)
    assert len(asked) == len(set(asked))
    assert set(asked) == every
    assert len(driver.ask(5)) == 0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_the_seed_decides(name: str) -> None:
    found = case("sizes")
    runs = [talk(driver_of(name, found.space, seed), found, 60) for seed in (0, 0, 1)]
    assert runs[0] == runs[1]
    if name != "enumeration":
        assert runs[0] != runs[2]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_small_portions_and_idle_asks(name: str) -> None:
    found = case("sizes")
    driver = driver_of(name, found.space, 0)
    assert len(driver.ask(0)) == 0
    asked = talk(driver, found, 90, portion=7)
    assert len(asked) == len(set(asked)) == 90
    if name in ("enumeration", "random", "genetic"):
        # what is asked does not depend on how asking is cut
        assert asked == talk(driver_of(name, found.space, 0), found, 90)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_asking_ahead_of_the_answers(name: str) -> None:
    found = case("sizes")
    driver = driver_of(name, found.space, 0)
    portions = [keys(driver.ask(16)) for _ in range(6)]
    asked = [key for portion in portions for key in portion]
    assert all(portions)
    assert len(asked) == len(set(asked))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_front_of_a_space_smaller_than_the_budget(name: str, tmp_path: Path) -> None:
    # optuna draws the last of "sizes" many times over
    found = case("weight" if name.startswith("optuna:") else "sizes")
    reference, reason = explored(found, "enumeration", tmp_path / "enumeration")
    study, why = explored(found, name, tmp_path / "driver", budget=10_000)
    assert (reason, why) == (StopReason.EXHAUSTED, StopReason.EXHAUSTED)
    assert rows_of(study) == rows_of(reference)
    assert front_of(study) == front_of(reference)
    assert len(front_of(study)) > 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_budget(name: str, tmp_path: Path) -> None:
    study, reason = explored(case("sizes"), name, tmp_path / "a", budget=41)
    assert reason is StopReason.BUDGET
    assert len(study.records) == study.evaluated == Table.calls == 41


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_time(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is begun after the time is up, here when the clock jumps at the 30th solve."""
    found, clock = case("sizes"), [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(time, "time", lambda: clock[0])

    def jump(calls: int) -> None:
        clock[0] = 100.0 if calls >= 30 else 0.0

    Table.after = jump
    study, reason = explored(found, name, tmp_path / "a", seconds=50.0)
    assert reason is StopReason.TIME
    assert Table.calls == 30
    assert len(study.records) == 30


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "name", [*NAMES[:-2], *(pytest.param(one, marks=pytest.mark.long) for one in NAMES[-2:-1]), NAMES[-1]]
)
def test_interrupted_anywhere_and_resumed(name: str, tmp_path: Path) -> None:
    """A run stopped after any number of solves, and again, ends in the table of an uninterrupted one."""
    found = case("sizes")
    whole, _ = explored(found, name, tmp_path / "whole", budget=120)
    for stop in (1, 73):
        Table.calls = 0

        def interrupt(calls: int, stop: int = stop) -> None:
            if calls == stop:
                raise Interrupted

        Table.after = interrupt
        folder = tmp_path / str(stop)
        with pytest.raises(Interrupted):
            explored(found, name, folder, budget=120)
        Table.after = None
        study, reason = explored(found, name, folder, budget=120)
        assert reason is StopReason.BUDGET
        assert rows_of(study) == rows_of(whole)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_a_larger_budget_goes_on(name: str, tmp_path: Path) -> None:
    found = case("sizes")
    whole, _ = explored(found, name, tmp_path / "whole", budget=100)
    explored(found, name, tmp_path / "parts", budget=45)
    study, _ = explored(found, name, tmp_path / "parts", budget=100)
    if name in ("hillclimb", "optuna:Random", "optuna:NSGAII"):  # these look at answers in portions as asked
        assert len(study.records) >= 100
    else:
        assert rows_of(study) == rows_of(whole)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_labellings_without_a_number_are_never_the_best(name: str, tmp_path: Path) -> None:
    study, _ = explored(case("sizes"), name, tmp_path / "a", budget=80)
    table = tables.results_table(study.records, study.assembly, study.space, name)
    apart = table[table["status"] != "collapse"]
    assert len(apart)
    assert apart["load_factor"].isna().all()
    assert apart["rank"].isna().all()
    assert table["status"].iloc[0] == "collapse"


@pytest.mark.parametrize("name", ["genetic", "hillclimb"])
def test_learning_beats_chance(name: str) -> None:
    """On λ that is a sum over faces the best of 300 is found sooner than by drawing at random."""
    scene = parse_scene(grid_document(["aaaa"] * 4 + ["####"], block_cells=[2, 4]))
    assembly = build_assembly(scene)
    found = Case(scene, assembly, search_space(scene, assembly))
    solver = Table(assembly, EvaluatorSettings())

    def reached(name: str, seed: int) -> float:
        driver, best, left = driver_of(name, found.space, seed), -np.inf, 300
        while left:
            rows = driver.ask(left)
            evaluations = [solver.evaluate(labels) for labels in rows]
            driver.tell(rows, evaluations)
            best = max([best, *(e.load_factor for e in evaluations if e.status is Status.COLLAPSE)])
            left -= len(rows)
        return best

    assert np.mean([reached(name, s) for s in range(5)]) > np.mean([reached("random", s) for s in range(5)])
