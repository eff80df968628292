"""Which label a face has: the interface's, else of the lists, the default, or its place; glued supports are said."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import box, prism
from cases import scene_in_space as scene
from jld_core import build_assembly, parse_scene, solve
from jld_core.geometry import polyhedra
from jld_core.refinement import crack_cells

Document = dict[str, Any]


def stack(labels: Document, interface: str | None = None) -> Document:
    """Two blocks of weight 1000 N on a support, pushed at the lower one."""
    document: Document = {
        "elements": [
            {"id": "S", "polygon": [[0, 0], [2, 0], [2, 0.5], [0, 0.5]], "support": True},
            {"id": "B", "polygon": [[0.5, 0.5], [1.5, 0.5], [1.5, 1], [0.5, 1]], "weight": 1000},
            {"id": "C", "polygon": [[0.5, 1], [1.5, 1], [1.5, 1.5], [0.5, 1.5]], "weight": 1000},
        ],
        "materials": {"dry": {"friction_coefficient": 0.5}, "inner": {"tensile_strength": 1e5, "shear_strength": 1e5}},
        "labels": labels,
        "loads": {"live": [{"element": "B", "force": [300, 0], "at": [1, 0.6]}]},
    }
    if interface is not None:
        lines = [(["S", "B"], [[0.5, 0.5], [1.5, 0.5]]), (["B", "C"], [[0.5, 1], [1.5, 1]])]
        document["interfaces"] = [{"elements": pair, "polygon": line} for pair, line in lines]
        document["interfaces"][0]["label"] = interface
    return document


@pytest.mark.parametrize(
    ("labels", "interface", "support", "between"),
    [
        ({}, None, True, True),
        ({"default": "inner"}, None, False, False),
        ({"default": "dry"}, None, True, True),
        ({"default": "inner", "inner": [["B", "S"]]}, None, False, False),
        ({"default": "inner", "dry": [["B", "C"]]}, None, False, True),
        ({"inner": [["S", "B"]]}, None, False, True),
        ({"default": "inner"}, "inner", False, False),
        ({"default": "inner", "inner": [["S", "B"]]}, "dry", True, False),
    ],
)
def test_labels_of_faces(labels: Document, interface: str | None, support: bool, between: bool) -> None:
    """True = dry, at the support and between the blocks; a note says where a default glues supports."""
    built = build_assembly(parse_scene(stack(labels, interface)))
    found = {built.pair(face): bool(dry) for face, dry in enumerate(built.labels)}
    assert found == {"S–B": support, "B–C": between}
    noted = labels.get("default") == "inner" and not support and "inner" not in labels and interface is None
    assert bool(built.notes) == noted


def test_a_support_that_is_named_dry_stays_a_joint() -> None:
    """A stack of 2000 N slides at 0.5 · 2000 / 300."""
    result = solve(build_assembly(parse_scene(stack({"default": "inner", "dry": [["S", "B"]]}))))
    assert result.load_factor == pytest.approx(0.5 * 2000 / 300, rel=1e-6)


# Pieces of a face have the label of the face that contains them, in the plane and in space.


def corner(length: float, height: float, depth: float) -> dict[str, object]:
    """A support with a floor and a wall, made of an outline in x and z."""
    outline = [[-1, -1], [length, -1], [length, 0], [0, 0], [0, height], [-1, height]]
    points = [[x, y, z] for y in (0.0, depth) for x, z in outline]
    sides = [[(k + 1) % 6, k, k + 6, (k + 1) % 6 + 6] for k in range(6)]
    return {"id": "s", "vertices": points, "faces": [list(range(6)), list(range(11, 5, -1)), *sides], "support": True}


@pytest.mark.parametrize("size", [(4.0, 1.0, 1.0), (1.0, 3.0, 0.5), (2.6, 0.7, 1.3)])
def test_pieces_in_a_corner(size: tuple[float, float, float]) -> None:
    """A box on a floor and against a wall: pieces of the floor face are those with its normal."""
    length, height, depth = size
    document = scene([box("b", [0, 0, 0], [length, depth, height]), corner(length, height, depth)])
    parsed = parse_scene(document | {"cracks": {"kind": "cells", "cell": 0.5}})
    joints = build_assembly(parsed)
    cells = crack_cells(parsed, joints, 0.5)
    assert len(joints.interfaces) == 2
    across = cells.face >= 0
    of_normal = abs(cells.fine.interfaces.normal @ joints.interfaces.normal.T).argmax(axis=1)
    np.testing.assert_array_equal(cells.face[across], of_normal[across])


def test_a_box_glued_to_a_wall_on_a_dry_floor() -> None:
    """λ of an independent program, of a box of 4 × 1 × 1 in four cells: dry floor and glued wall."""
    document = scene([box("b", [0, 0, 0], [4, 1, 1]), corner(4.0, 1.0, 1.0)])
    inner = {"tensile_strength": 1e5, "shear_strength": 1e5}
    document["materials"] = {"density": 2000.0, "dry": {"friction_coefficient": 0.5}, "inner": inner}
    parsed = parse_scene(document | {"cracks": {"kind": "cells", "cell": 1.0}})
    joints = build_assembly(parsed)
    cells = crack_cells(parsed, joints, 1.0)
    floor = abs(joints.interfaces.normal[:, 2]) > 0.5
    assert solve(cells.fine, cells.labels(np.ones(2, dtype=bool))).load_factor == pytest.approx(0.5, rel=1e-6)
    assert solve(cells.fine, cells.labels(floor)).load_factor == pytest.approx(2.41131, rel=1e-5)


def distance(name: str, point: np.ndarray) -> float:
    """Distance of a point from the face between a prism of a shape and the slab under it, 1 high."""
    outline = {"ell": [[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], "box": [[0, 0], [3, 0], [3, 3], [0, 3]]}[name]
    built = build_assembly(
        parse_scene(scene([prism("p", outline, 0.0, 1.0), box("slab", [-1, -1, -1], [4, 4, 0], support=True)]))
    )
    return polyhedra.distance_from_face(built.interfaces, 0, point)


@pytest.mark.parametrize(
    ("name", "point", "expected"),
    [
        ("box", [1.0, 2.0, 0.0], 0.0),
        ("box", [1.0, 2.0, 0.4], 0.4),
        ("box", [3.3, 2.0, 0.4], 0.5),
        ("ell", [2.0, 2.0, 0.0], 1.0),
        ("ell", [0.5, 2.5, 0.0], 0.0),
    ],
)
def test_distance_from_a_face(name: str, point: list[float], expected: float) -> None:
    assert distance(name, np.array(point)) == pytest.approx(expected, abs=1e-9)
