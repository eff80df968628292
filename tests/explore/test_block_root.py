"""The bound over all possible blocks, computed beside a search."""

from __future__ import annotations

from pathlib import Path

import pytest

from jld_core import Scene, build_assembly, parse_scene
from jld_core.deadline import Deadline
from jld_core.limit import SolveOptions
from jld_explore import explore
from jld_explore.drivers.exact.block_bounds import BlockRoot
from jld_explore.space import search_space

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


def bound_of(scene: Scene) -> float | None:
    assembly = build_assembly(scene)
    root = BlockRoot.beside(search_space(scene, assembly), SolveOptions(), Deadline(SECONDS), jobs=1)
    try:
        return root.poll(SECONDS)
    finally:
        root.close()


@pytest.mark.parametrize("cases", [False, True])
def test_no_layout_exceeds_the_bound_by_blocks(tmp_path: Path, cases: bool) -> None:
    """Every layout is enumerated; the bound holds for all, and is below that of the faces."""
    scene = beam(cases=cases)
    best = explore(scene, tmp_path / "all", driver="enumeration", pictures=False).summary.best
    faces = explore(scene, tmp_path / "some", driver="random", budget=2, pictures=False).summary
    bound = bound_of(scene)
    assert best <= bound * (1.0 + 1e-9)
    assert bound <= faces.bound * (1.0 + 1e-9)
    assert faces.facts["bound_by"] == "face by face"


def test_the_bound_scales_with_the_load() -> None:
    one, ten = bound_of(beam()), bound_of(beam(10.0))
    assert one == pytest.approx(10.0 * ten, rel=1e-5)


def test_a_search_under_a_time_limit_names_its_bound(tmp_path: Path) -> None:
    done = explore(beam(), tmp_path / "out", driver="random", budget=5, seconds=SECONDS, pictures=False).summary
    assert done.facts["bound_by"] in ("face by face", "block by block")
    assert done.bound is not None
    assert done.best is None or done.best <= done.bound
