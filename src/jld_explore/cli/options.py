"""Define arguments, options and error handling shared by the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from jld_core.errors import InputError

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
