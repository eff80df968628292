"""Lay out figures: sizes of axes, titles, and one scale for all axes."""

from __future__ import annotations

import math
import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.views import annotations as notes
from jld_core.views.structure import (
    extent,
    projection_of,
)


def figure_for(assembly: Assembly, count: int, columns: int | None = None) -> tuple[Figure, list[Axes]]:
    """Return a new figure with axes of about their final size, on which line widths depend."""
    lower, upper = extent(assembly, projection_of(assembly))
    figure = Figure(dpi=120)
    FigureCanvasAgg(figure)
    axes = [figure.add_axes((0.0, 0.0, 1.0, 1.0), label=str(k)) for k in range(count)]
    _place(figure, axes, upper - lower + 0.2 * float(np.max(upper - lower)), columns)
    return figure, axes


def finish(figure: Figure, axes: list[Axes], title: str, columns: int | None = None) -> None:
    """Give all axes of a figure one scale and their final sizes, and set the figure's title."""
    limits = np.array([[ax.get_xlim(), ax.get_ylim()] for ax in axes])
    low, high = limits[:, :, 0].min(axis=0), limits[:, :, 1].max(axis=0)
    for ax in axes:
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
    _place(figure, axes, high - low, columns)
    figure.suptitle(title, fontsize=11, y=1.0 - 0.1 / figure.get_figheight(), va="top")


def _place(figure: Figure, axes: list[Axes], span: Floats, columns: int | None = None) -> None:
    """Set sizes in inches from the space for data, ticks, titles and the longest legend.

    span: (2,) extent of the data.
    """
    stacked = columns is None and len(axes) > 1 and span[1] < 0.4 * span[0]
    width = 9.5 if stacked else 4.4 if len(axes) > 1 else 6.0
    height = width * float(span[1] / span[0])
    if height > 6.0:
        width, height = width * 6.0 / height, 6.0
    depth = max(notes.legend_inches(ax) for ax in axes)
    slot = max(width + 0.75, 3.7)
    row = 0.45 + height + depth
    columns = columns or (1 if stacked else len(axes))
    rows = math.ceil(len(axes) / columns)
    total = (columns * slot + 0.1, rows * row + 0.55)
    figure.set_size_inches(*total)
    for k, ax in enumerate(axes):
        line, column = divmod(k, columns)
        left = column * slot + 0.5 * (slot - width) + 0.25
        bottom = total[1] - 0.55 - line * row - 0.45 - height
        ax.set_position((left / total[0], bottom / total[1], width / total[0], height / total[1]))


def title_of(result: LimitAnalysisResult) -> str:
    """Return the title of a figure of a result: name, λ with its bracket, status, friction."""
    digits = 4
    if math.isfinite(result.gap) and result.gap > 0.0:
        digits = int(np.clip(math.ceil(-math.log10(result.gap)) + 2, 4, 14))
    low, high = (f"{end:.{digits}g}" if math.isfinite(end) else "unproven" for end in result.bracket)
    if result.status is Status.LOCKED:
        value = f"no finite collapse load (admissible from λ = {low} upwards)"
    elif result.status is Status.UNSTABLE:
        value = "no λ ≥ 0 is admissible"
    elif math.isfinite(result.load_factor):
        value = f"λ = {result.load_factor:.{max(digits - 2, 4)}g}  in  [{low}, {high}]"
    else:
        value = f"λ in [{low}, {high}]"
    name = textwrap.shorten(result.assembly.name, 90, placeholder=" …")
    return f"{name}\n{value}  ·  {result.status}  ·  {result.friction} friction"
