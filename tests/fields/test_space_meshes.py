"""Meshes fitted before fields are solved for: layers of long and flat cells, and dry joints of rigid blocks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import all_inner, box, prism, rotation
from jld_core import Assembly, build_assembly, parse_scene, solve
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import FieldSetting
from jld_core.fields.layers import layers_of, surface_of
from jld_core.fields.rigid_joints import RigidBlocks, fitted_joints, rigid_balance
from jld_core.fields.solids import loaded_solids


def scene(elements: list[dict[str, Any]], live: list[Any], label: str, **materials: Any) -> Assembly:
    document = {
        "elements": elements,
        "materials": {
            "gravity": [0.0, 0.0, -1.0],
            "density": 0.0,
            "dry": {"friction_coefficient": 0.7},
            "inner": {"tensile_strength": 200.0, "shear_strength": 100.0},
            **materials,
        },
        "loads": {"live": live},
    }
    return build_assembly(parse_scene(all_inner(document, label)))


@pytest.mark.long  # test_space_limit_loads.py bends a cantilever as well
def test_cantilever_within_fifteen_percent() -> None:
    """λ lies between M/l and M/(l − h/2) with M = σt b h²/4, as in benchmarks/space_fields.py."""
    length, width, depth = 2.0, 0.25, 0.5
    parts = [box("wall", [-0.5, 0, 0], [0, width, depth], support=True), box("beam", [0, 0, 0], [length, width, depth])]
    live = [{"element": "beam", "force": [0, 0, -1], "at": [length, width / 2, depth / 2]}]
    found = bounds_by_fields(scene(parts, live, "inner"), gap=0.15, most=150)
    plastic = 200.0 * width * depth**2 / 4.0
    assert found.gap <= 0.15
    assert [step.simplices for step in found.history] == [24, 144]
    assert found.lower <= plastic / (length - 0.5 * depth)
    assert found.upper >= plastic / length


OUTLINES = {
    "slab": prism("a", [[0, 0], [1, 0], [1, 1], [0, 1]], 0.0, 0.2),
    "voussoir": prism("a", [[0, 0], [1, 0], [0.9, 0.3], [0.1, 0.3]], 0.0, 0.25),
    "cube": prism("a", [[0, 0], [1, 0], [1, 1], [0, 1]], 0.0, 1.0),
    "triangle": prism("a", [[0, 0], [1, 0], [0.5, 0.9]], 0.0, 4.0),
}


@pytest.mark.parametrize(("name", "count"), [("slab", 9), ("voussoir", 3), ("cube", 1), ("triangle", 3)])
def test_layers_of_a_cell(name: str, count: int) -> None:
    """A cell of width w between ends of smaller side s ≤ w/3 has planes at s from both of them."""
    ground = box("ground", [-1, -1, -1], [2, 2, 0], support=True)
    assembly = scene([ground, OUTLINES[name]], [{"body": [1, 0, 0]}], "inner", density=1.0)
    layers = layers_of(surface_of(assembly), 1)
    assert (1 if layers is None else len(layers.parts)) == count
    mesh, loads = loaded_solids(assembly, None, assembly.labels, (1,))
    assert mesh.volume.sum() == pytest.approx(assembly.elements.volume[1], rel=1e-12)
    assert mesh.volume.min() > 0.0
    assert mesh.volume @ loads.live[mesh.root] == pytest.approx(assembly.live[1, :3], rel=1e-12)


def test_layers_meet_other_cells() -> None:
    """Two crossed bars: planes of each cut the interface between them, and both have the same triangles there."""
    found = []
    for turn in (np.eye(3), rotation(0.3, -0.4, 0.5)):
        parts = [
            box("ground", [0, 0.5, -1], [3, 1.0, 0], turn, support=True),
            box("one", [0, 0, 0], [3, 1.1, 0.5], turn),
            box("two", [0.9, -1, 0.5], [1.7, 3, 0.9], turn),
        ]
        live = [{"element": "two", "force": (turn @ [0, 0, -1]).tolist(), "at": (turn @ [1.3, 2.5, 0.9]).tolist()}]
        assembly = scene(parts, live, "inner", gravity=(turn @ [0.0, 0.0, -1.0]).tolist())
        mesh, _ = loaded_solids(assembly, None, None, (1, 2))
        plain, _ = loaded_solids(assembly)
        assert len(mesh) > 2 * len(plain)
        for cell in (1, 2):
            assert mesh.volume[mesh.cell == cell].sum() == pytest.approx(assembly.elements.volume[cell], rel=1e-9)
        face = int(np.flatnonzero([assembly.pair(k) == "one–two" for k in range(len(assembly.interfaces))])[0])
        sides = mesh.sides
        own = sides.tag == face
        assert (sides.b[own] >= 0).all()
        assert sides.area[own].sum() == pytest.approx(0.8 * 1.1, rel=1e-9)
        # every other triangle between two tetrahedra lies inside a cell, every triangle of one on its surface
        inside = (sides.tag < 0) & (sides.b >= 0)
        assert (mesh.cell[sides.a[inside]] == mesh.cell[sides.b[inside]]).all()
        found.append((len(mesh), float(np.sort(mesh.volume) @ np.arange(len(mesh)))))
    assert found[1][0] == found[0][0]
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-9)


def tower(friction: float, cohesion: float = 0.0) -> Assembly:
    """Two blocks on the ground, bonded by dry joints, pushed along the diagonal of their base."""
    parts = [
        box("ground", [-1, -1, -1], [2, 2, 0], support=True),
        box("a", [0, 0, 0], [1, 0.8, 0.7], weight=2.0),
        box("b", [0.1, 0, 0.7], [0.9, 0.8, 1.6], weight=1.0),
    ]
    strong = {"tensile_strength": 1e5, "shear_strength": 1e5}
    dry = {"friction_coefficient": friction, "cohesion": cohesion}
    return scene(parts, [{"body": [0.8, 0.6, 0.0]}], "dry", inner=strong, dry=dry)


@pytest.mark.parametrize(("friction", "cohesion"), [(0.9, 0.0), (0.2, 0.0), (0.2, 0.3)])
def test_rigid_blocks_at_nodes_are_those_by_faces(friction: float, cohesion: float) -> None:
    """Without cohesion forces at the nodes carry λ by faces; with it a cohesive block slides at μ + c A/W."""
    assembly = tower(friction, cohesion)
    setting = FieldSetting.of(assembly, None, assembly.labels)
    mesh = setting.coarse
    problem = setting.problem(mesh)
    found = rigid_balance(problem, RigidBlocks.of(problem, assembly.labels), at_nodes=True)
    assert found is not None
    factor = setting.units.load * found.factor
    if cohesion:
        assert factor <= 0.2 + 0.3 * 0.8 / 3.0 + 1e-6
    else:
        # blocks of strength σ give way within W/σ of their edges
        assert factor == pytest.approx(solve(assembly).load_factor, rel=1e-3)


def test_fitted_joints_lose_less_than_their_share() -> None:
    """Halving edges where tractions lose brings linear tractions to within 0.4 of the gap of forces at nodes."""
    assembly = tower(0.9)
    setting = FieldSetting.of(assembly, None, assembly.labels)
    mesh = setting.coarse
    fitted = fitted_joints(mesh, setting.problem, assembly.labels, 0.2)
    before, after = (setting.problem(one) for one in (mesh, fitted))
    blocks = RigidBlocks.of(before, assembly.labels)
    points, coarse, fine = (
        rigid_balance(problem, blocks, at_nodes=at_nodes)
        for problem, at_nodes in ((before, True), (before, False), (after, False))
    )
    assert points is not None
    assert coarse is not None
    assert fine is not None
    assert coarse.factor < (1.0 - 0.4 * 0.2) * points.factor <= fine.factor <= points.factor
    assert len(mesh) < len(fitted) <= 1.1 * len(mesh)
    assert fitted.volume.sum() == pytest.approx(mesh.volume.sum(), rel=1e-12)


def test_a_mesh_without_dry_joints_is_not_changed() -> None:
    parts = [box("ground", [-1, -1, -1], [2, 2, 0], support=True), box("a", [0, 0, 0], [1, 1, 1], weight=1.0)]
    assembly = scene(parts, [{"body": [1, 0, 0]}], "inner")
    setting = FieldSetting.of(assembly, None, assembly.labels)
    assert fitted_joints(setting.coarse, setting.problem, assembly.labels, 0.15) is setting.coarse


def test_a_mesh_grows_as_far_as_its_limit_allows() -> None:
    """Where half as many again do not fit, the worst tetrahedra are bisected; nested meshes narrow both bounds."""
    parts = [box("base", [0, 0, -1], [1, 1, 0], support=True), box("stone", [0, 0, 0], [1, 1, 0.6])]
    stone = scene(parts, [{"element": "stone", "force": [1, 0, -0.2], "at": [0.5, 0.5, 0.6]}], "inner")
    found = bounds_by_fields(stone, gap=1e-6, most=34)
    sizes = [step.simplices for step in found.history]
    assert 1.05 * sizes[0] <= sizes[1] <= 34 < 1.5 * sizes[0]
    first, second = found.history[:2]
    assert second.lower >= first.lower - 1e-6 * first.upper
    assert second.upper <= first.upper * (1.0 + 1e-6)
    assert second.upper - second.lower < 0.999 * (first.upper - first.lower)
