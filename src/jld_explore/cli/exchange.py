"""Provide `jld import`, `jld export` and `jld refine`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from jld_core.build.assemble import build_assembly
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.exchange import FORMATS, ImportOptions, Layout, blocks_csv, export, import_file
from jld_core.exchange.facts import lost
from jld_core.exchange.formats import formats
from jld_core.files import write_text
from jld_core.models import solve_rigid
from jld_core.refinement import refine
from jld_core.refinement.bonds import BONDS
from jld_core.refinement.transfer import KINDS
from jld_core.scene.reading import load_scene, parse_scene
from jld_explore.cli.layout import layout_of
from jld_explore.cli.options import (
    AsJson,
    DryLayers,
    FileUnit,
    HoleLayers,
    InnerLayers,
    LoadLayers,
    OnlyLayers,
    Out,
    Rank,
    SceneFile,
    SkippedLayers,
    Source,
    SupportLayers,
    Thickness,
    Tolerance,
    Up,
    layer_options,
    refuse_itself,
    write_scene,
)
from jld_explore.cli.streams import say


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


def import_command(
    file: Annotated[
        Path,
        typer.Argument(help="DXF, SVG, CSV, 3DM, IFC, STEP, OBJ, PLY, STL or COMPAS JSON file.", show_default=False),
    ],
    out: Out,
    layer: OnlyLayers = None,
    skip: SkippedLayers = None,
    hole: HoleLayers = None,
    support: SupportLayers = None,
    load: LoadLayers = None,
    dry: DryLayers = None,
    inner: InnerLayers = None,
    thickness: Thickness = None,
    tolerance: Tolerance = None,
    facet: Annotated[
        float | None,
        typer.Option(help="Largest distance of chords from arcs, in the file's unit; default 1e-3 of the size."),
    ] = None,
    unit: FileUnit = None,
    up: Up = None,
    like: Annotated[Path | None, typer.Option(help="Scene to take materials, search and body loads from.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Time in which the file must be read; default 60, and 5 for each megabyte.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Convert a drawing or a file of solids to a scene, and report what was assumed.

    The report says what was found, snapped, assumed, skipped, and what is doubtful.
    """
    layers = layer_options(layer=layer, skip=skip, hole=hole, support=support, load=load, dry=dry, inner=inner)
    options = ImportOptions(
        **layers,
        thickness=thickness,
        tolerance=tolerance,
        facet=facet,
        unit=unit,
        up=up,
        like=None if like is None else load_scene(like),
        seconds=seconds,
    )
    refuse_itself(file, out)
    with shown_reading(file) as progress:
        found = import_file(file, options, progress=progress)
    try:
        scene = parse_scene(found.document, "")
        build_assembly(scene)
    except InputError as error:
        raise found.in_unit_of_file(error, "--tolerance").within(str(file)) from None
    write_scene(scene, out)
    say(json.dumps(found.facts(), indent=1) if as_json else f"{found.report}\nwritten to   {out}")


def export_command(
    source: Source,
    kind: Annotated[str, typer.Option("--format", help=f"Kind of file: {', '.join(FORMATS)}.", show_default=False)],
    out: Annotated[Path, typer.Option("-o", "--out", help="File to write; blocks.csv beside it.", show_default=False)],
    rank: Rank = None,
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
    table = out.with_suffix(".blocks.csv")
    for file in (out, table):
        refuse_itself(source, file)
    scene, assembly, labels, model = layout_of(source, rank)
    solved = kind in FORMATS and formats()[kind].analysed
    layout = Layout(scene, assembly, labels, solve_rigid(assembly, labels, model) if solved else None)
    with error_context(source, str(out)):
        export(layout, kind, out, cells=cells, unit=unit)
    write_text(table, blocks_csv(layout))
    if gone := lost(layout, kind, cells=cells):
        say(f"not kept     {', '.join(gone)}")
    free = sum(1 for block in layout.blocks if block.cells)
    kinds = len({block.shape for block in layout.blocks if block.cells})
    say(f"{out}\n{table}: {free} block{'s' * (free != 1)} of {kinds} shape{'s' * (kinds != 1)}")


def refine_command(
    scene: SceneFile,
    out: Out,
    cell: Annotated[
        str | None, typer.Option(help="Size of a cell: A, A,B or A,B,C; radial: THICKNESS,DEGREES; bond: BRICK,COURSE.")
    ] = None,
    kind: Annotated[str, typer.Option(help="Cells: " + ", ".join(KINDS) + ".")] = "grid",
    by: Annotated[str | None, typer.Option(help="Old joints without a search: block or material.")] = None,
    centre: Annotated[
        str | None, typer.Option(help="Centre of radial cells, or of the joints of a flat arch: x,y.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of Voronoi cells.")] = 0,
    bond: Annotated[str, typer.Option(help="Masonry bond: " + ", ".join(BONDS) + ".")] = "running",
    voussoirs: Annotated[
        int | None,
        typer.Option(
            min=1, help="Voussoirs from springing to springing of each arc of the outline, or of a flat arch."
        ),
    ] = None,
    rings: Annotated[int, typer.Option(min=1, help="Rings of voussoirs over the depth.")] = 1,
    courses: Annotated[int, typer.Option(min=1, help="Voussoirs along the axis of a vault (spatial).")] = 1,
    skew: Annotated[
        float | None,
        typer.Option(help="Angle of the outer joints of a flat arch to its soffit's normal, degrees."),
    ] = None,
    snap: Annotated[
        float, typer.Option(help="Share of a cell by which its corners move to those of the outline (planar).")
    ] = 0.0,
    lintel: Annotated[
        int,
        typer.Option(min=1, help="Stones over an opening of a wall drawn as a solid: 1, or wedges of a flat arch."),
    ] = 1,
    bearing: Annotated[
        float | None, typer.Option(help="Least length by which these lintels reach beyond the jambs.")
    ] = None,
) -> None:
    """Split every element of a scene into cells, whose faces a search can choose from.

    Write the new scene, and print what could not be kept of the old one.
    """
    sizes = () if cell is None else _numbers("cell", cell)
    middle = None if centre is None else _numbers("centre", centre)
    if middle is not None and len(middle) != 2:
        raise ParameterError("centre", f"{centre!r} is wrong", "x,y")
    parsed = load_scene(scene)
    place = None if middle is None else (middle[0], middle[1])
    with error_context(scene):
        found = refine(
            parsed,
            sizes,
            kind=kind,
            by=by,
            centre=place,
            seed=seed,
            bond=bond,
            voussoirs=voussoirs,
            rings=rings,
            courses=courses,
            snap=snap,
            skew=skew,
            lintel=lintel,
            bearing=bearing,
        )
    write_scene(found.scene, out)
    before, after = len(set(found.parent.values())), len(found.parent)
    told = [*(f"assumed      {note}" for note in found.notes), f"found        {after} elements out of {before}"]
    say("\n".join([*told, f"written to   {out}"]))


def _numbers(option: str, text: str) -> tuple[float, ...]:
    """Convert comma-separated text to numbers; raise InputError if it is invalid."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ParameterError(option, f"{text!r} is wrong", "numbers, as 0.1,0.2") from None
