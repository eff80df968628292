"""Provide `jld plot`: pictures, animations and pages of scenes and studies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

from jld_core import (
    InputError,
    LimitAnalysisResult,
    ParameterError,
    Status,
    build_assembly,
    error_context,
    files,
    load_scene,
)
from jld_core.models import solve_rigid
from jld_core.scene import cracks
from jld_explore import Exploration, read_folder
from jld_explore.cli import layout as cli_layout
from jld_explore.cli import options as cli_options
from jld_explore.cli import streams
from jld_views.page_of_study import scene_page, write_report
from jld_views.search_pictures import write_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_command(
    source: cli_options.Source,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="File to write (scene) or folder (study).")] = None,
    kind: Annotated[
        Literal["png", "svg", "pdf", "html", "gif", "mp4"],
        typer.Option("--format", help="Kind of file, where --out names none."),
    ] = "png",
    rank: Annotated[str | None, typer.Option(help="Rows of a folder's results.csv, side by side: 1,4.")] = None,
    ids: Annotated[bool, typer.Option("--ids", help="Write the ids of elements (scene).")] = False,
    values: Annotated[bool, typer.Option("--values", help="Write the values of live loads (scene).")] = False,
) -> None:
    """Draw a scene with its own labels, or the pictures of a results folder again.

    The formats gif and mp4 show the mechanism moving.
    """
    source = cli_layout.best_of_design(source)
    moving = kind in ("gif", "mp4") or (out is not None and out.suffix in (".gif", ".mp4"))
    if source.is_dir() and (ids or values):
        raise ParameterError("ids" if ids else "values", "a study's pictures have none", "a scene, or the page of it")
    if moving:
        streams.say(_animate(source, rank, out, kind))
    elif rank is not None:
        streams.say(plot_ranks(source, rank, out, kind))
    elif source.is_dir():
        done = read_folder(source)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        if kind == "html":
            written = [write_report(done, out)]
        else:
            written = write_pictures(done, kind, out)[0]
        for path in written:
            streams.say(path)
    else:
        streams.say(_of_scene(source, out, kind, ids, values))


_MOST: Final = 6  # largest number of layouts drawn side by side


def _of_scene(source: Path, out: Path | None, kind: str, ids: bool, values: bool) -> Path:
    """Draw a scene with its own labels, or write its page, and return the file."""
    scene = load_scene(source)
    with error_context(source):
        assembly = build_assembly(scene)
    target = out or Path(source.with_suffix(f".{kind}").name)
    cli_options.refuse_itself(source, target)
    if target.suffix == ".html":
        files.write_text(target, scene_page(scene, assembly))
        return target
    if target.suffix not in (".png", ".svg", ".pdf"):
        raise ParameterError("out", f"{target.name!r} has no known ending", ".png, .svg, .pdf, .html, .gif or .mp4")
    from jld_views import figures

    figures.save_figure(figures.figure_of_assembly(assembly, ids=ids, values=values), target)
    return target


def _animate(source: Path, rank: str | None, out: Path | None, kind: str) -> Path:
    """Write an animation of a layout's mechanism under associative friction; return the file."""
    try:
        number = None if rank is None else int(rank)
    except ValueError:
        raise ParameterError("rank", f"{rank!r} is wrong", "one rank for an animation") from None
    scene, assembly, labels, model = cli_layout.layout_of(source, number)
    if scene.cracks != "faces":
        raise InputError(
            f"{source}: cracks", "animations show rigid elements of the grid", 'a still picture, or "faces"'
        )
    name = f"mechanism_{rank or 1}.{kind}"
    target = out or (source / name if source.is_dir() else Path(source.with_suffix(f".{kind}").name))
    cli_options.refuse_itself(source, target)
    result = solve_rigid(assembly, labels, model)
    if result.governing is not None:
        result = result.cases[result.governing]
    from jld_views.figures import save_animation

    save_animation(result, target)
    return target


def plot_ranks(source: Path, text: str, out: Path | None, ending: str) -> Path:
    """Draw layouts of a results folder side by side, and return the file written."""
    if not source.is_dir():
        raise ParameterError("rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
    try:
        ranks = [int(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError("rank", f"{text!r} is wrong", "ranks, as 1,4") from None
    if not 1 <= len(ranks) <= _MOST:
        raise ParameterError("rank", f"{len(ranks)} layouts do not fit side by side", f"at most {_MOST}")
    done = read_folder(source)
    target = out or source / f"layouts_{'_'.join(map(str, ranks))}.{ending}"
    if target.suffix not in (".png", ".svg", ".pdf"):
        raise ParameterError("out", f"{target.name!r} has no known ending", ".png, .svg or .pdf")
    from jld_views import figures

    if isinstance(done.scene.cracks, cracks.FieldCracks):
        figures.save_figure(_by_fields(done, ranks), target)
        return target
    results = [done.result(rank) for rank in ranks]
    counts = [sum(1 for block in done.layout(rank).blocks if block.cells) for rank in ranks]
    titles = [
        f"{_named(done, rank)}: {_value(result)}, {count} block{'s' if count != 1 else ''}"
        for rank, result, count in zip(ranks, results, counts, strict=True)
    ]
    figures.save_figure(figures.figure_of_layouts(results, titles), target)
    return target


def _by_fields(done: Exploration, ranks: list[int]) -> Figure:
    """Draw stresses and cracks of layouts side by side, each under its governing load case."""
    from jld_views.field_figures import figure_of_field_layouts

    results = [done.field_result(rank) for rank in ranks]
    titles = [
        f"{_named(done, rank)}: λ in [{result.decided.low:.4g}, {result.decided.high:.4g}]"
        for rank, result in zip(ranks, results, strict=True)
    ]
    return figure_of_field_layouts([result.governing_case for result in results], titles)


def _named(done: Exploration, number: int) -> str:
    """Return the rank of a row in words, with its number if it shares the rank or has none."""
    import pandas as pd  # slow to import and needed for tables only

    rank = done.row(number)["rank"]
    if pd.isna(rank):
        return f"row {number}"
    return f"rank {rank}" + (f", row {number}" if (done.results["rank"] == rank).sum() > 1 else "")


def _value(result: LimitAnalysisResult) -> str:
    return f"λ = {result.load_factor:.5g}" if result.status is Status.COLLAPSE else str(result.status)
