"""Provide `jld refine`."""

from __future__ import annotations

from typing import Annotated

import typer

from jld_core import ParameterError, error_context, load_scene
from jld_core.refinement import KINDS, refine
from jld_explore.cli import options as cli_options
from jld_explore.cli import streams
from jld_masonry.bonds import BONDS


def refine_command(
    scene: cli_options.SceneFile,
    out: cli_options.Out,
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
        float | None, typer.Option(help="Angle of the outer joints of a flat arch to its soffit's normal, degrees.")
    ] = None,
    snap: Annotated[
        float, typer.Option(help="Share of a cell by which its corners move to those of the outline (planar).")
    ] = 0.0,
    lintel: Annotated[
        int, typer.Option(min=1, help="Stones over an opening of a wall drawn as a solid: 1, or wedges of a flat arch.")
    ] = 1,
    bearing: Annotated[
        float | None, typer.Option(help="Least length by which these lintels reach beyond the jambs.")
    ] = None,
) -> None:
    """Split every element of a scene into cells, whose faces a search can choose from.

    Write the new scene, and print what could not be kept of the old one.
    """
    cli_options.refuse_itself(scene, out)
    sizes = () if cell is None else _numbers("cell", cell)
    middle = None if centre is None else _numbers("centre", centre)
    if middle is not None and len(middle) != 2:
        raise ParameterError("centre", f"{centre!r} is wrong", "x,y")
    parsed = load_scene(scene)
    centre_point = None if middle is None else (middle[0], middle[1])
    with error_context(scene):
        refined = refine(
            parsed,
            sizes,
            kind=kind,
            by=by,
            centre=centre_point,
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
    cli_options.write_scene(refined.scene, out)
    before, after = len(set(refined.parent.values())), len(refined.parent)
    lines = [*(f"assumed      {note}" for note in refined.notes), f"found        {after} elements out of {before}"]
    streams.say("\n".join([*lines, f"written to   {out}"]))


def _numbers(option: str, text: str) -> tuple[float, ...]:
    """Convert comma-separated text to numbers; raise InputError if it is invalid."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ParameterError(option, f"{text!r} is wrong", "numbers, as 0.1,0.2") from None
