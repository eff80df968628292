"""Pictures and pages of parts: pulled apart, and step by step."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from textwrap import wrap
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jld_core import Floats, files
from jld_cut.meshes import normals_of, surface_of
from jld_cut.parts import Part


def _draw(axes: Any, parts: list[Part], moves: Floats, numbers: bool) -> None:
    light = np.array([0.35, -0.5, 0.8])
    light /= np.linalg.norm(light)
    colours = colormaps["tab20"](np.array([part.number - 1 for part in parts]) % 20)
    # seen from there; faces that look away are hidden by those of the same part
    eye = np.array([np.cos(np.radians(-62)), np.sin(np.radians(-62)), np.tan(np.radians(22))])
    corners, paints, all_points = [], [], []
    for part, move, colour in zip(parts, moves, colours, strict=True):
        points, triangles = surface_of(part.exact)
        points = points + move
        faces = points[triangles]
        normal, length = normals_of(faces)
        normal = normal / np.maximum(length, 1e-300)[:, None]
        visible = normal @ eye > 0.0
        faces, normal = faces[visible], normal[visible]
        shade = 0.55 + 0.45 * np.clip(normal @ light, 0.0, 1.0)
        corners.append(faces)
        paints.append(np.column_stack([colour[:3] * shade[:, None], np.ones(len(faces))]))
        all_points.append(points)
        if numbers:
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            axes.text(*middle, str(part.number), fontsize=9, fontweight="bold", ha="center", zorder=1000)
    axes.add_collection3d(
        Poly3DCollection(
            np.concatenate(corners),
            facecolors=np.concatenate(paints),
            edgecolors=np.concatenate(paints),
            linewidths=0.4,
        )
    )
    points = np.concatenate(all_points)
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    sides = np.maximum(high - low, 1e-9)
    # the longest diagonal has one length in any picture: what stands upright is drawn smaller
    drawn_height = sides[2] * np.cos(np.radians(22)) + np.linalg.norm(sides[:2]) * np.sin(np.radians(22))
    axes.set_box_aspect(sides, zoom=0.9 * min(1.0, 0.66 * np.linalg.norm(sides) / drawn_height))
    axes.view_init(22, -62)
    axes.set_axis_off()


def figure_of_parts(parts: list[Part], title: str) -> Figure:
    middles = np.array([np.array(part.exact.bounding_box()).reshape(2, 3).mean(axis=0) for part in parts])
    moves = 0.45 * (middles - middles.mean(axis=0))
    moves[:, 2] -= moves[:, 2].min()
    figure = Figure(figsize=(9, 6.5))
    # wider than the figure: axes in space clip to their own box
    _draw(figure.add_axes((-0.25, -0.26, 1.5, 1.4), projection="3d"), parts, moves, numbers=True)
    figure.suptitle("\n".join(wrap(title, 100)), fontsize=10, y=0.97)
    return figure


def figure_of_order(parts: list[Part], steps: list[int]) -> Figure:
    """Return a picture of each of some steps of the order in which parts are laid, the new one drawn back."""
    columns = min(4, max(1, len(steps)))
    rows = -(-len(steps) // columns)
    figure = Figure(figsize=(3.2 * columns, 3.0 * rows))
    size = max(float(np.ptp(surface_of(part.exact)[0], axis=0).max()) for part in parts)
    for k, step in enumerate(steps):
        laid = [part for part in parts if 0 < part.step <= step]
        moves = np.array([-0.5 * size * part.direction if part.step == step else np.zeros(3) for part in laid])
        axes = figure.add_subplot(rows, columns, k + 1, projection="3d")
        _draw(axes, laid, moves, numbers=True)
        numbers = ", ".join(str(part.number) for part in laid if part.step == step)
        axes.set_title(f"{step}. lay part {numbers}", fontsize=9)
    return figure


def steps_of(parts: list[Part]) -> list[int]:
    return sorted({part.step for part in parts if part.step})


Table = tuple[list[str], list[list[str]]]  # heads and rows


def write_page(parts: list[Part], verdict: str, front: Table, cutting: Table, path: Path) -> None:
    """Write a page with the parts as they stand: a slider that pulls them apart, the order of assembly, and tables."""
    colours = (255 * colormaps["tab20"](np.array([part.number - 1 for part in parts]) % 20)[:, :3]).astype(int)
    boxes = np.array([np.array(part.exact.bounding_box()).reshape(2, 3) for part in parts])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    size = float((high - low).max())
    entries = []
    for part, box, colour in zip(parts, boxes, colours, strict=True):
        points, triangles = surface_of(part.solid)
        entry = {
            "number": part.number,
            "step": part.step,
            "direction": part.direction.tolist(),
            "colour": colour.tolist(),
        }
        entry |= {"middle": box.mean(axis=0).tolist(), "faces": triangles.tolist()}
        entries.append(entry | {"points": [[float(f"{v:.6g}") for v in point] for point in points.tolist()]})
    data = {"verdict": verdict, "size": size, "middle": ((low + high) / 2).tolist(), "parts": entries}
    text = json.dumps(data | {"front": front, "list": cutting}).replace("</", "<\\/")
    page = resources.files("jld_cut").joinpath("assets", "parts.html").read_text(encoding="utf-8")
    files.write_text(path, page.replace("/*DATA*/", text, 1))


_ROWS: Final = 28  # of a table on a printed page
_STEPS: Final = 8  # on a printed page


def write_pages(parts: list[Part], verdict: str, front: Table, cutting: Table, path: Path) -> None:
    """Write pages to print: the parts, λ against their number, the cutting list and the steps of assembly."""
    with PdfPages(path, metadata={"CreationDate": None}) as pdf:
        pdf.savefig(figure_of_parts(parts, verdict))
        for title, (head, rows) in (("λ against the number of parts", front), ("Cutting list", cutting)):
            for start in range(0, max(1, len(rows)), _ROWS):
                figure = Figure(figsize=(11.7, 8.3))
                axes = figure.add_axes((0.04, 0.04, 0.92, 0.86))
                axes.set_axis_off()
                axes.set_title(title, loc="left")
                table = axes.table(cellText=rows[start : start + _ROWS], colLabels=head, loc="upper center")
                table.auto_set_font_size(False)
                table.set_fontsize(8)
                pdf.savefig(figure)
        steps = steps_of(parts)
        for start in range(0, len(steps), _STEPS):
            pdf.savefig(figure_of_order(parts, steps[start : start + _STEPS]))
