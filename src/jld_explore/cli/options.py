"""Define arguments and options shared by the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from jld_core.errors import InputError
from jld_core.files import write_text
from jld_core.limit.options import Condense, Contacts
from jld_core.mechanics.standard import InnerBending
from jld_core.scene.cracks import parse_cracks
from jld_core.scene.schema import Scene
from jld_core.solvers import SOLVERS

Out = Annotated[Path, typer.Option("-o", "--out", help="Scene file to write.", show_default=False)]
SceneFile = Annotated[Path, typer.Argument(help="Scene file (JSON).", show_default=False)]
Source = Annotated[Path, typer.Argument(help="A scene file, or a folder written by jld explore.", show_default=False)]
Rank = Annotated[int | None, typer.Option(min=1, help="Row of a folder's results.csv; default 1.")]
OnlyLayers = Annotated[
    list[str] | None,
    typer.Option("--layer", help="Only these layers are read, beside those with a role; * and ?, may be given again."),
]
SkippedLayers = Annotated[list[str] | None, typer.Option("--skip", help="Layers that are not read.")]
HoleLayers = Annotated[list[str] | None, typer.Option("--hole", help="Layers of openings.")]
SupportLayers = Annotated[list[str] | None, typer.Option("--support", help="Layers of supports, or: lowest.")]
LoadLayers = Annotated[
    list[str] | None, typer.Option("--load", help="Layers of live loads; numbered layers are load cases.")
]
DryLayers = Annotated[list[str] | None, typer.Option("--dry", help="Layers of dry joints.")]
InnerLayers = Annotated[list[str] | None, typer.Option("--inner", help="Layers of inner faces.")]
Thickness = Annotated[float | None, typer.Option(help="Out-of-plane thickness of a drawing, m; default 1.")]
Tolerance = Annotated[
    float | None,
    typer.Option(help="Gaps and overlaps up to it are closed, in the file's unit; default 5e-4 of the size."),
]
FileUnit = Annotated[
    str | None, typer.Option(help="Unit of the file's lengths (mm, cm, m, in, ft), made metres; default its own.")
]
Up = Annotated[Literal["y", "z"] | None, typer.Option(help="Axis of solids that points upwards; default z.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def layer_options(**given: list[str] | None) -> dict[str, Any]:
    """Return the options of a command that name layers as those of `ImportOptions`."""
    return {name: tuple(patterns or ()) for name, patterns in given.items()}


def refuse_itself(source: Path, out: Path) -> None:
    """Raise InputError if the output file is the input file."""
    if out.exists() and source.exists() and out.samefile(source):
        raise InputError(str(out), "it is the file that is read", "another file")


EffectiveArea = Annotated[
    bool, typer.Option("--effective-area", help="Base torsion on the area in compression (spatial).")
]

Contact = Annotated[
    Contacts, typer.Option(help="Resultants at centres of pressure, or points at the corners of dry faces.")
]

Bending = Annotated[
    InnerBending, typer.Option(help="Bending of spatial inner faces: uncoupled, or by elastic edge stress.")
]

Blocks = Annotated[
    Condense, typer.Option(help="Rigid blocks that crack where needed; auto: where inner faces are very strong.")
]

First = Annotated[
    str,
    typer.Option(help="First solver: " + ", ".join(SOLVERS) + "; others follow where it proves nothing."),
]

Gap = Annotated[float, typer.Option(help="Relative width of the bracket to aim at.")]

Strict = Annotated[bool, typer.Option("--strict", help="Treat plausibility warnings as errors.")]

Robust = Annotated[
    bool, typer.Option("--robust", help="Use the low values of materials; λ at nominal values is stated as well.")
]


def asked(context: typer.Context, values: dict[str, Any]) -> dict[str, Any]:
    """Return those values, by name of the option, that the command line states itself."""
    sources = {name: context.get_parameter_source(f"{name}_" if name == "range" else name) for name in values}
    # by name, since typer may bring a click of its own
    return {name: value for name, value in values.items() if getattr(sources[name], "name", "") == "COMMANDLINE"}


Cracks = Annotated[
    str | None,
    typer.Option(
        help="How blocks crack: faces, cells:SIZE or fields[:GAP]; default: as the scene says, or along its faces."
    ),
]
CaseSeconds = Annotated[
    float | None,
    typer.Option(
        "--seconds", min=0.0, help="Time after which nothing further is tried, of each load case, s; 60 by fields."
    ),
]


def with_cracks(scene: Scene, text: str | None) -> Scene:
    return scene if text is None else scene.model_copy(update={"cracks": parse_cracks(text)})


def write_scene(scene: Scene, out: Path) -> None:
    """Write a scene file, completely or not at all; keys with default values are left out."""
    if out.is_dir():
        raise InputError(str(out), "it is a folder", "the name of a scene file")
    if not out.absolute().parent.is_dir():
        raise InputError(str(out), "its folder does not exist", "a file in a folder that is there")
    write_text(out, scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
