"""Draw the front of λ and two counts: the best λ for every pair of counts, and layouts."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from jld_core.arrays import Bools, Floats
from jld_core.assembly import Assembly
from jld_core.views.look import DOTS, FRONT, INK, SOFT
from jld_explore.report.columns import ranked_by, value_in_words
from jld_explore.report.evidence import known_front
from jld_explore.report.exploration import Exploration
from jld_explore.report.pictures import (
    Gallery,
    axes_of,
    caption,
    circle,
    collapsed,
    figure_of,
    plot_pareto,
    say_nothing,
    spread,
)
from jld_explore.space import count_named

STRENGTH: Final = LinearSegmentedColormap.from_list("strength", ["#FFFFFF", "#F3D9A4", "#D89A2B"])
"""Colours of λ from the weakest to the strongest of the front; text is legible on all of them."""

_CELLS: Final = 22  # number of values of a count up to which pairs are drawn as squares with λ written inside


def front_picture(done: Exploration) -> Figure:
    """Return a figure of the front of a study with its layouts, for one count or two."""
    axes = done.scene.search.front.axes
    if len(axes) > 1:
        return plot_three(done.results, done.front, done.assembly, axes=axes)
    ((count, sense),) = axes
    return plot_pareto(done.results, done.front, done.assembly, count=count, sense=sense)


def plot_three(
    results: pd.DataFrame,
    front: pd.DataFrame,
    assembly: Assembly,
    *,
    axes: Sequence[tuple[str, str]],
    layouts: int = 8,
) -> Figure:
    """Plot the best λ for every pair of two counts, and layouts along the front.

    The front is emphasised. Numbers in circles link layouts and points.

    results, front: tables with the columns of results.csv; `front` is a part of `results`. axes: the two counts with
    their better directions, "max" or "min". layouts: largest number of layouts drawn. Result: figure.
    """
    (first, _), (second, _) = axes
    counted = [count_named(name) for name, _ in axes]
    shown = collapsed(results)
    best = known_front(collapsed(front))[0].sort_values([first, second, "load_factor"], kind="stable")
    best, sure = known_front(best.drop_duplicates([first, second], keep="last"))
    points = best[[first, second, "load_factor"]].to_numpy(dtype=float)
    width, height = 9.6, 4.6
    places = shown[[first, second]].to_numpy(dtype=float)
    chosen = spread(points[:, :2], places, (7.6, height), layouts)
    gallery = Gallery.of(len(chosen), assembly, width)
    total = 0.25 + height + 0.85 + gallery.height + 0.35
    figure = figure_of(width, total)
    ax = axes_of(figure, (0.75, total - 0.4 - height, width - 2.1, height))
    for name, count, (_, sense) in zip("xy", counted, axes, strict=True):
        more = "more" if sense == "max" else "fewer" if count.integer else "less"
        getattr(ax, f"set_{name}label")(f"{count.label(assembly)}  ({more} is better)", fontsize=9)
    ax.set_title(textwrap.shorten(assembly.name, 60, placeholder=" …"), fontsize=10, loc="left")
    figure.text(0.5, 0.1 / total, caption(results), fontsize=8, ha="center", va="bottom", color=SOFT)
    if not len(shown):
        say_nothing(ax, "no labelling collapses at a finite load factor")
        return figure
    scale = Normalize(min(points[:, 2].min(), 0.999 * points[:, 2].max()), points[:, 2].max())
    squares = all(c.integer for c in counted) and bool(np.all(np.ptp(places, axis=0) < _CELLS))
    for axis, count in zip((ax.xaxis, ax.yaxis), counted, strict=True):
        if count.integer:
            axis.set_major_locator(MaxNLocator(nbins=12, integer=True, min_n_ticks=1))
    (_squares if squares else _dots)(ax, shown[[first, second, "load_factor"]], points, sure, scale)
    beside = axes_of(figure, (width - 1.0, total - 0.4 - height, 0.16, height))
    bar = figure.colorbar(ScalarMappable(scale, STRENGTH), cax=beside)
    bar.set_label(f"load factor {ranked_by(results)} of the front [–]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    for number, k in enumerate(chosen):
        # Place the circle beside the number or dot.
        shift = (0.33, 0.3) if squares else (0.0, 0.0)
        at = float(points[k, 0]) + shift[0], float(points[k, 1]) + shift[1]
        away = (0.0, 0.0) if squares else (11.0, 11.0)
        ax.annotate(str(number + 1), at, away, textcoords="offset points", **circle(), zorder=4.0)
        words = "  ".join(c.words(v, assembly) for c, v in zip(counted, points[k, :2], strict=True))
        gallery.draw(
            figure, number, assembly, best["labelling"].iloc[k], f"{value_in_words(results, points[k, 2])}  {words}"
        )
    return figure


def _squares(ax: Axes, shown: pd.DataFrame, points: Floats, sure: Bools, scale: Normalize) -> None:
    """Draw each pair of integer counts as a square with its best λ; fill and frame the front.

    shown: columns of both counts and λ. points: (k, 3) counts and λ on the front. sure: (k,) True if proven. scale:
    colours of λ.
    """
    first, second, value = shown.columns
    on_front = {(x, y): (v, known) for (x, y, v), known in zip(points, sure, strict=True)}
    most = shown.groupby([first, second], as_index=False)[value].max().to_numpy(dtype=float)
    for x, y, found in most.tolist():
        at = x, y
        v, known = on_front.get(at, (found, False))
        inside = at in on_front
        style: dict[str, Any] = {
            "facecolor": STRENGTH(scale(v)),
            "edgecolor": FRONT,
            "linewidth": 2.0 if known else 1.2,
            "zorder": 2.0,
        }
        style |= {"linestyle": "-" if known else (0, (3.0, 1.6))}
        plain: dict[str, Any] = {"facecolor": "none", "edgecolor": "#D5D5D5", "linewidth": 0.6, "zorder": 1.0}
        ax.add_patch(Rectangle((at[0] - 0.44, at[1] - 0.44), 0.88, 0.88, **(style if inside else plain)))
        ax.text(
            *at, f"{v:.3g}", ha="center", va="center", fontsize=7, color=INK if inside else SOFT,
            fontweight="bold" if inside else "normal", zorder=3.0,
        )  # fmt: skip
    ax.set_xlim(most[:, 0].min() - 0.6, most[:, 0].max() + 0.6)
    ax.set_ylim(most[:, 1].min() - 0.6, most[:, 1].max() + 0.6)
    keys: list[tuple[str, dict[str, Any], bool]] = [
        ("on the front, proven", {"edgecolor": FRONT, "linewidth": 2.0}, bool(sure.any()))
    ]
    keys += [
        ("on the front, best found", {"edgecolor": FRONT, "linewidth": 1.2, "linestyle": "--"}, bool((~sure).any()))
    ]
    keys += [("beaten: best seen there", {"edgecolor": "#B5B5B5", "linewidth": 0.8}, len(most) > len(points))]
    handles = [Patch(facecolor="white", label=words, **style) for words, style, there in keys if there]
    ax.legend(
        handles=handles, ncols=3, frameon=False, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
    )  # fmt: skip


def _dots(ax: Axes, shown: pd.DataFrame, points: Floats, sure: Bools, scale: Normalize) -> None:
    """Draw every layout as a dot and the front coloured by λ, for counts with many values.

    Arguments as in `_squares`.
    """
    first, second, _ = shown.columns
    ax.plot(shown[first], shown[second], "o", color=DOTS, alpha=0.4, markersize=3.0, markeredgewidth=0.0, zorder=1.0)
    for part, width, words in ((sure, 1.8, "proven"), (~sure, 0.9, "best found")):
        if part.any():
            ax.scatter(
                points[part, 0], points[part, 1], c=points[part, 2], cmap=STRENGTH, norm=scale, s=60.0,
                edgecolors=FRONT, linewidths=width, label=f"on the front, {words}", zorder=2.0,
            )  # fmt: skip
    ax.margins(0.08, 0.12)
    ax.legend(ncols=2, frameon=False, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
