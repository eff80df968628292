"""Loads that cancel within a block leave nothing: λ of the block is that of the block without them, in any units."""

from __future__ import annotations

from typing import Any

import pytest

from jld_core import build_assembly, parse_scene, solve

Document = dict[str, Any]

PUSH = {"element": "a", "force": [1.0, 0.0]}
PAIRS: dict[str, Document] = {
    "prestress": {
        "members": [
            {
                "kind": "tendon",
                "prestress": 1e4,
                "tension": 2e4,
                "from": {"element": "a", "at": [0.3, 0.45]},
                "to": {"element": "b", "at": [1.8, 0.21]},
            }
        ]
    },
    "forces": {
        "dead": [
            {"element": "a", "force": [0.3, -0.1], "at": [0.3, 0.45]},
            {"element": "b", "force": [-0.3, 0.1], "at": [0.3, 0.45]},
        ]
    },
    "large forces": {
        "dead": [
            {"element": "a", "force": [7.1e3, -2.3e3], "at": [0.7, 0.1]},
            {"element": "b", "force": [-7.1e3, 2.3e3], "at": [0.7, 0.1]},
        ]
    },
    "moments": {"dead": [{"element": "a", "moment": 0.7}, {"element": "b", "moment": -0.7}]},
    "weight held up": {
        "density": 2000.0,
        "dead": [
            {"element": "a", "force": [0.0, 2000.0 * 9.81 * 0.7]},
            {"element": "b", "force": [0.0, 2000.0 * 9.81 * 1.1 * 0.7]},
        ],
    },
}
"""Loads on two elements of one block that cancel, in m and N."""


def scaled(value: Any, key: str, length: float, force: float) -> Any:
    """Return a document in units of 1 / `length` m and 1 / `force` N."""
    if isinstance(value, dict):
        return {name: scaled(part, name, length, force) for name, part in value.items()}
    if isinstance(value, list):
        return [scaled(part, key, length, force) for part in value]
    factors = {"polygon": length, "at": length, "thickness": length, "force": force, "moment": force * length}
    factors |= {"prestress": force, "tension": force, "density": force / length**3}
    factors |= {"tensile_strength": force / length**2, "shear_strength": force / length**2}
    return value * factors[key] if key in factors else value


def block(pair: Document, push: Document, length: float = 1.0, force: float = 1.0) -> Document:
    """A block of two elements on the ground."""
    inner = {"tensile_strength": 1e9, "shear_strength": 1e9}
    document = {
        "elements": [
            {"id": "a", "polygon": [[0, 0], [1, 0], [1, 0.7], [0, 0.7]], "block": "A"},
            {"id": "b", "polygon": [[1, 0], [2.1, 0], [2.1, 0.7], [1, 0.7]], "block": "A"},
            {"id": "g", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True},
        ],
        "thickness": 1.0,
        "materials": {
            "density": pair.get("density", 0.0),
            "dry": {"friction_coefficient": 0.6},
            "inner": inner,
        },
        "loads": {"dead": pair.get("dead", []), "live": [push]},
        "members": pair.get("members", []),
    }
    return scaled(document, "", length, force)  # type: ignore[no-any-return]


@pytest.mark.parametrize(("length", "force"), [(1.0, 1.0), (1e3, 1e-3), (0.01, 1e4)])
@pytest.mark.parametrize("name", PAIRS)
def test_nothing_is_left_of_what_cancels(name: str, length: float, force: float) -> None:
    """A block without weight on a dry joint slides at λ = 0, and stands."""
    result = solve(build_assembly(parse_scene(block(PAIRS[name], PUSH, length, force))))
    low, high = result.bracket
    assert result.status == "collapse"
    assert low == pytest.approx(0.0, abs=1e-9)
    assert high == pytest.approx(0.0, abs=1e-6)
    assert result.stands_at_zero is True


@pytest.mark.parametrize("name", PAIRS)
def test_what_presses_counts_beside_what_cancels(name: str) -> None:
    """A weight of 100 pressed on in the middle slides at 0.6 · 100, whatever cancels."""
    document = block(PAIRS[name], PUSH)
    document["loads"]["dead"] = [*document["loads"]["dead"], {"element": "a", "force": [0, -100], "at": [1.05, 0.0]}]
    document["loads"]["live"] = [{**PUSH, "at": [0.5, 0.0]}]
    result = solve(build_assembly(parse_scene(document)))
    assert result.load_factor == pytest.approx(60.0, rel=1e-6)
