"""Drivers that learn: genetic, annealing and surrogates, their targets, and which driver is the default."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import run as run_claim

from cases import grid_document, space_of
from command import SCENES
from jld_core import LimitAnalysis, Status, build_assembly, load_scene, parse_scene
from jld_core.limit import mechanism
from jld_explore import Evaluation, ExploreSettings, explore, search_space
from jld_explore.drivers import DRIVERS, Genetic
from jld_explore.drivers.genetic import crowding_of, fronts_of
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_explore.space import count_named, keys, values_of

BEST = 12.6221788  # of all 6 382 classes, by enumeration


def test_best_of_the_flagship_within_500() -> None:
    """In at least two of three seeds; over ten seeds the benchmark asks for nine."""
    scene = load_scene(SCENES / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    solver, reached = Evaluator(assembly, EvaluatorSettings()), 0
    for seed in (0, 1, 2):
        driver, left, best = Genetic(space, seed), 500, 0.0
        while left and best < BEST * (1.0 - 1e-6):
            rows = driver.ask(left)
            found = solver.evaluate_all(rows)
            driver.tell(rows, found)
            left -= len(rows)
            best = max([best, *(e.load_factor for e in found if e.status is Status.COLLAPSE)])
        assert best <= BEST * (1.0 + 1e-6)
        reached += best >= BEST * (1.0 - 1e-6)
    assert reached >= 2


# Deb 2001, Multi-Objective Optimization using Evolutionary Algorithms, table 20: parents 1 to 6, offspring a to f.
PUBLISHED = {
    "1": (0.31, 6.10), "2": (0.43, 6.79), "3": (0.22, 7.09), "4": (0.59, 7.85), "5": (0.66, 3.65), "6": (0.83, 4.23),
    "a": (0.21, 5.90), "b": (0.79, 3.97), "c": (0.51, 6.51), "d": (0.27, 6.93), "e": (0.58, 4.52), "f": (0.24, 8.54),
}  # fmt: skip


def test_fronts_of_a_published_example() -> None:
    names, values = list(PUBLISHED), np.array(list(PUBLISHED.values()))
    found = [{names[n] for n in front} for front in fronts_of(values, len(values))]
    assert found == [{"5", "a", "e"}, {"1", "3", "b", "d"}, {"2", "6", "c", "f"}, {"4"}]
    assert [len(front) for front in fronts_of(values, 4)] == [3, 4]  # 7 rows are enough


@pytest.mark.parametrize("objectives", [1, 2, 3])
def test_fronts_are_those_of_the_definition(objectives: int) -> None:
    """A front holds the rows that no other row left dominates, with ties, in ascending order."""
    rng = np.random.default_rng(objectives)
    for count, different, enough in ((1, 1, 5), (40, 40, 12), (90, 7, 33), (60, 25, 60), (30, 1, 4)):
        values = rng.integers(different, size=(count, objectives)).astype(float)
        left, known = list(range(count)), []
        while left and sum(map(len, known)) < enough:
            front = [
                n
                for n in left
                if not any((values[k] <= values[n]).all() and (values[k] < values[n]).any() for k in left)
            ]
            known.append(front)
            left = [n for n in left if n not in front]
        assert [front.tolist() for front in fronts_of(values, enough)] == known


def test_crowding_is_that_of_the_definition() -> None:
    """Mean over the objectives of the distance between both neighbours on the front, in widths of the front."""
    rng = np.random.default_rng(0)
    values = np.column_stack([rng.normal(size=60), rng.permutation(60).astype(float), np.ones(60)])
    front = rng.integers(6, size=60).astype(float)
    found = crowding_of(values, front)
    for one in range(60):
        own = values[front == front[one]]
        expected = 0.0
        for column in (0, 1):
            order = np.sort(own[:, column])
            place = int(np.searchsorted(order, values[one, column]))
            inside = 0 < place < len(order) - 1
            gap = order[place + 1] - order[place - 1] if inside else np.inf
            expected += gap / (order[-1] - order[0]) if len(order) > 1 else np.inf
        assert found[one] == pytest.approx(expected / 3)
    assert crowding_of(values[:0], front[:0]).shape == (0,)
    # Deb 2001, section 6.2.2: on the second front of the example, with its ends, d is more crowded than 1.
    second = np.array([PUBLISHED[name] for name in "31bd"])
    distances = dict(zip("31bd", crowding_of(second, np.zeros(4)), strict=True))
    assert distances["3"] == distances["b"] == np.inf
    assert 0.0 < distances["d"] < distances["1"] < np.inf


# Annealing: what its moves do to a labelling, and that it reaches proven optima.


WALL = [*["aaaa"] * 4, "####"]
OPTIONS = {"block_cells": [1, 3], "tension": 5e3, "shear": 5e3}
# cells that overhang a support, in blocks of two to four: few layouts balance
OVERHANG = grid_document([*["aaaaa"] * 3, "..#.."], block_cells=[2, 4], friction=0.2)


@pytest.mark.parametrize("kernel", ["", "off"])
def test_a_tower_moves_at_its_foot_alone(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rocking about the foot: λ = 1/4 there, 1/3 at the joint above (width over height of what rocks), all dry."""
    monkeypatch.setenv("JLD_KERNEL", kernel)
    assembly = build_assembly(parse_scene(grid_document(["a", "a", "a", "a", "#"])))
    moving = mechanism.Movements(LimitAnalysis(assembly)).of(np.ones((3, len(assembly.interfaces)), dtype=bool))
    feet = assembly.elements.support[assembly.interfaces.a] | assembly.elements.support[assembly.interfaces.b]
    assert moving.shape == (3, 4)
    assert moving[:, feet] == pytest.approx(1.0)
    assert moving[:, ~feet] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.long
def test_the_driver_reaches_the_proven_best(tmp_path: Path) -> None:
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    proven = explore(scene, tmp_path / "exact", ExploreSettings(driver="exact", pictures=False)).summary.facts
    settings = ExploreSettings(driver="anneal", budget=600, pictures=False, options={"chains": 8})
    found = explore(scene, tmp_path / "anneal", settings).summary.facts
    assert proven["proven"]
    assert found["best"] == pytest.approx(proven["best"], rel=2e-3)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("driver", "options"), [("anneal", {"chains": 1}), ("anneal", {"chains": 8}), ("portfolio", {})]
)
def test_a_small_space_is_left_completely_known(driver: str, options: dict[str, int], tmp_path: Path) -> None:
    """What waits in the population when changes run out is asked as well."""
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], **OPTIONS))
    every = explore(scene, tmp_path / "every", ExploreSettings(driver="enumeration", pictures=False)).summary.facts
    settings = ExploreSettings(driver=driver, pictures=False, small=0, options=options)
    found = explore(scene, tmp_path / "found", settings).summary.facts
    assert found["stop_reason"] == "exhausted"
    assert found["evaluated"] == every["evaluated"] > 50
    assert found["best"] == pytest.approx(every["best"], rel=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "options", "document"),
    [
        ("anneal", {"chains": 4}, grid_document(WALL, **OPTIONS)),
        ("portfolio", {}, grid_document(WALL, **OPTIONS)),
        ("portfolio", {}, OVERHANG),
    ],
)
def test_evaluations_decide_what_is_next_and_no_clock(
    name: str, options: dict[str, int], document: dict[str, Any]
) -> None:
    """The same seed and budget give the same rows, whatever portions answers come in and what is prepared meanwhile."""
    space = space_of(document)
    solver = Evaluator(space.assembly, EvaluatorSettings())
    asked = []
    for portion in (None, 7):
        driver, rows = DRIVERS[name](space, 3, **options), []
        while sum(map(len, rows)) < 300:
            rows.append(driver.ask(portion))
            if portion is None:
                driver.prepare()
            driver.tell(rows[-1], [solver.evaluate(labels) for labels in rows[-1]])
        asked.append(np.concatenate(rows)[:300])
    assert (asked[0] == asked[1]).all()


@pytest.mark.parametrize(
    "document", [grid_document(["aaaaaaaa", "aaaaaaaa", "#......#"], block_cells=[2, 6]), OVERHANG]
)
def test_two_jobs_give_the_table_of_one(document: dict[str, Any], tmp_path: Path) -> None:
    """The second one halves batches and decides beside them what stands, where not all layouts do."""
    tables = []
    for jobs in (1, 2):
        settings = ExploreSettings(driver="portfolio", budget=300, jobs=jobs, small=0, pictures=False, check_fields=0)
        done = explore(parse_scene(document), tmp_path / str(jobs), settings)
        tables.append(done.results.drop(columns="seconds").to_csv(index=False))
    assert tables[0] == tables[1]
    assert 0 < done.results["stands_at_zero"].sum() < len(done.results)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("aim", ["best", "front"])
def test_the_portfolio_climbs_along_a_front_without_loss(aim: str) -> None:
    """A climb at a layout of the front asks for none with fewer dry faces, and raises its value."""
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    space = search_space(scene, build_assembly(scene))
    worth, begun = np.random.default_rng(5).random((2, len(space.candidates))), {}
    driver = DRIVERS["portfolio"](space, 1, aim=aim)
    while driver._surrogate.batches_learned < 40:
        rows = driver.ask()
        for name, labels in zip(keys(rows), rows, strict=True):
            climb = driver._climbing[name][0] if name in driver._climbing else None
            if climb is not None and climb.floor is not None:
                assert values_of(count_named("dry_faces"), space.assembly, labels[None])[0] >= -climb.floor
                begun.setdefault(id(climb), (climb, climb.energy))
        value = 1.0 + np.where(rows, worth[0], 2.0 * worth[1]).sum(axis=1)
        driver.tell(rows, [Evaluation(Status.COLLAPSE, one, one, one) for one in value.tolist()])
    assert bool(begun) == (aim == "front")
    assert not begun or any(climb.energy < first for climb, first in begun.values())


def test_chains_of_the_portfolio_know_no_best_of_its_climbs() -> None:
    """Half of them begin each cycle at the best of chains and population; at that of climbs all would end alike."""
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    driver = DRIVERS["portfolio"](search_space(scene, build_assembly(scene)), 0)
    rows = driver.ask()  # a climb begins
    driver.tell(rows, [Evaluation(Status.COLLAPSE, 2.0, 2.0, 2.0) for _ in rows])
    assert driver._incumbent[0] == -2.0
    assert driver._best[1] is None


def test_half_of_the_chains_begin_every_cycle_at_the_best() -> None:
    """At the end of the greedy cycles no chain did, where more chains join."""
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    driver = DRIVERS["anneal"](search_space(scene, build_assembly(scene)), 0, chains=8)
    best = driver.operators.draw(1, driver.rng)[0]
    driver._best = (-1.0, best, 0)
    counts = []
    for _ in range(4):
        for chain in driver._chains:
            chain.labelling = None
        driver._evaluated = driver._cycle_start + driver._cycle_length
        driver._advance_cycle()
        counts.append((len(driver._chains), sum(chain.labelling is best for chain in driver._chains)))
    assert counts == [(4, 2), (8, 4), (8, 4), (8, 4)]


# A slice of the trials of brute force against proof; `python -m benchmarks.claims trials` runs two thousand.


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [1, 4, 6, 10])
def test_proven_results_equal_brute_force(seed: int) -> None:
    assert run_claim("trials", seed, 1, 600.0).disagreements == []


# The default driver: a proof begins with labellings of the genetic driver.


ROWS = ["aaaa", "aaaa", "#..#"]


@pytest.mark.usefixtures("without_pictures")
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


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("rows", "driver"), [(["a" * 8] * 6 + ["###..###"], "portfolio"), (ROWS, "exact")])
def test_the_default_driver_begins_as_the_one_it_names(rows: list[str], driver: str, tmp_path: Path) -> None:
    """It is the portfolio, whatever the jobs, or a proof that begins with labellings of the genetic driver."""
    scene = parse_scene(grid_document(rows, block_cells=[2, 4]))
    orders, names = [], []
    other = "genetic" if driver == "exact" else driver
    for name, jobs in ((None, 1), (other, 1 if driver == "exact" else 2)):
        settings = ExploreSettings(driver=name, budget=48, jobs=jobs, small=0, pictures=False, check_fields=0)
        done = explore(scene, tmp_path / str(name), settings)
        names.append(done.summary.driver)
        with closing(sqlite3.connect(done.folder / "records.sqlite3")) as file:
            orders.append(file.execute("SELECT labelling FROM evaluations ORDER BY id").fetchall())
    assert names == [driver, other]
    assert orders[0] == orders[1]
    assert len(orders[0]) > 30


@pytest.mark.parametrize(
    ("search", "options", "name"),
    [
        ({}, {"aim": "best"}, "portfolio"),
        ({}, {"population": 40}, "genetic"),
        ({"front": {"counts": ["blocks", "shapes"], "sense": ["max", "min"]}}, {}, "genetic"),
    ],
)
def test_the_portfolio_is_the_default_where_it_applies(
    search: dict[str, object], options: dict[str, object], name: str, tmp_path: Path
) -> None:
    scene = parse_scene(grid_document(["a" * 8] * 6 + ["###..###"], block_cells=[2, 4], **search))
    settings = ExploreSettings(budget=1, jobs=1, pictures=False, check_fields=0, options=options)
    assert explore(scene, tmp_path / "found", settings).summary.driver == name
