"""By cells, layouts under a load that only presses are locked, though their rays lie at the edges of joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from jld_core import build_assembly, parse_scene, solve
from jld_core.refinement.cells import crack_cells

WEAK, ROUGH = {"tensile_strength": 1e3, "shear_strength": 2e3}, {"friction_coefficient": 1.0}
STRONG = {"tensile_strength": 1e5, "shear_strength": 2e5}
LAYOUTS: list[tuple[list[str], str, list[float], dict[str, float], dict[str, float], str]] = [
    # rows, element and force, dry and inner material, labels of the joints
    (["abc", "###"], "c0r0", [0, -1e3], {"friction_coefficient": 0.0}, STRONG | ROUGH, "iiiid"),
    (
        ["abc", "###"],
        "c0r0",
        [0, -1e3],
        {"friction_coefficient": 0.6, "compressive_strength": 1e6},
        STRONG | ROUGH,
        "iidid",
    ),
    (
        ["abc", "###"],
        "c2r0",
        [0, -1e3],
        {"friction_coefficient": 1.2, "compressive_strength": 1e6},
        WEAK | ROUGH,
        "ddiii",
    ),
    (
        ["abc", "###"],
        "c1r0",
        [0, -1e3],
        {"friction_coefficient": 1.2, "compressive_strength": 1e5},
        STRONG | ROUGH,
        "iiiii",
    ),
]


def pressed(rows: list[str], element: str, force: list[float], dry: dict[str, float], inner: dict[str, float]) -> Any:
    """A wall of cells of 0.2 m, which crack along cells of 0.1 m."""
    return parse_scene(
        {
            "grid": {"cell": [0.2, 0.2], "thickness": 0.1, "rows": rows},
            "materials": {"density": 1800, "dry": dry, "inner": inner},
            "loads": {"live": [{"element": element, "force": force}]},
            "cracks": {"kind": "cells", "cell": 0.1},
        }
    )


@pytest.mark.parametrize(("rows", "element", "force", "dry", "inner", "labels"), LAYOUTS)
def test_pressed_layouts_are_locked(
    rows: list[str],
    element: str,
    force: list[float],
    dry: dict[str, float],
    inner: dict[str, float],
    labels: str,
) -> None:
    scene = pressed(rows, element, force, dry, inner)
    joints = build_assembly(scene)
    cells = crack_cells(scene, joints, 0.1)
    result = solve(cells.fine, cells.labels(np.array([letter == "d" for letter in labels])))
    assert result.status == "locked"


@pytest.mark.parametrize("size", [0.2, 1.0, 0.7, 123.4])
def test_cells_of_a_grid_have_its_coordinates(size: float) -> None:
    """Corners of the cells lie where whole multiples of half a cell lie, to the last digits."""
    scene = pressed(["abc", "###"], "c0r0", [0, -1], {"friction_coefficient": 0.5}, WEAK)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["grid"]["cell"] = [size, size]
    scaled = parse_scene(document)
    cells = crack_cells(scaled, build_assembly(scaled), 0.5 * size)
    corners = np.concatenate(cells.fine.elements.shape) / (0.5 * size)
    assert abs(corners - np.round(corners)).max() <= 2e-15 * abs(corners).max()
