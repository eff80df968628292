"""One labelling alone by the batch solver, beside the usual way: the same answers, the same in all units, and never
wider."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import box, grid_scene
from jld_core import Assembly, LimitAnalysis, Status, build_assembly, parse_scene, solve, tolerances
from jld_core.batch import chosen

pytestmark = pytest.mark.skipif(chosen() is None, reason="no kernel")


def cubes(length: float = 1.0, force: float = 1.0, push: float = 1.0, columns: int = 3) -> Assembly:
    """Cubes of 0.1 m on a base that is pushed at a top corner; numbers of length and force times a factor."""
    side = 0.1 * length
    elements = [
        box(f"c{x}{y}{z}", side * np.array([x, y, z]), side * np.array([x + 1, y + 1, z + 1]), weight=13.7 * force)
        for z in range(3)
        for y in range(3)
        for x in range(columns)
    ]
    elements.append(box("base", side * np.array([-1, -1, -1]), side * np.array([columns + 1, 4, 0]), support=True))
    strength = 2e4 * force / length**2
    document = {
        "elements": elements,
        "materials": {
            "dry": {"friction_angle": 30},
            "inner": {"tensile_strength": strength, "shear_strength": strength},
        },
        "loads": {"live": [{"element": "c002", "force": [push * force, 0.3 * push * force, 0.0]}]},
    }
    return build_assembly(parse_scene(document))


def labellings(assembly: Assembly, count: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    dice = np.random.default_rng(3)
    return dice.random((count, len(assembly.interfaces))) < dice.random((count, 1))


def test_the_kernel_and_the_usual_way_agree() -> None:
    assembly = cubes()
    usual = LimitAnalysis(assembly)
    for labels in labellings(assembly, 8):
        one, other = solve(assembly, labels), usual.solve(labels)
        assert one.status is other.status
        assert one.stands_at_zero is other.stands_at_zero
        if one.status is Status.COLLAPSE:
            (low, high), (least, most) = one.bracket, other.bracket
            assert low <= most * (1.0 + 1e-12)
            assert least <= high * (1.0 + 1e-12)
            assert high - low <= tolerances.GAP * high


@pytest.mark.parametrize(("length", "force"), [(1e3, 1e-6), (1e-3, 1e6)])
def test_alone_lambda_is_the_same_in_all_units(length: float, force: float) -> None:
    here, there = cubes(), cubes(length, force)
    for labels in labellings(here, 4):
        one, other = solve(here, labels), solve(there, labels)
        assert one.status is other.status
        if one.status is Status.COLLAPSE:
            assert other.load_factor == pytest.approx(one.load_factor, rel=1e-9)


def test_a_narrower_gap_than_the_kernel_gives_is_left_to_the_usual_way() -> None:
    assembly = cubes()
    labels = labellings(assembly, 1)[0]
    narrow = solve(assembly, labels, gap=1e-8)
    assert narrow.gap <= 1e-8
    assert narrow.load_factor == pytest.approx(solve(assembly, labels).load_factor, rel=1e-6)


def test_small_structures_and_searches_do_not_begin_with_the_batch_solver() -> None:
    small = cubes(columns=1)
    assert "batch solver" not in solve(small, np.zeros(len(small.interfaces), dtype=bool)).solve_log
    assert "batch solver" not in LimitAnalysis(cubes()).prove(labellings(cubes(), 1)[0]).solve_log


def test_an_element_in_the_middle_of_its_supports_has_no_expansion() -> None:
    """It moves away from nothing; the motion was divided by its speed of zero."""
    assembly = build_assembly(grid_scene(["#a#"], live=[{"body": [0, -1]}]))
    assert LimitAnalysis(assembly).repair.expansion() is None
