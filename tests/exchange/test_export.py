"""Blocks out: closed solids, whole outlines, shapes told apart; and back in with the same faces and the same λ."""

from __future__ import annotations

import csv
import io
import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import ROUTE, box, grid_document
from cases import scene_in_space as spatial_scene
from command import SCENES, call
from jld_core import InputError, Layout, Scene, blocks_csv, build_assembly, load_scene, parse_scene, samples, solve
from jld_core.build import build_robust
from jld_core.geometry import outlines, unions
from jld_explore import ExploreSettings, explore, read_folder
from jld_formats import FORMATS, ImportOptions, export, import_file

pytest.importorskip("ezdxf")
meshio = pytest.importorskip("meshio")


def layout(scene: Scene, share: float | None = None, seed: int = 0, solved: bool = False) -> Layout:
    """The scene's own labelling, or one with about this share of dry faces, by chance."""
    assembly = build_assembly(scene)
    labels = assembly.labels
    if share is not None:
        labels = np.random.default_rng(seed).uniform(size=len(labels)) < share
    return Layout(scene, assembly, labels, solve(assembly, labels) if solved else None)


CASES = {
    "wall": (samples.wall(bond="flemish", opening="1.0,0.4,0.6,0.4"), 0.6),
    "arch": (samples.arch(rings=2, bond="running", load="quarter"), 0.6),
    "grid": (samples.grid(load="crown", support="ends"), 0.5),
    "ferris": (load_scene(SCENES / "ferris_tinloi_1.json"), None),
    "dome": (samples.dome(bond="running", meridians=6), 0.6),
    "cross": (samples.vault("cross", voussoirs=4, courses=2), 0.7),
    "shelf": (load_scene(SCENES / "spatial_shelf.json"), None),
    "cubes": (load_scene(SCENES / "spatial_cubes.json"), None),
}


def signed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CASES)
def test_every_block_is_one_closed_surface_of_its_cells_volume(name: str) -> None:
    """Each edge of the triangles is run through once either way, and the volumes are those of the elements."""
    scene, share = CASES[name]
    made = layout(scene, share)
    for block, members, surfaces in zip(made.blocks, made.members, made.surfaces, strict=True):
        total = 0.0
        for surface in surfaces:
            triangles = np.array(surface.triangles)
            edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).tolist()
            tally: dict[tuple[int, int], int] = {}
            for a, b in edges:
                tally[a, b] = tally.get((a, b), 0) + 1
            assert all(count == tally.get((b, a), 0) for (a, b), count in tally.items()), block.name
            total += signed_volume(surface.points, triangles)
        exact = made.assembly.elements.volume[members].sum()
        assert total == pytest.approx(exact, rel=1e-7 if name == "shelf" else 1e-10), block.name


def congruent(one: Any, other: Any, *, rotate: bool = True, flip: bool = False) -> bool:
    """Whether two sets of corners (k, d) are one by a shift, a turn if allowed, and a mirror if allowed."""
    first, second = (outlines.Outline(c - c.mean(axis=0), len(c), 1.0, 1.0, 0) for c in (one, other))
    return outlines.alike(
        first, second, 5e-6 * float(np.linalg.norm(first.points, axis=1).max()), rotate=rotate, flip=flip
    )


def test_blocks_of_one_shape_share_a_number() -> None:
    """Bricks of a running bond: stretchers and halves, two shapes; turned and turned-over copies are the same."""
    made = layout(samples.wall(bond="running", courses=4))
    free = [block for block in made.blocks if block.cells]
    assert {(round(b.upper[0] - b.lower[0], 9), b.shape) for b in free} == {(0.4, 1), (0.2, 2)}
    ell = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 3], [0, 3.0]])
    turned = ell @ np.array([[0.6, -0.8], [0.8, 0.6]]) + [4.0, -2.0]
    mirrored = ell * [-1.0, 1.0]
    assert congruent(ell, turned)
    assert not congruent(ell, turned, rotate=False)
    assert not congruent(ell, mirrored)
    assert congruent(ell, mirrored, flip=True)
    solid = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4.0], [1, 1, 5]])
    angle = 0.7
    about = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert congruent(solid, solid @ about.T @ np.diag([-1.0, -1.0, 1.0]) + 3.0)
    assert not congruent(solid, solid * [-1.0, 1.0, 1.0])


def test_cells_around_a_hole_are_one_outline_with_a_hole() -> None:
    made = layout(parse_scene(grid_document(["aaa", "a.a", "aaa", "###"])))
    (region,) = made.regions[0]
    assert (len(region.shell), [len(hole) for hole in region.holes]) == (4, [4])
    surface = unions.extrude(region, 0.5)
    shell, hole = (
        abs(float(np.linalg.det(np.array([r[1] - r[0], r[2] - r[1]])))) for r in (region.shell, region.holes[0])
    )
    assert signed_volume(surface.points, np.array(surface.triangles)) == pytest.approx(0.5 * (shell - hole))


def test_the_table_of_blocks() -> None:
    """Three courses of two, four and one cells, worked out by hand: 0.1 m cells, 1400 kg/m³, 0.1 m deep."""
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["aabb", "cccc", "####"]},
        "materials": {
            "density": 1400,
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": 1e5, "shear_strength": 1e5},
        },
        "loads": {"live": [{"body": [1, 0]}]},
    }
    rows = list(csv.DictReader(io.StringIO(blocks_csv(layout(parse_scene(document))))))
    assert [row["block"] for row in rows] == ["a", "b", "c"]
    assert [row["elements"] for row in rows][:2] == ["c0r0 c1r0", "c2r0 c3r0"]
    wanted = {
        "cells": 2, "mass": 2.8, "centroid_x": 0.1, "centroid_y": 0.25, "extent_x": 0.2, "extent_y": 0.1, "shape": 1,
        "volume": 0.002, "dry_length": 0.3, "inner_length": 0.1,
    }  # fmt: skip
    assert {key: float(rows[0][key]) for key in wanted} == pytest.approx(wanted)
    assert [row["shape"] for row in rows] == ["1", "1", "2"]
    assert float(rows[2]["dry_length"]) == pytest.approx(0.8)


ROUND = [("dxf", False, name) for name in ("wall", "arch", "grid", "ferris")]
ROUND += [("compas", True, name) for name in ("dome", "shelf", "cubes")]
ROUND += [("3dm", name not in ("wall", "arch"), name) for name in ("wall", "arch", "cross", "dome", "cubes")]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("kind", "cells", "name"), ROUND)
def test_there_and_back_is_the_same_assembly(kind: str, cells: bool, name: str, tmp_path: Path) -> None:
    """Interfaces, labels and λ to 1e-9, and materials and loads with them: nothing is told to the reader."""
    pytest.importorskip("rhino3dm" if kind == "3dm" else "json")
    scene, share = CASES[name]
    for seed in range(8):  # a labelling that collapses
        made = layout(scene, share, seed, solved=True)
        assert made.result is not None
        if np.isfinite(made.result.load_factor):
            break
    path = export(made, kind, tmp_path / f"there{FORMATS[kind]}", cells=cells)
    back = build_assembly(parse_scene(import_file(path).document))
    there = made.assembly
    support = [dict(zip(one.elements.ids, one.elements.support.tolist(), strict=True)) for one in (back, there)]
    assert support[0] == support[1]

    def faces(a: Any, labels: np.ndarray) -> list[tuple[Any, ...]]:
        ids = a.elements.ids
        rows = zip(a.interfaces.a, a.interfaces.b, a.interfaces.area, labels, strict=True)
        return sorted((*sorted((ids[i], ids[j])), round(float(s), 9), bool(d)) for i, j, s, d in rows)

    assert faces(back, back.labels) == faces(there, made.labels)
    result = solve(back)
    assert result.status is made.result.status
    # λ itself is known to the widths of both brackets
    width = 1e-9 * abs(made.result.load_factor) + sum(hi - lo for lo, hi in (result.bracket, made.result.bracket))
    assert result.load_factor == pytest.approx(made.result.load_factor, abs=width, nan_ok=True)


def test_strengths_of_one_face_come_back_from_compas(tmp_path: Path) -> None:
    """All of them, friction as an angle and values with a spread too; faces beside it keep those of the materials."""
    cells = [(i, k) for i in (0, 1) for k in (0, 1)]
    boxes = [box(f"{i}{k}", [i, 0, k], [i + 1, 1, k + 1]) for i, k in cells]
    document = spatial_scene([box("ground", [0, 0, -1], [2, 1, 0], support=True), *boxes])
    own: list[dict[str, Any]] = [
        {"compressive_strength": 3e6, "cohesion": 2e4, "inner_friction_coefficient": 0.25},
        {"friction_angle": 20.0, "tensile_strength": {"nominal": 2e5, "low": 1e5}, "shear_strength": 3e5},
        {"inner_friction_angle": 10.0},
    ]
    plain = build_assembly(parse_scene(document))
    faces, ids = plain.interfaces, plain.elements.ids
    document["interfaces"] = [
        {"elements": [ids[a], ids[b]], "polygon": polygon.tolist(), "label": "dry", **extra}
        for a, b, polygon, extra in zip(faces.a, faces.b, faces.polygon, [*own, *[{}] * len(faces)], strict=False)
    ]
    scene = parse_scene(document)
    there = layout(scene)
    path = export(there, "compas", tmp_path / "there.json", cells=True)
    found = parse_scene(import_file(path).document)
    back = build_assembly(found)
    names = {frozenset((ids[a], ids[b])): k for k, (a, b) in enumerate(zip(faces.a, faces.b, strict=True))}
    pairs = zip(back.interfaces.a, back.interfaces.b, strict=True)
    order = [names[frozenset((back.elements.ids[a], back.elements.ids[b]))] for a, b in pairs]
    assert sorted(order) == list(range(len(faces)))
    for field, values in vars(there.assembly.strengths(ROUTE)).items():
        np.testing.assert_array_equal(getattr(back.strengths(ROUTE), field), values[order], err_msg=field)
    assert len(np.unique(back.strengths(ROUTE).cohesion)) == 2
    low = build_robust(found)
    np.testing.assert_array_equal(low.strengths(ROUTE).tension, build_robust(scene).strengths(ROUTE).tension[order])


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("kind", "name"), [("obj", "cross"), ("stl", "dome"), ("ply", "dome"), ("dxf", "dome")])
def test_meshes_there_and_back_hold_the_geometry(kind: str, name: str, tmp_path: Path) -> None:
    """What a mesh has no place for is taken from another scene; the faces are found again, λ with all of them dry."""
    scene, _ = CASES[name]
    made = layout(scene, solved=True)
    assert made.result is not None
    path = export(made, kind, tmp_path / f"there{FORMATS[kind]}", cells=kind != "dxf")
    back = build_assembly(parse_scene(import_file(path, ImportOptions(like=scene)).document))
    assert len(back.interfaces) == len(made.assembly.interfaces)
    assert solve(back).load_factor == pytest.approx(made.result.load_factor, rel=3e-8)


def test_a_planar_layout_extruded_has_the_planar_load_factor(tmp_path: Path) -> None:
    """COMPAS knows no plane: blocks get their thickness, loads go to its middle; by symmetry λ stays what it was."""
    made = layout(CASES["arch"][0], 0.6, 1, solved=True)
    assert made.result is not None
    path = export(made, "compas", tmp_path / "arch.json", cells=True)
    back = build_assembly(parse_scene(import_file(path).document))
    assert back.dimension == 3
    assert solve(back).load_factor == pytest.approx(made.result.load_factor, rel=1e-6)


def test_svg_there_and_back(tmp_path: Path) -> None:
    scene, share = CASES["wall"]
    made = layout(scene, share)
    path = export(made, "svg", tmp_path / "wall.svg")
    found = import_file(path, ImportOptions(like=scene, thickness=0.2))
    back = build_assembly(parse_scene(found.document))
    assert (len(back.elements), len(back.interfaces)) == (len(made.assembly.elements), len(made.assembly.interfaces))
    assert int(back.labels.sum()) == int(made.labels.sum())
    assert set(back.elements.ids) == set(made.assembly.elements.ids)


def test_vtk_holds_forces_mechanism_and_utilisation(tmp_path: Path) -> None:
    """Read by meshio: vertical forces on the base balance weight, and the mechanism is that of the analysis."""
    made = layout(samples.wall(courses=3, length=1.2), solved=True)
    result = made.result
    assert result is not None
    assert result.forces is not None
    path = export(made, "vtk", tmp_path / "wall.vtu")
    mesh = meshio.read(path)
    assert set(mesh.cell_data) >= {"part", "element", "block", "shape", "label", "utilisation", "force", "support"}
    part, force = (np.concatenate(mesh.cell_data[name]) for name in ("part", "force"))
    assert int((part == 1).sum()) == len(made.assembly.interfaces)
    support = np.concatenate(mesh.cell_data["support"])
    faces = made.assembly.interfaces
    grounded = made.assembly.elements.support[faces.a] | made.assembly.elements.support[faces.b]
    assert grounded.any()
    free = made.assembly.elements.free
    total = made.assembly.elements.weight[free].sum(axis=0)[1]
    sign = np.where(made.assembly.elements.support[faces.b], 1.0, -1.0)[grounded]  # what the base takes, on element b
    assert (sign * force[part == 1][grounded, 2]).sum() == pytest.approx(total, rel=1e-6)
    assert set(support.tolist()) == {0.0, 1.0}
    older = meshio.read(export(made, "vtk", tmp_path / "wall.vtk"))  # what ParaView expects under this ending
    assert (tmp_path / "wall.vtk").read_bytes().startswith(b"# vtk DataFile")
    assert np.array_equal(np.concatenate(older.cell_data["force"]), force)
    motion = mesh.point_data["mechanism"]
    assert motion.shape == (len(mesh.points), 3)
    assert np.abs(motion).max() > 0.0
    assert np.concatenate(mesh.cell_data["utilisation"]).max() <= 1.0 + 1e-6


def test_3dec_commands_name_every_block_and_its_properties(tmp_path: Path) -> None:
    """A block for each cell, joined where they are one, faces of cells clockwise from outside, density and friction."""
    made = layout(parse_scene(grid_document(["aab", "ccb", "###"])))
    text = export(made, "3dec", tmp_path / "wall.dat").read_text("utf-8")
    assert text.count("block create polyhedron") == len(made.assembly.elements)
    joined = [block for block in made.blocks if len(block.elements) > 1]
    assert text.count("block join range group") == len(joined)
    for block in made.blocks:
        assert f"range group '{block.name}'" in text
    assert "friction" in text
    first = text.split("block create polyhedron")[1].split("block ")[0]
    loops = [re.findall(r"\(([^)]*)\)", line) for line in first.splitlines() if "face" in line]
    faces = [np.array([[float(v) for v in corner.split(",")] for corner in loop]) for loop in loops]
    middle = np.concatenate(faces).mean(axis=0)
    for a, b, c in (face[:3] for face in faces):
        assert np.cross(b - a, c - b) @ (a - middle) < 0.0


@pytest.mark.parametrize(("kind", "cells"), [("dxf", False), ("compas", True), ("compas", False)])
def test_pressures_go_out_with_the_blocks(kind: str, cells: bool, tmp_path: Path) -> None:
    """On an outline, and around an element: kept in a drawing, forces and moments elsewhere; λ is the same."""
    document = grid_document(["ab", "ab", "##"])
    face = {"face": {"along": [[0.0, 0.3], [0.0, 0.1]]}, "pressure": [0.0, 2000.0]}
    around = {"face": {"between": ["c1r0", "outside"]}, "pressure": 50.0}
    document["loads"] = {"live": [face], "dead": [around]}
    document["labels"] = {"default": "dry"}
    made = layout(parse_scene(document), solved=True)
    assert made.result is not None
    path = export(made, kind, tmp_path / f"a{FORMATS[kind]}", cells=cells)
    found = import_file(path).document
    assert any("face" in entry for entry in found["loads"]["live"]) == (kind == "dxf")
    again = solve(build_assembly(parse_scene(found)))
    assert again.load_factor == pytest.approx(made.result.load_factor, rel=2e-6)


def test_pressures_of_a_scene_to_be_like_are_left_out_where_their_element_is_missing(tmp_path: Path) -> None:
    document = grid_document(["ab", "ab", "##"])
    document["loads"] = {"live": [{"face": {"between": ["c1r0", "outside"]}, "pressure": 50.0}, {"body": [0, 1]}]}
    made = layout(parse_scene(document))
    found = import_file(export(made, "obj", tmp_path / "a.obj"), ImportOptions(like=made.scene))
    assert found.document["loads"]["live"] == [{"body": [1.0, 0.0, 0.0]}]


def test_moving_loads_go_out_with_a_drawing_alone(tmp_path: Path) -> None:
    document = grid_document(["aabb", "####"])
    axles = [{"weight": 1000.0}, {"weight": 500.0, "distance": 0.1}]
    document["loads"] = {"moving": [{"name": "cart", "axles": axles, "path": [[0.0, 0.2], [0.4, 0.2]], "steps": 3}]}
    made = layout(parse_scene(document))
    found = import_file(export(made, "dxf", tmp_path / "a.dxf")).document
    assert found["loads"]["moving"][0]["name"] == "cart"
    parse_scene(found)
    with pytest.raises(InputError, match=r"loads\.moving"):
        export(made, "compas", tmp_path / "a.json")


def test_pushes_go_out_with_drawings_and_with_solids_of_solids(tmp_path: Path) -> None:
    document = grid_document(["aabb", "####"])
    document["loads"] = {"pushes": {"directions": 2}}
    made = layout(parse_scene(document))
    found = import_file(export(made, "dxf", tmp_path / "a.dxf")).document
    assert found["loads"]["pushes"] == {"directions": 2}
    parse_scene(found)
    with pytest.raises(InputError, match=r"loads\.pushes: its directions are those of the plane"):
        export(made, "compas", tmp_path / "a.json")


def test_compas_interfaces_state_their_areas(tmp_path: Path) -> None:
    made = layout(CASES["dome"][0])
    document = json.loads(export(made, "compas", tmp_path / "a.json", cells=True).read_text())
    edges = document["data"]["graph"]["data"]["edge"]
    sizes = [f["data"]["size"] for others in edges.values() for entry in others.values() for f in entry["interfaces"]]
    assert sorted(sizes) == pytest.approx(sorted(made.assembly.interfaces.area))


@pytest.mark.skipif(find_spec("compas_cra") is None, reason="compas_cra is not installed")
def test_compas_assembly_opens_what_is_written_and_compas_cra_solves_it(tmp_path: Path) -> None:
    """A pile on a slab: opened by COMPAS itself, interfaces with their frames and sizes, and solved by RBE and CRA."""
    import contextlib

    import compas
    from compas_cra.datastructures import CRA_Assembly
    from compas_cra.equilibrium import cra_solve, rbe_solve

    made = layout(samples.wall(courses=2, length=0.8, brick=0.4, height=0.2, depth=0.3))
    path = export(made, "compas", tmp_path / "wall.json")
    opened = compas.json_load(path)
    assert type(opened).__name__ == "Assembly"
    assert opened.graph.number_of_nodes() == len(made.blocks)
    (first,) = list(opened.graph.edges())[:1]
    (face,) = opened.graph.edge_attribute(first, "interfaces")
    assert face.size > 0.0
    assert face.frame.zaxis.length == pytest.approx(1.0)
    volume = sum(abs(opened.node_block(node).volume()) for node in opened.graph.nodes())
    assert volume == pytest.approx(made.assembly.elements.volume.sum())
    for solver in (rbe_solve, cra_solve):
        assembly = CRA_Assembly.__from_data__(compas.json_load(path).__data__)
        nodes = list(assembly.graph.nodes())
        assembly.set_boundary_conditions([n for n in nodes if assembly.graph.node_attribute(n, "is_support")])
        with contextlib.redirect_stdout(io.StringIO()):
            solver(assembly, mu=0.6)
        shared = [face for e in assembly.graph.edges() for face in assembly.graph.edge_attribute(e, "interfaces")]
        forces = [corner for face in shared for corner in face.forces]
        assert sum(c["c_np"] for c in forces) > 0.0
        assert max(c["c_nn"] for c in forces) < 1e-4 * max(c["c_np"] for c in forces)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "out"
    document = grid_document(["aab", "abb", "###"])
    explore(parse_scene(document), folder, ExploreSettings(pictures=False))
    return folder


def test_a_search_leaves_the_blocks_of_its_best(study: Path) -> None:
    done = read_folder(study)
    assert (study / "blocks.csv").read_text("utf-8") == blocks_csv(done.layout(1))
    assert done.blocks(1)["cells"].sum() == 6
    for rank in (1, 2):
        row = done.results.iloc[rank - 1]
        assert done.result(rank).load_factor == pytest.approx(row["load_factor"], rel=1e-7)
        assert len(done.blocks(rank)) == row["blocks"]
    with pytest.raises(InputError, match="no layout of rank 9999"):
        done.layout(9999)


def test_commands_take_a_rank(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """solve, plot and export by rank; what has no rank is refused in one line."""
    rows = read_folder(study).results
    solved = call(monkeypatch, capsys, "solve", study, "--rank", "3", "--json")
    assert json.loads(solved.out)["load_factor"] == pytest.approx(rows["load_factor"].iloc[2], rel=1e-7)
    call(monkeypatch, capsys, "plot", study, "--rank", "1,4", "--out", tmp_path / "two.svg").done()
    text = (tmp_path / "two.svg").read_text("utf-8")
    assert "rank 1" in text
    assert f"rank {rows['rank'].iloc[3]}" in text
    for kind in FORMATS:
        out = tmp_path / f"blocks{FORMATS[kind]}"
        done = call(monkeypatch, capsys, "export", study, "--format", kind, "--rank", "2", "-o", out)
        assert (done.code, done.err) == (0, "")
        assert out.stat().st_size > 0
        assert (tmp_path / "blocks.blocks.csv").read_text("utf-8") == blocks_csv(read_folder(study).layout(2))
    scene = study / "scene.json"
    for arguments in (
        ["solve", study, "--rank", "9999"],
        ["solve", scene, "--rank", "1"],
        ["plot", scene, "--rank", "1"],
        ["plot", study, "--rank", "one"],
        ["plot", study, "--rank", "1,2,3,4,5,6,7"],
        ["export", study, "--format", "dxf", "--rank", "9999", "-o", tmp_path / "no.dxf"],
        ["export", study, "--format", "dxf", "--cells", "-o", tmp_path / "no.dxf"],
        ["export", scene, "--format", "dxf", "-o", tmp_path / "no" / "no.dxf"],
        ["export", scene, "--format", "dxf", "-o", ""],
        ["export", scene, "--format", "docx", "-o", tmp_path / "no.docx"],
    ):
        call(monkeypatch, capsys, *arguments).refused()
    assert not list(tmp_path.glob("no*"))


def test_values_that_a_format_cannot_hold_are_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="spatial"):
        export(layout(CASES["cubes"][0]), "svg", tmp_path / "no.svg")
    bent = parse_scene(
        {
            "elements": [
                {"id": "L", "polygon": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]},
                {"id": "g", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
            ],
            "materials": {"density": 1, "dry": {"friction_coefficient": 1}},
            "loads": {"live": [{"body": [1, 0]}]},
        }
    )
    with pytest.raises(InputError, match="'L': it is not convex"):
        export(layout(bent), "3dec", tmp_path / "no.dat")
    with pytest.raises(InputError, match="no format is named 'dwg'"):
        export(layout(bent), "dwg", tmp_path / "no.dwg")
    assert not list(tmp_path.iterdir())
    assert len(unions.union_outlines([np.array(bent.elements[0].polygon)])[0].shell) == 6  # type: ignore[index]
