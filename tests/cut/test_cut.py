"""Cutting solids: exact cells and joints, closed forms of λ, all layouts of parts, files read again, bad input."""

from __future__ import annotations

import json
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import comb
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64, OpType
from scipy.spatial import ConvexHull

from command import Command
from jld_core import InputError, ParameterError, build_assembly, parse_scene
from jld_cut import Options, cut, meshes, partitions
from jld_cut import cells as of_cells
from jld_cut import keys as of_keys
from jld_cut import parts as of_parts
from jld_cut import search as of_search
from jld_cut.cut import carries, verdict
from jld_cut.fields import scene_of_parts
from jld_cut.scene import outside, scene_of, shares
from jld_explore import ExploreSettings, explore

DOWN = ("0,0,-1000",)


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0, 0, 0)) -> Any:
    return Manifold.cube((x, y, z)).translate(at)


def bench() -> Any:
    return box(1.8, 0.4, 0.1, (0, 0, 0.4)) + box(0.2, 0.4, 0.41, (0.1, 0, 0)) + box(0.2, 0.4, 0.41, (1.5, 0, 0))


def by_grid(solid: Any, wish: Any) -> Any:
    """Cells of a solid by planes of a grid, and what holds and loads them."""
    family = of_search.family_of("grid", "solid", of_search.body_of(solid, wish), wish)
    assert family is not None
    return family


def divided(solid: Any, *planes: tuple[Sequence[float], float]) -> Any:
    """The cells of a solid by planes, each with its normal and its distance from the origin."""
    cutting = of_cells.Cutting(solid)
    for normal, at in planes:
        cutting.through(np.array(normal, dtype=float), at)
    return cutting


def joints(cutting: Any) -> Any:
    return of_cells.joints_of(cutting.cells, cutting.planes, cutting.size)


def searched(family: Any, wish: Any, together: Sequence[int] = (), **asked: Any) -> Any:
    """All layouts of the cells of a family, for a minute."""
    asked = {"seconds": 60.0, **asked}
    given = family.boxes(), family.around, wish.limits, list(together), goal_of(**asked)
    return partitions.search(family.document, *given)


def mesh_of(solid: Any) -> trimesh.Trimesh:
    """The surface of a solid."""
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)


def is_closed(solid: Any) -> bool:
    """Whether two faces meet at each edge of a solid in its file."""
    points, triangles = meshes.as_read(meshes.stl_bytes(*meshes.as_written(solid, 1.0)))
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all()) and len(points) > 0


def written(solid: Any, path: Path) -> Path:
    mesh_of(solid).export(path)
    return path


@pytest.mark.parametrize(("load", "angle", "factor"), [("body:1,0,0", 35.0, 0.5), ("body:0.6,0.8,0", 45.0, 0.625)])
def test_a_pillar_in_two_parts_tips_as_in_closed_form(tmp_path: Path, load: str, angle: float, factor: float) -> None:
    """A pillar 1 × 1 × 2 tilts at half its width over half its height, whatever cuts it level.

    With less friction a base of two faces carries less of an oblique load: each face's friction also bears torsion.
    """
    options = Options((1.2,) * 3, (load,), require=0.1, families=("grid",), cells=4, seconds=3.0)
    options = replace(options, matter=replace(options.matter, friction_angle=angle, tensile=1e6))
    found = cut(written(box(1.0, 1.0, 2.0), tmp_path / "pillar.stl"), options, tmp_path / "out")
    assert found["parts"] == 2
    assert found["fits"]
    assert found["can_be_laid"]
    assert found["load_factor"] == pytest.approx(factor, rel=1e-4)
    # both parts touch in one file, which holds them in millimetres
    assert meshes.read_solid(tmp_path / "out" / "parts.3mf", 1.0).volume() == pytest.approx(2.0, rel=1e-6)


def _round_table() -> Any:
    legs = [Manifold.cylinder(0.71, 0.09, 0.07, 16).translate((x, y, 0)) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    return Manifold.batch_boolean([Manifold.cylinder(0.08, 0.7, 0.7, 24).translate((0, 0, 0.7)), *legs], OpType.Add)


def _bowl() -> Any:
    return (Manifold.sphere(1.6, 24) - Manifold.sphere(1.4, 24)) ^ box(4, 4, 2, (-2, -2, 0))


@pytest.mark.parametrize("made", [bench, _round_table, _bowl])
def test_a_part_of_cells_of_different_cuts_is_closed(made: Any) -> None:
    """Cells whose cuts meet within rounding become one body without walls of no thickness, with their volume."""
    turn = [np.sin(0.3), np.cos(0.3) * 0.6, np.cos(0.3) * 0.8]
    cutting = divided(made(), ([1, 0, 0], 0.13), (turn, 0.41), ([0.8, -0.6, 0], 0.07))
    cutting.through(np.array([0, 0, 1.0]), 0.43, range(0, len(cutting.cells), 2))
    order = range(len(cutting.cells))
    beside = {(joint.a, joint.b) for joint in joints(cutting)}
    chosen = [0]
    for _ in range(len(order) // 2):
        near = [k for k in order if k not in chosen and any((k, c) in beside or (c, k) in beside for c in chosen)]
        chosen += near[:1]
        body = of_cells.union([cutting.cells[k] for k in chosen])
        assert body.volume() == pytest.approx(sum(cutting.cells[k].volume() for k in chosen), rel=1e-9)
        assert is_closed(body)
    # as for a STEP file, with plane faces: the same volume, and two faces at each edge
    surface = of_parts.plain_surface(body)
    fans = np.array([(face[0], *pair) for face in surface.faces for pair in pairwise(face[1:])])
    assert meshes.volume_of(surface.points, fans) == pytest.approx(body.volume(), rel=1e-6)
    assert len(meshes.open_edges(fans)) == 0
    everything = of_cells.union(cutting.cells)
    assert is_closed(everything)
    assert everything.volume() == pytest.approx(made().volume(), rel=1e-9)


def test_a_part_fits_a_box_along_the_axes() -> None:
    """A square plate whose smallest rectangle is not along the axes: the box along them is tried as well."""
    corner = (Manifold.cylinder(0.2, 2.0, 2.0, 48) ^ box(2, 2, 1)) - Manifold.cylinder(1.0, 1.7, 1.7, 48, True)
    part = of_parts.Part(1, [0], corner, corner, 1.0)
    assert of_parts.lay(part, np.full(3, 2.0))
    assert part.box.max() <= 2.0 * (1 + 1e-6)


def test_a_faulty_file_is_named(tmp_path: Path) -> None:
    """A part that touches itself along an edge only has an edge with four faces: it is named, not passed over."""
    two = Manifold.batch_boolean([box(1, 1, 1), box(1, 1, 1, (1, 1, 0))], OpType.Add)
    part = of_parts.Part(3, [0, 1], two, two, 1.0)
    of_parts.write_parts(tmp_path, [part], 1.0)
    assert not part.watertight
    assert part.fault == "part 3 has 1 edges that other than two faces meet at"


def test_a_bench_is_cut_to_whole_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = Options((0.95,) * 3, DOWN, clearance=0.002, cells=6, seconds=13.0, mass=200.0, families=("grid",))
    found = cut(written(bench(), tmp_path / "bench.stl"), options, out)
    table = pd.read_csv(out / "parts.csv")
    assert found == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert len(table) == found["parts"]
    assert found["volume_error"] < 1e-12
    assert found["file_error"] < 1e-6
    assert table["mass"].max() <= 200.0 * (1 + 1e-9)
    assert table["volume"].sum() == pytest.approx(found["volume"], rel=1e-9)
    assert (table["volume_with_clearance"] < table["volume"]).all()
    read = [trimesh.load_mesh(out / name) for name in table["file"]]
    assert all(mesh.is_watertight for mesh in read)
    assert [mesh.volume for mesh in read] == pytest.approx(table["volume_with_clearance"].tolist(), rel=1e-6)
    solids = [Manifold(Mesh64(mesh.vertices, mesh.faces.astype(np.uint64))) for mesh in read]
    assert all((a ^ b).volume() < 1e-9 for k, a in enumerate(solids) for b in solids[:k])
    assert sorted(table["step"]) == list(range(1, len(table) + 1))
    for name in ("parts.3mf", "parts.step", "parts.png", "order.png", "report.html", "scene.json"):
        # a machine that is slow or shared may have no time for some, which are named
        assert name in found["left_out"] or (out / name).stat().st_size > 500
    for one in ("bed/part_01.stl", "parts/part_01.3mf"):
        assert meshes.read_solid(out / one, 1.0).volume() == pytest.approx(read[0].volume, rel=1e-5)
    whole = "parts.step" not in found["left_out"]
    assert len(list((out / "parts").glob("*.step"))) == whole * len(table)


def test_cells_and_joints_are_exact() -> None:
    solid = bench()
    mesh = mesh_of(solid)
    assert meshes.volume_of(mesh.vertices + 1e3, mesh.faces) == pytest.approx(solid.volume(), rel=1e-12)
    cutting = divided(solid, ([1, 0, 0], 0.9), ([0, 0, 1], 0.4), ([0.6, 0, 0.8], 0.5))
    assert sum(cell.volume() for cell in cutting.cells) == pytest.approx(solid.volume(), rel=1e-12)
    found = joints(cutting)
    upright = [joint for joint in found if abs(joint.normal[0]) == 1.0]
    assert sum(joint.area for joint in upright) == pytest.approx(0.4 * 0.1, rel=1e-9)
    assert sum(joint.area for joint in found if abs(joint.normal[2]) == 1.0) == pytest.approx(2 * 0.2 * 0.4, rel=1e-9)
    cutting.halve(of_cells.Limits(np.full(3, 0.3), 1.0))
    sides = np.array([np.ptp(np.array(cell.bounding_box()).reshape(2, 3), axis=0) for cell in cutting.cells])
    assert sides.max() <= 0.3 * (1 + 1e-9)


def test_concave_cells_are_split_to_convex_ones() -> None:
    assert len(of_cells.concave_edges(box(1, 1, 1))) == 0
    pieces, of, planes, convex = of_cells.convex_parts([bench(), box(1, 1, 1, (5, 0, 0))], 50)
    assert convex
    assert len(planes) >= 1
    assert set(of.tolist()) == {0, 1}
    assert sum(piece.volume() for piece in pieces) == pytest.approx(bench().volume() + 1.0, rel=1e-12)


def test_a_round_joint_has_few_corners() -> None:
    tube = Manifold.cylinder(2.0, 1.0, 1.0, 48) - Manifold.cylinder(4.0, 0.6, 0.6, 48, True)
    cutting = divided(tube, ([0, 0, 1.0], 1.0))
    found = joints(cutting)
    assert max(len(joint.polygon) for joint in found) <= 8
    area = (Manifold.cylinder(1.0, 1.0, 1.0, 48) - Manifold.cylinder(4.0, 0.6, 0.6, 48, True)).volume()
    assert sum(joint.area for joint in found) == pytest.approx(area, rel=0.1)


def test_axis_and_stress_of_simple_bodies() -> None:
    wish = Options((9.0,) * 3, DOWN, cells=6, families=("radial",)).wish()
    tube = Manifold.cylinder(1.0, 2.0, 2.0, 40) - Manifold.cylinder(3.0, 1.5, 1.5, 40, True)
    found = of_search.family_of("radial", "tube", of_search.body_of(tube, wish), wish)
    assert found is not None
    through = [plane for plane in found.cutting.planes if abs(plane[2]) < 1e-6]
    assert len(through) > 2
    assert [plane[3] for plane in through] == pytest.approx([0.0] * len(through), abs=1e-6)
    assert of_search.family_of("radial", "bench", of_search.body_of(bench(), wish), wish) is None
    # what presses a pillar runs along it, so that cuts across are level
    wish = Options((9.0,) * 3, DOWN, cells=6, families=("stress",)).wish()
    found = of_search.family_of("stress", "pillar", of_search.body_of(box(1.0, 1.0, 3.0), wish), wish)
    assert found is not None
    assert len(found.cutting.planes) > 1
    assert all(abs(plane[2]) > 0.95 for plane in found.cutting.planes)


@pytest.mark.parametrize(("way", "count"), [("grid", 2), ("grid", 45), ("stress", 8)])
def test_loads_are_alike_for_all_cuts(way: str, count: int) -> None:
    """A force on a region of the seat has the same sum and the same moment on any cells, r × F of its middle."""
    back = bench() + box(1.8, 0.1, 0.4, (0, 0.3, 0.5))
    load = ("0,0,-6@0.2,0,0.45,1.3,0.3,0.6",)
    wish = Options((9.0,) * 3, load, cells=count, families=(way,)).wish()
    found = of_search.family_of(way, "bench", of_search.body_of(back, wish), wish)
    assert found is not None
    # a cut of 45 cells runs along the seat, whose faces stay those of the solid
    assert count != 45 or any(plane[2] > 0.9 and abs(plane[3] - 0.5) < 1e-6 for plane in found.cutting.planes)
    assembly = build_assembly(parse_scene(found.document))
    force, moment = assembly.live[:, :3], assembly.live[:, 3:]
    assert force.sum(axis=0) == pytest.approx([0.0, 0.0, -6.0], abs=1e-9)
    about_origin = moment + np.cross(assembly.elements.centroid, force)
    assert about_origin.sum(axis=0) == pytest.approx([-0.9, 4.5, 0.0], abs=1e-9)


def test_a_sliver_bears_no_force() -> None:
    """Corners in single precision leave slivers, whose force would have no face."""
    thin = [box(1, 1, 1), box(1, 3e-8, 1, (0, 1.0, 0))]
    (load,) = Options((1.0,) * 3, ("0,0,-6",)).wish().setting.loads
    ((of, force, _),) = shares(load, [outside([one], one, [], 1.0)[0] for one in thin])
    assert (of, force.tolist()) == (0, [0, 0, -6])


@pytest.mark.parametrize(("patches", "area"), [([0], 0.04), ([0, 2], 0.08), ([0, 1, 2], 0.12)])
def test_only_faces_in_the_boxes_are_held(patches: list[int], area: float) -> None:
    """Of three legs on one level only those in boxes stand on a support, the middle one between two others too."""
    legs = [box(0.2, 0.2, 1.01, (0.6 * k, 0, 0)) for k in range(3)]
    solid = box(1.4, 0.2, 0.2, (0, 0, 1.0)) + legs[0] + legs[1] + legs[2]
    held_in = tuple(f"{0.6 * k - 0.1},-0.1,-0.1,{0.6 * k + 0.3},0.3,0.1" for k in patches)
    wish = Options((3.0,) * 3, ("body:1,0,0",), support=held_in, cells=2, families=("grid",)).wish()
    assembly = build_assembly(parse_scene(by_grid(solid, wish).document))
    held = assembly.elements.support[assembly.interfaces.a] | assembly.elements.support[assembly.interfaces.b]
    assert assembly.interfaces.area[held].sum() == pytest.approx(area, rel=1e-6)


def _ascii(space: str, end: str, upper: bool) -> bytes:
    lines = ["solid a"]
    for face in mesh_of(box(1, 1, 2)).triangles:
        corners = [space.join(["", "vertex", *map(repr, corner)]) for corner in face.tolist()]
        lines += [f"{space}facet normal{space}0 0 0", f"{space}outer loop", *corners, "endloop", "endfacet"]
    text = end.join([*lines, "endsolid a", ""])
    return (text.upper() if upper else text).encode()


def _twice() -> bytes:
    """A binary file with a triangle that is there again, and one without area."""
    mesh = mesh_of(box(1, 1, 2))
    return meshes.stl_bytes(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:1, [1, 2, 0]], [[0, 0, 1]]]))


@pytest.mark.parametrize(
    "made",
    [
        lambda: _ascii(" ", "\n", False),
        lambda: _ascii("\t  ", "\r\n", True),
        lambda: _ascii("  ", "\n\n \n", False),
        lambda: b"\xef\xbb\xbf" + _ascii(" ", "\r", False),
        _twice,
    ],
)
def test_files_are_read_however_they_are_spelled(tmp_path: Path, made: Any) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(made())
    assert meshes.read_solid(path, 1.0).volume() == pytest.approx(2.0)


_TWO = '<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 1000 0 0"/>'
_BOTH = '<component objectid="1"/><component objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'


@pytest.mark.parametrize(
    ("build", "more", "found"),
    [
        ("", "", [0, 0, 0, 1, 1, 2]),
        (_TWO, "", [0, 0, 0, 2, 1, 2]),
        ('<item objectid="1" transform="0 0 1 0 1 0 -1 0 0 0 0 0"/>', "", [-2, 0, 0, 0, 1, 1]),
        ('<item objectid="9"/>', f'<object id="9"><components>{_BOTH}</components></object>', [-1, 0, 0, 1, 1, 2]),
        ('<item objectid="9"/>', '<object id="9"><components><component objectid="9"/></components></object>', "3MF"),
        ('<item objectid="7"/>', "", "3MF"),
        ('<item objectid="1" transform="1 0 0"/>', "", "3MF"),
        (_TWO.replace("1000", "5000"), "", "2 solids"),
    ],
)
def test_objects_of_a_3mf_file_stand_where_it_builds_them(tmp_path: Path, build: str, more: str, found: Any) -> None:
    path, mesh = tmp_path / "a.3mf", mesh_of(box(1, 1, 2))
    meshes.write_3mf(path, [("a", 1e3 * mesh.vertices, mesh.faces)])
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    start, end = model.index("<build>"), model.index("</build>")
    model = model[:start].replace("</resources>", f"{more}</resources>") + "<build>" + build + model[end:]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    if isinstance(found, str):
        with pytest.raises(InputError, match=found):
            meshes.read_solid(path, 1.0)
    else:
        assert meshes.read_solid(path, 1.0).bounding_box() == pytest.approx(found)


@pytest.mark.parametrize(
    ("states", "unit", "side", "used", "warned"),
    [
        (' unit="inch"', None, 1.2 / 0.0254, "in", ""),
        ("", None, 1200.0, "mm", ""),  # millimetres are the default of the format
        (' unit="millimeter"', "mm", 1200.0, "mm", ""),
        (' unit="millimeter"', "m", 1.2, "m", "the file states mm, the options are read in m: 1 m is 1000 mm of it"),
        (' unit="micron"', None, 1.2e6, "micron", ""),
    ],
)
def test_options_are_read_in_the_unit_that_a_3mf_file_states(
    tmp_path: Path, states: str, unit: str | None, side: float, used: str, warned: str
) -> None:
    path, mesh, said = tmp_path / "pillar.3mf", mesh_of(box(1, 1, 2)), list[str]()
    meshes.write_3mf(path, [("a", mesh.vertices * (side / 1.2 if not warned else 1e3), mesh.faces)])
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode().replace(' unit="millimeter"', states)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    options = Options((side,) * 3, DOWN, unit=unit, families=("grid",), cells=2, seconds=3.0, keys=False)
    found = cut(path, options, tmp_path / "out", warn=said.append)
    assert found["volume"] == pytest.approx(2.0, rel=1e-6)
    assert found["unit"] == used
    assert found["parts"] == 2
    assert found["fits"]
    assert found["largest_box"] == pytest.approx([side / 1.2] * 3, rel=1e-4)
    assert found["warnings"] == [warned] * bool(warned)
    assert said == found["warnings"]


def test_a_solid_whose_unit_is_doubtful_is_named_with_its_mass(tmp_path: Path, jld: Command) -> None:
    """A pillar in mm read in m: parts are made of it all the same, a line on stderr and the summary doubt it."""
    path = written(box(1000.0, 1000.0, 2000.0), tmp_path / "pillar.stl")
    words = ["--load", "0,0,-1000", "--family", "grid", "--cells", "2", "--seconds", "3", "--no-keys"]
    found = jld("cut", path, "--fit", "1200,1200,1200", *words, "-o", tmp_path / "out")
    told = "the solid is 2000 m long and weighs 4.8e+12 kg, with lengths in m; in mm it is 2 m: --unit mm"
    assert found.code == 0
    assert found.err == f"jld: warning: {path}: {told}\n"
    assert "warning" not in found.out
    assert json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["warnings"] == [told]


def test_files_of_a_solid_far_from_the_origin_are_whole(tmp_path: Path) -> None:
    """A pillar at coordinates of a survey: parts are moved to the origin, and said to be; the table says where."""
    mesh, far = mesh_of(box(1, 1, 2)), np.array([3456789.25, 5432100.5, 0.0])
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in (mesh.vertices + far).tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    (tmp_path / "pillar.obj").write_text("\n".join(["o pillar", *rows, ""]))
    options = Options((1.2,) * 3, DOWN, families=("grid",), cells=2, seconds=3.0, keys=False)
    found = cut(tmp_path / "pillar.obj", options, tmp_path / "out")
    assert found["watertight"]
    assert found["file_error"] < 1e-6
    (told,) = found["warnings"]
    assert "3MF files are moved by (-3456789, -5432100, 0) m" in told
    table = pd.read_csv(tmp_path / "out" / "parts.csv")
    assert table["at_x"].tolist() == pytest.approx([far[0]] * 2, rel=1e-9)
    parts = [trimesh.load(tmp_path / "out" / name) for name in table["file"]]
    assert sum(part.volume for part in parts) == pytest.approx(2.0, rel=1e-6)
    assert min(part.bounds[0, 0] for part in parts) == pytest.approx(0.25, abs=1e-6)


def test_nothing_is_printed_beside_an_error_of_a_cut(tmp_path: Path, jld: Command) -> None:
    """A slab whose only support leaves it to fall: one line on stderr, none of what was tried."""
    path = written(box(2.0, 1.0, 0.2), tmp_path / "slab.stl")
    words = ["--support", "0,0,0,0,1,0.2", "--load", "0,0,-1000", "--family", "grid", "--seconds", "3"]
    jld("cut", path, "--fit", "0.6,0.6,0.6", *words, "-o", tmp_path / "out").refused()
    assert not (tmp_path / "out").exists()


def _open(mesh: Any) -> None:
    mesh.faces = mesh.faces[1:]


def _turned(mesh: Any) -> None:
    mesh.faces = np.concatenate([mesh.faces[:1, ::-1], mesh.faces[1:]])


def _crossed(mesh: Any) -> None:
    mesh.vertices = np.where((mesh.vertices == 1.0).all(axis=1)[:, None], [-0.5, -0.5, -1.0], mesh.vertices)


@pytest.mark.parametrize(("spoil", "told"), [(_open, "open"), (_turned, "turn against"), (_crossed, "crosses itself")])
def test_poor_meshes_are_named_with_place_and_remedy(tmp_path: Path, spoil: Any, told: str) -> None:
    mesh = mesh_of(box(1, 1, 1))
    spoil(mesh)
    mesh.apply_scale(1e3)  # the place is in the unit of the file
    mesh.export(tmp_path / "poor.stl")
    with pytest.raises(InputError, match=told + r".*\(.*\d{3}") as error:
        cut(tmp_path / "poor.stl", Options((1.2e3,) * 3, DOWN, unit="mm"), tmp_path / "out")
    for words, there in (("(", True), ("expected", True), ("\n", False)):
        assert (words in str(error.value)) is there


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"fit": (0.0, 1.0, 1.0)}, "fit"),
        ({"fit": (0.05, 0.05, 0.05)}, "such parts, and 60 cells.*another unit"),
        ({"mass": 0.5}, "mass"),
        ({"loads": ()}, "load"),
        ({"loads": ("0,0",)}, "load"),
        ({"loads": ("0,0,-1@5,5,5,6,6,6",)}, "load"),
        ({"loads": ("body:1,0,0@0,0,0,1,1,1",)}, "load"),
        ({"support": ("5,5,5,6,6,6",)}, "support"),
        ({"support": ("1,1,1,0,0,0",)}, "support"),
        ({"families": ("slabs",)}, "^family: slabs is no way to cut"),
        ({"unit": "ell"}, "unit"),
        ({"clearance": 0.3}, "clearance"),
        ({"clearance": -1.0}, "clearance"),
        ({"require": float("nan")}, "require"),
        ({"keep_whole": ("0,0,0",)}, "keep_whole"),
        ({"keep_whole": ("5,5,5,6,6,6",)}, "^keep_whole: nothing of the solid lies in 5,5,5,6,6,6 m"),
        (
            {"keep_whole": ("0,0,0,1,1,2",), "fit": (0.6,) * 3},
            "^keep_whole: in .* lie 0.32 m³ of the solid, and a part",
        ),
    ],
)
def test_bad_options_are_one_line(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    plain: dict[str, Any] = {"fit": (1.2,) * 3, "loads": DOWN, "seconds": 5.0}
    options = Options(**(plain | change))
    with pytest.raises((InputError, ParameterError), match=told) as error:
        cut(written(box(0.4, 0.4, 2.0), tmp_path / "a.stl"), options, tmp_path / "out")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


# All layouts of parts that fit: numbers, boxes turned in space, parity with the exact driver, marks and tenons.


def chain(count: int) -> list[int]:
    return [sum(1 << j for j in (k - 1, k + 1) if 0 <= j < count) for k in range(count)]


def sets_of(cells: list[Any], around: list[int], fit: tuple[float, float, float], together: list[int]) -> list[int]:
    moments = np.array([meshes.moments(one) for one in cells])
    boxes = partitions.Boxes.of([mesh_of(one).vertices for one in cells], moments, partitions.frames(np.eye(3)))
    limits = of_cells.Limits(np.sort(np.array(fit)), np.inf)
    return list(partitions.connected_sets(boxes, around, limits, together, time.time() + 60))


@pytest.mark.parametrize(
    ("fit", "together", "most", "number"),
    [
        # a row of eight cells: cuts at k − 1 of 7 places
        ((9.0, 1.0, 1.0), [], 9, [comb(7, k - 1) for k in range(1, 5)]),
        ((1.0, 2.0, 1.0), [], 2, [0, 0, 0, 1, 10]),  # pairs and singles
        ((1.0, 2.0, 1.0), [0b110], 2, [0, 0, 0, 0, 6]),  # 1 and 2 stay together: one, a pair, then five in three parts
        ((1.0, 0.9, 1.0), [], 0, [0, 0]),
    ],
)
def test_all_layouts_of_a_row_of_cells(
    fit: tuple[float, float, float], together: list[int], most: int, number: list[int]
) -> None:
    cells = [box(1, 1, 1, (k, 0, 0)) for k in range(8)]
    sets = sets_of(cells, chain(8), fit, together)
    assert max((one.bit_count() for one in sets), default=0) == min(most, 8)
    for parts, expected in enumerate(number, 1):
        solver = _Listing()
        found = partitions.strongest(partitions.Partitions(sets, 8), parts, solver, 5.0, goal_of(60.0), 10_000)
        rows = {tuple(row) for row in solver.rows}
        assert len(rows) == len(solver.rows) == found.solved
        assert found.complete
        assert found.high == (5.0 if rows else -np.inf)
        if together and parts == 5:
            assert rows
            assert all(row[1] == row[2] for row in rows)
        else:
            assert len(rows) == expected


class _Listing:
    """No bounds: each layout is listed, none refuted."""

    def __init__(self) -> None:
        self.rows: list[list[int]] = []

    def __call__(self, blocks: Any) -> Any:
        self.rows += blocks.tolist()
        return np.ones(len(blocks)), np.full(len(blocks), 9.0), np.zeros(len(blocks), dtype=bool)

    def relaxed(self, blocks: Any, free: Any, *, thorough: bool = False) -> Any:
        return np.full(len(blocks), np.inf)


def goal_of(seconds: float, require: float = 1.0, most: int = 3, alike: int | None = None) -> partitions.SearchGoal:
    return partitions.SearchGoal(require, most, time.time() + seconds, time.time() + seconds, alike)


@pytest.mark.parametrize(("turn", "fits"), [(0.0, True), (30.0, True), (45.0, True), (82.5, True)])
def test_a_turned_bar_fits_a_box_of_three_sides(turn: float, fits: bool) -> None:
    bar = box(2.0, 0.5, 0.2).rotate((0, 0, turn)).rotate((90, 0, 0))
    assert bool(sets_of([bar], [0], (0.21, 2.01, 0.51), [])) is fits
    assert not sets_of([bar], [0], (0.21, 1.9, 0.51), [])
    # along the diagonal of a cube
    rod = box(1.6, 0.02, 0.02).rotate((0, -float(np.degrees(np.arcsin(3**-0.5))), 45))
    assert sets_of([rod], [0], (1.0, 1.0, 1.0), [])


def test_all_layouts_prove_what_the_exact_driver_proves(tmp_path: Path) -> None:
    load = ("0,0,-1000@0.6,-1,0.49,1.2,1,0.51",)
    wish = Options((0.95, 0.95, 0.95), load, cells=9, families=("grid",)).wish()
    family = by_grid(bench(), wish)
    found = searched(family, wish)
    fewest = next(n for n, one in sorted(found.of.items()) if len(one.low))
    limits = {"block_extent": [None, 0.95], "blocks": [None, fewest]}
    document = family.document | {"search": limits}
    proven = explore(document, tmp_path / "exact", ExploreSettings(check_fields=0, pictures=False, driver="exact"))
    assert found.proven(fewest)
    assert proven.summary.proven
    assert found.of[fewest].low[0] == pytest.approx(proven.summary.best, rel=1e-5)
    assert found.bound(fewest) == pytest.approx(proven.summary.best, rel=1e-5)
    # two shapes at most: the layouts of the symmetric bench are among all
    alike = searched(family, wish, most=4, alike=1)
    assert all(one.solved <= found.of[n].solved for n, one in alike.of.items() if n in found.of)
    for one in alike.of.values():
        for block in one.blocks:
            wholes = [sum(family.boxes().moments[block == name]) for name in set(block.tolist())]
            assert len({round(float(whole[0]), 9) for whole in wholes}) == 1


class _Unpruned(partitions.Bounds):
    """Bounds of layouts that refute no branch: all layouts are solved."""

    def relaxed(self, blocks: Any, free: Any, *, thorough: bool = False) -> Any:
        return np.full(len(blocks), np.inf)


@pytest.mark.parametrize(
    ("cells", "fit", "parts", "solved", "above"),
    [(12, 0.95, 3, 110, False), pytest.param(12, 0.95, 4, 2625, False, marks=pytest.mark.long), (20, 1.3, 2, 30, True)],
)
def test_bounds_of_branches_hold_for_all_layouts(cells: int, fit: float, parts: int, solved: int, above: bool) -> None:
    """No layout exceeds what is stated, however soon a search ends, where parts carry more than the uncut solid too."""
    load = "0,0,-1000@0.6,-1,0.49,1.2,1,0.51"
    wish = Options((fit,) * 3, (load,), cells=cells, families=("grid",)).wish()
    family = by_grid(bench(), wish)
    count = len(family.around)
    sets = partitions.connected_sets(family.boxes(), family.around, wish.limits, [], time.time() + 60)
    solver, everything = partitions.Bounds(family.document), np.ones((1, count), dtype=bool)
    whole = float(solver.relaxed(np.zeros((1, count), dtype=np.int64), everything)[0])
    ways = partitions.Partitions(sets, count)
    known = partitions.strongest(ways, parts, _Unpruned(family.document), np.inf, goal_of(60.0), 10**6)
    assert known.complete
    assert known.solved == solved
    assert known.low[0] <= whole * (1 + 1e-6)
    assert bool(known.low[0] > solver(np.zeros((1, count), dtype=np.int64))[1][0]) is above
    for number in (1, 20, 100, 10**6):
        found = partitions.strongest(ways, parts, solver, whole, goal_of(60.0), number)
        assert known.low[0] * (1 - 1e-6) <= found.high <= whole * (1 + 1e-6)
        assert not found.complete or found.low[0] == pytest.approx(known.low[0], rel=1e-5)
    assert found.complete
    assert found.low[:5] == pytest.approx(known.low[:5], rel=1e-5)


@pytest.mark.parametrize(("solid", "fit", "parts"), [(box(1, 1, 1), 2.0, 1), (box(2, 1, 1), 1.2, 2)])
def test_a_box_that_holds_many_cells_has_a_layout(solid: Any, fit: float, parts: int) -> None:
    """Where too many sets of cells fit to be listed, cells are joined, and nothing is proven."""
    wish = Options((fit,) * 3, DOWN, cells=27, families=("grid",)).wish()
    family = by_grid(solid, wish)
    found = searched(family, wish)
    assert found.joined
    assert min(n for n, one in found.of.items() if len(one.low)) == parts
    assert not found.proven(parts)
    assert found.kind(parts) == "joints"
    assert found.bound(parts) == found.whole >= found.of[parts].low[0]


@pytest.mark.parametrize("together", [[], [0b11]])
def test_a_search_without_time_has_a_layout(together: list[int]) -> None:
    """Cells joined pair by pair while they fit; parts that may not be parted are not."""
    wish = Options((1.1,) * 3, DOWN, cells=12, families=("grid",)).wish()
    family = by_grid(box(2, 1, 1), wish)
    boxes, count = family.boxes(), len(family.around)
    found = searched(family, wish, together, seconds=-1.0, most=24)
    stands = {n: one for n, one in found.of.items() if len(one.low)}
    assert 2 <= min(stands) <= 4
    for number, one in stands.items():
        (block,) = one.blocks
        parts = [[k for k in range(count) if block[k] == name] for name in range(number)]
        wholes = boxes.grouped([sum(1 << k for k in own) for own in parts])
        assert boxes.fit(wholes.low, wholes.high, wish.limits).all()
        assert not together or block[0] == block[1]
    assert not found.proven(2)
    assert found.kind(2) == "joints"


@pytest.mark.parametrize("seconds", [0.1, 4.0])
def test_a_cut_always_reaches_its_verdict(tmp_path: Path, seconds: float) -> None:
    hollow = box(2, 1, 1) - box(1.6, 0.6, 0.6, (0.2, 0.2, 0.2))
    options = Options((1.1,) * 3, DOWN, seconds=seconds, clearance=0.002)
    found = cut(written(hollow, tmp_path / "hollow.stl"), options, tmp_path / "out")
    assert found == json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert found["verdict"].startswith(f"{found['parts']} parts carry ")
    assert found["fits"]
    assert "report.html" in found["left_out"]  # which needs more
    assert "keys" in found["left_out"] or seconds > 1.0
    assert len(list((tmp_path / "out" / "parts").glob("*.stl"))) == found["parts"]


@pytest.mark.parametrize("number", [3, 12])
def test_a_number_is_engraved_in_a_closed_part(number: int) -> None:
    whole = box(0.3, 0.4, 0.5)
    part = of_parts.Part(number, [0], whole, whole, 1.0)
    assert of_parts.mark(part, 1.0)
    taken = 1.0 - part.solid.volume() / whole.volume()
    assert 1e-4 < taken < 0.02
    assert is_closed(part.solid)


def test_a_tenon_fits_its_mortise_and_the_box() -> None:
    low, high = box(1, 1, 1), box(1, 1, 1, (0, 0, 1))
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
    joint = of_cells.Joint(0, 1, square, np.array([0, 0, 1.0]), 1.0)
    for fit, clearance, number in ((1.0, 0.004, 0), (1.5, 0.004, 1), (1.5, 0.0, 1)):
        below = of_parts.Part(1, [0], low, low, 1.0, step=1)
        above = of_parts.Part(2, [1], high, high, 1.0, step=2, direction=np.array([0, 0, -1.0]))
        made = of_parts.tenons([below, above], np.array([0, 1]), [joint], clearance, np.full(3, fit), 1.0)
        assert made == number
        if not made:
            continue
        assert above.solid.volume() == pytest.approx(1.0 + 0.2**3, rel=1e-6)
        assert below.solid.volume() == pytest.approx(1.0 - (0.2 + clearance) ** 2 * (0.2 + clearance), rel=1e-6)
        for height in (0.0, 0.1, 0.3):
            assert (above.solid.translate((0, 0, height)) ^ below.solid).volume() < 1e-12
        assert above.box.max() == pytest.approx(1.2)


def test_parts_alike_are_counted_once() -> None:
    corner = box(1, 1, 1) + box(2, 1, 0.5)
    bodies = [corner, corner.rotate((0, 0, 90)).translate((5, 0, 0)), corner.mirror((1, 0, 0)), box(1, 1, 2)]
    assert of_parts.different([of_parts.Part(k, [k], one, one, 1.0) for k, one in enumerate(bodies, 1)]) == 2


def test_cells_keep_closed_cavities() -> None:
    hollow = box(3, 1, 1) - box(0.4, 0.4, 0.4, (0.3, 0.3, 0.3))
    assert [one.volume() for one in meshes.pieces_of(hollow)] == [pytest.approx(3.0 - 0.4**3)]
    cutting = divided(hollow, ([1.0, 0, 0], 2.0))
    assert sum(one.volume() for one in cutting.cells) == pytest.approx(3.0 - 0.4**3, rel=1e-12)


def _of(*bodies: Any) -> Any:
    return trimesh.util.concatenate([mesh_of(one) for one in bodies])


def _inwards(solid: Any) -> Any:
    mesh = mesh_of(solid)
    mesh.invert()
    return mesh


def _inside_out(mesh: Any) -> Any:
    mesh.invert()
    return mesh


def _hollow(inside: Any) -> Any:
    """A box with a cavity, and a body within that."""
    return trimesh.util.concatenate([_of(box(2, 2, 2)), _inwards(box(1, 1, 1, (0.5, 0.5, 0.5))), mesh_of(inside)])


@pytest.mark.parametrize("kind", ["stl", "obj"])
@pytest.mark.parametrize(
    ("made", "volume"),
    [
        (lambda: trimesh.creation.torus(2.0, 0.5), 9.7434),
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (1, 0, 0))), 2.0),  # they touch
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (0.5, 0.2, 0.1))), 2.0 - 0.5 * 0.8 * 0.9),  # they overlap
        (lambda: trimesh.util.concatenate([_of(box(2, 2, 2)), _inwards(box(1, 1, 1, (0.5, 0.5, 0.5)))]), 7.0),
        (lambda: _of(bench()), 1.8 * 0.4 * 0.1 + 2 * 0.2 * 0.4 * 0.4),
        (lambda: _inwards(bench()), 1.8 * 0.4 * 0.1 + 2 * 0.2 * 0.4 * 0.4),  # turned inwards as a whole, the same
        (lambda: _inside_out(_hollow(box(0.2, 0.2, 1, (0.9, 0.9, 0.5)))), 7.04),  # that of a cavity as well
        (lambda: _inside_out(_of(box(1, 1, 1), box(1, 1, 1, (1, 0, 0)))), 2.0),
        (lambda: _of(box(2, 2, 2), box(1, 1, 1, (0.5, 0.5, 0.5))), 8.0),  # one within the other, both outwards
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (3, 0, 0))), None),
        (lambda: _hollow(box(0.2, 0.2, 1, (0.9, 0.9, 0.5))), 7.04),  # a pillar across the cavity
        (lambda: _hollow(box(0.2, 0.2, 0.5, (0.9, 0.9, 0.7))), None),  # a body loose in the cavity
    ],
)
def test_meshes_of_other_makes(tmp_path: Path, kind: str, made: Any, volume: float | None) -> None:
    path = tmp_path / f"a.{kind}"
    made().export(path)
    if volume is None:
        with pytest.raises(InputError, match="2 solids that share no face"):
            meshes.read_solid(path, 1.0)
        return
    assert meshes.read_solid(path, 1.0).volume() == pytest.approx(volume, rel=1e-4)
    assert meshes.read_solid(path, 1e-3).volume() == pytest.approx(1e-9 * volume, rel=1e-4)


TOLD = {"parts": 3, "bracket": [2.0, 2.0], "locked": False, "uncut": [1.5, 1.5], "require": 1.0, "meets": True}
TOLD |= {"too_large": [], "can_be_laid": True, "coarse_truth": "", "faulty_files": [], "proven": True}


@pytest.mark.parametrize(
    ("change", "said", "unsaid"),
    [
        ({}, ["no fewer parts", "opens over its whole depth"], "crushing"),
        (
            {"meets": False, "require": 4.0, "load_factor_of_cells": 2.0, "bound": 3.0},
            ["; no layout of as many parts or fewer exceeds 3 on these cells, whether", "; 4 was asked"],
            "no fewer parts",
        ),
        ({"only_crushing": True}, ["only crushing limits it"], "watertight"),
        ({"load_factor_of_cells": 2.0, "bound": 3.0}, ["no layout of as many exceeds 3 on them"], "watertight"),
        (
            {"proven": False, "uncut": [2.0, 2.0]},
            ["carry at least 2 times", "nothing bounds λ of other"],
            "no fewer parts",
        ),
        (
            {"proven": False, "bound": 7.0, "bound_by": "branches"},
            ["not proven: no layout of as many parts of these cells exceeds 7 (a bound on all that were not"],
            "whole)",
        ),
        (
            {"proven": False, "bound": 7.0, "bound_by": "joints"},
            ["exceeds 7 (a bound with each joint open or"],
            "fewer",
        ),
        ({"faulty_files": ["part 3 has 1 edges"], "too_large": [2]}, ["not watertight: part 3", "fit the box: 2"], "λ"),
        (
            {"keys": [{"told": f"tongue of part {k} into 1"} for k in (2, 3, 4, 5)], "load_factor_without_keys": 1.2},
            ["part 3 into 1, tongue of part 4 into 1 and 1 more; 1.2 without)", "; with plane joints, no fewer parts"],
            "part 5",
        ),
        ({"coarse_truth": "no face"}, ["λ of the cells of the search"], "fit the box"),
        ({"by_fields": [1.7, 1.9]}, ["at least 1.7 and at most 1.9 times your load"], "at least 2"),
        ({"by_fields": [None, 1.9]}, ["carry at most 1.9 times", "(2 with cracks between cells, "], "at least"),
        ({"by_fields": [None, 1.9]}, ["uncut 1.5"], "opens over"),
        ({"by_fields": [None, 2.5]}, ["uncut 1.5 (a dry joint opens over its whole depth"], "few faces"),
        ({"by_fields": [1.7, 2.5]}, ["at least 1.7 times your load with cracks anywhere"], "at least 2"),
        (
            {"by_fields": [None, 2.5]},
            ["at least 2 times your load with cracks between cells, and at most 2.5"],
            "few faces",
        ),
        ({"by_fields": [None, 9.0], "bracket": [5.0, None], "locked": True}, ["carry at most 9"], "carry any"),
    ],
)
def test_the_verdict_says_what_limits_and_what_is_proven(change: Any, said: list[str], unsaid: str) -> None:
    words = verdict(TOLD | change)
    assert all(one in words for one in said)
    assert unsaid not in words


@pytest.mark.parametrize(
    ("low", "fields", "meets"),
    [
        (2.0, None, True),
        (0.5, None, False),
        (2.0, [None, 0.9], False),  # refuted by the model that knows more
        (2.0, [0.5, 1.5], True),
        (0.5, [1.2, 1.5], True),
        (None, [None, 3.0], False),
    ],
)
def test_fields_decide_whether_parts_carry(low: float | None, fields: Any, meets: bool) -> None:
    assert carries(TOLD | {"bracket": [low, None], "by_fields": fields}) is meets


def test_a_part_within_another_is_named() -> None:
    """A core within a shell of one part has no way out; a shell of two parts lets it in."""
    wish = Options((1.0, 1.0, 1.0), ("0,0,-1000",), cells=27, families=("grid",)).wish()
    family = by_grid(box(3, 3, 3), wish)
    middles = np.array([np.array(one.bounding_box()).reshape(2, 3).mean(axis=0) for one in family.cutting.cells])
    core = np.abs(middles - 1.5).max(axis=1) < 0.1
    truth = of_search.FineModel(family, wish.setting)
    assert truth.order(core.astype(np.int64), 60.0) is False
    assert int(np.flatnonzero(core)[0]) in truth.locking(core.astype(np.int64), 60.0)
    assert len(truth.order(np.where(core, 1, np.where(middles[:, 2] > 2.0, 2, 0)), 60.0).steps) == 3


def test_layouts_that_go_together_come_first() -> None:
    """Those with an order are judged first, then those that are not known to lock; a locked one only if all are."""

    class Orders:
        def __init__(self, known: dict[int, Any]) -> None:
            self.known = known

        def order(self, block: Any, seconds: float) -> Any:
            assert seconds > 0.0
            return self.known[int(block[0])]

    rows = partitions.Layouts(True, 4, 0, np.arange(4)[:, None], np.array([9.0, 8.0, 7.0, 6.0]), 9.0)
    for known, expected in (
        ({0: None, 1: "steps", 2: False, 3: "steps"}, [1, 3, 0]),
        ({0: False, 1: False, 2: None, 3: False}, [2]),
        (dict.fromkeys(range(4), False), [0]),
    ):
        family = SimpleNamespace(fine=Orders(known))
        found = list(sys.modules["jld_cut.cut"]._to_judge(family, rows, time.time() + 60.0))
        assert [int(block[0]) for block, _ in found] == expected


def test_a_part_with_a_hook_slides_out() -> None:
    """A rail of T section within two other parts, one on each side, leaves along itself although its hull would not."""
    solid = box(3, 3, 2)
    wish = Options((3.0,) * 3, ("0,0,-1000",), cells=8, families=("grid",)).wish()
    cutting = of_cells.Cutting(solid, [(box(1, 3, 1, (1, 0, 0)) + box(2, 3, 0.5, (0.5, 0, 1)))])
    cutting.cells.append(solid - cutting.cells[0])
    cutting.planes = [np.array(p) for p in ((1.0, 0, 0, 1), (1, 0, 0, 2), (0, 0, 1, 1), (1, 0, 0, 0.5), (1, 0, 0, 2.5))]
    cutting.planes.append(np.array([0, 0, 1, 1.5]))
    found = cutting.tidy(wish.limits)
    document = scene_of("rail", cutting, found, wish.setting, of_cells.BENT, cutting.planes)
    truth = of_search.FineModel(of_search.Family("grid", cutting, found, document, []), wish.setting)
    assert truth.convex
    steps = truth.order(np.array([0, 1]), 60.0).steps
    assert abs(steps[-1].direction @ [0, 1, 0]) == pytest.approx(1.0)


def test_parts_are_a_few_convex_pieces_for_fields() -> None:
    """An L of two parts is three pieces that hold its volume, joined along one bisector; a bowl is none of a few."""
    solid = box(3, 1, 1) + box(1, 1, 3)
    wish = Options((3.0,) * 3, ("0,0,-1000",)).wish()
    cutting = divided(solid, ([1.0, 0, 0], 2.0))
    assembly = build_assembly(parse_scene(scene_of_parts("L", cutting, cutting.cells, wish.setting)))
    free = assembly.elements.free
    assert len(free) == 3
    assert assembly.elements.volume[free].sum() == pytest.approx(5.0, rel=1e-9)
    assert sorted(assembly.interfaces.area.round(9).tolist())[:2] == [1.0, 1.0]
    with pytest.raises(InputError, match="convex pieces"):
        scene_of_parts("bowl", of_cells.Cutting(_bowl()), [_bowl()], wish.setting)


def test_fields_have_as_few_pieces_as_fill_a_part() -> None:
    """A part of cells cut obliquely is joined again, and steps are split along their faces, not along bisectors."""
    outline = [(0, 0), (0.5, 0), (0.5, 1.0), (0.7, 1.0), (0.7, 1.3), (0.95, 1.3), (0.95, 1.6), (0, 1.6)]
    corbel = CrossSection([np.array(outline)]).extrude(0.5).rotate((90, 0, 0)).translate((0, 0.5, 0))
    numbers = []
    for few in (False, True):
        pieces, _, _, convex = of_cells.convex_parts([corbel, box(1, 1, 1, (5, 0, 0))], 50, few=few)
        assert convex
        assert sum(piece.volume() for piece in pieces) == pytest.approx(corbel.volume() + 1.0, rel=1e-9)
        numbers.append(len(pieces))
    assert numbers[1] == 4 <= numbers[0]
    cutting = divided(corbel, ([0.6, 0, 0.8], 1.3))
    wish = Options((3.0,) * 3, ("0,0,-1000",)).wish()
    found = scene_of_parts("corbel", cutting, [of_cells.union(cutting.cells)], wish.setting)
    assert [one.get("block") for one in found["elements"]] == ["part 1"] * 3 + [None]
    assembly = build_assembly(parse_scene(found))
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(corbel.volume(), rel=1e-6)


def test_joints_for_fields_have_all_corners() -> None:
    """Two drums of sixteen sides meet in all of their section; the search has eight corners of it, 9 % less."""
    drums = Manifold.cylinder(2.0, 0.5, 0.5, 16)
    cutting = divided(drums, ([0.0, 0, 1], 1.0))
    wish = Options((3.0,) * 3, ("0,0,-1000",)).wish()
    found = build_assembly(parse_scene(scene_of_parts("drums", cutting, cutting.cells, wish.setting)))
    section = 8 * 0.25 * np.sin(np.pi / 8)
    assert found.interfaces.area.max() == pytest.approx(section, rel=1e-6)
    (joint,) = joints(cutting)
    assert joint.area == pytest.approx(4 * 0.25 * np.sin(np.pi / 4), rel=1e-6)


def test_a_plane_along_a_face_leaves_no_sheet() -> None:
    """Where rounding puts a plane below the top of a bump, the sheet stays with the bump, and no volume is lost."""
    solid = box(3, 1, 0.5) + box(1, 1, 2) + box(1, 1, 1, (2, 0, 0))
    cutting = divided(solid, ([0.0, 0, 1], 1.0 - 5e-9))
    assert len(cutting.cells) == 2
    assert sum(cell.volume() for cell in cutting.cells) == pytest.approx(solid.volume(), rel=1e-14)


def test_a_joint_in_planes_that_differ_by_rounding_is_one() -> None:
    """A narrow joint lies in any plane that turns a little about it."""
    cells = [box(1, 1e-3, 1), box(1, 1e-3, 1, (0, 0, 1))]
    turned = np.array([0.0, 4e-6, 1.0])
    planes = [np.array([0.0, 0, 1, 1]), np.array([*turned, turned @ [0.5, 5e-4, 1.0]])]
    (joint,) = of_cells.joints_of(cells, planes, 2.0)
    assert joint.area == pytest.approx(1e-3)
    # joints above each other are two, as those of a tongue
    tongue = box(2, 1, 1, (1, 0, 1))
    planes = [np.array([0.0, 0, 1, 1]), np.array([0.0, 0, 1, 2]), np.array([1.0, 0, 0, 1])]
    found = of_cells.joints_of([box(3, 1, 3) - tongue, tongue], planes, 3.0)
    assert [joint.area for joint in found] == pytest.approx([2, 2, 1])


def test_a_splinter_joins_a_piece_of_its_cell() -> None:
    """Joints of a splinter are too small to carry, so it would hang in the air."""
    pieces = [box(1, 1, 1), box(1, 1, 1, (0, 0, 1)), box(0.02, 0.02, 0.02, (1, 0, 0.5)), box(1, 1, 1, (1.02, 0, 0))]
    planes = [np.array([0.0, 0, 1, 1]), np.array([1.0, 0, 0, 1]), np.array([1.0, 0, 0, 1.02])]
    kept = of_cells.without_splinters(pieces, np.array([0, 0, 0, 1]), of_cells.joints_of(pieces, planes, 2.0))
    assert kept is not None
    assert [piece.volume() for piece in kept[0]] == pytest.approx([1.000008, 1.0, 1.0])
    assert kept[1].tolist() == [0, 0, 1]
    assert of_cells.without_splinters(kept[0], kept[1], of_cells.joints_of(kept[0], planes, 2.0)) is None


def test_no_joint_of_the_pieces_for_fields_is_lost(tmp_path: Path) -> None:
    """Corners in single precision lie beside the planes of joints that pieces joined again would share."""
    path = tmp_path / "bench.stl"
    path.write_bytes(meshes.stl_bytes(*meshes.surface_of(bench())))
    solid = meshes.read_solid(path, 1.0)
    cutting = divided(solid, ([1.0, 0, 0], 0.9))
    wish = Options((3.0,) * 3, ("0,0,-1000",)).wish()
    assembly = build_assembly(parse_scene(scene_of_parts("bench", cutting, cutting.cells, wish.setting)))
    pieces = len(assembly.elements.free)
    between = (assembly.interfaces.a < pieces) & (assembly.interfaces.b < pieces)
    skin = sum(ConvexHull(assembly.elements.shape[k]).area for k in assembly.elements.free)
    assert pieces >= 5
    assert 2 * assembly.interfaces.area[between].sum() == pytest.approx(skin - solid.surface_area(), rel=1e-4)


@pytest.mark.parametrize(
    ("shear", "kind", "expected"),
    [
        # a cube on a cube, pushed at its middle: with a key both tip about the ground, W/2 · 2 = F · 3/2
        (2e6, "tongue", lambda w: 2 * w / 3),
        # or the key is sheared off over its root: F = W tan φ + cohesion × area
        (6e3, "tongue", lambda w: w * np.tan(np.radians(20.0)) + 6e3 / 3),
        (6e3, "step", lambda w: w * np.tan(np.radians(20.0)) + 6e3 / 2),
        (6e3, "key", lambda w: w * np.tan(np.radians(20.0)) + 6e3 / 9),
    ],
)
def test_a_key_turns_sliding_into_shear_or_tipping(shear: float, kind: str, expected: Any) -> None:
    weight = 2400 * 9.81
    push = ("1000,0,0@-0.1,0,1,0.1,1,2",)
    options = Options((1.25,) * 3, push, require=0.1, families=("grid",), cells=2, clearance=0.002)
    matter = replace(options.matter, friction_angle=20.0, tensile=min(2e6, 16e3 * shear / 6e3), shear=shear)
    options = replace(options, matter=matter)
    wish, pillar = options.wish(), box(1, 1, 2)
    family = by_grid(pillar, wish)
    family.fine = of_search.FineModel(family, wish.setting)
    block = np.array([float(cell.bounding_box()[5]) > 1.5 for cell in family.cutting.cells]).astype(np.int64)
    plain = family.fine.solve(block)[0]
    assert plain == pytest.approx(weight * np.tan(np.radians(20.0)) / 1e3, rel=1e-5)
    found = of_keys.slides(family, block, np.tan(np.radians(20.0)))
    assert len(found) == 1
    assert found[0].along / np.linalg.norm(found[0].along) == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    made = next(one for one in of_keys.variants(family, block, found, wish.setting, 0.0) if one.keys[0].kind == kind)
    assert made.keys[0].told() == f"{kind} of part 1 into 2"
    assert made.bracket[0] == pytest.approx(expected(weight) / 1e3, rel=1e-5)
    assert len(made.family.fine.order(made.block, 60.0).steps) == 2
    parts = of_parts.parts_of(made.family.cutting.cells, made.block, made.family.joints, 2400.0, 0.002)
    assert of_keys.are_sound(parts, 1.0)
    assert all(of_parts.lay(part, wish.limits.fit) for part in parts)
    assert sum(part.exact.volume() for part in parts) == pytest.approx(2.0, rel=1e-12)
    assert parts[0].exact.volume() > 1.0 > parts[1].exact.volume()
    # both with the gap of the joint, so that the upper one comes off
    for height in (0.0, 0.05, 0.5):
        assert (parts[1].solid.translate((0, 0, height)) ^ parts[0].solid).volume() < 1e-12


def test_no_key_where_nothing_slides_or_none_is_sound() -> None:
    options = Options((1.25,) * 3, ("1000,0,0@-0.1,0,1,0.1,1,2",), families=("grid",), cells=2)
    options = replace(options, matter=replace(options.matter, friction_angle=20.0))
    for wide, sound, number in ((1.0, False, 0), (0.2, True, 0)):  # a slender one tips without a key
        wish, pillar = options.wish(), box(wide, 1, 2)
        family = by_grid(pillar, wish)
        family.fine = of_search.FineModel(family, wish.setting)
        block = np.array([float(cell.bounding_box()[5]) > 1.5 for cell in family.cutting.cells]).astype(np.int64)
        low = family.fine.solve(block)[0]
        made = of_keys.keyed(family, block, low, wish.setting, lambda _, sound=sound: sound)
        assert (0 if made is None else len(made.keys)) == number


@pytest.mark.long
def test_a_cut_names_its_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        sys.modules["jld_cut.cut"], "_start_field_bounds", lambda *_: None
    )  # they take what time there is
    push = ("1000,0,0@-0.1,0,1,0.1,1,2",)
    options = Options((1.25,) * 3, push, require=0.1, families=("grid",), cells=2, seconds=300.0, clearance=0.002)
    options = replace(options, matter=replace(options.matter, friction_angle=20.0))
    found = cut(written(box(1, 1, 2), tmp_path / "pillar.stl"), options, tmp_path / "out")
    (key,) = found["keys"]
    assert (key["kind"], {key["on"], key["into"]}) == ("tongue", {1, 2})
    assert found["load_factor"] == pytest.approx(15.696, rel=1e-4)
    assert found["load_factor_without_keys"] == pytest.approx(8.5693, rel=1e-4)
    assert f"with keys where parts slid ({key['told']}; 8.57 without)" in found["verdict"]
    table = pd.read_csv(tmp_path / "out" / "parts.csv").set_index("part")
    assert table["keys"].dropna().to_dict() == {key["on"]: f"tongue into {key['into']}"}
    assert found["watertight"]
    assert found["can_be_laid"]
    assert not found["left_out"]


def test_regions_stay_whole() -> None:
    wish = Options((1.2,) * 3, ("0,0,-1000",), cells=6, families=("grid",), keep_whole=("0,0,0.5,0.4,0.4,1.5",)).wish()
    pillar = box(0.4, 0.4, 2.0)
    family = by_grid(pillar, wish)
    assert family.together
    free = replace(wish, whole=())
    assert not by_grid(pillar, free).together
