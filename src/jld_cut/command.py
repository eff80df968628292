"""Provide `jld cut`: a closed solid to parts that fit, go together, and carry a load."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from jld_core import ParameterError
from jld_cut.cut import Options, cut
from jld_cut.families import FAMILIES
from jld_cut.scene import Matter
from jld_explore.cli import options, streams


def cut_(
    solid: Annotated[Path, typer.Argument(help="STL, OBJ or 3MF file of one closed solid.", show_default=False)],
    fit: Annotated[str, typer.Option(help="X,Y,Z: sides of the box that each part must fit in, file's unit.")],
    load: Annotated[
        list[str], typer.Option(help="FX,FY,FZ[@x0,y0,z0,x1,y1,z1] in N, or body:X,Y,Z; may be given again.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for parts, tables and pictures.")],
    mass: Annotated[float | None, typer.Option(help="Largest mass of a part, kg.")] = None,
    parts: Annotated[int | None, typer.Option(min=1, help="Most parts.")] = None,
    alike: Annotated[int | None, typer.Option(min=1, help="Most different shapes of parts.")] = None,
    require: Annotated[float, typer.Option(help="Load factor that the parts must carry.")] = 1.0,
    support: Annotated[
        list[str] | None, typer.Option(help="x0,y0,z0,x1,y1,z1: faces in it are held; default: those on the ground.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of all lengths: mm, cm, m, in or ft; default that of a 3MF file, else m.")
    ] = None,
    clearance: Annotated[float, typer.Option(help="Gap of joints, file's unit.")] = 0.0,
    density: Annotated[float, typer.Option(min=1e-6, help="kg/m³.")] = 2400.0,
    friction_angle: Annotated[float, typer.Option(min=0.0, max=89.0, help="Of joints, degrees.")] = 35.0,
    tensile: Annotated[float, typer.Option(min=0.0, help="Tensile strength of the material, Pa.")] = 2e6,
    shear: Annotated[float, typer.Option(min=0.0, help="Its shear strength, Pa.")] = 2e6,
    compressive: Annotated[float | None, typer.Option(min=0.0, help="Its compressive strength, Pa.")] = None,
    family: Annotated[list[str] | None, typer.Option(help=f"Ways to cut: {', '.join(FAMILIES)}; default all.")] = None,
    cells: Annotated[int, typer.Option(min=2, max=60, help="Cells that a way to cut aims at.")] = 24,
    tenons: Annotated[
        bool, typer.Option("--tenons", help="Tenons at joints that a part is laid straight onto.")
    ] = False,
    marks: Annotated[bool, typer.Option("--marks", help="Engrave number and arrow, up as the part stands.")] = False,
    keys: Annotated[
        bool, typer.Option("--keys/--no-keys", help="Tongues, steps or keys where parts slide and these raise λ.")
    ] = True,
    seconds: Annotated[float, typer.Option(help="Time for all, s.")] = 60.0,
    keep_whole: Annotated[
        list[str] | None, typer.Option(help="x0,y0,z0,x1,y1,z1: no joint meets this box; may be given again.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Cut a closed solid to numbered parts that fit a box, go together, and carry a load.

    The fewest parts with the required load factor are sought in several ways; λ of the best is by convex cells
    that crack between them, by fields where known.
    """
    try:
        x, y, z = (float(word) for word in fit.split(","))
    except ValueError:
        raise ParameterError("fit", f"{fit!r} is not three numbers", "X,Y,Z") from None
    settings = Options(
        (x, y, z),
        tuple(load),
        mass=mass,
        parts=parts,
        alike=alike,
        require=require,
        support=tuple(support or ()),
        matter=Matter(density, friction_angle, tensile, shear, compressive),
        clearance=clearance,
        families=tuple(family or FAMILIES),
        cells=cells,
        unit=unit,
        seconds=seconds,
        keep_whole=tuple(keep_whole or ()),
        tenons=tenons,
        marks=marks,
        keys=keys,
    )

    def warn(line: str) -> None:
        streams.remark(f"jld: warning: {solid}: {line}")

    summary = cut(solid, settings, out, None if as_json else streams.say, warn)
    streams.say(json.dumps(summary, indent=1) if as_json else f"written to   {out}")
