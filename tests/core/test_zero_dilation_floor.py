"""The bound below every solution without dilation: controls in closed form, small walls, certificates that refuse.

Two cubes rock at 1/2 (Iannuzzo et al. 2024, section 3.2b); walls whose ground course slides do so at μ = 0.65; the
lowest value of the wall of 2 × 5 bricks is where a search from every side ends (test_zero_dilation.py), and this
bound meets it from below by another route.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from studies.families import halved_bond, opened_wall, random_wall
from studies.scenes import leonardo_flat_arch, stacked_cubes

from cases import CASES, grid_assembly, grid_document
from jld_core import Assembly, LimitAnalysis, Scene, build_assembly, parse_scene, solve
from jld_dilation import ProximalOptions
from jld_dilation.certificate import BlockCertifier, Certifier, solve_rlt_by_matrix_blocks
from jld_dilation.modes import BoundedModes, Statics, bound_velocities, face_loops, has_opening, modes_of
from jld_dilation.range import LowerBoundSearch
from jld_dilation.rlt_relaxation import LowerBoundProblem, RltOptions, solve_rlt
from jld_dilation.sweep import BlockSweep, MultiStartSearch
from proofs import block


def below(assembly: Assembly, seconds: float = 60.0) -> tuple[float, Any, float]:
    """Lowest found, the floor (scaled), and the scale of λ."""
    analysis = LimitAnalysis(assembly)
    side = MultiStartSearch(analysis, assembly.labels, ProximalOptions(), analysis.prove(assembly.labels))
    found = side.search(thorough=False)
    assert side.modes is not None
    search = LowerBoundSearch(analysis, assembly.labels, side.modes, LowerBoundProblem(found.lowest_load, seconds))
    return found.lowest.state.load, search.search(), analysis.template.scaling.load


@pytest.mark.parametrize(
    ("assembly", "value"),
    [
        (stacked_cubes(2, friction=0.6, tension=2.0, shear=1.0), 0.5),
        (halved_bond(1, 1), 0.65),
        (halved_bond(1, 2), 0.65),
        (halved_bond(2, 2), 0.65),
        (leonardo_flat_arch(), 1305.8653333),
        (halved_bond(2, 5), 0.6112956811),
    ],
    ids=["two cubes", "1x1", "1x2", "2x2", "flat arch", "2x5"],
)
def test_the_lowest_found_is_the_lowest_there_is(assembly: object, value: float) -> None:
    lowest, floor, scale = below(build_assembly(assembly))
    assert lowest * scale == pytest.approx(value, rel=1e-7)
    assert floor.closed
    assert floor.tolerance == 0.0
    assert floor.bound == floor.proven
    assert floor.proven <= lowest * (1.0 + 1e-9)
    assert floor.proven * scale >= value * (1.0 - 1e-6)


def test_a_block_lifted_along_one_wall() -> None:
    """λ = W + μH, by statics alone: N of the wall is H in every state."""
    assembly = block(0.3, [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [0.8, 0]}], 1)
    _, floor, scale = below(assembly)
    assert floor.tolerance == 0.0
    assert floor.proven * scale == pytest.approx(1.24, rel=1e-6)


def test_unbounded_self_stress_has_the_cheap_bound_alone() -> None:
    """A wedged block: λ = W + μ(H + 2 N_left) with N_left ≥ 0, and N_right = H + N_left ≥ H is all that statics say."""
    assembly = block(0.3, [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [1.0, 0]}], 2)
    lowest, floor, scale = below(assembly)
    assert "no products: self-stress is not bounded" in floor.solve_log
    assert floor.proven * scale <= lowest * scale * (1.0 + 1e-9)


def test_inner_faces_and_supports() -> None:
    rows, options = CASES["beam"]
    lowest, floor, _ = below(grid_assembly(rows, **options), seconds=120.0)
    assert floor.tolerance == 0.0
    assert 0.0 < floor.proven <= lowest * (1.0 + 1e-9)


def test_crushing_is_refused() -> None:
    rows, options = CASES["crushable arch"]
    assembly = grid_assembly(rows, **options)
    assert modes_of(LimitAnalysis(assembly).template, assembly.labels) is None
    result = solve(assembly, friction="zero-dilation", range=True)
    assert result.facts["lowest_found"] is not None
    assert result.facts["lowest_proven"] is None
    assert not result.facts["proven"]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_no_solution_of_any_start_lies_below(seed: int) -> None:
    """Pivots from many seeds on one wall of three courses never go below what was proven from one."""
    assembly = build_assembly(halved_bond(2, 3, friction=0.3 + 0.2 * seed))
    lowest, floor, _ = below(assembly)
    assert floor.tolerance == 0.0
    analysis = LimitAnalysis(assembly)
    side = MultiStartSearch(analysis, assembly.labels, ProximalOptions(), analysis.prove(assembly.labels))
    for forces in np.random.default_rng(seed).normal(size=(6, side.fixed_point.count)):
        side.search_from(0.1 * forces)
    assert min(side.found.loads) >= floor.proven * (1.0 - 1e-9)
    assert floor.proven >= lowest * (1.0 - 1e-6)


# --- the certificate ------------------------------------------------------------------------------------------------


def certifier(assembly: Assembly, high: float, slack: float = 1e-8) -> tuple[Any, Any, BoundedModes, Certifier]:
    modes = modes_of(LimitAnalysis(assembly).template, assembly.labels)
    none = np.zeros(len(modes.rows), dtype=bool)
    bounded = BoundedModes.up_to(modes, high)
    region = bounded.region(0.0, high, none, none)
    return modes, region, bounded, Certifier(bounded, region, slack)


@pytest.fixture(scope="module")
def relaxation() -> tuple[Any, Any, BoundedModes, Certifier, Any, float]:
    """Two bricks on one, up to λ = 0.66: modes, region, bounds, certifier, solved relaxation and scale of λ."""
    assembly = build_assembly(halved_bond(1, 2))
    scale = LimitAnalysis(assembly).template.scaling.load
    modes, region, bounded, check = certifier(assembly, 0.66 / scale)
    pairs = np.ones((len(modes.rows), len(modes.forms)), dtype=bool)
    return modes, region, bounded, check, solve_rlt(bounded, region, RltOptions(pairs, 1e-8)), scale


def test_certificate_of_a_false_bound_is_refused(relaxation: Any) -> None:
    *_, check, relaxed, scale = relaxation
    true = check.bound(relaxed.multipliers)
    assert true * scale == pytest.approx(0.65, rel=1e-6)
    # a bound that is raised is lowered again or refused, never believed
    raised = check.bound(replace(relaxed.multipliers, bound=relaxed.multipliers.bound + 1e-3))
    assert raised <= 0.65 / scale
    emptied = replace(relaxed.multipliers, products=np.zeros_like(relaxed.multipliers.products))
    assert check.bound(emptied) <= 0.65 / scale
    noise = np.random.default_rng(0).uniform(0.0, 1e-3, relaxed.multipliers.products.shape)
    assert check.bound(replace(relaxed.multipliers, products=relaxed.multipliers.products + noise)) <= 0.65 / scale


@pytest.mark.long
def test_blocks_agree_with_the_library() -> None:
    """Blocks along the graph of velocities beside HiGHS row by row, with products with b_λ·u as well: what slack costs
    differs by that. On a wall of two courses nothing is farther than 9 faces; neighbours alone prove no more."""
    assembly = build_assembly(halved_bond(2, 2, friction=0.4))
    scale = LimitAnalysis(assembly).template.scaling.load
    modes, region, bounded, _ = certifier(assembly, 0.41 / scale, 1e-6)
    everything = np.ones((len(modes.rows), len(modes.forms)), dtype=bool)
    other = solve_rlt(bounded, region, RltOptions(everything, 1e-6))
    bounds = []
    for distance in (None, 9, 1):
        options = RltOptions(everything, 1e-6, 60.0, distance)
        own = solve_rlt_by_matrix_blocks(bounded, region, options)
        blocks = BlockCertifier(bounded, region, 1e-6, distance)
        bounds.append(own.multipliers.bound)
        assert -np.inf < blocks.bound(own.multipliers) <= 0.4 / scale
    assert bounds[0] == pytest.approx(other.multipliers.bound, rel=1e-5)
    assert bounds[0] <= other.multipliers.bound * (1.0 + 1e-6)
    assert bounds[1] == pytest.approx(bounds[0], rel=2e-6)
    assert bounds[2] <= bounds[0] * (1.0 + 1e-6)


@pytest.mark.parametrize("times", [1.0, 2.0], ids=["from the lowest found", "from far above"])
def test_the_first_step_of_large_scenes_excludes_a_part_of_the_way(times: float) -> None:
    """Two courses slide at μ. Up to three quarters of the way no solution lies; where one does, no more is claimed."""
    friction = 0.4
    assembly = build_assembly(halved_bond(2, 2, friction=friction))
    scale = LimitAnalysis(assembly).template.scaling.load
    _, _, bounded, _ = certifier(assembly, 1.1 * times * friction / scale)
    problem = LowerBoundProblem(times * friction / scale, 60.0)
    proven = BlockSweep(bounded, problem).partial_bound(0.0) * scale
    assert problem.solve_log == ["part of the way"]
    least = 0.98 * min(0.75 * times, 1.0) * friction
    assert least <= proven <= min(0.75 * times, 1.0) * friction


OPENED = opened_wall(0, 1)


@pytest.mark.long
def test_walls_with_openings_have_a_floor() -> None:
    """Three bricks and one opening, 19 faces: without what loops say of slides the root of the relaxation is zero, and
    what is found here was met by branches alone."""
    lowest, floor, scale = below(build_assembly(OPENED))
    assert lowest * scale == pytest.approx(0.5570290662, rel=1e-8)
    assert floor.closed
    assert floor.tolerance == 0.0
    assert "branch 1" not in floor.solve_log


def solutions(assembly: Assembly) -> tuple[Any, list[np.ndarray]]:
    """Every certified mechanism that a search from every side keeps, as (u, t) with t = max(0, −s)."""
    analysis = LimitAnalysis(assembly)
    side = MultiStartSearch(analysis, assembly.labels, ProximalOptions(), analysis.prove(assembly.labels))
    found = side.search()
    assert side.modes is not None
    out = []
    for pair in (found.lowest, found.highest):
        slips = pair.motion.jumps[:, 1]
        out.append(np.concatenate([pair.motion.velocity, np.maximum(0.0, -slips)]))
    return side.modes, out


@pytest.mark.parametrize(
    "assembly", [build_assembly(OPENED), grid_assembly(["ab", "cc", "##"])], ids=["opened", "grid"]
)
def test_conditions_of_loops_hold_in_solutions(assembly: Assembly) -> None:
    modes, mechanisms = solutions(assembly)
    assert len(modes.loops) > 0
    # around a loop the jumps add up to nothing: the two forms of a pair differ by an identity
    assert abs((modes.loops[::2] - modes.loops[1::2]) @ modes.rates).max() < 1e-12
    for w in mechanisms:
        size = abs(modes.rates @ w).max()
        assert (modes.forms @ w).min() > -1e-6 * size
    # and it says something: both slides of one face alone at once are no mechanism
    both = np.zeros(len(modes.rates))
    face = int(np.argmin(modes.loops[0])) // 4
    both[4 * face + 2 : 4 * face + 4] = 1.0
    assert (modes.loops @ both).min() == -1.0


@pytest.mark.parametrize(
    ("scene", "is_opened"),
    [
        (halved_bond(2, 3), False),
        (halved_bond(8, 10), False),
        (opened_wall(0, 1), True),
        (opened_wall(1, 1, 2), True),
        (opened_wall(8, 12), True),
        (leonardo_flat_arch(), True),
    ],
    ids=["bond", "many blocks", "opening", "opening of two courses", "many blocks and an opening", "flat arch"],
)
def test_openings_are_loops_that_short_ones_do_not_fill(scene: Scene, is_opened: bool) -> None:
    assembly = build_assembly(scene)
    assert has_opening(assembly) == is_opened
    lengths = {len(loop) for loop in face_loops(assembly)}
    assert lengths <= {2, 3, 4}


def test_loops_of_a_bond_tie_slides_to_the_joint_between() -> None:
    """Two bricks on one: s_f − s_g is the opening of the joint between them at the edge they share with it, so that
    s_g⁺ ≤ s_f⁺ ≤ s_g⁺ + z and the same of s⁻ the other way round: coefficients are ±1."""
    assembly = build_assembly(halved_bond(1, 2))
    modes = modes_of(LimitAnalysis(assembly).template, assembly.labels)
    values = modes.loops[modes.loops != 0.0]
    assert abs(values) == pytest.approx(np.ones(len(values)), abs=1e-9)


def test_a_false_loop_proves_nothing(relaxation: Any) -> None:
    """What the identity of a loop leaves is charged: coefficients off by a hundredth bring no bound above the truth."""
    modes, region, bounded, check, relaxed, scale = relaxation
    assert check.loop_errors.max() < 1e-10
    wrong = replace(modes)
    vars(wrong)["loops"] = np.where(modes.loops > 0.0, 0.99 * modes.loops, modes.loops)
    false = Certifier(replace(bounded, modes=wrong), region, 1e-8)
    assert false.loop_errors.max() > 1e-3
    used = relaxed.multipliers.products[:, len(modes.rows) :].max() > 1e-6
    assert not used or false.bound(relaxed.multipliers) <= 0.65 / scale


def test_velocities_stay_within_their_reach() -> None:
    """|u| and t of solutions, found by pivots, against the bound that the certificate charges residuals to."""
    assembly = build_assembly(halved_bond(2, 3))
    analysis = LimitAnalysis(assembly)
    side = MultiStartSearch(analysis, assembly.labels, ProximalOptions(), analysis.prove(assembly.labels))
    found = side.search()
    most = 1.01 * found.highest.state.load if found.highest is not None else 0.0
    statics = Statics(side.modes, 0.0, most, np.zeros(len(side.modes.rows), dtype=bool))
    limit = bound_velocities(statics)
    for pair in (found.lowest, found.highest):
        width = len(side.modes.dead)
        slips = pair.motion.jumps[:, 1]
        w = np.concatenate([pair.motion.velocity, np.maximum(0.0, -slips)])
        z = side.modes.rates @ w
        phi = np.concatenate([pair.state.forces.ravel(), [pair.state.load, 1.0]])
        cost = z[side.modes.hinges].sum() + (side.modes.capacities @ phi) @ abs(slips)
        assert np.all(abs(pair.motion.velocity) <= limit[:width] * cost)
        assert np.all(abs(slips) <= limit[width:] * cost)
        assert np.all(abs(phi) <= statics.force_bounds * (1.0 + 1e-9))


def test_bounds_of_statics_hold_for_random_states() -> None:
    assembly = build_assembly(random_wall(1))
    modes = modes_of(LimitAnalysis(assembly).template, assembly.labels)
    statics = Statics(modes, 0.0, 0.2, np.zeros(len(modes.rows), dtype=bool))
    rng = np.random.default_rng(0)
    for _ in range(20):
        way = np.append(rng.normal(size=modes.matrix.shape[1] + 1), 0.0)
        low, high = statics.least(way), -statics.least(-way)
        assert low <= high
        assert high <= float(abs(way) @ statics.force_bounds) * (1.0 + 1e-9)


def test_a_face_that_nothing_can_press() -> None:
    """A cell without weight on top of another: all rows of the joint between them are zero."""

    def cell(x: float, y: float) -> list[list[float]]:
        return [[x, y], [x + 0.1, y], [x + 0.1, y + 0.1], [x, y + 0.1]]

    document = grid_document(["##"], tension=0.0, shear=0.0)
    del document["grid"]
    document["thickness"] = 0.1
    document["elements"] = [
        {"id": "left", "polygon": cell(0.0, 0.1)},
        {"id": "right", "polygon": cell(0.1, 0.1)},
        {"id": "hat", "polygon": cell(0.0, 0.2), "weight": 0},
        {"id": "ground", "polygon": [[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]], "support": True},
    ]
    document["loads"]["live"] = [{"element": "right", "force": [13.5636, -11.7106], "at": [0.167843, 0.117409]}]
    document["labels"] = {"default": "dry", "inner": [["left", "ground"]]}
    result = solve(build_assembly(parse_scene(document)), friction="zero-dilation", range=True, floor_seconds=60.0)
    assert result.facts["lowest_proven"] <= result.facts["lowest_found"] * (1.0 + 1e-9)
    assert result.facts["closed"]
