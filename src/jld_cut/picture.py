"""Pictures of parts: pulled apart, and step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jld_core import Floats
from jld_cut.meshes import surface_of
from jld_cut.parts import Part
from jld_views import figures


def _draw(axes: Any, parts: list[Part], moves: Floats, numbers: bool) -> None:
    """Draw parts, each moved by a vector."""
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
        normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        seen = normal @ eye > 0.0
        faces, normal = faces[seen], normal[seen]
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
    axes.set_box_aspect(np.maximum(high - low, 1e-9), zoom=0.9)
    axes.view_init(22, -62)
    axes.set_axis_off()


def figure_of_parts(parts: list[Part], title: str, path: Path) -> None:
    """Write a picture of parts pulled apart."""
    middles = np.array([np.array(part.exact.bounding_box()).reshape(2, 3).mean(axis=0) for part in parts])
    moves = 0.45 * (middles - middles.mean(axis=0))
    moves[:, 2] -= moves[:, 2].min()
    figure = Figure(figsize=(9, 6.5))
    # wider than the figure: axes in space clip to their own box
    _draw(figure.add_axes((-0.25, -0.2, 1.5, 1.4), projection="3d"), parts, moves, numbers=True)
    figure.suptitle(title, fontsize=10, y=0.97)
    figures.save_figure(figure, path)


def figure_of_order(parts: list[Part], path: Path) -> None:
    """Write a picture for each step of the order in which parts are laid, the new one drawn back."""
    steps = sorted({part.step for part in parts if part.step})
    columns = min(4, max(1, len(steps)))
    rows = -(-len(steps) // columns)
    figure = Figure(figsize=(3.2 * columns, 3.0 * rows))
    size = max(float(np.ptp(surface_of(part.exact)[0], axis=0).max()) for part in parts)
    for k, step in enumerate(steps):
        laid = [part for part in parts if 0 < part.step <= step]
        moves = np.array([-0.5 * size * part.direction if part.step == step else np.zeros(3) for part in laid])
        axes = figure.add_subplot(rows, columns, k + 1, projection="3d")
        _draw(axes, laid, moves, numbers=True)
        named = ", ".join(str(part.number) for part in laid if part.step == step)
        axes.set_title(f"{k + 1}. lay part {named}", fontsize=9)
    figures.save_figure(figure, path)
