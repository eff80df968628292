"""Drawing of members: ties, tendons and pins as lines, with their forces."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.limit.member_results import effects
from jld_core.views.look import MEMBER, WHITE
from jld_core.views.structure import Drawn, Move, projection_of

_WIDTH = 1.6
"""Width of the line of a member, points; up to twice as much with its force."""


def draw_members(
    ax: Axes, assembly: Assembly, drawn: Drawn, forces: Floats | None = None, move: Move | None = None
) -> None:
    """Draw the members of an assembly on axes, and add them to `drawn` as "members".

    forces: (m, q) resultants of the assembly; the tension is then written beside each member, and lines grow with it.
    move: displacement function (element, points) → points, if any.
    """
    members, projection = assembly.members, projection_of(assembly)
    if not members:
        return
    force = None if forces is None else effects(assembly, forces)
    largest = 0.0 if force is None else float(abs(force).max(initial=0.0))
    found: list[Artist] = []
    for k, (elements, points) in enumerate(zip(members.elements, members.points, strict=True)):
        if move is not None:
            points = np.vstack([move(int(e), p[None]) for e, p in zip(elements, points, strict=True)])
        line = projection(points)
        pin = members.kinds[k] == "pin"
        width = _WIDTH * (1.0 if force is None or largest == 0.0 else 1.0 + abs(float(force[k])) / largest)
        look: dict[str, Any] = {"marker": "s" if pin else "o", "markersize": 5.0 if pin else 2.0 + width}
        found += ax.plot(*line.T, color=MEMBER, linewidth=width, zorder=3.5, label="members", **look)
        if force is not None:
            found.append(_written(ax, line, float(force[k])))
    drawn["members"] = found


def _written(ax: Axes, line: Floats, force: float) -> Artist:
    """Write the value of a force beside the middle of a polyline (r, 2), and return the text."""
    middle = 0.5 * (line[(len(line) - 1) // 2] + line[len(line) // 2])
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 6.5, "color": MEMBER}
    text = ax.annotate(f"{force + 0.0:.3g}", middle, xytext=(3, 3), **style)
    text.set_path_effects([withStroke(linewidth=1.5, foreground=WHITE)])
    text.set_zorder(5.0)
    return text


def member_handles(drawn: Drawn, words: str = "member") -> list[Artist]:
    """Return the legend handle of members in a list, empty if none were drawn.

    words: text of the legend.
    """
    if "members" not in drawn:
        return []
    return [Line2D([], [], color=MEMBER, linewidth=_WIDTH, marker="o", markersize=2.0 + _WIDTH, label=words)]
