"""Pushes in several directions: closed forms in the plane and in space, rotation, files, and refusals."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from cases_spatial import box
from jld_core import InputError, build_assembly, parse_scene, solve


def block(friction: float, pushes: dict[str, Any], left: float = -0.3) -> dict[str, Any]:
    """A block of height 2 on a support, from `left` to 0.7; its centroid is 0.2 right of the origin for −0.3."""
    return {
        "elements": [
            {"id": "ground", "support": True, "polygon": [[-2, -1], [2, -1], [2, 0], [-2, 0]]},
            {"id": "b", "polygon": [[left, 0], [0.7, 0], [0.7, 2], [left, 2]]},
        ],
        "materials": {"density": 2000, "dry": {"friction_coefficient": friction}},
        "loads": {"pushes": pushes},
    }


@pytest.mark.parametrize("friction", [0.2, 0.9])
def test_a_block_slides_or_tilts_to_both_sides(friction: float) -> None:
    """Statics: λ = min(μ, b/h)/share, b/h = 1/2."""
    found = solve(parse_scene(block(friction, {"of_weight": 0.5, "directions": 2, "required": 2.0})))
    assert list(found.cases) == ["push at 0°", "push at 180°"]
    for one in found.cases.values():
        assert one.load_factor == pytest.approx(min(friction, 0.5) / 0.5, rel=1e-9)
    assert found.load_factor == pytest.approx(min(friction, 0.5) / 0.5 / 2.0, rel=1e-9)


def test_vectors_count_by_their_direction_and_may_lean() -> None:
    """A push up at 45° lightens the block: λ/√2 = μ (1 − λ/√2)."""
    directions = [[0, 3], [5, 5], [-2, 0]]
    cases = build_assembly(parse_scene(block(0.4, {"directions": directions}))).cases
    assert [case.name for case in cases] == ["push at 90°", "push at 45°", "push at 180°"]
    found = solve(parse_scene(block(0.4, {"directions": [[5, 5]]})))
    assert found.load_factor == pytest.approx(math.sqrt(2.0) * 0.4 / 1.4, rel=1e-9)


def cuboid(directions: Any, gravity: Any = 9.81) -> dict[str, Any]:
    """A cuboid 1 × 2 × 3 on a wide support, with friction that keeps it from sliding."""
    return {
        "elements": [box("ground", (-5, -5, -1), (6, 7, 0), support=True), box("b", (0, 0, 0), (1, 2, 3))],
        "materials": {"density": 1000, "gravity": gravity, "dry": {"friction_coefficient": 5.0}},
        "loads": {"pushes": {"name": "quake", "directions": directions}},
    }


def test_a_cuboid_tilts_in_every_direction() -> None:
    """Statics: the centre of pressure leaves the 1 × 2 rectangle at x = λ h/2 cos φ = 1/2 or y = λ h/2 sin φ = 1."""
    found = solve(parse_scene(cuboid(8)))
    assert len(found.cases) == 8
    for k, one in enumerate(found.cases.values()):
        c, s = abs(math.cos(k * math.pi / 4)), abs(math.sin(k * math.pi / 4))
        limits = [side / (1.5 * part) for side, part in ((0.5, c), (1.0, s)) if part > 1e-9]
        assert one.load_factor == pytest.approx(min(limits), rel=1e-6)
    names = list(found.cases)
    assert (names[0], names[1], names[6]) == ("quake at 0°", "quake at 45°", "quake at 270°")


def test_horizontal_follows_gravity() -> None:
    """With gravity along +y, horizontal is across it: in space the first axis, and the vertical one of the scene."""
    cases = build_assembly(parse_scene({**cuboid(4, [0, 9.81, 0]), "members": []})).by_case
    weight = 6000 * 9.81
    pushes = np.array([case.live[1, :3] for case in cases]) / weight
    assert np.allclose(pushes, [[1, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1]], atol=1e-12)


def test_a_turned_scene_has_the_same_factors() -> None:
    scene = block(0.9, {"directions": 2})
    turned = copy.deepcopy(scene)
    c, s = math.cos(0.6), math.sin(0.6)
    for element in turned["elements"]:
        element["polygon"] = [[c * x - s * y, s * x + c * y] for x, y in element["polygon"]]
    turned["materials"]["gravity"] = [9.81 * s, -9.81 * c]
    one, other = solve(parse_scene(scene)), solve(parse_scene(turned))
    assert [a.load_factor for a in one.cases.values()] == pytest.approx(
        [b.load_factor for b in other.cases.values()], rel=1e-9
    )


def test_pushes_equal_stated_cases_beside_moving_loads() -> None:
    """The same forces as two cases stated by hand; a vehicle beside them adds its own cases."""
    pushed = block(0.3, {"of_weight": 0.1, "directions": 2})
    by_hand = block(0.3, {})
    by_hand["loads"] = {"cases": [{"name": str(x), "live": [{"body": [0.1 * x, 0]}]} for x in (1, -1)]}
    one, other = (build_assembly(parse_scene(scene)) for scene in (pushed, by_hand))
    assert np.array_equal([case.live for case in one.by_case], [case.live for case in other.by_case])
    pushed["loads"]["moving"] = [{"axles": [{"weight": 1.0}], "path": [[-0.3, 2], [0.7, 2]], "steps": 2}]
    assert [case.name for case in build_assembly(parse_scene(pushed)).cases] == [
        "moving at 0",
        "moving at 1",
        "push at 0°",
        "push at 180°",
    ]


@pytest.mark.parametrize(
    ("pushes", "message"),
    [
        ({"directions": 3}, "loads.pushes.directions: 3 horizontal directions in a planar scene; expected 1 or 2"),
        ({"directions": 0}, "loads.pushes.directions: 0 is wrong; expected a number of at least 1"),
        ({"directions": 400}, "loads.pushes.directions: 400 is wrong; expected a number of at most 360"),
        ({"directions": True}, "loads.pushes.directions: true is wrong; expected a number of directions, or a list"),
        ({"directions": [[1, 0], [1, 1e-20]]}, r"loads.pushes.directions\[1\]: it is a direction that stands before"),
        ({"directions": []}, "loads.pushes.directions"),
        ({"directions": [[1, 0], [2, 0]]}, r"loads.pushes.directions\[1\]: it is a direction that stands before"),
        ({"directions": [[0, 0]]}, r"loads.pushes.directions\[0\]: it is zero"),
        ({"directions": [[1, 0, 0]]}, r"loads.pushes.directions\[0\]: it has 3 numbers; expected 2"),
        ({"of_weight": -1, "directions": 2}, "loads.pushes.of_weight"),
        ({"of_weight": 1}, "loads.pushes.directions: missing"),
        ({"direction": 2}, "loads.pushes"),
    ],
)
def test_bad_pushes_are_one_line(pushes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as found:
        build_assembly(parse_scene(block(0.3, pushes)))
    assert "\n" not in str(found.value)


def test_pushes_stand_beside_no_live_load() -> None:
    scene = block(0.3, {"directions": 2})
    scene["loads"]["live"] = [{"body": [1, 0]}]
    with pytest.raises(InputError, match=r'loads\.live: it is given together with "pushes"'):
        parse_scene(scene)
