"""Figure of an assembly sequence as a strip of stages with arriving blocks and props."""

from __future__ import annotations

import math
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from jld_core import Bools, Floats, checkpoint, files
from jld_core.scene import units
from jld_practice.laying import Laying
from jld_practice.laying.order import Step
from jld_views import look, structure

# blocks laid before
LAID: Final = "#d9d4c7"

# arriving blocks
COMING: Final = "#d98c3f"

# props
PROP: Final = "#2c5f9e"
_ACROSS: Final = 5  # largest number of stages per row
_MOST: Final = 60  # largest number of stages drawn


def figure_of_laying(laying: Laying, title: str) -> Figure:
    # Blocks laid before are pale. Arriving blocks are orange and hatched, with an arrow of their direction. Props are
    # blue triangles below the blocks, or at their places along a line; the title of each stage has their total force.
    # Of more than 60 stages a regular selection is drawn.
    steps = list(laying.steps)
    drawn_steps = steps if len(steps) <= _MOST else [steps[round(k)] for k in np.linspace(0, len(steps) - 1, _MOST)]
    number = {id(step): k + 1 for k, step in enumerate(steps)}
    count = max(len(drawn_steps), 1)
    across = min(count, _ACROSS)
    down = math.ceil(count / across)
    low, high = _span(laying)
    ratio = (high[1] - low[1]) / max(high[0] - low[0], 1e-12)
    width = 2.6
    figure = Figure(
        figsize=(width * across, (width * min(max(ratio, 0.25), 2.5) + 0.45) * down + 0.5), layout="constrained"
    )
    axes = figure.subplots(down, across, squeeze=False).ravel()
    laid = laying.blocks.fixed.copy()
    position = 0
    for step in steps:
        before = laid.copy()
        laid[list(step.blocks)] = True
        if any(step is drawn_step for drawn_step in drawn_steps):
            checkpoint()
            _draw(axes[position], laying, step, before, number[id(step)], low, high)
            position += 1
    for ax in axes[position:]:
        ax.set_axis_off()
    if not steps:
        axes[0].text(
            0.5,
            0.5,
            "no order of laying was found",
            ha="center",
            va="center",
            color=look.INK,
            transform=axes[0].transAxes,
        )
    figure.suptitle(title, color=look.INK, fontsize=11, parse_math=False)
    return figure


def figure_of_stage(laying: Laying, number: int) -> Figure:
    low, high = _span(laying)
    ratio = (high[1] - low[1]) / max(high[0] - low[0], 1e-12)
    figure = Figure(figsize=(5.0, 5.0 * min(max(ratio, 0.25), 2.5) + 0.4), layout="constrained")
    laid = laying.blocks.fixed.copy()
    for step in laying.steps[: number - 1]:
        laid[list(step.blocks)] = True
    _draw(figure.subplots(), laying, laying.steps[number - 1], laid, number, low, high)
    return figure


def _span(laying: Laying) -> tuple[Floats, Floats]:
    """Return the lower and upper corner (2,) of a drawing of all elements, with margins."""
    assembly = laying.blocks.assembly
    points = structure.projection_of(assembly)(np.concatenate(assembly.elements.shape))
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.12 * float((high - low).max())
    return low - pad, high + 2.5 * pad


def _draw(ax: Axes, laying: Laying, step: Step, before: Bools, number: int, low: Floats, high: Floats) -> None:
    """Draw one stage of an assembly sequence on axes, with its arriving blocks and props.

    before: (k,) mask of the blocks laid before. low, high: (2,) corners of the drawing.
    """
    blocks = laying.blocks
    assembly = blocks.assembly
    elements, projection = assembly.elements, structure.projection_of(assembly)
    order = range(len(elements)) if assembly.dimension == 2 else structure.painter_order(assembly, projection.toward)
    for e in order:
        block = int(blocks.of[e])
        if not before[block] and block not in step.blocks:
            continue
        face = look.SUPPORT if elements.support[e] else COMING if block in step.blocks else LAID
        shapes = (
            [elements.shape[e]]
            if assembly.dimension == 2
            else [elements.shape[e][list(loop)] for loop in elements.faces[e]]
        )
        ax.add_collection(
            PolyCollection(
                [projection(shape) for shape in shapes],
                facecolors=face,
                edgecolors=look.INK,
                linewidths=0.6,
                hatch="///" if block in step.blocks else None,
            )
        )
    chosen = np.isin(blocks.of, step.blocks)
    middle = projection(np.average(elements.centroid[chosen], axis=0, weights=elements.volume[chosen])[None])[0]
    size = 0.22 * float((high - low).max())
    if assembly.dimension == 2 and len(step.direction) == 3:
        ax.plot(*middle, marker="o", markersize=7, markerfacecolor="none", markeredgecolor=look.INK)
        ax.plot(*middle, marker=".", markersize=3, color=look.INK)
    else:
        arrow = projection(step.direction[None])[0] * size
        ax.annotate(
            "",
            xy=tuple(middle),
            xytext=tuple(middle + arrow),
            arrowprops={"arrowstyle": "-|>", "color": look.INK, "lw": 1.2},
        )
    stage = step.stage
    # places along a line exist in the plane alone
    feet = list(projection(stage.places[stage.along > 0.0])) if stage.along.any() else []
    if not stage.along.size or stage.elsewhere > 1e-5 * stage.weight:
        # below the middle of a block that is propped elsewhere
        for block in np.flatnonzero(stage.props > 0.0).tolist():
            points = projection(np.concatenate([elements.shape[e] for e in blocks.elements(block)]))
            feet.append(np.array([points[:, 0].mean(), points[:, 1].min()]))
    for foot in feet:
        ax.plot(*foot, marker="^", markersize=6, color=PROP, zorder=5)
    props = f"props {units.force_in_words(float(stage.props.sum()), assembly.units[1])}"
    verdict = {True: "stands", False: props, None: "unsettled"}[stage.stands]
    ax.set_title(f"{number}: {verdict}", fontsize=8, color=look.INK)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_color(look.SOFT)


_STAGE, _END = 700, 2500  # time that a stage and the last stage are shown, ms
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
