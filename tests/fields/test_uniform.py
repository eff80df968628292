"""Uniform stresses in a square: the load factor is the gauge of the yield set, in closed form."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import box
from jld_core import Bits, Floats, build_assembly, parse_scene
from jld_core.fields import bounds as field_bounds
from jld_core.fields import mesh as field_mesh
from jld_core.fields import problem as field_problem
from proofs import fields_of

SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [0.1, -0.05]])
TENSION = 0.7
COHESION = 1.0


def problem(material: field_problem.Material, stress: tuple[float, float, float], parts: int) -> field_problem.Problem:
    """A free square under tractions of a uniform stress (σx, σy, τxy)."""
    fan = np.array([[k, (k + 1) % 4, 4] for k in range(4)])
    none = np.zeros(0)
    ends = np.zeros((0, 2), dtype=np.int64)
    mesh = field_mesh.Mesh(SQUARE, fan, np.zeros(4, dtype=np.int64), np.arange(4), ends, np.zeros(0, dtype=np.int64))
    mesh = field_mesh.subdivide(mesh, parts)
    tensor = np.array([[stress[0], stress[2]], [stress[2], stress[1]]])
    free = mesh.sides.b < 0
    pull = np.where(free[:, None, None], (mesh.sides.normal @ tensor)[:, None], 0.0).repeat(2, axis=1)
    zero: Floats = np.zeros((len(mesh), 2))
    return field_problem.Problem(
        field_problem.Units(1.0, 1.0, 1.0, 1.0, np.zeros(2)),
        material,
        field_problem.Joints(none, none, none),
        mesh,
        zero,
        zero,
        np.zeros_like(pull),
        pull,
    )


CASES = [
    # (friction, crushing, σx, σy, τxy, λ)
    (0.0, np.inf, 1.0, 0.0, 0.0, TENSION),
    (0.0, np.inf, -1.0, 0.0, 0.0, 2.0 * COHESION),
    (0.0, 1.5, -1.0, 0.0, 0.0, 1.5),
    (0.0, np.inf, 0.0, 0.0, 1.0, TENSION),
    (0.0, np.inf, -2.0, -2.0, 1.0, COHESION),
    (0.0, 1.5, -1.0, -1.0, 0.0, 1.5),
    # Mohr–Coulomb in uniaxial compression: 2 c cos φ / (1 − sin φ), with tan φ = 3/4: 2 · 0.8 / 0.4
    (0.75, np.inf, 0.0, -1.0, 0.0, 4.0),
    (0.75, 3.0, 0.0, -1.0, 0.0, 3.0),
    # R = 1, m = −1: 1 ≤ c cos φ / λ + sin φ
    (0.75, np.inf, 0.0, -2.0, 0.0, 2.0),
]


def assert_bounds(given: field_problem.Problem, labels: Bits, factor: float, rel: float) -> None:
    """Both bounds are the factor at which the uniform stress reaches yield, from their own side."""
    lower, upper = fields_of(given, labels)
    assert lower.room >= 0.0
    assert (lower.factor, upper.factor) == pytest.approx((factor, factor), rel=rel)
    assert lower.factor <= factor * (1.0 + 1e-12)
    assert upper.factor >= factor * (1.0 - 1e-12)


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(("friction", "crushing", "x", "y", "xy", "factor"), CASES)
def test_uniform_stress(
    friction: float, crushing: float, x: float, y: float, xy: float, factor: float, parts: int
) -> None:
    given = problem(field_problem.Material(TENSION, COHESION, friction, crushing), (x, y, xy), parts)
    assert_bounds(given, np.zeros(0, dtype=bool), factor, 1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.75])
@pytest.mark.parametrize("crushing", [np.inf, 2.0])
def test_support_function_is_the_largest_power_over_the_set(friction: float, crushing: float) -> None:
    """D(e, g) is sup m e + R g, found here by sampling the boundary of the set."""
    material = field_problem.Material(TENSION, COHESION, friction, crushing)
    rng = np.random.default_rng(1)
    trace, shear = rng.normal(size=200), abs(rng.normal(size=200))
    m = np.concatenate([np.linspace(-min(crushing, 400.0), TENSION, 200_001)])
    radius = np.min([a + b * m for a, b in material.lines], axis=0)
    held = radius >= 0.0
    for e, g in zip(trace, shear, strict=True):
        best = float((m[held] * e + radius[held] * g).max())
        power = float(material.dissipation(np.array([e]), np.array([g]))[0])
        if np.isfinite(power):
            assert power == pytest.approx(best, abs=5e-3 * (abs(e) + g))
        else:
            # without crushing the power grows for ever along the edge of friction
            assert best > 10.0 * (abs(e) + g) or material.sine * g - e < 0.05 * (abs(e) + g)


def test_slack_is_the_distance_to_yield() -> None:
    """Slack on, inside and outside the three conditions."""
    material = field_problem.Material(TENSION, COHESION, 0.75, 3.0)
    points = np.array([[TENSION, 0.0, 0.0], [0.0, 0.3, 0.4], [-3.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert material.slack(points) == pytest.approx([0.0, 0.2, 0.0, -1.3])
    assert material.sine == pytest.approx(0.6)
    assert material.intercept == pytest.approx(0.8)


# Uniform stresses in a free cube, and the support function in space: closed forms and a second route.


INNER = {"tensile_strength": TENSION, "shear_strength": COHESION}


@cache
def cube(times: int) -> field_problem.Problem:
    """A cube of side 1 without any interface: bisected as often as stated."""
    parts = [box("ground", [0, 0, -1], [1, 1, 0], support=True), box("cube", [0, 0, 0], [1, 1, 1])]
    document = {
        "elements": parts,
        "materials": {"density": 0.0, "dry": {"friction_coefficient": 0.5}, "inner": INNER},
        "loads": {"live": [{"element": "cube", "force": [1, 0, 0]}]},
    }
    assembly = build_assembly(parse_scene(document))
    setting = field_bounds.FieldSetting.of(assembly)
    mesh = replace(setting.coarse, tagged=setting.coarse.tagged[:0], tag=setting.coarse.tag[:0])
    for _ in range(times):
        mesh = field_mesh.bisect(mesh, np.ones(len(mesh), dtype=bool))
    found = setting.problem(mesh)
    return replace(found, live=np.zeros_like(found.live))


def tensor(xx: float, yy: float, zz: float, xy: float = 0.0, yz: float = 0.0) -> Floats:
    return np.array([[xx, xy, 0.0], [xy, yy, yz], [0.0, yz, zz]])


CASES_IN_SPACE = [
    # (friction, crushing, stress, λ)
    (0.0, np.inf, tensor(1, 0, 0), TENSION),
    (0.0, np.inf, tensor(0, 0, -1), 2.0 * COHESION),
    (0.0, 1.5, tensor(0, -1, 0), 1.5),
    (0.0, np.inf, tensor(0, 0, 0, xy=1), TENSION),
    (0.0, np.inf, tensor(-2, -2, -2, yz=1), COHESION),
    # σ1 − σ3 = 2τ is half of |σx − σz| here: the middle stress plays no part
    (0.0, np.inf, tensor(-1, -2, -3), COHESION),
    (0.0, 1.5, tensor(-1, -1, -1), 1.5),
    # Mohr–Coulomb in uniaxial compression: 2 c cos φ / (1 − sin φ), with tan φ = 3/4: 2 · 0.8 / 0.4
    (0.75, np.inf, tensor(0, 0, -1), 4.0),
    (0.75, 3.0, tensor(0, 0, -1), 3.0),
    # triaxial compression: 1.6 σ1 − 0.4 σ3 = 1.6
    (0.75, np.inf, tensor(-0.5, -0.5, -3), 4.0),
]


@pytest.mark.parametrize(("friction", "crushing", "stress", "factor"), CASES_IN_SPACE)
def test_uniform_stress_in_space(friction: float, crushing: float, stress: Floats, factor: float) -> None:
    given = replace(cube(0), material=field_problem.Material(TENSION, COHESION, friction, crushing))
    outside = given.sides.b < 0
    pull = np.where(outside[:, None, None], (given.sides.normal @ stress)[:, None], 0.0).repeat(3, axis=1)
    assert_bounds(replace(given, pull=pull), np.zeros(1, dtype=bool), factor, 1e-4)


@pytest.mark.parametrize(("friction", "crushing"), [(0.0, np.inf), (0.3, np.inf), (0.75, 2.0)])
def test_support_function_is_the_largest_power_over_the_set_in_space(friction: float, crushing: float) -> None:
    """D(tr ε, Σ|ε_i|) is the largest Σ σ_i ε_i, found here by a linear program over the principal stresses."""
    material = field_problem.Material(TENSION, COHESION, friction, crushing)
    rows, right = [*np.eye(3)], [TENSION] * 3
    if np.isfinite(crushing):
        rows, right = [*rows, *(-np.eye(3))], right + [crushing] * 3
    for i in range(3):
        for j in range(3):
            if i != j:
                row = np.zeros(3)
                row[i], row[j] = 1.0 + material.sine, material.sine - 1.0
                rows.append(row)
                right.append(2.0 * material.intercept)
    for rate in np.random.default_rng(2).normal(size=(12, 3)):
        found = linprog(-rate, A_ub=np.array(rows), b_ub=right, bounds=(None, None))
        power = float(material.dissipation(np.array([rate.sum()]), np.array([abs(rate).sum()]))[0])
        if found.status == 3:
            assert power == np.inf
        else:
            assert found.fun is not None
            assert power == pytest.approx(-found.fun, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("times", [0, 1, 4])
def test_meshes_fill_the_cube(times: int) -> None:
    """Volumes add up, every triangle inside has two sides, gradients are exact, and no tetrahedron degenerates."""
    mesh: field_mesh.Mesh = cube(times).mesh
    for one in (mesh, field_mesh.split_at_centroids(mesh)):
        sides = one.sides
        assert one.volume.min() > 0.02 * one.volume.max()
        assert one.volume.sum() == pytest.approx(1.0)
        assert sides.area[sides.b < 0].sum() == pytest.approx(6.0)
        assert 4 * len(one) == 2 * int((sides.b >= 0).sum()) + int((sides.b < 0).sum())
        two = sides.b >= 0
        places = one.corners[sides.a[two][:, None], sides.corner_a[two]]
        assert np.array_equal(places, one.corners[sides.b[two][:, None], sides.corner_b[two]])
        slope = np.einsum("tki,tkj->tij", one.corners, one.gradient)
        assert np.allclose(slope, np.eye(3))
        away = one.corners[sides.a].mean(axis=1) - one.corners[sides.a[:, None], sides.corner_a].mean(axis=1)
        assert (np.einsum("fi,fi->f", away, sides.normal) < 0.0).all()
