"""Drawings of moved joints and of paths of assembly."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, Bits, Floats, LimitAnalysisResult
from jld_views import annotations as notes
from jld_views.figures import draw_assembly, figure_for, finish
from jld_views.look import FRONT, INK, PRESS, SOFT, TINTS
from jld_views.quantities import SMALL, typical
from jld_views.structure import projection_of

_LONGEST: Final = 0.8  # length of the longest arrow, relative to a typical element


def draw_vertex_vectors(ax: Axes, assembly: Assembly, places: Floats, vectors: Floats, *, true: bool = False) -> None:
    """Draw vectors (v, d) at vertices (v, d) as arrows on axes, without those below 1 % of the longest, or NaN."""
    sizes = np.linalg.norm(np.nan_to_num(vectors), axis=1)
    largest = float(sizes.max(initial=0.0))
    visible = sizes > SMALL * largest
    if not visible.any():
        return
    projection = projection_of(assembly)
    scale = 1.0 if true else _LONGEST * typical(assembly) / largest
    arrows = projection(np.nan_to_num(vectors)[visible]) * scale
    notes.arrows(ax, projection(places[visible]), arrows, "vertices", PRESS, "tip" if true else "tail", 1.2)


def figure_of_move(
    before: Assembly,
    after: Assembly,
    labels: Bits,
    places: Floats,
    moved: Floats,
    titles: tuple[str, str],
    first: Bits | None = None,
) -> Figure:
    """Return a figure of a structure before and after a move of its joints.

    Parameters
    ----------
    before, after : Assembly
        Structures.
    labels : (m,) array of bool
        True = dry.
    places : (v, 2) array
        Vertices after the move, scene units.
    moved : (v, 2) array
        Their displacements, drawn as arrows.
    titles : (str, str)
        Titles of both drawings.
    first : (m,) array of bool, optional
        Labels before the move; None for the same.

    Returns
    -------
    Figure
        Figure.
    """
    figure, axes = figure_for(before, 2)
    pairs = ((before, labels if first is None else first), (after, labels))
    for ax, (assembly, labels_of_pair), title in zip(axes, pairs, titles, strict=True):
        draw_assembly(ax, assembly, labels_of_pair)
        ax.set_title(title, fontsize=10)
    draw_vertex_vectors(axes[1], after, places, moved, true=True)
    finish(figure, axes, textwrap.shorten(before.name, 60, placeholder=" …"))
    return figure


def figure_of_vertex_rates(assembly: Assembly, labels: Bits, places: Floats, rates: Floats) -> Figure:
    """Return a figure of the derivatives of λ by vertices (v, d), as arrows to where λ grows; NaN: unknown."""
    figure, axes = figure_for(assembly, 1)
    draw_assembly(axes[0], assembly, labels)
    draw_vertex_vectors(axes[0], assembly, places, rates)
    largest = float(np.linalg.norm(np.nan_to_num(rates), axis=1).max(initial=0.0))
    axes[0].set_title(f"Derivatives of λ by vertices, longest {largest:.3g} per {assembly.units[0]}", fontsize=10)
    finish(figure, axes, textwrap.shorten(assembly.name, 60, placeholder=" …"))
    return figure


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
        return 0.5 * (self.low + self.high)


def path_values(result: LimitAnalysisResult) -> list[PathValue]:
    """Return λ at each position of the moving loads of a result; empty without any."""
    values = []
    for case in result.assembly.cases:
        if case.place is not None:
            low, high = result.cases[case.name].bracket
            values.append(PathValue(*case.place, low, high, case.required))
    return values


def draw_path(ax: Axes, values: list[PathValue], length: str, *, distance: str = "first axle along the path") -> None:
    """Draw λ against the place of the first axle, one line for each vehicle and direction."""
    # A position without a number has no mark; the least λ over required is marked.
    names = list(dict.fromkeys(value.vehicle for value in values))
    colours = (PRESS, FRONT, SOFT, *TINTS)
    for k, name in enumerate(names):
        of_vehicle = [value for value in values if value.vehicle == name]
        x, y = [required.distance for required in of_vehicle], [required.middle for required in of_vehicle]
        colour = colours[k % len(colours)]
        ax.plot(
            x, y, color=colour, marker="o", markersize=2.5, linewidth=1.1, linestyle=("-", "--", ":")[k % 3], label=name
        )
    bounded = [value for value in values if math.isfinite(value.middle)]
    if bounded:
        least = min(bounded, key=lambda required: required.middle / required.required)
        ax.plot([least.distance], [least.middle], marker="o", markersize=7, markerfacecolor="none", color=INK)
        ax.annotate(
            f"{least.middle:.4g}", (least.distance, least.middle), xytext=(6, 6), textcoords="offset points", fontsize=7
        )
        ax.set_ylim(0.0, 1.1 * min(max(required.middle for required in bounded), _HIGHEST * least.middle))
    for required in sorted({value.required for value in values}):
        ax.axhline(required, color=SOFT, linewidth=0.7, linestyle=(0, (1, 2)))
    ax.set_xlabel(f"{distance} [{length}]", fontsize=7)
    ax.set_ylabel("λ", fontsize=7)
    ax.tick_params(labelsize=6.5)
    if len(names) > 1:
        ax.legend(fontsize=6.5, frameon=False)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def figure_of_path(assembly: Assembly, values: list[PathValue]) -> Figure:
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    ax = figure.add_subplot()
    draw_path(ax, values, assembly.units[0])
    ax.set_title(f"{textwrap.shorten(assembly.name, 50, placeholder=' …')}: λ along the path", fontsize=9)
    return figure
