"""Figures of joints that move, and of derivatives of λ by vertices."""

from __future__ import annotations

import textwrap
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.views import annotations as notes
from jld_core.views.figure_layout import figure_for, finish
from jld_core.views.figures import draw_assembly
from jld_core.views.look import PRESS
from jld_core.views.quantities import SMALL, typical
from jld_core.views.structure import projection_of

_LONGEST: Final = 0.8  # length of the longest arrow, relative to a typical element


def draw_vertex_vectors(ax: Axes, assembly: Assembly, places: Floats, vectors: Floats, *, true: bool = False) -> None:
    """Draw vectors at vertices as arrows on axes.

    places, vectors: (v, d), scene units. Vectors below 1 % of the longest, or NaN, are left out.
    """
    sizes = np.linalg.norm(np.nan_to_num(vectors), axis=1)
    largest = float(sizes.max(initial=0.0))
    shown = sizes > SMALL * largest
    if not shown.any():
        return
    projection = projection_of(assembly)
    scale = 1.0 if true else _LONGEST * typical(assembly) / largest
    arrows = projection(np.nan_to_num(vectors)[shown]) * scale
    notes.arrows(ax, projection(places[shown]), arrows, "vertices", PRESS, "tip" if true else "tail", 1.2)


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
    for ax, (assembly, own), title in zip(axes, pairs, titles, strict=True):
        draw_assembly(ax, assembly, own)
        ax.set_title(title, fontsize=10)
    draw_vertex_vectors(axes[1], after, places, moved, true=True)
    finish(figure, axes, textwrap.shorten(before.name, 60, placeholder=" …"))
    return figure


def figure_of_vertex_rates(assembly: Assembly, labels: Bits, places: Floats, rates: Floats) -> Figure:
    """Return a figure of the derivatives of λ by the positions of vertices, as arrows.

    labels: (m,) True = dry. places: (v, d) vertices, scene units. rates: (v, d) derivatives, 1/length; NaN where
    unknown. Each arrow points to where λ grows.
    """
    figure, axes = figure_for(assembly, 1)
    draw_assembly(axes[0], assembly, labels)
    draw_vertex_vectors(axes[0], assembly, places, rates)
    largest = float(np.linalg.norm(np.nan_to_num(rates), axis=1).max(initial=0.0))
    axes[0].set_title(f"Derivatives of λ by vertices, longest {largest:.3g} per {assembly.units[0]}", fontsize=10)
    finish(figure, axes, textwrap.shorten(assembly.name, 60, placeholder=" …"))
    return figure
