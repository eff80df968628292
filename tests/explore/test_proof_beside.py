"""The proof in a process beside a search: the bound over all possible blocks, then the exact driver."""

from __future__ import annotations

from pathlib import Path

import pytest

from jld_core import Deadline, Scene, SolveOptions, build_assembly, parse_scene
from jld_explore import explore, search_space
from jld_explore.drivers import proof_beside

SECONDS = 60.0


def beam(load: float = 1.0, cases: bool = False) -> Scene:
    """A beam of 5 × 2 cells on two supports, in blocks of up to two cells, loaded in the middle."""
    live = [{"element": "c2r0", "force": [0, -load]}]
    loads = (
        {"cases": [{"name": "down", "live": live}, {"name": "push", "live": [{"body": [1, 0]}]}]}
        if cases
        else {"live": live}
    )
    return parse_scene(
        {
            "name": "beam",
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["aaaaa", "aaaaa", "#...#"]},
            "materials": {
                "density": 1400,
                "dry": {"friction_angle": 30},
                "inner": {"tensile_strength": 2e6, "shear_strength": 2e5},
            },
            "loads": loads,
            "search": {"block_cells": [1, 2]},
        }
    )


@pytest.mark.sampled(2)
@pytest.mark.parametrize("cases", [False, True])
def test_a_search_of_few_layouts_ends_with_a_bound_on_all(tmp_path: Path, cases: bool) -> None:
    """Every layout is enumerated; the bound of a search of five holds for all, and is at most that of the faces."""
    scene = beam(cases=cases)
    best = explore(scene, tmp_path / "all", driver="enumeration", pictures=False).summary.best
    faces = explore(scene, tmp_path / "some", driver="random", budget=5, pictures=False).summary
    beside = explore(scene, tmp_path / "beside", driver="random", budget=5, seconds=SECONDS, pictures=False).summary
    assert best <= beside.bound * (1.0 + 1e-9)
    assert beside.bound <= faces.bound * (1.0 + 1e-9)
    assert faces.facts["bound_by"] == "face by face"
    assert beside.facts["bound_by"] in ("face by face", "block by block", "exact")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("cases", [False, True])
def test_a_search_under_a_time_limit_takes_up_what_is_proven_beside_it(tmp_path: Path, cases: bool) -> None:
    """Normal forces that stronger layouts do not exceed bound λ; a layout handed over is in its class of symmetry."""
    scene = beam(cases=cases)
    done = explore(scene, tmp_path / "out", driver="random", seconds=8.0, pictures=False)
    best = explore(scene, tmp_path / "all", driver="enumeration", pictures=False).summary.best
    assert done.summary.best <= best * (1.0 + 1e-6)
    assert done.summary.bound >= best * (1.0 - 1e-6)
    assert done.results["labelling"].is_unique


def test_the_exact_driver_beside_a_search_evaluates_load_cases() -> None:
    """Its process would otherwise end with a traceback, where the bound over all blocks does not meet the best."""
    scene = beam(cases=True)
    proof = proof_beside._Proof(search_space(scene, build_assembly(scene)), SolveOptions(), None)
    proof.prove(Deadline(SECONDS))
    assert proof.driver is not None
    assert proof.driver.finished
    assert proof.driver.bound is not None
    assert proof.status.low == pytest.approx(proof.driver.bound, rel=1e-5)


def test_a_space_without_a_bound_says_so(tmp_path: Path) -> None:
    """Cells between supports that nothing crushes carry any load, pressed hard enough."""
    scene = beam()
    grid = {**scene.model_dump(mode="json", exclude_defaults=True)["grid"], "rows": ["#aaa#"]}
    live = {"live": [{"element": "c2r0", "force": [0, -1]}]}
    document = {**scene.model_dump(mode="json", exclude_defaults=True), "grid": grid, "loads": live}
    facts = explore(parse_scene(document), tmp_path / "out", driver="random", budget=4, pictures=False).summary.facts
    assert facts["unbounded"]
    assert facts["bound"] is None
    assert facts["bound_by"] == "nothing: a locked layout carries any load"
