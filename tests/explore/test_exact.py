"""The exact driver against enumeration: the best and the whole front, and what it says when it is stopped."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Callable
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import DOWN, box, canonical, every_layout, grid_document, replace_processes
from cases import scene_in_space as scene
from jld_core import LimitAnalysis, Scene, SolveOptions, Status, build_assembly, parse_scene
from jld_explore import Evaluation, Exploration, ExploreSettings, SearchSpace, explore, search_space
from jld_explore.drivers import DRIVERS, make_driver
from jld_explore.evaluation import Records
from jld_explore.space import count_named, feasible, values_of
from jld_explore.verification import verify
from proofs import formula_of

SCENES: dict[str, tuple[list[str], dict[str, Any]]] = {
    "pairs": (["aaa", "aaa", "###"], {"block_cells": [1, 2]}),
    "weak": (["aaaa", "aaaa", "####"], {"tension": 2e3, "shear": 2e3, "block_cells": [1, 3]}),
    "strong": (["aaa", "aaa", "###"], {"tension": 2e5, "shear": 2e5, "block_cells": [1, 4]}),
    "no limit": (["aaa", "aaa", "###"], {"tension": 5e3, "shear": 5e3}),
    "equal blocks": (["aaaa", "aaaa", "####"], {"block_cells": [2, 2]}),
    "counts": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "blocks": [3, 4], "dry_faces": [4, 6]}),
    "extent": (["aaa", "aaa", "###"], {"block_extent": [None, 0.2], "tension": 5e3, "shear": 8e3}),
    "cells too large unless exempt": (
        ["aaa", "aaa", "###"],
        {"block_extent": [None, 0.05], "except": ["c0r0", "c2r1"], "tension": 5e3, "shear": 8e3},
    ),
    "kept": (
        ["aaa", "aaa", "###"],
        {"block_cells": [1, 3], "keep": {"dry": [["c0r0", "c1r0"]], "inner": [["c1r1", "c2r1"]]}},
    ),
    "bridge": (["aaaa", "a..a", "#..#"], {"live": DOWN, "block_cells": [1, 3], "shear": 2e5, "tension": 2e5}),
    "mortar": (["aaa", "aaa", "###"], {"cohesion": 1e3, "tension": 5e3, "shear": 5e3, "friction": 0.4}),
    "rough cracks": (
        ["aaa", "aaa", "###"],
        {"block_cells": [1, 3], "inner_friction": 0.9, "cohesion": 5e2, "tension": 2e3, "shear": 3e3, "friction": 0.5},
    ),
    "crushing blocks": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "crush_inner": 1e5}),
}


FEW = ("weak", "kept", "bridge", "rough cracks")
"""Scenes with each way of proof; the others, which `test_exact_proves_the_same_as_enumeration` has, in `make bench`."""
ONE_BY_ONE = [name if name in FEW else pytest.param(name, marks=pytest.mark.long) for name in SCENES]

OWN = ("aim", "search", "by_blocks", "list_blocks", "step_after", "programs")


def search(rows: list[str], options: dict[str, Any], folder: Path, driver: str, **settings: Any) -> Exploration:
    scene = parse_scene(grid_document(rows, **options))
    own = {name: settings.pop(name) for name in OWN if name in settings}
    if own.keys() <= {"aim"}:
        return explore(scene, folder, ExploreSettings(pictures=False, driver=driver, options=own, **settings))
    space = search_space(scene, build_assembly(scene))
    return explore(scene, folder, ExploreSettings(pictures=False, **settings), driver=DRIVERS["exact"](space, **own))


Enumerated = Callable[[list[str], dict[str, Any]], Exploration]


@pytest.fixture(scope="module")
def enumerated(tmp_path_factory: pytest.TempPathFactory) -> Enumerated:
    """Enumerate the layouts of a scene, once for all tests."""
    known: dict[str, Exploration] = {}

    def found(rows: list[str], options: dict[str, Any]) -> Exploration:
        key = json.dumps([rows, options])
        if key not in known:
            known[key] = search(rows, options, tmp_path_factory.mktemp("enumerated") / "every", "enumeration")
        return known[key]

    return found


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCENES)
def test_exact_proves_the_same_as_enumeration(name: str, tmp_path: Path, enumerated: Enumerated) -> None:
    rows, options = SCENES[name]
    every = enumerated(rows, options)
    found = search(rows, options, tmp_path / "exact", "exact", aim="front")
    best = every.summary.best
    assert found.summary.stop_reason == "proven"
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(best, rel=1e-6)
    assert best <= found.summary.bound * (1.0 + 1e-6)
    assert found.summary.bound <= best * (1.0 + 2e-6)
    table = every.results[every.results["status"] == "collapse"]
    known = table.groupby("dry_faces")["load_factor"].max()
    proven = {row["count"]: row for row in found.summary.facts["best_by_count"]}
    assert sorted(proven) == sorted(known.index)
    for count, value in known.items():
        assert proven[count]["proven"]
        assert proven[count]["load_factor"] == pytest.approx(value, rel=1e-6, abs=1e-6)
        assert proven[count]["bound"] >= value * (1.0 - 1e-6)


@pytest.mark.parametrize(
    ("rows", "options"),
    [
        (["aa", "aa", "##"], {"candidates": "all+supports"}),
        (["aa", "aa", "##"], {"segmentation": False}),
        (["aaa", "###"], {"crush_dry": 1e5}),
        (["#aaa#"], {"live": [{"element": "c2r0", "force": [0, -1]}]}),
    ],
    ids=["supports", "slits", "crushing joints", "confined"],
)
def test_spaces_of_other_kinds(rows: list[str], options: dict[str, Any], tmp_path: Path) -> None:
    every = search(rows, options, tmp_path / "every", "enumeration")
    found = search(rows, options, tmp_path / "exact", "exact")
    assert found.summary.proven is True
    assert found.summary.best == every.summary.best
    assert found.summary.unbounded == every.summary.unbounded
    assert found.summary.unbounded or found.summary.bound >= found.summary.best
    assert (found.summary.bound is None) == (every.summary.bound is None) == found.summary.unbounded


def test_the_bound_of_layouts_that_all_fall_is_that_of_their_best(tmp_path: Path) -> None:
    """A leaning stack that the live load holds: none stands at 0, and the strongest is proven, with a certificate."""
    outlines = [[[k, k], [k + 1, k], [k + 2, k + 1], [k + 1, k + 1]] for k in range(2)]
    document = {
        **grid_document(["aa", "##"], friction=3.0, tension=100.0, shear=1e4, candidates="all+supports"),
        "elements": [
            {"id": "g", "support": True, "polygon": [[0, -1], [1, -1], [1, 0], [0, 0]]},
            *({"id": f"s{k}", "polygon": outline} for k, outline in enumerate(outlines)),
        ],
        "loads": {"live": [{"element": "s1", "force": [-1000, 0], "at": [2, 2]}]},
    }
    del document["grid"]
    proof = tmp_path / "proof"
    settings: dict[str, Any] = {"pictures": False, "driver": "exact", "certificate": proof}
    found = explore(parse_scene(document), tmp_path / "out", **settings).summary
    assert (found.proven, found.facts["stands_at_zero"]) == (True, False)
    assert found.bound == pytest.approx(found.best, rel=1e-6)
    assert verify(proof).claim.bound >= found.best


def _boxes(size: tuple[int, int, int], **materials: Any) -> dict[str, Any]:
    """A spatial block of unit cells on one support."""
    nx, ny, nz = size
    cells = [
        box(f"{i}{j}{k}", [i, j, k], [i + 1, j + 1, k + 1])
        for i, j, k in itertools.product(range(nx), range(ny), range(nz))
    ]
    return scene([box("ground", [0, 0, -1], [nx, ny, 0], support=True), *cells], materials=materials)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("size", "limits", "inner"),
    [
        ((2, 1, 3), {"block_cells": [1, 2]}, {"tensile_strength": 0.5, "shear_strength": 0.8}),
        ((2, 2, 2), {"block_cells": [1, 3]}, {"tensile_strength": 0.1, "shear_strength": 0.1}),
        ((3, 1, 2), {"block_cells": [2, 4]}, {"tensile_strength": 5.0, "shear_strength": 5.0}),
        (
            (2, 1, 2),
            {"block_cells": [1, 2]},
            {"tensile_strength": 0.5, "shear_strength": 0.8, "compressive_strength": 4},
        ),
    ],
)
def test_exact_proves_the_same_as_enumeration_in_space(
    size: tuple[int, int, int], limits: dict[str, Any], inner: dict[str, Any], tmp_path: Path
) -> None:
    crush = {key: value for key, value in inner.items() if key == "compressive_strength"}
    dry = {"friction_coefficient": 0.7, **crush}
    document = {**_boxes(size, inner=inner, dry=dry), "search": limits}
    every = explore(parse_scene(document), tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    found = explore(
        parse_scene(document),
        tmp_path / "exact",
        ExploreSettings(pictures=False, driver="exact", options={"aim": "front"}),
    )
    table = every.results[every.results["status"] == "collapse"]
    known = table.groupby("dry_faces")["load_factor"].max()
    proven = {row["count"]: row for row in found.summary.facts["best_by_count"]}
    assert found.summary.proven is True
    assert found.summary.facts["conflicts"] > 0
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    assert sorted(proven) == sorted(known.index)
    for count, value in known.items():
        assert proven[count]["load_factor"] == pytest.approx(value, rel=1e-6, abs=1e-6)


WAYS: dict[str, dict[str, Any]] = {
    "blocks are not listed": {"list_blocks": False},
    "the proof alone": {"aim": "front", "search": 0},
    "the bound in steps": {"aim": "front", "step_after": 2},
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ONE_BY_ONE)
def test_every_way_of_a_proof_finds_the_best(name: str, way: str, tmp_path: Path, enumerated: Enumerated) -> None:
    rows, options = SCENES[name]
    if "blocks" in options and "list_blocks" in WAYS[way]:
        pytest.skip("blocks are counted where they are listed")
    every = enumerated(rows, options)
    found = search(rows, options, tmp_path / "exact", "exact", **WAYS[way])
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)


def test_long_structures_are_refuted_window_by_window(tmp_path: Path) -> None:
    rows, options = ["aaaaa", "aaaaa", "#...#"], {"live": DOWN, "block_cells": [1, 3], "shear": 5e4, "tension": 5e4}
    every = search(rows, options, tmp_path / "every", "enumeration")
    found = search(rows, options, tmp_path / "exact", "exact", list_blocks=False)
    assert found.summary.facts["conflicts"] > 0
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [*SCENES, "bridge"])
@pytest.mark.parametrize("listed", [True, False])
def test_formulas_have_the_space_for_models(name: str, listed: bool) -> None:
    rows, options = SCENES[name]
    scene = parse_scene(grid_document(rows[-3:], **options))
    space = search_space(scene, build_assembly(scene))
    if not listed and space.search.blocks != [None, None]:
        pytest.skip("blocks are counted where they are listed")
    formula = formula_of(space, listed=listed)
    found = set()
    every = np.arange(len(space.fixed))
    while (labels := formula.next()) is not None:
        assert feasible(space, labels[None])[0]
        found.add(np.asarray(canonical(labels[None], space.group)[0]).tobytes())
        formula.forbid(every, labels)
    assert len(found) == make_driver("enumeration", space, 0).count().classes


def test_a_stopped_proof_reports_its_gap_and_continues(tmp_path: Path) -> None:
    rows, options = [*["aaaa"] * 4, "####"], {"block_cells": [1, 2], "tension": 5e3, "shear": 5e3}
    # conflicts of faces alone
    first = search(rows, options, tmp_path, "exact", by_blocks="off", programs=60)
    assert first.summary.stop_reason in ("time", "proven")
    assert first.summary.bound >= first.summary.best * (1.0 - 1e-9)
    last = search(rows, options, tmp_path, "exact", by_blocks="off", resume=True)
    assert last.summary.stop_reason == "proven"
    assert first.summary.facts["conflicts"] > 0
    assert last.summary.facts["conflicts"] > first.summary.facts["conflicts"]
    assert last.summary.bound <= first.summary.bound * (1.0 + 1e-9)
    assert last.summary.gap <= 1e-6
    assert np.isclose(last.summary.best, max(last.summary.best, first.summary.best))


def test_without_dilation_the_associative_optimum_bounds_what_was_found(tmp_path: Path) -> None:
    rows, options = ["aaa", "aaa", "###"], {"block_cells": [1, 3], "tension": 5e3, "shear": 5e3}
    every = search(rows, options, tmp_path / "every", "enumeration", model=SolveOptions(friction="zero-dilation"))
    found = search(rows, options, tmp_path / "exact", "exact", model=SolveOptions(friction="zero-dilation"))
    table = every.results[every.results["status"] == "collapse"]
    # proven only where friction without dilation costs the best nothing
    assert found.summary.proven is (found.summary.gap <= 1e-6)
    assert found.summary.classes is None or found.summary.classes >= found.summary.evaluated
    assert found.summary.best == pytest.approx(table["load_factor_zero_dilation"].max(), rel=1e-6)
    assert found.summary.bound >= table["load_factor_zero_dilation"].max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("rows", "cell", "options"),
    [
        (["aaa"] * 3 + ["###"], [0.2, 0.1], {"friction": 3.0, "tension": 0.0, "shear": 0.0}),
        (["aaa"] * 3 + ["###"], [0.2, 0.1], {"friction": 0.75, "tension": 0.0, "shear": 0.0}),
        (
            [".aa", ".aa", ".##"],
            [0.1, 0.2],
            {"friction": 1.5, "tension": 0.0, "shear": 0.0, "crush_inner": 1e4, "live": [{"body": [1, 1]}]},
        ),
    ],
)
def test_faces_no_block_contains_are_dry_in_every_bound(
    rows: list[str], cell: list[float], options: dict[str, Any], tmp_path: Path
) -> None:
    """The limit on extent leaves faces across which no block can reach; the scene's own label there is inner."""
    document = grid_document(rows, **options, block_extent=[None, 0.2])
    document["grid"]["cell"] = cell
    scene = parse_scene(document)
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration")).summary.facts
    alone = DRIVERS["exact"](search_space(scene, build_assembly(scene)), search=0)  # the proof alone finds it
    found = explore(scene, tmp_path / "exact", ExploreSettings(pictures=False), driver=alone).summary.facts
    assert found["proven"] is True
    assert found["best"] == pytest.approx(every["best"], rel=1e-6)
    assert found["bound"] >= every["best"] * (1.0 - 1e-9)


TREES = [*SCENES, "very strong", "no friction", "overhang"]
BEGUN = (next(iter(SCENES)), "very strong", "no friction", "overhang")


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("name", "searched"),
    [
        *((name, 0) for name in TREES),
        # a search before the tree gives it a target to begin with
        *((name, 10) if name in BEGUN else pytest.param(name, 10, marks=pytest.mark.long) for name in TREES),
    ],
)
def test_the_tree_of_blocks_proves_the_optimum(
    name: str, searched: int, tmp_path: Path, enumerated: Enumerated
) -> None:
    rows, options = {
        **SCENES,
        # bounds are too blunt there, and the tree is given up
        "very strong": (["aaa", "aaa", "###"], {"tension": 1e9, "shear": 1e9, "block_cells": [1, 3]}),
        "no friction": (["aaa", "aaa", "###"], {"friction": 0.0, "block_cells": [1, 3]}),
        "overhang": (["aaa", "aa.", "#.."], {"block_cells": [1, 3], "live": [{"body": [-1, 1]}]}),
    }[name]
    every = enumerated(rows, options).summary.facts
    # a tree wherever there is a relaxation by blocks
    found = search(rows, options, tmp_path / "exact", "exact", search=searched, by_blocks="on").summary.facts
    assert found["proven"] is True
    if every["best"] is None:
        assert found["best"] is None
        return
    assert found["best"] == pytest.approx(every["best"], rel=1e-6, abs=1e-9)
    assert found["bound"] >= every["best"] - 1e-6 * abs(every["best"]) - 1e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("across", "limits"),
    [
        (3, {"dry_faces": [10, None]}),
        (3, {"blocks": [6, None]}),
        pytest.param(4, {"dry_faces": [13, None]}, marks=pytest.mark.long),
    ],
)
def test_the_tree_offers_nothing_outside_the_limits_on_counts(
    across: int, limits: dict[str, Any], tmp_path: Path
) -> None:
    # the tree knows nothing of counts: of its leaves only those in the space may be evaluated
    rows = [*["a" * across] * 3, "#" * across]
    options = {"tension": 2e3, "shear": 2e3, "block_cells": [1, 2], **limits}
    every = search(rows, options, tmp_path / "every", "enumeration").summary.facts
    found = search(rows, options, tmp_path / "exact", "exact", by_blocks="on").summary.facts
    assert found["proven"] is True
    assert found["best"] == pytest.approx(every["best"], rel=1e-6)
    assert found["bound"] >= every["best"] * (1.0 - 1e-9)
    assert found["evaluated"] <= every["evaluated"]


def test_conflicts_are_taken_back_at_the_threshold_they_were_made_at(tmp_path: Path) -> None:
    """A threshold over the scale of a scene three cells wide, times that scale, is often more than the threshold."""
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 2]))
    space = search_space(scene, build_assembly(scene))
    faces, labels = np.flatnonzero(space.candidates)[:2], np.array([False, True])
    decided, values = np.zeros((2, len(space.fixed)), dtype=bool)
    decided[faces], values[faces] = True, labels
    images = np.argsort(space.group, axis=1)[:, faces]
    known = every_layout(space)[:1]
    scale = LimitAnalysis(space.assembly).template.scaling.load
    for number, best in enumerate((1e-3 * np.random.default_rng(4).random(10)).tolist()):
        records = Records(tmp_path / str(number), {}, len(space.fixed))
        DRIVERS["exact"](space, search=0).start(None, lambda: None, records)
        driver = DRIVERS["exact"](space, search=0)
        driver.restore(known, [Evaluation(Status.COLLAPSE, best, best, best)])
        records.add_conflicts(decided[None], values[None], [driver.least(None) / scale], [0])
        driver.start(None, lambda: None, records)
        row = driver.ask()
        assert len(row) == 1
        assert not any((row[0, image] == labels).all() for image in images)
        records.close()


def test_a_tree_that_was_stopped_goes_on(tmp_path: Path) -> None:
    rows, options = [*["aaaa"] * 3, "####"], {"block_cells": [1, 2]}
    whole = search(rows, options, tmp_path / "whole", "exact", by_blocks="on").summary.facts
    folder = tmp_path / "part"
    part = search(rows, options, folder, "exact", by_blocks="on", programs=2).summary.facts
    assert part["proven"] is False
    assert part["bound"] >= whole["best"] * (1.0 - 1e-9)
    rest = search(rows, options, folder, "exact", by_blocks="on", resume=True).summary.facts
    assert rest["proven"] is True
    assert rest["best"] == pytest.approx(whole["best"], rel=1e-9)


def test_the_block_relaxation_bounds_the_root() -> None:
    """Walls of blocks of two: 0.75 = µ face by face, less where a block is one body; the optimum is below either."""
    options = {"block_cells": [1, 2], "tension": 2e4, "shear": 2e4, "friction": 0.75}
    scene = parse_scene(grid_document(["aaaa"] * 5 + ["####"], **options))
    space, bounds = search_space(scene, build_assembly(scene)), []
    for by_blocks in ("auto", "off"):
        driver = DRIVERS["exact"](space, search=0, programs=1, by_blocks=by_blocks)
        driver.start(None, lambda: None)
        driver.ask()
        assert driver.bound is not None
        bounds.append(driver.bound)
    best = 0.6644093  # benchmarks/results/exact.md
    assert best < bounds[0] < 0.72 < bounds[1] == pytest.approx(0.75, rel=1e-6)


def test_a_front_that_was_enumerated_is_reported(tmp_path: Path) -> None:
    rows, options = ["aaa", "###"], {"segmentation": False, "front": {"count": "blocks", "sense": "min"}}
    every = search(rows, options, tmp_path / "every", "enumeration")
    found = search(rows, options, tmp_path / "exact", "exact", aim="front")
    table = every.results[every.results["status"] == "collapse"]
    known = table.groupby("blocks")["load_factor"].max()
    assert {row["count"]: row["load_factor"] for row in found.summary.facts["best_by_count"]} == pytest.approx(
        known.to_dict()
    )
    assert all(row["proven"] for row in found.summary.facts["best_by_count"])


def test_the_exact_driver_keeps_the_budget(tmp_path: Path) -> None:
    """Labellings that nothing refutes come up several at a time; a budget is kept all the same."""
    rows, options = SCENES["weak"]
    for budget in (1, 4, 9):
        found = search(rows, options, tmp_path / str(budget), "exact", search=0, budget=budget)
        assert found.summary.evaluated <= budget


def test_annealing_has_its_turn_beside_the_proof(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However often and early the search is resumed, the optimum and its proof are the same."""
    rows, options = [*["aaaa"] * 3, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]}
    whole = search(rows, options, tmp_path / "whole", "exact").summary.facts
    monkeypatch.setattr("jld_explore.drivers.exact.context._FIRST_INTERVAL", 20)
    monkeypatch.setattr("jld_explore.drivers.exact.context._LABELLINGS_PER_RELAXATION", (0.5, 0.5))
    found = search(rows, options, tmp_path / "often", "exact", search=1).summary.facts
    assert found["proven"] is True
    assert found["best"] == pytest.approx(whole["best"], rel=1e-6)


# One formula for a whole proof: what it is aimed at, and what holds above some λ alone.


def space_of(count: str, **limits: Any) -> SearchSpace:
    options = {"block_cells": [1, 3], "front": {"count": count}, "dry_faces": [4, 6], **limits}
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], **options))
    return search_space(scene, build_assembly(scene))


def range_of(count: str, *ends: int | None) -> Any:
    """Bounds of a count as the limits of a space state them."""
    limits = space_of(count, **{count: list(ends)}).limits
    return next(bounds for one, bounds in limits.on_counts if one.name == count)


def left(formula: Any) -> list[np.ndarray]:
    """All labellings that are left, up to symmetry, each set aside once found."""
    rows: list[np.ndarray] = []
    while (labels := formula.next()) is not None:
        rows.append(labels)
        formula.set_aside(np.arange(len(labels)), labels)
    return rows


@pytest.mark.parametrize("count", ["dry_faces", "blocks"])
def test_a_formula_is_aimed_at_one_count_after_the_other(count: str) -> None:
    space = space_of(count)
    every = every_layout(space)
    expected = Counter(values_of(count_named(count), space.assembly, every, space.graph).tolist())
    assert len(expected) >= 3
    formula = formula_of(space)
    assert len(left(formula)) == len(every)
    for wanted in (*sorted(expected), min(expected), 0, 100):
        formula.aim(0.0, wanted)
        found = left(formula)
        assert len(found) == expected[wanted]
        assert not formula.possible((), ())
    below = min(expected) + 1
    for bounds, number in (
        (range_of(count, None, below), sum(expected[value] for value in expected if value <= below)),
        (range_of(count, below, None), sum(expected[value] for value in expected if value >= below)),
    ):
        formula.aim(0.0, bounds)
        assert len(left(formula)) == number
    formula.aim(0.0)
    assert len(left(formula)) == len(every)


def test_conflicts_hold_above_their_bounds_in_whatever_order_these_are_aimed_at() -> None:
    space = space_of("dry_faces")
    formula = formula_of(space)
    rows = left(formula)
    everywhere = np.arange(len(space.fixed))
    bounds = np.random.default_rng(0).permutation(len(rows)).astype(float)
    told = len(rows) // 2
    for place, (labels, bound) in enumerate(zip(rows, bounds, strict=True)):
        if place == told:
            # half of them are there before anything is aimed at, the others come in between
            formula.aim(bounds[:told].mean())
        formula.forbid(everywhere, labels, bound)
    for threshold in (-1.0, len(rows) / 2, 3.5, 7.0, len(rows) / 4, 7.0, 1e3, 0.0, 6.5):
        formula.aim(threshold)
        assert len(left(formula)) == (bounds > threshold).sum()
        formula.raise_threshold(threshold - 1.0)
        assert not formula.possible((), ())
    # nothing that was set aside comes back where only the threshold rises
    formula.aim(3.0)
    labels = formula.next()
    assert labels is not None
    formula.set_aside(everywhere, labels)
    formula.raise_threshold(5.0)
    place = next(place for place, row in enumerate(rows) if (row == labels).all())
    assert len(left(formula)) == (bounds > 5.0).sum() - (bounds[place] > 5.0)
    # a conflict found anew with a smaller bound holds lower down too
    highest = int(bounds.argmax())
    formula.aim(len(rows) - 1.5)
    assert len(left(formula)) == 1
    formula.forbid(everywhere, rows[highest], 2.0)
    formula.aim(len(rows) - 1.5)
    assert left(formula) == []


# A proof that lasts asks the relaxation by blocks: the same optimum, and nothing ruled out is better than it says.


WEAK: dict[str, Any] = {"tension": 2e3, "shear": 2e3, "block_cells": [1, 3]}
WINDS = {"loads": {"cases": [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [-1, 0]}]}]}}


def scenes() -> dict[str, Scene]:
    weak = grid_document(["aaa", "aaa", "###"], **WEAK)
    return {
        "weak": parse_scene(weak),
        "cases": parse_scene(weak | WINDS),
        "crushing": parse_scene(grid_document(["aaa", "aaa", "###"], **WEAK, crush_dry=5e4, crush_inner=1e5)),
        "in space": parse_scene(_cubes()),
    }


def _cubes() -> dict[str, Any]:
    """Two by two by two cubes on a slab, in blocks of up to two."""
    document = grid_document(["a"], tension=2e3, shear=2e3, live=[{"body": [1, 0.3, 0]}], block_cells=[1, 2])
    del document["grid"]
    places = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    boxes = {f"c{x}{y}{z}": ([0.1 * x, 0.1 * y, 0.1 * z], 0.1, 0.1) for x, y, z in places}
    boxes["base"] = ([0.0, 0.0, -0.1], 0.2, 0.1)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    elements = []
    for name, (low, wide, high) in boxes.items():
        size = (wide, wide, high)
        corners = [[low[axis] + size[axis] * (k >> axis & 1) for axis in range(3)] for k in range(8)]
        elements.append({"id": name, "support": name == "base", "vertices": corners, "faces": faces})
    return {**document, "elements": elements}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["weak", "cases", "crushing", "in space"])
def test_what_blocks_rule_out_is_no_better_and_the_optimum_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scenes()[name]
    space = search_space(scene, build_assembly(scene))
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._RELAXATIONS", (0.0, 0.0))
    monkeypatch.setattr("jld_explore.drivers.exact.block_tree._BLOCKS_PER_ELEMENT", 0)  # no tree
    driver = DRIVERS["exact"](space, search=0)
    found = explore(scene, tmp_path / "found", ExploreSettings(pictures=False, small=0), driver=driver)
    assert driver._tightening.solves + driver.block_search.solves > 0
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    table = every.results[every.results["status"] == "collapse"]
    for text, load in zip(table["labelling"], table["bracket_lo"], strict=True):
        for image in np.array([letter == "d" for letter in text])[space.group]:
            for one in driver.state.conflicts:
                if (image[one.faces] == one.labels).all():
                    assert load <= one.bound * driver._scale * (1.0 + 1e-9)


@pytest.mark.parametrize("late", [False, True])
def test_a_long_program_is_solved_elsewhere_and_given_up_in_time(late: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    replace_processes(monkeypatch)
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._DEADLINE_CHECK_SECONDS", 0.0)
    scene = scenes()["in space"]
    space = search_space(scene, build_assembly(scene))
    found = []
    for here in (10**9, 0):
        monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._SIDES_HERE", here)
        answers = chain([False], repeat(here == 0 and late))
        found.append(DRIVERS["exact"](space)._tightening.tighten(0.1, 1e3, math.inf, answers.__next__))
    if late:
        assert found[1].bound == 1e3
    else:
        assert found[1].bound == found[0].bound < 1e3
