"""Derivatives of λ by vertices: closed forms, fourth-order differences, and one-sided values at kinks."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import Tally, vertex_rates
from structures import Document, block

from command import Command
from jld_core import Assembly, build_assembly, geometry_sensitivities, parse_scene, samples, solve
from jld_geometry.convex_cells import vertex_mesh
from jld_geometry.moved_scene import MovedScene


def rates_of(document: Document) -> Any:
    found = geometry_sensitivities(solve(parse_scene(document)))
    assert found is not None
    return found


def at(found: Any, *points: tuple[float, float]) -> np.ndarray:
    """Derivatives at the vertices at given points."""
    distance = np.linalg.norm(found.vertices[:, None] - np.array(points), axis=2)
    assert distance.min(axis=0).max() < 1e-9
    return found.derivative[np.argmin(distance, axis=0)]


def test_a_rocking_block() -> None:
    """λ = b/h: both right-hand vertices move by 1/h, both upper ones by −b/h²."""
    b, h = 0.6, 1.5
    found = rates_of(block(b, h))
    assert at(found, (b, 0.0), (b, h))[:, 0].sum() == pytest.approx(1.0 / h, rel=1e-9)
    assert at(found, (0.0, h), (b, h))[:, 1].sum() == pytest.approx(-b / h**2, rel=1e-9)


def test_a_block_pushed_up_a_slope() -> None:
    """λ = tan(φ + α), by (2.4): its derivative by α is 1/cos²(φ + α), whatever the outline of the block."""
    b, lean, friction = 1.0, 0.2, 0.4
    found = rates_of(block(b, 0.1, friction=friction, lean=lean))
    alpha, phi = math.atan2(lean, b), math.atan(friction)
    normal = np.array([-math.sin(alpha), math.cos(alpha)])
    by_angle = at(found, (b, lean))[0] @ normal * math.hypot(b, lean)
    assert by_angle == pytest.approx(1.0 / math.cos(phi + alpha) ** 2, rel=1e-9)


def test_a_glued_block_that_shears() -> None:
    """λ = τ b t/W = τ/(γ h): nothing by the width, −λ/h by the height; the term D_f/l_f of (11.1) counts."""
    b, h = 1.0, 0.2
    found = rates_of(block(b, h, label="inner"))
    load_factor = 3e3 / (1000.0 * 9.81 * h)
    assert at(found, (b, 0.0), (b, h))[:, 0].sum() == pytest.approx(0.0, abs=1e-9 * load_factor)
    assert at(found, (0.0, h), (b, h))[:, 1].sum() == pytest.approx(-load_factor / h, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 7, 19])
def test_derivatives_agree_with_differences(seed: int) -> None:
    """Four of the scenes of the claim `vertex_rates`: all yield terms, crushing (7), and space (19)."""
    tally = Tally(vertex_rates.CLAIM)
    assert vertex_rates.case(seed, tally) == ""
    assert sum(count for name, count in tally.notes.items() if name.startswith("smooth")) == 1


def lies_between(assembly: Assembly, places: np.ndarray, vertex: int, axis: int, step: float) -> float:
    """λ after one vertex of an all dry arch moved."""
    mesh = vertex_mesh(assembly)
    moved = MovedScene(SYMMETRIC, assembly, assembly.labels, mesh)
    shifted = places.copy()
    shifted[vertex, axis] += step
    return solve(build_assembly(moved.at(shifted))).load_factor


SYMMETRIC = samples.arch(voussoirs=8, thickness=0.2, load="crown")


def test_both_sides_of_a_kink() -> None:
    """A symmetric arch under a load at its crown falls in two mirrored ways: each side has a rate of its own."""
    assembly = build_assembly(SYMMETRIC)
    result = solve(assembly)
    found = geometry_sensitivities(result)
    kinks = np.argwhere(np.isnan(found.derivative))
    assert len(kinks)
    for vertex, axis in kinks[:3].tolist():
        for step, rate in ((1e-6, found.right), (-1e-6, found.left)):
            chord = (lies_between(assembly, found.vertices, vertex, axis, step) - result.load_factor) / step
            assert chord == pytest.approx(rate[vertex, axis], abs=1e-4 * np.nanmax(abs(found.right)))


def test_where_mechanisms_differ_and_the_rate_does_not() -> None:
    """A course that lags behind a sliding wall: one mechanism of many has a rate, λ = μ has none."""
    rows = ["aab", "cbb", "###"]
    materials = {"density": 2000, "dry": {"friction_coefficient": 0.6}}
    materials["inner"] = {"tensile_strength": 1e4, "shear_strength": 2e4}
    grid = {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows}
    found = rates_of({"grid": grid, "materials": materials, "loads": {"live": [{"body": [1, 0]}]}})
    assert at(found, (0.1, 0.2))[0] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_governing_case_over_its_required_factor() -> None:
    document = block(0.6, 1.5)
    live = document["loads"].pop("live")
    easy = [{"body": [0.1, 0.0]}]
    document["loads"]["cases"] = [{"name": "a", "live": easy}, {"name": "b", "live": live, "required": 2.0}]
    assert at(rates_of(document), (0.6, 0.0), (0.6, 1.5))[:, 0].sum() == pytest.approx(0.5 / 1.5, rel=1e-9)


def test_other_models_have_none() -> None:
    assert geometry_sensitivities(solve(parse_scene(block(0.6, 1.5)), friction="zero-dilation")) is None


def test_in_the_output_of_solve(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "block.json"
    file.write_text(json.dumps(block(0.6, 1.5)))
    rates = json.loads(jld("solve", file, "--out", tmp_path / "out", "--json").out)["geometry_sensitivities"]
    assert np.array(rates["vertices"]).shape == np.array(rates["derivative"]).shape
    assert (tmp_path / "out" / "vertices.png").exists()
