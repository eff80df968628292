"""Only layouts that can be laid: locks speak for other labellings, drivers keep the limit, exact is brute force."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmarks.common import random_segmentations, scene

from cases import dry_and_inner, every_layout, grid_document, standing_of
from command import Command
from jld_core import Deadline, InputError, LimitAnalysis, build_assembly, parse_scene, samples, solve
from jld_explore import Exploration, ExploreSettings, explore, read_folder, search_space
from jld_explore.drivers import make_driver
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.report import words
from jld_explore.space import from_string
from jld_practice.laying import SequenceConstraint, assembly_order, locked_blocks

# a neck that what is wider cannot pass; two that lean over one another; a lid over one end
NECK = ["#aaa#", "##a##", "#aaa#"]
HOOKS = ["aaaa", "aaaa", "####"]
LID = ["##.##", "#aaa#", "#aaa#"]
ARCH = ["#aaaa#", "#....#"]
WIDE: dict[str, Any] = {"candidates": "all+supports", "symmetry": "none", "block_cells": [1, 9]}


def scene_of(rows: list[str], *, assemble: str | None = None, friction: float = 0.75, **search: Any) -> Any:
    document = grid_document(rows, friction=friction, **{"block_cells": [1, 4], **search})
    if assemble is not None:
        document["search"]["assemble"] = assemble
    return parse_scene(document)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rows", [NECK, HOOKS, LID])
def test_a_lock_refutes_other_labellings_and_never_a_possible_one(rows: list[str]) -> None:
    scene = scene_of(rows, **WIDE)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    labellings = every_layout(space)
    labellings = labellings[np.random.default_rng(1).permutation(len(labellings))[:150]]
    alone = [not locked_blocks(assembly, labels) for labels in labellings]
    asked = SequenceConstraint(assembly, "translation", np.ones(len(assembly.interfaces), dtype=bool))
    assert asked.possible(labellings).tolist() == alone
    assert 0 < sum(alone) < len(alone)
    # what one labelling is locked by settles others
    assert len(asked.locks) < len(alone) - sum(alone) or rows is not LID
    for lock in asked.locks:
        assert set(lock.elements.tolist()) <= set(assembly.elements.free.tolist())
        assert len(lock.faces) < len(assembly.interfaces)


DOWN = [{"element": "c1r0", "force": [0, -1]}]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("rows", "assemble", "search"),
    [
        (["aaa", "aaa", "###"], "translation", WIDE),
        (["#aa", "#aa", ".##"], "translation", {**WIDE, "live": [{"body": [0, 1]}]}),
        (["aaaa", "aaaa", "#..#"], "standing", {"live": DOWN, "block_cells": [2, 3]}),
        pytest.param(["aaaa", "a..a", "#..#"], "standing", {"block_cells": [1, 3]}, marks=pytest.mark.long),
    ],
)
def test_exact_is_brute_force(rows: list[str], assemble: Any, search: dict[str, Any], tmp_path: Path) -> None:
    free = scene_of(rows, **search)
    every = explore(free, tmp_path / "free", ExploreSettings(pictures=False, driver="enumeration"))
    assembly = build_assembly(free)
    kept = set()
    for text in every.results["labelling"]:
        labels = from_string(text)
        if locked_blocks(assembly, labels):
            continue
        laying = None if assemble == "translation" else assembly_order(assembly, labels, wish="standing")
        if laying is None or (laying.possible and laying.stands):
            kept.add(text)
    assert 0 < len(kept) < len(every.results)
    ranked = every.results[every.results["labelling"].isin(kept) & (every.results["status"] == "collapse")]
    scene = scene_of(rows, assemble=assemble, **search)
    listed = explore(scene, tmp_path / "listed", ExploreSettings(pictures=False, driver="enumeration"))
    assert set(listed.results["labelling"]) == kept
    assert listed.summary.proven
    found = explore(scene, tmp_path / "exact", ExploreSettings(pictures=False, driver="exact"))
    assert found.summary.proven
    assert found.summary.best == pytest.approx(ranked["load_factor"].max(), rel=2e-6)
    assert found.summary.best_labelling in kept


@pytest.mark.sampled(2)
@pytest.mark.parametrize("driver", ["random", "genetic", "hillclimb"])
def test_every_driver_keeps_the_assembly_constraint(driver: str, tmp_path: Path) -> None:
    scene = scene_of(LID, assemble="translation", **WIDE)
    done = explore(scene, tmp_path / "out", ExploreSettings(pictures=False, driver=driver, budget=40))
    assembly = build_assembly(scene)
    assert all(not locked_blocks(assembly, from_string(text)) for text in done.results["labelling"])
    assert len(done.results) == 40


def test_a_wall_that_cannot_be_laid_in_its_plane_is_laid_from_the_side(tmp_path: Path) -> None:
    rows = ["####", "#aa#", "#aa#", "####"]
    with pytest.raises(InputError, match="no layout can be laid; expected assemble_out_of_plane"):
        explore(scene_of(rows, assemble="translation"), tmp_path / "in")
    scene = scene_of(rows, assemble="translation", assemble_out_of_plane=True)
    assert len(explore(scene, tmp_path / "out", ExploreSettings(pictures=False)).results)


def test_load_cases_do_not_matter_to_laying() -> None:
    document = grid_document(ARCH)
    document["loads"] = {
        "cases": [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [0, 1]}]}]
    }
    several, one = build_assembly(parse_scene(document)), build_assembly(parse_scene(grid_document(ARCH)))
    with_cases, without = assembly_order(several, several.labels), assembly_order(one, one.labels)
    assert [s.stage.stands for s in with_cases.steps] == [s.stage.stands for s in without.steps]


def test_a_certificate_with_an_assembly_constraint_is_refused(tmp_path: Path) -> None:
    settings = ExploreSettings(driver="exact", certificate=tmp_path / "proof.json")
    with pytest.raises(InputError, match=r"it cannot express search\.assemble"):
        explore(scene_of(ARCH, assemble="translation"), tmp_path / "out", settings)


def test_an_unknown_rule_of_assembly_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        scene_of(ARCH, assemble="sideways")
    assert str(caught.value).startswith("search.assemble") or "search.assemble" in str(caught.value)
    assert "translation" in str(caught.value)
    assert solve(build_assembly(scene_of(ARCH, assemble="standing"))).status


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("rows", "sizes"),
    [(ARCH, [1, 2]), (["aaaa", "a..a", "#..#"], [1, 3]), (["aaa", "aaa", "#.#"], [1, 2]), (HOOKS, [1, 2])],
)
def test_building_up_agrees_with_taking_apart(rows: list[str], sizes: list[int]) -> None:
    """What stands at every stage: laid from the ground with locks that speak for others, and taken apart one by one."""
    scene = scene_of(rows, assemble="standing", **{**WIDE, "candidates": "all", "block_cells": sizes})
    assembly = build_assembly(scene)
    free = scene.model_copy(update={"search": scene.search.model_copy(update={"assemble": None})})
    labellings = every_layout(search_space(free, assembly))
    labellings = labellings[np.random.default_rng(2).permutation(len(labellings))[:25]]
    asked = SequenceConstraint(assembly, "standing", np.ones(len(assembly.interfaces), dtype=bool))
    orders = [assembly_order(assembly, labels, wish="standing") for labels in labellings]
    assert asked.possible(labellings).tolist() == [bool(order.possible and order.stands) for order in orders]


@pytest.mark.long
def test_an_arch_that_needs_centring_is_refused_at_once(tmp_path: Path) -> None:
    """No voussoir past the springing stands before the arch is closed: 1 490 segmentations, none of them laid."""
    scene = samples.arch()
    search = scene.search.model_copy(update={"block_cells": [1, 4], "assemble": "standing"})
    with pytest.raises(InputError, match="assemble: no layout stands at every stage"):
        explore(scene.model_copy(update={"search": search}), tmp_path / "out", ExploreSettings(pictures=False))
    assert not (tmp_path / "out").exists()


def test_a_search_for_an_order_that_stops_at_its_limit_proves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A layout whose order was not found within the limit was called impossible to lay, and others proven strongest."""
    bridge = scene_of(["aaaa", "a..a", "#..#"], assemble="standing", block_cells=[1, 3])
    assembly = build_assembly(bridge)
    settings = ExploreSettings(pictures=False, driver="enumeration", jobs=1)
    for limit, decided in ((400, True), (0, False)):
        for module in ("order", "constraint"):
            monkeypatch.setattr(f"jld_practice.laying.{module}.MOST_STAGES", limit)
        asked = SequenceConstraint(assembly, "standing", assembly.free_faces)
        lock = asked.lock(np.ones(len(assembly.interfaces), dtype=bool))
        assert lock.proven is decided
        assert asked.undecided == (0 if decided else 1)
        assert asked.locks == [] or decided
        done = explore(bridge, tmp_path / f"some {limit}", settings)
        assert len(done.results) == 20
        assert done.summary.proven is decided
        assert any("stopped at its limit" in text for text in done.summary.warnings) is not decided
        # the check of a proof by conflicts: all that is known to stand is evaluated, and no conflict refutes the rest
        driver: Any = make_driver("exact", search_space(bridge, assembly), 0)
        rows = np.array([from_string(text) for text in done.results["labelling"]])
        driver.restore(rows, evaluator_of(assembly, EvaluatorSettings()).evaluate_all(rows))
        driver.state.hand_over(rows)
        driver.found[None] = replace(driver.found[None], bound=done.summary.best)
        assert ("stopped at its limit" in driver._checked().problem) is not decided
    with pytest.raises(InputError, match=r"no layout was found that stands at every stage .* stopped at its limit"):
        explore(scene_of(ARCH, assemble="standing", block_cells=[1, 2]), tmp_path / "none", settings)


def test_where_nothing_stands_the_first_stage_that_falls_is_named(tmp_path: Path) -> None:
    """An arch of five stones: the first past the springing falls, and needs a prop of its own weight."""
    scene = samples.arch(voussoirs=5)
    search = scene.search.model_copy(update={"block_cells": [1, 1], "assemble": "standing"})
    with pytest.raises(InputError) as caught:
        explore(scene.model_copy(update={"search": search}), tmp_path / "out", ExploreSettings(pictures=False))
    found = re.search(
        r"no layout stands at every stage without props; the one that gets farthest falls at step (\d) of (\d), "
        r"when (\S+) is laid: it needs props of (\S+) N below (\S+);",
        str(caught.value),
    )
    step, steps, stone, force, below = found.groups()
    assert (step, steps, below) == ("3", "5", stone)
    assembly = build_assembly(scene)
    weight = float(np.linalg.norm(assembly.elements.weight[assembly.elements.ids.index(stone)]))
    assert float(force) == pytest.approx(weight, rel=1e-3)


# Layouts that fall under their dead load alone rank after those that stand, and are called so everywhere.


DRIVERS = ("enumeration", "random", "hillclimb", "anneal", "genetic", "portfolio", "optuna", "exact")


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


@pytest.mark.sampled(2)
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
    assert "ranked last" in words.facts_of_exploration(done)
    front = pd.read_csv(tmp_path / "out" / "pareto.csv")
    assert front["stands_at_zero"].all()
    if done.summary.proven:
        assert done.summary.bound == pytest.approx(best, rel=1e-5)
        assert done.summary.facts.get("proof_check", {"passed": True})["passed"]


@pytest.mark.parametrize("driver", ["enumeration", "exact", "genetic"])
def test_nothing_stands(driver: str, tmp_path: Path) -> None:
    done = found_by(driver, slope(1e3, "all"), tmp_path)
    assert done.summary.best == pytest.approx(4.0, rel=1e-6)
    assert done.summary.stands_at_zero is False
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert said["stands_at_zero"] is False
    assert "falls under its own weight" in words.facts_of_exploration(done)["best λ"]
    assert "falls" in repr(done)
    assert not done.results["stands_at_zero"].fillna(True).any()
    assert repr(read_folder(tmp_path / "out")) == repr(done)


def test_a_resumed_search_ranks_alike(tmp_path: Path) -> None:
    first = found_by("exact", slope(19620.0), tmp_path)
    again = found_by("exact", slope(19620.0), tmp_path, resume=True)
    assert again.results["labelling"].tolist() == first.results["labelling"].tolist()
    assert again.summary.best == first.summary.best


def test_a_required_load_factor_is_not_met_by_what_falls(tmp_path: Path) -> None:
    document = slope(19620.0)
    document["search"]["require"] = {"load_factor": 3.9}
    for driver in ("enumeration", "exact"):
        done = found_by(driver, document, tmp_path / driver)
        assert not done.results["meets"].any()
        assert done.summary.facts["require"]["best"] is None


def test_cells_and_cases(tmp_path: Path) -> None:
    document = slope(19620.0)
    live = document["loads"].pop("live")
    document["loads"]["cases"] = [{"name": "push", "live": live}, {"name": "more", "live": live, "required": 2}]
    done = found_by("exact", document, tmp_path)
    best = max(load for load, stands in alone(document).values() if stands)
    assert done.summary.best == pytest.approx(best, rel=1e-6)
    assert done.summary.stands_at_zero is True


def test_whether_a_layout_stands_is_not_begun_where_it_would_be_late() -> None:
    """Of a wall of 9 660 faces it took 5 s, so that a search of 8 s ended after 13.7 s."""
    assembly = build_assembly(parse_scene(grid_document(["ab", "##"])))
    labels = assembly.labels[None]
    assert np.isnan(standing_of(assembly, labels, None, Deadline(60.0), solved_in=30.0)).all()
    assert standing_of(assembly, labels, None, Deadline(600.0), solved_in=30.0).tolist() == [1.0]


def test_what_is_dry_in_any_layout_is_proven_to_stand_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The state of a weak wall with all faces dry settles few layouts; it was sought anew for each batch of others."""
    document = grid_document(["aaaa"] * 5 + ["####"], tension=1e3, shear=10.0, block_cells=[1, 3])
    kind = type(LimitAnalysis(build_assembly(parse_scene(document))).repair)
    prove, proven = kind.proof_at_zero, [0]

    def counted(*given: Any) -> Any:
        proven[0] += 1
        return prove(*given)

    monkeypatch.setattr(kind, "proof_at_zero", counted)
    done = explore(parse_scene(document), tmp_path, driver="genetic", budget=600, jobs=1, pictures=False)
    assert done.results["stands_at_zero"].all()
    assert proven[0] < 3


def test_many_layouts_of_an_arch_equal_a_solve_of_each(tmp_path: Path) -> None:
    """So many different states are needed that most answers come from bounds in both directions of the live load."""
    assembly = scene("flat_beam_arch")
    labellings = random_segmentations(assembly, 80, seed=3)
    alone = [solve(assembly, labels) for labels in labellings]
    expected = [float(one.stands_at_zero) for one in alone]
    low = np.array([one.bracket[0] for one in alone])
    assert 10 < sum(expected) < 70
    assert standing_of(assembly, labellings, low).tolist() == expected
    assert standing_of(assembly, np.concatenate([labellings, labellings])).tolist() == 2 * expected
    assert standing_of(assembly, labellings[::-1]).tolist() == expected[::-1]


def test_printed(jld: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(slope(1e3, "all")))
    done = jld("explore", tmp_path / "scene.json", "-o", tmp_path / "out", "--check-fields", "0").done()
    assert "falls under its own weight" in done.out
    assert "proven strongest" not in done.out
