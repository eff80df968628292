"""Animation of an assembly sequence: its stages one after the other, as a GIF."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Final

from PIL import Image

from jld_core import checkpoint, files
from jld_practice.laying import Laying
from jld_practice.laying.strip import figure_of_stage

_STAGE, _END = 700, 2500
"""Time that a stage and the last stage are shown, ms."""

_DPI: Final = 100  # resolution of a stage, dots per inch

_COLOURS: Final = 64  # number of colours of the animation: drawings have few


def save_laying_animation(laying: Laying, path: Path) -> None:
    """Write the stages of an order of laying as a GIF that repeats; ValueError without steps."""
    # Each stage is drawn as by `figure_of_stage`.
    frames = []
    for number in range(1, len(laying.steps) + 1):
        checkpoint()
        figure = figure_of_stage(laying, number)
        picture = BytesIO()
        figure.savefig(picture, format="png", dpi=_DPI)
        frames.append(Image.open(picture).convert("RGB").quantize(_COLOURS))
    if not frames:
        raise ValueError("a sequence without steps has nothing to animate")
    times = [_STAGE] * (len(frames) - 1) + [_END]
    with files.whole_file(path) as fresh:
        frames[0].save(fresh, "GIF", save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)
