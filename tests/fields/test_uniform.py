"""Uniform stresses in a square: the load factor is the gauge of the yield set, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jld_core import Floats
from jld_core.fields.forms import Material
from jld_core.fields.lower import LowerBound
from jld_core.fields.mesh import Mesh, subdivide
from jld_core.fields.problem import Joints, Problem, Units
from jld_core.fields.upper import UpperBound

SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [0.1, -0.05]])
TENSION = 0.7
COHESION = 1.0


def problem(material: Material, stress: tuple[float, float, float], parts: int) -> Problem:
    """A free square under tractions of a uniform stress (σx, σy, τxy)."""
    fan = np.array([[k, (k + 1) % 4, 4] for k in range(4)])
    none = np.zeros(0)
    ends = np.zeros((0, 2), dtype=np.int64)
    mesh = Mesh(SQUARE, fan, np.zeros(4, dtype=np.int64), np.arange(4), ends, np.zeros(0, dtype=np.int64))
    mesh = subdivide(mesh, parts)
    tensor = np.array([[stress[0], stress[2]], [stress[2], stress[1]]])
    free = mesh.sides.b < 0
    pull = np.where(free[:, None, None], (mesh.sides.normal @ tensor)[:, None], 0.0).repeat(2, axis=1)
    zero: Floats = np.zeros((len(mesh), 2))
    found = Problem(
        Units(1.0, 1.0, 1.0, 1.0, np.zeros(2)),
        material,
        Joints(none, none, none),
        mesh,
        zero,
        zero,
        np.zeros_like(pull),
        pull,
    )
    return replace(found)


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


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(("friction", "crushing", "x", "y", "xy", "factor"), CASES)
def test_uniform_stress(
    friction: float, crushing: float, x: float, y: float, xy: float, factor: float, parts: int
) -> None:
    """Both bounds are the factor at which the uniform stress reaches yield."""
    given = problem(Material(TENSION, COHESION, friction, crushing), (x, y, xy), parts)
    labels = np.zeros(0, dtype=bool)
    lower, upper = LowerBound(given).bound(labels), UpperBound(given).bound(labels)
    assert lower is not None
    assert upper is not None
    assert lower.room >= 0.0
    assert lower.factor == pytest.approx(factor, rel=1e-6)
    assert upper.factor == pytest.approx(factor, rel=1e-6)
    assert lower.factor <= factor * (1.0 + 1e-12)
    assert upper.factor >= factor * (1.0 - 1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.75])
@pytest.mark.parametrize("crushing", [np.inf, 2.0])
def test_support_function_is_the_largest_power_over_the_set(friction: float, crushing: float) -> None:
    """D(e, g) is sup m e + R g, found here by sampling the boundary of the set."""
    material = Material(TENSION, COHESION, friction, crushing)
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
    material = Material(TENSION, COHESION, 0.75, 3.0)
    points = np.array([[TENSION, 0.0, 0.0], [0.0, 0.3, 0.4], [-3.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert material.slack(points) == pytest.approx([0.0, 0.2, 0.0, -1.3])
    assert material.sine == pytest.approx(0.6)
    assert material.intercept == pytest.approx(0.8)
