"""`jld import`: files of other programs in as scenes, blocks out as files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.exchange import ImportOptions, import_file
from jld_core.scene import load_scene, parse_scene
from jld_explore.cli.samples import Out, write_scene


def add_to(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command(name="import")(import_command)


def import_command(
    file: Annotated[Path, typer.Argument(help="DXF, SVG, CSV, OBJ, PLY, STL or COMPAS JSON file.", show_default=False)],
    out: Out,
    support: Annotated[
        list[str] | None, typer.Option(help="Layer of supports, or: lowest. May be given again.")
    ] = None,
    dry: Annotated[list[str] | None, typer.Option(help="Layer of dry joints.")] = None,
    inner: Annotated[list[str] | None, typer.Option(help="Layer of inner faces.")] = None,
    load: Annotated[list[str] | None, typer.Option(help="Layer of live loads.")] = None,
    thickness: Annotated[float | None, typer.Option(help="Out-of-plane thickness; default 1.")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Gaps and overlaps up to it are closed; default 1e-6 of the size.")
    ] = None,
    facet: Annotated[
        float | None, typer.Option(help="Largest distance of chords from arcs; default 1e-3 of the size.")
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the file's lengths, made metres; default its own.")] = None,
    like: Annotated[Path | None, typer.Option(help="Scene to take materials, search and body loads from.")] = None,
) -> None:
    """Make a scene of a drawing, and say what was found, snapped, assumed and skipped."""
    options = ImportOptions(
        support=tuple(support or ()),
        dry=tuple(dry or ()),
        inner=tuple(inner or ()),
        load=tuple(load or ()),
        thickness=thickness,
        tolerance=tolerance,
        facet=facet,
        unit=unit,
        like=None if like is None else load_scene(like),
    )
    found = import_file(file, options)
    try:
        scene = parse_scene(found.document, "")
        build_assembly(scene)
    except InputError as error:
        raise InputError(f"{file}: {error.where.lstrip(': ')}", error.problem, error.expected) from None
    write_scene(scene, out)
    sys.stdout.write(f"{found.report}\nwritten to   {out}\n")
