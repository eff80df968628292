"""Drawings as people make them: mirrored blocks, outlines past their start, openings, layers off, sloppy gaps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command import call
from jld_core import Assembly, InputError, build_assembly, parse_scene
from jld_formats import ImportOptions, import_file, paths
from jld_formats import paths as paths_of_exchange

ezdxf = pytest.importorskip("ezdxf")


def square(space: Any, x0: float, y0: float, x1: float, y1: float, layer: str = "0") -> None:
    space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, dxfattribs={"layer": layer})


def drawn(path: Path, make: Callable[[Any, Any], None], unit: int = 6) -> Path:
    """A drawing above a support from (0, -1) to (2, 0)."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    square(space, 0, -1, 2, 0, "SUPPORT")
    make(document, space)
    document.saveas(path)
    return path


def found(path: Path, **options: Any) -> tuple[Assembly, str]:
    read = import_file(path, ImportOptions(**options))
    return build_assembly(parse_scene(read.document)), str(read.report)


def test_mirrored_and_nested_blocks(tmp_path: Path) -> None:
    """A trapezium with an arc, mirrored, mirrored within a block, and mirrored twice: areas and centroids by hand."""

    def make(document: Any, space: Any) -> None:
        stone = document.blocks.new("STONE")
        # right-angled trapezium of width 1, heights 1 and 2; a bulge of a quarter circle on its left side
        bulge = math.tan(math.pi / 8)
        stone.add_lwpolyline([(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 1, bulge)], format="xyb", close=True)
        stone.add_text("name", dxfattribs={"layer": "IDS", "insert": (0.5, 0.5)})
        turned = document.blocks.new("TURNED")
        turned.add_blockref("STONE", (0, 0), dxfattribs={"xscale": -1})
        space.add_blockref("STONE", (0, 0))
        space.add_blockref("STONE", (2, 0), dxfattribs={"xscale": -1})
        space.add_blockref("TURNED", (2, 10), dxfattribs={"yscale": -1, "rotation": 0})
        space.add_blockref("TURNED", (10, 10), dxfattribs={"xscale": -1})

    read = import_file(drawn(tmp_path / "a.dxf", make), ImportOptions(facet=1e-4))
    free = [entry for entry in read.document["elements"] if not entry.get("support")]
    area = 1.5 + (math.pi / 8 - 0.25)  # a segment of a quarter circle on a chord of 1
    boxes = set()
    for entry in free:
        points = np.array(entry["polygon"])
        x, y = points.T
        assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(area, rel=1e-3)
        boxes.add((*np.round(points.min(axis=0), 2).tolist(), *np.round(points.max(axis=0), 2).tolist()))
    sag = round((math.sqrt(0.5) - 0.5), 2)
    wanted = {(-sag, 0, 1, 2), (1, 0, 2 + sag, 2), (1, 8, 2 + sag, 10), (10 - sag, 10, 11, 12)}
    assert {tuple(round(v, 2) for v in box) for box in wanted} == boxes
    assert "not in the plane" not in str(read.report)
    assert "skipped" not in str(read.report)


@pytest.mark.parametrize(
    "corners",
    [
        "ABCDA", "ABCDAB", "ABCDABC", "ABCDABCDA", "ABCDAM", "ABCDABm",
    ],
)  # fmt: skip
@pytest.mark.parametrize("closed", [False, True])
def test_outlines_that_go_round_past_their_start(corners: str, closed: bool) -> None:
    """M halves the edge from A to B, m that from B to C: all of these are the outline A B C D."""
    place = {"A": (0, 0), "B": (2, 0), "C": (2, 1), "D": (0, 1), "M": (1, 0), "m": (2, 0.5)}
    points = np.array([(*place[letter], 0.0) for letter in corners])
    path = paths_of_exchange.without_repeats(paths.Path(points, closed, "0"), 1e-9)
    assert path.closed
    assert path.points[:, :2].tolist() == [list(place[letter]) for letter in "ABCD"]


def test_lines_that_cross_their_start_stay_lines() -> None:
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (-1, -1, 0.0), (0, -1, 0)])
    assert paths_of_exchange.without_repeats(paths.Path(points, False, "0"), 1e-9).points is points


def test_outlines_past_their_start_and_twice_are_one_element(tmp_path: Path) -> None:
    def make(_: Any, space: Any) -> None:
        space.add_lwpolyline([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0)])
        space.add_lwpolyline([(1, 0), (2, 0), (2, 1), (1, 1), (1, 0), (2, 0)], close=True)
        square(space, 0, 0, 1, 1)

    assembly, report = found(drawn(tmp_path / "a.dxf", make))
    assert sorted(assembly.elements.volume.tolist()) == pytest.approx([1.0, 1.0, 2.0])
    assert "1 outlines: drawn twice" in report


@pytest.mark.parametrize("opening", ["outline", "lines"])
@pytest.mark.parametrize("option", [False, True])
def test_openings_by_layer_or_option(opening: str, option: bool, tmp_path: Path) -> None:
    """A window of 0.2 × 0.2 in one stone of a wall of lines: no element, and the stone stays one block."""
    layer = "RAUM" if option else "Windows"

    def make(_: Any, space: Any) -> None:
        for x in (0, 1, 2):
            space.add_line((x, 0), (x, 1))
        for y in (0, 0.5, 1):
            space.add_line((0, y), (2, y))
        corners = [(0.2, 0.1), (0.4, 0.1), (0.4, 0.3), (0.2, 0.3)]
        if opening == "outline":
            space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})
        else:
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                space.add_line(a, b, dxfattribs={"layer": layer})

    assembly, report = found(drawn(tmp_path / "a.dxf", make), **({"hole": ("raum",)} if option else {}))
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(2.0 - 0.04)
    assert "1 opening" in report
    around = [k for k, block in enumerate(assembly.elements.blocks) if block is not None]
    assert assembly.elements.volume[around].sum() == pytest.approx(0.5 - 0.04)
    both = np.isin(assembly.interfaces.a, around) & np.isin(assembly.interfaces.b, around)
    assert both.sum() == 2
    assert not assembly.labels[both].any()


def test_a_filled_window_is_doubtful(tmp_path: Path) -> None:
    def make(_: Any, space: Any) -> None:
        for x in (0, 0.5, 1.5, 2):
            space.add_line((x, 0), (x, 1))
        for y in np.linspace(0, 1, 6).tolist():
            space.add_line((0, y), (0.5, y))
            space.add_line((1.5, y), (2, y))
        for y in (0, 1):
            space.add_line((0, y), (2, y))

    _, report = found(drawn(tmp_path / "a.dxf", make))
    assert "has 10 times the area of the median element: if it is an opening" in report
    assert "--hole" in report


def test_layers_off_or_frozen_are_not_read(tmp_path: Path) -> None:
    def make(document: Any, space: Any) -> None:
        square(space, 0, 0, 2, 1)
        document.layers.add("OFF").off()
        document.layers.add("COLD").freeze()
        block = document.blocks.new("B")
        square(block, 0, 1, 2, 2, "0")
        for layer in ("OFF", "COLD"):
            square(space, 0, 1, 2, 2, layer)
            space.add_blockref("B", (0, 0), dxfattribs={"layer": layer})

    assembly, report = found(drawn(tmp_path / "a.dxf", make))
    assert len(assembly.elements) == 2
    assert "2 entities on layer COLD: it is off or frozen" in report
    assert "2 entities on layer OFF: it is off or frozen" in report


def test_lines_beside_outlines_are_used_or_counted_by_layer(tmp_path: Path) -> None:
    """A stone drawn by lines beside an outline is an element; notes, ticks and a loop elsewhere are counted."""

    def make(_: Any, space: Any) -> None:
        square(space, 0, 0, 1, 1)
        space.add_line((1, 0), (2, 0))
        space.add_line((2, 0), (2, 1))
        space.add_line((2, 1), (1, 1))
        space.add_line((0.2, 0.2), (0.4, 0.4), dxfattribs={"layer": "TICK"})
        space.add_line((5, 5), (6, 6), dxfattribs={"layer": "NOTES"})
        space.add_arc((5.5, 5.5), math.sqrt(0.5), 45, 225, dxfattribs={"layer": "NOTES"})
        space.add_spline([(0, 3, 0), (1, 4, 0), (2, 3, 0)], dxfattribs={"layer": "CURVES"})
        space.add_spline([(0, 0.5, 0), (0.5, 0.6, 0), (1, 0.5, 0)], dxfattribs={"layer": "CRACKS"})

    assembly, report = found(drawn(tmp_path / "a.dxf", make))
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(2.0)
    assert len(assembly.elements) == 4  # one outline in two, one of lines, and the support
    for words in ("1 line on layer TICK", "2 lines on layer NOTES", "1 line on layer CURVES", "1 cell that lines"):
        assert words in report
    assert "layer CRACKS:" not in report


def test_chords_have_the_symmetry_of_their_arcs() -> None:
    """Arcs of one circle from any angles: equal chords in each, the same on both sides, mirrored about the middle."""
    ends = np.radians([17.0, 40.0, 90.0, 140.0, 163.0])
    rows = [paths_of_exchange.arc_points((0.0, 0.0), 2.0, a, b - a) for a, b in itertools.pairwise(ends)]
    rows.append(paths_of_exchange.arc_points((0.0, 0.0), 2.0, ends[-1], ends[0] - ends[-1]))  # the whole arc, backwards
    made = paths_of_exchange.flatten([paths.Path(row, False, "0") for row in rows], 1e-3, 1e-9)
    for points in made.points[:4]:
        chords = np.hypot(*np.diff(points, axis=0).T)
        np.testing.assert_allclose(chords, chords[0], rtol=1e-12)
    whole, parts = made.points[-1][::-1], np.concatenate([made.points[0], *(p[1:] for p in made.points[1:4])])
    np.testing.assert_allclose(whole, parts, atol=1e-12)
    np.testing.assert_allclose(whole * [-1, 1], whole[::-1], atol=1e-12)
    assert made.deviation <= 1e-3


@pytest.mark.parametrize(("unit", "size"), [(6, 1.0), (4, 1000.0), (1, 1 / 0.0254)])
def test_the_default_tolerance_closes_an_ordinary_drawing(unit: int, size: float, tmp_path: Path) -> None:
    """Gaps of 0.3 mm in 2 m close in every unit, and what moved is told in that of the drawing."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    square(space, 0, -size, 2 * size, 0, "SUPPORT")
    square(space, 0, 0, size, size)
    square(space, 1.0003 * size, 0.0002 * size, 2 * size, size)
    document.saveas(tmp_path / "a.dxf")
    assembly, report = found(tmp_path / "a.dxf")
    assert len(assembly.interfaces) == 3
    name = {6: "m", 4: "mm", 1: "in"}[unit]
    assert f"corners, by at most {3.60555e-4 * size:.3g} {name}; tolerance {1e-3 * size:.3g} {name}" in report
    with pytest.raises(InputError, match="no path of interfaces"):
        found(tmp_path / "a.dxf", tolerance=1e-4 * size)


def test_the_tolerance_is_in_the_unit_of_the_drawing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gap of 2 units: the message names the tolerance that closes it in this unit, and it does."""

    def make(_: Any, space: Any) -> None:
        square(space, 0, 0.01, 2, 1)

    path, out = drawn(tmp_path / "a.dxf", make), tmp_path / "a.json"
    call(monkeypatch, capsys, "import", path, "-o", out, "--unit", "mm").refused(
        "--tolerance 0.011 (in mm) closes such gaps"
    )
    done = call(monkeypatch, capsys, "import", path, "-o", out, "--unit", "mm", "--tolerance", "0.011").done()
    assert "by at most 0.01 mm; tolerance 0.011 mm" in done.out


@pytest.mark.parametrize(
    ("unit", "size", "words"),
    [
        (1, 1800.0, "45.7 m large"),  # a jack arch of millimetres read as inches
        (0, 3000.0, "3e+03 m large"),  # no unit: metres are assumed
        (4, 2.0, "0.002 m large"),  # metres read as millimetres
        (6, 2.0, ""),
    ],
)
def test_sizes_that_cannot_be_meant(unit: int, size: float, words: str, tmp_path: Path) -> None:
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    for k in range(5):
        square(space, 0.2 * k * size, 0, 0.2 * (k + 1) * size, 0.2 * size, "" if k else "SUPPORT")
    document.saveas(tmp_path / "a.dxf")
    _, report = found(tmp_path / "a.dxf")
    assert ("doubtful" in report) == bool(words)
    assert words in report
    if words:
        assert f"--unit {'m' if unit == 4 else 'mm'}" in report


def loaded(document: Any, space: Any) -> None:
    """A stone of 2 × 1 m with forces on two load layers, one on a layer without a number, and one dead."""
    square(space, 0, 0, 2, 1)
    for k, x in ((1, 0.5), (2, 1.5), (10, 1.0)):
        space.add_line((x, 2), (x, 1), dxfattribs={"layer": f"LOAD {k}"})
        space.add_text(f"{k},5 kN", dxfattribs={"layer": f"LOAD {k}", "insert": (x, 1.5)})
    space.add_text("1 t", dxfattribs={"layer": "DEAD LOAD", "insert": (0.2, 0.5)})


def test_load_cases_by_layer(tmp_path: Path) -> None:
    def make(document: Any, space: Any) -> None:
        loaded(document, space)
        space.add_text("3 N", dxfattribs={"layer": "LOADS", "insert": (0.1, 0.5)})

    read = import_file(drawn(tmp_path / "a.dxf", make))
    loads = read.document["loads"]
    assert [case["name"] for case in loads["cases"]] == ["LOAD 1", "LOAD 2", "LOAD 10"]
    forces = [[entry["force"][1] for entry in case["live"]] for case in loads["cases"]]
    assert forces == [[-1500.0, -3.0], [-2500.0, -3.0], [-10500.0, -3.0]]
    assert [entry["force"] for entry in loads["dead"]] == [[0.0, -9810.0]]
    assert "live" not in loads
    parse_scene(read.document)
    assert "load cases by layer: LOAD 1, LOAD 2, LOAD 10" in str(read.report)
    assert "load case 'LOAD 2': force (0, -2500) N on element 'e2' at (1.5, 1), '2,5 kN'" in str(read.report)
    assert "act in every load case" in str(read.report)


@pytest.mark.parametrize(("text", "thickness"), [("10 kN/m", 0.5), ("20 kN/m²", 0.3), ("0,01 kN/mm", 0.5)])
def test_a_load_per_length_along_an_edge_is_a_pressure(text: str, thickness: float, tmp_path: Path) -> None:
    """20 kN/m² on 2 m: a force of 20 kN/m² × 2 m × thickness downwards on the stone below."""

    def make(_: Any, space: Any) -> None:
        square(space, 0, 0, 1, 1)
        square(space, 1, 0, 2, 1)
        space.add_line((0, 1), (2, 1), dxfattribs={"layer": "LOAD"})
        space.add_text(text, dxfattribs={"layer": "LOAD", "insert": (1, 1.1)})

    assembly, report = found(drawn(tmp_path / "a.dxf", make), thickness=thickness)
    assert assembly.live[:, 1].sum() == pytest.approx(-2e4 * 2 * thickness)
    assert "live pressure 20000 N/m² on elements e2, e3 from (0, 1) to (2, 1)" in report


@pytest.mark.parametrize(
    ("at", "text", "words"),
    [
        ((0, 1.3), "10 kN/m", ["'10 kN/m'", "along no free edge"]),
        ((0, 1), "10 kN/s", ["'10 kN/s'", "no unit of length is named 's'"]),
        ((0, 1), "10 kN/m live", ["'10 kN/m live'"]),
        ((0, 1), "10 kN and 3", ["'10 kN and 3'", "'and 3'"]),
        ((0, float("nan")), "1 kN", ["no number"]),
        ((0, 1e300), "1 kN", ["out of range"]),
        ((float("inf"), 1), "1 kN", ["no number"]),
    ],
)
def test_loads_that_cannot_be_read(
    at: tuple[float, float], text: str, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def make(_: Any, space: Any) -> None:
        square(space, 0, 0, 2, 1)
        space.add_line(at, (2, at[1]), dxfattribs={"layer": "LOAD"})
        space.add_text(text, dxfattribs={"layer": "LOAD", "insert": (1, 1.1)})

    path = drawn(tmp_path / "a.dxf", make)
    done = call(monkeypatch, capsys, "import", path, "-o", tmp_path / "a.json")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert all(word in done.err for word in words), done.err


@pytest.mark.parametrize("command", [["check"], ["solve"], ["explore", "--out", "o"]])
@pytest.mark.parametrize("name", ["a.dxf", "a.json"])
def test_commands_say_how_a_drawing_is_imported(
    command: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text('{"dtype": "compas_dem.models/BlockModel", "data": {}}')
    call(monkeypatch, capsys, command[0], name, *command[1:]).refused(f"jld import {name} -o a_scene.json")


def test_hidden_svg_groups_and_arcs_of_one_circle(tmp_path: Path) -> None:
    """Two voussoirs on either side of an arc, drawn in one and in two parts, share its chords; hidden is not read."""
    a, b, c = ((10 * math.cos(t), -10 * math.sin(t)) for t in np.radians([120, 80, 60]))
    outer = f"M {b[0]} {b[1]} A 10 10 0 0 1 {c[0]} {c[1]} L {1.2 * c[0]} {1.2 * c[1]}"
    outer += f" A 12 12 0 0 0 {1.2 * a[0]} {1.2 * a[1]} L {a[0]} {a[1]} A 10 10 0 0 1 {b[0]} {b[1]} Z"
    inner = f"M {a[0]} {a[1]} A 10 10 0 0 1 {c[0]} {c[1]} L {c[0]} -5 L {a[0]} -5 Z"
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg">'
        f'<g id="support"><path d="{inner}"/></g><path d="{outer}"/>'
        '<g id="notes" style="display:none"><rect x="0" y="-20" width="5" height="5"/></g></svg>'
    )
    assembly, _ = found(path, facet=1e-3)
    assert len(assembly.elements) == 2
    exact = 0.5 * math.radians(60) * (144 - 100)
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(exact, rel=1e-3)
    lengths = assembly.face_sizes.sum()
    assert lengths == pytest.approx(10 * math.radians(60), rel=1e-3)


def test_an_outline_within_another_is_an_element_of_its_own(tmp_path: Path) -> None:
    """A stone let into another: both keep their areas, and the one around is one block."""

    def make(_: Any, space: Any) -> None:
        square(space, 0, 0, 2, 2, "stones")
        square(space, 0.5, 0.5, 1, 1, "stones")

    assembly, report = found(drawn(tmp_path / "a.dxf", make))
    volume = assembly.elements.volume[assembly.elements.free]
    assert volume.sum() == pytest.approx(4.0)
    assert volume.min() == pytest.approx(0.25)
    assert "an outline around 1 outline" in report


def test_a_block_in_the_hole_of_another_comes_back(tmp_path: Path) -> None:
    """Eight cells of one block around a block of one: written as a drawing the hole is no opening."""
    from cases import grid_document
    from jld_core import Layout
    from jld_formats import export

    for rows in (["aaa", "aba", "aaa", "###"], ["aaa", "a.a", "aaa", "###"]):
        scene = parse_scene(grid_document(rows))
        assembly = build_assembly(scene)
        path = export(Layout(scene, assembly, assembly.labels), "dxf", tmp_path / "a.dxf")
        back, _ = found(path)
        assert sorted(back.elements.ids) == sorted(assembly.elements.ids)
        assert int(back.labels.sum()) == int(assembly.labels.sum())
        assert len(back.interfaces) == len(assembly.interfaces)


@pytest.mark.parametrize("ground", [(0.5, 0.2, 1.0, 0.6), (0.2, 0.1, 1.8, 0.3)])
def test_a_wall_around_its_support_is_no_frame(ground: tuple[float, float, float, float], tmp_path: Path) -> None:
    document = ezdxf.new(units=6)
    square(document.modelspace(), 0, 0, 3, 2, "WALL")
    square(document.modelspace(), *ground, "APPUI")
    document.saveas(tmp_path / "a.dxf")
    read = import_file(tmp_path / "a.dxf")
    x0, y0, x1, y1 = ground
    assert read.facts()["area"] == pytest.approx(6.0 - (x1 - x0) * (y1 - y0))
    assert not any("frame" in words for words in read.report.skipped)


def test_an_outline_around_a_wall_is_asked_about_by_design_too(tmp_path: Path) -> None:
    from jld_practice.design import DesignOptions, read_outline

    document = ezdxf.new(units=6)
    square(document.modelspace(), -1, -1, 7, 4.3)
    square(document.modelspace(), 0, 0, 3, 2)
    document.saveas(tmp_path / "a.dxf")
    said = read_outline(tmp_path / "a.dxf", DesignOptions()).assumed
    assert any("lies within" in words and "an opening?" in words for words in said)


@pytest.mark.parametrize(("top", "area", "count"), [(2.0, 10.0, 1), (3.0, 9.0, 2)])
def test_a_hole_of_a_hatch_that_reaches_its_outline_is_cut_out(
    top: float, area: float, count: int, tmp_path: Path
) -> None:
    """A door, and a slot from edge to edge, which leaves two pieces."""
    document = ezdxf.new(units=6)
    hatch = document.modelspace().add_hatch(dxfattribs={"layer": "MURO"})
    hatch.paths.add_polyline_path([(0, 0), (4, 0), (4, 3), (0, 3)], is_closed=True, flags=1)
    hatch.paths.add_polyline_path([(1, 0), (2, 0), (2, top), (1, top)], is_closed=True, flags=16)
    square(document.modelspace(), -1, -0.5, 5, 0, "SUELO")
    document.saveas(tmp_path / "a.dxf")
    facts = import_file(tmp_path / "a.dxf").facts()
    assert (facts["elements"], facts["area"]) == (count, pytest.approx(area))
