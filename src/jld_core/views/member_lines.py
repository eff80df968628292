"""Drawing of fill, and of ties, tendons, pins and pressures of fill as lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.limit import effects
from jld_core.views.look import HATCH, MEMBER, WHITE
from jld_core.views.structure import Drawn, Move, projection_of

_WIDTH = 1.6  # width of the line of a member, points; up to twice as much with its force

_SEEN = 1e-3  # least pressure of fill that is drawn, in the largest force of a member


def draw_members(
    ax: Axes, assembly: Assembly, drawn: Drawn, forces: Floats | None = None, move: Move | None = None
) -> None:
    """Draw fill and members of an assembly on axes, and add them to `drawn`.

    forces: (m, q) resultants of the assembly; the tension is then written beside each member, and lines grow with it.
    move: displacement function (element, points) → points, if any.
    """
    # The names in `drawn` are "fill" and "members", or "pressures" where all members are pressures of fill.
    members, projection = assembly.members, projection_of(assembly)
    if assembly.fill:
        joined = shapely.union_all([shapely.Polygon(outline) for outline in assembly.fill])
        parts = [np.array(part.exterior.coords) for part in getattr(joined, "geoms", [joined])]
        drawn["fill"] = [ax.add_patch(_soil(part)) for part in parts]
    if not members:
        return
    force = None if forces is None else effects(assembly, forces)
    largest = 0.0 if force is None else float(abs(force).max(initial=0.0))
    found: list[Artist] = []
    for k, (elements, points) in enumerate(zip(members.elements, members.points, strict=True)):
        soil = members.kinds[k] == "fill"
        # Pressures are many: none in a mechanism, and of forces those that can be seen.
        if soil and (move is not None or (force is not None and abs(force[k]) <= _SEEN * largest)):
            continue
        if move is not None:
            points = np.vstack([move(int(e), p[None]) for e, p in zip(elements, points, strict=True)])
        line = projection(points)
        pin = members.kinds[k] == "pin"
        width = _WIDTH * (1.0 if force is None or largest == 0.0 else 1.0 + abs(float(force[k])) / largest)
        look: dict[str, Any] = {"marker": "s" if pin else "o", "markersize": 5.0 if pin else 2.0 + width}
        if soil:
            look["markevery"] = [0]  # the other end stands for the soil, not for a point of an element
        found += ax.plot(*line.T, color=MEMBER, linewidth=width, zorder=3.5, label="members", **look)
        if force is not None and not soil:
            found.append(_written(ax, line, float(force[k])))
    if found:
        drawn["pressures" if set(members.kinds) == {"fill"} else "members"] = found


def _soil(outline: Floats) -> Polygon:
    """Return the patch of an outline (k, 2) of fill."""
    return Polygon(outline, facecolor=WHITE, edgecolor=HATCH, hatch="....", linewidth=0.0, zorder=0.2)


def _written(ax: Axes, line: Floats, force: float) -> Artist:
    """Write the value of a force beside the middle of a polyline (r, 2), and return the text."""
    middle = 0.5 * (line[(len(line) - 1) // 2] + line[len(line) // 2])
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 6.5, "color": MEMBER}
    text = ax.annotate(f"{force + 0.0:.3g}", middle, xytext=(3, 3), **style)
    text.set_path_effects([withStroke(linewidth=1.5, foreground=WHITE)])
    text.set_zorder(5.0)
    return text


def member_handles(drawn: Drawn, words: str = "member") -> list[Artist]:
    """Return the legend handles of fill and members, an empty list if none were drawn."""
    line: dict[str, Any] = {"color": MEMBER, "linewidth": _WIDTH, "marker": "o", "markersize": 2.0 + _WIDTH}
    handles: list[Artist] = []
    if "fill" in drawn:
        handles.append(Patch(facecolor=WHITE, edgecolor=HATCH, hatch="....", linewidth=0.0, label="fill"))
    if "pressures" in drawn:
        handles.append(Line2D([], [], **line, label="pressure of the fill"))
    if "members" in drawn:
        handles.append(Line2D([], [], **line, label=words))
    return handles
