"""Velocity fields of results are in scene units: the virtual work of the live load as the scene states it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import all_inner, grid_document
from jld_core import Assembly, Floats, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields


def works(assembly: Assembly, corners: Floats, velocity: Floats, cell: Floats) -> tuple[float, float]:
    """Work of the live and of the dead load of a scene whose loads are body forces through the centroids.

    corners, velocity: (t, d + 1, d) of triangles of the scene's thickness, or of tetrahedra; cell: (t,) their elements.
    """
    sides = corners[:, 1:] - corners[:, :1]
    dimension = corners.shape[2]
    size = abs(np.linalg.det(sides)) / (2.0 if dimension == 2 else 6.0)
    share = size / np.bincount(cell, size, minlength=len(assembly.elements))[cell]
    mean = velocity.mean(axis=1)
    live, dead = (
        float((share[:, None] * load[cell, :dimension] * mean).sum()) for load in (assembly.live, assembly.dead)
    )
    return live, dead


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_planar_velocities_have_scene_units(unit: float) -> None:
    """b_λ·u = 1, and the dissipation less the work of the dead load is λ; unit: of lengths, over m."""
    live: list[dict[str, Any]] = [{"body": [1.0, 0.0]}]
    document = grid_document(["aab", "aab", "###"], live=live, tension=2e5 / unit, shear=2e5 / unit)
    document["grid"] |= {"cell": [0.3 / unit, 0.2 / unit], "thickness": 1.7}
    assembly = build_assembly(parse_scene(document))
    found = bounds_by_fields(assembly, gap=0.3)
    field = found.velocities
    assert field is not None
    work, dead = works(assembly, field.mesh.corners, field.velocity, field.mesh.cell)
    assert work == pytest.approx(1.0, rel=1e-9)
    assert float(field.dissipation.sum()) - dead == pytest.approx(found.upper, rel=1e-9)


def test_spatial_velocities_have_scene_units() -> None:
    """The same in tetrahedra, for a stone that is glued to its support."""
    boxes = [("base", -1.0, 0.0, True), ("stone", 0.0, 0.5, False)]
    elements = []
    for name, low, high, support in boxes:
        corners = [[x, y, z] for z in (low, high) for y in (0.0, 1.0) for x in (0.0, 1.0)]
        faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        elements.append({"id": name, "vertices": corners, "faces": faces, "support": support})
    inner = {"tensile_strength": 5e4, "shear_strength": 1e4}
    scene = {
        "elements": elements,
        "materials": {"density": 2000.0, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"live": [{"body": [1, 0, -0.5]}]},
    }
    assembly = build_assembly(parse_scene(all_inner(scene)))
    found = bounds_by_fields(assembly, gap=0.9, most=30)
    field = found.velocities
    assert field is not None
    work, dead = works(assembly, field.mesh.corners, field.velocity, field.mesh.cell)
    assert work == pytest.approx(1.0, rel=1e-9)
    assert float(field.dissipation.sum()) - dead == pytest.approx(found.upper, rel=1e-9)
