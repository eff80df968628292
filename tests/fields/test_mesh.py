"""Meshes of cells: they cover the cells and all interfaces, and refinement keeps both."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from benchmarks.claims.fields import random_scenes
from benchmarks.claims.geometry import Move

from jld_core import Assembly, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_core.fields.loads import loaded_mesh
from jld_core.fields.mesh import Mesh, refine, subdivide


def random_assembly(seed: int) -> Assembly | None:
    """A random structure of cells, most of them not convex."""
    scenes = random_scenes(np.random.default_rng([seed, 2026]), [Move(np.eye(2), 1.0, np.zeros(2))])
    return None if scenes is None else build_assembly(parse_scene(scenes[0]))


def check(mesh: Mesh, assembly: Assembly) -> None:
    """Areas, interfaces, and that every edge joins the same places on both sides."""
    assert (mesh.volume > 0.0).all()
    for cell in assembly.elements.free.tolist():
        whole = shapely.Polygon(assembly.elements.shape[cell]).area
        assert mesh.volume[mesh.cell == cell].sum() == pytest.approx(whole, rel=1e-6)
    e = mesh.sides
    lengths = [e.area[e.tag == face].sum() for face in range(len(assembly.interfaces))]
    assert lengths == pytest.approx(assembly.interfaces.l1, rel=1e-6)
    both = e.b >= 0
    one = mesh.corners[e.a[both][:, None], e.corner_a[both]]
    other = mesh.corners[e.b[both][:, None], e.corner_b[both]]
    assert np.array_equal(one, other)
    # Euler: each triangle has three edges
    assert len(e) + both.sum() == 3 * len(mesh)


@pytest.mark.parametrize("seed", range(12))
def test_random_cells(seed: int) -> None:
    """Coarsest mesh, similar subdivision and random refinement."""
    assembly = random_assembly(seed)
    if assembly is None:
        return
    coarse, _ = loaded_mesh(assembly)
    check(coarse, assembly)
    check(subdivide(coarse, 3), assembly)
    rng = np.random.default_rng(seed)
    mesh = coarse
    for _ in range(3):
        singular = rng.integers(-1, 3, len(mesh))
        mesh = refine(mesh, rng.random(len(mesh)) < 0.2, singular)
        check(mesh, assembly)
        assert np.array_equal(np.unique(mesh.root), np.arange(len(coarse)))


def test_gradients_and_normals() -> None:
    """Gradients reproduce a linear function; normals are outward and of length one."""
    assembly = random_assembly(1)
    assert assembly is not None
    mesh = subdivide(loaded_mesh(assembly)[0], 2)
    slope = np.array([0.3, -1.7])
    values = mesh.corners @ slope + 0.2
    assert np.einsum("tk,tki->ti", values, mesh.gradient) == pytest.approx(np.tile(slope, (len(mesh), 1)))
    e = mesh.sides
    away = mesh.corners[e.a, e.corner_a[:, 0]] - mesh.corners.mean(axis=1)[e.a]
    assert (np.einsum("ei,ei->e", away, e.normal) > 0.0).all()
    assert np.hypot(*e.normal.T) == pytest.approx(np.ones(len(e)))


@pytest.mark.parametrize(("inset", "width"), [(-0.15, 0.4), (0.1, 0.3), (0.2, 0.2)])
def test_the_mirror_image_of_a_patch_has_the_same_bounds(inset: float, width: float) -> None:
    """A triangle with both ends of a patch as corners is split alike from either side."""
    bounds = []
    for flip in (False, True):
        x = 2.0 - 0.5 - inset if flip else 0.5 + inset
        load = {"element": f"c{int(x)}r0", "force": [-500 if flip else 500, -2e3], "at": [x, 2.0], "width": width}
        scene = {
            "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": ["ab", "##"]},
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": 0.6},
                "inner": {"tensile_strength": 1e5, "shear_strength": 1.5e5},
            },
            "loads": {"live": [load]},
        }
        found = bounds_by_fields(build_assembly(parse_scene(scene)), gap=1e3)
        bounds.append((found.lower, found.upper))
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-6)
