"""Provide `jld report`: printed pages of one layout, and an archive of its project."""

from __future__ import annotations

import json
import math
import zipfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
import typer

from jld_core import (
    Deadline,
    DeadlinePassed,
    InputError,
    Layout,
    LimitAnalysisResult,
    ParameterError,
    build_assembly,
    error_context,
    load_scene,
)
from jld_core import files as core_files
from jld_core.fields import bounds_by_fields
from jld_core.fields import problem as fields_problem
from jld_core.models import solve_by_elements, solve_rigid
from jld_core.scene import units
from jld_explore import read_folder
from jld_explore.cli import layout as cli_layout
from jld_explore.cli import options, streams
from jld_explore.report import csv_of
from jld_practice.laying import Laying, assembly_order
from jld_practice.laying.command import start_of_design
from jld_practice.laying.order import LayingStart
from jld_practice.printed import Printed, Stone, factor_to, stones_of, stones_table, write_printed

if TYPE_CHECKING:
    import pandas as pd


_FITS: Final = 1e-9  # excess of a side, relative to the stock, up to which a stone fits


@dataclass(frozen=True)
class Placed:
    """Stone in a stock cuboid; lengths in the unit of the scene."""

    stone: int  # number of the stone
    cuboid: int  # number of the stock cuboid, from 1
    # corner of the stone's own cuboid nearest to the corner of the stock
    corner: tuple[float, float, float]
    sides: tuple[float, float, float]  # sides of the stone's own cuboid along those of the stock


@dataclass(frozen=True)
class Stock:
    size: tuple[float, float, float]  # sides of a stock cuboid, in the unit of the scene
    placed: tuple[Placed, ...]  # place of every stone
    cuboids: int  # number of stock cuboids
    least: int  # number of cuboids that no cutting of these stones goes below, whatever their places
    volume: float  # volume of all stones

    @property
    def waste(self) -> float:
        return 1.0 - self.volume / (self.cuboids * math.prod(self.size))

    @property
    def least_waste(self) -> float:
        """Share of the stock that any cutting of these stones loses."""
        return 1.0 - self.volume / (self.least * math.prod(self.size))


def stock_of(
    stones: list[Stone], size: tuple[float, float, float], kerf: float = 0.0, said: tuple[float, str] = (1.0, "")
) -> Stock:
    """Place the smallest cuboids of stones in stock cuboids by guillotine cuts."""
    # `said`: factor and unit of lengths in messages.
    # Each cut passes through a whole piece. Stones are placed from the largest to the smallest, in the free piece that
    # they fill best, turned about the axes as they fit (guillotine cuts; the least leftover side decides).
    if not all(0.0 < side < math.inf for side in size):
        raise ParameterError("stock", "a side is not above 0", "three sides above 0, as 1.2,0.8,0.3")
    if not math.isfinite(math.prod(size)):
        raise ParameterError("stock", "the volume of a cuboid is out of range", "shorter sides")
    if not 0.0 <= kerf < min(size):
        raise ParameterError(
            "kerf", "it is no width of a cut in this stock", "a width from 0 to below the sides of the stock"
        )
    free: list[tuple[int, tuple[float, ...], tuple[float, ...]]] = []
    placements, count = [], 0
    for stone in sorted(stones, key=lambda stone: (-stone.stock, stone.number)):
        fit = _best(stone, free)
        if fit is None:
            count += 1
            free.append((count, (0.0, 0.0, 0.0), tuple(size)))
            fit = _best(stone, free)
        if fit is None:
            factor, unit = said
            both = (stone.size, size)
            stone_size, stock_size = (" × ".join(f"{factor * side:.4g}" for side in sides) + unit for sides in both)
            problem = f"stone {stone.number} of {stone_size} does not fit into {stock_size}"
            raise ParameterError("stock", problem, "larger cuboids, or a search with smaller blocks")
        index, sides3 = fit
        cuboid, corner, room = free.pop(index)
        placements.append(Placed(stone.number, cuboid, _three(corner), _three(sides3)))
        free += [(cuboid, *free_box) for free_box in _rest(corner, room, sides3, kerf)]
    volume = sum(stone.volume for stone in stones)
    least = least_number([stone.volume for stone in stones], math.prod(size))
    return Stock(size, tuple(placements), count, least, volume)


def least_number(volumes: list[float], stock: float) -> int:
    """Return the least number of cuboids that any cutting of stones needs, by their volumes."""
    # Bound L2 of Martello and Toth (1990, Discrete Applied Mathematics 28, 59-70): for each k, stones above stock − k
    # need a cuboid each, and none above half fits beside another.
    sizes = np.sort(np.array(volumes) / stock)[::-1] if volumes else np.zeros(0)
    bound = math.ceil(float(sizes.sum()) - _FITS)
    for k in (0.0, *(float(size) for size in np.unique(sizes[sizes <= 0.5]))):
        fills_bin = sizes > 1.0 - k + _FITS
        large = (sizes > 0.5 + _FITS) & ~fills_bin
        small = (sizes >= k) & (sizes <= 0.5 + _FITS)
        room = float(sizes[small].sum()) - (float(large.sum()) - float(sizes[large].sum()))
        bound = max(bound, int(fills_bin.sum()) + int(large.sum()) + max(0, math.ceil(room - _FITS)))
    return bound


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]


def _best(
    stone: Stone, free: list[tuple[int, tuple[float, ...], tuple[float, ...]]]
) -> tuple[int, tuple[float, ...]] | None:
    """Return the free piece that a stone fills best, and its sides there; None if none fits."""
    a, b, c = stone.size
    turns = dict.fromkeys([(a, b, c), (a, c, b), (b, a, c), (b, c, a), (c, a, b), (c, b, a)])
    best: tuple[tuple[float, ...], int, tuple[float, ...]] | None = None
    for index, (_, _, room) in enumerate(free):
        for sides in turns:
            over = sorted(have - side for have, side in zip(room, sides, strict=True))
            if over[0] >= -_FITS * max(room) and (best is None or (*over, index) < (*best[0], best[1])):
                best = (tuple(over), index, sides)
    return None if best is None else (best[1], best[2])


def _rest(
    corner: tuple[float, ...], room: tuple[float, ...], sides: tuple[float, ...], kerf: float
) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the pieces (corner, sides) that remain beside a stone at a piece's corner."""
    # Cuts pass through the whole piece: the first one where the most is left over.
    boxes = []
    at, size = list(corner), list(room)
    for axis in sorted(range(3), key=lambda k: -(room[k] - sides[k])):
        remaining = size[axis] - sides[axis] - kerf
        if remaining > _FITS * room[axis]:
            start, sides_left = list(at), list(size)
            start[axis] += sides[axis] + kerf
            sides_left[axis] = remaining
            boxes.append((tuple(start), tuple(sides_left)))
        size[axis] = sides[axis]
    return boxes


def stock_table(stock: Stock, scene_unit: str, unit: str) -> pd.DataFrame:
    """Return where each stone lies in its stock cuboid: one row per stone."""
    import pandas as pd  # slow to import and needed for tables only

    factor = factor_to(unit, scene_unit)
    rows = [
        {"cuboid": placement.cuboid, "stone": placement.stone}
        | {f"at_{k}_{unit}": factor * value for k, value in enumerate(placement.corner, 1)}
        | {f"side_{k}_{unit}": factor * value for k, value in enumerate(placement.sides, 1)}
        for placement in sorted(stock.placed, key=lambda placement: (placement.cuboid, placement.stone))
    ]
    return pd.DataFrame(rows).map(lambda x: float(f"{x:.12g}") if isinstance(x, float) else x)


def words_of_stock(stock: Stock) -> str:
    """Describe in one line the number of cuboids, the waste, and bounds on both."""
    proven = "the least number" if stock.cuboids == stock.least else f"any cutting needs {stock.least} or more"
    least = "" if stock.cuboids == stock.least else f", at least {100.0 * stock.least_waste:.3g} % in any case"
    return (
        f"{stock.cuboids} stock cuboid{'s' * (stock.cuboids != 1)}, {proven}; waste {100.0 * stock.waste:.3g} %{least}"
    )


_LAYING: Final = 30.0  # longest time for an order of laying, s; without one the report says so

_NOTHING: Final = (-math.inf, math.inf)  # bounds where nothing is proven

_DATE: Final = (1980, 1, 1, 0, 0, 0)  # date of the files in an archive, so that equal projects give equal archives

ReportSource = Annotated[
    Path, typer.Argument(help="A scene, or a folder of jld explore or jld design.", show_default=False)
]


def report(
    source: ReportSource,
    pdf: Annotated[bool, typer.Option("--pdf", help="Write report.pdf: one to four pages to print.")] = False,
    pack: Annotated[bool, typer.Option("--zip", help="Write all files of the project into one archive.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="PDF file; default report.pdf in the folder, or beside the scene."),
    ] = None,
    rank: options.Rank = None,
    language: Annotated[Literal["en", "de", "it"], typer.Option(help="Language of the pages.")] = "en",
    unit: Annotated[str, typer.Option(help=f"Unit of lengths: {', '.join(units.METRES)}.")] = "mm",
    stock: Annotated[
        str | None, typer.Option(help="Place stones in stock cuboids with these sides, in --unit: A,B,C.")
    ] = None,
    kerf: Annotated[float, typer.Option(help="Width of a saw cut between stones of one cuboid, in --unit.")] = 0.0,
) -> None:
    """Print a layout: picture, loads, numbered stones, moulds, laying, assumptions and what is proven.

    Beside the PDF the cutting list is written as CSV. With --zip also pack everything of the project into an archive.
    """
    if not pdf and not pack:
        raise ParameterError("pdf", "nothing is to be written", "`pdf`, `zip` or both")
    if unit not in units.METRES:
        raise ParameterError("unit", f"no unit is named {unit!r}", "one of " + ", ".join(units.METRES))
    sides = _sides(stock, pdf, kerf)
    if not source.exists():
        raise InputError(str(source), "it does not exist", "a scene, or a folder of jld explore or jld design")
    target = out or (source / "report.pdf" if source.is_dir() else source.with_suffix(".pdf"))
    if target.suffix.lower() != ".pdf" or target.is_dir() or not target.absolute().parent.is_dir():
        raise ParameterError(
            "out", f"{target} cannot be written", "a file that ends in .pdf, in a folder that is there"
        )
    options.refuse_itself(source, target)
    core_files.require_writable(target)
    if pdf:
        content = content_of(source, rank)
        placements = _place_stones(content.layout, sides, kerf, unit)
        count = write_printed(content, target, language=language, unit=unit)
        streams.say(f"{target}: {count} page{'s' * (count != 1)}")
        table = target.with_suffix(".stones.csv")
        core_files.write_text(table, csv_of(stones_table(content.layout, unit)))
        streams.say(f"{table}: the cutting list")
        if placements is not None:
            stock_file = target.with_suffix(".stock.csv")
            core_files.write_text(stock_file, csv_of(stock_table(placements, content.layout.scene.units.length, unit)))
            streams.say(f"{stock_file}: {words_of_stock(placements)}")
    if pack:
        archive = target.with_suffix(".zip")
        streams.say(f"{archive}: {_pack(source, archive, target if pdf else None)} files")


_FIELDS: Final = 30.0  # longest time for bounds by fields of a layout that has none, s

# Triangles of all load cases together up to which these bounds are refined: equal layouts have equal reports
_TRIANGLES: Final = 500


def _sides(stock: str | None, pdf: bool, kerf: float) -> tuple[float, float, float] | None:
    if stock is None:
        if kerf:
            raise ParameterError("kerf", "it is given without `stock`", "both")
        return None
    if not pdf:
        raise ParameterError("stock", "stones are placed beside the cutting list", "`pdf` as well")
    try:
        a, b, c = (float(part) for part in stock.split(","))
    except ValueError:
        raise ParameterError("stock", f"{stock!r} is wrong", "three sides, as 1200,800,300") from None
    return a, b, c


def _place_stones(layout: Layout, sides: tuple[float, float, float] | None, kerf: float, unit: str) -> Stock | None:
    """Place the stones of a layout in stock cuboids; None without sides, which are in `unit`."""
    if sides is None:
        return None
    factor = 1.0 / factor_to(unit, layout.scene.units.length)
    a, b, c = (factor * side for side in sides)
    return stock_of(stones_of(layout), (a, b, c), factor * kerf, (1.0 / factor, f" {unit}"))


def content_of(source: Path, rank: int | None) -> Printed:
    """Return what is printed of a design, a row of a search, or a scene."""
    best = cli_layout.best_of_design(source)
    if best != source:
        if rank is not None:
            raise ParameterError("rank", f"{source} is a design, which has one best layout", "no rank")
        return _of_design(source, best)
    if source.is_dir():
        return _of_search(source, rank)
    if rank is not None:
        raise ParameterError("rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
    scene = load_scene(source)
    with error_context(source):
        assembly = build_assembly(scene)
        result = solve_by_elements(assembly, assembly.labels, what="a printed report")
        return _content(Layout(scene, assembly, assembly.labels), result, _NOTHING)


def _of_design(source: Path, best: Path) -> Printed:
    facts = json.loads((source / "summary.json").read_text(encoding="utf-8"))
    scene = load_scene(best)
    assembly = build_assembly(scene)
    return _content(
        Layout(scene, assembly, assembly.labels),
        solve_rigid(assembly),
        _bounds(tuple(facts.get("fields") or (None, None))),
        assumed=tuple(str(assumption) for assumption in facts.get("assumed", [])),
        uncut=facts.get("uncut_at_most"),
        start=start_of_design(source),
    )


def _of_search(source: Path, rank: int | None) -> Printed:
    search = read_folder(source)
    row, first = search.row(rank), rank is None or int(rank) == 1
    fields = tuple(row.get(name, np.nan) for name in ("fields_lo", "fields_hi"))
    strongest = bool(search.summary.proven) and search.summary.stands_at_zero is not False and first
    with error_context(source):
        printed = _content(search.layout(rank), search.result(rank), _bounds(fields), strongest=strongest)
    facts = search.summary.facts
    uncut_low, *_ = (facts.get("fields") or {}).get("uncut") or (None,)
    return replace(printed, uncut=facts.get("uncut_at_most") if first else None, uncut_by_fields=uncut_low)


def _content(
    layout: Layout,
    result: LimitAnalysisResult,
    fields: tuple[float, float],
    *,
    strongest: bool = False,
    assumed: tuple[str, ...] = (),
    uncut: float | None = None,
    start: LayingStart = "ground",
) -> Printed:
    """Return the content of a report, with an order of laying where one is found in time."""
    low, high = result.bracket
    faces = (low if math.isfinite(low) else -math.inf, high if math.isfinite(high) else math.inf)
    if fields == _NOTHING and layout.scene.cracks == "faces":  # what is drawn is not all that cracks
        with suppress(DeadlinePassed, InputError), Deadline(_FIELDS).enforced():
            fields = _by_fields(layout)
    laying: Laying | None = None
    if layout.scene.cracks != "faces":
        assumed = (*assumed, "order of laying: not printed, since the report judges stages by cracks along faces")
        return Printed(layout, fields, faces, str(result.status), strongest, laying, assumed, uncut)
    try:
        with Deadline(_LAYING).enforced():
            sideways = layout.scene.search.assemble_out_of_plane
            laying = assembly_order(layout.assembly, layout.labels, sideways=sideways, start=start)
    except DeadlinePassed:
        assumed = (*assumed, "order of laying: not found within 30 s; jld assembly searches on")
    return Printed(layout, fields, faces, str(result.status), strongest, laying, assumed, uncut)


def _by_fields(layout: Layout) -> tuple[float, float]:
    """Return bounds by fields on the governing factor; InputError where fields do not apply."""
    fields_problem.require_planar_fields(layout.assembly)
    required, cases = layout.assembly.required.tolist(), layout.assembly.by_case
    most = _TRIANGLES // len(cases)
    bounds = [bounds_by_fields(case, layout.labels, most=most) for case in cases]
    ends = [(bracket.lower / factor, bracket.upper / factor) for bracket, factor in zip(bounds, required, strict=True)]
    return min(low for low, _ in ends), min(high for _, high in ends)


def _bounds(values: tuple[float | None, ...]) -> tuple[float, float]:
    """Return bounds with infinite ends in place of None."""
    low, high = values
    return (
        float(low) if low is not None and math.isfinite(low) else -math.inf,
        float(high) if high is not None and math.isfinite(high) else math.inf,
    )


def _pack(source: Path, archive: Path, pdf: Path | None) -> int:
    """Write all files of a project into an archive; return their number."""
    if source.is_dir():
        files = sorted(path for path in source.rglob("*") if path.is_file() and path != archive)
        by_name = {path.relative_to(source).as_posix(): path for path in files}
    else:
        by_name = {source.name: source}
    if pdf is not None:
        written = (pdf, pdf.with_suffix(".stones.csv"), pdf.with_suffix(".stock.csv"))
        by_name |= {path.name: path for path in written if path.exists()}
    with core_files.whole_file(archive) as fresh, zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, path in by_name.items():
            if path == fresh:
                continue
            packed.writestr(zipfile.ZipInfo(name, _DATE), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return len(by_name)
