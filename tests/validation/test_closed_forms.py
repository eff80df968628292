"""Closed forms from docs/method.md (2.2) to (2.11); relative tolerance 1e-8 unless said otherwise."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cases import all_inner, grid_assembly
from jld_core import LimitAnalysisResult, Status, build_assembly, parse_scene, solve


def column(width: float, height: float, count: int, friction: float, live: list[dict[str, Any]]) -> LimitAnalysisResult:
    elements: list[dict[str, Any]] = [
        {
            "id": f"b{k}",
            "polygon": [
                [0, k * height],
                [width, k * height],
                [width, (k + 1) * height],
                [0, (k + 1) * height],
            ],
            "weight": 1.0,
        }
        for k in range(count)
    ]
    ground = [[-width, -height], [2 * width, -height], [2 * width, 0], [-width, 0]]
    elements.append({"id": "ground", "polygon": ground, "support": True})
    document = {
        "elements": elements,
        "materials": {"dry": {"friction_coefficient": friction}},
        "loads": {"live": live},
    }
    return solve(build_assembly(parse_scene(document)))


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.4, 0.6, 2.0])
@pytest.mark.parametrize(("width", "height"), [(1.0, 1.0), (1.0, 3.0), (2.0, 1.0)])
def test_block_under_horizontal_body_load(friction: float, width: float, height: float) -> None:
    """min(μ, b/h): it slides or it rocks."""
    result = column(width, height, 1, friction, [{"body": [1, 0]}])
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(min(friction, width / height), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("count", [2, 5, 20])
@pytest.mark.parametrize("friction", [0.02, 0.7])
def test_column_of_blocks(count: int, friction: float) -> None:
    """min(μ, b/(n h)): the whole column rocks about its base."""
    result = column(1.0, 0.5, count, friction, [{"body": [1, 0]}])
    assert result.load_factor == pytest.approx(min(friction, 1.0 / (count * 0.5)), rel=1e-8)


def test_block_under_pure_moment() -> None:
    """A couple m tips a block of weight 1 and width b when m = b/2."""
    result = column(1.0, 2.0, 1, 0.5, [{"element": "b0", "moment": 1.0}])
    assert result.load_factor == pytest.approx(0.5, rel=1e-8)


def test_force_outside_its_element() -> None:
    """A vertical force at distance e beyond the edge tips the block when λ e = W b/2."""
    result = column(1.0, 1.0, 1, 0.5, [{"element": "b0", "force": [0, -1], "at": [1.25, 3.0]}])
    assert result.load_factor == pytest.approx(2.0, rel=1e-8)


@pytest.mark.parametrize(("tension", "shear"), [(2e4, 1e3), (2e4, 1e6), (0.0, 1e6), (1e3, 200.0)])
def test_cell_on_an_inner_base(tension: float, shear: float) -> None:
    """Paper 3.2a, eq. (4): sliding at τA/W, opening at (l/3h)(1 + σt A/W) for a load at the centroid."""
    side, thickness = 0.1, 0.1
    document = {
        "grid": {"cell": [side, side], "thickness": thickness, "rows": ["a", "#"]},
        "materials": {"density": 1400, "inner": {"tensile_strength": tension, "shear_strength": shear}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    weight, area = 1400 * 9.81 * side * side * thickness, side * thickness
    result = solve(build_assembly(parse_scene(all_inner(document))))
    expected = min(shear * area / weight, (side / (3 * side)) * (1 + tension * area / weight))
    assert result.load_factor == pytest.approx(expected, rel=1e-8)


def test_horizontal_inner_cantilever() -> None:
    """A weightless cell glued to a wall, transverse tip force P: P l = σt A h/6 or P = τA."""
    tension, shear, side = 2e5, 1e6, 0.1
    document = {
        "grid": {"cell": [side, side], "thickness": side, "rows": ["#a"]},
        "materials": {"inner": {"tensile_strength": tension, "shear_strength": shear}},
        "loads": {"live": [{"element": "c1r0", "force": [0, -1], "at": [2 * side, side / 2]}]},
    }
    result = solve(build_assembly(parse_scene(all_inner(document))))
    area = side * side
    assert result.load_factor == pytest.approx(min(tension * area * side / 6 / side, shear * area), rel=1e-8)
    assert result.stands_at_zero is True


def test_pulled_cell() -> None:
    """A weightless glued cell pulled straight off: σt A."""
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a", "#"]},
        "materials": {"inner": {"tensile_strength": 3e5, "shear_strength": 1e6}},
        "loads": {"live": [{"element": "c0r0", "force": [0, 1]}]},
    }
    assert solve(build_assembly(parse_scene(all_inner(document)))).load_factor == pytest.approx(3e3, rel=1e-8)


@pytest.mark.parametrize("label", ["dry", "inner"])
def test_crushing(label: str) -> None:
    """Compression at the centroid crushes a face at σc A, whatever its label."""
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["a", "#"]},
        "materials": {
            "dry": {"friction_coefficient": 0.5, "compressive_strength": 4e5},
            "inner": {"tensile_strength": 1e5, "shear_strength": 1e5, "compressive_strength": 4e5},
        },
        "loads": {"live": [{"element": "c0r0", "force": [0, -1]}]},
    }
    result = solve(build_assembly(parse_scene(all_inner(document, label))))
    assert result.load_factor == pytest.approx(4e3, rel=1e-7)


def test_eccentric_crushing_of_a_joint() -> None:
    """docs/method.md (2.10): a force at eccentricity e is carried by the strip l − 2e, N = σc t (l − 2e)."""
    side, crush, off = 0.1, 4e5, 0.02
    document = {
        "grid": {"cell": [side, side], "thickness": side, "rows": ["a", "#"]},
        "materials": {"dry": {"friction_coefficient": 0.5, "compressive_strength": crush}},
        "loads": {"live": [{"element": "c0r0", "force": [0, -1], "at": [side / 2 + off, side]}]},
    }
    result = solve(build_assembly(parse_scene(document)))
    assert result.load_factor == pytest.approx(crush * side * (side - 2 * off), rel=1e-7)


def test_pressed_stack_is_locked() -> None:
    """Without σc a centred press can grow for ever."""
    result = grid_solve(["aa", "aa", "##"], [{"body": [0, -1]}])
    assert result.status is Status.LOCKED
    assert math.isnan(result.load_factor)
    assert result.bracket[0] >= 0.0
    assert math.isnan(result.bracket[1])
    assert result.mechanism is None


def test_overhang_is_unstable() -> None:
    """Three dry cells held at one end only cannot stand under any λ ≥ 0."""
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["abc", "#.."]},
        "materials": {"density": 1400, "dry": {"friction_coefficient": 0.5}},
        "loads": {"live": [{"body": [0, -1]}]},
    }
    result = solve(build_assembly(parse_scene(document)))
    assert result.status is Status.UNSTABLE
    assert result.stands_at_zero is False


def test_an_overhang_that_stands_only_under_load() -> None:
    """docs/method.md (3.15): a see-saw stands for λ in [λ1 > 0, λ2] only; λ2 is reported, and that it falls at zero."""
    document = {
        "elements": [
            {"id": "beam", "polygon": [[0, 1], [4, 1], [4, 2], [0, 2]], "weight": 1.0},
            {"id": "stone", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": 0.5}},
        "loads": {"live": [{"element": "beam", "force": [0, -1], "at": [0.0, 2.0]}]},
    }
    result = solve(build_assembly(parse_scene(document)))
    # beyond the left edge x = 0 nothing can tip it that way; about x = 1: 1·1 ≤ λ·1
    assert result.status is Status.LOCKED
    assert result.stands_at_zero is False


def grid_solve(rows: list[str], live: list[dict[str, Any]]) -> LimitAnalysisResult:
    return solve(grid_assembly(rows, live=live))
