"""Meshes of cells: they cover the cells and all interfaces, and refinement keeps both."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from benchmarks.claims.fields import random_scenes
from benchmarks.claims.geometry import Move
from studies.crack_models import bridge

from cases import all_inner, box, prism, rotation
from jld_core import Assembly, Bits, Floats, build_assembly, parse_scene, solve
from jld_core.fields import bounds as field_bounds
from jld_core.fields import bounds_by_fields
from jld_core.fields import loads as field_loads
from jld_core.fields import mesh as field_mesh
from jld_core.fields.rigid_joints import RigidBlocks, fitted_joints, rigid_balance
from jld_core.fields.solids import layers_of, surface_of
from proofs import velocities_with_margin


def random_assembly(seed: int) -> Assembly | None:
    """A random structure of cells, most of them not convex."""
    scenes = random_scenes(np.random.default_rng([seed, 2026]), [Move(np.eye(2), 1.0, np.zeros(2))])
    return None if scenes is None else build_assembly(parse_scene(scenes[0]))


def check(mesh: field_mesh.Mesh, assembly: Assembly) -> None:
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


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(12))
def test_random_cells(seed: int) -> None:
    """Coarsest mesh, similar subdivision and random refinement."""
    assembly = random_assembly(seed)
    if assembly is None:
        return
    coarse, _ = field_loads.loaded_mesh(assembly)
    check(coarse, assembly)
    check(field_mesh.subdivide(coarse, 3), assembly)
    rng = np.random.default_rng(seed)
    mesh = coarse
    for _ in range(3):
        singular = rng.integers(-1, 3, len(mesh))
        mesh = field_mesh.refine(mesh, rng.random(len(mesh)) < 0.2, singular)
        check(mesh, assembly)
        assert np.array_equal(np.unique(mesh.root), np.arange(len(coarse)))


def test_gradients_and_normals() -> None:
    """Gradients reproduce a linear function; normals are outward and of length one."""
    assembly = random_assembly(1)
    assert assembly is not None
    mesh = field_mesh.subdivide(field_loads.loaded_mesh(assembly)[0], 2)
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


# Meshes fitted before fields are solved for: layers of long and flat cells, and dry joints of rigid blocks.


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
    setting = field_bounds.FieldSetting.of(assembly, None, assembly.labels, (1,))
    mesh, loads = setting.coarse, setting.loads
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
        mesh, plain = (field_bounds.FieldSetting.of(assembly, None, None, cut).coarse for cut in ((1, 2), ()))
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
    setting = field_bounds.FieldSetting.of(assembly, None, assembly.labels)
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
    setting = field_bounds.FieldSetting.of(assembly, None, assembly.labels)
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
    setting = field_bounds.FieldSetting.of(assembly, None, assembly.labels)
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


# Meshes on which bounds used to fail: patches inside a face, and blocks with friction whose opening motion is dear.


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    """A bridge under a force on a patch of 0.2 m inside a face of 0.3 m; material with friction."""
    return build_assembly(bridge())


def test_a_patch_inside_a_face_has_a_stress_field_on_the_coarsest_mesh(assembly: Assembly) -> None:
    """Ends of the patch get three triangles; before, λ = 0 was the best of every mesh whose ends had two."""
    coarse, loads = field_loads.loaded_mesh(assembly)
    ends = [end for segment in loads.tractions for end in segment.ends]
    mesh = field_bounds.FieldSetting.of(assembly).coarse
    for end in ends:
        (node,) = np.flatnonzero(np.hypot(*(mesh.points - end).T) < 1e-9)
        assert (mesh.simplices == node).sum() >= 3
    assert mesh.volume.sum() == pytest.approx(coarse.volume.sum(), rel=1e-12)
    assert (field_mesh.fanned(mesh, ends).simplices == mesh.simplices).all()  # nothing more to do
    low = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly)).lower(~assembly.free_faces)[0]
    high = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly)).upper(~assembly.free_faces)[0]
    assert 0.4 * high < low < high


def test_meshes_are_left_alone_where_loads_end_at_corners(assembly: Assembly) -> None:
    coarse, _ = field_loads.loaded_mesh(assembly)
    corners = assembly.elements.shape[assembly.elements.index["c0r0"]]
    assert field_mesh.fanned(coarse, list(corners)) is coarse or len(field_mesh.fanned(coarse, list(corners))) == len(
        coarse
    )
    assert field_mesh.fanned(coarse, []) is coarse


def test_a_field_whose_repair_costs_much_is_solved_with_slack(
    assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On 674 triangles of this bridge opening by 5e-9 costs 1.6 % of λ; here the first field costs a tenth."""
    setting = field_bounds.FieldSetting.of(assembly)
    fields = field_bounds.Fields.on(setting, setting.coarse, assembly.labels)
    plain, upper, asked = fields.velocity, fields.upper, []
    original = upper.certify

    def dear(velocity: Floats, labels: Bits, expected: float) -> Any:
        found = original(velocity, labels, expected)
        asked.append(found)
        return found if found is None or len(asked) > 1 else replace(found, factor=1.1 * found.factor)

    monkeypatch.setattr(upper, "certify", dear)
    found = upper.bound(assembly.labels)
    assert len(asked) == 2
    assert plain is not None
    assert found is not None
    assert found.factor == pytest.approx(plain.factor, rel=1e-5)


def test_room_of_flow_rules_costs_next_to_nothing(assembly: Assembly) -> None:
    """A program with a margin of 1e-8: its field needs no opening, and λ rises by less than 1e-5 of itself."""
    setting = field_bounds.FieldSetting.of(assembly)
    labels = assembly.labels
    fields = field_bounds.Fields.on(setting, setting.coarse, labels)
    plain, upper = fields.velocity, fields.upper
    assert plain is not None
    answer = velocities_with_margin(upper, labels, 1e-8)
    found = upper.certify(answer.point[: 6 * len(setting.coarse)].reshape(-1, 3, 2), labels, answer.objective)
    assert found is not None
    assert found.opened == 0.0
    assert found.factor == pytest.approx(plain.factor, rel=1e-5)
