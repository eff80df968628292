"""Provide `jld design`: the blocks of an outline, found, moved, checked and explained."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from jld_core import ParameterError, error_context
from jld_explore.cli import ending, streams
from jld_explore.cli import options as cli_options
from jld_formats import forces as exchange_forces

OutlineFile = Annotated[
    Path, typer.Argument(help="Outline: scene, drawing (DXF, SVG, CSV) or solid (OBJ, PLY, STL).", show_default=False)
]
Folder = Annotated[Path, typer.Option("-o", "--out", help="Folder for page, picture and scene.", show_default=False)]


@cli_options.with_options({k: v for k, v in cli_options.READING.items() if k != "load"}, before="laid")
def design(
    context: typer.Context,
    outline: OutlineFile,
    out: Folder,
    block_mass: Annotated[float | None, typer.Option(help="Largest mass of a block, kg.")] = None,
    shapes: Annotated[int | None, typer.Option(help="Largest number of different blocks (moulds).")] = None,
    load: Annotated[
        list[str] | None,
        typer.Option(
            help='Force downwards, as "10 kN" (a number alone in the unit of a scene), or layers of live loads.'
        ),
    ] = None,
    along: Annotated[
        str,
        typer.Option(help="Where the load acts: top, bottom, left, right, extrados, or an edge by its ends X,Y,X,Y."),
    ] = "top",
    places: Annotated[
        str, typer.Option(help="Number of places of the load, or shares of the length, as 0.25,0.5.")
    ] = "1",
    width: Annotated[
        float | None, typer.Option(help="Length that the load is spread on, m; default a tenth of the top.")
    ] = None,
    push: Annotated[float | None, typer.Option(help="Horizontal load to either side, share of the weight.")] = None,
    friction: Annotated[float | None, typer.Option(help="Friction coefficient of joints.")] = None,
    friction_low: Annotated[
        float | None, typer.Option(help="Low friction to check the best at; default 0.8 times --friction.")
    ] = None,
    density: Annotated[float | None, typer.Option(help="Density of the stone, kg/m³.")] = None,
    tension: Annotated[float | None, typer.Option(help="Tensile strength of the stone, Pa.")] = None,
    shear: Annotated[float | None, typer.Option(help="Shear strength of the stone, Pa.")] = None,
    laid: Annotated[
        Literal["translation", "standing", "left-to-right", "right-to-left", "springings"] | None,
        typer.Option(help="Only layouts that can be laid (from where), or whose every stage stands."),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Time limit of all together, s.")] = 300.0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of searches and irregular cells.")] = 0,
    as_json: cli_options.AsJson = False,
    **reading: Any,
) -> None:
    """Design the blocks of an outline: cells tried, joints searched and moved, the best checked.

    The folder holds a page in plain words, a picture, the table of blocks and the scene of the best layout. After a
    signal it holds the best so far.
    """
    from jld_practice.design import DesignOptions, facts_of
    from jld_practice.design.page import words_of
    from jld_practice.design.run import design_outline

    forces = [text for text in load or () if exchange_forces.is_force(text)]
    if len(forces) > 1:
        raise ParameterError("load", f"{len(forces)} forces are given", "one force, which may act at several places")
    options = DesignOptions(
        block_mass=block_mass,
        shapes=shapes,
        load=forces[0] if forces else None,
        along=along,
        places=places,
        width=width,
        push=push,
        friction=friction,
        friction_low=friction_low,
        density=density,
        tension=tension,
        shear=shear,
        load_layer=tuple(text for text in load or () if text not in forces),
        **cli_options.of_reading(reading),
        laid=laid,
        seconds=seconds,
        jobs=jobs or os.cpu_count() or 1,
        seed=seed,
    )
    ending.raise_on_signals()
    with error_context(outline, str(out), str(outline)):
        result = design_outline(outline, out, options, None if as_json else streams.say, started=context.obj)
    streams.say(json.dumps(facts_of(result), indent=1) if as_json else words_of(result))
