"""Doors of files: one reader for import, design and studio; gaps, springings, layers, what is said."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import pytest

from command import Command, refused
from files.make import File, shelf
from jld_core import InputError, build_assembly, parse_scene
from jld_core.scene import units
from jld_formats import ImportOptions, import_file
from jld_formats import options as options_of_exchange
from jld_practice.design import DesignOptions, read_outline
from jld_studio import server

ezdxf = pytest.importorskip("ezdxf")


def drawing(path: Path, draw: Any, unit: int = 6) -> Path:
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    draw(document.modelspace())
    document.saveas(path)
    return path


def box(space: Any, x0: float, y0: float, x1: float, y1: float, layer: str = "0") -> None:
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})


def lines(space: Any, gap: float) -> None:
    """A wall of 2 × 1 by four lines, with a gap at its upper right corner."""
    for a, b in (((0, 0), (2, 0)), ((2, 0), (2, 1)), ((2 - gap, 1), (0, 1)), ((0, 1), (0, 0))):
        space.add_line(a, b)


OUTLINE = "id,x,y,layer\n" + "".join(f"wänd,{x},{y},wänd\n" for x, y in ((0, 0), (2, 0), (2, 1), (0, 1)))
PAGE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 2"><rect x="25%" width="50%" height="50%"/></svg>'
CUBE = [f"v {x} {y} {z}" for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
SIDES = ["1 4 3 2", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
MARKED: dict[str, tuple[str, list[str]]] = {
    "csv": (OUTLINE, ["utf-8-sig", "utf-16", "cp1252"]),
    "svg": (PAGE.replace("<rect", "<title>wänd</title><rect"), ["utf-8-sig", "utf-16", "cp1252"]),
    "obj": ("\n".join([*CUBE, *(f"f {side}" for side in SIDES)]), ["utf-8-sig", "utf-16"]),
}


@pytest.mark.parametrize(("kind", "encoding"), [(kind, one) for kind, (_, every) in MARKED.items() for one in every])
def test_texts_are_read_as_programs_write_them(kind: str, encoding: str, tmp_path: Path) -> None:
    """A mark before the first line was part of it: the first vertex of an OBJ was lost, and a DXF was damaged."""
    path = tmp_path / f"a.{kind}"
    path.write_bytes(MARKED[kind][0].replace("\n", "\r\n").encode(encoding))
    found = import_file(path, ImportOptions(support=("lowest",), unit="m")).facts()
    assert found.get("area", found.get("volume")) == pytest.approx({"csv": 2.0, "svg": 2.0, "obj": 1.0}[kind])


def test_a_mark_before_a_drawing_is_no_damage(tmp_path: Path) -> None:
    path = drawing(tmp_path / "a.dxf", lambda space: box(space, 0, 0, 2, 1))
    path.write_text(path.read_text("utf-8"), encoding="utf-8-sig")
    assert import_file(path, ImportOptions(support=("lowest",))).facts()["area"] == pytest.approx(2.0)


@pytest.mark.parametrize("count", [0, 10, 10**9])
def test_a_wrong_number_of_triangles_is_named(count: int, tmp_path: Path) -> None:
    """Also where the header begins as that of a text."""
    path = tmp_path / "a.stl"
    path.write_bytes(b"solid x".ljust(80) + count.to_bytes(4, "little") + bytes(50 * 12))
    with pytest.raises(InputError, match=f"its header promises {count} triangles in 684 bytes"):
        import_file(path)


@pytest.mark.parametrize("gap", [1e-5, 1e-4, 9e-4])
def test_small_gaps_are_closed_and_named_by_import_and_design_alike(gap: float, tmp_path: Path) -> None:
    path = drawing(tmp_path / "a.dxf", lambda space: lines(space, gap))
    scene = read_outline(path, DesignOptions()).scene
    assert build_assembly(scene).elements.free.tolist() == [0]
    found = import_file(path, ImportOptions(support=("lowest",)))
    assert found.facts()["area"] == pytest.approx(2.0, rel=1e-3)
    assert any(f"1 gap closed, it is {gap:.3g} m wide, at (" in words for words in found.report.snapped)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("gap", [0.002, 0.0137, 0.09])
def test_wide_gaps_say_how_wide_and_what_closes_them(gap: float, tmp_path: Path) -> None:
    path = drawing(tmp_path / "a.dxf", lambda space: lines(space, gap))
    for read in (
        lambda **how: read_outline(path, DesignOptions(**how)),
        lambda **how: import_file(path, ImportOptions(support=("lowest",), **how)),
    ):
        with pytest.raises(InputError, match=f"not closed: 1 gap, it is {gap:.3g} m wide, at \\(") as caught:
            read()
        tolerance = float(str(caught.value).partition("--tolerance ")[2].split()[0])
        assert gap < tolerance < 1.2 * gap
        read(tolerance=tolerance)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("drawn", ["outline", "lines"])
@pytest.mark.parametrize("rings", [1, 2])
@pytest.mark.parametrize(("embrace", "skew"), [(40, 0.0), (60, 0.1), (90, -0.05), (120, 0.0), (150, 0.1), (180, 0.0)])
def test_arches_stand_at_their_springings(embrace: float, skew: float, rings: int, drawn: str, tmp_path: Path) -> None:
    """Bands between two arcs, with radial or skew ends: each end has a support of its own length."""
    half, thick = math.radians(embrace / 2), 0.3

    def point(radius: float, side: int) -> tuple[float, float]:
        angle = math.pi / 2 - side * (half + skew * (radius - 2.0) / (rings * thick))
        return radius * math.cos(angle), radius * math.sin(angle)

    def draw(space: Any) -> None:
        radii = [2.0 + thick * k for k in range(rings + 1)]
        for low, high in itertools.pairwise(radii):
            arc, other = (math.tan((half + skew * (r - 2.0) / (rings * thick)) / 2) for r in (low, high))
            if drawn == "outline":
                corners = [
                    (*point(low, 1), arc),
                    (*point(low, -1), 0),
                    (*point(high, -1), -other),
                    (*point(high, 1), 0),
                ]
                space.add_lwpolyline(corners, format="xyb", close=True)
            else:
                for side in (-1, 1):
                    space.add_line(point(low, side), point(high, side))
        for radius in radii if drawn == "lines" else ():
            ends = [math.degrees(math.atan2(*point(radius, side)[::-1])) for side in (1, -1)]
            space.add_arc((0, 0), radius, *ends)

    path = drawing(tmp_path / "arch.dxf", draw)
    for scene in (
        read_outline(path, DesignOptions()).scene,
        *([parse_scene(import_file(path, ImportOptions(support=("lowest",))).document)] if rings == 1 else []),
    ):
        assembly = build_assembly(scene)
        supports = assembly.elements.support
        assert supports.sum() >= 2
        lengths = assembly.face_sizes[supports[assembly.interfaces.a] | supports[assembly.interfaces.b]]
        ends = 2.0 * math.dist(point(2.0, 1), point(2.0 + rings * thick, 1))
        assert lengths.sum() == pytest.approx(ends, rel=0.02)


def wall(space: Any) -> None:
    box(space, 0, 0, 3, 2, "WALL")
    box(space, 1, 0.8, 2, 1.4, "X1")
    box(space, 3, 0, 4, 2, "ANBAU")
    box(space, 0, -0.3, 4, 0, "G")


def test_layers_of_import_design_and_studio(tmp_path: Path, jld: Command) -> None:
    path, out = drawing(tmp_path / "a.dxf", wall), tmp_path / "a.json"
    layers = ["--skip", "ANB*", "--hole", "X1", "--support", "G"]
    told = json.loads(jld("import", path, "-o", out, "--json", *layers).out)
    assert (told["elements"], told["supports"], told["area"], told["unit"]) == (2, 1, pytest.approx(5.4), "m")
    assert (told["size"], told["doubtful"]) == ([pytest.approx(4.0), pytest.approx(2.3)], [])
    assert any("on layer ANBAU" in words for words in told["dropped"])
    options = {"skip": ("ANB*",), "hole": ("X1",), "support": ("G",)}
    scene = read_outline(path, DesignOptions(**options)).scene
    assert sum(not entry.support for entry in scene.elements) == 2
    said: list[str] = []
    scene, _, _ = server.opened(path, ImportOptions(**options), said.append)
    assert len(scene.elements) == 3
    assert said[0].startswith("found        2 elements and 1 support, area 5.4 m²; 4 × 2.3 m in all")


@pytest.mark.parametrize("option", ["layer", "skip", "hole", "load", "dry", "inner"])
def test_a_layer_that_is_not_there_is_refused(option: str, tmp_path: Path) -> None:
    path = drawing(tmp_path / "a.dxf", wall)
    with pytest.raises(InputError, match=f"{option}: no layer of the file is like 'FENSTER'; expected one of 0, ANBAU"):
        import_file(path, ImportOptions(support=("G",), **{option: ("FENSTER",)}))


def test_design_takes_a_force_or_layers_as_load(tmp_path: Path, jld: Command) -> None:
    path = drawing(tmp_path / "a.dxf", wall)
    done = jld("design", path, "-o", tmp_path / "o", "--load", "1 kN", "--load", "2 kN")
    assert (done.code, done.err) == (
        2,
        "jld: --load: 2 forces are given; expected one force, which may act at several places\n",
    )
    done = jld("design", path, "-o", tmp_path / "o", "--load", "LASTEN")
    assert "no layer of the file is like 'LASTEN'" in done.err


def test_less_than_nine_tenths_is_doubtful(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        box(space, 0, 0, 1, 1)
        box(space, 0, -0.3, 1, 0, "SUPPORTS")
        for k in range(3):
            space.add_line((5 + k, 5), (6 + k, 6))

    doubts = import_file(drawing(tmp_path / "a.dxf", draw)).report.doubtful
    assert doubts == ("only 40 % of the entities were read; the others are listed as skipped",)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Rundfenster EG", "hole"), ("TÜREN", "hole"), ("A-WALL-OPNG", "hole"), ("A-32----E-", "hole"),
        ("puertas", "hole"),
        ("Streifenfundamente", "support"), ("S-FNDN", "support"), ("A-G21---E-", "support"), ("appuis", "support"),
        ("A-GRID-IDEN", "skip"), ("GRID", None), ("Achse_12", "skip"), ("Bemaßung", "skip"), ("A-21----T-", "skip"),
        ("Arco di scarico", None), ("Structure", None), ("MAUERWERK", None), ("GESAMTLASTEN 2", None),
        ("Windlast", "load"), ("Lastfall Schnee", "load"), ("Nutzlast 1", "load"), ("Plastik", None),
        ("LASTEN 2", "load"),
        ("Eigengewicht", "dead"), ("Stoßfugen", "dry"), ("RISSE", "inner"), ("ids", "id"), ("Assembly", None),
    ],
)  # fmt: skip
def test_roles_by_name(name: str, role: str | None) -> None:
    assert options_of_exchange.role_by_name(name) == role


# Files of other programs come in as they were drawn: number, size, unit, what is doubtful and what is dropped.


for library in ("ezdxf", "svgelements", "meshio", "rhino3dm", "ifcopenshell"):
    pytest.importorskip(library)
SHELF = shelf()


@pytest.mark.sampled(10)
@pytest.mark.parametrize("file", SHELF, ids=[file.name for file in SHELF])
def test_file(file: File, tmp_path: Path) -> None:
    path = tmp_path / file.name
    file.write(path)
    if file.refused:
        with refused(file.refused):
            import_file(path, ImportOptions(**file.options))
        return
    found = import_file(path, ImportOptions(**file.options))
    build_assembly(parse_scene(found.document))
    facts = found.facts()
    amount = facts.get("area", facts.get("volume"))
    near = pytest.approx(file.amount, rel=5e-3)
    assert (facts["elements"], facts["unit"], amount) == (file.elements, file.unit, near), found.report
    assert any(file.doubtful in words for words in facts["doubtful"]) == bool(file.doubtful), facts["doubtful"]
    assert any(file.dropped in words for words in facts["dropped"]) or not file.dropped, facts["dropped"]
    if file.whole is not None:
        entries = [{**entry, "support": False} for entry in found.document["elements"]]
        size = units.METRES[file.unit] ** (2 if "area" in facts else 3)
        assert options_of_exchange.measure(entries).amount == pytest.approx(size * file.whole(path), rel=5e-3)


def test_the_shelf_is_large_and_its_files_are_small(tmp_path: Path) -> None:
    assert len(SHELF) >= 120
    assert len({file.name for file in SHELF}) == len(SHELF)
