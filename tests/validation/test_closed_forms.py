"""Closed forms from docs/method.md (2.2) to (2.11); relative tolerance 1e-8 unless said otherwise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmarks import commands, hard_cases, speed_error
from benchmarks.hard_cases import hard_cases as all_hard_cases
from benchmarks.scenes import GRIDS, bonded, brick_wall, grid
from studies.families import semicircular_arch

from cases import all_inner, box, dry_and_inner, grid_assembly
from jld_core import LimitAnalysis, LimitAnalysisResult, Scene, Status, build_assembly, parse_scene, solve
from jld_core.limit import mechanism


def column(width: float, height: float, count: int, friction: float, live: list[dict[str, Any]]) -> LimitAnalysisResult:
    elements: list[dict[str, Any]] = [
        {
            "id": f"b{k}",
            "polygon": [[0, k * height], [width, k * height], [width, (k + 1) * height], [0, (k + 1) * height]],
            "weight": 1.0,
        }
        for k in range(count)
    ]
    ground = [[-width, -height], [2 * width, -height], [2 * width, 0], [-width, 0]]
    elements.append({"id": "ground", "polygon": ground, "support": True})
    document = {"elements": elements, "materials": {"dry": {"friction_coefficient": friction}}, "loads": {"live": live}}
    return solve(build_assembly(parse_scene(document)))


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.4, 0.6, 2.0])
@pytest.mark.parametrize(("width", "height"), [(1.0, 1.0), (1.0, 3.0), (2.0, 1.0)])
def test_block_under_horizontal_body_load(friction: float, width: float, height: float) -> None:
    """min(μ, b/h): it slides or it rocks."""
    result = column(width, height, 1, friction, [{"body": [1, 0]}])
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(min(friction, width / height), rel=1e-8, abs=1e-9)


def cell(rows: list[str], load: dict[str, Any], label: str = "inner", **materials: Any) -> LimitAnalysisResult:
    """Cells of 0.1 × 0.1 × 0.1 under one load, all of whose faces have one label."""
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": {label: materials.pop("strengths"), **materials},
        "loads": {"live": [load]},
    }
    return solve(build_assembly(parse_scene(all_inner(document, label))))


def tip(place: int, *at: float) -> dict[str, Any]:
    return {"element": f"c{place}r0", "force": [0, -1], **({"at": list(at)} if at else {})}


CRUSHING = {"friction_coefficient": 0.5, "compressive_strength": 4e5}
BRITTLE = {"tensile_strength": 1e5, "shear_strength": 1e5, "compressive_strength": 4e5}
CLOSED: dict[str, tuple[Callable[[], LimitAnalysisResult], float]] = {
    # the whole column rocks about its base: min(μ, b/(n h))
    **{
        f"{count} blocks, μ = {friction}": (
            lambda count=count, friction=friction: column(1.0, 0.5, count, friction, [{"body": [1, 0]}]),
            min(friction, 2.0 / count),
        )
        for count in (2, 5, 20)
        for friction in (0.02, 0.7)
    },
    # a couple m tips a block of weight 1 and width b when m = b/2
    "couple": (lambda: column(1.0, 2.0, 1, 0.5, [{"element": "b0", "moment": 1.0}]), 0.5),
    # a vertical force at distance e beyond the edge when λ e = W b/2
    "outside": (lambda: column(1.0, 1.0, 1, 0.5, [{"element": "b0", "force": [0, -1], "at": [1.25, 3.0]}]), 2.0),
    # a weightless cell glued to a wall, transverse tip force P: P l = σt A h/6, less than τA
    "cantilever": (
        lambda: cell(["#a"], tip(1, 0.2, 0.05), strengths={"tensile_strength": 2e5, "shear_strength": 1e6}),
        2e5 * 1e-2 / 6,
    ),
    # pulled straight off: σt A
    "pulled": (
        lambda: cell(
            ["a", "#"], {"element": "c0r0", "force": [0, 1]}, strengths={"tensile_strength": 3e5, "shear_strength": 1e6}
        ),
        3e3,
    ),
    # compression at the centroid crushes a face at σc A, whatever its label
    "crushed joint": (lambda: cell(["a", "#"], tip(0), "dry", strengths=CRUSHING, inner=BRITTLE), 4e3),
    "crushed face": (lambda: cell(["a", "#"], tip(0), strengths=BRITTLE, dry=CRUSHING), 4e3),
    # (2.10): a force at eccentricity e is carried by the strip l − 2e, N = σc t (l − 2e)
    "off the middle": (lambda: cell(["a", "#"], tip(0, 0.07, 0.1), "dry", strengths=CRUSHING), 4e4 * 0.06),
    # paper 3.2a, eq. (4): sliding at τA/W, opening at (l/3h)(1 + σt A/W) for a load at the centroid
    **{
        f"glued, σt = {tension:g}, τ = {shear:g}": (
            lambda tension=tension, shear=shear: cell(
                ["a", "#"],
                {"body": [1, 0]},
                strengths={"tensile_strength": tension, "shear_strength": shear},
                density=1400,
            ),
            min(shear / 1373.4, (1.0 + tension / 1373.4) / 3.0),
        )
        for tension, shear in ((2e4, 1e3), (2e4, 1e6), (0.0, 1e6), (1e3, 200.0))
    },
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms(name: str) -> None:
    made, expected = CLOSED[name]
    result = made()
    assert result.load_factor == pytest.approx(expected, rel=1e-7 if "crushed" in name or "off" in name else 1e-8)
    assert result.stands_at_zero is True


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


# Least thickness of a semicircular arch: Cocchetti & Rizzi, Frattura ed Integrità Strutturale 51 (2020)
# 356–375, Table 3, weight along the centreline: μ > 0.395832 → t/R = 0.107426 (rotation), μ = 0.309215 → 0.200637,
# between them sliding and rotation at once, below 0.309215 no thickness stands.
#
# A discrete arch has joints at fixed angles only, so that it stands a little longer; its error falls with the
# number of voussoirs. Tolerances are those errors.


ROTATION, LIMIT_FRICTION, LIMIT_THICKNESS = 0.107426, 0.309215, 0.200637


def stands(voussoirs: int, thickness: float, friction: float) -> bool:
    assembly = build_assembly(semicircular_arch(voussoirs, thickness, friction))
    return LimitAnalysis(assembly).stands(assembly.labels) is True


def least_thickness(voussoirs: int, friction: float, low: float, high: float, tolerance: float = 1e-7) -> float:
    assert stands(voussoirs, high, friction)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands(voussoirs, middle, friction) else (middle, high)
    return high


@pytest.mark.long
def test_rotation_regime_converges() -> None:
    """The error is that of the nearest joint's angle to the true hinge, squared: fitted slope 2, hence n⁻² at the most.

    Hinge at the haunch, same table: 54.4963° from the crown.
    """
    numbers = np.array([8, 16, 28, 48, 64, 112, 240])
    hinge = 90.0 - 54.4963
    step = 180.0 / numbers
    offset = np.minimum(hinge % step, step - hinge % step)
    errors = ROTATION - np.array([least_thickness(int(n), 0.7, 0.08, 0.12) for n in numbers])
    # with fewer joints there are fewer mechanisms: a discrete arch never needs more than the continuous one
    assert np.all(errors > -1e-6)
    far = offset > 0.3
    slope = np.polyfit(np.log(offset[far]), np.log(errors[far]), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.25)
    assert errors[-1] < 1e-5


def test_friction_just_above_the_transition_changes_nothing() -> None:
    near, far = (least_thickness(60, friction, 0.10, 0.12, 1e-6) for friction in (0.3965, 0.7))
    assert near == pytest.approx(far, abs=2e-5)


@pytest.mark.long
def test_mixed_regime_lies_between() -> None:
    values = [least_thickness(120, friction, 0.10, 0.25, 1e-5) for friction in (0.315, 0.33, 0.36, 0.39)]
    assert np.all(np.diff(values) < 0.0)
    assert ROTATION - 1e-4 < values[-1] < values[0] < LIMIT_THICKNESS + 1e-4


def test_sliding_limit() -> None:
    """At the limit friction the thickness is 0.200637; a little below it no thickness stands."""
    assert least_thickness(240, LIMIT_FRICTION + 2e-5, 0.19, 0.21, 1e-4) == pytest.approx(LIMIT_THICKNESS, abs=2e-3)
    for thickness in (0.2, 0.4, 0.8, 1.2):
        assert not stands(240, thickness, LIMIT_FRICTION - 1e-4)


@pytest.mark.parametrize("voussoirs", [12, 41])
def test_bracket_of_an_arch_is_narrow(voussoirs: int) -> None:
    assembly = build_assembly(semicircular_arch(voussoirs, 0.16, 0.6))
    result = LimitAnalysis(assembly).solve()
    assert result.gap < 1e-7
    assert result.stands_at_zero is True


# The paper's section 3.2: one block on an inner base, two stacked cubes on a dry base; λ in closed form.
#
# Relative tolerance 1e-8 (planar) and 1e-7 (spatial).


SIDE, DENSITY = 1.0, 2.0
WEIGHT = DENSITY * SIDE**3


def stack(
    cubes: int,
    direction: tuple[float, float],
    *,
    friction: float,
    tension: float,
    shear: float,
    base: str,
    **options: Any,
) -> LimitAnalysisResult:
    """Spatial stack of unit cubes; labels: the base as said, between cubes inner. Strengths as multiples of W/A."""
    elements = [box(f"b{k}", [0, 0, k], [1, 1, k + 1]) for k in range(cubes)]
    elements.append(box("ground", [-1, -1, -1], [2, 2, 0], support=True))
    pairs = [[f"b{k}", f"b{k + 1}"] for k in range(cubes - 1)]
    document = {
        "elements": elements,
        "materials": dry_and_inner(DENSITY, friction, tension * WEIGHT, shear * WEIGHT, gravity=1.0),
        "loads": {"live": [{"body": [*direction, 0.0]}]},
        "labels": {"inner": pairs + ([["b0", "ground"]] if base == "inner" else [])},
    }
    return solve(build_assembly(parse_scene(document)), **options)


def planar_stack(friction: float, tension: float, shear: float) -> LimitAnalysisResult:
    document = {
        "grid": {"cell": [1, 1], "thickness": 1, "rows": ["a", "a", "#"]},
        "materials": dry_and_inner(DENSITY, friction, tension * WEIGHT, shear * WEIGHT, gravity=1.0),
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return solve(build_assembly(parse_scene(document)))


@pytest.mark.parametrize("angle", range(16))
def test_one_block_shears_off_alike_in_every_direction(angle: int) -> None:
    """3.2a: λ = τA/W in 16 horizontal directions, opening being farther in each."""
    turn = 2.0 * np.pi * angle / 16
    shear, tension = 0.2, 1.0  # opening at (1 + σtA/W)/3 along an edge, never below 0.47 on a diagonal
    result = stack(1, (np.cos(turn), np.sin(turn)), friction=0.5, tension=tension, shear=shear, base="inner")
    assert result.load_factor == pytest.approx(shear, rel=1e-7)
    assert result.gap < 1e-6


@pytest.mark.sampled(2)
@pytest.mark.parametrize("tension", [0.0, 0.25, 0.5, 1.0])
def test_map_of_two_cubes(tension: float) -> None:
    """3.2b: λ = min(μ, 1/2, τA/W, (1 + σtA/W)/3) over a map of (μ, τA/W), and the mechanism of each region.

    With σt = 0 the opening at 1/3 always comes before base rocking, which governs for σtA > W/2 only.
    """
    for friction, shear in itertools.product((0.1, 0.3, 0.45, 0.7), (0.05, 0.2, 0.4, 0.8)):
        borders = {
            ("base", mechanism.Movement.SLIDE): friction,
            ("base", mechanism.Movement.HINGE): 0.5,
            ("inner", mechanism.Movement.CRACK_SHEAR): shear,
            ("inner", mechanism.Movement.CRACK_TENSION): (1.0 + tension) / 3.0,
        }
        governing = min(borders, key=lambda kind: borders[kind])
        result = planar_stack(friction, tension, shear)
        assert result.load_factor == pytest.approx(borders[governing], rel=1e-8)
        moving = {
            ("base" if dry else "inner", motion.kind)
            for dry, motion in zip(result.labels, mechanism.face_motions(result), strict=True)
            if motion.kind is not mechanism.Movement.CLOSED
        }
        ties = [kind for kind, value in borders.items() if value < borders[governing] + 1e-9]
        assert moving == {governing} if len(ties) == 1 else moving <= set(ties)


@pytest.mark.parametrize(
    ("friction", "shear", "tension"), [(0.2, 0.9, 0.6), (0.9, 0.9, 1.0), (0.9, 0.3, 0.6), (0.9, 0.9, 0.2)]
)
def test_two_spatial_cubes(friction: float, shear: float, tension: float) -> None:
    """One point of each region of the map in space, convex and concave contact alike."""
    expected = min(friction, 0.5, shear, (1.0 + tension) / 3.0)
    for contact in ("convex", "concave"):
        result = stack(2, (1.0, 0.0), friction=friction, tension=tension, shear=shear, base="dry", contact=contact)
        assert result.load_factor == pytest.approx(expected, rel=1e-7)


def test_bending_forms_differ_on_the_diagonal() -> None:
    """docs/method.md (2.6): two cubes at 45°, σt = 0: √2/3 by the paper’s uncoupled form, half of it by the kern."""
    turn = (np.sqrt(0.5), np.sqrt(0.5))
    loads = {"friction": 5.0, "tension": 0.0, "shear": 9.0, "base": "dry"}
    assert stack(2, turn, **loads).load_factor == pytest.approx(np.sqrt(2) / 3, rel=1e-7)
    assert stack(2, turn, **loads, inner_bending="kern").load_factor == pytest.approx(np.sqrt(2) / 6, rel=1e-7)


# The machinery of the benchmarks, each on its smallest scene, so that none of them rots unseen.


def test_hard_cases() -> None:
    cases = [case for case in all_hard_cases() if case.name in ("N, mm", "inside the cone", "-1e-06")]
    verdicts = [hard_cases.judge(case) for case in cases]
    assert [verdict.right for verdict in verdicts] == [True] * 3
    assert [hard_cases.row_of(verdict)[2] for verdict in verdicts] == ["collapse", "locked", "unstable"]


def test_a_search_beside_the_plain_way() -> None:
    scene = grid(GRIDS[33], search={"block_cells": [2, 6]})
    _, labellings, values = commands.studied(scene, 12)
    assembly, place = build_assembly(scene), int(np.flatnonzero(np.isfinite(values))[0])
    assert len(labellings) == 12
    assert values[place] == pytest.approx(commands.plainly(assembly, labellings[place])[1], rel=1e-5)


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
