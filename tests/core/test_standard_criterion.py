"""The standard criterion in the plane, stated as rows, against the closed forms of docs/method.md (2.2) to (3.7)."""

from __future__ import annotations

import numpy as np
import pytest

from cases import grid_assembly
from jld_core.arrays import Bits, Floats
from jld_core.mechanics import scaling_of, yield_set
from jld_core.mechanics.standard import StandardYield
from jld_core.strengths import Side

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


def capacity(side: Side, n: Floats) -> Floats:
    """c + μN, inf where V is left out of the program."""
    return np.where(side.shear + side.friction > 0.0, side.shear + side.friction * n, np.inf)


def slack(dry: Side, inner: Side, forces: Floats, labels: Bits) -> Floats:
    n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
    of_dry = np.minimum(n - n * n / dry.crush - m, capacity(dry, n) - v)
    of_inner = np.minimum(np.minimum(n + inner.tension, inner.crush - n) / 3.0 - m, capacity(inner, n) - v)
    return np.where(labels, of_dry, of_inner)


def margin(dry: Side, inner: Side, jumps: Floats, labels: Bits) -> Floats:
    opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
    of_dry = np.where(np.isinf(dry.crush), opening - turn - dry.friction * slip, np.inf)
    of_inner = np.where(np.isinf(inner.crush), opening - inner.friction * slip - turn / 3.0, np.inf)
    return np.where(labels, of_dry, of_inner)


def dissipation(dry: Side, inner: Side, jumps: Floats, labels: Bits) -> Floats:
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
