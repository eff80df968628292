"""One panel per scene: processor time against true relative error of λ, by route."""

from __future__ import annotations

import math
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from benchmarks.speed_error import LIMIT, Measured, Reference, certain_error
from benchmarks.speed_routes import BRACKETED

MARKS: Final = {
    "jld, default": ("*", "#b2182b", 190),
    "jld, Clarabel": ("o", "#d6604d", 55),
    "jld, other solver": ("D", "#e08214", 45),
    "jld, condensed": ("s", "#8c510a", 48),
    "Clarabel, bare": ("X", "#4d4d4d", 60),
    "CVXPY": ("P", "#2166ac", 60),
    "cones as polygons, inside": ("^", "#1b7837", 48),
    "cones as polygons, outside": ("v", "#762a83", 48),
}
"""Marker, colour and size by family; bracketed families are filled and warm."""
PLACES: Final = [(side, up) for up in (3.0, -8.0, 13.0, -18.0, 23.0, -28.0, 33.0) for side in (6.0, -6.0)]
"""Where a name may stand from its mark, points; left of it with a negative first number."""


def draw(results: dict[str, tuple[list[Measured], Reference]]) -> Figure:
    """The figure. results: by scene, the routes measured and the reference their errors are taken to."""
    columns = min(3, len(results))
    rows = -(-len(results) // columns)
    figure = Figure(figsize=(5.6 * columns, 4.3 * rows + 1.0), dpi=110, layout="constrained")
    panels: list[Axes] = []
    for place, (name, (found, reference)) in enumerate(results.items()):
        ax = figure.add_subplot(rows, columns, place + 1)
        _panel(ax, found, reference)
        ax.set_title(name, fontsize=11)
        if place % columns == 0:
            ax.set_ylabel("relative error of λ")
        if place >= len(results) - columns:
            ax.set_xlabel("processor time, s")
        panels.append(ax)
    present = {one.way.family for found, _ in results.values() for one in found}
    handles = [_handle(family) for family in MARKS if family in present]
    most = "error at most so much (dashed: half-width of the reference)"
    handles.append(Line2D([], [], marker="|", color="0.3", linestyle=":", label=most))
    handles.append(Line2D([], [], color="0.7", label="front of all routes"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=10)
    figure.draw_without_rendering()  # names are placed by what is near them on the finished page
    for ax, (found, reference) in zip(panels, results.values(), strict=True):
        _name(ax, found, reference)
    return figure


def _handle(family: str) -> Line2D:
    marker, colour, size = MARKS[family]
    proven = family in BRACKETED
    label = f"{family} ({'bracket proven' if proven else 'no bracket'})"
    face = colour if proven else "white"
    return Line2D([], [], ls="", marker=marker, color=colour, markerfacecolor=face, markersize=size**0.5, label=label)


def _shown(found: list[Measured]) -> list[Measured]:
    return [one for one in found if math.isfinite(one.seconds) and math.isfinite(one.found.load)]


def _panel(ax: Axes, found: list[Measured], reference: Reference) -> None:
    ax.set_xscale("log")
    ax.set_yscale("log")
    for one in _shown(found):
        marker, colour, size = MARKS[one.way.family]
        error, most = certain_error(one, reference)
        face = colour if one.way.family in BRACKETED else "white"
        ax.scatter(one.seconds, error, size, marker=marker, facecolor=face, edgecolor=colour, linewidth=1.3, zorder=3)
        if most:
            ax.plot([one.seconds] * 2, [error, error / 4.0], ":", color="0.3", lw=1.0, zorder=2)
            ax.plot(one.seconds, error / 4.0, "|", color="0.3", ms=4)
    best, steps = math.inf, []
    for seconds, error in sorted((one.seconds, certain_error(one, reference)[0]) for one in _shown(found)):
        if error < best:
            steps.append((seconds, error))
            best = error
    if steps:
        ax.step(*zip(*steps, strict=True), where="post", color="0.7", lw=1.0, zorder=1)
    ax.axhline(reference.half_width, color="0.6", lw=0.7, ls="--", zorder=1)
    ax.grid(True, which="major", color="0.92", lw=0.6)
    low, high = ax.get_xlim()
    ax.set_xlim(10.0 ** math.floor(math.log10(low)), high * 1.8)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    late = [one.way.name for one in found if one.failure.startswith("not in")]
    if late:
        text = f"not in {LIMIT} s:\n" + "\n".join(late)
        ax.text(0.98, 0.97, text, transform=ax.transAxes, ha="right", va="top", fontsize=7.0, color="0.35")


def _name(ax: Axes, found: list[Measured], reference: Reference) -> None:
    """Write each route's name beside its mark, at the first of several places that is still free."""
    dot = 110.0 / 72.0
    taken: list[tuple[float, float, float, float]] = []
    for one in _shown(found):
        error, _ = certain_error(one, reference)
        text = one.way.name
        for part in ("jld, ", "CVXPY, ", " inside", " outside"):
            text = text.replace(part, "")
        x, y = ax.transData.transform((one.seconds, error))
        wide = 3.9 * len(text)
        for right, up in PLACES:
            left = right if right > 0 else right - wide
            box = (x / dot + left, y / dot + up, x / dot + left + wide, y / dot + up + 7.5)
            if not any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
                break
        taken.append(box)
        line = {"arrowstyle": "-", "color": "0.7", "lw": 0.5} if abs(up) > 9.0 else None
        at, colour = (one.seconds, error), MARKS[one.way.family][1]
        ax.annotate(
            text, at, (left, up), textcoords="offset points", fontsize=6.5, color=colour, arrowprops=line, zorder=4
        )
