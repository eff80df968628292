"""Draw pictures of a study from its tables alone: front with layouts, distributions, convergence."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from jld_core import Assembly, Bits, Bools, Floats, LimitAnalysisResult, Status
from jld_core import assembly as core_assembly
from jld_core.scene import Search
from jld_explore import Exploration
from jld_explore.report import columns as explore_columns
from jld_explore.space import Count, count_named, cut, registered
from jld_explore.space import labelling as explore_labelling
from jld_views import figures as core
from jld_views.annotations import frame
from jld_views.look import DOTS, FRONT, INK, PLAIN, SOFT
from jld_views.structure import LineStyle, element_points, extent, paint, projection_of

FIRST: Final[str] = Search().front.count  # default count of the front in pictures

# colours of the share of layouts in which a face is dry
SHARE: Final = LinearSegmentedColormap.from_list("share", ["#C9C9C9", "#D89A2B", "#8C2300"])
MANY: Final = 5000  # dots from which a scatter plot is stored as an image, so that vector files stay small

# colours and dash patterns of convergence curves
LINES: Final = (
    ("#0072B2", "solid"),
    ("#D55E00", "dashed"),
    ("#009E73", "dashdot"),
    ("#CC79A7", "dotted"),
    ("#1B1B1B", (0, (6.0, 1.0, 1.0, 1.0, 1.0, 1.0))),
    ("#E69F00", (0, (1.0, 1.0))),
    ("#56B4E9", (0, (9.0, 2.0))),
)


def plot_pareto(
    results: pd.DataFrame,
    front: pd.DataFrame,
    assembly: Assembly,
    *,
    count: str = FIRST,
    sense: str = "max",
    layouts: int = 8,
) -> Figure:
    """Plot λ against a count: all layouts that collapse, the front, and layouts along it."""
    # Numbers in circles link layouts and points.
    if count not in [evidence.name for evidence in registered()] or sense not in ("max", "min"):
        raise ValueError(f"count {count!r} and sense {sense!r}: no such front")
    counted = count_named(count)
    rows = collapsed(results)
    best, sure = explore_columns.known_front(collapsed(front).sort_values(count, kind="stable"))
    points = best[[count, "load_factor"]].to_numpy(dtype=float)
    width, height = 9.6, 4.3
    chosen = spread(points, rows[[count, "load_factor"]].to_numpy(dtype=float), (8.6, height - 0.3), layouts)
    gallery = Gallery.of(len(chosen), assembly, width)
    total = 0.25 + height + 0.75 + gallery.height + 0.35
    figure = figure_of(width, total)
    ax = axes_of(figure, (0.75, total - 0.35 - height, width - 1.0, height))
    ax.set_xlabel(counted.label(assembly), fontsize=9)
    ax.set_ylabel(f"load factor {explore_columns.ranked_by(results)} [–]", fontsize=9)
    if len(rows):
        is_large = len(rows) > MANY
        ax.plot(
            rows[count], rows["load_factor"], "o", color=DOTS, alpha=0.25 if is_large else 0.65, markersize=3.6,
            markeredgewidth=0.0, rasterized=is_large, label="labellings that collapse", zorder=1.0,
        )  # fmt: skip
        steps = "steps-pre" if sense == "max" else "steps-post"
        evidence = "proven" if sure.all() else "partly proven" if sure.any() else "best found"
        ax.plot(*points.T, color=FRONT, linewidth=1.3, drawstyle=steps, label=f"front, {evidence}", zorder=2.0)
        for chosen_points, face, words in ((sure, FRONT, "proven"), (~sure, "white", "best found")):
            if chosen_points.any():
                ax.plot(
                    *points[chosen_points].T, "o", color=FRONT, markerfacecolor=face, markersize=5.0,
                    label=f"on the front, {words}", zorder=2.1,
                )  # fmt: skip
        _whole_numbers(ax, counted)
        ax.margins(x=0.04, y=0.07)
    else:
        say_nothing(ax, "no labelling collapses at a finite load factor")
    for number, k in enumerate(chosen):
        ax.text(points[k, 0], points[k, 1], str(number + 1), **circle(), zorder=3.0)
        value = f"{explore_columns.value_in_words(results, points[k, 1])}   {counted.words(points[k, 0], assembly)}"
        gallery.draw(figure, number, assembly, best["labelling"].iloc[k], value)
    figure.text(0.5, 0.1 / total, caption(results), fontsize=8, ha="center", va="bottom", color=SOFT)
    ax.set_title(textwrap.shorten(assembly.name, 60, placeholder=" …"), fontsize=10, loc="left")
    if len(rows):
        position: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
        ax.legend(handles=ax.lines[:2], ncols=2, frameon=False, fontsize=8, markerscale=1.6, **position)
    return figure


def plot_best(result: LimitAnalysisResult) -> Figure:
    return core.figure_of_result(result)


def plot_distribution(results: pd.DataFrame, count: str = FIRST) -> Figure:
    """Return a figure of λ by an integer count: box plots, with all layouts as dots."""
    rows = collapsed(results)
    figure = figure_of(8.0, 4.6)
    ax = axes_of(figure, (0.75, 0.85, 7.0, 3.25))
    counted = count_named(count)
    ax.set_xlabel(counted.axis if isinstance(counted.axis, str) else f"{counted.noun}s", fontsize=9)
    ax.set_ylabel(f"load factor {explore_columns.ranked_by(results)} [–]", fontsize=9)
    if rows.empty:
        say_nothing(ax, "no labelling collapses at a finite load factor")
    else:
        dry, value = rows[count].to_numpy(dtype=int), rows["load_factor"].to_numpy(dtype=float)
        groups = {int(k): value[dry == k] for k in np.unique(dry)}
        is_large = len(rows) > MANY
        ax.plot(
            dry, value, "o", color=DOTS, alpha=0.2 if is_large else 0.65, markersize=3.6,
            markeredgewidth=0.0, rasterized=is_large, zorder=1.0, label="labellings",
        )  # fmt: skip
        line = {"color": INK, "linewidth": 0.9}
        ax.boxplot(
            list(groups.values()), positions=list(groups), widths=0.55, manage_ticks=False, showfliers=False,
            boxprops=line, whiskerprops=line, capprops=line, medianprops={"color": FRONT, "linewidth": 1.8},
        )  # fmt: skip
        ax.set_xlim(min(groups) - 0.8, max(groups) + 0.8)
        _whole_numbers(ax, counted)
        ax.set_title(f"λ by {counted.noun}s; above each box how many classes it holds", fontsize=9, pad=18.0)
        note: dict[str, Any] = {"fontsize": 7, "ha": "center", "va": "bottom", "color": SOFT}
        for group, part in groups.items() if len(groups) <= 40 else ():
            turned = 90 if len(groups) > 24 else 0
            ax.text(group, 1.015, str(len(part)), transform=ax.get_xaxis_transform(), rotation=turned, **note)
    figure.text(0.5, 0.1 / 4.6, caption(results), fontsize=8, ha="center", va="bottom", color=SOFT)
    return figure


def plot_dry_frequency(results: pd.DataFrame, assembly: Assembly, top: int = 50) -> Figure:
    """Return a figure of how often each face is dry in the `top` best layouts."""
    # Width and colour of a face show the share; faces to supports stay thin.
    best = collapsed(results).nlargest(top, "load_factor")  # ties keep their order
    lower, upper = extent(assembly, projection_of(assembly))
    span = upper - lower
    width = float(np.clip(4.6 * span[0] / span[1], 3.2, 7.6))
    height = float(np.clip(width * span[1] / span[0], 0.8, 6.5))
    total = (width + 1.0, height + 1.5)
    figure = figure_of(*total)
    ax = axes_of(figure, (0.65, 1.15, width, height))
    if best.empty:
        say_nothing(ax, "no labelling collapses at a finite load factor")
        return figure
    share = np.mean([labels_of(text, assembly) for text in best["labelling"]], axis=0)
    between = assembly.free_faces
    thick = float(np.clip(0.11 * element_points(ax, assembly), 0.8, 5.0))
    ink = LineStyle(
        [tuple(SHARE(float(s))) if free else INK for s, free in zip(share, between, strict=True)],
        np.where(between, thick * (0.15 + 0.85 * share), 0.6),
    )
    paint(ax, assembly, share > 0.0, [PLAIN] * len(assembly.elements), ink)
    frame(ax, assembly, [lower, upper])
    bar = axes_of(figure, (0.65 + 0.1 * width, 0.5, 0.8 * width, 0.11))
    figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), SHARE), cax=bar, orientation="horizontal")
    bar.set_xlabel("share in which the face is dry; dotted: in none", fontsize=8)
    bar.tick_params(labelsize=8)
    subject = "the labelling" if len(best) == 1 else f"the {len(best)} best labellings"
    figure.text(0.5, 1.0 - 0.1 / total[1], f"Dry faces in {subject}", fontsize=10, ha="center", va="top")
    return figure


def plot_convergence(histories: dict[str, pd.DataFrame]) -> Figure:
    """Return a figure of the best λ so far against solves and against time, a line per search."""
    figure = figure_of(9.6, 4.2)
    names = {"solves": "programs solved", "seconds": "time [s]"}
    axes = [axes_of(figure, (0.75 + 4.45 * k, 0.95, 4.1, 2.95)) for k in range(2)]
    count = 0
    for number, (name, history) in enumerate(histories.items()):
        colour, dash = LINES[number % len(LINES)]
        finite = history.assign(best=history["best"].cummax()).dropna(subset=["best"])
        if finite.empty:
            continue
        count += 1
        for ax, column in zip(axes, names, strict=True):
            ax.plot(
                finite[column], finite["best"], color=colour, linestyle=dash, linewidth=1.5, label=name,
                drawstyle="steps-post", marker="o", markersize=4.5, markevery=[len(finite) - 1],
            )  # fmt: skip
    for ax, label in zip(axes, names.values(), strict=True):
        ax.set_xlabel(label, fontsize=9)
        if not count:
            say_nothing(ax, "no finite load factor yet")
    axes[0].set_ylabel("best load factor λ so far [–]", fontsize=9)
    if count:
        low = min(ax.get_ylim()[0] for ax in axes)
        high = max(ax.get_ylim()[1] for ax in axes)
        for ax in axes:
            ax.set_ylim(low, high)
        axes[1].tick_params(labelleft=False)
        figure.legend(
            handles=axes[0].lines, loc="lower center", ncols=min(count, 5), frameon=False, fontsize=8,
            bbox_to_anchor=(0.5, 0.02), handlelength=3.5,
        )  # fmt: skip
    return figure


def labels_of(text: object, assembly: Assembly) -> Bits:
    """Convert letters d, i and v to labels (m,), v not dry; ValueError if they do not fit."""
    count = assembly.faces
    if not isinstance(text, str) or len(text) != count:
        raise ValueError(f"labelling {text!r}: expected {count} letters d, i or v")
    return core_assembly.with_members(assembly, explore_labelling.dry_of(text))


def collapsed(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table whose layouts have a finite load factor."""
    ranked = (table["status"] == str(Status.COLLAPSE)) & np.isfinite(table["load_factor"].astype(float))
    return table if ranked.all() else table[ranked]  # a selection copies: a million rows take 0.3 GB


def spread(points: Floats, every: Floats, inches: tuple[float, float], most: int) -> list[int]:
    """Select points (k, 2) that lie well apart on paper, and return their indices, ascending."""
    # The ends come first, then always the point farthest from those selected, until circles would touch.
    if not len(points):
        return []
    scale = np.array(inches) / np.maximum(np.ptp(every, axis=0), 1e-300)
    paper = np.where(np.ptp(every, axis=0) > 0.0, points * scale, 0.0)
    chosen = [0]
    while len(chosen) < min(most, len(points)):
        distance = np.min([np.hypot(*(paper - paper[k]).T) for k in chosen], axis=0)
        farthest = int(np.argmax(distance)) if len(chosen) > 1 else len(points) - 1
        if distance[farthest] < 0.28:
            break
        chosen.append(farthest)
    return sorted(chosen)


@dataclass(frozen=True)
class Gallery:
    """Layouts in one or two rows along the bottom of a figure."""

    count: int  # number of layouts
    columns: int  # number of layouts per row
    cell: tuple[float, float]  # width and height of each layout, inches
    width: float  # width of the figure, inches

    @classmethod
    def of(cls, count: int, assembly: Assembly, width: float) -> Gallery:
        """Return a gallery of `count` layouts for a figure of given width, inches."""
        columns = count if count <= 5 else math.ceil(count / 2)
        wide = width / max(columns, 4)
        lower, upper = extent(assembly, projection_of(assembly))
        span = upper - lower
        height = float(np.clip((wide - 0.16) * span[1] / span[0], 0.3, 2.2))
        return cls(count, columns, (wide, height + 0.42), width)

    @property
    def rows(self) -> int:
        return -(-self.count // self.columns) if self.count else 0

    @property
    def height(self) -> float:
        return self.rows * self.cell[1]

    def draw(self, figure: Figure, number: int, assembly: Assembly, labelling: object, words: str) -> None:
        """Draw one layout, given by its letters, with `number` + 1 in a circle and `words` above."""
        width, total = figure.get_size_inches()
        row, column = divmod(number, self.columns)
        left = (width - min(self.columns, self.count) * self.cell[0]) / 2.0 + column * self.cell[0]
        bottom = 0.35 + (self.rows - 1 - row) * self.cell[1]
        thumb = axes_of(figure, (left + 0.08, bottom + 0.06, self.cell[0] - 0.16, self.cell[1] - 0.42))
        labels_of(labelling, assembly)
        structure, labels = cut(assembly, str(labelling))
        core.draw_assembly(thumb, structure, labels, plain=True)
        if structure is not assembly:
            # Use the scale of the whole structure.
            frame(thumb, assembly, list(extent(assembly, projection_of(assembly))), bare=True)
        y = (bottom + self.cell[1] - 0.2) / total
        figure.text((left + 0.2) / width, y, str(number + 1), **circle())
        text = figure.text((left + 0.36) / width, y, words, fontsize=8, va="center", color=INK)
        room = (self.cell[0] - 0.42) * figure.dpi
        # Try sizes in steps: hinting rounds widths, so that a smaller size need not be narrower.
        for size in (7.5, 7.0, 6.5, 6.0):
            if text.get_window_extent().width <= room:
                break
            text.set_fontsize(size)


def caption(results: pd.DataFrame) -> str:
    """Return a sentence with the number of classes of the table, in total and by status."""
    tally = results["status"].value_counts()
    parts = [f"{int(tally.get(str(s), 0))} {s}" for s in Status if s is not Status.FAILED or str(s) in tally]
    total = int(results["multiplicity"].sum()) if "multiplicity" in results else len(results)
    return f"{len(results)} classes ({total} labellings): " + ", ".join(parts) + "; only collapse has a point"


def _whole_numbers(ax: Axes, count: Count) -> None:
    if count.integer:
        ax.xaxis.set_major_locator(MaxNLocator(nbins=12, integer=True, min_n_ticks=1))


def say_nothing(ax: Axes, text: str) -> None:
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", fontsize=10, color=SOFT)
    ax.set_xticks([])
    ax.set_yticks([])


def circle() -> dict[str, Any]:
    """Return the matplotlib style of a text that stands in a circle."""
    box = {"boxstyle": "circle,pad=0.22", "facecolor": "white", "edgecolor": FRONT, "linewidth": 1.1}
    return {"ha": "center", "va": "center", "fontsize": 8, "fontweight": "bold", "color": INK, "bbox": box}


def figure_of(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=120)
    FigureCanvasAgg(figure)
    return figure


def axes_of(figure: Figure, inches: tuple[float, float, float, float]) -> Axes:
    """Add axes at left, bottom, width, height in inches, with small ticks and without a box."""
    width, height = figure.get_size_inches()
    left, bottom, wide, high = inches
    ax = figure.add_axes((left / width, bottom / height, wide / width, high / height))
    ax.tick_params(labelsize=8)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return ax


# colours of λ from the weakest to the strongest of the front, on which text is legible
STRENGTH: Final = LinearSegmentedColormap.from_list("strength", ["#FFFFFF", "#F3D9A4", "#D89A2B"])

_CELLS: Final = 22  # number of values of a count up to which pairs are drawn as squares with λ written inside


def front_picture(done: Exploration) -> Figure:
    """Return a figure of the front of a study with its layouts, for one count or two."""
    axes = done.scene.search.front.axes
    if len(axes) > 1:
        return plot_three(done.results, done.front, done.assembly, axes=axes)
    ((count, sense),) = axes
    return plot_pareto(done.results, done.front, done.assembly, count=count, sense=sense)


def plot_three(
    results: pd.DataFrame, front: pd.DataFrame, assembly: Assembly, *, axes: Sequence[tuple[str, str]], layouts: int = 8
) -> Figure:
    """Plot the best λ for every pair of two counts, and layouts along the front."""
    # The front is emphasised. Numbers in circles link layouts and points.
    (first, _), (second, _) = axes
    counted = [count_named(name) for name, _ in axes]
    rows = collapsed(results)
    best = explore_columns.known_front(collapsed(front))[0].sort_values([first, second, "load_factor"], kind="stable")
    best, sure = explore_columns.known_front(best.drop_duplicates([first, second], keep="last"))
    points = best[[first, second, "load_factor"]].to_numpy(dtype=float)
    width, height = 9.6, 4.6
    counts_of_rows = rows[[first, second]].to_numpy(dtype=float)
    chosen = spread(points[:, :2], counts_of_rows, (7.6, height), layouts)
    gallery = Gallery.of(len(chosen), assembly, width)
    total = 0.25 + height + 0.85 + gallery.height + 0.35
    figure = figure_of(width, total)
    ax = axes_of(figure, (0.75, total - 0.4 - height, width - 2.1, height))
    for name, count, (_, sense) in zip("xy", counted, axes, strict=True):
        more = "more" if sense == "max" else "fewer" if count.integer else "less"
        getattr(ax, f"set_{name}label")(f"{count.label(assembly)}  ({more} is better)", fontsize=9)
    ax.set_title(textwrap.shorten(assembly.name, 60, placeholder=" …"), fontsize=10, loc="left")
    figure.text(0.5, 0.1 / total, caption(results), fontsize=8, ha="center", va="bottom", color=SOFT)
    if not len(rows):
        say_nothing(ax, "no labelling collapses at a finite load factor")
        return figure
    scale = Normalize(min(points[:, 2].min(), 0.999 * points[:, 2].max()), points[:, 2].max())
    squares = all(c.integer for c in counted) and bool(np.all(np.ptp(counts_of_rows, axis=0) < _CELLS))
    for axis, count in zip((ax.xaxis, ax.yaxis), counted, strict=True):
        if count.integer:
            axis.set_major_locator(MaxNLocator(nbins=12, integer=True, min_n_ticks=1))
    (_squares if squares else _dots)(ax, rows[[first, second, "load_factor"]], points, sure, scale)
    beside = axes_of(figure, (width - 1.0, total - 0.4 - height, 0.16, height))
    bar = figure.colorbar(ScalarMappable(scale, STRENGTH), cax=beside)
    bar.set_label(f"load factor {explore_columns.ranked_by(results)} of the front [–]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    for number, k in enumerate(chosen):
        # Place the circle beside the number or dot.
        shift = (0.33, 0.3) if squares else (0.0, 0.0)
        at = float(points[k, 0]) + shift[0], float(points[k, 1]) + shift[1]
        away = (0.0, 0.0) if squares else (11.0, 11.0)
        ax.annotate(str(number + 1), at, away, textcoords="offset points", **circle(), zorder=4.0)
        words = "  ".join(c.words(v, assembly) for c, v in zip(counted, points[k, :2], strict=True))
        gallery.draw(
            figure,
            number,
            assembly,
            best["labelling"].iloc[k],
            f"{explore_columns.value_in_words(results, points[k, 2])}  {words}",
        )
    return figure


def _squares(ax: Axes, rows: pd.DataFrame, points: Floats, sure: Bools, scale: Normalize) -> None:
    """Draw each pair of counts as a square with its best λ; points: (k, 3) counts and λ on the front."""
    first, second, value = rows.columns
    on_front = {(x, y): (v, sure_value) for (x, y, v), sure_value in zip(points, sure, strict=True)}
    # (k, 3) each pair of counts with its best λ
    most = rows.groupby([first, second], as_index=False)[value].max().to_numpy(dtype=float)
    for x, y, best_load in most.tolist():
        at = x, y
        v, sure_value = on_front.get(at, (best_load, False))
        inside = at in on_front
        style: dict[str, Any] = {
            "facecolor": STRENGTH(scale(v)),
            "edgecolor": FRONT,
            "linewidth": 2.0 if sure_value else 1.2,
            "zorder": 2.0,
        }
        style |= {"linestyle": "-" if sure_value else (0, (3.0, 1.6))}
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


def _dots(ax: Axes, rows: pd.DataFrame, points: Floats, sure: Bools, scale: Normalize) -> None:
    """Draw every layout as a dot and the front coloured by λ, for counts with many values."""
    # Arguments as in `_squares`.
    first, second, _ = rows.columns
    ax.plot(rows[first], rows[second], "o", color=DOTS, alpha=0.4, markersize=3.0, markeredgewidth=0.0, zorder=1.0)
    for part, width, words in ((sure, 1.8, "proven"), (~sure, 0.9, "best found")):
        if part.any():
            ax.scatter(
                points[part, 0], points[part, 1], c=points[part, 2], cmap=STRENGTH, norm=scale, s=60.0,
                edgecolors=FRONT, linewidths=width, label=f"on the front, {words}", zorder=2.0,
            )  # fmt: skip
    ax.margins(0.08, 0.12)
    ax.legend(ncols=2, frameon=False, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
