"""Drawings of moulds in the printed report: outlines with the lengths of their edges."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from matplotlib.axes import Axes

from jld_core.arrays import Floats
from jld_core.views.look import INK
from jld_practice.making import Stone

_SIZE: Final = 5.5  # size of the letters, points

_LETTER: Final = (0.62, 0.95)  # width and height of a digit, relative to the size of the letters

_GAP: Final = 2.0  # distance of a length from its edge, points

_MARGIN: Final = 0.2  # margin on each side of a drawing, relative to the outline

_SHORT: Final = 0.04  # length of an edge, relative to the outline, up to which it bears none

_SHARES: Final = (0.5, 0.35, 0.65, 0.2, 0.8)  # places of a length along its edge, in the order in which they are tried


def draw_mould(ax: Axes, stone: Stone, factor: float, tint: str) -> None:
    """Draw the outline of a planar stone with the lengths of its edges.

    A length lies outside beside the middle of its edge. Where it would lie on an edge or on another length it moves
    along its edge, or inside. factor: from the unit of the scene to that of the lengths.
    """
    if stone.outline is None:
        raise ValueError("a stone in space has no outline")
    ring = factor * stone.outline
    ax.fill(*ring.T, facecolor=tint, edgecolor=INK, linewidth=0.8)
    ax.set_aspect("equal")
    ax.margins(_MARGIN)
    ax.set_axis_off()
    edges = np.roll(ring, -1, axis=0) - ring
    lengths = np.hypot(*edges.T)
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    point = _point(ax, ring)
    outline = shapely.LinearRing(ring)
    taken: list[shapely.Geometry] = []
    # long edges first: they have room beside their middle
    for k in np.argsort(-lengths, kind="stable").tolist():
        if lengths[k] <= _SHORT * float(np.ptp(ring, axis=0).max()):
            continue
        text = f"{lengths[k]:.0f}" if lengths[k] >= 99.95 else f"{lengths[k]:.1f}"
        half = 0.5 * point * _SIZE * np.array([_LETTER[0] * len(text), _LETTER[1]])
        off = float(abs(outward[k]) @ half) + _GAP * point
        places = [ring[k] + share * edges[k] + side * off * outward[k] for side in (1.0, -1.0) for share in _SHARES]
        boxes = shapely.box(*(np.array(places) - half).T, *(np.array(places) + half).T)
        free = [
            not (outline.intersects(box) or any(box.intersects(other) for other in taken)) for box in boxes.tolist()
        ]
        best = free.index(True) if any(free) else 0
        taken.append(boxes[best])
        x, y = places[best].tolist()
        ax.text(x, y, text, fontsize=_SIZE, ha="center", va="center")


def _point(ax: Axes, ring: Floats) -> float:
    """Return the length of a point on paper in the unit of an outline (k, 2) that fills its axes."""
    # before an equal aspect shrinks the axes
    box = ax.get_position(original=True).transformed(ax.figure.transSubfigure)
    room = 72.0 / ax.figure.dpi * np.array([box.width, box.height])
    return float((np.ptp(ring, axis=0) * (1.0 + 2.0 * _MARGIN) / room).max())
