"""The machinery of the benchmarks, each on its smallest scene, so that none of them rots unseen."""

from __future__ import annotations

import math

import pytest
from benchmarks import hard_cases, large, speed_error, throughput
from benchmarks.hard_cases import hard_cases as all_hard_cases
from benchmarks.scenes import GRIDS, bonded, brick_wall, grid

from jld_core import Assembly, Scene, build_assembly


def test_hard_cases() -> None:
    cases = [case for case in all_hard_cases() if case.name in ("N, mm", "inside the cone", "-1e-06")]
    verdicts = [hard_cases.judge(case) for case in cases]
    assert [verdict.right for verdict in verdicts] == [True] * 3
    assert [hard_cases.row_of(verdict)[2] for verdict in verdicts] == ["collapse", "locked", "unstable"]


def test_throughput() -> None:
    scene = grid(GRIDS[33], search={"block_cells": [2, 6]})
    found = throughput.measure("33", scene, asked=12, sample=2, jobs=1)
    assert found.asked == 12
    assert found.apart < 1e-5


# in space more routes do the same
@pytest.mark.long
@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(grid(bonded(GRIDS[33])), id="planar"),
        pytest.param(brick_wall(2, 2), id="spatial", marks=pytest.mark.long),
    ],
)
def test_speed_against_error(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_error, "REPEATED", 0.0)
    assembly = build_assembly(scene)
    found = speed_error.measure_all(assembly, assembly, limit=20)
    reference = speed_error.reference_of(found)
    assert reference.half_width < 1e-8
    assert {one.way.name for one in found} == {way.name for way in speed_error.SOLVERS if way.takes(assembly)}
    for one in found:
        if one.way.family in speed_error.BRACKETED and math.isfinite(one.found.load):
            assert speed_error.certain_error(one, reference)[0] < 1e-3
    assert speed_error.DEFAULT not in speed_error.better(found, reference, bracketed=True)
    assert len(speed_error.rows_of(found, reference)) == len(found)
    assert len(speed_error.draw({"scene": (found, reference)}).axes) == 1


def test_a_route_that_exceeds_the_time_limit_is_marked() -> None:
    assembly = build_assembly(brick_wall(2, 2))

    def never(_: Assembly) -> speed_error.Found:
        while True:
            pass

    slow = speed_error.Way("slow", "CVXPY", speed_error.any_scene, never)
    slower = speed_error.Way("slower", "CVXPY", speed_error.any_scene, never, easier="slow")
    failures = [one.failure for one in speed_error.measure_all(assembly, assembly, (slow, slower), limit=0)]
    assert failures == ["not in 0 s", "not in 0 s (slow was not)"]


# The machinery of the benchmarks of scale, on walls of a few blocks.


@pytest.mark.parametrize("case", sorted(large.DRY_WALLS))
def test_scale(case: str) -> None:
    found = [large.measure_wall(case, courses, "schur") for courses in (4, 6)]
    assert all(one["status"] == "collapse" and one["stands"] and one["gap"] < 1e-6 for one in found)
    assert set(found[0]["seconds"]) == set(large.WALL_PHASES)
    assert f"| {case} | schur |" in large._walls({(case, "schur"): found})
