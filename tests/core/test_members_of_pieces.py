"""Members at common corners of cells are shared by them: a layout and its mirror image have the same λ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.refinement import refine

WIDTH = 4


def beam(member: dict[str, Any], tension: float, flip: bool) -> dict[str, Any]:
    """Four dry blocks on two supports, held together by a tendon and one more member; `flip` mirrors everything."""

    def anchor(column: int, row: int, x: float, y: float) -> dict[str, Any]:
        column, x = (WIDTH - 1 - column, WIDTH - x) if flip else (column, x)
        return {"element": f"c{column}r{row}", "at": [x, y]}

    tendon = {"kind": "tendon", "from": anchor(0, 0, 0.1, 1.3), "to": anchor(3, 0, 3.85, 1.3), "prestress": 1e4}
    places = {key: anchor(*member[key]) for key in ("from", "to")}
    push = {**anchor(1, 0, 1.4, 2.0), "force": [-1e3 if flip else 1e3, -3e3]}
    inner = {"tensile_strength": tension, "shear_strength": 1.5 * tension, "friction_coefficient": 0.5}
    return {
        "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": ["dcba" if flip else "abcd", "#..#"]},
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"live": [push]},
        "members": [{**member, **places}, tendon],
        "cracks": {"kind": "cells", "cell": 0.5},
    }


@pytest.mark.parametrize("tension", [2e3, 5e3])
@pytest.mark.parametrize(
    "member",
    [
        {"kind": "tendon", "from": (0, 0, 0.5, 1.5), "to": (2, 0, 2.5, 1.5), "prestress": 4e4},
        {
            "kind": "tendon",
            "from": (0, 0, 0.5, 1.5),
            "to": (3, 0, 3.6, 1.6),
            "prestress": 4e4,
            "tension": {"nominal": 5e4, "low": 4.5e4},
        },
        {"kind": "pin", "from": (1, 0, 2.0, 1.5), "to": (2, 0, 2.0, 1.5), "shear": 4e3, "prestress": 3e4},
    ],
)
def test_mirror_images_with_members_at_corners_of_cells_are_alike(member: dict[str, Any], tension: float) -> None:
    one, other = (solve(beam(member, tension, flip)) for flip in (False, True))
    assert one.status == other.status == "collapse"
    assert one.load_factor == pytest.approx(other.load_factor, rel=1e-8)


@pytest.mark.parametrize(
    ("at", "names", "shear"),
    [
        ([1.0, 0.5, 0.5], {f"pin 1 ({k} of 4)" for k in (1, 2, 3, 4)}, 250.0),
        ([1.0, 0.5, 0.2], {"pin 1 (1 of 2)", "pin 1 (2 of 2)"}, 500.0),
        ([1.0, 0.3, 0.2], {"pin 1"}, 1e3),
    ],
)
def test_a_pin_without_length_is_shared_along_its_face(at: list[float], names: set[str], shear: float) -> None:
    """Two cubes beside each other, each cut in eight; pieces that touch in an edge or corner alone share nothing."""
    elements = []
    for k, name in enumerate(("a", "b", "s")):
        vertices = [[x + k % 2, y, z - k // 2] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
        faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        elements.append({"id": name, "vertices": vertices, "faces": faces, "support": name == "s"})
    pin = {"kind": "pin", "from": {"element": "a", "at": at}, "to": {"element": "b", "at": at}, "shear": 1e3}
    scene = parse_scene(
        {
            "elements": elements,
            "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
            "loads": {"live": [{"body": [1, 0, 0]}]},
            "members": [pin],
        }
    )
    members = build_assembly(refine(scene, (0.5, 0.5, 0.5)).scene).members
    assert set(members.names) == names
    assert members.shear == pytest.approx([shear] * len(names))
    assert np.abs(members.axis) == pytest.approx(np.array([[1.0, 0.0, 0.0]] * len(names)))


@pytest.mark.parametrize("back", [False, True])
def test_the_axis_of_a_pin_where_two_faces_meet_is_asked_for(back: bool) -> None:
    """A block in the corner of an L: the order of the two faces would choose the axis."""
    angle = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    elements = [
        {"id": "l", "polygon": angle},
        {"id": "b", "polygon": [[1, 1], [2, 1], [2, 2], [1, 2]]},
        {"id": "s", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
    ]
    ends = {key: {"element": name, "at": [1, 1]} for key, name in (("from", "l"), ("to", "b"))}
    scene = {
        "elements": elements[::-1] if back else elements,
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": [{"body": [1, 0]}]},
        "members": [{"kind": "pin", **ends, "shear": 1e3}],
    }
    with pytest.raises(InputError, match="meet at an angle"):
        build_assembly(parse_scene(scene))


def test_shares_of_an_uncertain_member_are_asked_for() -> None:
    """A file of shares would hold values that vary each by itself; λ by cells is that of the mean."""
    member = {"kind": "tendon", "from": (0, 0, 0.5, 1.5), "to": (2, 0, 2.5, 1.5), "prestress": 4e4}
    document = beam({**member, "tension": {"mean": 6e4, "cov": 0.1, "kind": "lognormal"}}, 2e3, False)
    with pytest.raises(InputError, match="uncertain"):
        refine(parse_scene(document), (0.5, 0.5))
    mean = solve(beam({**member, "tension": 6e4}, 2e3, False))
    assert solve(document).load_factor == pytest.approx(mean.load_factor, rel=1e-9)
