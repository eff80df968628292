"""Meshes of cells: they cover the cells and all interfaces, and refinement keeps both."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from benchmarks.claims.fields import random_scenes
from benchmarks.claims.geometry import Move

from jld_core import Assembly, build_assembly, parse_scene
from jld_core.fields.loads import loaded_mesh
from jld_core.fields.mesh import Mesh, refine, subdivide


def random_assembly(seed: int) -> Assembly | None:
    """A random structure of cells, most of them not convex."""
    scenes = random_scenes(np.random.default_rng([seed, 2026]), [Move(np.eye(2), 1.0, np.zeros(2))])
    return None if scenes is None else build_assembly(parse_scene(scenes[0]))


def check(mesh: Mesh, assembly: Assembly) -> None:
    """Areas, interfaces, and that every edge joins the same places on both sides."""
    assert (mesh.area > 0.0).all()
    for cell in assembly.elements.free.tolist():
        whole = shapely.Polygon(assembly.elements.shape[cell]).area
        assert mesh.area[mesh.cell == cell].sum() == pytest.approx(whole, rel=1e-6)
    e = mesh.edges
    lengths = [e.length[e.tag == face].sum() for face in range(len(assembly.interfaces))]
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
    e = mesh.edges
    away = mesh.corners[e.a, e.corner_a[:, 0]] - mesh.corners.mean(axis=1)[e.a]
    assert (np.einsum("ei,ei->e", away, e.normal) > 0.0).all()
    assert np.hypot(*e.normal.T) == pytest.approx(np.ones(len(e)))
