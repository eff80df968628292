"""Pressure on free faces and loads that move: closed forms, sums over boundaries, and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner
from cases_spatial import box
from jld_core import InputError, build_assembly, geometry_sensitivities, parse_scene, solve

WEIGHT = 2000 * 9.81 * 2.0 * 0.5
"""Weight of the block of `dam`, N."""


def dam(friction: float, *live: dict[str, Any]) -> dict[str, Any]:
    """A block 1 m × 2 m × 0.5 m on a support, with given loads."""
    return {
        "elements": [
            {"id": "ground", "support": True, "polygon": [[-1, -1], [2, -1], [2, 0], [-1, 0]]},
            {"id": "b", "polygon": [[0, 0], [1, 0], [1, 2], [0, 2]]},
        ],
        "thickness": 0.5,
        "materials": {"density": 2000, "dry": {"friction_coefficient": friction}},
        "loads": {"live": list(live)},
    }


WATER = {"face": {"along": [[0, 0], [0, 2]]}, "pressure": [1000.0, 0.0]}
"""Hydrostatic pressure on the left side: resultant 500 N at a third of the height."""


@pytest.mark.parametrize(("friction", "expected"), [(0.2, 0.2 * WEIGHT / 500.0), (2.0, WEIGHT * 0.5 / (500.0 * 2 / 3))])
def test_a_dam_slides_or_overturns(friction: float, expected: float) -> None:
    """Statics: μW = λH where it slides; W b/2 = λ H h/3 where it overturns."""
    assert solve(parse_scene(dam(friction, WATER))).load_factor == pytest.approx(expected, rel=1e-9)


def test_direction_of_the_points_and_pieces_do_not_matter() -> None:
    downwards = {"face": {"along": [[0, 2], [0, 0.7], [0, 0]]}, "pressure": [0.0, 1000.0]}
    one, other = (build_assembly(parse_scene(dam(0.5, load))) for load in (WATER, downwards))
    assert np.allclose(one.live, other.live, rtol=1e-13, atol=1e-10)
    assert one.live[1] == pytest.approx([500.0, 0.0, 500.0 * (1.0 - 2 / 3)], rel=1e-12)


def test_pressure_all_around_presses_on_the_interface_alone() -> None:
    """Uniform pressure on a closed outline is in balance: what is left is that on the covered base, downwards."""
    around = {"face": {"between": ["b", "outside"]}, "pressure": 1000.0}
    live = build_assembly(parse_scene(dam(0.5, around))).live
    assert live[1] == pytest.approx([0.0, -1000.0 * 1.0 * 0.5, 0.0], abs=1e-9)


def test_pressure_stays_off_interfaces() -> None:
    """The lower half of the right side is covered by a second block."""
    scene = dam(0.5, {"face": {"between": ["b", "outside"]}, "pressure": 100.0})
    scene["elements"].append({"id": "c", "polygon": [[1, 0], [2, 0], [2, 1], [1, 1]]})
    live = build_assembly(parse_scene(scene)).live
    # free: left 2 m pushes right, right upper 1 m pushes left, top 1 m pushes down
    assert live[1, :2] == pytest.approx([0.5 * 100.0 * (2.0 - 1.0), -0.5 * 100.0], rel=1e-12)
    # about the centroid (0.5, 1): left none, right at height 1.5 gives +0.5 · 50
    assert live[1, 2] == pytest.approx(0.5 * 100.0 * 1.0 * 0.5, rel=1e-12)


def test_pressure_around_a_solid() -> None:
    """A cube on a support: the same balance in space; sliding at μ(W + λpA) under a push of λP."""
    scene = {
        "elements": [box("ground", [-1, -1, -1], [2, 2, 0], support=True), box("b", [0, 0, 0], [1, 1, 1])],
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.5}},
        "loads": {
            "dead": [{"face": {"between": ["b", "outside"]}, "pressure": 3000.0}],
            "live": [{"element": "b", "force": [1000.0, 0, 0], "at": [0.5, 0.5, 0.0]}],
        },
    }
    result = solve(parse_scene(scene))
    assert result.assembly.dead[1, :3] == pytest.approx([0, 0, -2000 * 9.81 - 3000.0], abs=1e-6)
    assert result.load_factor == pytest.approx(0.5 * (2000 * 9.81 + 3000.0) / 1000.0, rel=1e-7)


def test_rotation_does_not_matter() -> None:
    angle = np.deg2rad(23.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    plain = dam(2.0, WATER)
    turned = dam(2.0, {"face": {"along": (np.array([[0, 0], [0, 2.0]]) @ turn.T).tolist()}, "pressure": [1000.0, 0.0]})
    for element in turned["elements"]:
        element["polygon"] = (np.array(element["polygon"]) @ turn.T).tolist()
    turned["materials"]["gravity"] = (turn @ [0.0, -9.81]).tolist()
    assert solve(parse_scene(turned)).load_factor == pytest.approx(solve(parse_scene(plain)).load_factor, rel=1e-9)


def test_sensitivities_by_vertices_are_unknown_under_pressure() -> None:
    assert geometry_sensitivities(solve(parse_scene(dam(0.2, WATER)))) is None


REFUSED = [
    ({"face": {"along": [[0, 0], [0.5, 0]]}, "pressure": 1.0}, "is free boundary"),
    ({"face": {"along": [[5, 0], [6, 0]]}, "pressure": 1.0}, "0 is free boundary"),
    ({"face": {"along": [[0, 0], [0, 0]]}, "pressure": 1.0}, "coincide"),
    ({"face": {"between": ["b", "ground"]}, "pressure": 1.0}, "no free face lies between"),
    ({"face": {"between": ["ground", "outside"]}, "pressure": 1.0}, "is a support"),
    ({"face": {"between": ["b", "outside"]}, "pressure": [0.0, 1.0]}, "the pressure varies"),
    ({"face": {}, "pressure": 1.0}, "it names no place"),
    ({"face": {"between": ["b", "outside"], "along": [[0, 0], [0, 2]]}, "pressure": 1.0}, "is given together with"),
    ({"face": {"between": ["b", "outside"]}}, "missing"),
    ({"face": {"between": ["b", "outside"]}, "pressure": 1.0, "force": [0, 1]}, "force"),
]


@pytest.mark.parametrize(("load", "words"), REFUSED)
def test_wrong_pressures_are_refused_in_one_line(load: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        build_assembly(parse_scene(dam(0.5, load)))
    assert words in str(refused.value)
    assert "loads.live[0]" in str(refused.value)
    assert "\n" not in str(refused.value)


def bridge(**moving: Any) -> dict[str, Any]:
    """A beam of three blocks between two supports, all of one height."""
    blocks = [{"id": f"b{k}", "polygon": [[k, 0], [k + 1, 0], [k + 1, 1], [k, 1]]} for k in range(3)]
    left = {"id": "left", "support": True, "polygon": [[-1, 0], [0, 0], [0, 1], [-1, 1]]}
    right = {"id": "right", "support": True, "polygon": [[3, 0], [4, 0], [4, 1], [3, 1]]}
    inner = {"tensile_strength": 1e6, "shear_strength": 1e6}
    return {
        "elements": [left, *blocks, right],
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "labels": {"default": "inner", "inner": [["left", "b0"], ["b2", "right"]]},
        "loads": {"moving": [{"axles": [{"weight": 1000.0}], "path": [[0, 1], [3, 1]], "steps": 7, **moving}]},
    }


def test_a_moving_load_is_the_least_of_its_positions() -> None:
    moving = solve(parse_scene(bridge()))
    expected = {}
    for place in np.linspace(0.0, 3.0, 7).tolist():
        # on a joint the load stands on either block; at the ends of the path a support carries it alone
        sides = sorted({int(np.floor(place)), int(np.ceil(place)) - 1} & {0, 1, 2}, reverse=True)
        for number, block in enumerate(sides):
            scene = bridge()
            scene["loads"] = {"live": [{"element": f"b{block}", "force": [0.0, -1000.0], "at": [place, 1.0]}]}
            behind = number or (block < place - 1e-9 and place == 3.0)
            name = f"moving at {place:g}" + (" behind the joint" if behind else "")
            expected[name] = solve(parse_scene(scene)).load_factor
    assert {name: case.load_factor for name, case in moving.cases.items()} == pytest.approx(expected, rel=1e-6)
    assert moving.load_factor == pytest.approx(min(expected.values()), rel=1e-6)
    assert list(moving.cases)[1] == "moving at 0.5"


@pytest.mark.parametrize("both", [False, True])
def test_an_axle_on_a_joint_is_the_limit_from_either_side(both: bool) -> None:
    """A bar of one strong stone between loose ones: just before the joint it tips, just behind it another does."""
    scene = {
        "grid": {"cell": [0.5, 0.4], "thickness": 0.3, "rows": ["#aaab", "....#"]},
        "materials": dry_and_inner(1, 0.0, 1e5, 1e7),
        "labels": {"inner": [["c0r0", "c1r0"]]},
    }

    def factor(place: float, steps: int, length: float) -> float:
        path = [[place, 0.8], [place + length, 0.8]]
        moving = {"axles": [{"weight": 1000.0}], "path": path, "steps": steps, "both_directions": both}
        return solve(parse_scene({**scene, "loads": {"moving": [moving]}})).load_factor

    nearby = min(factor(x, 1, 0.1) for x in (1.0 - 1e-4, 1.0 + 1e-4, 1.5 - 1e-4, 1.5 + 1e-4, 2.0 - 1e-4, 2.0 + 1e-4))
    assert factor(0.5, 5, 2.0) == pytest.approx(nearby, rel=1e-3)


def test_axles_follow_each_other_and_turn_round() -> None:
    scene = bridge(
        axles=[{"weight": 3.0}, {"weight": 1.0, "distance": 0.5}], path=[[0.25, 1], [2.75, 1]], both_directions=True
    )
    cases = build_assembly(parse_scene(scene)).cases
    assert len(cases) == 14
    there, back = cases[3], cases[10]
    assert (there.name, back.name) == ("moving at 1.5", "moving back at 1.5")
    # the first axle has gone 1.5 of 2.5, the second follows by 0.5; the way back is the mirror image
    for case, places in ((there, (1.75, 1.25)), (back, (1.25, 1.75))):
        assert case.live_loads.points.at.tolist() == [[place, 1.0] for place in places]
        assert case.live_loads.points.force.tolist() == [[0.0, -3.0], [0.0, -1.0]]


@pytest.mark.parametrize(
    ("moving", "words"),
    [
        ({"path": [[0, 1], [3, 2]]}, "no element is at"),
        ({"path": [[0, 1], [0, 1]]}, "coincide"),
        ({"path": [[-1, 1], [-0.5, 1]]}, "supports alone"),
        ({"axles": []}, "axles"),
        ({"steps": 0}, "steps"),
        ({"axles": [{"weight": -1.0}]}, "weight"),
    ],
)
def test_wrong_moving_loads_are_refused_in_one_line(moving: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        build_assembly(parse_scene(bridge(**moving)))
    assert words in str(refused.value)
    assert "loads.moving[0]" in str(refused.value)
