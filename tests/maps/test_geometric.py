"""Geometric safety: thickness over the least thickness, against published least thicknesses and closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from studies.families import semicircular_arch
from studies.scenes import ring_arch

import jld_core as jc
from command import ROOT, Command

COUPLET = 0.107426  # t/R, weight along the centreline, μ > 0.3958: Cocchetti & Rizzi 2020, Table 3
MILANKOVITCH = 0.1075  # t/R under the true weight of the ring, radial cuts: Milankovitch 1907


def written(scene: jc.Scene, folder: Path) -> Path:
    path = folder / "scene.json"
    path.write_text(json.dumps(scene.model_dump(mode="json", exclude_unset=True)), "utf-8")
    return path


@pytest.mark.parametrize(
    ("scene", "thickness", "published", "within"),
    [
        (lambda: semicircular_arch(36, 0.15, 0.7), 0.15, COUPLET, 2e-4),  # a joint 0.5° from the true hinge
        (lambda: ring_arch(36, 0.1, 0.7, fine=4), 0.1, MILANKOVITCH, 2e-3),
    ],
)
def test_least_thickness_of_semicircular_arches(
    jld: Command, tmp_path: Path, scene: Any, thickness: float, published: float, within: float
) -> None:
    found = jld("solve", written(scene(), tmp_path), "--geometric", "--json", "--no-sensitivities")
    low, high = json.loads(found.out)["geometric"]["factor"]
    assert low <= high <= low * (1 + 3e-6)
    assert thickness / low == pytest.approx(published, rel=within)
    assert (low > 1.0) == (thickness > published)


def box_scene(slope: float) -> dict[str, Any]:
    """A box 2 high whose weight leans: it stands while its width is at least 2 × slope."""
    return {
        "name": "leaning weight",
        "elements": [
            jc.samples.box("a", (0, 0, 0), (1.0, 3.0, 2.0)),
            jc.samples.box("g", (-1, -1, -1), (2.0, 4.0, 0.0), support=True),
        ],
        "materials": {"density": 1.0, "gravity": [slope, 0.0, -1.0], "dry": {"friction_coefficient": 2.0}},
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }


def test_a_block_in_space_is_scaled_across_its_thin_side(jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(box_scene(0.2)), "utf-8")
    low, high = json.loads(jld("solve", path, "--geometric", "--json").out)["geometric"]["factor"]
    assert (low, high) == (pytest.approx(1.0 / 0.4, rel=3e-6),) * 2
    assert "geometric safety         2.5" in jld("solve", path, "--geometric").out


def test_a_wall_of_single_blocks_needs_the_thickness_of_overturning(jld: Command, tmp_path: Path) -> None:
    document = {
        "name": "column",
        "elements": [
            *({"id": f"b{k}", "polygon": [[0, k], [1.2, k], [1.2, k + 1], [0, k + 1]]} for k in range(4)),
            {"id": "g", "polygon": [[-1, -1], [2, -1], [2, 0], [-1, 0]], "support": True},
        ],
        "materials": {"density": 2.0, "gravity": [1.0, -10.0], "dry": {"friction_coefficient": 0.8}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    path = tmp_path / "scene.json"
    for lean, factor in ((1.0, 1.2 / 0.4), (0.0, None)):
        document["materials"]["gravity"] = [lean, -10.0]  # type: ignore[index]
        path.write_text(json.dumps(document), "utf-8")
        told = json.loads(jld("solve", path, "--geometric", "--json", "--no-sensitivities").out)["geometric"]
        assert told["thickness"] == pytest.approx([1.2, 1.2])
        if factor is None:
            assert told["factor"] == [1024.0, None]  # it stands at any thickness
        else:
            assert told["factor"] == pytest.approx([factor, factor], rel=3e-6)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (lambda: jc.samples.arch(rings=2), "element 'v0r0': it has 3 joints"),
        (lambda: jc.load_scene(ROOT / "scenes" / "flat_beam_arch.json"), "elements: grids and stated interfaces have"),
    ],
)
def test_what_has_no_middle_line_is_refused(jld: Command, tmp_path: Path, scene: Any, words: str) -> None:
    found = jld("solve", written(scene(), tmp_path), "--geometric")
    assert (found.code, found.out) == (2, "")
    assert words in found.err
    assert found.err.count("\n") == 1
