"""Least share of the capacity of faces: closed forms in the plane, in space and for each kind of face."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cases import box
from jld_core import LimitAnalysis, build_assembly, parse_scene
from jld_practice.reactions.thrust import least_share, shrunk
from jld_samples import arch


def share_of(document: dict[str, Any]) -> Any:
    assembly = build_assembly(parse_scene(document))
    return least_share(assembly, assembly.labels)


def block(friction: float, force: float, **more: Any) -> dict[str, Any]:
    """A block 1 × 2 × 1 of weight 1 under a horizontal force at its centroid."""
    dry = {"friction_coefficient": friction, **more.pop("dry", {})}
    return {
        "elements": [
            {"id": "g", "support": True, "polygon": [[-2, -1], [2, -1], [2, 0], [-2, 0]]},
            {"id": "b", "polygon": [[-0.5, 0], [0.5, 0], [0.5, 2], [-0.5, 2]], "weight": 1.0},
        ],
        "materials": {"dry": dry, **more.pop("materials", {})},
        "loads": {"dead": [{"element": "b", "force": [force, 0]}], "live": [{"body": [1, 0]}]},
        **more,
    }


@pytest.mark.parametrize("friction", [0.3, 2.0])
def test_eccentricity_and_slip_of_a_block(friction: float) -> None:
    """Statics: e = H h/2 / W of l/2, and H of μW."""
    found = share_of(block(friction, 0.2))
    assert found.bending == pytest.approx([0.4], rel=1e-9)
    assert found.slip == pytest.approx([0.2 / friction], rel=1e-9)
    low, high = found.bracket
    assert low <= max(0.4, 0.2 / friction) <= high
    assert high - low < 3e-3


def test_a_block_that_falls_has_none() -> None:
    assert share_of(block(2.0, 0.6)) is None


def test_an_inner_face_uses_its_tensile_strength() -> None:
    """M = (N + σt A) l/6 · share, with N = 1, M = 0.5: 3/(1 + 5); the face is glued to the support."""
    inner = {"tensile_strength": 5.0, "shear_strength": 10.0}
    found = share_of(block(1.0, 0.5, materials={"inner": inner}, labels={"inner": [["b", "g"]]}))
    assert found.share == pytest.approx([0.5], rel=1e-9)
    # yield sets shrink in both: M = (N + θσt A) θ l/6
    root = (math.sqrt(1.0 + 4 * 5 * 3) - 1.0) / 10.0
    assert found.bracket[0] <= root <= found.bracket[1]


def test_bond_counts_from_its_apex() -> None:
    """With σt = 1 and c = 2: N' = N + 1 = 2, eccentricity share 0.4/2, shear share 0.2/(c + μN) = 0.2/3."""
    materials = {"inner": {"tensile_strength": 5.0, "shear_strength": 10.0}}
    found = share_of(block(1.0, 0.2, dry={"cohesion": 2.0, "tensile_strength": 1.0}, materials=materials))
    assert found.forces[0] == pytest.approx([1.0, 0.2, 0.2], rel=1e-6)
    assert found.bending == pytest.approx([0.2], rel=1e-6)
    assert found.slip == pytest.approx([0.2 / 3.0], rel=1e-6)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_cuboid_in_space(angle: float) -> None:
    """A force H at height 1 on a 1 × 1 base: e = H/W, of 1/2 over the larger of |cos| and |sin|."""
    force = [0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.0]
    found = share_of(
        {
            "elements": [box("g", (-2, -2, -1), (3, 3, 0), support=True), box("b", (0, 0, 0), (1, 1, 2), weight=1.0)],
            "materials": {"dry": {"friction_coefficient": 0.8}},
            "loads": {"dead": [{"element": "b", "force": force}], "live": [{"body": [1, 0, 0]}]},
        }
    )
    assert found.bending == pytest.approx([0.4 * math.cos(angle)], rel=1e-6)
    assert found.slip == pytest.approx([0.25], rel=1e-6)
    assert found.bracket[0] <= 0.4 * math.cos(angle) <= found.bracket[1]


def test_an_arch_has_no_state_of_smaller_share() -> None:
    """The state found keeps its share, and with a hundredth less the arch falls, proven anew."""
    assembly = build_assembly(arch(voussoirs=8, thickness=0.24))
    found = least_share(assembly, assembly.labels)
    assert found.share.max() <= found.bracket[1] * (1 + 1e-9)
    assert np.all(np.maximum(found.bending, found.slip) <= found.share + 1e-12)
    assert LimitAnalysis(shrunk(assembly, found.bracket[0])).stands(assembly.labels) is False
