"""Locked is a claim about every part of a structure, however small its share of the live load (docs/method.md (3.14)).

A block on the floor is pushed along the direction s (1, −1), another pressed down by 1. With friction μ < 1 the first
slides at s λ = μ (W + s λ), λ = μ W / ((1 − μ) s), however small s is; with μ ≥ 1 both carry any load.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import cases_spatial
from jld_core import Assembly, LimitAnalysis, Status, build_assembly, parse_scene, solve
from jld_core.limit import BatchAnalysis

Make = Callable[[float, float], Assembly]


def planar(share: float, friction: float) -> Assembly:
    loads = [
        {"element": "pushed", "force": [share, -share], "at": [0.5, 0.0]},
        {"element": "pressed", "force": [0, -1]},
    ]
    return build_assembly(
        parse_scene(
            {
                "elements": [
                    {"id": "pushed", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
                    {"id": "pressed", "polygon": [[2, 0], [3, 0], [3, 1], [2, 1]]},
                    {"id": "floor", "polygon": [[-1, -1], [4, -1], [4, 0], [-1, 0]], "support": True},
                ],
                "materials": {"density": 1000, "dry": {"friction_coefficient": friction}},
                "loads": {"live": loads},
            }
        )
    )


def spatial(share: float, friction: float) -> Assembly:
    elements = [
        cases_spatial.box("pushed", [0, 0, 0], [1, 1, 1]),
        cases_spatial.box("pressed", [2, 0, 0], [3, 1, 1]),
        cases_spatial.box("floor", [-1, -1, -1], [4, 2, 0], support=True),
    ]
    loads = [{"element": "pushed", "force": [share, 0, -share], "at": [0.5, 0.5, 0.0]}]
    loads.append({"element": "pressed", "force": [0, 0, -1]})
    return cases_spatial.assembly(elements, materials={"dry": {"friction_coefficient": friction}}, live=loads)


SHARES = [(1e-4, 1.0 - 1e-9), (1e-6, 1.0 - 1e-7), (1e-8, 1.0 - 1e-5), (1e-10, 0.999), (1e-12, 0.5), (1e-13, 0.5)]


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize(("share", "friction"), SHARES)
def test_small_share_of_the_live_load_is_not_taken_as_rounding(make: Make, share: float, friction: float) -> None:
    """Ten of these twelve were locked while the slack of a ray was judged beside the whole live load."""
    assembly = make(share, friction)
    result = solve(assembly)
    assert result.status in (Status.COLLAPSE, Status.UNCERTIFIED)
    weight = -float(assembly.dead[assembly.elements.free][0, assembly.dimension - 1])
    exact = friction * weight / ((1.0 - friction) * share)
    low, high = result.bracket
    assert not low > exact * (1.0 + 1e-9)
    assert not high < exact * (1.0 - 1e-9)


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize(("share", "friction"), SHARES)
def test_batch_solver_takes_no_small_share_as_rounding(make: Make, share: float, friction: float) -> None:
    """Shares of 1e-12 and less were locked by the compiled batch solver."""
    assembly = make(share, friction)
    batch = BatchAnalysis.of(LimitAnalysis(assembly))
    if batch is None:
        pytest.skip("no compiled kernel")
    assert not batch.prove(np.ones((1, len(assembly.interfaces)), dtype=bool)).locked[0]


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize("share", [1.0, 1e-3, 1e-6])
def test_small_share_that_carries_any_load_is_locked(make: Make, share: float) -> None:
    assert solve(make(share, 1.1)).status is Status.LOCKED


@pytest.mark.parametrize("make", [planar, spatial])
def test_friction_counts_as_45_degrees_within_rounding_alone(make: Make) -> None:
    """As docs/method.md (3.14) says: 1e-12 of the forces of a face."""
    assert solve(make(1.0, 1.0)).status is Status.LOCKED
    assert solve(make(1.0, 1.0 - 1e-11)).status is not Status.LOCKED
