"""Printed report of one layout: picture, loads, stones, moulds, laying and what is proven."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

import jld_core
from jld_core import Floats, Layout, Scene, files
from jld_core.build import cases_of_scene, weight_facts
from jld_core.geometry import area_vector, outlines
from jld_core.geometry import outlines as polygons
from jld_core.scene import loads as scene_loads
from jld_core.scene import uncertain, units
from jld_practice import languages
from jld_practice.laying import Laying
from jld_views import figures as views_figures
from jld_views import look, writing

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Stone:
    """One block as a workshop sees it; lengths in the units of the scene, mass in kg where these are known."""

    number: int  # number that stands on the stone, from 1
    name: str  # name of the block
    shape: int  # number of its mould
    mass: float
    volume: float
    # sides of the smallest cuboid around it, the longest first; planar: of those with the thickness as one side, in
    # space along the axes of the scene
    size: tuple[float, ...]
    cuts: int  # sawn faces, without the two sides of a planar stone
    set_ups: int  # directions of these faces
    sawn: float  # area of these faces
    outline: Floats | None  # (k, 2) outline of a planar stone about its centroid

    @property
    def stock(self) -> float:
        return float(np.prod(self.size))


def stones_of(layout: Layout) -> list[Stone]:
    """Return the stones, numbered in the order of `blocks.csv`."""
    stones = []
    members = {block.name: k for k, block in enumerate(layout.blocks)}
    for number, block in enumerate((candidate for candidate in layout.blocks if candidate.cells), 1):
        k = members[block.name]
        if layout.assembly.dimension == 2:
            rings = [ring for region in layout.regions[k] for ring in (region.shell, *region.holes)]
            edges = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
            lengths = np.hypot(*edges.T)
            directions, sawn = edges / lengths[:, None], float(lengths.sum()) * layout.thickness
            outline: Floats | None = layout.regions[k][0].shell - np.array(block.centroid)
            flat = smallest_rectangle(np.concatenate([region.shell for region in layout.regions[k]]))
            sides = [*flat, layout.thickness]
        else:
            surface = layout.surfaces[k][0]
            areas = np.array([area_vector(surface.points[list(face)]) for face in surface.faces])
            directions, sawn = (
                areas / np.linalg.norm(areas, axis=1)[:, None],
                float(np.linalg.norm(areas, axis=1).sum()),
            )
            outline = None
            sides = [high - low for low, high in zip(block.lower, block.upper, strict=True)]
        shape_facts = (len(directions), outlines.different_lines(directions), sawn, outline)
        size = tuple(sorted(sides, reverse=True))
        mass = block.mass * (layout.assembly.kilograms or 1.0)
        stones.append(Stone(number, block.name, block.shape, mass, block.volume, size, *shape_facts))
    return stones


def smallest_rectangle(points: Floats) -> tuple[float, float]:
    """Return the sides of the rectangle of least area around points (k, 2)."""
    # one side lies along an edge of the hull (Freeman and Shapira 1975, Communications of the ACM 18, 409–413)
    hull = polygons.hull(points)
    edges = np.roll(hull, -1, axis=0) - hull
    along = edges / np.hypot(*edges.T)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    spans = np.ptp(hull @ along.T, axis=0), np.ptp(hull @ across.T, axis=0)
    best = int(np.argmin(spans[0] * spans[1]))
    return float(spans[0][best]), float(spans[1][best])


@dataclass(frozen=True)
class Making:
    """Sums over all stones of a layout, in the units of the scene."""

    # stones, moulds: numbers of stones and of different shapes
    stones: int
    moulds: int
    # cuts, set_ups: sawn faces, and set-ups of the saw where equal stones are sawn together
    cuts: int
    set_ups: int
    # sawn, volume, stock: sawn area, volume of stone, and volume of the smallest cuboids, one for each stone
    sawn: float
    volume: float
    stock: float
    # mass, heaviest: mass of all stones, and of the heaviest
    mass: float
    heaviest: float

    @property
    def waste(self) -> float:
        """Share of the stock that is lost; for planar stones the least of any choice of cuboids."""
        return 1.0 - self.volume / self.stock


def making_of(stones: list[Stone]) -> Making:
    """Return the totals of cuts, set-ups and material over stones."""
    first = {stone.shape: stone for stone in reversed(stones)}
    return Making(
        len(stones),
        len(first),
        sum(stone.cuts for stone in stones),
        sum(stone.set_ups for stone in first.values()),
        sum(stone.sawn for stone in stones),
        sum(stone.volume for stone in stones),
        sum(stone.stock for stone in stones),
        sum(stone.mass for stone in stones),
        max((stone.mass for stone in stones), default=0.0),
    )


def stones_table(layout: Layout, unit: str) -> pd.DataFrame:
    """Return the cutting list: one row per stone, as numbered in the report."""
    import pandas as pd  # slow to import and needed for tables only

    factor, metres = (factor_to(target, layout.scene.units.length) for target in (unit, "m"))
    rows = [
        {
            "stone": stone.number,
            "block": stone.name,
            "mould": stone.shape,
            "mass": stone.mass,
            **{f"side_{k}_{unit}": factor * side for k, side in enumerate(stone.size, 1)},
            "cuts": stone.cuts,
            "set_ups": stone.set_ups,
            "sawn_area": metres**2 * stone.sawn,
            "waste": 1.0 - stone.volume / stone.stock,
        }
        for stone in stones_of(layout)
    ]
    # twelve digits: sums have rounding errors in the last ones
    return pd.DataFrame(rows).map(lambda x: float(f"{x:.12g}") if isinstance(x, float) else x)


def factor_to(unit: str, scene_unit: str) -> float:
    """Return the factor from a scene's unit of length to another; 1 if the scene's is unknown."""
    return units.METRES[scene_unit] / units.METRES[unit] if scene_unit in units.METRES else 1.0


_PARALLEL: Final = 1e-9  # sine of the angle between forces up to which they are printed as one


def load_rows(
    layout: Layout, factor: float, words: dict[str, str], stones: Sequence[Stone], language: str
) -> list[list[str]]:
    """Return the rows of the table of loads: case, load, and λ times it."""
    # Parallel forces of a case, as those of a load that is spread, are one force at their common line of action.
    scene, rows = layout.scene, []
    cases = cases_of_scene(scene, layout.assembly.elements)
    for name, live in [(case.case.name, case.case.live) for case in cases] or [("", scene.loads.live or [])]:
        entries = [uncertain.with_means(entry.model_dump(mode="json", exclude_defaults=True)) for entry in live]
        for group in _groups(layout, entries):
            text, times = _load(layout, group, factor, words, stones)
            rows.append([textwrap.shorten(languages.phrase_in(language, name), 24, placeholder="…"), text, times])
    return rows


def force_words(layout: Layout, value: float) -> str:
    """Write a force in kN, or in the scene's unit where that is unknown."""
    unit = layout.scene.units.force
    if unit not in units.NEWTONS:
        return f"{languages.digits(value)} {unit}"
    return f"{languages.digits(value * units.NEWTONS[unit] / units.NEWTONS['kN'])} kN"


def finite(value: float, write: Callable[[float], str]) -> str:
    """Return a number as text by the function `write`, or a dash if it is not finite."""
    return write(value) if math.isfinite(value) else "–"


def _groups(layout: Layout, entries: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Return the entries of a case, parallel forces on elements in one group, the others alone."""
    groups: list[list[dict[str, Any]]] = []
    for entry in entries:
        alike = next((group for group in groups if _parallel(layout, group[0], entry)), None)
        if alike is None:
            groups.append([entry])
        else:
            alike.append(entry)
    return groups


def _parallel(layout: Layout, first: dict[str, Any], second: dict[str, Any]) -> bool:
    """Return whether two loads are forces on elements in one direction, without a moment."""
    if not all(
        "force" in entry and "moment" not in entry and _element(layout, entry) >= 0 for entry in (first, second)
    ):
        return False
    a, b = (np.array(entry["force"], dtype=float) for entry in (first, second))
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0.0 and float(a @ b) >= (1.0 - _PARALLEL) * size


def _element(layout: Layout, entry: dict[str, Any]) -> int:
    """Return the index of the element of a load, -1 if it names none."""
    return layout.assembly.elements.index.get(str(entry.get("element")), -1)


def _load(
    layout: Layout, group: list[dict[str, Any]], factor: float, words: dict[str, str], stones: Sequence[Stone]
) -> tuple[str, str]:
    """Describe one load or a group of parallel forces, and λ times it."""
    entry = group[0]
    if (body := scene_loads.body_of(entry)) is not None:
        value = float(np.linalg.norm(body))
        vector = ", ".join(f"{component + 0.0:.4g}" for component in body)
        return f"({vector}) {words['body']}", finite(factor * value, lambda x: f"{x:.4g}")
    if "force" in entry:
        value = sum(float(np.linalg.norm(component["force"])) for component in group)
        text = f"{force_words(layout, value)} {_carriers(layout, group, words, stones)}"
        where = _place(layout, group)
        if where is not None:
            text += f" {words['at']} ({', '.join(f'{x:.4g}' for x in where)}) {layout.scene.units.length}"
        return textwrap.shorten(text, 66, placeholder="…"), finite(factor * value, lambda x: force_words(layout, x))
    for key in ("pressure", "line", "traction"):
        if key in entry:
            return f"{words[key]} {entry[key]}", ""
    return f"{words['moment']} {entry.get('moment')}", ""


def _carriers(layout: Layout, group: list[dict[str, Any]], words: dict[str, str], stones: Sequence[Stone]) -> str:
    """Name the stones on which forces act by their numbers, other elements by their ids."""
    numbers = {stone.name: stone.number for stone in stones}
    sides, others = set[int](), set[str]()
    for entry in group:
        k = _element(layout, entry)
        block = layout.blocks[int(layout.block_of[k])].name if k >= 0 else ""
        if block in numbers:
            sides.add(numbers[block])
        else:
            others.add(str(entry.get("element", "")))
    if others:
        return f"{words['on']} {', '.join(sorted(others))}"
    return words["on_stone" if len(sides) == 1 else "on_stones"].format(numbers=", ".join(map(str, sorted(sides))))


def _place(layout: Layout, group: list[dict[str, Any]]) -> list[float] | None:
    """Return the point at which forces act together, None where an entry states none."""
    if any("at" not in entry for entry in group):
        return None
    sizes = np.array([float(np.linalg.norm(entry["force"])) for entry in group])
    points = np.array([entry["at"] for entry in group], dtype=float)
    return [float(x) + 0.0 for x in sizes @ points / sizes.sum()] if sizes.sum() > 0.0 else None


_SIZE: Final = 5.5  # size of the letters, points

_LETTER: Final = (0.62, 0.95)  # width and height of a digit, relative to the size of the letters

_GAP: Final = 2.0  # distance of a length from its edge, points

_MOULD_MARGIN: Final = 0.2  # margin on each side of a drawing, relative to the outline

_SHORT: Final = 0.04  # length of an edge, relative to the outline, up to which it bears none

_SHARES: Final = (0.5, 0.35, 0.65, 0.2, 0.8)  # places of a length along its edge, in the order in which they are tried


def draw_mould(ax: Axes, stone: Stone, factor: float, tint: str) -> None:
    """Draw the outline of a planar stone with the lengths of its edges."""
    # A length lies outside beside the middle of its edge. Where it would lie on an edge or on another length it moves
    # along its edge, or inside.
    if stone.outline is None:
        raise ValueError("a stone in space has no outline")
    ring = factor * stone.outline
    ax.fill(*ring.T, facecolor=tint, edgecolor=look.INK, linewidth=0.8)
    ax.set_aspect("equal")
    ax.margins(_MOULD_MARGIN)
    ax.set_axis_off()
    edges = np.roll(ring, -1, axis=0) - ring
    lengths = np.hypot(*edges.T)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    point = _point(ax, ring)
    outline = shapely.LinearRing(ring)
    occupied: list[shapely.Geometry] = []
    # long edges first: they have room beside their middle
    for k in np.argsort(-lengths, kind="stable").tolist():
        if lengths[k] <= _SHORT * float(np.ptp(ring, axis=0).max()):
            continue
        text = f"{lengths[k]:.0f}" if lengths[k] >= 99.95 else f"{lengths[k]:.1f}"
        half = 0.5 * point * _SIZE * np.array([_LETTER[0] * len(text), _LETTER[1]])
        off = float(abs(outward[k]) @ half) + _GAP * point
        positions = [ring[k] + share * edges[k] + side * off * outward[k] for side in (1.0, -1.0) for share in _SHARES]
        boxes = shapely.box(*(np.array(positions) - half).T, *(np.array(positions) + half).T)
        free = [
            not (outline.intersects(box) or any(box.intersects(other) for other in occupied)) for box in boxes.tolist()
        ]
        best = free.index(True) if any(free) else 0
        occupied.append(boxes[best])
        x, y = positions[best].tolist()
        ax.text(x, y, text, fontsize=_SIZE, ha="center", va="center")


def _point(ax: Axes, ring: Floats) -> float:
    """Return the length of a point on paper in the unit of an outline (k, 2) that fills its axes."""
    # Called before an equal aspect shrinks the axes.
    box = ax.get_position(original=True).transformed(ax.figure.transSubfigure)
    room = 72.0 / ax.figure.dpi * np.array([box.width, box.height])
    return float((np.ptp(ring, axis=0) * (1.0 + 2.0 * _MOULD_MARGIN) / room).max())


_PAPER: Final = (8.27, 11.69)  # size of a page, DIN A4, inches

_ROWS: Final = 52  # largest number of rows of a table on one page

_LOADS: Final = 14  # largest number of rows of the table of loads

_MOULDS: Final = 28  # largest number of moulds that are drawn, on one page

# Beginnings of assumptions on materials, whose values the report states anyway
_MATERIALS: Final = ("density", "friction", "low friction", "tensile", "shear strength", "inner strengths")

_STRAIGHT: Final = 0.9998  # cosine of the angle, 1 degree, up to which a stone comes along an axis

_MARGIN: Final = 0.09  # margin of a page, relative to its width


@dataclass(frozen=True)
class Printed:
    """Content of a printed report."""

    layout: Layout
    # fields, faces: proven bounds on λ by fields and by faces, infinite where there are none
    fields: tuple[float, float]
    faces: tuple[float, float]
    status: str  # status of its limit analysis
    strongest: bool = False  # True if the layout is proven the strongest of its cells
    laying: Laying | None = None  # order of laying, None if it was not asked for
    assumed: tuple[str, ...] = ()  # assumptions beside the model, one sentence each
    uncut: float | None = None  # upper bound on λ by faces without cuts if it is below that of the layout, else None
    uncut_by_fields: float | None = None  # lower bound on λ by fields without cuts, None if unknown

    @property
    def load_factor(self) -> float:
        """λ proven from below: by fields if known, 0 for a fall, else by faces."""
        if self.fields[1] < 0.0:
            return 0.0
        return self.fields[0] if math.isfinite(self.fields[0]) else min(self.faces[0], self.fields[1])


@dataclass
class _Book:
    """State of a report while its pages are made."""

    content: Printed
    language: str
    unit: str
    stones: list[Stone]
    making: Making
    words: dict[str, str]
    pages: list[Figure] = field(default_factory=list)

    @property
    def scene(self) -> Scene:
        return self.content.layout.scene

    @property
    def length(self) -> float:
        return factor_to(self.unit, self.scene.units.length)

    def new(self, title: str) -> Figure:
        figure = Figure(figsize=_PAPER)
        figure.text(_MARGIN, 0.955, title, fontsize=15, color=look.INK, va="top")
        self.pages.append(figure)
        return figure

    def text(self, figure: Figure, top: float, lines: list[str], size: float = 9.0) -> float:
        """Write lines, wrapped to the page, from the height `top` on; return the height below."""
        width = int(150 * 7.0 / size * (1.0 - 2.0 * _MARGIN))
        for line in lines:
            for part in textwrap.wrap(line, width) or [""]:
                figure.text(_MARGIN, top, part, fontsize=size, color=look.INK, va="top")
                top -= 1.45 * size / 72.0 / _PAPER[1]
        return top

    def table(self, figure: Figure, top: float, head: list[str], rows: list[list[str]], widths: list[float]) -> float:
        """Write a table from the height `top` on, return the height below; widths: page shares."""
        step = 1.5 * 8.0 / 72.0 / _PAPER[1]
        left = _MARGIN + (1.0 - 2.0 * _MARGIN) * np.concatenate([[0.0], np.cumsum(widths)[:-1]])
        for number, row in enumerate([head, *rows]):
            for x, cell in zip(left, row, strict=True):
                figure.text(float(x), top, cell, fontsize=8.0, color=look.SOFT if number == 0 else look.INK, va="top")
            top -= step
        return top


def write_printed(content: Printed, path: Path, *, language: str = "en", unit: str = "mm") -> int:
    """Write the report as PDF, completely or not at all; return its number of pages."""
    figures = pages_of(content, language=language, unit=unit)
    facts = {"CreationDate": None, "Title": content.layout.scene.name}
    with mpl.rc_context({"pdf.fonttype": 42}), files.whole_file(path) as file, PdfPages(file, metadata=facts) as book:
        for figure in figures:
            with writing.as_written(figure):
                book.savefig(figure)
    return len(figures)


def pages_of(content: Printed, *, language: str = "en", unit: str = "mm") -> list[Figure]:
    """Return the pages of a printed report: overview, stones, moulds, laying, assumptions."""
    stones = stones_of(content.layout)
    book = _Book(content, language, unit, stones, making_of(stones), languages.words_in(language))
    _overview(book)
    _stones(book)
    if content.layout.assembly.dimension == 2:
        _moulds(book)
    _laying(book)
    names = {stone.name for stone in stones}
    for number, figure in enumerate(book.pages, 1):
        languages.localise(figure, language, names)
        foot = f"{book.scene.name} · jld {jld_core.__version__} · {book.words['page']} {number}/{len(book.pages)}"
        figure.text(_MARGIN, 0.03, foot, fontsize=7.5, color=look.SOFT)
    return book.pages


def _overview(book: _Book) -> None:
    """Make the page with the picture, the loads and the proven results."""
    content, words = book.content, book.words
    layout = content.layout
    figure = book.new(f"{words['title']}: {textwrap.shorten(book.scene.name, 50, placeholder=' …')}")
    ax = figure.add_axes((_MARGIN, 0.52, 1.0 - 2.0 * _MARGIN, 0.38))
    views_figures.draw_assembly(ax, layout.assembly, layout.labels)
    ax.set_title("")
    blocks = [block for block in layout.blocks if block.cells]
    size = 7.0 if len(blocks) <= 60 else 4.5
    writing.write_numbers(
        ax, layout.assembly, [entry.elements for entry in blocks], [entry.centroid for entry in blocks], size
    )
    top = book.text(figure, 0.43, [words["loads"]], 12.0)
    rows = load_rows(layout, content.load_factor, words, book.stones, book.language)
    head = [words["case"], words["load"], words["times"]]
    top = book.table(figure, top, head, rows[:_LOADS], [0.2, 0.58, 0.22])
    if len(rows) > _LOADS:
        top = book.text(figure, top, [words["more"].format(count=len(rows) - _LOADS)], 8.0)
    top = book.text(figure, top - 0.015, [words["proven"]], 12.0)
    book.text(figure, top, _proven(book))


def _proven(book: _Book) -> list[str]:
    content, words = book.content, book.words
    sentences = []
    if content.fields[1] < 0.0:
        sentences.append(words["falls_by_fields"])
    elif math.isfinite(content.fields[0]):
        low, high = content.fields
        sentences.append(words["by_fields"].format(low=f"{low:.4g}", high=finite(high, lambda x: f"{x:.4g}")))
    elif math.isfinite(content.fields[1]):
        sentences.append(words["most_by_fields"].format(high=f"{content.fields[1]:.4g}"))
    if math.isfinite(content.faces[0]) and content.status != "locked":
        least, most = (finite(face, lambda x: f"{x:.4g}") for face in content.faces)
        sentences.append(words["by_faces" if least != most else "at_faces"].format(low=least, high=most))
    elif content.status == "locked":
        sentences.append(words["locked"])
    elif not sentences:
        sentences.append(words["nothing"].format(status=content.status))
    sentences.append(words["strongest"] if content.strongest else words["not_strongest"])
    if content.uncut is not None:
        sentences.append(words["stronger_cut"].format(high=f"{content.uncut:.4g}"))
    if content.uncut_by_fields is not None and content.uncut_by_fields > content.fields[1]:
        sentences.append(words["weaker_cut"].format(low=f"{content.uncut_by_fields:.4g}"))
    return sentences


def _stones(book: _Book) -> None:
    words = book.words
    figure = book.new(words["stones"])
    head = [words[key] for key in ("stone", "block", "mould", "mass", "size", "cuts", "set_ups", "waste")]
    head[4] += f" [{book.unit}]"
    rows = []
    for stone in book.stones[:_ROWS]:
        size = " × ".join(languages.digits(book.length * side) for side in stone.size)
        waste = f"{100.0 * max(0.0, 1.0 - stone.volume / stone.stock):.0f} %"
        mass = _kilograms(book, stone.mass)
        name = textwrap.shorten(stone.name, 14, placeholder="…")
        rows.append([str(stone.number), name, str(stone.shape), mass, size, str(stone.cuts), str(stone.set_ups), waste])
    top = book.table(figure, 0.91, head, rows, [0.07, 0.15, 0.09, 0.13, 0.23, 0.1, 0.13, 0.1])
    if len(book.stones) > _ROWS:
        top = book.text(figure, top, [words["more"].format(count=len(book.stones) - _ROWS)])
    top = book.text(figure, top - 0.01, [words["making"]], 12.0)
    book.text(figure, top, [_making_words(book)])


def _kilograms(book: _Book, mass: float) -> str:
    return languages.digits(mass) + (" kg" if book.content.layout.assembly.kilograms is not None else "")


def _making_words(book: _Book) -> str:
    """Return the paragraph on numbers, cuts, masses, stock and waste of all stones."""
    sums, words = book.making, book.words
    metres = factor_to("m", book.scene.units.length)
    sentence = words["making_words"].format(
        stones=sums.stones,
        moulds=sums.moulds,
        cuts=sums.cuts,
        set_ups=sums.set_ups,
        sawn=f"{languages.digits(metres**2 * sums.sawn)} m²",
        mass=_kilograms(book, sums.mass),
        heaviest=_kilograms(book, sums.heaviest),
        stock=f"{languages.digits(metres**3 * sums.stock)} m³",
        waste=f"{100.0 * max(0.0, sums.waste):.0f} %",
    )
    return f"{sentence} {words['least' if book.content.layout.assembly.dimension == 2 else 'axes']}"


def _moulds(book: _Book) -> None:
    """Make the page of moulds with the lengths of their edges."""
    figure = book.new(book.words["moulds"].format(unit=book.unit))
    shapes = sorted({stone.shape for stone in book.stones})
    across = 4
    down = math.ceil(min(len(shapes), _MOULDS) / across)
    height = min(0.15, 0.84 / max(down, 1))
    for index, shape in enumerate(shapes[:_MOULDS]):
        alike = [stone for stone in book.stones if stone.shape == shape]
        x = _MARGIN + (index % across) * (1.0 - 2.0 * _MARGIN) / across
        y = 0.9 - (index // across + 1) * height
        ax = figure.add_axes((x, y + 0.1 * height, 0.9 * (1.0 - 2.0 * _MARGIN) / across, 0.72 * height))
        draw_mould(ax, alike[0], book.length, look.TINTS[index % len(look.TINTS)])
        numbers = ", ".join(str(stone.number) for stone in alike)
        count = book.words["pieces"].format(count=len(alike))
        title = f"{book.words['mould']} {shape}: {count} ({textwrap.shorten(numbers, 12, placeholder='…')})"
        ax.set_title(title, fontsize=7.5, color=look.INK, loc="left")
    if len(shapes) > _MOULDS:
        book.text(figure, 0.06, [book.words["more"].format(count=len(shapes) - _MOULDS)])


def _laying(book: _Book) -> None:
    """Make the page with the order of laying, the assumptions and the warnings."""
    words, laying = book.words, book.content.laying
    figure = book.new(words["laying"] if laying is not None else words["assumptions"])
    top = 0.91
    if laying is not None:
        top = _laying_table(book, figure, top)
        top = book.text(figure, top - 0.012, [words["assumptions"]], 12.0)
    top = book.text(figure, top, [f"– {line}" for line in _assumptions(book)], 8.0)
    if warnings := [*book.content.layout.assembly.warnings, *book.content.layout.assembly.notes]:
        top = book.text(figure, top - 0.012, [words["warnings"]], 12.0)
        book.text(figure, top, [f"– {line}" for line in warnings[:6]], 8.0)


def _laying_table(book: _Book, figure: Figure, top: float) -> float:
    """Write the table of the order of laying, in two columns where it is long."""
    words, laying = book.words, book.content.laying
    if laying is None:
        return top
    if not laying.possible:
        names = ", ".join(_numbers(book, laying, laying.locked))
        return book.text(figure, top, [words["no_order"].format(names=names)])
    rows = []
    for number, step in enumerate(laying.steps, 1):
        stones = " + ".join(_numbers(book, laying, step.blocks))
        direction = _direction_in_words(book, 0.0 - np.asarray(step.direction))
        props = float(step.stage.props.sum())
        stage_text = words["stands"] if step.stage.stands else words["undecided"] if step.stage.stands is None else ""
        rows.append(
            [str(number), stones, direction, stage_text or f"{words['prop']} {force_words(book.content.layout, props)}"]
        )
    listed = rows[: 2 * (_ROWS - 12)]
    half = math.ceil(len(listed) / 2)
    head = [words[key] for key in ("step", "stone", "way", "stands")]
    both = [[*left, *right] for left, right in zip(listed[:half], [*listed[half:], *[[""] * 4] * half], strict=False)]
    top = book.table(figure, top, [*head, *head], both, [0.07, 0.09, 0.17, 0.17] * 2)
    if len(rows) > len(listed):
        top = book.text(figure, top, [words["more"].format(count=len(rows) - len(listed))])
    return top


def _direction_in_words(book: _Book, motion: Floats) -> str:
    """Say from where a stone comes, or along which vector; motion: (d,) of its movement."""
    words, axes = book.words, np.eye(len(motion))
    named_directions = [(words["from_above"], -axes[-1]), (words["from_below"], axes[-1])]
    if len(motion) == 2:
        named_directions += [(words["from_left"], axes[0]), (words["from_right"], -axes[0])]
    else:
        signed = [(sign, k) for k in (0, 1) for sign in (1.0, -1.0)]
        named_directions += [
            (words["along"].format(axis=f"{'+' if sign > 0.0 else '−'}{'xy'[k]}"), sign * axes[k]) for sign, k in signed
        ]
    vector = "(" + ", ".join(f"{x:.2f}" for x in motion) + ")"
    return next((name for name, axis in named_directions if float(motion @ axis) > _STRAIGHT), vector)


def _numbers(book: _Book, laying: Laying, blocks: Sequence[int]) -> list[str]:
    layout = book.content.layout
    names = {stone.name: str(stone.number) for stone in book.stones}
    block_names = [layout.blocks[int(layout.block_of[laying.blocks.elements(block)[0]])].name for block in blocks]
    return [names.get(name, name) for name in block_names]


def _assumptions(book: _Book) -> list[str]:
    """Return sentences on the values and the model on which the load factor is based."""
    words, scene = book.words, book.scene
    materials = uncertain.with_means(scene.model_dump(mode="json", exclude_defaults=True)["materials"])
    dry, inner = materials.get("dry") or {}, materials.get("inner") or {}
    scene_units, lines = scene.units, []
    force, metre = units.NEWTONS.get(scene_units.force, 0.0), units.METRES.get(scene_units.length, 1.0)
    if dry:
        angle = dry.get("friction_angle")
        value = f"{_plain(angle, words)}°" if angle is not None else _plain(dry.get("friction_coefficient"), words)
        lines.append(words["friction"].format(value=value))
    if inner:
        factor, unit = (
            (force / metre**2 / 1e6, "N/mm²") if force else (1.0, f"{scene_units.force}/{scene_units.length}²")
        )
        tension, shear = (
            f"{_plain(inner.get(key), words, factor)} {unit}" for key in ("tensile_strength", "shear_strength")
        )
        lines.append(words["strength"].format(tension=tension, shear=shear))
    if materials.get("density") is not None:
        # a scene may have any units of mass: its gravity makes a weight of it
        gravity = book.content.layout.assembly.elements.gravity
        factor, unit = (gravity / units.GRAVITY * force / metre**3, " kg/m³") if force else (1.0, "")
        lines.append(words["density"].format(value=_plain(materials["density"], words, factor) + unit))
    facts = weight_facts(scene, book.content.layout.assembly)
    lines += [words[f"whole_{name}"].format(value=facts[name]) for name in ("thickness", "weight") if name in facts]
    # what the file of materials says already stands above
    others = [assumption for assumption in book.content.assumed if not assumption.startswith(_MATERIALS)]
    return [*lines, words["rigid"], *(languages.phrase_in(book.language, other) for other in others)]


def _plain(value: Any, words: dict[str, str], factor: float = 1.0) -> str:
    """Write a value of a material times a factor, with its low value where it has one."""
    if isinstance(value, dict):
        return words["low"].format(value=f"{factor * value['nominal']:.4g}", low=f"{factor * value['low']:.4g}")
    return f"{factor * value:.4g}" if isinstance(value, float | int) else "–"
