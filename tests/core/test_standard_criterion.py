"""The standard criterion in the plane, stated as rows, against the closed forms of docs/method.md (2.2) to (3.7)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import grid_assembly
from jld_core import LimitAnalysis
from jld_core.mechanics import scaling_of, yield_set
from jld_core.mechanics.standard import StandardYield

STRENGTHS: dict[str, dict[str, float]] = {
    "plain": {},
    "cohesion": {"cohesion": 1e5},
    "no friction": {"friction": 0.0},
    "no shear": {"friction": 0.0, "shear": 0.0},
    "rough inside": {"inner_friction": 0.4, "shear": 9e5},
    "crushing inside": {"crush_inner": 2e6},
    "crushing": {"crush_dry": 5e6, "crush_inner": 2e6, "cohesion": 1e5},
}


def sets_of(name: str) -> StandardYield:
    given = {"friction": 0.577, "tension": 2e6, "shear": 2e5} | STRENGTHS[name]
    assembly = grid_assembly(["ab", "##", "cd"], **given)
    sets = yield_set(assembly, scaling_of(assembly))
    assert isinstance(sets, StandardYield)
    return sets


def capacity(side: Any, n: np.ndarray) -> np.ndarray:
    """c + μN, inf where V is left out of the program."""
    return np.where(side.shear + side.friction > 0.0, side.shear + side.friction * n, np.inf)


def slack(dry: Any, inner: Any, forces: np.ndarray, labels: np.ndarray) -> np.ndarray:
    n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
    of_dry = np.minimum(n - n * n / dry.crush - m, capacity(dry, n) - v)
    of_inner = np.minimum(np.minimum(n + inner.tension, inner.crush - n) / 3.0 - m, capacity(inner, n) - v)
    return np.where(labels, of_dry, of_inner)


def margin(dry: Any, inner: Any, jumps: np.ndarray, labels: np.ndarray) -> np.ndarray:
    opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
    of_dry = np.where(np.isinf(dry.crush), opening - turn - dry.friction * slip, np.inf)
    of_inner = np.where(np.isinf(inner.crush), opening - inner.friction * slip - turn / 3.0, np.inf)
    return np.where(labels, of_dry, of_inner)


def dissipation(dry: Any, inner: Any, jumps: np.ndarray, labels: np.ndarray) -> np.ndarray:
    opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
    closing, cracked = turn + dry.friction * slip - opening, opening - inner.friction * slip
    with np.errstate(all="ignore"):
        early = dry.crush * closing * closing / (4.0 * turn)
        crushed = np.where(closing < 2.0 * turn, early, dry.crush * (closing - turn))
        top = 0.5 * (inner.tension - inner.crush) * cracked + (inner.crush + inner.tension) * turn / 6.0
        bent = np.where(np.isinf(inner.crush), -np.inf, np.maximum(-inner.crush * cracked, top))
    of_dry = np.where((closing <= 0.0) | np.isinf(dry.crush), 0.0, crushed) + dry.shear * slip
    return np.where(labels, of_dry, np.maximum(inner.tension * cracked, bent) + inner.shear * slip)


@pytest.mark.parametrize("name", STRENGTHS)
def test_rows_have_the_slack_and_the_support_function_of_the_closed_forms(name: str) -> None:
    sets, rng = sets_of(name), np.random.default_rng(3)
    both = sets.numbers.side(dry=True), sets.numbers.side(dry=False)
    for _ in range(40):
        labels = rng.random(len(sets.point)) < 0.5
        forces, jumps = rng.normal(size=(2, len(labels), 3))
        jumps[:, 0] = 3.0 * rng.random(len(labels)) - 0.5
        assert sets.slack(forces, labels) == pytest.approx(slack(*both, forces, labels), rel=1e-12, abs=1e-12)
        expected = margin(*both, jumps, labels)
        assert sets.margin(jumps, labels) == pytest.approx(expected, rel=1e-12, abs=1e-12)
        finite = expected >= 0.0
        work = dissipation(*both, jumps, labels)[finite]
        assert sets.dissipation(jumps, labels)[finite] == pytest.approx(work, rel=1e-12, abs=1e-12)
        # many mechanisms at once, as proofs ask
        assert np.array_equal(sets.margin(np.stack([jumps, jumps]), labels)[1], sets.margin(jumps, labels))


@pytest.mark.parametrize("name", STRENGTHS)
def test_rows_of_undecided_faces_enclose_either_label(name: str) -> None:
    """Forces inside a set of one label, drawn by the closed forms, satisfy the linear rows of the hull."""
    sets, rng = sets_of(name), np.random.default_rng(4)
    pattern, both = sets.hull().pattern, (sets.numbers.side(dry=True), sets.numbers.side(dry=False))
    for _ in range(60):
        labels = rng.random(len(sets.point)) < 0.5
        forces = rng.normal(size=(len(labels), 3)) * rng.choice([0.1, 1.0, 5.0])
        forces[~sets.active(labels)] = 0.0
        inside = slack(*both, forces, labels) >= 0.0
        y = np.where(inside[:, None], forces, 0.0).ravel()
        product = np.bincount(pattern.row, pattern.dry * y[pattern.column], minlength=len(pattern.h_dry))
        spare = (pattern.h_dry - product)[: pattern.linear]
        assert spare.min() >= -1e-12 * max(1.0, abs(y).max())


# What encloses planar faces of either label that crush, against samples of both sets (docs/method.md (6.3)).


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


def sets_of_hull(**other: float) -> StandardYield:
    strengths = {"friction": 0.577, "tension": 2e6, "shear": 2e5, "crush_dry": 5e6, "crush_inner": 5e6} | other
    sets = LimitAnalysis(grid_assembly(["a", "#"], **strengths)).template.yield_set
    assert isinstance(sets, StandardYield)
    return sets


def planes(bow: Any, limit: float) -> np.ndarray:
    """(k, 4) planes −a N + b|V| + c|m| ≤ h of one face, tangents of what is curved among them."""
    (curve, knee), rows = bow.parabola[0], bow.rows[0]
    found = [(rows[1, 0], rows[1, 1], 0.0, rows[1, 2]), (rows[2, 0], 0.0, rows[2, 1], rows[2, 2])]
    found += [(1.0 - 2.0 * curve * n, 0.0, 1.0, curve * n * n) for n in np.linspace(knee, 1.2 * limit, 200)]
    normal, moment, more, first, last, most, friction, cohesion = bow.interaction[0, :8]
    # tangents of |m| ≤ w m₀ + N₁ − N₁²/((1 − w) N_c), N₁ = N − w n₀, where N₁ = (1 − w) n
    for n in np.linspace(first, last, 200 if more else 0):
        slope = 1.0 - 2.0 * n / most
        b = -(moment - slope * normal - n * n / most) / more
        found.append((slope + friction * b, b, 1.0, n * n / most + cohesion * b))
    return np.array(found)


def support(sets: StandardYield, direction: np.ndarray) -> float:
    """Largest F·direction of both sets."""
    labels = np.array([True, False])
    return float(max(sets.dissipation(-direction[None], one[None])[0] for one in labels))


@pytest.mark.parametrize("name", KINDS)
def test_rows_enclose_either_label_and_hardly_more(name: str) -> None:
    other, wide = KINDS[name]
    sets = sets_of_hull(**other)
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
