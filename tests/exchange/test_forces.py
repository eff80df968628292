"""Forces written as text: every spelling that is read, and that nothing else is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cases import box
from cases import scene_in_space as scene
from command import Command, refused
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_formats import forces, import_file


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("10 kN", (1e4,)),
        ("10kN", (1e4,)),
        ("10 KN", (1e4,)),
        ("2,5 kN", (2500.0,)),
        ("2,5", (2.5,)),
        ("2.5", (2.5,)),
        ("-2.5e3 N", (-2500.0,)),
        (".5 MN", (5e5,)),
        (",5 MN", (5e5,)),
        ("7 daN", (70.0,)),
        ("1 t", (9810.0,)),
        ("500 kg", (4905.0,)),
        ("100 kgf", (980.665,)),
        ("1 lbf", (4.4482216152605,)),
        ("2 kips", (8896.443230521,)),
        ("F1 = 10 kN", (1e4,)),
        ("F1=10 kN", (1e4,)),
        ("H: 250 N", (250.0,)),
        ("  F1 =\n10 kN ", (1e4,)),
        ("q.left = 3", (3.0,)),
        ("3, -4", (3.0, -4.0)),
        ("3,-4", (3.0, -4.0)),
        ("3; 4", (3.0, 4.0)),
        ("3 kN; -4,5 kN", (3000.0, -4500.0)),
        ("3,5, 4,5", (3.5, 4.5)),
        ("Fx = 3 kN, Fy = -4 kN", (3000.0, -4000.0)),
        ("Fy = -4 kN; Fx = 3 kN", (3000.0, -4000.0)),
        ("fx = 3", (3.0, 0.0)),
        ("F_y = 3", (0.0, 3.0)),
    ],
)
def test_spellings(text: str, values: tuple[float, ...]) -> None:
    found = forces.parse_force(text)
    assert found.values == pytest.approx(values, rel=1e-15)
    assert found.components == (len(values) == 2)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("10 kN/m", "per length"),
        ("10 kN / m²", "per length"),
        ("10 N/mm", "per length"),
        ("1,000 kN", "thousands"),
        ("100,200", "thousands"),
        ("1 000 N", "'000 N'"),
        ("1.000,5 N", "',5 N'"),
        ("10 mN", "'mN'"),
        ("10 T", "'T'"),
        ("10 furlong", "'furlong'"),
        ("F1 10 kN", "no force"),
        ("10 kN wind", "'wind'"),
        ("10 kN (live)", "'(live)'"),
        ("10 kN + 2 kN", "'+ 2 kN'"),
        ("3 kN; 4", "not all of its numbers have a unit"),
        ("1; 2; 3", "3 numbers"),
        ("Fx = 3; 4", "name no component"),
        ("1e999 N", "out of range"),
        ("10 kN;", "nothing"),
        ("wind", "no force"),
        ("", "no force"),
        ("nan", "no force"),
        ("10 kN 5", "'5'"),
        ("2*5", "'*5'"),
    ],
)
def test_unparsed_rests_of_force_texts_are_refused_and_quoted(text: str, problem: str) -> None:
    with refused(problem, " ".join(repr(text).split())):
        forces.parse_force(text)


def test_the_unit_of_the_scene_is_the_unit_of_the_result() -> None:
    assert forces.parse_force("10 kN", "kN").values == (10.0,)
    assert forces.parse_force("1 t", "kN").values == pytest.approx((9.81,))
    assert forces.parse_force("7", "kN").values == (7.0,)
    assert forces.parse_force("7", "blocks").values == (7.0,)
    with pytest.raises(InputError, match="that of the scene"):
        forces.parse_force("7 N", "blocks")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1 kN; 2 kN; -3 kN", (1e3, 2e3, -3e3)),
        ("Fz = -4; Fx = 1", (1.0, 0.0, -4.0)),
        ("Fz = 5 kN", (0.0, 0.0, 5e3)),
        ("5 kN", (5e3,)),
    ],
)
def test_forces_in_space(text: str, values: tuple[float, ...]) -> None:
    found = forces.parse_force(text, dimension=3)
    assert (found.values, found.components) == (values, len(values) == 3)


@pytest.mark.parametrize(
    ("text", "dimension", "problem"),
    [("1; 2", 3, "2 numbers for 3"), ("Fz = 1", 2, "no component along z"), ("Fx = 1; Fx = 2", 3, "or the same one")],
)
def test_components_that_do_not_fit(text: str, dimension: int, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        forces.parse_force(text, dimension=dimension)


@pytest.mark.parametrize(
    ("text", "per"),
    [("10 kN/m", (1.0, 1)), ("10 N/mm²", (1e-3, 2)), ("F = 1 kN / m^2", (1.0, 2)), ("3 lbf/ft", (0.3048, 1))],
)
def test_loads_per_length_or_area(text: str, per: tuple[float, int]) -> None:
    assert forces.parse_force(text, distributed=True).per == per


# What is equally near is shared, or asked for; the order in which things were drawn decides nothing.


ezdxf = pytest.importorskip("ezdxf")

Box = tuple[float, float, float, float]
PIER: list[Box] = [(0, 0, 1, 1), (1, 0, 2, 1), (0, 1, 1, 2), (1, 1, 2, 2)]


def drawn(path: Path, boxes: list[Box], lines: Any = (), texts: Any = (), *, back: bool) -> dict[str, Any]:
    """Draw boxes on one support, lines and texts on the layer of loads, forwards or backwards, and import them."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    layer = {"layer": "LOADS"}
    way = -1 if back else 1
    for text, at in texts[::way]:
        space.add_text(text, dxfattribs={**layer, "insert": at})
    for ends in lines[::way]:
        space.add_line(*ends, dxfattribs=layer)
    for one in boxes[::way]:
        space.add_lwpolyline(ring(one), close=True)
    space.add_lwpolyline(ring((-1, -1, 9, 0)), close=True, dxfattribs={"layer": "SUPPORTS"})
    document.saveas(path)
    return import_file(path).document


def ring(box: Box) -> list[tuple[float, float]]:
    x0, y0, x1, y1 = box
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def loads(document: dict[str, Any]) -> list[tuple[float, ...]]:
    """Forces with the place of the element that each acts on, in order."""
    corner = {one["id"]: min(map(tuple, one["polygon"])) for one in document["elements"]}
    return sorted((*corner[one["element"]], *one["force"]) for one in document["loads"]["live"])


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (("8, -4", (1.0, 1.0)), [(x, y, 2.0, -1.0) for x in (0.0, 1.0) for y in (0.0, 1.0)]),  # common corner
        (("8, -4", (1.0, 2.0)), [(0.0, 1.0, 4.0, -2.0), (1.0, 1.0, 4.0, -2.0)]),  # upper end of a joint
        (("8, -4", (1.0, 2.5)), [(0.0, 1.0, 4.0, -2.0), (1.0, 1.0, 4.0, -2.0)]),  # above it, touching none
        (("8, -4", (0.5, 2.0)), [(0.0, 1.0, 8.0, -4.0)]),
    ],
)
def test_elements_that_are_equally_near_share_a_force(text: Any, expected: list[Any], tmp_path: Path) -> None:
    found = [drawn(tmp_path / f"{back}.dxf", PIER, texts=[text], back=back) for back in (False, True)]
    assert loads(found[0]) == loads(found[1]) == expected
    values = [solve(build_assembly(parse_scene(document))).load_factor for document in found]
    assert values[0] == pytest.approx(values[1], rel=1e-9)


@pytest.mark.parametrize(("back", "at"), [(False, (1, 1, 1)), (True, (1, 1, 1)), (True, (1, 1, 1.5))])
def test_solids_that_are_equally_near_share_a_force(back: bool, at: Any, tmp_path: Path) -> None:
    rhino = pytest.importorskip("rhino3dm")
    file = rhino.File3dm()
    file.Settings.ModelUnitSystem = rhino.UnitSystem.Meters
    for name in ("stones", "supports", "LOADS"):
        layer = rhino.Layer()
        layer.Name = name
        file.Layers.Add(layer)

    def attributes(layer: int, name: str = "") -> Any:
        found = rhino.ObjectAttributes()
        found.LayerIndex, found.Name = layer, name
        return found

    cells = [(x, y) for x in (0, 1) for y in (0, 1)]
    for x, y in cells[::-1] if back else cells:
        box = rhino.Brep.CreateFromBox(rhino.Box(rhino.BoundingBox(x, y, 0, x + 1, y + 1, 1)))
        file.Objects.AddBrep(box, attributes(0, f"s{x}{y}"))
    ground = rhino.Brep.CreateFromBox(rhino.Box(rhino.BoundingBox(0, 0, -1, 2, 2, 0)))
    file.Objects.AddBrep(ground, attributes(1, "ground"))
    file.Objects.AddTextDot("8 N", rhino.Point3d(*at), attributes(2))
    path = tmp_path / "four.3dm"
    assert file.Write(str(path), 8)
    live = import_file(path).document["loads"]["live"]
    assert {one["element"]: one["force"][2] for one in live} == dict.fromkeys(("s00", "s01", "s10", "s11"), -2.0)


def test_the_closest_line_takes_a_text_whichever_was_drawn_first(tmp_path: Path) -> None:
    """A text between two arrows belongs to the nearer one, and the other text is left for the farther one."""
    lines = [((0.5, 3.0), (0.5, 2.0)), ((1.5, 3.0), (1.5, 2.0))]
    texts = [("6 N", (1.1, 2.5)), ("2 N", (0.6, 2.5))]
    for back in (False, True):
        document = drawn(tmp_path / f"{back}.dxf", PIER, lines, texts, back=back)
        assert loads(document) == [(0.0, 1.0, 0.0, -2.0), (1.0, 1.0, 0.0, -6.0)]


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize(
    ("texts", "words"),
    [
        ([("6 N", (1.0, 2.5))], "equally far from two lines"),
        ([("6 N", (0.25, 2.5)), ("2 N", (0.75, 2.5))], "equally far from the same line"),
    ],
)
def test_texts_that_may_belong_to_two_lines_are_asked_for(
    texts: list[Any], words: str, back: bool, tmp_path: Path
) -> None:
    lines = [((0.5, 3.0), (0.5, 2.0)), ((1.5, 3.0), (1.5, 2.0))]
    with refused(match=words):
        drawn(tmp_path / "asked.dxf", PIER, lines, texts, back=back)


# A load on a block that is joined to a support: a file of blocks that could not be read again is not written.


@pytest.mark.parametrize("kind", ["compas", "compas_dem"])
@pytest.mark.parametrize("glued", [True, False])
def test_export_and_import_agree(kind: str, glued: bool, tmp_path: Path, jld: Command) -> None:
    """Both accept a load on the lower of two blocks, or both refuse it."""
    elements = [
        box("S", [0, 0, -1], [2, 1, 0], support=True),
        box("B", [0, 0, 0], [1, 1, 1]),
        box("C", [0, 0, 1], [1, 1, 2]),
    ]
    live = [{"element": name, "force": [1, 0, 0]} for name in ("B", "C")]
    source, target, back = tmp_path / "s.json", tmp_path / "blocks.json", tmp_path / "back.json"
    source.write_text(json.dumps(scene(elements, live=live, labels={"inner": [["S", "B"]]} if glued else {})))
    written = jld("export", source, "--format", kind, "-o", target)
    if glued:
        assert written.code == 2
        assert "element 'B': it carries a load and is joined to a support" in written.err
        assert not target.exists()
    else:
        assert written.code == 0
        assert jld("import", target, "-o", back).code == 0
