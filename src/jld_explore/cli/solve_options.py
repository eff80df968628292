"""Define the options of `jld solve` alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jld_core.limit import (
    Friction,
)

SolvedFile = Annotated[Path, typer.Argument(help="Scene file (JSON), or a folder of jld explore.", show_default=False)]
FrictionModel = Annotated[Friction, typer.Option(help="Associative, or sliding without dilation.")]
SolutionRange = Annotated[
    bool, typer.Option("--range", help="With --friction zero-dilation: search the lowest and the highest λ.")
]
FloorSeconds = Annotated[
    float, typer.Option(help="With --range: processor time for the bound below the lowest λ, 0 for none.")
]
ResultFolder = Annotated[Path | None, typer.Option("-o", "--out", help="Folder for result.json and pictures.")]
Sensitivities = Annotated[
    bool | None,
    typer.Option(
        "--sensitivities/--no-sensitivities",
        help="Rates of λ with strengths and weight; default: up to 128 faces.",
        show_default=False,
    ),
]
