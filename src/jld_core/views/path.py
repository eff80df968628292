"""Plot of load factors along the paths of moving loads."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysisResult
from jld_core.views.look import FRONT, INK, PRESS, SOFT, TINTS

_HIGHEST: Final = 6.0  # largest λ that is drawn, over the least one


@dataclass(frozen=True)
class PathValue:
    """Load factor at one position of a moving load."""

    vehicle: str  # name of the moving load, with its direction
    distance: float  # distance of the first axle along the path, length
    # low, high: proven bounds on λ; NaN where one is missing
    low: float
    high: float
    required: float  # required factor

    @property
    def middle(self) -> float:
        """Return the middle of both bounds, NaN where one is missing."""
        return 0.5 * (self.low + self.high)


def path_values(result: LimitAnalysisResult) -> list[PathValue]:
    """Return λ at each position of the moving loads of a result; empty without any."""
    found = []
    for case in result.assembly.cases:
        if case.place is not None:
            low, high = result.cases[case.name].bracket
            found.append(PathValue(*case.place, low, high, case.required))
    return found


def draw_path(ax: Axes, values: list[PathValue], length: str, *, distance: str = "first axle along the path") -> None:
    """Draw λ against the place of the first axle, one line for each vehicle and direction."""
    # A position without a number has no mark; the least λ over required is marked.
    names = list(dict.fromkeys(one.vehicle for one in values))
    colours = (PRESS, FRONT, SOFT, *TINTS)
    for k, name in enumerate(names):
        own = [one for one in values if one.vehicle == name]
        x, y = [one.distance for one in own], [one.middle for one in own]
        colour = colours[k % len(colours)]
        ax.plot(
            x, y, color=colour, marker="o", markersize=2.5, linewidth=1.1, linestyle=("-", "--", ":")[k % 3], label=name
        )
    known = [one for one in values if math.isfinite(one.middle)]
    if known:
        least = min(known, key=lambda one: one.middle / one.required)
        ax.plot([least.distance], [least.middle], marker="o", markersize=7, markerfacecolor="none", color=INK)
        ax.annotate(
            f"{least.middle:.4g}", (least.distance, least.middle), xytext=(6, 6), textcoords="offset points", fontsize=7
        )
        ax.set_ylim(0.0, 1.1 * min(max(one.middle for one in known), _HIGHEST * least.middle))
    for one in sorted({one.required for one in values}):
        ax.axhline(one, color=SOFT, linewidth=0.7, linestyle=(0, (1, 2)))
    ax.set_xlabel(f"{distance} [{length}]", fontsize=7)
    ax.set_ylabel("λ", fontsize=7)
    ax.tick_params(labelsize=6.5)
    if len(names) > 1:
        ax.legend(fontsize=6.5, frameon=False)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def figure_of_path(assembly: Assembly, values: list[PathValue]) -> Figure:
    """Return a figure of λ along the paths of moving loads."""
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    ax = figure.add_subplot()
    draw_path(ax, values, assembly.units[0])
    ax.set_title(f"{textwrap.shorten(assembly.name, 50, placeholder=' …')}: λ along the path", fontsize=9)
    return figure
