"""∂λ by strengths and weight, against closed forms and against λ solved a step away."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from benchmarks.claims.answers import drawn_converged as drawn

from cases import assembly_in_space as spatial_assembly
from cases import box, grid_assembly, grid_document
from command import Command, saved
from jld_core import Assembly, LimitAnalysis, build_assembly, parse_scene, solve
from jld_core.models import sensitivities
from jld_core.models.sensitivity import _parameters


def test_a_block_that_slides() -> None:
    """λ = μ, whatever it weighs beside its own live load: (2.4) of docs/method.md. The live load is left as it is."""
    assembly = grid_assembly(["a", "#"], friction=0.6)
    found = sensitivities(solve(assembly))
    assert found["friction_coefficient"].derivative == pytest.approx(1.0, rel=1e-6)
    assert found["weight"].derivative == pytest.approx(0.6, rel=1e-6)


def test_a_block_that_slides_as_soon_as_it_tilts() -> None:
    """λ = min(μ, b/h) at μ = b/h = 1: one side each, and no derivative."""
    found = sensitivities(solve(grid_assembly(["a", "#"], friction=1.0)))["friction_coefficient"]
    assert found.left == pytest.approx(1.0, rel=1e-6)
    assert found.right == pytest.approx(0.0, abs=1e-6)
    assert found.to_json()["derivative"] is None


def load_factor(assembly: Assembly, labels: np.ndarray) -> float:
    return LimitAnalysis(assembly, gap=1e-9).solve(labels, stands=False).load_factor


def hold_against_differences(assembly: Assembly, labels: np.ndarray | None = None, rel: float = 1e-4) -> None:
    result = solve(assembly, labels)
    found = sensitivities(result)
    changes = _parameters(assembly, result.labels)
    assert {name for name, _, _ in changes} == set(found)
    for name, change, _ in changes:
        step = 1e-4 * change.size
        here = load_factor(assembly, result.labels)
        left = (here - load_factor(change.of(assembly, -step), result.labels)) / step
        right = (load_factor(change.of(assembly, step), result.labels) - here) / step
        least = 1e-5 * abs(here) / change.size
        assert found[name].left == pytest.approx(left, rel=rel, abs=least)
        assert found[name].right == pytest.approx(right, rel=rel, abs=least)
        if found[name].derivative == found[name].derivative:
            assert found[name].derivative == pytest.approx(0.5 * (left + right), rel=rel, abs=least)


@pytest.mark.parametrize(
    ("rows", "live"),
    [
        (["aab", "cbb", "###"], [{"body": [1, 0]}]),
        (["aaaaa", "#...#"], [{"element": "c2r0", "force": [0, -1]}]),
        (["abcd", "#..#"], [{"element": "c1r0", "force": [0.2, 1]}]),
    ],
)
def test_differences_agree(rows: list[str], live: list[dict[str, object]]) -> None:
    hold_against_differences(grid_assembly(rows, live=live, friction=0.7))


def test_differences_agree_in_space() -> None:
    blocks = [box("ground", (0, 0, -1), (2, 1, 0), support=True), box("low", (0, 0, 0), (1, 1, 1), block="b")]
    assembly = spatial_assembly([*blocks, box("high", (0, 0, 1), (1, 1, 2.4), block="b")])
    hold_against_differences(assembly, rel=2e-2)


@pytest.mark.parametrize("crush", [2e4, 1e5])
@pytest.mark.parametrize("rows", [["#abc#"], ["#abcd#", "#efgh#"]])
def test_crushing_bends_but_has_no_kink(rows: list[str], crush: float) -> None:
    """Rates of 1e-4 λ/p beside the curvature of crushing are rates: at 0.2 `weight` of the second scene was a kink."""
    assembly = grid_assembly(rows, live=[{"element": "c2r0", "force": [0, -1]}], friction=0.75, crush_dry=crush)
    result = solve(assembly)
    found = sensitivities(result)
    for name, change, _ in _parameters(assembly, result.labels):
        step = 1e-2 * change.size
        low, high = (load_factor(change.of(assembly, by), result.labels) for by in (-step, step))
        central = (high - low) / (2.0 * step)
        assert found[name].derivative == pytest.approx(central, rel=1e-2, abs=1e-5 * result.load_factor / change.size)


def test_of_the_case_that_governs() -> None:
    cases = [{"name": "a", "live": [{"body": [1, 0]}], "required": 2.0}, {"name": "b", "live": [{"body": [0, 1]}]}]
    assembly = build_assembly(parse_scene({**grid_document(["a", "#"], friction=0.6), "loads": {"cases": cases}}))
    result = solve(assembly)
    assert result.governing == "a"
    assert sensitivities(result)["friction_coefficient"].derivative == pytest.approx(0.5, rel=1e-6)


def test_no_sensitivities_without_a_program() -> None:
    assembly = grid_assembly(["a", "#"], friction=0.6)
    assert sensitivities(solve(assembly, friction="zero-dilation")) == {}
    assert sensitivities(solve(grid_assembly(["aaa", "#.#"], tension=0.0, shear=0.0))) == {}


def test_the_command_line(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "scene.json", grid_document(["a", "#"], friction=1.0))
    found = json.loads(jld("solve", file, "--json").out)["sensitivities"]
    assert found["friction_coefficient"]["derivative"] is None
    assert found["friction_coefficient"]["left"] == pytest.approx(1.0, rel=1e-6)
    out = jld("solve", file).out
    assert "∂λ/∂friction_coefficient" in out
    assert "1 for less" in out


def test_no_rate_towards_friction_that_locks() -> None:
    """A block in a corner, pulled from the wall: λ = μ up to 45°, without end above (tests of friction_boundary)."""
    elements = [
        box("block", [0, 0, 0], [1, 1, 1]),
        box("floor", [-1, -1, -1], [3, 2, 0], support=True),
        box("wall", [-1, 0, 0], [0, 1, 1], support=True),
    ]
    assembly = spatial_assembly(
        elements, materials={"dry": {"friction_coefficient": 1.0}}, live=[{"body": [1.0, 0.0, 0.0]}]
    )
    found = sensitivities(solve(assembly))["friction_coefficient"]
    assert found.left == pytest.approx(1.0, rel=1e-4)
    assert math.isnan(found.right)
    assert math.isnan(found.derivative)


def test_rates_are_unknown_where_multipliers_and_steps_disagree() -> None:
    """Multipliers are not unique in this scene with friction of 45°: they said 0.65 where both sides are 0.5."""
    assembly, labels = drawn(9075)
    result = solve(assembly, labels)
    found = sensitivities(result)["friction_coefficient"]
    assert found.left == pytest.approx(0.5 * result.load_factor, rel=1e-4)
    assert found.right == pytest.approx(0.5 * result.load_factor, rel=1e-4)
    assert math.isnan(found.derivative) or found.derivative == pytest.approx(0.5 * result.load_factor, rel=1e-2)


@pytest.mark.parametrize(
    ("size", "options", "known"), [(8, (), True), (9, (), False), (2, ("--no-sensitivities",), False)]
)
def test_rates_of_many_faces_wait_until_asked(
    size: int, options: tuple[str, ...], known: bool, tmp_path: Path, jld: Command
) -> None:
    """A wall of n × n cells has 2n² − n faces beside n at the supports: 128 at n = 8."""
    file = saved(tmp_path / "scene.json", grid_document(["a" * size] * size + ["#" * size], live=[{"body": [1, 0]}]))
    found = json.loads(jld("solve", file, "--json", *options).out)
    assert ("friction_coefficient" in found["sensitivities"]) == known
    assert ("not_computed" in found["sensitivities"]) != known
    spent = found["seconds"]
    assert spent.pop("total") == pytest.approx(sum(spent.values()), rel=0.1)


def test_rates_of_many_faces_come_when_asked(tmp_path: Path, jld: Command) -> None:
    file = saved(
        tmp_path / "scene.json", grid_document(["a" * 9] * 9 + ["#" * 9], live=[{"body": [1, 0]}], friction=0.5)
    )
    found = json.loads(jld("solve", file, "--json", "--sensitivities").out)["sensitivities"]
    assert found["friction_coefficient"]["derivative"] == pytest.approx(1.0, rel=1e-6)
