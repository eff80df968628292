"""Geometry that moves: the same as at rest where joints are stiff, closed forms of large movements, new contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from studies.scenes import leonardo_flat_arch, stacked_cubes

from jld_core import InputError, build_assembly, parse_scene
from jld_experiment import Joints, Push, Settings, push, run_experiment, specimen_of


def test_stiff_joints_move_as_at_rest() -> None:
    assembly = build_assembly(leonardo_flat_arch())
    rest = run_experiment(assembly)
    moving = run_experiment(assembly, settings=Settings(moving=True))
    assert moving.collapse_load == pytest.approx(rest.collapse_load, rel=2e-3)


def pushed(document: dict[str, Any], joints: Joints, distance: float) -> tuple[Push, float]:
    """A push up to a movement of the centroid of the only free element, of unit weight, and its elastic reach."""
    assembly = build_assembly(parse_scene(document))
    probe = specimen_of(assembly, assembly.labels, joints, Settings(moving=True))
    scale = 0.3
    settings = Settings(moving=True, length=distance / (scale * probe.system.reach), hasten=4.0)
    specimen = specimen_of(assembly, assembly.labels, joints, settings)
    settled, _ = specimen.settle()
    return push(specimen, settled, scale, 100.0, endless=True), probe.system.reach


def block(wide: float, high: float, *others: dict[str, Any]) -> dict[str, Any]:
    """A block of unit weight on a long base, pushed along x."""
    return {
        "elements": [
            {"id": "block", "polygon": [[0, 0], [wide, 0], [wide, high], [0, high]], "weight": 1.0},
            {"id": "base", "polygon": [[-1, -1], [9, -1], [9, 0], [-1, 0]], "support": True},
            *others,
        ],
        "materials": {"dry": {"friction_coefficient": 0.9 if wide < high else 0.3}},
        "loads": {"live": [{"body": [1, 0]}]},
    }


def test_a_rocking_block_gets_weaker_as_it_turns() -> None:
    """About its toe: the centroid at an angle α − θ from the vertical has moved R (sin α − sin(α − θ)), and
    λ = tan(α − θ)."""
    wide, high = 0.5, 1.0
    found, _ = pushed(block(wide, high), Joints(normal_stiffness=1e4), 0.1)
    reach, alpha = 0.5 * np.hypot(wide, high), np.arctan(wide / high)
    leaning = np.arcsin(np.sin(alpha) - found.distance / reach)
    late = found.distance > 0.03
    assert found.load_factor[late] == pytest.approx(np.tan(leaning[late]), rel=2e-2)
    assert found.load_factor[-1] < 0.6 * wide / high


def test_a_corner_that_meets_another_block_presses() -> None:
    """A sliding block carries μ until it reaches a step 0.02 away that is not its neighbour at rest; then it is held.

    The step leans over the block, so that it is a corner of the block that meets it."""
    step = {"id": "step", "polygon": [[1.08, 0.3], [1.6, 0.3], [1.6, 0.8], [0.98, 0.8]], "support": True}
    found, _ = pushed(block(1.0, 0.6, step), Joints(normal_stiffness=1e5), 0.024)
    before = (found.distance > 0.002) & (found.distance < 0.018)
    assert found.load_factor[before] == pytest.approx(0.3, rel=2e-2)
    assert found.load_factor[found.distance < 0.0200].max() < 0.32
    assert found.load_factor[-1] > 3.0 * 0.3


def test_what_slides_off_its_face_is_carried_no_more() -> None:
    """A block on a base as long as itself tips once its middle has slid past the end: λ falls from μ."""
    document = block(1.0, 0.2)
    document["elements"][1]["polygon"] = [[0, -1], [1, -1], [1, 0], [0, 0]]
    found, _ = pushed(document, Joints(normal_stiffness=1e5), 0.7)
    assert found.load_factor[(found.distance > 0.01) & (found.distance < 0.3)] == pytest.approx(0.3, rel=3e-2)
    assert found.load_factor[found.distance > 0.6].min() < 0.15


def test_spatial_scenes_stay_at_rest() -> None:
    assembly = build_assembly(stacked_cubes(1, friction=0.5, tension=1.0, shear=1.0, direction=0.0))
    with pytest.raises(InputError, match="--moving"):
        run_experiment(assembly, settings=Settings(moving=True))
