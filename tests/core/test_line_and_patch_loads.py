"""Loads along part of an edge and on part of a surface: resultants, λ in closed form, units and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases_spatial import box
from jld_core import InputError, build_assembly, parse_scene, solve


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
    with pytest.raises(InputError, match=message) as found:
        build_assembly(parse_scene(slope(live)))
    assert "\n" not in str(found.value)


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
    with pytest.raises(InputError, match=r"loads\.live\[0\]\.face\.patch: .*" + message) as found:
        build_assembly(parse_scene(cubes({"face": {"patch": patch}, **load})))
    assert "\n" not in str(found.value)


def test_supports_below_a_patch_take_their_part() -> None:
    """A patch over the top of a low support and nothing else carries no load; beside a column it carries its part."""
    scene = cubes({"face": {"patch": [[2, 0, 0], [3, 0, 0], [3, 1, 0], [2, 1, 0]]}, "pressure": 1.0})
    with pytest.raises(InputError, match="the live load is zero"):
        build_assembly(parse_scene(scene))
