"""What each reduction leaves of size and time, as bars."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from benchmarks.reductions import Reduction


def draw(found: list[Reduction]) -> Figure:
    """Bars: what is left of size and time."""
    figure = Figure(figsize=(9.0, 0.62 * len(found) + 1.4), dpi=110, layout="constrained")
    ax = figure.add_subplot()
    place = np.arange(len(found))
    parts = (
        ("size left (unknowns, or solves)", "#92c5de", [one.sizes[1] / one.sizes[0] for one in found], -0.19),
        ("time left", "#2166ac", [one.seconds[1] / one.seconds[0] for one in found], 0.19),
    )
    for name, colour, values, up in parts:
        bars = ax.barh(place + up, values, 0.36, color=colour, label=name)
        ax.bar_label(bars, [f"{value:.2f}" for value in values], padding=3, fontsize=8)
    names = [f"{one.name}\n{one.scene}" for one in found]
    ax.set_yticks(place, names, fontsize=7.5)
    ax.invert_yaxis()
    ax.axvline(1.0, color="0.4", lw=0.8)
    ax.set_xlabel("share of what it is without the reduction")
    ax.margins(x=0.12)
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure
