"""What encloses planar faces of either label that crush, against samples of both sets (docs/method.md (6.3))."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import grid_assembly
from jld_core import LimitAnalysis
from jld_core.arrays import Floats
from jld_core.mechanics.standard import StandardYield
from jld_core.mechanics.yield_set import ParabolicBending

KINDS: dict[str, tuple[dict[str, float], float]] = {
    "little shear strength": ({}, 1.0003),
    "little of both": ({"shear": 1e4, "tension": 2e5}, 1.0003),
    "weaker inside": ({"crush_inner": 2e6}, 1.0003),
    "cohesion": ({"cohesion": 1e5}, 1.0005),
    "no tension": ({"tension": 0.0}, 1.0003),
    "shear strength beyond all friction": ({"shear": 5e6}, 1.005),
    # the top of the inner set has more shear than the dry line too, and no plane of its own
    "rough inside": ({"inner_friction": 0.3, "shear": 8e5}, 1.06),
    "most strength inside": ({"tension": 3e6, "shear": 1.5e6, "crush_inner": 4e6}, 1.06),
}
"""Strengths that differ from those of the arch of `benchmarks/exact.py`, and how much wider than the hull rows may be,
with a fiftieth of what crushes added."""


def sets_of(**other: float) -> StandardYield:
    strengths = {"friction": 0.577, "tension": 2e6, "shear": 2e5, "crush_dry": 5e6, "crush_inner": 5e6} | other
    sets = LimitAnalysis(grid_assembly(["a", "#"], **strengths)).template.yield_set
    assert isinstance(sets, StandardYield)
    return sets


def planes(bow: ParabolicBending, limit: float) -> Floats:
    """(k, 4) planes −a N + b|V| + c|m| ≤ h of one face, tangents of what is curved among them."""
    (curve, knee), rows = bow.parabola[0], bow.rows[0]
    found = [(rows[1, 0], rows[1, 1], 0.0, rows[1, 2]), (rows[2, 0], 0.0, rows[2, 1], rows[2, 2])]
    found += [(1.0 - 2.0 * curve * n, 0.0, 1.0, curve * n * n) for n in np.linspace(knee, 1.2 * limit, 200)]
    assert bow.interaction is not None
    normal, moment, more, first, last, most, friction, cohesion = bow.interaction[0, :8]
    # tangents of |m| ≤ w m₀ + N₁ − N₁²/((1 − w) N_c), N₁ = N − w n₀, where N₁ = (1 − w) n
    for n in np.linspace(first, last, 200 if more else 0):
        slope = 1.0 - 2.0 * n / most
        b = -(moment - slope * normal - n * n / most) / more
        found.append((slope + friction * b, b, 1.0, n * n / most + cohesion * b))
    return np.array(found)


def support(sets: StandardYield, direction: Floats) -> float:
    """Largest F·direction of both sets."""
    labels = np.array([True, False])
    return float(max(sets.dissipation(-direction[None], one[None])[0] for one in labels))


@pytest.mark.parametrize("name", KINDS)
def test_rows_enclose_either_label_and_hardly_more(name: str) -> None:
    other, wide = KINDS[name]
    sets = sets_of(**other)
    bow = sets.parabolic_bending(undecided=True)
    assert bow is not None
    limit = float(sets.numbers.crush_dry[0])
    rows = planes(bow, limit)
    rng = np.random.default_rng(6)
    n = rng.uniform(-float(sets.tension[0]), limit, 4000)
    v, m = rng.uniform(0.0, 2.0 * limit, n.size), rng.uniform(0.0, limit, n.size)
    for label in np.array([[True], [False]]):
        dry = bool(label[0])
        shear = sets.capacity_of(label) + sets.friction_of(label) * n
        bend = n - n * n / limit if dry else np.minimum(n + sets.tension[0], sets.numbers.crush_inner[0] - n) / 3.0
        held = (bend >= 0.0) & (shear >= 0.0)
        # what lies outside is taken to the boundary
        points = np.column_stack([n, np.minimum(v, shear), np.minimum(m, bend)])[held]
        assert len(points) > 100
        excess = points @ np.array([-rows[:, 0], rows[:, 1], rows[:, 2]]) - rows[:, 3]
        assert excess.max() <= 1e-9 * limit
    ratios = []
    for _ in range(25):
        a, b, c = rng.normal(), abs(rng.normal()), abs(rng.normal())
        direction = np.array([-a, b, c]) / np.linalg.norm([a, b, c])
        # the largest of the rows, V and m not negative
        answer = linprog(
            -direction,
            A_ub=np.column_stack([-rows[:, 0], rows[:, 1], rows[:, 2]]),
            b_ub=rows[:, 3],
            bounds=[(None, None), (0.0, None), (0.0, None)],
        )
        assert answer.status == 0
        hull = support(sets, direction)
        assert -answer.fun >= hull - 1e-7 * limit
        ratios.append((-answer.fun + 0.02 * limit) / (hull + 0.02 * limit))
    assert max(ratios) <= wide
