"""Scenes without any dead load: the bracket is ordered, λ = 0 is not proven to be above 0, λ is that of strengths."""

from __future__ import annotations

from typing import Any

import pytest

from cases import all_inner, box
from jld_core import build_assembly, parse_scene, solve

AREA = 0.01
"""Area of the only joint, m²: cells of 0.1 m, 0.1 m thick; boxes with a side of 0.1 m."""

MATERIALS: dict[str, tuple[dict[str, Any], str, list[float], float]] = {
    # name: materials, label, direction of the force at the middle of the joint, λ in closed form
    "friction alone": ({"dry": {"friction_coefficient": 0.7}}, "dry", [1.0, 0.0], 0.0),
    "lifted off": ({"dry": {"friction_coefficient": 0.7}}, "dry", [0.0, 1.0], 0.0),
    "crushing joint, lifted off": (
        {"dry": {"friction_coefficient": 0.7, "compressive_strength": 2e4}},
        "dry",
        [0.0, 1.0],
        0.0,
    ),
    "crushing joint, pressed": (
        {"dry": {"friction_coefficient": 0.7, "compressive_strength": 2e4}},
        "dry",
        [0.0, -1.0],
        2e4 * AREA,
    ),
    "crushing joint, pushed": (
        {"dry": {"friction_coefficient": 0.0, "compressive_strength": 2e4}},
        "dry",
        [1.0, 0.0],
        0.0,
    ),
    "cohesion": ({"dry": {"friction_coefficient": 0.7, "cohesion": 1e3}}, "dry", [1.0, 0.0], 1e3 * AREA),
    "tension": ({"inner": {"tensile_strength": 5e3, "shear_strength": 2e3}}, "inner", [0.0, 1.0], 5e3 * AREA),
    "shear": ({"inner": {"tensile_strength": 5e3, "shear_strength": 2e3}}, "inner", [1.0, 0.0], 2e3 * AREA),
    "no strength": ({"inner": {"tensile_strength": 0.0, "shear_strength": 0.0}}, "inner", [1.0, 0.0], 0.0),
}


@pytest.mark.parametrize("how", ["gravity", "density"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", MATERIALS)
def test_bracket_without_dead_load(name: str, dimension: int, how: str) -> None:
    materials, label, direction, expected = MATERIALS[name]
    document: dict[str, Any] = {"name": name, "materials": {"density": 1400, **materials, how: 0}}
    if dimension == 2:
        document["grid"] = {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a", "#"]}
        document["loads"] = {"live": [{"element": "c0r0", "force": direction, "at": [0.05, 0.1]}]}
    else:
        document["elements"] = [
            box("b", [0, 0, 0], [0.1, 0.1, 0.1]),
            box("floor", [-0.1, -0.1, -0.1], [0.2, 0.2, 0.0], support=True),
        ]
        force = [direction[0], 0.0, direction[1]]
        document["loads"] = {"live": [{"element": "b", "force": force, "at": [0.05, 0.05, 0.0]}]}
    result = solve(build_assembly(parse_scene(all_inner(document, label))))
    low, high = result.bracket
    assert result.status == "collapse"
    assert low <= result.load_factor <= high
    if expected == 0.0:
        assert low <= 0.0  # λ = 0 is not proven to be above 0
        assert high <= 1e-6
    else:
        assert result.load_factor == pytest.approx(expected, rel=1e-6)
        assert high - low <= 1e-6 * expected
    assert result.stands_at_zero is True


def test_gap_without_dead_load_does_not_depend_on_units() -> None:
    """The width is held against the least strength: the same in N and m as in kN and mm."""
    gaps = []
    for length, force in ((1.0, 1.0), (1e3, 1e-3)):
        stress = force / length**2
        document = {
            "grid": {"cell": [0.1 * length, 0.1 * length], "thickness": 0.1 * length, "rows": ["#abc#"]},
            "materials": {"density": 0, "dry": {"friction_coefficient": 0.7, "compressive_strength": 2e4 * stress}},
            "loads": {"live": [{"element": "c2r0", "force": [0.0, -1.0]}]},
        }
        result = solve(build_assembly(parse_scene(document)))
        assert result.status == "collapse"
        gaps.append(result.gap)
    assert gaps[0] == pytest.approx(gaps[1], abs=1e-9)


@pytest.mark.parametrize("force", [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
@pytest.mark.parametrize("rows", [["a", "#"], ["ab", "cd", "##"], ["abc", "def", "###"]])
@pytest.mark.parametrize("dimension", [2, 3])
def test_joints_with_cohesion_that_nothing_presses_bear_nothing_that_tilts(
    dimension: int, rows: list[str], force: list[float]
) -> None:
    """Cohesion bears shear alone: where N = 0 a dry joint bears no moment, so λ = 0. At 0.2: `uncertified`."""
    document: dict[str, Any] = {
        "materials": {"density": 0, "dry": {"friction_coefficient": 0.7, "cohesion": 1e3}},
        "labels": {"default": "dry"},
    }
    if dimension == 2:
        document["grid"] = {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows}
        document["loads"] = {"live": [{"element": "c0r0", "force": force}]}
    else:
        courses, across = len(rows) - 1, len(rows[0])
        document["elements"] = [
            box(f"b{i}{k}", [0.1 * i, 0.0, 0.1 * k], [0.1 * (i + 1), 0.1, 0.1 * (k + 1)])
            for k in range(courses)
            for i in range(across)
        ] + [box("floor", [-0.1, -0.1, -0.1], [0.1 * across + 0.1, 0.2, 0.0], support=True)]
        document["loads"] = {"live": [{"element": f"b0{courses - 1}", "force": [force[0], 0.0, force[1]]}]}
    result = solve(build_assembly(parse_scene(document)))
    assert result.status == "collapse"
    assert result.bracket[0] == 0.0
    assert result.bracket[1] <= 1e-6 * 1e-3 * 1e3 * AREA  # gap, share of the least strength, c times area
