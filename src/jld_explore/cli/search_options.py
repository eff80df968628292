"""Define the options of `jld explore` that concern the search and its files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

OutFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder for tables and pictures.", show_default=False)]
DriverName = Annotated[
    str | None, typer.Option(help="Search driver; default: one that proves where the proof is in reach.")
]
Objective = Annotated[
    str,
    typer.Option(
        metavar="[associative|zero-dilation|zero-dilation-floor|experiment|reliability|PLUG-IN]",
        help="Value to maximise: λ; the lowest λ found without dilation, or a proven bound below it (-floor); the "
        "load carried in a virtual experiment; or the reliability index of the best by λ.",
    ),
]
ExperimentOf = Annotated[
    int | None,
    typer.Option("--experiment", min=1, help="Test the best K layouts in the virtual experiment; adds a column."),
]
ReliabilityOf = Annotated[
    int | None,
    typer.Option("--reliability", min=1, help="Rank the best K by their reliability index; default 10 as objective."),
]
CheckFields = Annotated[int, typer.Option(min=0, help="Check the best K by faces with stress fields, 0 for none.")]
MoveBest = Annotated[
    int | None,
    typer.Option("--move", min=1, help="Move joints of the best K, search labels anew there, rank by fields."),
]
Budget = Annotated[int | None, typer.Option(min=1, help="Most layouts evaluated; those equal by symmetry count once.")]
Seconds = Annotated[float | None, typer.Option(min=0.0, help="Time limit, s.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the driver.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the search in the folder.")]
WriteCsv = Annotated[bool, typer.Option("--csv", help="Write results.csv for more than 100 000 layouts too.")]
AllPictures = Annotated[
    bool, typer.Option("--pictures", help="Draw distribution, frequency of dry faces and convergence too.")
]
Cluster = Annotated[
    str | None,
    typer.Option(help="URL of a dask scheduler, tcp://host:8786, whose workers evaluate layouts."),
]
CertificateFile = Annotated[
    Path | None, typer.Option(help="File for the proof of the exact driver; jld verify checks it.")
]
