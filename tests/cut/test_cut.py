"""Cutting solids: exact cells and joints, closed forms of λ, files that are read again, bad input."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import trimesh
from manifold3d import Manifold, OpType

from jld_core import InputError, ParameterError
from jld_cut import Options, cut
from jld_cut.cells import Cutting, Limits, concave_edges, convex_parts, joints_of, union
from jld_cut.cut import verdict
from jld_cut.elastic import compressed
from jld_cut.families import axis_of
from jld_cut.loads import outside, parse_load, shares
from jld_cut.meshes import (
    as_read,
    as_written,
    doubled_edges,
    open_edges,
    read_solid,
    solid_of,
    stl_bytes,
    surface_of,
    volume_of,
    write_3mf,
)
from jld_cut.parts import Part, lay, plain_surface, write_parts
from jld_cut.scene import Matter

DOWN = ("0,0,-1000",)


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0, 0, 0)) -> Any:
    return Manifold.cube((x, y, z)).translate(at)


def bench() -> Any:
    return box(1.8, 0.4, 0.1, (0, 0, 0.4)) + box(0.2, 0.4, 0.41, (0.1, 0, 0)) + box(0.2, 0.4, 0.41, (1.5, 0, 0))


def written(solid: Any, path: Path) -> Path:
    path.write_bytes(stl_bytes(*surface_of(solid)))
    return path


@pytest.mark.parametrize(("load", "angle", "factor"), [("body:1,0,0", 35.0, 0.5), ("body:0.6,0.8,0", 45.0, 0.625)])
def test_a_pillar_in_two_parts_tips_as_in_closed_form(tmp_path: Path, load: str, angle: float, factor: float) -> None:
    """A pillar 1 × 1 × 2 tilts at half its width over half its height, whatever cuts it level.

    With less friction a base of two faces carries less of an oblique load: each face's friction also bears torsion.
    """
    options = Options((1.2,) * 3, (load,), require=0.1, families=("grid",), cells=4, seconds=3.0)
    options = replace(options, matter=Matter(friction_angle=angle, tensile=1e6))
    found = cut(written(box(1.0, 1.0, 2.0), tmp_path / "pillar.stl"), options, tmp_path / "out")
    assert found["parts"] == 2
    assert found["fits"]
    assert found["can_be_laid"]
    assert found["load_factor"] == pytest.approx(factor, rel=1e-4)


def _round_table() -> Any:
    legs = [Manifold.cylinder(0.71, 0.09, 0.07, 16).translate((x, y, 0)) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    return Manifold.batch_boolean([Manifold.cylinder(0.08, 0.7, 0.7, 24).translate((0, 0, 0.7)), *legs], OpType.Add)


def _bowl() -> Any:
    return (Manifold.sphere(1.6, 24) - Manifold.sphere(1.4, 24)) ^ box(4, 4, 2, (-2, -2, 0))


@pytest.mark.parametrize("made", [bench, _round_table, _bowl])
def test_a_part_of_cells_of_different_cuts_is_closed(made: Any) -> None:
    """Cells whose cuts meet within rounding become one body without walls of no thickness, with their volume."""
    cutting = Cutting(made())
    turn = np.array([np.sin(0.3), np.cos(0.3) * 0.6, np.cos(0.3) * 0.8])
    for normal, at in ((np.array([1.0, 0, 0]), 0.13), (turn, 0.41), (np.array([0.8, -0.6, 0.0]), 0.07)):
        cutting.through(normal, at)
    cutting.through(np.array([0, 0, 1.0]), 0.43, range(0, len(cutting.cells), 2))
    order = range(len(cutting.cells))
    beside = {(joint.a, joint.b) for joint in joints_of(cutting.cells, cutting.planes, cutting.size)}
    chosen = [0]
    for _ in range(len(order) // 2):
        near = [k for k in order if k not in chosen and any((k, c) in beside or (c, k) in beside for c in chosen)]
        chosen += near[:1]
        body = union([cutting.cells[k] for k in chosen])
        assert body.volume() == pytest.approx(sum(cutting.cells[k].volume() for k in chosen), rel=1e-9)
        assert doubled_edges(*as_read(stl_bytes(*as_written(body, 1.0)))) == 0
    # as for a STEP file, with plane faces: the same volume, and two faces at each edge
    surface = plain_surface(body)
    fans = np.array([(face[0], *pair) for face in surface.faces for pair in pairwise(face[1:])])
    assert volume_of(surface.points, fans) == pytest.approx(body.volume(), rel=1e-6)
    assert len(open_edges(fans)) == 0
    everything = union(cutting.cells)
    assert doubled_edges(*as_written(everything, 1.0)) == 0
    assert everything.volume() == pytest.approx(made().volume(), rel=1e-9)


def test_a_part_fits_a_box_along_the_axes() -> None:
    """A square plate whose smallest rectangle is not along the axes: the box along them is tried as well."""
    corner = (Manifold.cylinder(0.2, 2.0, 2.0, 48) ^ box(2, 2, 1)) - Manifold.cylinder(1.0, 1.7, 1.7, 48, True)
    part = Part(1, [0], corner, corner, 1.0)
    assert lay(part, np.full(3, 2.0))
    assert part.box.max() <= 2.0 * (1 + 1e-6)


def test_a_faulty_file_is_named(tmp_path: Path) -> None:
    """A part that touches itself along an edge only has an edge with four faces: it is named, not passed over."""
    two = Manifold.batch_boolean([box(1, 1, 1), box(1, 1, 1, (1, 1, 0))], OpType.Add)
    part = Part(3, [0, 1], two, two, 1.0)
    write_parts(tmp_path, [part], 1.0)
    assert not part.watertight
    assert part.fault == "part 3 has 1 edges that other than two faces meet at"
    told = {"parts": 3, "bracket": [2.0, 2.0], "locked": False, "uncut": [2.0, 2.0], "require": 1.0, "meets": True}
    told |= {"too_large": [2], "can_be_laid": True, "coarse_truth": "", "faulty_files": [part.fault]}
    assert "not watertight: part 3" in verdict(told)
    assert "do not fit the box: 2" in verdict(told)
    assert "λ of the cells of the search" in verdict(told | {"coarse_truth": "no face"})


def test_a_bench_is_cut_to_whole_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = Options((0.95,) * 3, DOWN, clearance=0.002, cells=6, seconds=20.0, mass=200.0, families=("grid",))
    found = cut(written(bench(), tmp_path / "bench.stl"), options, out)
    table = pd.read_csv(out / "parts.csv")
    assert found == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert len(table) == found["parts"]
    assert found["volume_error"] < 1e-12
    assert found["file_error"] < 1e-6
    assert table["mass"].max() <= 200.0 * (1 + 1e-9)
    assert table["volume"].sum() == pytest.approx(found["volume"], rel=1e-9)
    assert (table["volume_with_clearance"] < table["volume"]).all()
    meshes = [trimesh.load_mesh(out / name) for name in table["file"]]
    assert all(mesh.is_watertight for mesh in meshes)
    assert [mesh.volume for mesh in meshes] == pytest.approx(table["volume_with_clearance"].tolist(), rel=1e-6)
    solids = [solid_of(mesh.vertices, mesh.faces) for mesh in meshes]
    assert all((a ^ b).volume() < 1e-9 for k, a in enumerate(solids) for b in solids[:k])
    assert sorted(table["step"]) == list(range(1, len(table) + 1))
    for name in ("parts.3mf", "parts.step", "parts.png", "order.png", "report.html", "scene.json"):
        assert (out / name).stat().st_size > 500
    assert read_solid(out / "bed" / "part_01.stl", 1.0).volume() == pytest.approx(meshes[0].volume, rel=1e-5)


def test_cells_and_joints_are_exact() -> None:
    solid = bench()
    points, triangles = surface_of(solid)
    assert volume_of(points + 1e3, triangles) == pytest.approx(solid.volume(), rel=1e-12)
    cutting = Cutting(solid)
    for normal, at in ((np.array([1.0, 0, 0]), 0.9), (np.array([0, 0, 1.0]), 0.4), (np.array([0.6, 0, 0.8]), 0.5)):
        cutting.through(normal, at)
    assert sum(cell.volume() for cell in cutting.cells) == pytest.approx(solid.volume(), rel=1e-12)
    joints = joints_of(cutting.cells, cutting.planes, cutting.size)
    upright = [joint for joint in joints if abs(joint.normal[0]) == 1.0]
    assert sum(joint.area for joint in upright) == pytest.approx(0.4 * 0.1, rel=1e-9)
    assert sum(joint.area for joint in joints if abs(joint.normal[2]) == 1.0) == pytest.approx(2 * 0.2 * 0.4, rel=1e-9)
    cutting.halve(Limits(np.full(3, 0.3), 1.0))
    sides = np.array([np.ptp(np.array(cell.bounding_box()).reshape(2, 3), axis=0) for cell in cutting.cells])
    assert sides.max() <= 0.3 * (1 + 1e-9)


def test_concave_cells_are_split_to_convex_ones() -> None:
    assert len(concave_edges(box(1, 1, 1))) == 0
    pieces, of, planes, convex = convex_parts([bench(), box(1, 1, 1, (5, 0, 0))], 50)
    assert convex
    assert len(planes) >= 1
    assert set(of.tolist()) == {0, 1}
    assert sum(piece.volume() for piece in pieces) == pytest.approx(bench().volume() + 1.0, rel=1e-12)


def test_a_round_joint_has_few_corners() -> None:
    tube = Manifold.cylinder(2.0, 1.0, 1.0, 48) - Manifold.cylinder(4.0, 0.6, 0.6, 48, True)
    cutting = Cutting(tube)
    cutting.through(np.array([0, 0, 1.0]), 1.0)
    joints = joints_of(cutting.cells, cutting.planes, cutting.size)
    assert max(len(joint.polygon) for joint in joints) <= 8
    area = (Manifold.cylinder(1.0, 1.0, 1.0, 48) - Manifold.cylinder(4.0, 0.6, 0.6, 48, True)).volume()
    assert sum(joint.area for joint in joints) == pytest.approx(area, rel=0.1)


def test_axis_and_stress_of_simple_bodies() -> None:
    found = axis_of(Manifold.cylinder(1.0, 2.0, 2.0, 40) - Manifold.cylinder(3.0, 1.5, 1.5, 40, True))
    assert found is not None
    assert abs(found[1] @ np.array([0, 0, 1.0])) == pytest.approx(1.0)
    assert found[0][:2] == pytest.approx(np.zeros(2), abs=1e-6)
    assert axis_of(bench()) is None
    pillar = box(1.0, 1.0, 3.0)
    corners = np.array([[x, y, 0.0] for x in (0.1, 0.5, 0.9) for y in (0.1, 0.5, 0.9)])
    _, size, direction = compressed(pillar, corners, [], np.array([0.0, 0.0, -1.0]), 200)
    low = size > np.median(size)
    assert np.abs(direction[low][:, 2]).mean() > 0.9


def test_loads_are_alike_for_all_cuts() -> None:
    """A force on a region has the same sum and the same moment on any cells."""
    load = parse_load("0,0,-6@0.2,0,0.45,1.3,0.3,0.6", 1.0)
    wholes = []
    back = bench() + box(1.8, 0.1, 0.4, (0, 0.3, 0.5))
    # the second cut runs along the seat, whose faces stay those of the solid
    for normal, at in ((None, 0.0), (np.array([0.0, 0.0, 1.0]), 0.5), (np.array([0.8, 0.6, 0.0]), 0.77)):
        cutting = Cutting(back)
        if normal is not None:
            cutting.through(normal, at)
        parts = shares(load, [outside(cell, back, cutting.planes, 1.8) for cell in cutting.cells])
        force, moment = sum(f for _, f, _ in parts), sum(np.cross(p, f) for _, f, p in parts)
        wholes.append(np.concatenate([force, moment]))
    assert wholes[1] == pytest.approx(wholes[0], abs=1e-9)
    assert wholes[2] == pytest.approx(wholes[0], abs=1e-9)
    assert wholes[0][:3] == pytest.approx([0, 0, -6])


def test_files_of_all_kinds_hold_the_same_solid(tmp_path: Path) -> None:
    points, triangles = surface_of(bench())
    volume = bench().volume()
    write_3mf(tmp_path / "b.3mf", [("b", 1e3 * points, triangles)])
    lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    (tmp_path / "b.obj").write_text("\n".join(lines), encoding="utf-8")
    # turned inwards as a whole, it is the same solid
    (tmp_path / "b.stl").write_bytes(stl_bytes(points, triangles[:, ::-1]))
    for name in ("b.3mf", "b.obj", "b.stl"):
        assert read_solid(tmp_path / name, 1.0).volume() == pytest.approx(volume, rel=1e-6)


def _ascii(space: str, end: str, upper: bool) -> bytes:
    points, triangles = surface_of(box(1, 1, 2))
    lines = ["solid a"]
    for face in points[triangles]:
        corners = [space.join(["", "vertex", *map(repr, corner)]) for corner in face.tolist()]
        lines += [f"{space}facet normal{space}0 0 0", f"{space}outer loop", *corners, "endloop", "endfacet"]
    text = end.join([*lines, "endsolid a", ""])
    return (text.upper() if upper else text).encode()


@pytest.mark.parametrize(
    "data",
    [
        _ascii(" ", "\n", False),
        _ascii("\t  ", "\r\n", True),
        _ascii("  ", "\n\n \n", False),
        b"\xef\xbb\xbf" + _ascii(" ", "\r", False),
    ],
)
def test_text_files_are_read_however_they_are_spaced(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(data)
    assert read_solid(path, 1.0).volume() == pytest.approx(2.0)


def test_a_triangle_that_is_there_twice_is_one(tmp_path: Path) -> None:
    points, triangles = surface_of(box(1, 1, 2))
    path = tmp_path / "a.stl"
    path.write_bytes(stl_bytes(points, np.concatenate([triangles, triangles[:1, [1, 2, 0]], [[0, 0, 1]]])))
    assert read_solid(path, 1.0).volume() == pytest.approx(2.0)


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
    path = tmp_path / "a.3mf"
    points, triangles = surface_of(box(1, 1, 2))
    write_3mf(path, [("a", 1e3 * points, triangles)])
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    start, end = model.index("<build>"), model.index("</build>")
    model = model[:start].replace("</resources>", f"{more}</resources>") + "<build>" + build + model[end:]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    if isinstance(found, str):
        with pytest.raises(InputError, match=found):
            read_solid(path, 1.0)
    else:
        assert read_solid(path, 1.0).bounding_box() == pytest.approx(found)


def _open(points: Any, triangles: Any) -> tuple[Any, Any]:
    return points, triangles[1:]


def _turned(points: Any, triangles: Any) -> tuple[Any, Any]:
    return points, np.concatenate([triangles[:1, ::-1], triangles[1:]])


def _crossed(points: Any, triangles: Any) -> tuple[Any, Any]:
    moved = points.copy()
    moved[(points == [1, 1, 1]).all(axis=1)] = [-0.5, -0.5, -1.0]
    return moved, triangles


@pytest.mark.parametrize(("spoil", "told"), [(_open, "open"), (_turned, "turn against"), (_crossed, "crosses itself")])
def test_poor_meshes_are_named_with_place_and_remedy(tmp_path: Path, spoil: Any, told: str) -> None:
    path = tmp_path / "poor.stl"
    path.write_bytes(stl_bytes(*spoil(*surface_of(box(1, 1, 1)))))
    with pytest.raises(InputError, match=told) as error:
        read_solid(path, 1.0)
    assert "(" in str(error.value)
    assert "expected" in str(error.value)
    assert "\n" not in str(error.value)


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
        ({"families": ("slabs",)}, "families"),
        ({"unit": "ell"}, "unit"),
        ({"clearance": 0.3}, "clearance"),
        ({"clearance": -1.0}, "clearance"),
        ({"require": float("nan")}, "require"),
        ({"keep_whole": ("0,0,0",)}, "keep_whole"),
    ],
)
def test_bad_options_are_one_line(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    plain: dict[str, Any] = {"fit": (1.2,) * 3, "loads": DOWN, "seconds": 5.0}
    options = Options(**(plain | change))
    with pytest.raises((InputError, ParameterError), match=told) as error:
        cut(written(box(0.4, 0.4, 2.0), tmp_path / "a.stl"), options, tmp_path / "out")
    assert "\n" not in str(error.value)
