"""Loads as they act: resultants are integrals of tractions, and sums, shares and selections of loads keep them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases_spatial import box
from jld_core import build_assembly, parse_scene
from jld_core.arrays import Floats
from jld_core.loads import Traction, resultants


def squares(low: Floats, high: Floats, count: int) -> tuple[Floats, float]:
    """Middles (k, 2) of small squares that fill a rectangle, and their area."""
    step = (high - low) / count
    axes = [low[k] + step[k] * (np.arange(count) + 0.5) for k in (0, 1)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2), float(np.prod(step))


def test_the_resultant_of_a_linear_traction_with_a_hole_is_its_integral() -> None:
    """A square of side 4 with a hole 1 × 2 in a turned plane, by the midpoint rule, to its error."""
    rng = np.random.default_rng(3)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    outer, inner = np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]]), np.array([[1, 1], [1, 3], [2, 3], [2, 1.0]])
    base, mean, slope = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(3, 3))
    middle = (16.0 * np.array([2.0, 2.0]) - 2.0 * np.array([1.5, 2.0])) / 14.0
    for holes in ([inner], [inner[::-1]]):
        rings = tuple(base + ring @ frame for ring in (outer, *holes))
        one = Traction(0, rings, base + middle @ frame, mean, slope)
        force, moment = np.zeros(3), np.zeros(3)
        for sign, low, high in ((1.0, [0.0, 0.0], [4.0, 4.0]), (-1.0, [1.0, 1.0], [2.0, 3.0])):
            flat, area = squares(np.array(low), np.array(high), 200)
            places = base + flat @ frame
            pulls = sign * area * one.at(places)
            force += pulls.sum(axis=0)
            moment += np.cross(places - one.origin, pulls).sum(axis=0)
        assert one.resultant()[0] == pytest.approx(force, abs=1e-9)
        assert one.resultant()[1] == pytest.approx(moment, abs=2e-3)


def loaded(d: int) -> dict[str, Any]:
    """Two blocks on a support, with every kind of load."""
    if d == 2:
        elements = [
            {"id": "ground", "support": True, "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]]},
            {"id": "a", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
            {"id": "b", "polygon": [[1, 0], [2, 0], [2, 1.5], [1, 1]], "weight": 3.0},
        ]
        face = {"face": {"along": [[0, 1], [1, 1], [2, 1.5]]}, "pressure": [1.0, -2.0]}
        moment: Any = 0.7
    else:
        elements = [
            box("ground", [0, 0, -1], [2, 1, 0], support=True),
            box("a", [0, 0, 0], [1, 1, 1]),
            box("b", [1, 0, 0], [2, 1, 1.5]),
        ]
        face = {"face": {"between": ["b", "outside"]}, "pressure": 1.3}
        moment = [0.1, -0.2, 0.7]
    force = [0.4, *([0.0] * (d - 2)), -1.0]
    dead = [face, {"element": "a", "force": force, "moment": moment}]
    live = [{"body": force}, {"element": "b", "force": force, "at": [1.5] * d}, face]
    dry = {"friction_coefficient": 0.5}
    return {"elements": elements, "materials": {"density": 1.0, "dry": dry}, "loads": {"dead": dead, "live": live}}


@pytest.mark.parametrize("d", [2, 3])
def test_sums_shares_and_selections_of_loads_have_their_resultants(d: int) -> None:
    assembly = build_assembly(parse_scene(loaded(d)))
    elements, dead, live = assembly.elements, assembly.dead_loads, assembly.live_loads
    assert resultants(dead + 2.0 * live, elements) == pytest.approx(assembly.dead + 2.0 * assembly.live, abs=1e-12)
    factors = np.array([1.0, 0.9, 1.35])
    assert resultants(dead.weighted(factors), elements) == pytest.approx(factors[:, None] * assembly.dead, abs=1e-12)
    rows = np.array([0, 2])
    assert resultants(dead.take(rows), elements.take(rows)) == pytest.approx(assembly.dead[rows], abs=1e-12)
    assert resultants(type(dead).of_resultants(assembly.dead), elements) == pytest.approx(assembly.dead, abs=1e-12)
    assert dead
    assert not 0.0 * dead
    twice = replace(elements, centroid=2.0 * elements.centroid)
    stretched = resultants(dead.stretched(2.0), twice)
    assert stretched[:, :d] == pytest.approx(assembly.dead[:, :d], abs=1e-12)
    assert stretched[:, d:] == pytest.approx(2.0 * assembly.dead[:, d:], abs=1e-12)
