"""A command: `jld count-stones SCENE`."""

from pathlib import Path
from typing import Annotated

import typer

from jld_core import build_assembly, load_scene


def count_stones(
    scene: Annotated[Path, typer.Argument(help="Scene file.")],
    supports: Annotated[bool, typer.Option("--supports", help="Count supports too.")] = False,
) -> None:
    """Print how many elements a scene has."""
    elements = build_assembly(load_scene(scene)).elements
    print(len(elements) if supports else int((~elements.support).sum()))
