"""Only layouts that can be laid: locks speak for other labellings, drivers keep the limit, exact is brute force."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import every_layout, grid_document
from jld_core import InputError, build_assembly, parse_scene, samples, solve
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.exact.proof_check import Claim, _find_open_labelling
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.space import from_string
from jld_practice.laying import SequenceConstraint, assembly_order, locked_blocks

# what blocks that crack anywhere carry, test_field_searches.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

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
        space = search_space(bridge, assembly)
        state = ProofState(space)
        state.hand_over([from_string(text) for text in done.results["labelling"]])
        state.note_evaluated(state.take_waiting())
        problem = _find_open_labelling(space, None, [], state, [Claim(None, 0.0)])
        assert ("stopped at its limit" in problem) is not decided
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
