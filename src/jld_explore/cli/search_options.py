"""Define the options of `jld explore` that concern the search and its files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jld_explore.settings import (
    ObjectiveName,
)

OutFolder = Annotated[Path, typer.Option(help="Folder for tables and pictures.", show_default=False)]
DriverName = Annotated[
    str | None, typer.Option(help="Search driver; default: one that proves where the proof is in reach.")
]
Objective = Annotated[
    ObjectiveName,
    typer.Option(
        help="What is maximised: λ; without dilation the lowest found, or a proven bound below it (-floor); or "
        "what a virtual experiment carries; or the reliability index of the best by λ."
    ),
]
ExperimentOf = Annotated[
    int | None,
    typer.Option("--experiment", min=1, help="Put the best K to the virtual experiment: a column more."),
]
ReliabilityOf = Annotated[
    int | None,
    typer.Option("--reliability", min=1, help="Rank the best K by their reliability index; default 10 as objective."),
]
CheckFields = Annotated[int, typer.Option(min=0, help="Check the best K of a search by faces by fields, 0 for none.")]
MoveBest = Annotated[
    int | None,
    typer.Option("--move", min=1, help="Move joints of the best K, search labels anew there, rank by fields."),
]
Budget = Annotated[int | None, typer.Option(min=1, help="Distinct classes evaluated at the most.")]
Seconds = Annotated[float | None, typer.Option(min=0.0, help="Time limit.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the driver.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a folder that holds a study.")]
WriteCsv = Annotated[bool, typer.Option("--csv", help="Write results.csv also of more than 100 000 layouts.")]
Cluster = Annotated[
    str | None,
    typer.Option(help="Scheduler of dask, tcp://host:8786, whose workers evaluate."),
]
CertificateFile = Annotated[
    Path | None, typer.Option(help="Exact driver: file for its proof, which jld verify checks.")
]
