"""Define `jld studio`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jld_explore.cli import options as cli_options
from jld_explore.cli import streams
from jld_formats import ImportOptions


def studio(
    source: Annotated[
        Path | None,
        typer.Argument(help="A scene, drawing or file of solids, or a folder written by jld explore; default: a wall."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
    layer: cli_options.OnlyLayers = None,
    skip: cli_options.SkippedLayers = None,
    hole: cli_options.HoleLayers = None,
    support: cli_options.SupportLayers = None,
    load: cli_options.LoadLayers = None,
    dry: cli_options.DryLayers = None,
    inner: cli_options.InnerLayers = None,
    thickness: cli_options.Thickness = None,
    tolerance: cli_options.Tolerance = None,
    unit: cli_options.FileUnit = None,
    up: cli_options.Up = None,
) -> None:
    """Serve a page on this machine on which the proven load of a layout follows each change.

    Print the address of the page. The server runs until it is interrupted; searches begun from the page are then
    stopped.
    """
    from jld_studio import open_studio

    layers = cli_options.layer_options(
        layer=layer, skip=skip, hole=hole, support=support, load=load, dry=dry, inner=inner
    )
    options = ImportOptions(thickness=thickness, tolerance=tolerance, unit=unit, up=up, **layers)
    open_studio(source, port, streams.say, browser, options)
