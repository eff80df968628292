"""Least thickness of a semicircular arch: Cocchetti & Rizzi, Frattura ed Integrità Strutturale 51 (2020)
356–375, Table 3, weight along the centreline: μ > 0.395832 → t/R = 0.107426 (rotation), μ = 0.309215 → 0.200637,
between them sliding and rotation at once, below 0.309215 no thickness stands.

A discrete arch has joints at fixed angles only, so that it stands a little longer; its error falls with the
number of voussoirs. Tolerances are those errors.
"""

from __future__ import annotations

import numpy as np
import pytest
from studies.families import semicircular_arch

from jld_core import LimitAnalysis, build_assembly

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
    near, far = (least_thickness(120, friction, 0.10, 0.12, 1e-6) for friction in (0.3965, 0.7))
    assert near == pytest.approx(far, abs=2e-5)


@pytest.mark.long
def test_mixed_regime_lies_between() -> None:
    values = [least_thickness(120, friction, 0.10, 0.25, 1e-5) for friction in (0.315, 0.33, 0.36, 0.39)]
    assert np.all(np.diff(values) < 0.0)
    assert ROTATION - 1e-4 < values[-1] < values[0] < LIMIT_THICKNESS + 1e-4


def test_sliding_limit() -> None:
    """At the limit friction the thickness is 0.200637; a little below it no thickness stands."""
    assert least_thickness(240, LIMIT_FRICTION + 2e-5, 0.15, 0.25, 1e-5) == pytest.approx(LIMIT_THICKNESS, abs=2e-3)
    for thickness in (0.2, 0.4, 0.8, 1.2):
        assert not stands(240, thickness, LIMIT_FRICTION - 1e-4)


@pytest.mark.parametrize("voussoirs", [12, 41])
def test_bracket_of_an_arch_is_narrow(voussoirs: int) -> None:
    assembly = build_assembly(semicircular_arch(voussoirs, 0.16, 0.6))
    result = LimitAnalysis(assembly).solve()
    assert result.gap < 1e-7
    assert result.stands_at_zero is True
