"""Annealing: what its moves do to a labelling, and that it reaches proven optima."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases import grid_document
from jld_core import LimitAnalysis, build_assembly, parse_scene
from jld_core.limit.movements import Movements
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import BufferedRandom, operators
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.operators.following import Following
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.protocol import Evaluator
from jld_explore.space.search_space import feasible

WALL = [*["aaaa"] * 4, "####"]
OPTIONS = {"block_cells": [1, 3], "tension": 5e3, "shear": 5e3}


@pytest.mark.parametrize("kernel", ["", "off"])
def test_a_tower_moves_at_its_foot_alone(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rocking about the foot: λ = 1/4 there, 1/3 at the joint above (width over height of what rocks), all dry."""
    monkeypatch.setenv("JLD_KERNEL", kernel)
    assembly = build_assembly(parse_scene(grid_document(["a", "a", "a", "a", "#"])))
    moving = Movements(LimitAnalysis(assembly)).of(np.ones((3, len(assembly.interfaces)), dtype=bool))
    feet = assembly.elements.support[assembly.interfaces.a] | assembly.elements.support[assembly.interfaces.b]
    assert moving.shape == (3, 4)
    assert moving[:, feet] == pytest.approx(1.0)
    assert moving[:, ~feet] == pytest.approx(0.0, abs=1e-4)


def test_a_face_that_moves_is_joined() -> None:
    assembly = build_assembly(parse_scene(grid_document(WALL, **OPTIONS)))
    space = search_space(parse_scene(grid_document(WALL, **OPTIONS)), assembly)
    moves, rng = operators(space), BufferedRandom(np.random.default_rng(1))
    follow = Following(space, moves)
    rows = moves.draw(40, rng)
    joined = 0
    for labels in rows:
        faces = np.flatnonzero(labels & space.candidates)
        moving = np.zeros((1, len(labels)))
        moving[0, faces[0]] = 1.0
        child, of = follow.changes(labels[None], follow.parts(labels[None]), moving, rng)
        assert feasible(space, child).all()
        assert of.tolist() == [0] * len(child)
        joined += int((~child[:, faces[0]]).sum())
    assert joined > 20


@pytest.mark.long
def test_the_driver_reaches_the_proven_best(tmp_path: Path) -> None:
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    proven = explore(scene, tmp_path / "exact", ExploreSettings(driver="exact", pictures=False)).summary.facts
    settings = ExploreSettings(driver="anneal", budget=600, pictures=False, options={"chains": 8})
    found = explore(scene, tmp_path / "anneal", settings).summary.facts
    assert proven["proven"]
    assert found["best"] == pytest.approx(proven["best"], rel=2e-3)


@pytest.mark.parametrize("chains", [1, 8])
def test_a_small_space_is_left_completely_known(chains: int, tmp_path: Path) -> None:
    """What waits in the population when changes run out is asked as well."""
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], **OPTIONS))
    every = explore(scene, tmp_path / "every", ExploreSettings(driver="enumeration", pictures=False)).summary.facts
    settings = ExploreSettings(driver="anneal", pictures=False, small=0, options={"chains": chains})
    found = explore(scene, tmp_path / "anneal", settings).summary.facts
    assert found["stop_reason"] == "exhausted"
    assert found["evaluated"] == every["evaluated"] > 50
    assert found["best"] == pytest.approx(every["best"], rel=1e-6)


def test_evaluations_decide_what_is_next_and_no_clock() -> None:
    """The same seed and budget give the same rows, whatever the portions that answers come in."""
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    space = search_space(scene, build_assembly(scene))
    solver = Evaluator(space.assembly, EvaluatorSettings())
    asked = []
    for portion in (None, 7):
        driver, rows = Anneal(space, 3, chains=4), []
        while sum(map(len, rows)) < 300:
            rows.append(driver.ask(portion))
            driver.tell(rows[-1], [solver.evaluate(labels) for labels in rows[-1]])
        asked.append(np.concatenate(rows)[:300])
    assert (asked[0] == asked[1]).all()


def test_half_of_the_chains_begin_every_cycle_at_the_best() -> None:
    """At the end of the greedy cycles no chain did, where more chains join."""
    scene = parse_scene(grid_document(WALL, **OPTIONS))
    driver = Anneal(search_space(scene, build_assembly(scene)), 0, chains=8)
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
