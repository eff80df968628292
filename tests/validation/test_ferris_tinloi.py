"""Dry walls of Ferris & Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209–224, friction 0.65, horizontal body load.

λ as in the scenes' own `expected` (published to 3–5 digits, recomputed by two independent linear programs);
tolerance 1e-6. The walls are symmetric about a vertical line, so both directions give the same value. Blocks and
contacts are counted as in MPECLib, whose complementarity problem of n blocks and m contacts has 3n + 7m + 2 equations.
"""

from __future__ import annotations

import pytest

from jld_core import (
    Assembly,
    LimitAnalysisResult,
    Scene,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    solve,
)
from jld_core.solvers import SOLVERS
from paths import SCENES
from transforms import as_elements

WALLS = tuple(f"ferris_tinloi_{n}" for n in range(1, 7))
EQUATIONS = (682, 1154, 854, 979, 1025, 2855)
"""Of frictionalblock_1 … 6 in MPECLib."""


def wall(name: str, direction: float = 1.0) -> tuple[Scene, Assembly]:
    document = as_elements(load_scene(SCENES / f"{name}.json"))
    document["loads"]["live"] = [{"body": [direction, 0.0]}]
    scene = parse_scene(document)
    return scene, build_assembly(scene)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("name", WALLS)
def test_wall(name: str, direction: float) -> None:
    scene, assembly = wall(name, direction)
    assert len(assembly.interfaces) == scene.expected["interfaces"]
    assert len(assembly.elements) == scene.expected["elements"]
    result = solve(assembly)
    published = scene.expected["load_factor_associative"]
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(published, rel=1e-6)
    low, high = result.bracket
    assert low <= result.load_factor <= high
    assert (high - low) / published < 1e-7
    assert result.stands_at_zero is True


@pytest.mark.parametrize(("name", "equations"), list(zip(WALLS, EQUATIONS, strict=True)))
def test_blocks_and_contacts_are_those_of_mpeclib(name: str, equations: int) -> None:
    _, assembly = wall(name)
    blocks = int((~assembly.elements.support).sum())
    assert 3 * blocks + 7 * len(assembly.interfaces) + 2 == equations


@pytest.mark.parametrize("route", SOLVERS)
def test_every_route_gives_the_same_wall(route: str) -> None:
    scene, assembly = wall("ferris_tinloi_4")
    result: LimitAnalysisResult = solve(assembly, solver=route)
    assert result.load_factor == pytest.approx(scene.expected["load_factor_associative"], rel=1e-7)
    assert result.gap < 1e-7
