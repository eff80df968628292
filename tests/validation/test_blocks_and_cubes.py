"""The paper's section 3.2: one block on an inner base, two stacked cubes on a dry base; λ in closed form.

Relative tolerance 1e-8 (planar) and 1e-7 (spatial).
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner
from cases_spatial import box
from jld_core import LimitAnalysisResult, build_assembly, parse_scene, solve
from jld_core.limit.mechanism import Movement, face_motions

SIDE, DENSITY = 1.0, 2.0
WEIGHT = DENSITY * SIDE**3


def stack(
    cubes: int,
    direction: tuple[float, float],
    *,
    friction: float,
    tension: float,
    shear: float,
    base: str,
    **options: Any,
) -> LimitAnalysisResult:
    """Spatial stack of unit cubes; labels: the base as said, between cubes inner. Strengths as multiples of W/A."""
    elements = [box(f"b{k}", [0, 0, k], [1, 1, k + 1]) for k in range(cubes)]
    elements.append(box("ground", [-1, -1, -1], [2, 2, 0], support=True))
    pairs = [[f"b{k}", f"b{k + 1}"] for k in range(cubes - 1)]
    document = {
        "elements": elements,
        "materials": dry_and_inner(DENSITY, friction, tension * WEIGHT, shear * WEIGHT, gravity=1.0),
        "loads": {"live": [{"body": [*direction, 0.0]}]},
        "labels": {"inner": pairs + ([["b0", "ground"]] if base == "inner" else [])},
    }
    return solve(build_assembly(parse_scene(document)), **options)


def planar_stack(friction: float, tension: float, shear: float) -> LimitAnalysisResult:
    document = {
        "grid": {"cell": [1, 1], "thickness": 1, "rows": ["a", "a", "#"]},
        "materials": dry_and_inner(DENSITY, friction, tension * WEIGHT, shear * WEIGHT, gravity=1.0),
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return solve(build_assembly(parse_scene(document)))


@pytest.mark.parametrize("angle", range(16))
def test_one_block_shears_off_alike_in_every_direction(angle: int) -> None:
    """3.2a: λ = τA/W in 16 horizontal directions, opening being farther in each."""
    turn = 2.0 * np.pi * angle / 16
    shear, tension = 0.2, 1.0  # opening at (1 + σtA/W)/3 along an edge, never below 0.47 on a diagonal
    result = stack(1, (np.cos(turn), np.sin(turn)), friction=0.5, tension=tension, shear=shear, base="inner")
    assert result.load_factor == pytest.approx(shear, rel=1e-7)
    assert result.gap < 1e-6


@pytest.mark.parametrize("tension", [0.0, 0.25, 0.5, 1.0])
def test_map_of_two_cubes(tension: float) -> None:
    """3.2b: λ = min(μ, 1/2, τA/W, (1 + σtA/W)/3) over a map of (μ, τA/W), and the mechanism of each region.

    With σt = 0 the opening at 1/3 always comes before base rocking, which governs for σtA > W/2 only.
    """
    for friction, shear in itertools.product((0.1, 0.3, 0.45, 0.7), (0.05, 0.2, 0.4, 0.8)):
        borders = {
            ("base", Movement.SLIDE): friction,
            ("base", Movement.HINGE): 0.5,
            ("inner", Movement.CRACK_SHEAR): shear,
            ("inner", Movement.CRACK_TENSION): (1.0 + tension) / 3.0,
        }
        governing = min(borders, key=lambda kind: borders[kind])
        result = planar_stack(friction, tension, shear)
        assert result.load_factor == pytest.approx(borders[governing], rel=1e-8)
        moving = {
            ("base" if dry else "inner", motion.kind)
            for dry, motion in zip(result.labels, face_motions(result), strict=True)
            if motion.kind is not Movement.CLOSED
        }
        ties = [kind for kind, value in borders.items() if value < borders[governing] + 1e-9]
        assert moving == {governing} if len(ties) == 1 else moving <= set(ties)


@pytest.mark.parametrize(
    ("friction", "shear", "tension"), [(0.2, 0.9, 0.6), (0.9, 0.9, 1.0), (0.9, 0.3, 0.6), (0.9, 0.9, 0.2)]
)
def test_two_spatial_cubes(friction: float, shear: float, tension: float) -> None:
    """One point of each region of the map in space, convex and concave contact alike."""
    expected = min(friction, 0.5, shear, (1.0 + tension) / 3.0)
    for contact in ("convex", "concave"):
        result = stack(2, (1.0, 0.0), friction=friction, tension=tension, shear=shear, base="dry", contact=contact)
        assert result.load_factor == pytest.approx(expected, rel=1e-7)


def test_bending_forms_differ_on_the_diagonal() -> None:
    """docs/method.md (2.6): two cubes at 45°, σt = 0: √2/3 by the paper’s uncoupled form, half of it by the kern."""
    turn = (np.sqrt(0.5), np.sqrt(0.5))
    loads = {"friction": 5.0, "tension": 0.0, "shear": 9.0, "base": "dry"}
    assert stack(2, turn, **loads).load_factor == pytest.approx(np.sqrt(2) / 3, rel=1e-7)
    assert stack(2, turn, **loads, inner_bending="kern").load_factor == pytest.approx(np.sqrt(2) / 6, rel=1e-7)


def test_prism_under_pure_torsion() -> None:
    """A prism on a dry face twisted about its axis: MT = μ N c_T, with c_T of the unit square 0.382598."""
    document = {
        "elements": [box("b", [0, 0, 0], [1, 1, 1]), box("ground", [-1, -1, -1], [2, 2, 0], support=True)],
        "materials": {"density": 3.0, "gravity": 1.0, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": [{"element": "b", "moment": [0, 0, 1.0]}]},
    }
    c_t = np.sqrt(2) / 6 + np.arcsinh(1.0) / 6
    assert c_t == pytest.approx(0.382598, abs=1e-6)
    assert solve(build_assembly(parse_scene(document))).load_factor == pytest.approx(0.6 * 3.0 * c_t, rel=1e-8)
