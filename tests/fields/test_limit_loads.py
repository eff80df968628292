"""Limit loads with closed forms or published bounds, from scene to bracket."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from jld_core import Assembly, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import FieldStatus


def scene(elements: list[dict[str, Any]], live: list[Any], **materials: Any) -> Assembly:
    """Weightless elements of unit thickness unless stated otherwise; all faces inner."""
    inner = {"tensile_strength": 1000.0, "shear_strength": 1.0, **materials.pop("inner", {})}
    document = {
        "elements": elements,
        "materials": {
            "gravity": 1.0,
            "density": 0.0,
            "dry": {"friction_coefficient": 0.5},
            "inner": inner,
            **materials,
        },
        "loads": {"live": live},
        "labels": {"default": "inner"},
    }
    return build_assembly(parse_scene(document))


def box(name: str, x0: float, y0: float, x1: float, y1: float, **more: Any) -> dict[str, Any]:
    """A rectangle."""
    return {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], **more}


def test_prandtl() -> None:
    """A strip load on a weightless half-space of cohesion c: (2 + π) c, Prandtl 1920.

    In the plane R ≤ c is the same condition for plane stress and plane strain where no tension is cut off.
    """
    ground = [
        box("soil", -2, -1.2, 2, 0),
        box("bottom", -2, -2, 2, -1.2, support=True),
        box("left", -3, -1.2, -2, 0, support=True),
        box("right", 2, -1.2, 3, 0, support=True),
    ]
    load = {"element": "soil", "force": [0, -1], "at": [0, 0]}
    found = bounds_by_fields(scene(ground, [load]), gap=0.09, patch=1.0, parts=2)
    exact = 2.0 + math.pi
    assert found.status is FieldStatus.CLOSED
    assert found.lower <= exact <= found.upper
    assert found.gap <= 0.09


def test_vertical_cut() -> None:
    """A vertical cut of height H in cohesive soil fails at γH/c between 3.772 and 3.776.

    Pastor, Thai & Francescato 2000 (lower 3.7603, upper 3.7859); Krabbenhøft & Lyamin 2006 (3.772 and 3.776).
    """
    blocks = [
        box("bank", -2, 0, 0, 1, density=1.0),
        box("under", -2, -1, 0, 0, density=1.0),
        box("floor", 0, -1, 1.5, 0, density=1.0),
        box("bottom", -2, -2, 1.5, -1, support=True),
        box("left", -3, -1, -2, 1, support=True),
        box("right", 1.5, -1, 2.5, 0, support=True),
    ]
    found = bounds_by_fields(scene(blocks, [{"body": [0, -1]}]), gap=0.12)
    assert 1.0 + found.lower <= 3.776
    assert 1.0 + found.upper >= 3.772
    assert found.gap <= 0.12


def test_cantilever_in_plastic_bending() -> None:
    """M = σ0 t h²/4 with σ0 = σt = 2τ, in a section between the clamp and half a depth away from it.

    At the clamp itself the beam cannot thin, which strengthens it; a section h/2 away does not feel the clamp.
    """
    parts = [box("wall", -1, 0, 0, 1, support=True), box("beam", 0, 0, 8, 1)]
    load = {"element": "beam", "force": [0, -1], "at": [8, 0.5]}
    found = bounds_by_fields(scene(parts, [load], inner={"tensile_strength": 2.0}), gap=0.09, parts=2)
    plastic = 2.0 / 4.0
    assert found.gap <= 0.09
    assert found.lower <= plastic / 7.5
    assert found.upper >= plastic / 8.0
    # a thrust line at the strength of the material in every section is a stress field: no more than 2 % of shear
    assert found.lower >= 0.98 * plastic / 8.0


@pytest.mark.parametrize(
    ("tension", "factor"),
    [(1.2, 1.2 * 0.5), (5.0, 2.0 * 0.5)],
)
def test_pulled_bar(tension: float, factor: float) -> None:
    """A bar glued to its support breaks at σt A, or slides at 45° by 2τ A where σt is larger."""
    parts = [box("wall", 0, -1, 0.5, 0, support=True), box("bar", 0, 0, 0.5, 1.5)]
    load = {"element": "bar", "force": [0, 1], "at": [0.25, 1.5]}
    found = bounds_by_fields(scene(parts, [load], inner={"tensile_strength": tension}), gap=0.01)
    assert found.lower <= factor * (1 + 1e-9)
    assert found.upper >= factor * (1 - 1e-9)
    assert found.gap <= 0.01


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_block_that_slides_or_tips(friction: float) -> None:
    """A strong block on a dry joint: λ = μ where it slides, b/h = 1/2 where it tips."""
    parts = [box("ground", -1, -1, 2, 0, support=True), box("block", 0, 0, 1, 2, weight=3.0)]
    strong = {"tensile_strength": 1e4, "shear_strength": 1e4}
    assembly = scene(parts, [{"body": [1, 0]}], inner=strong, dry={"friction_coefficient": friction})
    found = bounds_by_fields(assembly, np.ones(len(assembly.interfaces), dtype=bool), gap=0.01)
    exact = min(friction, 0.5)
    assert found.lower <= exact * (1 + 1e-9)
    assert found.upper >= exact * (1 - 1e-9)
    assert found.gap <= 0.01


def test_cohesion_and_crushing_of_a_joint() -> None:
    """Sliding: λ W = c A + μ W. Tipping about a crushed edge: λ W h/2 = W (b − W/σc t)/2."""
    strong = {"tensile_strength": 1e4, "shear_strength": 1e4}
    ground = box("ground", -1, -1, 2, 0, support=True)
    low = scene(
        [ground, box("block", 0, 0, 1, 0.1, weight=3.0)],
        [{"body": [1, 0]}],
        inner=strong,
        dry={"friction_coefficient": 0.4, "cohesion": 0.6},
    )
    every = np.ones(len(low.interfaces), dtype=bool)
    slid = bounds_by_fields(low, every, gap=0.01)
    assert slid.lower <= 0.6 * (1 + 1e-9)
    assert slid.upper >= 0.6 * (1 - 1e-9)
    assert slid.gap <= 0.01
    high = scene(
        [ground, box("block", 0, 0, 1, 2, weight=3.0)],
        [{"body": [1, 0]}],
        inner=strong,
        dry={"friction_coefficient": 0.9, "compressive_strength": 10.0},
    )
    tipped = bounds_by_fields(high, every, gap=0.02, seconds=20.0)
    exact = (1.0 - 3.0 / 10.0) / 2.0
    assert tipped.lower <= exact * (1 + 1e-9)
    assert tipped.upper >= exact * (1 - 1e-9)
    assert tipped.gap <= 0.02
