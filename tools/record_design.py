"""Draw designs of `python -m benchmarks.designs` in docs/images: best layouts, and a recording of the wall."""

from __future__ import annotations

import io
import json
import shlex
from pathlib import Path
from typing import Final

import numpy as np
from benchmarks.common import ROOT
from benchmarks.designs import COMMANDS, RUNS
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from jld_practice import pages_of
from jld_practice.design import DesignOptions, read_outline
from jld_practice.printing import content_of

IMAGES: Final = ROOT / "docs" / "images"
_SIZE: Final = (7.2, 4.8)  # size of a frame of the recording, inches; at 100 dots per inch


def frame(figure: Figure) -> Image.Image:
    stream = io.BytesIO()
    figure.savefig(stream, dpi=100, facecolor="white")
    return fitted(Image.open(stream))


def page_frame(figure: Figure) -> Image.Image:
    """Return what a printed page shows above its foot, as large as a frame allows."""
    stream = io.BytesIO()
    figure.savefig(stream, dpi=200, facecolor="white")
    page = Image.open(stream).convert("RGB")
    page = page.crop((0, 0, page.width, round(0.95 * page.height)))
    left, top, right, low = ImageChops.invert(page).getbbox() or (0, 0, *page.size)
    return fitted(page.crop((left - 20, top - 20, right + 20, low + 20)))


def fitted(picture: Image.Image) -> Image.Image:
    """Return a picture scaled into a frame, on white."""
    size = (round(100 * _SIZE[0]), round(100 * _SIZE[1]))
    picture = picture.convert("RGB")
    picture.thumbnail(size, Image.Resampling.LANCZOS)
    page = Image.new("RGB", size, "white")
    page.paste(picture, ((size[0] - picture.width) // 2, (size[1] - picture.height) // 2))
    return page


def drawing_frame(file: Path) -> Image.Image:
    figure = Figure(figsize=_SIZE, layout="constrained")
    ax = figure.subplots()
    for one in read_outline(file, DesignOptions(thickness=0.3, friction=0.6)).scene.elements or ():
        if not one.support:
            points = np.array(one.polygon)
            ax.fill(*points.T, facecolor="#e8e2d4", edgecolor="#333333", linewidth=1.2)
    ax.set_aspect("equal")
    ax.set_title(f"{file.name}: the drawing", fontsize=12)
    ax.set_xlabel("m")
    return frame(figure)


def terminal_frame(command: str, lines: list[tuple[float, str]]) -> Image.Image:
    """Return a frame of a terminal: the command, and the last lines with their times in seconds."""
    figure = Figure(figsize=_SIZE, facecolor="white")
    shown = [f"$ {command}", "", *(f"{at:6.0f} s  {line}" for at, line in lines[-17:])]
    for place, line in enumerate(shown):
        text = line if len(line) <= 92 else line[:91] + "…"
        figure.text(0.02, 0.95 - 0.048 * place, text, family="monospace", fontsize=8.5, va="top", parse_math=False)
    return frame(figure)


def record(name: str, path: Path) -> None:
    """Write a recording of a finished run: drawing, lines of the terminal, the best layout, and the printed pages."""
    folder = RUNS / name
    lines: list[tuple[float, str]] = [(at, line) for at, line in json.loads((folder / "log.json").read_text())]
    file, *options = shlex.split(COMMANDS[name])
    command = f"jld design {file} -o out/{name} {shlex.join(options)}"
    frames = [(drawing_frame(ROOT / "scenes" / "outlines" / file), 2500)]
    for count in range(0, len(lines) + 1, 2):
        frames.append((terminal_frame(command, lines[:count]), 600))
    frames.append((terminal_frame(command, lines), 2500))
    frames.append((fitted(Image.open(folder / "best.png")), 4000))
    frames.append((terminal_frame(f"jld report out/{name} --pdf", []), 1000))
    frames += [(page_frame(page), 3500) for page in pages_of(content_of(folder, None))]
    pictures = [picture.quantize(40, dither=Image.Dither.NONE) for picture, _ in frames]
    times = [lasting for _, lasting in frames]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=times, loop=0, optimize=True)


def main() -> None:
    """Draw every run that is there."""
    for name in COMMANDS:
        if (RUNS / name / "best.png").exists():
            picture = Image.open(RUNS / name / "best.png").convert("RGB").quantize(64, dither=Image.Dither.NONE)
            picture.save(IMAGES / f"design_{name}.png", optimize=True)
    if (RUNS / "wall" / "log.json").exists():
        record("wall", IMAGES / "design.gif")


if __name__ == "__main__":
    main()
