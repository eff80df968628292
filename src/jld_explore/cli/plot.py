"""Provide `jld plot`: pictures, animations and pages of scenes and studies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from jld_core.build.assemble import build_assembly
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.files import write_text
from jld_core.models import solve_rigid
from jld_core.scene.reading import load_scene
from jld_explore.cli.layout import best_of_design, layout_of, plot_ranks
from jld_explore.cli.options import Source, refuse_itself
from jld_explore.cli.streams import say
from jld_explore.report import write_report
from jld_explore.report.folder import write_pictures
from jld_explore.report.page_of_study import scene_page
from jld_explore.report.reading import read_folder


def plot_command(
    source: Source,
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
    source = best_of_design(source)
    moving = kind in ("gif", "mp4") or (out is not None and out.suffix in (".gif", ".mp4"))
    if source.is_dir() and (ids or values):
        raise ParameterError("ids" if ids else "values", "a study's pictures have none", "a scene, or the page of it")
    if moving:
        say(_animate(source, rank, out, kind))
    elif rank is not None:
        say(plot_ranks(source, rank, out, kind))
    elif source.is_dir():
        done = read_folder(source)
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        if kind == "html":
            written = [write_report(done, out)]
        else:
            written = write_pictures(done, kind, out)[0]
        for path in written:
            say(path)
    else:
        say(_of_scene(source, out, kind, ids, values))


def _of_scene(source: Path, out: Path | None, kind: str, ids: bool, values: bool) -> Path:
    """Draw a scene with its own labels, or write its page, and return the file."""
    scene = load_scene(source)
    with error_context(source):
        assembly = build_assembly(scene)
    target = out or Path(source.with_suffix(f".{kind}").name)
    refuse_itself(source, target)
    if target.suffix == ".html":
        write_text(target, scene_page(scene, assembly))
        return target
    if target.suffix not in (".png", ".svg", ".pdf"):
        raise ParameterError("out", f"{target.name!r} has no known ending", ".png, .svg, .pdf, .html, .gif or .mp4")
    from jld_core.views import figures

    figures.save_figure(figures.figure_of_assembly(assembly, ids=ids, values=values), target)
    return target


def _animate(source: Path, rank: str | None, out: Path | None, kind: str) -> Path:
    """Write an animation of a layout's mechanism under associative friction; return the file."""
    try:
        number = None if rank is None else int(rank)
    except ValueError:
        raise ParameterError("rank", f"{rank!r} is wrong", "one rank for an animation") from None
    scene, assembly, labels, model = layout_of(source, number)
    if scene.cracks != "faces":
        raise InputError(
            f"{source}: cracks", "animations show rigid elements of the grid", 'a still picture, or "faces"'
        )
    name = f"mechanism_{rank or 1}.{kind}"
    target = out or (source / name if source.is_dir() else Path(source.with_suffix(f".{kind}").name))
    refuse_itself(source, target)
    result = solve_rigid(assembly, labels, model)
    if result.governing is not None:
        result = result.cases[result.governing]
    from jld_core.views.figures import save_animation

    save_animation(result, target)
    return target
