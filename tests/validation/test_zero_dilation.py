"""Collapse without dilation: the given walls, random walls, closed forms, the certificate (docs/method.md (4.3)).

Sources: Gilbert, Casapulla, Ahmed, Computers & Structures 84 (2006) 873–887; walls of Ferris & Tin-Loi 2001 with
the local minima of a public MPEC solver as lower ends of the plausible range.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from benchmarks.zero_dilation import Smoothing, smoothed
from studies.by_scheme import solve_zero_dilation, zero_dilation
from studies.families import random_wall

import cases_spatial
from balances import flow_rule, work_balance
from cases import CASES, grid_assembly
from jld_core import (
    Assembly,
    InputError,
    LimitAnalysis,
    Status,
    build_assembly,
    load_scene,
)
from jld_dilation.fixed_point_search import ProximalOptions
from nondilatant import block, certify
from paths import SCENES

WALLS = {"ferris_tinloi_1": 0.638981, "ferris_tinloi_2": 0.562005, "ferris_tinloi_4": 0.263736}


def wall(name: str) -> Assembly:
    return build_assembly(load_scene(SCENES / f"{name}.json"))


@pytest.mark.parametrize("start", ["associative", "gravity", "vertex"])
@pytest.mark.parametrize("name", WALLS)
def test_given_walls(name: str, start: str) -> None:
    result = solve_zero_dilation(wall(name), start=start)
    assert result.status is Status.COLLAPSE
    assert result.friction == "zero-dilation"
    certify(result)
    assert result.facts["friction_violation"] <= 1e-4
    assert result.facts["dilation"] <= 1e-6
    assert result.facts["complementarity_gap"] <= 1e-3
    assert WALLS[name] * (1.0 - 1e-5) <= result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)
    assert work_balance(result).error <= 1e-7
    printed = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert printed["friction"] == "zero-dilation"
    assert printed["converged"] is True


@pytest.mark.parametrize(("damping", "block"), [(1e-3, 3), (1e-1, 8)])
@pytest.mark.parametrize("name", WALLS)
def test_given_walls_under_other_parameters(name: str, damping: float, block: int) -> None:
    """The value depends on the parameters, since solutions are not unique; that it is one does not."""
    result = solve_zero_dilation(wall(name), damping=damping, block=block, alpha=0.0)
    certify(result)
    assert WALLS[name] * (1.0 - 1e-5) <= result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)


def test_a_fixed_point_iteration_that_does_not_converge_is_uncertified() -> None:
    """On the third wall it does not settle: uncertified, with the violation it is left with."""
    result = smoothed(LimitAnalysis(wall("ferris_tinloi_4")), Smoothing())
    assert not result.facts["converged"]
    assert result.status is Status.UNCERTIFIED
    assert result.facts["friction_violation"] > 1e-4


@pytest.mark.parametrize("seed", range(8))
def test_random_walls(seed: int) -> None:
    result = solve_zero_dilation(build_assembly(random_wall(seed)))
    assert result.status is Status.COLLAPSE
    certify(result)
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)


@pytest.mark.parametrize("name", ["wall", "beam", "arch", "crushable arch", "crushable wall", "no tensile strength"])
def test_inner_faces_are_left_alone(name: str) -> None:
    rows, options = CASES[name]
    result = solve_zero_dilation(grid_assembly(rows, **options))
    assert result.status is Status.COLLAPSE
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.min() >= -1e-6 * abs(result.load_factor)


def test_statuses_of_structures_that_do_not_collapse() -> None:
    for name, status in (("overhang", Status.UNSTABLE), ("pressed", Status.LOCKED)):
        rows, options = CASES[name]
        result = solve_zero_dilation(grid_assembly(rows, **options))
        assert result.status is status
        assert np.isnan(result.load_factor)


# --- closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.1, 0.4, 0.9])
def test_sliding_block_is_the_same_with_and_without_dilation(friction: float) -> None:
    result = solve_zero_dilation(block(friction, [{"body": [1, 0]}], [], 0))
    assert result.load_factor == pytest.approx(friction, rel=1e-8)
    assert result.facts["associative_load_factor"] == pytest.approx(friction, rel=1e-8)
    assert result.mechanism is not None
    assert abs(result.mechanism[0, 1]) <= 1e-8 * abs(result.mechanism[0, 0])


@pytest.mark.parametrize("push", [1.0, 2.0])
def test_wedged_block(push: float) -> None:
    """A block between fixed walls, pushed to the right by H and lifted by λ.

    With dilation it cannot move: the walls would have to part, any λ is carried by self-stress. Without, it
    slides up both walls, N_right = H + N_left, and λ = W + μ (H + 2 N_left) for whatever N_left the self-stress
    is. A start from the least forces leaves little of it.
    """
    friction = 0.3
    live, dead = [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [push, 0]}]
    assembly = block(friction, live, dead, 2)
    assert LimitAnalysis(assembly).solve().status is Status.LOCKED
    result = solve_zero_dilation(assembly)
    assert result.status is Status.COLLAPSE
    assert result.facts["associative_load_factor"] is None
    certify(result)
    assert result.forces is not None
    ids = result.assembly.elements.ids
    left = float(result.forces[[ids[b] for b in result.assembly.interfaces.b].index("left"), 0])
    assert 0.0 <= left <= 0.1 * push
    assert result.load_factor == pytest.approx(1.0 + friction * (push + 2.0 * left), rel=1e-7)


def test_block_lifted_along_one_wall() -> None:
    """With one wall N = H by statics, so dilation changes nothing: λ = W + μH."""
    live, dead = [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [0.8, 0]}]
    result = solve_zero_dilation(block(0.3, live, dead, 1))
    assert result.load_factor == pytest.approx(1.24, rel=1e-7)
    assert result.facts["associative_load_factor"] == pytest.approx(1.24, rel=1e-7)


# --- spatial ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("live", [[1, 0, 0], [0, 1, 0], [0.6, 0.5, 0]])
@pytest.mark.parametrize("wythes", [1, 2])
def test_spatial_walls(wythes: int, live: list[float]) -> None:
    assembly = cases_spatial.assembly(cases_spatial.wall(3, 3, wythes), live=[{"body": live}])
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    result = solve_zero_dilation(assembly, dry)
    assert result.status is Status.COLLAPSE
    assert result.gap <= 1e-6
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)
    assert result.facts["dilation"] <= 1e-6
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.min() >= -1e-7
    assert work_balance(result).error <= 1e-7


def test_given_spatial_scenes() -> None:
    for name in ("spatial_cubes", "spatial_shelf"):
        result = solve_zero_dilation(build_assembly(load_scene(SCENES / f"{name}.json")))
        assert result.status is Status.COLLAPSE, name
        assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)


def test_an_analysis_is_used_again_and_options_are_checked() -> None:
    assembly = wall("ferris_tinloi_1")
    analysis = LimitAnalysis(assembly)
    associative = analysis.prove(assembly.labels)
    first, again = (zero_dilation(analysis, associative=associative) for _ in range(2))
    assert first.load_factor == again.load_factor
    with pytest.raises(InputError, match="start"):
        ProximalOptions(start="other")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="alpha"):
        ProximalOptions(alpha=2.0)
    with pytest.raises(InputError, match="positive"):
        ProximalOptions(block=0)
    spatial = build_assembly(load_scene(SCENES / "spatial_cubes.json"))
    with pytest.raises(InputError, match="vertex"):
        solve_zero_dilation(spatial, start="vertex")
