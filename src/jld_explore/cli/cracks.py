"""Options of the crack models: `--cracks faces|cells:SIZE|fields[:GAP]`."""

from __future__ import annotations

from typing import Annotated

import typer

from jld_core.scene import Scene, parse_cracks

Cracks = Annotated[
    str | None,
    typer.Option(
        help="How blocks crack: faces, cells:SIZE or fields[:GAP]; default: as the scene says, or along its faces."
    ),
]
Seconds = Annotated[
    float | None,
    typer.Option(
        "--seconds", min=0.0, help="Time after which nothing further is tried, of each load case, s; 60 by fields."
    ),
]


def with_cracks(scene: Scene, text: str | None) -> Scene:
    """Return a scene with the crack model that the option --cracks names.

    Raises InputError for an unknown model.
    """
    return scene if text is None else scene.model_copy(update={"cracks": parse_cracks(text)})
