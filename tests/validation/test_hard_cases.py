"""Hard cases: each ends with a bracket no wider than 1e-6 or an honest status, none with a wrong number.

The cases themselves stand in benchmarks/hard_cases.py, which draws up a table of them too. Expected values are closed
forms (`test_closed_forms`) or the independent CVXPY statement.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.hard_cases import (
    UNITS,
    Entry,
    HardCase,
    block,
    bricks,
    ground,
    hard_cases,
    is_near,
    slippery_cubes,
    wedged,
    weightless,
)

from cases import grid_assembly, grid_document
from jld_core import Assembly, LimitAnalysisResult, Status, build_assembly, parse_scene, solve
from jld_core.program import Template
from jld_core.solvers import is_large
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from proofs import reference_load_factor


def proven(result: LimitAnalysisResult, expected: float, rel: float = 1e-6, floor: float = 0.0) -> None:
    assert result.status is Status.COLLAPSE, result.solve_log
    low, high = result.bracket
    assert low - 1e-12 <= expected <= high + 1e-12 or result.load_factor == pytest.approx(expected, rel=rel, abs=floor)
    assert result.load_factor == pytest.approx(expected, rel=rel, abs=floor)
    assert result.gap <= 1e-6


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", [case for case in hard_cases() if not case.kind.startswith("1 640")], ids=str)
@pytest.mark.filterwarnings("ignore")
def test_hard_case(case: HardCase) -> None:
    """Seed 0 of the weights is one where Clarabel, given the unscaled program, says "optimal" of a λ 45 % too high."""
    assembly = case.make()
    labels = assembly.labels if case.labels is None else case.labels(assembly)
    result = solve(assembly, labels)
    assert result.status is case.status, result.solve_log
    if case.status is Status.COLLAPSE:
        expected = case.expected
        if expected is None:
            expected = reference_load_factor(assembly, labels, simplex=case.simplex)
        low, high = result.bracket
        assert low - 1e-12 <= expected <= high + 1e-12 or is_near(result.load_factor, case, expected)
        assert is_near(result.load_factor, case, expected)
        assert result.gap <= 1e-6
    elif case.status is Status.UNSTABLE:
        assert math.isnan(result.load_factor)


@pytest.mark.long
def test_a_large_wall_in_bad_units() -> None:
    """420 bricks, which the solver for large structures takes; `benchmarks.hard_cases` solves 1 640."""
    bad, good = (solve(bricks(20, 10, *UNITS[units])) for units in ("µN, mm", "kN, m"))
    assert is_large(Template(bad.assembly).structure)
    assert bad.status is good.status is Status.COLLAPSE
    assert bad.load_factor == pytest.approx(good.load_factor, rel=1e-9)
    assert bad.gap <= 1e-6


@pytest.mark.parametrize(("halvings", "expected"), [(16, 10.899063770712107), (23, 0.08514948818601104)])
def test_a_motion_that_hardly_works_proves_nothing(halvings: int, expected: float) -> None:
    """Confined, almost without friction: facial reduction once divided by a work that was rounding, and proved λ = 0.

    Expected: the same linear program in rational numbers.
    """
    document = grid_document(["aa..a", "#aaaa", "aa.a#"], friction=2.0**-halvings, tension=1e6, shear=1e6)
    document["grid"] |= {"cell": [1, 1], "thickness": 1}
    document["materials"] |= {"density": 0, "gravity": 1}
    document["loads"] = {"live": [{"element": "c3r1", "force": [0, -1]}]}
    assembly = build_assembly(parse_scene(document))
    labels = np.array([label == "d" for label in "iddiddiiddidid"])
    for many in (False, True):
        found = Evaluator(assembly, EvaluatorSettings(use_batch_solver=many)).evaluate_all(labels[None])[0]
        assert not found.high < expected * (1.0 - 1e-6)
        assert not found.low > expected * (1.0 + 1e-6)


def test_a_hard_case_for_everything_that_was_asked() -> None:
    asked = [
        "units",
        "aspect ratio",
        "column",
        "friction",
        "strengths 0 to 1e12",
        "weights over six decades",
        "no self-weight",
        "nearly coincident faces",
        "sliver",
        "redundant supports",
        "duplicate supports",
        "separate structures",
        "live load without work",
        "load that locks",
        "edge of standing",
        "1 640 blocks in bad units",
        "rank-deficient equilibrium",
        "labelling",
    ]
    assert list(dict.fromkeys(case.kind for case in hard_cases())) == asked


@pytest.mark.parametrize("force", [[1.0, 0.0], [0.9, -1.0]])
def test_a_structure_without_weight(force: list[float]) -> None:
    """Weightless dry blocks carry nothing, exactly, and they stand."""
    result = solve(weightless(force))
    assert result.stands_at_zero is True
    assert result.bracket == (0.0, 0.0)


def test_no_weight_and_glue() -> None:
    assembly = grid_assembly(["aaa", "aaa", "###"], live=[{"element": "c1r0", "force": [1, 0]}])
    result = solve(replace(assembly, dead_loads=0.0 * assembly.dead_loads))
    # λ = 0: nothing is proven above it, and the upper bound is rounding beside the strength of one face
    assert (result.status, result.bracket[0]) == (Status.COLLAPSE, 0.0)
    assert result.bracket[1] <= 1e-11


def test_a_wedged_block_without_friction_lifts() -> None:
    proven(solve(wedged([0.0, 1.0], 0.0)), 1.0)


@pytest.mark.parametrize("route", ["clarabel", "highs"])
def test_an_unreachable_width_is_named(route: str) -> None:
    """Asked for more digits than there are, the result is a bracket all the same, and says how wide it is."""
    assembly = grid_assembly(["aaaa"] * 4 + ["####"])
    result = solve(assembly, solver=route, gap=1e-16)
    assert result.status is Status.COLLAPSE
    assert bool(result.reason) is (result.gap > 1e-16)
    assert result.bracket[0] <= result.load_factor <= result.bracket[1]


def pair(extra: list[Entry], live: list[Entry], **materials: Any) -> Assembly:
    """A unit block on wide ground, and what is said besides."""
    elements = [ground(-5, 5), block("b", -0.5, 0, 0.5, 1, weight=1.0), *extra]
    document = {
        "elements": elements,
        "materials": {"dry": {"friction_coefficient": 0.5}, **materials},
        "loads": {"live": live},
        "labels": {"inner": [["ground", "b"]] if "inner" in materials else []},
    }
    return build_assembly(parse_scene(document))


def test_only_one_load_is_admissible_and_it_is_not_zero() -> None:
    """Frictionless, 5 N one way and λ the other: λ = 5 exactly, and at λ = 0 it slides away."""
    document = grid_document(["a", "#"], friction=0.0, live=[{"element": "c0r0", "force": [-1, 0]}])
    document["loads"]["dead"] = [{"element": "c0r0", "force": [5.0, 0.0]}]
    result = solve(build_assembly(parse_scene(document)))
    proven(result, 5.0)
    assert result.stands_at_zero is False


@pytest.mark.parametrize("body", [[-0.54, 0.36], [0.3, -0.2], [0.9, 0.1], [-0.11, -0.7]])
def test_a_block_that_stands_and_bears_nothing_is_not_unstable(body: list[float]) -> None:
    """Between a frictionless floor and ceiling no sideways load is admissible: λ = 0, and it stands."""
    result = solve(grid_assembly(["#", "a", "#"], friction=0.0, live=[{"body": body}]))
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(0.0, abs=1e-12)
    assert result.stands_at_zero is True


def test_forces_that_cancel_to_a_couple_are_no_scale() -> None:
    live = [
        {"element": "b", "force": [0, 0.1], "at": [0.5, 0.5]},
        {"element": "b", "force": [0, 0.2], "at": [0.5, 0.5]},
        {"element": "b", "force": [0, -0.3], "at": [-0.5, 0.5]},
    ]
    proven(solve(pair([], live)), 0.5 / 0.3)
    proven(
        solve(
            pair(
                [block("c", 2, 0, 3, 1, weight=1.0)],
                [{"element": "b", "force": [1e-8, 0]}, {"element": "c", "moment": 1.0}],
            )
        ),
        0.5,
    )


@pytest.mark.parametrize("weight", [1e8, 1e10])
def test_a_light_block_beside_a_heavy_one(weight: float) -> None:
    """The width of a bracket counts beside λ too where λ is small beside the weight of the whole."""
    light = block("p", 2, 0, 3, 1, weight=1.0)
    assembly = pair([block("heavy", -3, 0, -2, 1, weight=weight), light], [{"element": "p", "force": [1, 0]}])
    proven(solve(assembly), 0.5)


@pytest.mark.parametrize(("strength", "weight"), [(1e6, 1e-8), (1e8, 1e-9)])
def test_a_hanging_pebble_falls_however_strong_the_rest(strength: float, weight: float) -> None:
    ceiling = [block("ceiling", -5, 5, 5, 6, support=True), block("pebble", 2, 4, 3, 5, weight=weight)]
    inner = {"tensile_strength": strength, "shear_strength": strength, "compressive_strength": strength}
    assembly = pair(ceiling, [{"element": "b", "force": [0, -1]}], inner=inner)
    assert solve(assembly, condense="off").status is Status.UNSTABLE


def test_a_pebble_lifted_by_a_millionth_of_the_load_is_not_called_unstable() -> None:
    """It stands for every λ ≥ 1000: locked in truth, and honest doubt is the least that is asked."""
    ceiling = [block("ceiling", -5, 5, 5, 6, support=True), block("pebble", 2, 4, 3, 5, weight=1e-3)]
    live = [{"element": "b", "force": [0, -1e6]}, {"element": "pebble", "force": [0, 1e-6]}]
    assert solve(pair(ceiling, live)).status in (Status.LOCKED, Status.UNCERTIFIED)


@pytest.mark.parametrize("slope", [1e-4, 4.4e-4, 6e-4, 1e-2])
def test_a_faint_kink_is_a_kink(slope: float) -> None:
    """A frictionless block on a floor that rises by the slope: λ is the slope, not the zero of a flat floor."""
    rise = math.tan(slope)
    floor = [[-3, -3], [3, -3], [3, 0], [2, 0], [1, 0], [0, 0], [-1, rise], [-2, rise], [-3, rise]]
    elements = [
        {"id": "floor", "polygon": floor, "support": True},
        {"id": "b", "polygon": [[-1, rise], [0, 0], [1, 0], [1, 1], [-1, 1]], "weight": 1.0},
    ]
    document = {
        "elements": elements,
        "materials": {"dry": {"friction_coefficient": 0.0}},
        "loads": {"live": [{"element": "b", "force": [-1, 0]}]},
    }
    assembly = build_assembly(parse_scene(document))
    assert len(assembly.interfaces) == 2
    proven(solve(assembly), rise, floor=2e-9)


def test_frictionless_cubes_side_by_side_stand() -> None:
    """A yield set without room, with cones."""
    assert solve(slippery_cubes()).stands_at_zero is True
