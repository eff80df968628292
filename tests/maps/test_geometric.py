"""Geometric safety: thickness over the least thickness, against published least thicknesses and closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.families import semicircular_arch
from studies.scenes import ring_arch

import jld_core as jc
from cases import grid_document
from command import Command, saved

# t/R of a semicircular arch, weight along the centreline
COUPLET = 0.101  # hinges at 45°: Couplet 1730
HEYMAN = 0.106  # hinges at 58.8°: Heyman 1969
ROTATION = 0.107426  # hinges at 54.4963°: Cocchetti & Rizzi 2020, Table 3, from friction 0.395832 on
SLIDING = 0.200637  # sliding, and hinges at 60.5134°, at friction 0.309215, below which none stands: same table
MILANKOVITCH = 0.1075  # t/R under the true weight of the ring, radial cuts: Milankovitch 1907


def written(scene: jc.Scene, folder: Path) -> Path:
    return saved(folder / "scene.json", scene.model_dump(mode="json", exclude_unset=True))


def factor_of(jld: Command, path: Path) -> tuple[float, float]:
    low, high = json.loads(jld("solve", path, "--geometric", "--json", "--no-sensitivities").out)["geometric"]["factor"]
    return low, high


@pytest.mark.parametrize(
    ("scene", "thickness", "published", "within"),
    [
        (lambda: semicircular_arch([45.0], 0.12, 0.7), 0.12, COUPLET, 5e-4),
        pytest.param(lambda: semicircular_arch([58.8], 0.12, 0.7), 0.12, HEYMAN, 5e-5, marks=pytest.mark.long),
        pytest.param(lambda: semicircular_arch([54.4963], 0.12, 0.4), 0.12, ROTATION, 5e-7, marks=pytest.mark.long),
        (lambda: semicircular_arch([28.6362, 60.5134], 0.25, 0.309216), 0.25, SLIDING, 1e-6),
        (lambda: ring_arch(36, 0.1, 0.7, fine=4), 0.1, MILANKOVITCH, 5e-5),
    ],
)
def test_least_thickness_of_semicircular_arches(
    jld: Command, tmp_path: Path, scene: Any, thickness: float, published: float, within: float
) -> None:
    """Each value to its printed digits, of arches with joints at its hinges (degrees from the crown)."""
    low, high = factor_of(jld, written(scene(), tmp_path))
    assert low <= high <= low * (1 + 3e-6)
    assert thickness / low == pytest.approx(published, abs=within)


def rings_as_one(rings: int) -> jc.Scene:
    """An arch of concentric rings whose blocks above one another are one block."""
    return jc.samples.arch(rings=rings, voussoirs=6, thickness=0.16, load="quarter")


def test_rings_bonded_to_one_are_one_ring(jld: Command, tmp_path: Path) -> None:
    """Rings are scaled across the middle line of all: with blocks through both they stand as one ring does."""
    one, two = (rings_as_one(k).model_dump(mode="json", exclude_unset=True) for k in (1, 2))
    for entry in two["elements"]:
        if not entry.get("support"):
            entry["block"] = entry["id"].partition("r")[0]
    two["materials"]["inner"] = {"tensile_strength": 1e7, "shear_strength": 1e7}
    found = [factor_of(jld, written(jc.parse_scene(document), tmp_path)) for document in (one, two)]
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_a_wall_is_scaled_whole_as_grid_elements_and_solids(jld: Command, tmp_path: Path) -> None:
    """2 × 3 cells, 0.2 by 0.3, lean by 1/10: as one block the width is 20/3 times what it has to be.

    Dry, blocks of a grid, of elements with stated faces, and of solids have one factor.
    """
    lean = {"density": 1.0, "gravity": [1.0, -10.0]}
    whole = grid_document(["aa"] * 3 + ["##"], tension=1e5, shear=1e5)
    whole["materials"] |= lean
    assert factor_of(jld, written(jc.parse_scene(whole), tmp_path)) == (pytest.approx(20.0 / 3.0, rel=1e-5),) * 2
    dry = grid_document(["ab", "cc", "ab", "##"], tension=1e5, shear=1e5)
    dry["materials"] |= lean
    assembly = jc.build_assembly(dry)
    elements, faces = assembly.elements, assembly.interfaces
    rest = {"materials": dry["materials"], "loads": dry["loads"], "thickness": 0.1}
    shapes = zip(elements.ids, elements.blocks, elements.support.tolist(), elements.shape, strict=True)
    planar = [
        {"id": name, "support": held, "polygon": shape.tolist()} | ({} if held else {"block": block})
        for name, block, held, shape in shapes
    ]
    pairs = zip(faces.a.tolist(), faces.b.tolist(), faces.polygon, strict=True)
    stated = [{"elements": [elements.ids[a], elements.ids[b]], "polygon": line.tolist()} for a, b, line in pairs]
    solids = [
        {name: value for name, value in one.items() if name != "polygon"}
        | {name: value for name, value in jc.samples.box(one["id"], *ends(one["polygon"])).items() if name in KEPT}
        for one in planar
    ]
    spatial = json.loads(json.dumps(rest | {"elements": solids}))
    del spatial["thickness"]
    spatial["materials"]["gravity"], spatial["loads"] = [1.0, 0.0, -10.0], {"live": [{"body": [1, 0, 0]}]}
    others = [rest | {"elements": planar, "interfaces": stated}, spatial]
    found = [factor_of(jld, written(jc.parse_scene(one), tmp_path)) for one in (dry, *others)]
    assert found[0][0] > 1.0
    assert found[1:] == [pytest.approx(found[0], rel=1e-4)] * 2


KEPT = ("vertices", "faces")


def ends(polygon: list[list[float]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    (x, y), (far, high) = np.min(polygon, axis=0), np.max(polygon, axis=0)
    return (float(x), 0.0, float(y)), (float(far), 2.0, float(high))


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
    path = saved(tmp_path / "scene.json", box_scene(0.2))
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


STEPPED = grid_document(["ab.", "cab", "###"])


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (STEPPED, "its outline has steps"),
        (grid_document(["abcb", "#ab#", "####"]), "a contact with supports is bent"),
        (grid_document(["abcd", "ab.d", "#..#"]), "the corners of its two sides do not match"),
        (grid_document(["ab", "##"]) | {"cracks": {"kind": "cells", "cell": 0.05}}, "cracks by faces"),
    ],
)
def test_what_has_no_middle_line_is_refused(jld: Command, tmp_path: Path, document: Any, words: str) -> None:
    path = saved(tmp_path / "scene.json", document)
    jld("solve", path, "--geometric").refused(words)
