"""Drawings in: DXF, SVG and CSV, against geometry known beforehand; broken and hostile files get one line."""

from __future__ import annotations

import itertools
import math
import resource
from pathlib import Path

import numpy as np
import pytest

from command import call, refused
from jld_core import Assembly, InputError, build_assembly, load_scene, parse_scene, samples, solve
from jld_formats import ImportOptions, import_file

ezdxf = pytest.importorskip("ezdxf")


def built(path: Path, **options: object) -> Assembly:
    return build_assembly(parse_scene(import_file(path, ImportOptions(**options)).document))  # type: ignore[arg-type]


def sector(inner: float, outer: float, a: float, b: float) -> list[tuple[float, float, float]]:
    """A voussoir with arcs: x, y, bulge."""
    bulge = math.tan((b - a) / 4.0)
    corners = ((inner, a, bulge), (inner, b, 0.0), (outer, b, -bulge), (outer, a, 0.0))
    return [(r * math.cos(t), r * math.sin(t), w) for r, t, w in corners]


def network(path: Path, noise: float = 0.0, unit: int = 6) -> None:
    """Two by two cells of 0.5 × 0.3 on a support: the upright between them a crack, a force on the left."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    scale = {6: 1.0, 4: 1000.0}[unit]
    space = document.modelspace()

    def line(layer: str, *ends: tuple[float, float]) -> None:
        space.add_line(*[(scale * x, scale * y) for x, y in ends], dxfattribs={"layer": layer})

    for x, layer in ((0.0, "joints"), (0.5, "cracks"), (1.0, "joints")):
        line(layer, (x, noise), (x, 0.6))
    for y in (0.0, 0.3, 0.6):
        line("joints", (-noise, y), (1.0 + noise, y))
    ground = [(0, 0), (1, 0), (1, -0.1), (0, -0.1)]
    space.add_lwpolyline([(scale * x, scale * y) for x, y in ground], close=True, dxfattribs={"layer": "SUPPORTS"})
    line("LOADS", (-0.2, 0.45), (0.0, 0.45))
    space.add_text("H = 250 N", dxfattribs={"layer": "LOADS", "insert": (-0.1 * scale, 0.46 * scale)})
    document.saveas(path)


@pytest.mark.parametrize(("noise", "unit"), [(0.0, 6), (5e-4, 6), (5e-4, 4)])
def test_a_network_of_lines_becomes_cells(noise: float, unit: int, tmp_path: Path) -> None:
    """Every shared line a face, labelled by its layer; the force at the tip of its arrow; millimetres become metres."""
    path = tmp_path / "network.dxf"
    network(path, noise, unit)
    assembly = built(path, thickness=0.2, tolerance={6: 1e-3, 4: 1.0}[unit])  # in the unit of the drawing
    assert (len(assembly.elements), len(assembly.interfaces)) == (5, 6)
    assert assembly.elements.volume[assembly.elements.free] == pytest.approx([0.03] * 4, rel=4e-3)
    upright = np.isclose(assembly.interfaces.normal[:, 1], 0.0, atol=0.01)
    assert (~assembly.labels).tolist() == upright.tolist()
    loaded = np.flatnonzero(assembly.live[:, 0])
    assert assembly.live[loaded, :2].tolist() == [[250.0, 0.0]]
    assert assembly.elements.centroid[loaded[0]] == pytest.approx([0.25, 0.45], abs=2e-3)


def test_the_command_reports_and_writes_a_scene_that_solves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "network.dxf", tmp_path / "scene.json"
    network(path, 5e-4)
    failed = call(monkeypatch, capsys, "import", path, "-o", out, "--tolerance", "1e-5")
    assert (failed.code, failed.err.count("\n"), out.exists()) == (2, 1, False)  # gaps above the tolerance
    done = call(monkeypatch, capsys, "import", path, "-o", out, "--tolerance", "0.001", "--thickness", "0.2")
    assert (done.code, done.err) == (0, "")
    for word in ("4 elements and 1 support", "6 lines around 4 cells", "4 dry, 2 inner", "at most 0.000707", "density"):
        assert word in done.out
    assert solve(build_assembly(load_scene(out))).status == "collapse"
    other = tmp_path / "like.json"
    like = call(monkeypatch, capsys, "import", path, "-o", other, "--tolerance", "0.001", "--like", out)
    assert "assumed      thickness" in like.out
    assert "density" not in like.out


@pytest.mark.parametrize("offset", [False, True])
def test_arcs_drawn_twice_share_their_chords(offset: bool, tmp_path: Path) -> None:
    """An arch in two rings, joints in line or not: as many contacts as radial and ring joints."""
    document = ezdxf.new()
    space = document.modelspace()
    n = 6
    rings = []
    for ring, (inner, outer) in enumerate(((1.0, 1.1), (1.1, 1.2))):
        ends = [math.pi * k / n for k in range(n + 1)]
        if ring and offset:
            ends = [0.0, *(math.pi * (k + 0.5) / n for k in range(n)), math.pi]
        rings.append(len(ends) - 1)
        for a, b in itertools.pairwise(ends):
            space.add_lwpolyline(sector(inner, outer, a, b), format="xyb", close=True, dxfattribs={"layer": "stone"})
    for x in (1.0, -1.2):
        ground = [(x, 0), (x + 0.2, 0), (x + 0.2, -0.2), (x, -0.2)]
        space.add_lwpolyline(ground, close=True, dxfattribs={"layer": "support"})
    path = tmp_path / "arch.dxf"
    document.saveas(path)
    found = import_file(path, ImportOptions(facet=1e-3))
    (said,) = [text for text in found.report.found if "chords" in text]
    assert float(said.split("at most ")[1].split()[0]) <= 1e-3
    assembly = build_assembly(parse_scene(found.document))
    assert len(assembly.elements) == sum(rings) + 2
    pairs = set(zip(assembly.interfaces.a.tolist(), assembly.interfaces.b.tolist(), strict=True))
    ring_joints = n if not offset else 2 * n
    assert len(pairs) == (rings[0] - 1) + (rings[1] - 1) + ring_joints + 4
    exact = 0.5 * math.pi * (1.2**2 - 1.0)
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(exact, rel=2e-3)


def test_blocks_hatches_texts_and_points(tmp_path: Path) -> None:
    """Inserted blocks turned, a hatch, names by text and by attribute, a pinned support, loads as points."""
    document = ezdxf.new()
    space = document.modelspace()
    brick = document.blocks.new("BRICK")
    brick.add_lwpolyline([(0, 0), (2, 0), (2, 1), (0, 1)], close=True, dxfattribs={"layer": "0"})
    pile = document.blocks.new("PILE")
    pile.add_blockref("BRICK", (0, 0))
    pile.add_blockref("BRICK", (2, 2), dxfattribs={"rotation": 180.0})
    space.add_blockref("PILE", (0, 0), dxfattribs={"layer": "stones"})
    named = space.add_blockref("BRICK", (3, 0), dxfattribs={"layer": "stones", "rotation": 90.0})
    named.add_attrib("ID", "upright", (2.5, 1.0))
    hatch = space.add_hatch(dxfattribs={"layer": "stones"})
    hatch.paths.add_polyline_path([(0, 2), (3, 2), (3, 3), (0, 3)], is_closed=True)
    space.add_text("lintel", dxfattribs={"layer": "IDS", "insert": (1.5, 2.5)})
    space.add_lwpolyline([(-1, -1), (4, -1), (4, 0), (-1, 0)], close=True, dxfattribs={"layer": "stones"})
    space.add_point((1.0, -0.5), dxfattribs={"layer": "my supports"})
    space.add_text("3, -4", dxfattribs={"layer": "load", "insert": (1.5, 3.0)})
    space.add_mtext("5", dxfattribs={"layer": "load", "insert": (1.0, 2.0)})
    space.add_circle((10, 10), 1.0, dxfattribs={"layer": "dimensions"})
    path = tmp_path / "blocks.dxf"
    document.saveas(path)
    found = import_file(path)
    assembly = build_assembly(parse_scene(found.document))
    assert {"lintel", "upright"} < set(assembly.elements.ids)
    assert int(assembly.elements.support.sum()) == 1
    assert sorted(assembly.elements.volume[assembly.elements.free].tolist()) == pytest.approx([2.0, 2.0, 2.0, 3.0])
    lintel = assembly.elements.index["lintel"]
    # the second force stands on the joint with the brick below, which takes half of it
    assert assembly.live[lintel] == pytest.approx([3.0, -4.0 - 2.5, 1.5 * 0 - 3.0 * 0.5 + 2.5 * 0.5])
    assert assembly.live[:, 1].sum() == pytest.approx(-9.0)
    assert any("dimensions" in text for text in found.report.skipped)


def test_an_outline_is_cut_by_the_lines_that_cross_it(tmp_path: Path) -> None:
    """One outline, a crack and a joint through it, and a line that ends inside and divides nothing."""
    document = ezdxf.new()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (3, 0), (3, 1), (0, 1)], close=True, dxfattribs={"layer": "wall"})
    space.add_line((1, -1), (1, 2), dxfattribs={"layer": "cracks"})
    space.add_line((2, 0), (2, 1), dxfattribs={"layer": "joints"})
    space.add_line((2.5, 0), (2.5, 0.5), dxfattribs={"layer": "joints"})
    space.add_lwpolyline([(0, 0), (3, 0), (3, -1), (0, -1)], close=True, dxfattribs={"layer": "support"})
    path = tmp_path / "cut.dxf"
    document.saveas(path)
    assembly = built(path)
    assert sorted(assembly.elements.volume.tolist()) == pytest.approx([1.0, 1.0, 1.0, 3.0])
    inner = assembly.interfaces.origin[~assembly.labels]
    assert inner.tolist() == [[1.0, 0.5]]


def test_regions_are_outlines_and_solids_are_solids(tmp_path: Path) -> None:
    """A region of a solid modeller as an element; meshes and solids with plane faces make a spatial scene."""
    from ezdxf.acis import api as acis
    from ezdxf.math import Vec3
    from ezdxf.render import MeshBuilder, forms

    document = ezdxf.new("R2010")
    space = document.modelspace()
    flat = MeshBuilder()
    flat.vertices = [Vec3(p) for p in ((0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0))]
    flat.faces = [(0, 1, 2, 3)]
    acis.export_dxf(space.add_region(dxfattribs={"layer": "stone"}), [acis.body_from_mesh(flat)])
    space.add_lwpolyline([(0, -1), (2, -1), (2, 0), (0, 0)], close=True, dxfattribs={"layer": "support"})
    document.saveas(tmp_path / "region.dxf")
    assert built(tmp_path / "region.dxf").elements.volume.tolist() == pytest.approx([2.0, 2.0])

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    block = forms.cube().scale_uniform(1000.0)
    acis.export_dxf(space.add_3dsolid(dxfattribs={"layer": "stone"}), [acis.body_from_mesh(block)])
    with space.add_mesh(dxfattribs={"layer": "supports"}).edit_data() as data:
        data.vertices = [(x, y, z - 1000.0) for x, y, z in block.vertices]
        data.faces = [list(face) for face in block.faces]
    document.saveas(tmp_path / "solids.dxf")
    assembly = built(tmp_path / "solids.dxf")
    assert assembly.elements.volume == pytest.approx([1.0, 1.0])
    assert assembly.elements.support.tolist() == [False, True]
    assert assembly.interfaces.area == pytest.approx([1.0])


def test_pairs_with_a_joint_and_a_crack_get_interfaces_of_their_own(tmp_path: Path) -> None:
    """An L around a square: one of their two faces dry, the other inner, which lists of pairs cannot say."""
    document = ezdxf.new()
    space = document.modelspace()
    ell = [(0, 0), (2, 0), (2, 2), (1, 2), (1, 1), (0, 1)]
    space.add_lwpolyline(ell, close=True, dxfattribs={"layer": "stone"})
    space.add_lwpolyline([(0, 1), (1, 1), (1, 2), (0, 2)], close=True, dxfattribs={"layer": "stone"})
    space.add_lwpolyline([(0, 0), (2, 0), (2, -1), (0, -1)], close=True, dxfattribs={"layer": "support"})
    space.add_line((0, 1), (1, 1), dxfattribs={"layer": "joints"})
    space.add_line((1, 1), (1, 2), dxfattribs={"layer": "cracks"})
    path = tmp_path / "ell.dxf"
    document.saveas(path)
    assembly = built(path)
    label = {
        tuple(origin): bool(dry)
        for origin, dry in zip(assembly.interfaces.origin.tolist(), assembly.labels, strict=True)
    }
    assert label == {(0.5, 1.0): True, (1.0, 1.5): False, (1.0, 0.0): True}


def test_svg_groups_are_layers_and_y_turns_up(tmp_path: Path) -> None:
    path = tmp_path / "sketch.svg"
    path.write_text(
        '<svg width="210mm" viewBox="0 0 70 40" xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape">'
        '<g inkscape:label="Supports"><rect x="0" y="10" width="10" height="2"/></g>'
        '<g id="stones" transform="translate(0,5)"><path d="M0 0 h5 v5 h-5 z m5 0 h5 v5 h-5 z"/></g>'
        '<g id="stones2"><path d="M 0,5 A 5,5 0 0 1 10,5 Z"/></g>'
        '<g id="names" transform="translate(1,0)"><text x="1" y="7">left</text></g></svg>',
        encoding="utf-8",
    )
    assembly = built(path, facet=0.001)
    assert assembly.elements.ids[assembly.elements.centroid[:, 1].argmin()] in assembly.elements.ids
    volume = sorted(assembly.elements.volume.tolist())
    assert volume == pytest.approx([9e-6 * area for area in (20.0, 25.0, 25.0, 12.5 * math.pi)], rel=1e-3)
    assert "left" in assembly.elements.ids
    assert len(assembly.interfaces) == 5


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("page", "metres", "unit"),
    [
        ('width="400mm" height="300mm" viewBox="0 0 400 300"', 0.1, "mm"),
        ('width="40cm" height="30cm" viewBox="0 0 400 300"', 0.1, "cm"),
        ('width="20mm" height="15mm" viewBox="0 0 400 300"', 0.005, "mm"),
        ('width="10in" height="7.5in" viewBox="0,0,10,7.5"', 2.54, "in"),
        ('width="400mm" viewBox="0 0 400 300"', 0.1, "mm"),
        ('width="400mm" height="400mm" viewBox="0 0 400 300"', 0.1, "mm"),
        ('width="400mm" height="300mm"', 100 * 0.0254 / 96, "mm"),
        ('width="400" height="300" viewBox="0 0 400 300"', 100.0, None),
        ('width="400mm" height="300mm" viewBox="0 0 0 300"', 100.0, None),
    ],
)
def test_the_page_of_an_svg_states_its_unit(page: str, metres: float, unit: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    shapes = '<g id="support"><rect y="100" width="100" height="20"/></g><rect id="b" width="100" height="100"/>'
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {page}>{shapes}</svg>')
    found = import_file(path)
    (outline,) = [one["polygon"] for one in found.document["elements"] if not one.get("support")]
    side = np.ptp(np.array(outline), axis=0)
    assert side == pytest.approx([metres, metres], rel=1e-6)
    assert any("names no unit" in line for line in found.report.assumed) == (unit is None)
    # a unit given by the user is that of the numbers in the file
    elements = import_file(path, ImportOptions(unit="cm")).document["elements"]
    (own,) = [one["polygon"] for one in elements if not one.get("support")]
    assert np.ptp(np.array(own), axis=0) == pytest.approx([1.0, 1.0], rel=1e-6)


def test_csv_polygons(tmp_path: Path) -> None:
    path = tmp_path / "wall.csv"
    path.write_text("id;x;y;support\na;0;0,0;yes\na;1;0;\na;1;1,00;\na;0;1;\nb;0;1;\nb;1;1;\nb;1;2;\nb;0;2;\nb;0;1;\n")
    assembly = built(path)
    assert assembly.elements.ids == ("a", "b")
    assert assembly.elements.support.tolist() == [True, False]
    assert len(built(path, support=("lowest",)).interfaces) == 1


def bomb(path: Path) -> None:
    """Ten blocks, each holding ten of the one before: 10¹⁰ lines if taken apart."""
    document = ezdxf.new()
    document.blocks.new("B0").add_line((0, 0), (1, 0))
    for level in range(1, 11):
        block = document.blocks.new(f"B{level}")
        for _ in range(10):
            block.add_blockref(f"B{level - 1}", (0, 0))
    document.modelspace().add_blockref("B10", (0, 0))
    document.saveas(path)


def ouroboros(path: Path) -> None:
    document = ezdxf.new()
    document.blocks.new("A").add_blockref("B", (0, 0))
    document.blocks.new("B").add_blockref("A", (0, 0))
    document.modelspace().add_blockref("A", (0, 0))
    document.saveas(path)


def array(path: Path) -> None:
    document = ezdxf.new()
    document.blocks.new("A").add_line((0, 0), (1, 0))
    document.modelspace().add_blockref("A", (0, 0), dxfattribs={"row_count": 32000, "column_count": 32000})
    document.saveas(path)


def truncated(path: Path) -> None:
    network(path)
    path.write_bytes(path.read_bytes()[:-3000])


def binary(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(20_000))


def nan(path: Path) -> None:
    document = ezdxf.new()
    document.modelspace().add_lwpolyline([(0, 0), (float("nan"), 0), (1, 1)], close=True)
    document.saveas(path)


def huge(path: Path) -> None:
    document = ezdxf.new()
    document.modelspace().add_lwpolyline([(0, 0), (1e300, 0), (1e300, 1e300)], close=True)
    document.modelspace().add_lwpolyline(
        [(0, 0), (1e-300, 0), (1e-300, -1)], close=True, dxfattribs={"layer": "support"}
    )
    document.saveas(path)


def crossing(path: Path) -> None:
    document = ezdxf.new()
    document.modelspace().add_lwpolyline([(0, 0), (2, 2), (2, 0), (0, 1)], close=True)
    document.modelspace().add_lwpolyline(
        [(0, 0), (2, 0), (2, -1), (0, -1)], close=True, dxfattribs={"layer": "support"}
    )
    document.saveas(path)


def hatched(path: Path) -> None:
    """Eleven hundred lines across as many: more than a million crossings."""
    document = ezdxf.new()
    space = document.modelspace()
    for k in range(1100):
        space.add_line((k, -1), (k, 1100))
        space.add_line((-1, k), (1100, k))
    document.saveas(path)


def one_circle(path: Path) -> None:
    document = ezdxf.new()
    for k in range(3_500):
        document.modelspace().add_arc((0, 0), 1.0, 0.01 * k, 0.01 * k + 1.0)
    document.saveas(path)


def nothing(path: Path) -> None:
    ezdxf.new().saveas(path)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (bomb, ["nested blocks hold", "at most"]),
        (ouroboros, ["block 'A'", "inside itself"]),
        (array, ["nested blocks hold"]),
        (truncated, ["no DXF"]),
        (binary, ["no DXF"]),
        (nan, ["no number"]),
        (huge, ["out of range"]),
        (crossing, ["element 'e1'", "self-intersection"]),
        (hatched, ["too many crossings"]),
        (one_circle, ["3500 arcs of one circle"]),
        (nothing, ["no closed outline and no line"]),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_hostile_dxf(
    make: object, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "bad.dxf", tmp_path / "scene.json"
    make(path)  # type: ignore[operator]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = call(monkeypatch, capsys, "import", path, "-o", out)
    done.refused(str(path))
    assert all(word in done.err for word in words), done.err
    assert not out.exists()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


@pytest.mark.parametrize(
    ("text", "force"),
    [("10 kN", [0.0, -1e4]), ("F1 = 10 kN", [0.0, -1e4]), ("1 t", [0.0, -9810.0]), ("2,5 kN; 1 kN", [2500.0, 1000.0])],
)
def test_a_force_is_read_with_its_unit_and_reported(text: str, force: list[float], tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    shapes = '<g id="support"><rect y="1" width="1" height="1"/></g><rect id="b" width="1" height="1"/>'
    path.write_text(SVG.format(f'{shapes}<g id="loads"><text x=".5" y="0">{text}</text></g>'))
    found = import_file(path)
    (load,) = found.document["loads"]["live"]
    assert load["force"] == pytest.approx(force)
    (told,) = [line for line in found.report.found if "force" in line]
    assert f" N on element {load['element']!r} at (0.5, 0), {text!r}" in told
    path.write_text(SVG.format(f'{shapes}<g id="loads"><text x=".5" y="0">10 kN/m</text></g>'))
    with pytest.raises(InputError, match=r"'10 kN/m': 10 kN/m is a load per length"):
        import_file(path)


SVG = '<svg xmlns="http://www.w3.org/2000/svg">{}</svg>'


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "x,y\n1,2\n", ["line 1", "'id'"]),
        ("a.csv", "id,x,y,colour\na,1,2,red\n", ["line 1", "'colour'"]),
        ("a.csv", "id,x,y\na,0,zero\n", ["line 2", "two numbers"]),
        ("a.csv", 'id,x,y\na,"1,5",2\n', ["line 2", "decimal commas"]),
        ("a.csv", "id;x;y\na;0,5;0\na;1.000;0\n", ["line 3", "decimal commas"]),
        ("a.csv", "id,x,y\na,1_5,0\n", ["line 2", "two numbers"]),
        ("a.csv", "id,x,y\na,0,inf\n", ["line 2", "no number"]),
        ("a.csv", "id,x,y\na,0\n", ["line 2", "2 fields"]),
        ("a.csv", "id,x,y\na,0,0\na,1,0\n", ["'a'", "2 corners"]),
        ("a.csv", "id,x,y\na,0,0\na,1,0\na,1,1\n", ["no support", "--support lowest"]),
        ("a.csv", "", ["empty"]),
        ("a.csv", "id,x,y\na,0,0\n" + "b" * 140_000 + ",1,2\n", ["line 3", "no row"]),
        ("a.csv", "c" * 140_000 + ",x,y\na,0,0\n", ["line 1", "no row"]),
        ("a.csv", b"id,x,y\na,\x81\xfe,1\n", ["UTF-8"]),
        ("a.svg", "<svg", ["no SVG"]),
        ("a.svg", SVG.format("<path d='M 0 0 L nan 1 L 1 1 z'/>"), ["a.svg"]),
        ("a.svg", "<!DOCTYPE svg [<!ENTITY a 'b'>]>" + SVG.format("&a;"), ["entities"]),
        ("a.svg", SVG.format(""), ["no closed outline"]),
        ("a.svg", SVG.format('<rect id="support" width="1" height="1"/>'), ["a.svg"]),
        ("a.docx", "x", ["'.docx'", ".dxf"]),
    ],
)
def test_hostile_text(
    name: str, text: str | bytes, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    monkeypatch.chdir(tmp_path)
    done = call(monkeypatch, capsys, "import", name, "-o", "scene.json")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert str(tmp_path) not in done.err
    assert all(word in done.err for word in words), done.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": -1.0}, "^tolerance: "),
        ({"thickness": 0.0}, "^thickness: "),
        ({"facet": float("nan")}, "^facet: "),
        ({"unit": "furlong"}, "^unit: "),
        ({"support": ("nope",)}, "no layer is like nope"),
    ],
)
def test_bad_options(options: dict[str, object], words: str, tmp_path: Path) -> None:
    path = tmp_path / "network.dxf"
    network(path)
    with pytest.raises(InputError, match=words):
        import_file(path, ImportOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("unit", [4, 6])
def test_joints_that_end_on_arcs_divide_them(unit: int, tmp_path: Path) -> None:
    """Two half circles and eight radial lines: seven voussoirs, though chords lie up to the facet inside the arcs."""
    scale = {6: 1.0, 4: 1000.0}[unit]
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    for radius in (1.5, 1.9):
        space.add_arc((0, 0), scale * radius, 0, 180, dxfattribs={"layer": "Arc"})
    for angle in np.linspace(0.0, np.pi, 8):
        ends = [(scale * r * math.cos(angle), scale * r * math.sin(angle)) for r in (1.5, 1.9)]
        space.add_line(*ends, dxfattribs={"layer": "Joints"})
    for side in (-1, 1):
        feet = [(side * x * scale, y * scale) for x, y in ((1.4, -0.3), (2.0, -0.3), (2.0, 0.0), (1.4, 0.0))]
        space.add_lwpolyline(feet, close=True, dxfattribs={"layer": "Appuis"})
    document.saveas(tmp_path / "arch.dxf")
    assembly = built(tmp_path / "arch.dxf")
    assert len(assembly.elements.free) == 7
    assert len(assembly.interfaces) == 8
    volume = assembly.elements.volume[assembly.elements.free]
    assert volume == pytest.approx([math.pi * (1.9**2 - 1.5**2) / 14] * 7, rel=5e-3)


def test_a_pressure_names_all_elements_that_it_acts_on(tmp_path: Path) -> None:
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    for k in range(3):
        outline = [(k, 0), (k + 1, 0), (k + 1, 0.5), (k, 0.5)]
        space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "Ziegel"})
    space.add_lwpolyline([(0, -1), (3, -1), (3, 0), (0, 0)], close=True, dxfattribs={"layer": "Boden"})
    space.add_line((0, 0.5), (3, 0.5), dxfattribs={"layer": "Lasten"})
    space.add_text("q = 20 kN/m", height=0.1, dxfattribs={"layer": "Lasten", "insert": (1.4, 0.6)})
    document.saveas(tmp_path / "row.dxf")
    found = import_file(tmp_path / "row.dxf", ImportOptions(thickness=0.5)).report.found
    assert any("live pressure 40000 N/m² on elements e1, e2, e3 from (0, 0.5) to (3, 0.5)" in line for line in found)


@pytest.mark.parametrize(("yes", "no"), [("ja", "nein"), ("Oui", "non"), ("x", ""), ("VERO", "falso")])
def test_supports_of_a_table_are_named_in_five_languages(yes: str, no: str, tmp_path: Path) -> None:
    rows = [(name, x, y, held) for name, low, held in (("s", 0, no), ("g", -1, yes)) for x, y in
            ((0, low), (1, low), (1, low + 1), (0, low + 1))]  # fmt: skip
    path = tmp_path / "pier.csv"
    path.write_text("id,x,y,support\n" + "".join(f"{n},{x},{y},{held}\n" for n, x, y, held in rows))
    assert built(path).elements.support.tolist() == [False, True]
    path.write_text(path.read_text().replace(f"1,{yes}\n", "1,vielleicht\n"))
    with pytest.raises(InputError, match=r"line \d+: support is 'vielleicht'; expected yes or no"):
        import_file(path)


def pier(path: Path, lines: list[tuple[str, float, float, float, float]], texts: list[tuple[str, str]]) -> None:
    """A pier of 1 × 2 m on a footing, drawn in mm, with lines by layer and texts by layer beside them."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    for layer, low, high in (("Pfeiler", 0, 2000), ("Gründung", -200, 0)):
        outline = [(0, low), (1000, low), (1000, high), (0, high)]
        space.add_lwpolyline(outline, close=True, dxfattribs={"layer": layer})
    for (layer, *ends), (own, text) in zip(lines, texts, strict=True):
        space.add_line(ends[:2], ends[2:], dxfattribs={"layer": layer})
        middle = (0.5 * (ends[0] + ends[2]) + 20.0, 0.5 * (ends[1] + ends[3]))
        space.add_text(text, height=50, dxfattribs={"layer": own, "insert": middle})
    document.saveas(path)


WIND, SNOW = (0.0, 2000.0, 0.0, 500.0), (500.0, 2500.0, 500.0, 2000.0)


def test_load_cases_are_named_in_german(tmp_path: Path) -> None:
    path = tmp_path / "pier.dxf"
    named = [(layer, *line) for layer, line in (("Lastfall Wind", WIND), ("Lastfall Schnee", SNOW))]
    pier(path, named, [("Lastfall Wind", "w = 0,8 kN/m²"), ("Lastfall Schnee", "1,5 kN")])
    cases = import_file(path).document["loads"]["cases"]
    assert [case["name"] for case in cases] == ["Lastfall Schnee", "Lastfall Wind"]
    assert cases[0]["live"][0]["force"] == [0.0, -1500.0]
    assert cases[1]["live"][0]["pressure"] == pytest.approx(800.0)


def test_a_point_is_no_sign_of_thousands_beside_a_decimal_comma(tmp_path: Path) -> None:
    path = tmp_path / "pier.dxf"
    texts = [("Lasten", "w = 0,8 kN/m²"), ("Lasten", "1.500 N")]
    pier(path, [("Lasten", *WIND), ("Lasten", *SNOW)], texts)
    with pytest.raises(
        InputError, match=r"the point in '1.500 N' may separate thousands, as 'w = 0,8 kN/m²' has a dec"
    ):
        import_file(path)


def test_forces_on_layers_that_are_not_read_are_doubtful(tmp_path: Path) -> None:
    path = tmp_path / "pier.dxf"
    pier(path, [("Druck", *WIND), ("Druck", *SNOW)], [("Druck", "w = 0,8 kN/m²"), ("Notizen", "Höhe 2 m")])
    doubts = import_file(path).report.doubtful
    assert [one for one in doubts if "Druck" in one] == [
        "the text 'w = 0,8 kN/m²' on layer Druck states a force: a load? --load 'Druck'"
    ]
    assert not any("Notizen" in one for one in doubts)


@pytest.mark.parametrize(
    ("support", "words"),
    [
        ([(0, 0), (1000, 0)], "no line on layer Auflager encloses an area; expected closed outlines there"),
        ([(500, 0), (420, -140), (580, -140)], "'e2' and 'e1' touch at a point alone"),
    ],
)
def test_supports_that_bear_nothing_are_explained(
    support: list[tuple[float, float]], words: str, tmp_path: Path
) -> None:
    """A line of the ground, and the triangle by which drawings show a bearing."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    outline = [(0, 0), (1000, 0), (1000, 400), (0, 400)]
    space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "Träger"})
    space.add_lwpolyline(support, close=len(support) > 2, dxfattribs={"layer": "Auflager"})
    document.saveas(tmp_path / "beam.dxf")
    with refused(words):
        built(tmp_path / "beam.dxf")


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    path = tmp_path / "network.dxf"
    network(path)
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(InputError, match=r"pip install 'jld\[dxf\]'"):
        import_file(path)


def test_a_sample_drawn_and_read_again_has_the_same_load_factor(tmp_path: Path) -> None:
    """Corners of a wall written as CSV: the same faces, and λ to rounding."""
    scene = samples.wall(bond="third")
    rows = ["id,x,y,layer"]
    for element in scene.elements or []:
        rows += [f"{element.id},{x!r},{y!r},{'support' if element.support else ''}" for x, y in element.polygon or []]
    path = tmp_path / "wall.csv"
    path.write_text("\n".join(rows))
    read = built(path, thickness=0.2, like=scene)
    exact = build_assembly(scene)
    assert len(read.interfaces) == len(exact.interfaces)
    assert solve(read).load_factor == pytest.approx(solve(exact).load_factor, rel=1e-9)
