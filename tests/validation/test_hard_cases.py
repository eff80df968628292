"""Hard cases: each ends with a bracket no wider than 1e-6 or an honest status, none with a wrong number.

Expected values are closed forms (METHOD, REFERENCE_VALUES) or the independent CVXPY statement.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases import grid_assembly, grid_document
from cases_spatial import box
from cases_spatial import scene as spatial_scene
from jld_core import Assembly, LimitAnalysisResult, Status, build_assembly, parse_scene, solve
from reference_planar import reference_load_factor

Entry = dict[str, Any]
PUSH: list[Entry] = [{"body": [1, 0]}]


def block(name: str, x0: float, y0: float, x1: float, y1: float, **keys: Any) -> Entry:
    return {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], **keys}


def ground(x0: float = -1.0, x1: float = 5.0, name: str = "ground") -> Entry:
    return block(name, x0, -1, x1, 0, support=True)


def structure(elements: list[Entry], friction: float = 0.5, live: list[Entry] | None = None) -> Assembly:
    return build_assembly(
        parse_scene(
            {
                "elements": elements,
                "materials": {"dry": {"friction_coefficient": friction}},
                "loads": {"live": live or PUSH},
            }
        )
    )


def proven(result: LimitAnalysisResult, expected: float, rel: float = 1e-6, floor: float = 0.0) -> None:
    assert result.status is Status.COLLAPSE, result.route
    low, high = result.bracket
    assert low - 1e-12 <= expected <= high + 1e-12 or result.load_factor == pytest.approx(expected, rel=rel, abs=floor)
    assert result.load_factor == pytest.approx(expected, rel=rel, abs=floor)
    assert result.gap <= 1e-6


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_tall_columns(count: int) -> None:
    column = [block(f"b{k}", 0, k, 1, k + 1, weight=1.0) for k in range(count)]
    proven(solve(structure([*column, ground()])), 1.0 / count)


@pytest.mark.parametrize("height", [1e-6, 1e-3, 1e3, 1e6])
def test_interface_aspect_ratios(height: float) -> None:
    pair = [block("a", 0, 0, 1, height, weight=1.0), block("b", 0, height, 1, 2 * height, weight=1.0)]
    proven(
        solve(structure([*pair, block("ground", -1, -height, 2, 0, support=True)])), min(0.5, 0.5 / height), floor=1e-9
    )


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
def test_a_thin_leg_beside_a_thick_one(width: float) -> None:
    legs = [block("thin", 0, 0, width, 1, weight=width), block("thick", 1, 0, 2, 1, weight=1.0)]
    assembly = structure([block("beam", 0, 1, 2, 2, weight=1.0), *legs, ground()])
    result = solve(assembly)
    assert result.gap < 1e-9
    assert 0.49 < result.load_factor < 0.5


@pytest.mark.parametrize("friction", [0.0, 1e-6, 1e-3, 1.0, 10.0, 1e3])
@pytest.mark.filterwarnings("ignore")
def test_friction_from_nothing_to_a_thousand(friction: float) -> None:
    blocks = [
        block("a", 0, 0, 1, 1, weight=1.0),
        block("b", 0, 1, 1, 2, weight=1.0),
        block("c", 1, 0, 2, 1, weight=1.0),
    ]
    assembly = structure([*blocks, ground()], friction)
    proven(solve(assembly), reference_load_factor(assembly, assembly.labels), floor=1e-9)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.filterwarnings("ignore")
def test_strengths_over_twelve_decades_in_one_scene(seed: int) -> None:
    assembly = grid_assembly(["aaaa", "aaaa", "aaaa", "####"])
    rng = np.random.default_rng(seed)
    count = len(assembly.interfaces)
    tension, shear = 10.0 ** rng.uniform(0, 12, (2, count))
    tension[::7] = 0.0
    mixed = replace(assembly, strengths=replace(assembly.strengths, tension=tension, shear=shear))
    labels = rng.random(count) < 0.5
    proven(solve(mixed, labels), reference_load_factor(mixed, labels), rel=1e-5, floor=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.filterwarnings("ignore")
def test_weights_over_six_decades(seed: int) -> None:
    """Seed 0 is one where Clarabel, given the unscaled program, says "optimal" of a λ 45 % too high."""
    weights = 10.0 ** np.random.default_rng(seed).uniform(-3, 3, 12)
    wall = [
        block(f"b{i}{j}", i + 0.5 * (j % 2), j, i + 1 + 0.5 * (j % 2), j + 1, weight=float(weights[3 * j + i]))
        for j in range(4)
        for i in range(3)
    ]
    assembly = structure([*wall, ground()])
    proven(solve(assembly), reference_load_factor(assembly, assembly.labels, simplex=True))


@pytest.mark.parametrize(
    ("force", "status"),
    [
        ([1.0, 0.0], Status.COLLAPSE),
        ([0.9, -1.0], Status.COLLAPSE),
        ([0.0, -1.0], Status.LOCKED),
        ([0.1, -1.0], Status.LOCKED),
    ],
)
def test_no_weight_at_all(force: list[float], status: Status) -> None:
    """Weightless dry blocks carry nothing, or anything that points into the friction cone."""
    pair = [block("a", 0, 0, 1, 1), block("b", 0, 1, 1, 2), ground()]
    result = solve(structure(pair, live=[{"element": "b", "force": force}]))
    assert result.status is status
    assert result.stands_at_zero is True
    if status is Status.COLLAPSE:
        assert result.bracket == (0.0, 0.0)


def test_no_weight_and_glue() -> None:
    assembly = grid_assembly(["aaa", "aaa", "###"], live=[{"element": "c1r0", "force": [1, 0]}])
    result = solve(replace(assembly, dead=0.0 * assembly.dead))
    assert (result.status, result.load_factor, result.gap) == (Status.COLLAPSE, 0.0, 0.0)


@pytest.mark.parametrize("gap", [1e-5, 1e-7, 1e-9, -1e-9])
def test_nearly_coincident_faces(gap: float) -> None:
    """Two blocks a hair apart, or a hair into one another: in contact or not, λ is the same here."""
    blocks = [block("a", 0, 0, 1, 1, weight=1.0), block("b", 1 + gap, 0, 2, 1, weight=1.0)]
    proven(solve(structure([*blocks, ground()])), 0.5)


def test_redundant_supports_under_one_block() -> None:
    pieces = [block(f"g{k}", 0.25 * k, -1, 0.25 * (k + 1), 0, support=True) for k in range(4)]
    assembly = structure([block("a", 0, 0, 1, 1, weight=1.0), *pieces])
    assert len(assembly.interfaces) == 4
    proven(solve(assembly), 0.5)


def test_separate_structures_in_one_scene() -> None:
    two = [block("low", 0, 0, 1, 1, weight=1.0), block("tall", 10, 0, 11, 3, weight=1.0)]
    supports = [ground(-1, 2), ground(9, 12, "far ground")]
    proven(solve(structure([*two, *supports])), 1.0 / 3.0)
    proven(solve(structure([*two, *supports], live=[{"element": "low", "force": [1, 0]}])), 0.5)


@pytest.mark.parametrize("push", [[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
def test_a_wedged_block_is_locked(push: list[float]) -> None:
    """Between two abutments a load does no work in any mechanism (associative friction, self-stress)."""
    walls = [block("left", -1, 0, 0, 1, support=True), block("right", 1, 0, 2, 1, support=True)]
    result = solve(
        structure([block("a", 0, 0, 1, 1, weight=1.0), *walls, ground()], live=[{"element": "a", "force": push}])
    )
    assert result.status is Status.LOCKED


def test_a_wedged_block_without_friction_lifts() -> None:
    walls = [block("left", -1, 0, 0, 1, support=True), block("right", 1, 0, 2, 1, support=True)]
    lifted = structure([block("a", 0, 0, 1, 1, weight=1.0), *walls, ground()], 0.0, [{"element": "a", "force": [0, 1]}])
    proven(solve(lifted), 1.0)


@pytest.mark.parametrize("edge", [0.0, 1e-12, 1e-10, 1e-9, 1e-6])
def test_at_the_edge_of_standing(edge: float) -> None:
    """A block whose support ends `edge` beyond its centroid: λ = 2·edge, and just short of it it falls."""
    blocks = [block("a", 0, 0, 2, 1, weight=1.0), ground(-1, 1 + edge)]
    live = [{"element": "a", "force": [1, 0]}]
    proven(solve(structure(blocks, live=live)), 2.0 * edge, floor=1e-9)
    if edge > 0.0:
        blocks[1] = ground(-1, 1 - edge)
        result = solve(structure(blocks, live=live))
        assert result.status is Status.UNSTABLE
        assert math.isnan(result.load_factor)


@pytest.mark.parametrize("pattern", ["dry", "inner", "alternating"])
@pytest.mark.filterwarnings("ignore")
def test_uniform_and_alternating_labels(pattern: str) -> None:
    assembly = grid_assembly(["aaaa"] * 4 + ["####"])
    count = len(assembly.interfaces)
    labels = {"dry": np.ones(count, bool), "inner": np.zeros(count, bool), "alternating": np.arange(count) % 2 == 0}[
        pattern
    ]
    proven(solve(assembly, labels), reference_load_factor(assembly, labels))


@pytest.mark.parametrize("route", ["clarabel", "highs"])
def test_an_unreachable_width_is_named(route: str) -> None:
    """Asked for more digits than there are, the result says so instead of pretending."""
    assembly = grid_assembly(["aaaa"] * 4 + ["####"])
    result = solve(assembly, solver=route, gap=1e-16)
    assert result.status is Status.UNCERTIFIED
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


def test_frictionless_cubes_side_by_side_in_space() -> None:
    """No force can pass between them: a yield set without room, with cones. Lifting one takes its weight."""
    slab = box("slab", [-5, -5, -1], [5, 5, 0], support=True)
    cubes = [box("a", [0, 0, 0], [1, 1, 1]), box("b", [1, 0, 0], [2, 1, 1])]
    lifted = spatial_scene(
        [*cubes, slab], materials={"dry": {"friction_coefficient": 0.0}}, live=[{"element": "a", "force": [0, 0, 1]}]
    )
    result = solve(build_assembly(parse_scene(lifted)))
    proven(result, 1.0)
    assert result.stands_at_zero is True
