"""Run `jld design` on four outlines: ``python -m benchmarks.designs [NAME…] [--draw]``.

Each outline of `scenes/outlines` is designed by one command and printed by another. Pictures go to `docs/images`, with
a recording of the wall from the drawing to the printed pages. `--draw` writes them again from runs in `out/examples`.
"""

from __future__ import annotations

import io
import json
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from benchmarks.common import ROOT, about, table, write
from jld_practice import pages_of
from jld_practice.design import DesignOptions, read_outline
from jld_practice.printing import content_of

STONE: Final = "--friction 0.6 --density 2000 --tension 3e5 --shear 5e5"
"""Options of the stone, the same for all outlines."""

COMMANDS: Final = {
    "wall": f'wall.svg --load "10 kN" --places 0.25 --push 0.05 --block-mass 56 --thickness 0.3 {STONE} --seconds 480',
    "bridge": f'bridge.csv --load "40 kN" --places 0.25,0.5 --block-mass 2500 --thickness 1 {STONE} --seconds 240',
    "jack_arch": f'jack_arch.csv --load "20 kN" --places 0.25,0.5 --block-mass 60 --thickness .3 {STONE} --seconds 120',
    "vault": f'vault.obj --load "5 kN" --places 0.25 --block-mass 600 {STONE} --seconds 240',
}
"""Outline and options of each example."""

RUNS: Final = ROOT / "out" / "examples"
IMAGES: Final = ROOT / "docs" / "images"

_SIZE: Final = (7.2, 4.8)
"""Size of a frame of the recording, inches; at 100 dots per inch."""


def run(name: str) -> None:
    """Design one outline and print it, as a user does; keep the lines with their times."""
    folder = RUNS / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    file, *options = shlex.split(COMMANDS[name])
    command = [sys.executable, "-m", "jld_explore", "design", f"scenes/outlines/{file}", "-o", str(folder), *options]
    start, lines = time.perf_counter(), []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        for line in process.stdout or ():
            lines.append((round(time.perf_counter() - start, 1), line.rstrip()))
            print(line, end="")
    if process.returncode:
        raise SystemExit(process.returncode)
    (folder / "log.json").write_text(json.dumps(lines), encoding="utf-8")
    subprocess.run([sys.executable, "-m", "jld_explore", "report", str(folder), "--pdf"], check=True, cwd=ROOT)


def row_of(name: str) -> list[str]:
    """Return the row of the table of one finished run."""
    facts: dict[str, Any] = json.loads((RUNS / name / "summary.json").read_text(encoding="utf-8"))

    def span(bounds: list[float | None] | None) -> str:
        """Return bounds by fields as text."""
        low, high = bounds or [None, None]
        if low is None:
            return "–" if high is None else "does not stand" if high < 0.0 else f"at most {high:.4g}"
        return f"{low:.4g}" + ("" if high is None else f" to {high:.4g}")

    usual, gain = facts["usual"] or {}, facts["gain"]
    best = f"{facts['tessellation']}, {facts['kind']}"
    asked = shlex.split(COMMANDS[name])[-1]
    blocks = len((RUNS / name / "blocks.csv").read_text(encoding="utf-8").splitlines()) - 1
    factors = [f"{one:.4g}" if one is not None else "–" for one in (usual.get("load_factor"), facts["load_factor"])]
    numbers = [factors[0], span(usual.get("fields")), best, str(blocks), factors[1], span(facts["fields"])]
    return [name.replace("_", " "), *numbers, "–" if gain is None else f"{gain:.3g}", asked, f"{facts['seconds']:.0f}"]


def frame(figure: Figure) -> Image.Image:
    """Return a figure as a picture of the size of a frame, on white."""
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
    """Return a frame of the outline as it is read."""
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
    """Run the examples, and write their pictures, the recording and the table."""
    names = [name for name in sys.argv[1:] if not name.startswith("-")] or list(COMMANDS)
    for name in names:
        if "--draw" not in sys.argv:
            run(name)
        picture = Image.open(RUNS / name / "best.png").convert("RGB").quantize(64, dither=Image.Dither.NONE)
        picture.save(IMAGES / f"design_{name}.png", optimize=True)
    if "wall" in names:
        record("wall", IMAGES / "design.gif")
    done = [name for name in COMMANDS if (RUNS / name / "summary.json").exists()]
    head = ["outline", "usual bond by faces", "by fields", "best", "blocks", "by faces", "by fields", "proven gain"]
    words = f"Written by `python -m benchmarks.designs`, beside other work. {about(__doc__)}"
    rows = [row_of(name) for name in done]
    lines = "\n".join(f"jld design scenes/outlines/{COMMANDS[name]} -o out/{name}" for name in done)
    text = f"# Four designs by one command each\n\n{words}\n\n```sh\n{lines}\n```\n\n"
    write("design_examples", text + table(rows=rows, head=[*head, "time asked, s", "time, s"]))


if __name__ == "__main__":
    main()
