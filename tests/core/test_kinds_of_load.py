"""Loads of every kind: as they act, on lines and patches, of pressure, in every direction, and such as cancel."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases import box, dry_and_inner
from command import refused
from jld_core import InputError, build_assembly, geometry_sensitivities, parse_scene, resultants, solve
from jld_core.build import loads


def squares(low: np.ndarray, high: np.ndarray, count: int) -> tuple[np.ndarray, float]:
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
        one = loads.Traction(0, rings, base + middle @ frame, mean, slope)
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


# Loads along part of an edge and on part of a surface: resultants, λ in closed form, units and refusals.


def slope(*live: dict[str, Any], **units: str) -> dict[str, Any]:
    """Two blocks under a slope from (0, 1) to (4, 4), which meet at x = 2; unit weight each."""
    return {
        "units": units,
        "elements": [
            {"id": "g", "support": True, "polygon": [[-1, -1], [5, -1], [5, 0], [-1, 0]]},
            {"id": "a", "polygon": [[0, 0], [2, 0], [2, 2.5], [0, 1]], "weight": 1.0},
            {"id": "b", "polygon": [[2, 0], [4, 0], [4, 4], [2, 2.5]], "weight": 1.0},
        ],
        "thickness": 0.5,
        "materials": {"dry": {"friction_coefficient": 0.5}},
        "loads": {"live": list(live)},
    }


def test_a_line_load_acts_along_part_of_the_edges() -> None:
    """From x = 1 to x = 4: 1.25 m of the slope on a and 2.5 m on b, each force at its middle whatever the thickness."""
    line = {"face": {"along": [[4, 4], [1, 1.75]]}, "line": [1.0, -3.0]}
    assembly = build_assembly(parse_scene(slope(line)))
    found = {tuple(at.tolist()): force for _, at, force in assembly.live_loads.arrows()}
    assert found[1.5, 2.125] == pytest.approx((1.25, -3.75))
    assert found[3.0, 3.25] == pytest.approx((2.5, -7.5))
    for k, (x, y, force) in enumerate([(1.5, 2.125, (1.25, -3.75)), (3.0, 3.25, (2.5, -7.5))], 1):
        arm = np.array([x, y]) - assembly.elements.centroid[k]
        assert assembly.live[k] == pytest.approx([*force, arm[0] * force[1] - arm[1] * force[0]])
    reverse = {**line, "face": {"along": [[1, 1.75], [2, 2.5], [4, 4]]}}
    assert np.allclose(build_assembly(parse_scene(slope(reverse))).live, assembly.live, rtol=1e-12, atol=1e-12)


def test_a_line_load_equals_many_point_loads() -> None:
    """The midpoint rule over 1 000 pieces, an independent route."""
    line = {"face": {"along": [[2, 2.5], [4, 4]]}, "line": [0.7, -2.0]}
    shares = (np.arange(1000) + 0.5) / 1000
    points = [
        {"element": "b", "force": [0.7 * 2.5e-3, -2.0 * 2.5e-3], "at": [2 + 2 * s, 2.5 + 1.5 * s]}
        for s in shares.tolist()
    ]
    one, many = (build_assembly(parse_scene(slope(*loads))).live for loads in ([line], points))
    assert np.allclose(one, many, rtol=1e-9, atol=1e-9)


def test_a_line_load_has_a_unit() -> None:
    line = {"face": {"along": [["2 m", "2500 mm"], [4, 4]]}, "line": ["0 N/m", "-2 kN/m"]}
    live = build_assembly(parse_scene(slope(line, length="m", force="kN"))).live
    assert live[2, :2] == pytest.approx([0.0, -5.0])
    with pytest.raises(InputError, match=r"live\[0\]\.line\[1\]: 'kN/m²' is no unit of this quantity"):
        parse_scene(slope({**line, "line": [0, "-2 kN/m²"]}))


def cubes(*live: dict[str, Any]) -> dict[str, Any]:
    """Two columns 1 × 1 × 2 of weight 1 beside each other along x, on a wide support."""
    return {
        "elements": [
            box("g", (-2, -2, -1), (4, 3, 0), support=True),
            box("a", (0, 0, 0), (1, 1, 2), weight=1.0),
            box("b", (1, 0, 0), (2, 1, 2), weight=1.0),
        ],
        "materials": {"dry": {"friction_coefficient": 5.0}},
        "loads": {"live": list(live)},
    }


TOP = [[0.5, 0.2, 2], [1.8, 0.2, 2], [1.8, 0.6, 2], [0.5, 0.6, 2]]
"""Patch on the top of both columns: 0.5 × 0.4 of a and 0.8 × 0.4 of b."""


@pytest.mark.parametrize("load", [{"pressure": 10.0}, {"traction": [3.0, -1.0, 2.0]}])
def test_a_patch_is_shared_by_area(load: dict[str, Any]) -> None:
    per_area = np.array(load.get("traction", [0.0, 0.0, -10.0]))
    for corners in (TOP, TOP[::-1], TOP[2:] + TOP[:2]):
        assembly = build_assembly(parse_scene(cubes({"face": {"patch": corners}, **load})))
        for k, area, at in ((1, 0.2, (0.75, 0.4, 2.0)), (2, 0.32, (1.4, 0.4, 2.0))):
            arm = np.array(at) - assembly.elements.centroid[k]
            assert assembly.live[k] == pytest.approx([*(area * per_area), *np.cross(arm, area * per_area)], abs=1e-12)


def test_a_patch_overturns_a_column() -> None:
    """Statics: p on the upper half of the side y = 0 of a column: W b/2 = λ p A · 3/2."""
    half = [[0, 0, 1], [1, 0, 1], [1, 0, 2], [0, 0, 2]]
    scene = cubes({"face": {"patch": half}, "pressure": 0.2})
    scene["elements"] = scene["elements"][:2]
    assert solve(parse_scene(scene)).load_factor == pytest.approx(0.5 / (0.2 * 1.5), rel=1e-6)


@pytest.mark.parametrize(
    ("live", "message"),
    [
        ({"face": {"along": [[0, 1], [4, 5]]}, "line": [0, 1]}, r"face\.along: of its .* is free boundary"),
        ({"face": {"along": [[0, 1], [4, 4]]}, "line": [0, 1, 0]}, r"face\.along: it is for planar scenes"),
        ({"face": {"between": ["a", "outside"]}, "line": [0, 1]}, r'\.line: it is given without "along"'),
        (
            {"face": {"along": [[0, 1], [4, 4]]}, "line": [0, 1], "pressure": 1.0},
            r'\.line: it is given together with "pressure"',
        ),
        ({"face": {"along": [[0, 1], [4, 4]]}}, r"\.pressure: missing"),
        ({"face": {"along": [[0, 1], [4, 4]]}, "traction": [0, 1]}, r'\.traction: it is given without "patch"'),
        ({"face": {"patch": [[0, 1], [4, 4], [0, 0]]}, "pressure": 1.0}, r"\.patch: it is for spatial scenes"),
        (
            {"face": {"patch": TOP, "along": [[0, 1], [4, 4]]}, "pressure": 1.0},
            r'"patch" is given together with "along"',
        ),
    ],
)
def test_bad_loads_in_the_plane_are_one_line(live: dict[str, Any], message: str) -> None:
    with refused(match=message):
        build_assembly(parse_scene(slope(live)))


@pytest.mark.parametrize(
    ("patch", "load", "message"),
    [
        ([[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]], {"pressure": 1.0}, "of its area of 1, 0 is free surface"),
        ([[0, 0, 2], [3, 0, 2], [3, 1, 2], [0, 1, 2]], {"pressure": 1.0}, "of its area of 3, 2 is free surface"),
        ([[0, 0, 2], [1, 0, 2], [1, 1, 1], [0, 1, 2]], {"pressure": 1.0}, "its corners lie on no plane"),
        ([[0, 0, 2], [1, 0, 2], [2, 0, 2]], {"pressure": 1.0}, "its corners lie on no plane"),
        ([[0, 0, 2], [1, 1, 2], [1, 0, 2], [0, 0.5, 2]], {"pressure": 1.0}, "its outline crosses itself"),
        (TOP, {"pressure": [1.0, 2.0]}, "the pressure varies"),
        (TOP, {"traction": [1.0, 0.0]}, "three numbers"),
    ],
)
def test_bad_patches_are_one_line(patch: list[list[float]], load: dict[str, Any], message: str) -> None:
    with refused(match=r"loads\.live\[0\]\.face\.patch: .*" + message):
        build_assembly(parse_scene(cubes({"face": {"patch": patch}, **load})))


def test_supports_below_a_patch_take_their_part() -> None:
    """A patch over the top of a low support and nothing else carries no load; beside a column it carries its part."""
    scene = cubes({"face": {"patch": [[2, 0, 0], [3, 0, 0], [3, 1, 0], [2, 1, 0]]}, "pressure": 1.0})
    with pytest.raises(InputError, match="the live load is zero"):
        build_assembly(parse_scene(scene))


# Pressure on free faces and loads that move: closed forms, sums over boundaries, and refusals.


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
    with refused(words, "loads.live[0]"):
        build_assembly(parse_scene(dam(0.5, load)))


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


@pytest.mark.sampled(2)
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
    with refused(words, "loads.moving[0]"):
        build_assembly(parse_scene(bridge(**moving)))


# Pushes in several directions: closed forms in the plane and in space, rotation, files, and refusals.


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
    with refused(match=message):
        build_assembly(parse_scene(block(0.3, pushes)))


def test_pushes_stand_beside_no_live_load() -> None:
    scene = block(0.3, {"directions": 2})
    scene["loads"]["live"] = [{"body": [1, 0]}]
    with pytest.raises(InputError, match=r'loads\.live: it is given together with "pushes"'):
        parse_scene(scene)


# Loads that cancel within a block leave nothing: λ of the block is that of the block without them, in any units.


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


def block_of_weight(pair: Document, push: Document, length: float = 1.0, force: float = 1.0) -> Document:
    """A block of two elements on the ground."""
    inner = {"tensile_strength": 1e9, "shear_strength": 1e9}
    document = {
        "elements": [
            {"id": "a", "polygon": [[0, 0], [1, 0], [1, 0.7], [0, 0.7]], "block": "A"},
            {"id": "b", "polygon": [[1, 0], [2.1, 0], [2.1, 0.7], [1, 0.7]], "block": "A"},
            {"id": "g", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True},
        ],
        "thickness": 1.0,
        "materials": {"density": pair.get("density", 0.0), "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"dead": pair.get("dead", []), "live": [push]},
        "members": pair.get("members", []),
    }
    return scaled(document, "", length, force)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("length", "force"), [(1.0, 1.0), (1e3, 1e-3), (0.01, 1e4)])
@pytest.mark.parametrize("name", PAIRS)
def test_nothing_is_left_of_what_cancels(name: str, length: float, force: float) -> None:
    """A block without weight on a dry joint slides at λ = 0, and stands."""
    result = solve(build_assembly(parse_scene(block_of_weight(PAIRS[name], PUSH, length, force))))
    low, high = result.bracket
    assert result.status == "collapse"
    assert low == pytest.approx(0.0, abs=1e-9)
    assert high == pytest.approx(0.0, abs=1e-6)
    assert result.stands_at_zero is True


@pytest.mark.parametrize("name", PAIRS)
def test_what_presses_counts_beside_what_cancels(name: str) -> None:
    """A weight of 100 pressed on in the middle slides at 0.6 · 100, whatever cancels."""
    document = block_of_weight(PAIRS[name], PUSH)
    document["loads"]["dead"] = [*document["loads"]["dead"], {"element": "a", "force": [0, -100], "at": [1.05, 0.0]}]
    document["loads"]["live"] = [{**PUSH, "at": [0.5, 0.0]}]
    result = solve(build_assembly(parse_scene(document)))
    assert result.load_factor == pytest.approx(60.0, rel=1e-6)
