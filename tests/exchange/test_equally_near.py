"""What is equally near is shared, or asked for; the order in which things were drawn decides nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.exchange import import_file

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
    for box in boxes[::way]:
        space.add_lwpolyline(ring(box), close=True)
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
    with pytest.raises(InputError, match=words) as complaint:
        drawn(tmp_path / "asked.dxf", PIER, lines, texts, back=back)
    assert "\n" not in str(complaint.value)
