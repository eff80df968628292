"""The printed report: pages, numbers, languages, the cutting list and the archive."""

from __future__ import annotations

import itertools
import math
import re
import zipfile
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import shapely
from matplotlib.figure import Figure

from cases import grid_document
from command import Command, saved
from jld_core import InputError, Layout, build_assembly, parse_scene, samples, solve
from jld_practice import Printed, Stone, languages, making_of, pages_of, smallest_rectangle, stones_of, stones_table
from jld_practice.laying import assembly_order
from jld_practice.printed import draw_mould
from jld_practice.printing import least_number, stock_of
from jld_views import figures


def layout(rows: list[str]) -> Layout:
    """Layout of a grid of cells."""
    scene = parse_scene(grid_document(rows))
    assembly = build_assembly(scene)
    return Layout(scene, assembly, assembly.labels)


def texts(pages: list[Figure]) -> str:
    """All texts of the pages."""
    return "\n".join(text.get_text() for page in pages for text in page.findobj(lambda one: hasattr(one, "get_text")))


def test_the_smallest_rectangle_of_known_shapes() -> None:
    """A turned rectangle is its own, a right isosceles triangle fills half, a regular hexagon 3/4 of its rectangle."""
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    box = np.array([[0, 0], [3, 0], [3, 1], [0, 1]]) @ turn
    assert sorted(smallest_rectangle(box)) == pytest.approx([1.0, 3.0])
    triangle = np.array([[0, 0], [1, 0], [0, 1]], dtype=float) @ turn
    assert np.prod(smallest_rectangle(triangle)) == pytest.approx(1.0)
    angles = np.arange(6) * np.pi / 3
    hexagon = np.column_stack([np.cos(angles), np.sin(angles)])
    assert np.prod(smallest_rectangle(hexagon)) == pytest.approx(2.0 * np.sqrt(3.0))


def test_no_turned_rectangle_is_smaller() -> None:
    """Rectangles at 2 000 angles around random points, a second route, are never smaller, and one comes near."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        points = rng.normal(size=(12, 2)) * [2.0, 1.0]
        angles = np.linspace(0.0, np.pi / 2, 2001)
        along, across = (np.column_stack([np.cos(angles + k), np.sin(angles + k)]) for k in (0.0, np.pi / 2))
        areas = np.ptp(points @ along.T, axis=0) * np.ptp(points @ across.T, axis=0)
        best = np.prod(smallest_rectangle(points))
        assert best <= areas.min() * (1.0 + 1e-12)
        assert best == pytest.approx(areas.min(), rel=1e-2)


def test_stones_are_counted_by_hand() -> None:
    """Two rods and an L of cells 0.1 × 0.1 × 0.1: cuts, set-ups, moulds, sawn area and waste."""
    own = layout(["aabb", "accb", "#..#"])
    stones = stones_of(own)
    assert [stone.number for stone in stones] == [1, 2, 3]
    by_cells = {one.name: one for one in stones}
    assert sorted(stone.cuts for stone in stones) == [4, 6, 6]
    assert all(stone.set_ups == 2 for stone in stones)
    size = own.assembly.interfaces.l1.max()
    sums = making_of(stones)
    # an L of three cells needs a square of four, the rod wastes nothing
    assert sums.waste == pytest.approx(1.0 - 8.0 / 10.0)
    assert (sums.stones, sums.moulds, sums.cuts, sums.set_ups) == (3, 2, 16, 4)
    # perimeters: L 8 edges of a cell each, rod 6
    assert sums.sawn == pytest.approx((8 + 8 + 6) * size * own.thickness)
    assert sums.mass == pytest.approx(sum(stone.mass for stone in by_cells.values()))
    table = stones_table(own, "mm")
    assert table["side_1_mm"].max() == pytest.approx(2e3 * size)


def test_every_text_has_three_languages_with_the_same_places() -> None:
    """All languages have all keys, and fill in the same values."""
    for key, found in languages.WORDS.items():
        assert len(found) == len(languages.LANGUAGES) == 3
        places = [sorted(re.findall(r"\{(\w+)\}", text)) for text in found]
        assert places[0] == places[1] == places[2], key
    assert languages.words_in("de")["stones"] == "Steine"


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_pages_say_loads_times_the_proven_factor(language: str) -> None:
    """1 kN times a proven λ of 2.5 is 2.5 kN; what is not proven is said in the language."""
    scene = samples.flat_arch(voussoirs=5)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["loads"]["live"][0]["force"] = [0.0, -1000.0]
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    found = Layout(scene, assembly, assembly.labels)
    laying = assembly_order(assembly, assembly.labels)
    pages = pages_of(Printed(found, (2.5, 3.0), (3.0, 3.0), "collapse", laying=laying), language=language)
    assert 1 <= len(pages) <= 4
    told = texts(pages)
    assert "1 kN" in told
    assert ("2.5 kN" if language == "en" else "2,5 kN") in told
    assert languages.words_in(language)["not_strongest"] in told
    assert f"{languages.words_in(language)['page']} 1/{len(pages)}" in told


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_loads_of_a_design_are_one_row_each_in_the_language_of_the_page(language: str) -> None:
    """12 N and 4 N on two stones are 16 N at three parts to one; large masses have no exponent."""
    document = grid_document(["ab", "##"])
    document["loads"] = {
        "cases": [
            {"name": "push to the left", "live": [{"body": [-0.1, 0.0]}]},
            {
                "name": "load at 0.1",
                "live": [
                    {"element": "c0r0", "force": [0.0, -12.0], "at": [0.05, 0.2]},
                    {"element": "c1r0", "force": [0.0, -4.0], "at": [0.15, 0.2]},
                ],
            },
        ]
    }
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    laying = assembly_order(assembly, assembly.labels)
    assumed = ("supports below the lowest edges: the drawing names none", "low friction 0.4, 0.8 of 0.5")
    own = Layout(scene, assembly, assembly.labels)
    pages = pages_of(
        Printed(own, (0.5, 0.5), (0.5, 0.5), "collapse", laying=laying, assumed=assumed), language=language
    )
    told = texts(pages)
    place = languages.LANGUAGES.index(language)
    assert ("push to the left", "Schub nach links", "spinta verso sinistra")[place] in told
    assert ("0.016 kN on stones 1, 2", "0,016 kN auf den Steinen 1, 2", "0,016 kN sui conci 1, 2")[place] in told
    assert ("(0.075, 0.2) m", "(0,075; 0,2) m", "(0,075; 0,2) m")[place] in told
    assert ("from above", "von oben", "dall'alto")[place] in told
    assert ("below the lowest", "unter den tiefsten", "sotto i bordi")[place] in told
    assert "low friction" not in told
    assert languages.digits(14973.4) == "14970"
    assert "λ = 0" in texts(pages_of(Printed(own, (-np.inf, np.inf), (0.5, 0.5), "collapse"), language=language))


def test_lengths_of_edges_of_a_mould_lie_beside_them_and_apart() -> None:
    """A narrow notch has no room for the lengths of its three edges outside: some stand within."""
    ring = np.array([[0, 0], [9, 0], [9, 6], [5, 6], [5, 1], [4, 1], [4, 6], [0, 6]], dtype=float) / 10.0
    figure = Figure(figsize=(8.27, 11.69))
    ax = figure.add_axes((0.1, 0.6, 0.18, 0.1))
    draw_mould(ax, Stone(1, "a", 1, 1.0, 1.0, (1.0, 1.0, 1.0), 8, 2, 1.0, ring), 1000.0, "#dddddd")
    figure.canvas.draw()
    boxes = [shapely.box(*one.get_window_extent().extents) for one in ax.texts]
    outline = shapely.LinearRing(ax.transData.transform(1000.0 * ring))
    assert sorted(one.get_text() for one in ax.texts) == ["100", "400", "400", "500", "500", "600", "600", "900"]
    assert not any(one.intersects(other) for one, other in combinations(boxes, 2))
    assert not any(box.buffer(-1.0).intersects(outline) for box in boxes)


def test_a_locked_layout_claims_no_number() -> None:
    """Where no load is too large there is no λ × load."""
    own = layout(["ab", "##"])
    nothing = (-np.inf, np.inf)
    told = texts(pages_of(Printed(own, nothing, nothing, "locked")))
    assert languages.words_in("en")["locked"] in told
    assert "–" in told


def test_pdf_table_and_archive(jld: Command, tmp_path: Path) -> None:
    """The same scene gives the same bytes; the archive holds scene, PDF and cutting list."""
    scene = tmp_path / "arch.json"
    assert jld("new", "flat-arch", "-o", scene).code == 0
    jld("report", scene, "--pdf", "--zip", "--language", "it").done()
    first = (tmp_path / "arch.pdf").read_bytes()
    assert first.startswith(b"%PDF")
    table = pd.read_csv(tmp_path / "arch.stones.csv")
    assert len(table) == 7
    assert table["mass"].sum() == pytest.approx(stones_mass(scene))
    with zipfile.ZipFile(tmp_path / "arch.zip") as packed:
        assert sorted(packed.namelist()) == ["arch.json", "arch.pdf", "arch.stones.csv"]
    assert jld("report", scene, "--pdf", "--language", "it").code == 0
    assert (tmp_path / "arch.pdf").read_bytes() == first


def stones_mass(path: Path) -> float:
    """Mass of all free elements of a scene."""
    assembly = solve(path).assembly
    return float(assembly.elements.mass[assembly.elements.free].sum())


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ([], "--pdf: nothing is to be written"),
        (["--pdf", "--unit", "parsec"], "--unit: no unit is named 'parsec'"),
        (["--pdf", "--rank", "2"], "--rank"),
        (["--pdf", "-o", "report.txt"], "--out"),
        (["--pdf", "--language", "fr"], "--language"),
    ],
)
def test_bad_reports_are_one_line(jld: Command, tmp_path: Path, flags: list[str], words: str) -> None:
    """Every wrong option is one line with exit code 2, and nothing is written."""
    scene = tmp_path / "arch.json"
    assert jld("new", "flat-arch", "-o", scene).code == 0
    jld("report", scene, *flags).refused(words)
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]


def test_stones_in_space_have_faces_and_cuboids() -> None:
    """Boxes of 1 × 2 × 3 have six faces in three set-ups, a surface of 22, and no waste."""
    scene = parse_scene(
        {
            "elements": [
                samples.box("b", (0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
                samples.box("s", (0.0, 0.0, -1.0), (1.0, 2.0, 0.0), support=True),
            ],
            "materials": {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": 0.5}},
            "loads": {"live": [{"body": [1.0, 0.0, 0.0]}]},
        }
    )
    assembly = build_assembly(scene)
    (stone,) = stones_of(Layout(scene, assembly, assembly.labels))
    assert (stone.cuts, stone.set_ups, stone.outline) == (6, 3, None)
    assert stone.sawn == pytest.approx(22.0)
    assert stone.size == pytest.approx((3.0, 2.0, 1.0))
    told = texts(pages_of(Printed(Layout(scene, assembly, assembly.labels), (-np.inf, np.inf), (0.3, 0.3), "collapse")))
    assert languages.words_in("en")["axes"] in " ".join(told.split())


def test_moving_loads_and_pushes_are_printed() -> None:
    """A scene without stated cases or live loads: every position and direction is a row."""
    document = grid_document(["ab", "##"])
    axles = [{"weight": 10.0}]
    document["loads"] = {
        "moving": [{"name": "cart", "axles": axles, "path": [[0, 0.2], [0.2, 0.2]], "steps": 2}],
        "pushes": {"directions": 2},
    }
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    content = Printed(Layout(scene, assembly, assembly.labels), (-np.inf, np.inf), (0.5, 0.5), "collapse")
    told = texts(pages_of(content))
    for words in ("cart at 0", "push at 180°", "share of the weight"):
        assert words in told


def test_numbers_have_the_decimal_comma_of_the_language() -> None:
    assert languages.decimal_commas("das 5.062-fache bei (0.22, 0.4) m") == "das 5,062-fache bei (0,22; 0,4) m"
    assert languages.decimal_commas("jld 0.2.0, c2.5, (1, 2, 3)") == "jld 0.2.0, c2.5, (1, 2, 3)"


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_drawings_speak_the_language_of_the_page(language: str) -> None:
    """Every entry of a legend is translated, its number kept; ticks have commas, names of stones their points."""
    own = layout(["aabb", "accb", "#..#"])
    page = Figure()
    ax = page.add_subplot()
    figures.draw_assembly(ax, own.assembly, own.labels)
    name = page.text(0.0, 0.0, "1.5")
    legend = ax.get_legend()
    before = [one.get_text() for one in legend.get_texts()]
    languages.localise(page, language, {"1.5"})
    after = [one.get_text() for one in legend.get_texts()]
    assert name.get_text() == "1.5"
    if language == "en":
        assert after == before
        return
    place = languages.LANGUAGES.index(language) - 1
    assert all(any(one.endswith(known) for known in languages.LEGEND) for one in before)
    assert all(any(one.endswith(words[place]) for words in languages.LEGEND.values()) for one in after)
    assert ax.xaxis.get_major_formatter()(0.5, 0) == "0,5"


def test_a_stronger_uncut_structure_is_reported() -> None:
    """By faces the cuts win, by fields they lose: the page has both sentences."""
    own = layout(["aabb", "accb", "#..#"])
    page = texts(pages_of(Printed(own, (5.0, 7.1), (12.0, 12.0), "collapse", uncut=11.5, uncut_by_fields=7.2)))
    assert "11.5 times" in page.replace("\n", " ")
    assert "at least 7.2" in page.replace("\n", " ")
    page = texts(pages_of(Printed(own, (5.0, 7.3), (12.0, 12.0), "collapse", uncut_by_fields=7.2)))
    assert "without these cuts" not in page.replace("\n", " ")


@pytest.mark.parametrize("language", languages.LANGUAGES)
def test_heads_of_columns_do_not_overlap(language: str) -> None:
    """Each head of the table of stones ends before the next begins."""
    page = pages_of(Printed(layout(["ab", "##"]), (1.0, 1.0), (1.0, 1.0), "collapse"), language=language)[1]
    words = {
        languages.words_in(language)[key] for key in ("stone", "block", "mould", "mass", "cuts", "set_ups", "waste")
    }
    words.add(languages.words_in(language)["size"] + " [mm]")
    boxes = sorted((one.get_window_extent() for one in page.texts if one.get_text() in words), key=lambda box: box.x0)
    assert len(boxes) == len(words)
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


@pytest.mark.parametrize(
    "units",
    [
        ("m", "N", 1.0, 1.0, 9.81),
        ("mm", "kN", 1e-3, 1e-3, 9.81),
        ("m", "kN", 1.0, 1e-3, 9.81),
        ("mm", "N", 1e-3, 1.0, 9810.0),
    ],
)
def test_materials_are_printed_in_units_of_the_trade(units: tuple[str, str, float, float, float]) -> None:
    """2 N/mm², 1400 kg/m³ and masses in kg are the same on paper, whatever the units of the scene."""
    length, force, metre, newton, gravity = units
    document = grid_document(["ab", "##"], tension=2e6 * newton * metre**2, shear=1e6 * newton * metre**2)
    document["units"] = {"length": length, "force": force}
    document["materials"] |= {"density": 1400.0 * newton * metre**3 * 9.81 / gravity, "gravity": gravity}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    own = Layout(scene, assembly, assembly.labels)
    told = texts(pages_of(Printed(own, (1.0, 1.0), (1.0, 1.0), "collapse")))
    assert "2 and 1 N/mm²" in told or "2 N/mm² and 1 N/mm²" in told
    assert "1400 kg/m³" in told
    stones = stones_table(own, "mm")
    assert stones["mass"].sum() == pytest.approx(1400.0 * metre**3 * assembly.elements.volume[:2].sum())
    assert " kg" in told


# Stones in stock cuboids: places are valid, the number of cuboids is proven from below, bad input is one line.


def stone(number: int, *sides: float) -> Stone:
    """A cuboid."""
    size = tuple(sorted(sides, reverse=True))
    return Stone(number, f"s{number}", 1, 1.0, math.prod(sides), size, 6, 3, 1.0, None)


def apart(one: Any, other: Any, kerf: float) -> bool:
    """Return True if two stones of one cuboid leave room for a cut."""
    sides = zip(one.corner, one.sides, other.corner, other.sides, strict=True)
    return any(p + a + kerf <= q + 1e-9 or q + b + kerf <= p + 1e-9 for p, a, q, b in sides)


@pytest.mark.parametrize("kerf", [0.0, 0.01])
def test_stones_lie_in_the_stock_and_apart(kerf: float) -> None:
    """No stone leaves its cuboid, none meets another, sides are those of the stone; the bound is never exceeded."""
    rng = np.random.default_rng(1)
    for _ in range(8):
        stones = [stone(k, *rng.uniform(0.1, 0.9, 3)) for k in range(1, 15)]
        found = stock_of(stones, (1.0, 1.2, 0.95), kerf)
        assert sorted(one.stone for one in found.placed) == list(range(1, 15))
        for one in found.placed:
            assert sorted(one.sides, reverse=True) == pytest.approx(stones[one.stone - 1].size)
            ends = [at + side for at, side in zip(one.corner, one.sides, strict=True)]
            assert all(end <= side * (1.0 + 1e-9) for end, side in zip(ends, found.size, strict=True))
        for one, other in itertools.combinations(found.placed, 2):
            assert one.cuboid != other.cuboid or apart(one, other, kerf)
        assert found.least <= found.cuboids
        assert found.least_waste <= found.waste


def test_known_packings() -> None:
    """Eight half cubes fill one cube, four slabs of a quarter too; with a kerf the fourth slab has no room."""
    cubes = stock_of([stone(k, 0.5, 0.5, 0.5) for k in range(8)], (1.0, 1.0, 1.0))
    assert (cubes.cuboids, cubes.least) == (1, 1)
    assert cubes.waste == pytest.approx(0.0, abs=1e-12)
    slabs = [stone(k, 1.0, 1.0, 0.25) for k in range(4)]
    assert stock_of(slabs, (1.0, 1.0, 1.0)).cuboids == 1
    assert stock_of(slabs, (1.0, 1.0, 1.0), 0.01).cuboids == 2


@pytest.mark.parametrize(
    ("volumes", "expected"),
    [([0.6] * 5, 5), ([0.5] * 5, 3), ([0.7, 0.7, 0.35, 0.35, 0.35], 4), ([0.2] * 10, 2), ([], 0)],
)
def test_the_least_number_of_known_cases(volumes: list[float], expected: int) -> None:
    """Martello and Toth's L2; no assignment of volumes to fewer cuboids exists, by trying all of them."""
    assert least_number(volumes, 1.0) == expected
    owners = itertools.product(range(expected - 1), repeat=len(volumes)) if 0 < len(volumes) < 8 else ()
    for owner in owners:
        assert max(np.bincount(owner, volumes, minlength=1)) > 1.0 + 1e-9


def test_the_command_writes_where_stones_lie(jld: Command, tmp_path: Path) -> None:
    """The table holds every stone in millimetres; the line says number, bound and waste."""
    scene = saved(tmp_path / "wall.json", parse_scene(grid_document(["aab", "ccb", "###"])))
    done = jld("report", scene, "--pdf", "--stock", "10000,10000,10000", "--kerf", "5").done()
    assert "1 stock cuboid, the least number; waste" in done.out
    table = pd.read_csv(tmp_path / "wall.stock.csv")
    assert len(table) == 3
    assert (table["at_1_mm"] + table["side_1_mm"]).max() <= 10000.0


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--pdf", "--stock", "1,2"], "--stock: '1,2' is wrong"),
        (["--pdf", "--stock", "1,2,x"], "--stock: '1,2,x' is wrong"),
        (["--zip", "--stock", "1,2,3"], "--stock: stones are placed beside the cutting list"),
        (["--pdf", "--kerf", "3"], "--kerf: it is given without"),
        (["--pdf", "--stock", "1,1,1"], "mm does not fit into 1 × 1 × 1 mm"),
        (["--pdf", "--stock=-1,1,1"], "--stock: a side is not above 0"),
        (["--pdf", "--stock", "9000,9000,9000", "--kerf=-1"], "--kerf: it is no width of a cut"),
        (["--pdf", "--stock", "1e300,1e300,1e300"], "--stock: the volume of a cuboid is out of range"),
    ],
)
def test_bad_stock_is_one_line(jld: Command, tmp_path: Path, flags: list[str], words: str) -> None:
    """Exit code 2, one line, nothing written."""
    scene = saved(tmp_path / "wall.json", parse_scene(grid_document(["aab", "ccb", "###"])))
    jld("report", scene, *flags).refused(words)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["wall.json"]


def test_a_stone_that_does_not_fit_is_named() -> None:
    """The message has the stone and its sides."""
    with pytest.raises(InputError, match="stone 3 of 2 × 1 × 1 does not fit into"):
        stock_of([stone(3, 1.0, 2.0, 1.0)], (1.5, 1.5, 1.5))
    with pytest.raises(InputError, match="of 200 × 100 × 100 cm does not fit into 150 × 150 × 150 cm"):
        stock_of([stone(3, 1.0, 2.0, 1.0)], (1.5, 1.5, 1.5), said=(100.0, " cm"))
