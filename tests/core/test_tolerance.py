"""Drawings that are nearly right: gaps and overlaps within the tolerance are closed, what is outside is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from jld_core import Assembly, InputError, build_assembly, parse_scene, solve

BRICK = (0.2, 0.06)


def wall(courses: int = 6, length: int = 4, joint: float = 0.0) -> dict[str, Any]:
    """A running bond pushed along, its bricks shrunk by half a joint on every side; the slab keeps its top edge."""
    wide, high = BRICK
    half = 0.5 * joint
    slab = [[0, -high], [length * wide, -high], [length * wide, -half], [0, -half]]
    elements: list[dict[str, Any]] = [{"id": "slab", "polygon": slab, "support": True}]
    for course in range(courses):
        whole = np.arange(length + 1) * wide
        ends = whole if course % 2 == 0 else np.concatenate([[0.0], whole[:-1] + 0.5 * wide, whole[-1:]])
        low, top = course * high + half, (course + 1) * high - half
        for k, (a, b) in enumerate(zip(ends[:-1] + half, ends[1:] - half, strict=True)):
            elements.append({"id": f"c{course}b{k}", "polygon": [[a, low], [b, low], [b, top], [a, top]]})
    return {
        "elements": elements,
        "thickness": 0.1,
        "materials": {"density": 1800, "dry": {"friction_coefficient": 0.65}},
        "labels": {"default": "dry"},
        "loads": {"live": [{"body": [1, 0]}]},
    }


def shaken(document: dict[str, Any], error: float, seed: int) -> dict[str, Any]:
    """The same with every coordinate off by up to an error, each brick on its own, as drawn by hand."""
    rng = np.random.default_rng(seed)
    moved = [
        {**element, "polygon": (np.array(element["polygon"]) + rng.uniform(-error, error, (4, 2))).tolist()}
        for element in document["elements"]
    ]
    return {**document, "elements": moved}


def pairs(assembly: Assembly) -> set[tuple[str, str]]:
    ids, faces = assembly.elements.ids, assembly.interfaces
    return {(ids[a], ids[b]) for a, b in zip(faces.a, faces.b, strict=True)}


@pytest.fixture(scope="module")
def ideal() -> tuple[set[tuple[str, str]], float]:
    assembly = build_assembly(parse_scene(wall()))
    assert assembly.moved == 0.0
    assert assembly.warnings == ()
    return pairs(assembly), solve(assembly).load_factor


@pytest.mark.parametrize("error", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(4))
def test_a_shaken_drawing_is_the_wall(error: float, seed: int, ideal: tuple[set[tuple[str, str]], float]) -> None:
    """Errors of 0.01, 0.1 and 1 mm on bricks of 200 × 60 mm; λ to the order of the error, error / 60 mm."""
    assembly = build_assembly(parse_scene({**shaken(wall(), error, seed), "tolerance": 3.5 * error}))
    assert pairs(assembly) == ideal[0]
    assert len(assembly.interfaces) == len(ideal[0])
    assert 0.0 < assembly.moved <= 3.5 * error * 1.5
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=3.0 * error / BRICK[1])


def test_uniform_joints_close(ideal: tuple[set[tuple[str, str]], float]) -> None:
    """Joints of 1 mm left open, as bricks are drawn."""
    assembly = build_assembly(parse_scene({**wall(joint=1e-3), "tolerance": 2e-3}))
    assert pairs(assembly) == ideal[0]
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=3e-3 / BRICK[1])


def test_a_head_joint_opened_by_a_micrometre_is_closed(ideal: tuple[set[tuple[str, str]], float]) -> None:
    """The default is 1e-4 of the shortest edge, 6 µm here."""
    assembly = build_assembly(parse_scene(wall(joint=1e-6)))
    assert pairs(assembly) == ideal[0]
    assert solve(assembly).load_factor == pytest.approx(ideal[1], rel=1e-4)


def test_elements_that_nearly_touch_are_a_warning() -> None:
    document = wall()
    for element in document["elements"]:
        if element["id"] == "c0b1":  # a head joint of 0.1 mm, open beyond the default
            element["polygon"][0][0] += 1e-4
            element["polygon"][3][0] += 1e-4
    assembly = build_assembly(parse_scene(document))
    assert "not joined: 'c0b0' and 'c0b1' are 0.0001 m apart at (0.20005, 0.03)" in assembly.warnings[0]
    assert build_assembly(parse_scene({**document, "tolerance": 2e-4})).warnings == ()


def test_all_overlaps_are_named_with_depth_and_place() -> None:
    document = wall(joint=-2e-3)
    with pytest.raises(InputError) as caught:
        build_assembly(parse_scene(document))
    text = str(caught.value)
    assert text.startswith("elements 'slab' and 'c0b0': they overlap by 0.002 at (")
    assert text.count(" by 0.002 at (") == 10
    assert "more pairs" in text
    build_assembly(parse_scene({**document, "tolerance": 4e-3}))


def test_hanging_nodes_doubled_vertices_and_outlines_that_touch_themselves() -> None:
    plain = build_assembly(parse_scene(wall()))
    document = wall()
    for element in document["elements"]:
        (x0, y0), (x1, _), (_, y1), _ = element["polygon"]
        middle = 0.5 * (x0 + x1)
        # doubled corner, a corner in a straight edge off by 1e-7, a spike of 1e-7 there and back
        element["polygon"] = [[x0, y0], [x0 + 1e-9, y0], [middle, y0 + 1e-7], [x1, y0], [x1, y1], [x1 + 1e-7, y1]]
        element["polygon"] += [[x1, y1], [x0, y1]]
    assembly = build_assembly(parse_scene({**document, "tolerance": 1e-5}))
    assert pairs(assembly) == pairs(plain)
    assert solve(assembly).load_factor == pytest.approx(solve(plain).load_factor, rel=1e-4)


def test_spatial_gaps_close() -> None:
    def cubes(gap: float) -> dict[str, Any]:
        faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]

        def box(low: float, high: float) -> list[list[float]]:
            return [[x, y, z] for z in (low, high) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]

        return {
            "elements": [
                {"id": "base", "vertices": box(-1, 0), "faces": faces, "support": True},
                {"id": "one", "vertices": box(gap, 1 + gap), "faces": faces},
                {"id": "two", "vertices": box(1 + 2 * gap, 2 + 2 * gap), "faces": faces},
            ],
            "materials": {"density": 2000, "dry": {"friction_coefficient": 0.65}},
            "labels": {"default": "dry"},
            "loads": {"live": [{"body": [1, 0, 0]}]},
        }

    assembly = build_assembly(parse_scene({**cubes(1e-3), "tolerance": 2e-3}))
    assert len(assembly.interfaces) == 2
    assert 0.0 < assembly.moved <= 2e-3
    assert solve(assembly).load_factor == pytest.approx(0.5, rel=2e-3)  # two cubes rock at b / (2 h)
    with pytest.raises(InputError, match="no path of interfaces"):
        build_assembly(parse_scene(cubes(1e-3)))
    with pytest.raises(InputError, match=r"they overlap by 0.001 at \(0\.\d+, 0\.\d+, -0.0005\); so do"):
        build_assembly(parse_scene({**cubes(-1e-3), "tolerance": 0}))


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_the_default_is_relative(scale: float) -> None:
    """The same drawing in metres and millimetres."""
    document = shaken(wall(), 1e-6, 0)
    for element in document["elements"]:
        element["polygon"] = (scale * np.array(element["polygon"])).tolist()
    assembly = build_assembly(parse_scene({**document, "units": {"length": "mm", "force": "N"}}))
    assert len(assembly.interfaces) == len(pairs(build_assembly(parse_scene(wall()))))
