"""Tenons and numbers of parts: exact volumes, nothing overlaps, nothing collides on the way in, files are closed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold

from jld_cut.cells import Cutting, Joint, joints_of
from jld_cut.marks import add_tenons, engrave
from jld_cut.parts import Part, lay, parts_of, write_parts


def box_in_three(gap: float) -> tuple[list[Part], list[Joint]]:
    """A box 1 × 0.6 × 1.2 whose upper half is cut in two; the base is laid first, the others come down on it."""
    cutting = Cutting(Manifold.cube((1.0, 0.6, 1.2)))
    cutting.through(np.array([0.0, 0.0, 1.0]), 0.6)
    upper = [k for k, cell in enumerate(cutting.cells) if cell.bounding_box()[2] > 0.5]
    cutting.through(np.array([1.0, 0.0, 0.0]), 0.45, upper)
    joints = joints_of(cutting.cells, cutting.planes, cutting.size)
    parts = parts_of(cutting.cells, np.arange(3), joints, 2400.0, gap)
    for step, part in enumerate(sorted(parts, key=lambda part: part.exact.bounding_box()[2]), 1):
        part.step, part.direction = step, np.array([0.0, 0.0, -1.0])
    return parts, joints


def fits(part: Part) -> bool:
    return lay(part, np.array([0.7, 1.0, 1.0]))


def shared(parts: list[Part], moved: dict[int, Any] | None = None) -> float:
    """Volume that parts share, some of them moved."""
    solids = [part.solid.translate(tuple((moved or {}).get(part.number, np.zeros(3)))) for part in parts]
    return sum(float((one ^ other).volume()) for k, one in enumerate(solids) for other in solids[:k])


@pytest.mark.parametrize("gap", [0.0, 0.001, 0.01])
def test_tenons_stand_on_what_is_laid_first_and_let_the_rest_come_in(gap: float, tmp_path: Path) -> None:
    parts, joints = box_in_three(gap)
    before = [part.solid.volume() for part in parts]
    assert add_tenons(parts, np.arange(3), joints, gap, fits) == 2
    gained = {part.step: part.solid.volume() - volume for part, volume in zip(parts, before, strict=True)}
    assert gained[1] > 0.0 > max(gained[2], gained[3])
    assert shared(parts) < 1e-12
    for part in parts:
        laid = [other for other in parts if other.step <= part.step]
        for way in np.linspace(0.0, 1.3, 27):
            assert shared(laid, {part.number: -way * part.direction}) < 1e-12
    write_parts(tmp_path, parts, 1.0)
    assert all(part.watertight for part in parts)


def test_no_tenon_where_a_part_slides_past_is_too_thin_or_leaves_the_box() -> None:
    parts, joints = box_in_three(0.0)
    for part in parts:
        part.direction = np.array([1.0, 0.0, 0.0])  # along the level joint
    assert add_tenons(parts, np.arange(3), [joint for joint in joints if abs(joint.normal[2]) > 0.5], 0.0, fits) == 0
    parts, joints = box_in_three(0.0)
    assert add_tenons(parts, np.arange(3), joints, 0.0, lambda part: lay(part, np.array([0.6, 0.6, 1.0]))) == 0
    parts, joints = box_in_three(0.0)
    for part in parts:
        part.solid -= Manifold.cube((2.0, 2.0, 0.58)).translate((-0.5, -0.5, 0.61))  # thin lids on the base
    assert add_tenons(parts, np.arange(3), joints, 0.0, fits) == 0


def test_a_number_is_as_deep_as_stated_and_stays_off_joints() -> None:
    parts, joints = box_in_three(0.0)
    planes = [np.array([*joint.normal, joint.normal @ joint.polygon[0]]) for joint in joints]
    for part in parts:
        before = part.solid
        assert engrave(part, planes, 0.002)
        mark = before - part.solid
        assert np.ptp(np.array(mark.bounding_box()).reshape(2, 3), axis=0).min() == pytest.approx(0.002)
        for plane in planes:
            points = np.array(mark.to_mesh64().vert_properties[:, :3])
            assert np.abs(points @ plane[:3] - plane[3]).min() > 1e-3
    assert not engrave(parts[0], planes, 0.2)
