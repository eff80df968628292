"""Jumps, their names, flow rules and work balance of mechanisms, planar and spatial."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from studies.by_scheme import solve_zero_dilation

import cases
from cases import CASES, grid_assembly
from command import SCENES
from jld_core import LimitAnalysisResult, build_assembly, load_scene, parse_scene, solve
from jld_core.limit import face_jumps
from jld_core.limit.mechanism import Movement, face_motions
from proofs import flow_rule, work_balance


def on_ground(friction: float, live: list[dict[str, Any]], **inner: float) -> LimitAnalysisResult:
    """A cube of weight 1 on a larger ground, spatial, its base dry or, with strengths, inner."""
    elements = [cases.box("cube", [0, 0, 0], [1, 1, 1]), cases.box("ground", [-1, -1, -1], [2, 2, 0], support=True)]
    materials: dict[str, Any] = {"dry": {"friction_coefficient": friction}}
    if inner:
        materials["inner"] = inner
    labels = {"default": "inner" if inner else "dry", "inner": [["cube", "ground"]] if inner else []}
    return solve(cases.assembly_in_space(elements, live=live, materials=materials, labels=labels))


PUSH: list[dict[str, Any]] = [{"body": [1, 0, 0]}]
TWIST: list[dict[str, Any]] = [{"element": "cube", "force": [0, 0, 0], "moment": [0, 0, 1]}]
LIFT: list[dict[str, Any]] = [{"element": "cube", "force": [0, 0, 1]}]


@pytest.mark.parametrize(
    ("result", "kind"),
    [
        (lambda: on_ground(0.3, PUSH), Movement.SLIDE),
        (lambda: on_ground(2.0, PUSH), Movement.HINGE),
        (lambda: on_ground(0.3, TWIST), Movement.TWIST),
        (lambda: on_ground(0.3, LIFT), Movement.OPEN),
        (lambda: on_ground(0.3, PUSH, tensile_strength=50.0, shear_strength=0.2), Movement.CRACK_SHEAR),
        (lambda: on_ground(0.3, LIFT, tensile_strength=0.5, shear_strength=9.0), Movement.CRACK_TENSION),
        (lambda: on_ground(0.3, PUSH, tensile_strength=0.5, shear_strength=9.0), Movement.CRACK_TENSION),
        (lambda: on_ground(0.3, TWIST, tensile_strength=50.0, shear_strength=0.2), Movement.CRACK_SHEAR),
    ],
)
def test_names(result: Any, kind: Movement) -> None:
    found = result()
    (motion,) = face_motions(found)
    assert motion.kind is kind
    assert motion.size > 0.0
    assert work_balance(found).error <= 1e-7
    rule = flow_rule(found)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.max() <= 1e-7


def test_place_of_a_hinge_and_closed_faces() -> None:
    rocking = on_ground(2.0, PUSH)
    assert face_motions(rocking)[0].place == pytest.approx([1.0, 0.5, 0.0])
    sliding_top = {
        "elements": [
            {"id": "top", "polygon": [[0, 1], [2, 1], [2, 2], [0, 2]], "weight": 1.0},
            {"id": "low", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]], "weight": 1.0},
            {"id": "ground", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": 0.3}},
        "loads": {"live": [{"element": "top", "force": [1, 0]}]},
    }
    result = solve(build_assembly(parse_scene(sliding_top)))
    faces, ids = result.assembly.interfaces, result.assembly.elements.ids
    kinds = {
        frozenset((ids[a], ids[b])): k.kind for a, b, k in zip(faces.a, faces.b, face_motions(result), strict=True)
    }
    assert kinds[frozenset(("top", "low"))] is Movement.SLIDE
    assert kinds[frozenset(("low", "ground"))] is Movement.CLOSED
    assert result.mechanism is not None
    assert face_jumps(result.assembly, result.mechanism).shape == (2, 3)


@pytest.mark.parametrize("name", CASES)
def test_planar_cases_balance_and_flow(name: str) -> None:
    rows, options = CASES[name]
    result = solve(grid_assembly(rows, **options))
    if result.mechanism is None or result.forces is None or abs(result.load_factor) < 1e-6:
        return
    assert work_balance(result).error <= 1e-7
    rule = flow_rule(result)
    work = abs(result.load_factor)
    assert rule.margin.min() >= -1e-12 * abs(result.mechanism).max()
    assert rule.gap.min() >= -1e-9 * work
    assert rule.gap.sum() == pytest.approx(result.bracket[1] - result.bracket[0], abs=1e-9 * work)


@pytest.mark.parametrize("name", ["ferris_tinloi_1", "ferris_tinloi_2", "ferris_tinloi_4"])
@pytest.mark.parametrize("friction", ["associative", "zero-dilation"])
def test_walls_balance_and_flow(name: str, friction: str) -> None:
    assembly = build_assembly(load_scene(SCENES / f"{name}.json"))
    result = solve(assembly) if friction == "associative" else solve_zero_dilation(assembly)
    assert work_balance(result).error <= 1e-7
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-12
    assert rule.gap.min() >= -1e-9
    assert rule.gap.sum() == pytest.approx(result.bracket[1] - result.bracket[0], abs=1e-9)
    kinds = {motion.kind for motion in face_motions(result)}
    assert kinds <= {Movement.CLOSED, Movement.HINGE, Movement.SLIDE, Movement.OPEN}
    assert Movement.CLOSED in kinds


@pytest.mark.parametrize("name", ["spatial_cubes", "spatial_shelf"])
def test_mechanisms_of_spatial_scenes_balance_and_obey_the_flow_rule(name: str) -> None:
    result = solve(build_assembly(load_scene(SCENES / f"{name}.json")))
    assert work_balance(result).error <= 1e-7
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.min() >= -1e-9


def test_results_without_mechanism_are_refused() -> None:
    rows, options = CASES["overhang"]
    result = solve(grid_assembly(rows, **options))
    for function in (face_motions, flow_rule, work_balance):
        with pytest.raises(ValueError, match="no mechanism"):
            function(result)
    assert np.isnan(result.load_factor)
