"""Provide `jld import` and `jld export`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from jld_core import InputError, Layout, blocks_csv, build_assembly, error_context, files, load_scene, parse_scene
from jld_core.models import solve_rigid
from jld_explore.cli import layout as cli_layout
from jld_explore.cli import options as cli_options
from jld_explore.cli import streams
from jld_formats.facts import lost
from jld_formats.formats import FORMATS, export, formats
from jld_formats.libraries import import_file
from jld_formats.options import ImportOptions


@contextmanager
def shown_reading(file: Path) -> Iterator[Callable[[str, int, int], None]]:
    """Show on stderr, if it is a terminal, how much of a file was read, by the function that this yields."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(file=sys.stderr)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[said]}"), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(f"reading {file.name}", total=None, said="")

        def show(what: str, done: int, total: int) -> None:
            bar.update(task, completed=done, total=total or None, said=f"{done} {what}")

        yield show


@cli_options.with_options(cli_options.READING, before="facet")
def import_command(
    file: Annotated[
        Path,
        typer.Argument(help="DXF, SVG, CSV, 3DM, IFC, STEP, OBJ, PLY, STL or COMPAS JSON file.", show_default=False),
    ],
    out: cli_options.Out,
    facet: Annotated[
        float | None,
        typer.Option(help="Largest distance of chords from arcs, in the file's unit; default 1e-3 of the size."),
    ] = None,
    like: Annotated[Path | None, typer.Option(help="Scene to take materials, search and body loads from.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Time in which the file must be read; default 60, and 5 for each megabyte.")
    ] = None,
    as_json: cli_options.AsJson = False,
    **reading: Any,
) -> None:
    """Convert a drawing or a file of solids to a scene, and report what was assumed.

    The report says what was found, snapped, assumed, skipped, and what is doubtful.
    """
    materials = None if like is None else load_scene(like)
    options = ImportOptions(**cli_options.of_reading(reading), facet=facet, like=materials, seconds=seconds)
    cli_options.refuse_itself(file, out)
    with shown_reading(file) as progress:
        imported = import_file(file, options, progress=progress)
    try:
        scene = parse_scene(imported.document, "")
        build_assembly(scene)
    except InputError as error:
        raise imported.in_unit_of_file(error, "--tolerance").within(str(file)) from None
    cli_options.write_scene(scene, out)
    streams.say(json.dumps(imported.facts(), indent=1) if as_json else f"{imported.report}\nwritten to   {out}")


def export_command(
    source: cli_options.Source,
    kind: Annotated[str, typer.Option("--format", help=f"Kind of file: {', '.join(FORMATS)}.", show_default=False)],
    out: Annotated[Path, typer.Option("-o", "--out", help="File to write; blocks.csv beside it.", show_default=False)],
    rank: cli_options.Rank = None,
    cells: Annotated[
        bool, typer.Option("--cells", help="Write every element as a separate solid (formats of solids).")
    ] = False,
    unit: Annotated[
        str | None, typer.Option(help="Unit of the file's lengths (mm, cm, m, in, ft); default that of the scene.")
    ] = None,
) -> None:
    """Write the blocks of a layout to a file of another program, and a table of them.

    The table has the name of the file with the ending .blocks.csv.
    """
    if not out.name:
        raise InputError(str(out), "it is no name of a file", "a file in a folder that is there")
    table = out.with_suffix(".blocks.csv")
    for file in (out, table):
        cli_options.refuse_itself(source, file)
    scene, assembly, labels, model = cli_layout.layout_of(source, rank)
    solved = kind in FORMATS and formats()[kind].analysed
    layout = Layout(scene, assembly, labels, solve_rigid(assembly, labels, model) if solved else None)
    with error_context(source, str(out)):
        export(layout, kind, out, cells=cells, unit=unit)
    files.write_text(table, blocks_csv(layout))
    if gone := lost(layout, kind, cells=cells):
        streams.say(f"not kept     {', '.join(gone)}")
    free = sum(1 for block in layout.blocks if block.cells)
    kinds = len({block.shape for block in layout.blocks if block.cells})
    streams.say(f"{out}\n{table}: {free} block{'s' * (free != 1)} of {kinds} shape{'s' * (kinds != 1)}")
