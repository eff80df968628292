"""Jumps, their names, flow rules and work balance of mechanisms, planar and spatial."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from studies.by_scheme import solve_zero_dilation

import cases
from cases import CASES, all_inner, box, grid_assembly
from command import SCENES
from jld_core import (
    Assembly,
    LimitAnalysis,
    LimitAnalysisResult,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    solve,
)
from jld_core.limit import face_jumps, mechanism
from jld_core.limit.facial_reduction import FacialReduction, SelfStress
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
        (lambda: on_ground(0.3, PUSH), mechanism.Movement.SLIDE),
        (lambda: on_ground(2.0, PUSH), mechanism.Movement.HINGE),
        (lambda: on_ground(0.3, TWIST), mechanism.Movement.TWIST),
        (lambda: on_ground(0.3, LIFT), mechanism.Movement.OPEN),
        (lambda: on_ground(0.3, PUSH, tensile_strength=50.0, shear_strength=0.2), mechanism.Movement.CRACK_SHEAR),
        (lambda: on_ground(0.3, LIFT, tensile_strength=0.5, shear_strength=9.0), mechanism.Movement.CRACK_TENSION),
        (lambda: on_ground(0.3, PUSH, tensile_strength=0.5, shear_strength=9.0), mechanism.Movement.CRACK_TENSION),
        (lambda: on_ground(0.3, TWIST, tensile_strength=50.0, shear_strength=0.2), mechanism.Movement.CRACK_SHEAR),
    ],
)
def test_names(result: Any, kind: mechanism.Movement) -> None:
    found = result()
    (motion,) = mechanism.face_motions(found)
    assert motion.kind is kind
    assert motion.size > 0.0
    assert work_balance(found).error <= 1e-7
    rule = flow_rule(found)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.max() <= 1e-7


def test_place_of_a_hinge_and_closed_faces() -> None:
    rocking = on_ground(2.0, PUSH)
    assert mechanism.face_motions(rocking)[0].place == pytest.approx([1.0, 0.5, 0.0])
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
        frozenset((ids[a], ids[b])): k.kind
        for a, b, k in zip(faces.a, faces.b, mechanism.face_motions(result), strict=True)
    }
    assert kinds[frozenset(("top", "low"))] is mechanism.Movement.SLIDE
    assert kinds[frozenset(("low", "ground"))] is mechanism.Movement.CLOSED
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
    kinds = {motion.kind for motion in mechanism.face_motions(result)}
    assert kinds <= {
        mechanism.Movement.CLOSED,
        mechanism.Movement.HINGE,
        mechanism.Movement.SLIDE,
        mechanism.Movement.OPEN,
    }
    assert mechanism.Movement.CLOSED in kinds


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
    for function in (mechanism.face_motions, flow_rule, work_balance):
        with pytest.raises(ValueError, match="no mechanism"):
            function(result)
    assert np.isnan(result.load_factor)


# Scenes without any dead load: the bracket is ordered, λ = 0 is not proven to be above 0, λ is that of strengths.


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


@pytest.mark.sampled(4)
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


# A block in a corner at friction of exactly 45°: a self-stress on the boundary of both cones, docs/method.md (3.12).


TURNS = {"upright": np.eye(3), "turned": cases.rotation(0.3, 0.2, 0.5)}


def corner(live: list[float], turn: str = "upright", friction: float = 1.0) -> Assembly:
    rotation = TURNS[turn]
    elements = [
        cases.box("block", [0, 0, 0], [1, 1, 1], rotation),
        cases.box("floor", [-1, -1, -1], [3, 2, 0], rotation, support=True),
        cases.box("wall", [-1, 0, 0], [0, 1, 1], rotation, support=True),
    ]
    materials = {"dry": {"friction_coefficient": friction}, "gravity": (rotation @ [0.0, 0.0, -1.0]).tolist()}
    return cases.assembly_in_space(elements, materials=materials, live=[{"body": (rotation @ live).tolist()}])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    "live", [[0, 0, 1], [1, 0, 0], [1, 0, 1], [1, 0, -0.5], [0.5, 0, 1], [1, 0.3, 0], [0.6, -0.2, 0.7]]
)
def test_upper_bound_where_self_stress_is_on_the_boundary_of_friction(live: list[float], turn: str) -> None:
    """At 0.2 nine of these fourteen had no upper bound."""
    result = solve(corner(live, turn))
    expected = 1.0 / (live[0] + live[2])
    assert result.status is Status.COLLAPSE
    low, high = result.bracket
    assert low <= expected * (1.0 + 1e-12)
    assert high >= expected * (1.0 - 1e-12)
    assert result.load_factor == pytest.approx(expected, rel=1e-6)
    block = TURNS[turn].T @ result.mechanism[0, :3]
    assert block == pytest.approx(np.array([1.0, 0.0, 1.0]) * expected, abs=1e-6)


@pytest.mark.parametrize("friction", [0.9999, 0.6])
def test_below_45_degrees_the_block_slides_or_lifts(friction: float) -> None:
    """No self-stress: pulled from the wall it slides up at the angle of friction, λ = μ."""
    result = solve(corner([1, 0, 0], friction=friction))
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(friction, rel=1e-6)


@pytest.mark.parametrize(("friction", "opens"), [(1.0, True), (1.0 + 1e-9, False)])
def test_fast_motion_elsewhere_excuses_no_closing_jump(friction: float, opens: bool) -> None:
    """Jumps that close by 1e-9 of themselves counted as rounding beside the speed, 1e4, of a block far away."""
    elements = [
        cases.box("block", [0, 0, 0], [1, 1, 1]),
        cases.box("far", [5, 0, 0], [6, 1, 1]),
        cases.box("floor", [-1, -1, -1], [9, 2, 0], support=True),
        cases.box("wall", [-1, 0, 0], [0, 1, 1], support=True),
    ]
    materials = {"dry": {"friction_coefficient": friction}}
    assembly = cases.assembly_in_space(elements, materials=materials, live=[{"body": [0, 0, 1]}])
    analysis = LimitAnalysis(assembly)
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    velocity = np.array([1.0, 0, 1, 0, 0, 0, 0, 0, 1e4, 0, 0, 0])
    jumps = (analysis.prover.transposed @ velocity).reshape(len(labels), 6)
    wedged = np.flatnonzero((assembly.interfaces.a == 0) | (assembly.interfaces.b == 0))
    ways = jumps[wedged] / np.linalg.norm(jumps[wedged], axis=1, keepdims=True)
    onto = ways[:, :, None] * ways[:, None, :]
    found = FacialReduction(analysis.template, analysis.prover)._measured(velocity, 1.0, labels, (wedged, onto))
    assert (found.margin >= 0.0) is opens


def test_above_45_degrees_the_block_is_wedged() -> None:
    result = solve(corner([1, 0, 0], friction=1.01))
    assert result.status is Status.LOCKED


def test_ray_on_the_boundary_of_friction() -> None:
    """Pushed along the angle of friction a block carries any load: the ray is on the boundary of both cones."""
    analysis = LimitAnalysis(corner([1, 0, -1]))
    labels = np.ones(len(analysis.assembly.interfaces), dtype=bool)
    assert solve(analysis.assembly).status is Status.LOCKED
    ray = analysis.repair.ray(labels)
    assert ray is not None
    assert analysis.prover.is_ray(ray)


@pytest.mark.parametrize("turn", TURNS)
def test_forces_that_grow_with_the_square_of_the_load_factor_lock(turn: str) -> None:
    """Along the wall λ grows without end, though no direction of forces carries it: more of it needs a wedge as λ²."""
    result = solve(corner([0, 1, 0], turn))
    assert result.status is Status.LOCKED
    assert "ray beside self-stress" in result.solve_log
    assert any("square of the load factor" in note for note in result.notes)


def test_square_growth_is_admissible_at_every_load_factor() -> None:
    """F + λ R₁ + t R is within both cones for t ~ λ², weighed here by the formula of the cones."""
    analysis = LimitAnalysis(corner([0, 1, 0]))
    labels = np.ones(2, dtype=bool)
    beside = SelfStress(analysis.prover, labels)
    ray, inside = beside.ray(), analysis.repair.state(labels)
    stress = beside.stages[0].stresses[0][:12].reshape(2, 6)
    assert analysis.prover.imbalance(stress.ravel(), np.zeros(6)) < 1e-14
    for load in (1e1, 1e2, 1e3):
        forces = inside.forces + (load - inside.load) * ray.forces + 10.0 * load**2 * stress
        left = analysis.template.matrix @ forces.ravel() + analysis.template.dead + load * analysis.template.live
        assert abs(left).max() < 1e-15 * abs(forces).max()
        assert analysis.template.yield_set.slack(forces, labels).min() > 0.0


def test_state_beside_self_stress_reaches_the_load_factor() -> None:
    """λ = 1/(lx + lz) needs a self-stress without end; with one of 1e8 the lower bound stays 2e-7 below."""
    analysis = LimitAnalysis(corner([0.3, 1, -0.2]))
    labels = np.ones(2, dtype=bool)
    answer = analysis.repair._largest_slack_solution(labels).point[: analysis.template.columns]
    loads = [
        state.load * analysis.template.scaling.load
        for state in SelfStress(analysis.prover, labels).states(answer)
        if state.admissible
    ]
    assert max(loads) <= 10.0
    assert max(loads) == pytest.approx(10.0, rel=5e-8)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("live", [[0, 1, 0], [1, 0, -1], [0.3, 1, -0.3]])
@pytest.mark.parametrize("friction", [1.0 - 1e-13, 1.0 - 1e-9])
def test_friction_below_45_degrees_is_not_locked(friction: float, live: list[float]) -> None:
    """A ray along the angle of friction is outside of both cones by 1e-13, and λ is 1e13: neither locked nor proven."""
    assert solve(corner([1, 0, -1])).status is Status.LOCKED
    result = solve(corner(live, friction=friction))
    assert result.status is Status.UNCERTIFIED
    assert result.reason is not None


def test_friction_above_45_degrees_does_not_collapse() -> None:
    """At 1 + 2e-12 the block is wedged, by forces of 1e12: λ = 1 of 45° is no upper bound."""
    for friction in (1.0 + 1e-13, 1.0 + 2e-12, 1.0 + 1e-9):
        result = solve(corner([1, 0, 0], friction=friction))
        assert result.status is not Status.COLLAPSE
        assert not result.bracket[1] <= 1.0 + 1e-6


def test_reason_is_given_where_a_bound_is_missing() -> None:
    result = solve(corner([0, 1, 0], friction=1.0 - 1e-9))
    assert result.status is Status.UNCERTIFIED
    assert result.reason.startswith("no upper bound: ")
    assert result.reason in result.to_json()["warnings"]


def test_no_reason_where_nothing_is_missing() -> None:
    result = solve(corner([1, 0, 0]))
    assert result.reason is None
    assert result.to_json()["warnings"] == list(result.assembly.warnings)
