"""Define arguments, options and error handling shared by the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jld_core.errors import InputError

SceneFile = Annotated[Path, typer.Argument(help="Scene file (JSON).", show_default=False)]
Source = Annotated[Path, typer.Argument(help="A scene file, or a folder written by jld explore.", show_default=False)]
Rank = Annotated[int | None, typer.Option(min=1, help="Row of a folder's results.csv; default 1.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def refuse_itself(source: Path, out: Path) -> None:
    """Raise InputError if the output file is the input file."""
    if out.exists() and source.exists() and out.samefile(source):
        raise InputError(str(out), "it is the file that is read", "another file")
