"""The bound below every spatial solution without dilation: cubes in closed form, parity with the plane, certificates.

A unit cube pushed by λ times its weight slides at μ, and topples at b/h over the cosine between the push and the normal
of its edge. Where a polygon stands for the circle of friction, the rate of slip may fall short of |s|, and the bound of
the products alone with it: by cos 45° for a square and a push along its diagonal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls
from studies.families import halved_bond
from studies.spatial_bound import range_in_space
from studies.spatial_bound.certificate import SpaceCertifier
from studies.spatial_bound.lower_bound import SpaceLowerBoundSearch
from studies.spatial_bound.modes import (
    AXES,
    SpaceModes,
    space_modes_of,
    unit_direction,
    widest,
    with_direction,
)
from studies.spatial_bound.rlt_relaxation import SpaceRltSolution, solve_space_rlt
from studies.spatial_bound.statics import SpaceStatics, bound_space_velocities

from cases_spatial import assembly as spatial
from cases_spatial import box
from jld_core import Assembly, LimitAnalysis, build_assembly, load_scene, solve
from jld_core.arrays import Floats
from jld_core.geometry.polygons import rectangle_torsion_length
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.lower_bound_problem import LowerBoundProblem
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.rlt_relaxation import Region
from paths import SCENES

GROUND = box("ground", [-3.0, -3.0, -0.5], [9.0, 3.0, 0.0], support=True)


def cubes(count: int, friction: float, degrees: float, inner: bool = False) -> Assembly:
    """Cubes on one another, pushed under an angle to x; inner: glued to one another."""
    angle = np.radians(degrees)
    elements = [GROUND, *(box(f"b{k}", [0, 0, k], [1, 1, k + 1]) for k in range(count))]
    glued = {"labels": {"inner": [[f"b{k}", f"b{k + 1}"] for k in range(count - 1)]}} if inner else {}
    return spatial(
        elements,
        materials={"dry": {"friction_coefficient": friction}},
        live=[{"body": [float(np.cos(angle)), float(np.sin(angle)), 0.0]}],
        **glued,
    )


def extruded(
    bricks: int, courses: int, live: tuple[float, float, float] = (1.0, 0.0, 0.0), depth: float = 2.0
) -> Assembly:
    """`halved_bond` with a depth."""
    elements = [GROUND]
    for element in halved_bond(bricks, courses).elements[1:]:
        low, high = np.min(element.polygon, axis=0), np.max(element.polygon, axis=0)
        elements.append(box(element.id, [low[0], 0.0, low[1]], [high[0], depth, high[1]]))
    return spatial(elements, materials={"dry": {"friction_coefficient": 0.65}}, live=[{"body": list(live)}])


def program(
    assembly: Assembly, directions: Floats = AXES, slack: float = 1e-8
) -> tuple[SpaceModes, Region, SpaceStatics, SpaceRltSolution, SpaceCertifier, float]:
    """The root program of a labelling with all rows, its certifier, and the scale of λ."""
    analysis = LimitAnalysis(assembly)
    high = 1.02 * analysis.prove(assembly.labels).bracket[1]
    modes = space_modes_of(analysis.template, assembly.labels, (directions,) * len(assembly.labels))
    assert modes is not None
    none = np.zeros(len(modes.rows), dtype=bool)
    statics = SpaceStatics(modes, 0.0, high, none)
    velocity_bounds = bound_space_velocities(statics)
    assert velocity_bounds is not None
    region = Region(0.0, high, statics.closed_modes(), none)
    pairs = np.ones((len(modes.rows), len(modes.rates)), dtype=bool)
    relaxed = solve_space_rlt(modes, region, statics.force_bounds, pairs, slack)
    assert relaxed is not None
    check = SpaceCertifier(modes, region, slack, statics.force_bounds, velocity_bounds)
    return modes, region, statics, relaxed, check, analysis.template.scaling.load


def ends(assembly: Assembly, seconds: float = 30.0, **options: Any) -> dict[str, Any]:
    extra = range_in_space(assembly, seconds, **options)
    assert extra["lowest_proven"] <= extra["lowest_found"] * (1.0 + 1e-9)
    assert extra["lowest_found"] <= extra["highest_found"]
    return extra


@pytest.mark.parametrize(
    ("count", "friction", "degrees", "value"),
    [
        (1, 0.3, 0.0, 0.3),
        (1, 0.3, 37.0, 0.3),
        (1, 1.5, 0.0, 1.0),
        (1, 1.5, 30.0, 1.0 / np.cos(np.pi / 6)),
        (2, 0.3, 20.0, 0.3),
        (2, 0.7, 0.0, 0.5),
        (3, 0.7, 0.0, 1.0 / 3.0),
    ],
)
def test_cubes_slide_at_friction_and_topple_at_their_slenderness(
    count: int, friction: float, degrees: float, value: float
) -> None:
    extra = ends(cubes(count, friction, degrees))
    assert extra["proven"]
    assert extra["closed"]
    assert extra["lowest_proven"] == pytest.approx(value, rel=1e-6)
    assert extra["lowest_found"] == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("contact", ["convex", "concave"])
def test_glued_cubes_topple_as_one(contact: str) -> None:
    extra = ends(cubes(2, 0.7, 0.0, inner=True), contact=contact)
    assert extra["closed"]
    assert extra["lowest_proven"] == pytest.approx(0.5, rel=1e-6)


# --- products alone -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2])
def test_products_lose_slip_along_the_diagonal_of_a_friction_square(count: int) -> None:
    """Of t ≥ max(|s1|, |s2|) alone |s| cos 45° would be left. With R s = −t V the products of C ∓ V with t ∓ s add
    t ≥ 2 |s_k| + V_k s_k / C for both k, so that t ≥ (2/3)(|s1| + |s2|), |s| √8/3 at the least; other products add
    to that. With a direction along the slip nothing is lost."""
    assembly = cubes(count, 0.3, 45.0)
    _, _, _, relaxed, check, scale = program(assembly)
    assert 0.3 * np.sqrt(8.0) / 3.0 <= check.bound(relaxed.multipliers) * scale <= 0.3 * (1.0 - 1e-3)
    sharper = with_direction(with_direction(AXES, np.array([1.0, 1.0])), np.array([-1.0, -1.0]))
    assert len(sharper) == 6
    _, _, _, relaxed, check, scale = program(assembly, sharper)
    assert check.bound(relaxed.multipliers) * scale == pytest.approx(0.3, rel=1e-6)


def test_products_alone_close_toppling_about_an_edge_and_the_given_cubes() -> None:
    _, _, _, relaxed, check, scale = program(cubes(2, 0.7, 30.0))
    assert check.bound(relaxed.multipliers) * scale == pytest.approx(0.5 / np.cos(np.pi / 6), rel=1e-6)
    _, _, _, relaxed, check, scale = program(build_assembly(load_scene(SCENES / "spatial_cubes.json")))
    assert check.bound(relaxed.multipliers) * scale == pytest.approx(0.3239796753, rel=1e-6)


def test_directions_stay_within_the_circle() -> None:
    rng = np.random.default_rng(0)
    for way in rng.normal(size=(50, 2)):
        d = unit_direction(way)
        assert 1.0 - 1e-12 <= float(np.hypot(*d)) <= 1.0
    assert widest(AXES) == pytest.approx(np.pi / 2)
    assert len(with_direction(AXES, np.array([-2.0, 0.0]))) == 4
    assert len(with_direction(AXES, np.array([-2.0, 1.0]))) == 5


# --- parity -----------------------------------------------------------------------------------------------------------


def test_a_wall_with_a_depth_has_the_bound_of_the_plane() -> None:
    """The ground course slides at μ, as in test_zero_dilation_floor.py; space has more solutions, none lower."""
    planar = solve(build_assembly(halved_bond(1, 2)), friction="zero-dilation", range=True).facts
    extra = ends(extruded(1, 2))
    assert extra["proven"]
    assert extra["closed"]
    assert extra["lowest_proven"] == pytest.approx(planar["lowest_proven"], rel=1e-6)
    assert extra["lowest_proven"] <= planar["lowest_found"] * (1.0 + 1e-9)


@pytest.mark.parametrize("live", [(0.6, 0.8, 0.0), (0.0, 1.0, 0.0)])
def test_a_brick_may_stand_on_one_of_two_halves(live: tuple[float, float, float]) -> None:
    """Its friction holds the turn of the push about that joint as well: λ = μ / (1 + e / c_T), by equilibrium alone."""
    extra = solve(extruded(1, 2, live=live, depth=1.0), friction="zero-dilation", range=True, floor_seconds=0.0).facts
    # the middle of a joint 2 × 1 is one from that of the brick
    turn = live[1] / float(rectangle_torsion_length(np.array([2.0]), np.array([1.0]))[0])
    assert extra["lowest_found"] == pytest.approx(0.65 / (1.0 + turn), rel=1e-6)
    assert extra["highest_found"] > 1.15 * extra["lowest_found"]


@pytest.mark.long
def test_the_lowest_of_a_wall_pushed_askew_is_proven() -> None:
    extra = ends(extruded(1, 2, live=(0.6, 0.8, 0.0), depth=1.0), seconds=60.0)
    assert extra["closed"]
    assert extra["proven"]


# --- the relaxation and its certificate ------------------------------------------------------------------------------


def product_of(modes: SpaceModes, side: MultiStartSearch) -> list[tuple[Floats, Floats]]:
    """(F, T, λ, 1) and w of the solutions at both ends: T = |mT|, z by least squares with z ≥ 0, t the rate of slip."""
    out = []
    for pair in (side.found.lowest, side.found.highest):
        assert pair is not None
        assert pair.motion is not None
        kept = modes.columns.ravel() >= 0
        turning = pair.state.forces.reshape(modes.columns.shape)[modes.share >= 0, 5]
        phi = np.concatenate([pair.state.forces.ravel()[kept], abs(turning), [pair.state.load, 1.0]])
        u, q, b = pair.motion.velocity, modes.rows.shape[1], modes.bending
        jumps = modes.matrix.T @ u
        z, left = nnls(-modes.ties[:, q : q + b], modes.ties[:, :q] @ jumps)
        assert left <= 1e-8
        slips = jumps[modes.columns[modes.slip >= 0][:, [1, 2, 5]]]
        out.append((phi, np.concatenate([u, z, np.maximum(np.hypot(slips[:, 0], slips[:, 1]), abs(slips[:, 2]))])))
    return out


@pytest.mark.parametrize("live", [(1.0, 0.0, 0.0), (0.3, 1.0, 0.0)])
def test_true_solutions_obey_every_row_and_reach_no_further(live: tuple[float, float, float]) -> None:
    assembly = extruded(1, 2, live)
    analysis = LimitAnalysis(assembly)
    side = MultiStartSearch(analysis, assembly.labels, ProximalOptions(), analysis.prove(assembly.labels))
    side.search()
    modes, region, statics, _, check, _ = program(assembly, with_direction(AXES, np.array([0.3, 1.0])))
    size = statics.force_bounds
    for phi, w in product_of(modes, side):
        jumps, y = modes.motions @ w, modes.slacks @ phi
        cost = float(phi @ modes.cost.table(0, (len(phi), len(jumps))) @ jumps)
        assert cost > 0.0
        assert y.min() >= -1e-9
        assert (modes.rates @ jumps).min() >= -1e-8
        assert abs(modes.ties @ jumps).max() <= 1e-8
        assert abs((modes.rates @ jumps)[region.closed]).max(initial=0.0) <= 1e-6
        assert np.max(y[: modes.bending] * w[len(modes.dead) : len(modes.dead) + modes.bending]) <= 1e-5 * cost
        for form in range(modes.coupled.count):
            table = modes.coupled.table(form, (len(phi), len(jumps)))
            assert abs(float(phi @ table @ jumps)) <= 1e-4 * cost
        assert np.all(abs(phi) <= size * (1.0 + 1e-9))
        assert np.all(abs(w) <= check.velocity_bounds * cost * (1.0 + 1e-9))


def test_certificate_of_a_false_bound_is_refused() -> None:
    _, _, _, relaxed, check, scale = program(extruded(1, 1))
    true = check.bound(relaxed.multipliers)
    assert true * scale == pytest.approx(0.65, rel=1e-6)
    multipliers = relaxed.multipliers
    for wrong in (
        replace(multipliers, bound=multipliers.bound + 1e-3),
        replace(multipliers, products=np.zeros_like(multipliers.products)),
        replace(
            multipliers,
            products=multipliers.products + np.random.default_rng(0).uniform(0.0, 1e-3, multipliers.products.shape),
        ),
        replace(multipliers, live_work=np.zeros_like(multipliers.live_work)),
    ):
        assert check.bound(wrong) * scale <= 0.65 * (1.0 + 1e-9)


def test_problems_without_a_bound() -> None:
    """The plane has its own program; crushing and effective areas have none; large scenes the cheap bound alone."""
    flat = build_assembly(halved_bond(1, 1))
    assert space_modes_of(LimitAnalysis(flat).template, flat.labels) is None
    crushed = spatial(
        [GROUND, box("b", [0, 0, 0], [1, 1, 1])],
        materials={"dry": {"friction_coefficient": 0.5, "compressive_strength": 50.0}},
    )
    assert space_modes_of(LimitAnalysis(crushed).template, crushed.labels) is None
    for options in ({}, {"effective_area": True}):
        extra = solve(cubes(1, 0.3, 0.0), friction="zero-dilation", range=True, **options).facts
        assert (extra["proven"], extra["lowest_proven"]) == (False, None)
    row = spatial([GROUND, *(box(f"b{k}", [0.2 * k, 0, 0], [0.2 * (k + 1), 0.2, 0.2]) for k in range(14))])
    analysis = LimitAnalysis(row)
    modes = space_modes_of(analysis.template, row.labels)
    assert modes is not None
    problem = LowerBoundProblem(analysis.prove(row.labels).bracket[1], 1.0)
    floor = SpaceLowerBoundSearch(analysis, row.labels, modes, problem).search()
    assert floor.solve_log[-1] == "no products: 27 faces"
