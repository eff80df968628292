"""Define `jld studio`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jld_explore.cli import options as cli_options
from jld_explore.cli import streams
from jld_formats import ImportOptions


@cli_options.with_options(cli_options.READING)
def studio(
    source: Annotated[
        Path | None,
        typer.Argument(help="A scene, drawing or file of solids, or a folder written by jld explore; default: a wall."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
    **reading: Any,
) -> None:
    """Serve a page on this machine on which the proven load of a layout follows each change.

    Print the address of the page. The server runs until it is interrupted; searches begun from the page are then
    stopped.
    """
    from jld_studio import open_studio

    open_studio(source, port, streams.say, browser, ImportOptions(**cli_options.of_reading(reading)))
