"""A block in a corner at friction of exactly 45°: a self-stress on the boundary of both cones, docs/method.md (3.12).

The floor pushes up and away from the wall, the wall pushes away and down; at μ = 1 both forces are opposite and on the
boundary of their cones. The block can then move along (1, 0, 1) alone, so λ (lx + lz) = 1 for a live load
(lx, ly, lz) times its weight.
"""

from __future__ import annotations

import numpy as np
import pytest

import cases
from jld_core import Assembly, LimitAnalysis, Status, solve
from jld_core.limit.facial_reduction import FacialReduction, SelfStress

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
    bases = {int(k): jumps[k][:, None] / np.linalg.norm(jumps[k]) for k in wedged}
    found = FacialReduction(analysis.template, analysis.prover)._measured(velocity, 1.0, labels, bases)
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
