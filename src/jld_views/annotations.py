"""Annotations of figures: loads, arrows, axes, triad, legends, and their styles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from matplotlib.quiver import Quiver
from matplotlib.transforms import ScaledTranslation

from jld_core import Assembly, Bits, Floats, LimitAnalysisResult, blocks_of
from jld_core.limit import effects
from jld_views import quantities
from jld_views.look import (
    HATCH,
    LOAD,
    MEMBER,
    MOVEMENTS,
    PRESS,
    REST,
    SOFT,
    SUPPORT,
    THRUST_COLOUR,
    THRUST_DASH,
    TINTS,
    USED_STOPS,
    WHITE,
    YIELDS,
)
from jld_views.quantities import MovementSign
from jld_views.structure import DOTTED, Drawn, LineStyle, Move, element_points, extent, projection_of

USED: Final = LinearSegmentedColormap.from_list("used", list(USED_STOPS))  # colour map of utilisation, 0 … 1
TURN: Final[dict[str, Any]] = {"marker": r"$\circlearrowleft$", "linestyle": "none", "markeredgewidth": 0.2}
"""Marker style of a counter-clockwise couple."""

BACK: Final[dict[str, Any]] = {**TURN, "marker": r"$\circlearrowright$"}  # marker style of a clockwise couple
THRUST: Final[dict[str, Any]] = {"color": THRUST_COLOUR, "linewidth": 1.2, "linestyle": (0, THRUST_DASH)}
"""Line style of the thrust line, for matplotlib."""

YIELD: Final[dict[str, dict[str, Any]]] = {  # marker styles of yielding faces, for matplotlib
    f"yield {kind}": {**mark.style, "markeredgewidth": 0.6 if kind == "dry" else 0.4} for kind, mark in YIELDS.items()
}

MOVES: Final[dict[MovementSign, dict[str, Any]]] = {kind: mark.style for kind, mark in MOVEMENTS.items()}
"""Marker styles by kind of movement, for matplotlib."""

MEANING: Final = {kind: mark.meaning for kind, mark in MOVEMENTS.items()}  # legend texts by kind of movement
FONT: Final = 7.5  # font size of legends, points


def draw_loads(ax: Axes, assembly: Assembly, drawn: Drawn) -> list[Floats]:
    """Draw the live loads on axes; return the points that loads and structure cover, arrays (2,) or (k, 2) on paper."""
    # Point loads have their tips at the points; the load on all bodies is one arrow beside the structure. Artists are
    # added to `drawn` as "live", "body" and "couples".
    projection = projection_of(assembly)
    lower, upper = extent(assembly, projection)
    covered = [lower, upper]
    length = 0.13 * assembly.size
    loads = assembly.live_loads.arrows()
    if loads:
        at = projection(np.array([point for _, point, _ in loads]))
        vectors = projection(np.array([force for _, _, force in loads]))
        vectors *= length / max(float(np.linalg.norm(vectors, axis=1).max()), 1e-300)
        drawn["live"] = [arrows(ax, at, vectors, "live", LOAD, "tip", 1.5)]
        covered += [at, at - vectors]
    total = quantities.body_load(assembly)
    if total is not None:
        along = projection(total) / max(float(np.linalg.norm(projection(total))), 1e-300)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        with np.errstate(divide="ignore"):
            leave = float(np.min(half / abs(along)))
        tip = middle - along * (leave + 0.04 * assembly.size)
        # on small axes, the head must leave part of the shaft visible
        width = min(3.2, 0.125 * element_points(ax, assembly) * length / quantities.typical(assembly))
        drawn["body"] = [arrows(ax, tip[None], length * along[None], "body", LOAD, "tip", width)]
        covered += [tip, tip - length * along]
    couples = quantities.live_couples(assembly)
    if len(couples):
        at = projection(assembly.elements.centroid[couples])
        clockwise = assembly.live[couples, -1] < 0.0 if assembly.dimension == 2 else np.zeros(len(at), dtype=bool)
        look: dict[str, Any] = {"color": LOAD, "markersize": 14.0, "zorder": 5.0, "label": "live couples"}
        drawn["couples"] = [
            line
            for mask, turn in ((~clockwise, TURN), (clockwise, BACK))
            if mask.any()
            for line in ax.plot(*at[mask].T, **turn, **look)
        ]
    return covered


def arrows(
    ax: Axes, feet: Floats, vectors: Floats, name: str, colour: str, pivot: Any, width: float, hollow: bool = False
) -> Quiver:
    """Draw vectors (k, 2) at feet (k, 2), in data units, as arrows."""
    look: dict[str, Any] = {"facecolor": "white" if hollow else colour, "edgecolor": colour}
    look |= {"linewidth": 0.8 if hollow else 0.0, "zorder": 4.0, "label": name}
    head: dict[str, Any] = {"headwidth": 3.8, "headlength": 4.4, "headaxislength": 4.0, "minlength": 0.5}
    units: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "inches"}
    return ax.quiver(*feet.T, *vectors.T, width=width / 72.0, pivot=pivot, **units, **head, **look)


def frame(ax: Axes, assembly: Assembly, covered: list[Floats], bare: bool = False) -> None:
    """Set limits and aspect of axes so that they show the points `covered`, and label the axes."""
    points = np.vstack([np.atleast_2d(p) for p in covered])
    lower, upper = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * float(np.max(upper - lower))
    if assembly.dimension == 3 and not bare:
        lower = _draw_triad(ax, assembly, lower)
    ax.set_xlim(lower[0] - margin, upper[0] + margin)
    ax.set_ylim(lower[1] - margin, upper[1] + margin)
    ax.set_aspect("equal")
    if bare or assembly.dimension == 3:
        ax.set_axis_off()
        return
    # parse_math=False, since a single dollar sign in a unit would begin a formula
    ax.set_xlabel(f"x [{assembly.units[0]}]", fontsize=9, labelpad=2.0, parse_math=False)
    ax.set_ylabel(f"y [{assembly.units[0]}]", fontsize=9, labelpad=4.0, parse_math=False)
    ax.tick_params(labelsize=8)
    ax.locator_params(nbins=6, min_n_ticks=2)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def _draw_triad(ax: Axes, assembly: Assembly, lower: Floats) -> Floats:
    """Draw arrows along x, y, z to the left of a spatial view; return the lower corner (2,) with them."""
    size = assembly.size
    power = 10.0 ** math.floor(math.log10(0.18 * size))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 0.18 * size)
    tips = projection_of(assembly)(length * np.eye(3))
    foot = np.array([lower[0] - 0.22 * size, lower[1] + 0.06 * size])
    arrows(ax, np.repeat(foot[None], 3, axis=0), tips, "triad", SOFT, "tail", 0.9)
    text: dict[str, Any] = {"ha": "center", "color": SOFT}
    for name, tip in zip("xyz", tips, strict=True):
        reach = float(np.linalg.norm(tip))
        x, y = foot + tip * (1.0 + 0.035 * size / reach)
        ax.text(x, y, name, fontsize=8, va="center", **text)
    note = f"each {length:g} {assembly.units[0]}"
    ax.text(foot[0], foot[1] - 0.05 * size, note, fontsize=7, va="top", parse_math=False, **text)
    return np.array([foot[0] - 0.08 * size, min(lower[1], foot[1] - 0.08 * size)])


def legend(ax: Axes, handles: list[Artist]) -> None:
    """Add a legend below the axes, at a distance in points that suits any shape of the axes."""
    figure = ax.get_figure(root=True)
    if figure is None:
        return
    shift = ScaledTranslation(0.0, -_below(ax) / 72.0, figure.dpi_scale_trans)
    columns = int(np.clip(ax.bbox.width / figure.dpi / 2.0, 2, 5))
    size: dict[str, Any] = {"fontsize": FONT, "handlelength": 2.2, "columnspacing": 1.2, "labelspacing": 0.5}
    position: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 0.0}
    box = ax.legend(
        handles=handles, bbox_transform=ax.transAxes + shift, ncols=columns, frameon=False, **position, **size
    )
    for text in box.get_texts():
        text.set_parse_math(False)


def _below(ax: Axes) -> float:
    """Return the height that ticks and axis label take below the axes, points."""
    return 34.0 if ax.axison else 8.0


def legend_inches(ax: Axes) -> float:
    """Return an estimate of the height of ticks and legend below the axes, inches; 0.6 without a legend."""
    legend = ax.get_legend()
    figure = ax.get_figure(root=True)
    if legend is None or figure is None:
        return 0.6
    columns = int(np.clip(ax.bbox.width / figure.dpi / 2.0, 2, 5))
    rows = math.ceil(len(legend.get_texts()) / columns)
    return (_below(ax) + rows * 1.62 * FONT + 10.0) / 72.0


def _line(label: str, **style: Any) -> Line2D:
    return Line2D([], [], label=label, **style)


def _mark(label: str, marker: str, size: float, **style: Any) -> Line2D:
    return Line2D([], [], label=label, marker=marker, markersize=size, linestyle="none", **style)


def label_handles(assembly: Assembly, labels: Bits, ink: LineStyle) -> list[Artist]:
    """Return legend handles of dry faces, inner faces and supports, as present."""
    handles: list[Artist] = []
    for mask, name, dash in ((labels, "dry face", "solid"), (~labels, "inner face", DOTTED)):
        if mask.any():
            first = int(np.flatnonzero(mask)[0])
            width = max(float(ink.widths[first]), 0.8)
            handles.append(_line(name, color=ink.colours[first], linewidth=width, linestyle=dash))
    handles.append(Patch(facecolor=SUPPORT, edgecolor=HATCH, hatch="////", linewidth=0.4, label="support"))
    return handles


def block_handle(assembly: Assembly, labels: Bits) -> Artist:
    """Return the legend handle of the blocks' tints, with the number of blocks that are not supports alone."""
    count = len(np.unique(blocks_of(assembly, labels)[assembly.elements.free]))
    name = "1 block" if count == 1 else f"{count} blocks, by tint"
    return Patch(facecolor=TINTS[0], edgecolor=SOFT, linewidth=0.6, label=name)


def load_handles(drawn: Drawn) -> list[Artist]:
    """Return legend handles of the live loads that `draw_loads` has added to `drawn`."""
    styles: dict[str, Callable[[], Artist]] = {  # made where they are wanted, as arrows are set as formulas
        "live": lambda: _mark("live load, × λ", r"$\longrightarrow$", 15.0, color=LOAD, markeredgewidth=0.3),
        "body": lambda: _mark("live load on all bodies, × λ", r"$\Rightarrow$", 13.0, color=LOAD),
        "couples": lambda: _line("live couple, × λ", **TURN, markersize=10.0, color=LOAD),
    }
    return [handle() for name, handle in styles.items() if name in drawn]


def force_handles(result: LimitAnalysisResult, forces: Floats, drawn: Drawn, thick: float) -> list[Artist]:
    """Return legend handles of a figure of forces (m, q): utilisation, arrows, thrust line, loads."""
    size = np.linalg.norm(quantities.face_vectors(result.assembly, forces), axis=1)
    largest = f"longest {float(size.max(initial=0.0)):.3g} {result.assembly.units[1]}"
    handles: list[Artist] = []
    for used in (0.0, 0.5, 1.0):
        width = max(thick, 1.0) * (0.45 + 1.15 * used)
        handles.append(_line(f"utilisation {used:g}", color=USED(used), linewidth=width))
    styles: dict[str, Callable[[], Artist]] = {
        "press": lambda: _mark(f"pressing, {largest}", r"$\longrightarrow$", 15.0, color=PRESS, markeredgewidth=0.3),
        "tension": lambda: _mark("pulling (hollow)", r"$\Rightarrow$", 13.0, color=PRESS, markeredgewidth=0.3),
        "couples on faces": lambda: _line("bending without thrust on face", **TURN, markersize=8.0, color=PRESS),
        "thrust": lambda: _line("thrust line", **THRUST),
        "yield dry": lambda: _line(YIELDS["dry"].meaning, linestyle="none", markersize=6.0, **YIELD["yield dry"]),
        "yield inner": lambda: _line(YIELDS["inner"].meaning, linestyle="none", markersize=6.0, **YIELD["yield inner"]),
    }
    handles += [handle() for name, handle in styles.items() if name in drawn]
    return handles + load_handles(drawn)


def mechanism_handles(assembly: Assembly, labels: Bits, ink: LineStyle, drawn: Drawn) -> list[Artist]:
    """Return legend handles of a figure of a mechanism: labels, rest, kinds of movement."""
    handles = label_handles(assembly, labels, ink)
    handles.append(_line("at rest", color=REST, linewidth=0.6))
    for kind, style in MOVES.items():
        if str(kind) in drawn:
            handles.append(_line(MEANING[kind], linestyle="none", markersize=6.0, markeredgewidth=0.8, **style))
    return handles


_WIDTH = 1.6  # width of the line of a member, points; up to twice as much with its force
_SEEN = 1e-3  # least pressure of fill that is drawn, in the largest force of a member


def draw_members(
    ax: Axes, assembly: Assembly, drawn: Drawn, forces: Floats | None = None, move: Move | None = None
) -> None:
    """Draw fill and members on axes, and add them to `drawn`; with forces (m, q), write tensions and scale lines."""
    # The names in `drawn` are "fill" and "members", or "pressures" where all members are pressures of fill.
    members, projection = assembly.members, projection_of(assembly)
    if assembly.fill:
        joined = shapely.union_all([shapely.Polygon(outline) for outline in assembly.fill])
        parts = [np.array(part.exterior.coords) for part in getattr(joined, "geoms", [joined])]
        look_of_soil: dict[str, Any] = {"facecolor": WHITE, "edgecolor": HATCH, "hatch": "....", "linewidth": 0.0}
        drawn["fill"] = [ax.add_patch(Polygon(part, zorder=0.2, **look_of_soil)) for part in parts]
    if not members:
        return
    force = None if forces is None else effects(assembly, forces)
    largest = 0.0 if force is None else float(abs(force).max(initial=0.0))
    artists: list[Artist] = []
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
        artists += ax.plot(*line.T, color=MEMBER, linewidth=width, zorder=3.5, label="members", **look)
        if force is not None and not soil:
            artists.append(_written(ax, line, float(force[k])))
    if artists:
        drawn["pressures" if set(members.kinds) == {"fill"} else "members"] = artists


def _written(ax: Axes, line: Floats, force: float) -> Artist:
    """Write the value of a force beside the middle of a polyline (r, 2), and return the text."""
    middle = 0.5 * (line[(len(line) - 1) // 2] + line[len(line) // 2])
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 6.5, "color": MEMBER}
    text = ax.annotate(f"{force + 0.0:.3g}", middle, xytext=(3, 3), **style)
    text.set_path_effects([withStroke(linewidth=1.5, foreground=WHITE)])
    text.set_zorder(5.0)
    return text


def member_handles(drawn: Drawn, words: str = "member") -> list[Artist]:
    line: dict[str, Any] = {"color": MEMBER, "linewidth": _WIDTH, "marker": "o", "markersize": 2.0 + _WIDTH}
    handles: list[Artist] = []
    if "fill" in drawn:
        handles.append(Patch(facecolor=WHITE, edgecolor=HATCH, hatch="....", linewidth=0.0, label="fill"))
    if "pressures" in drawn:
        handles.append(Line2D([], [], **line, label="pressure of the fill"))
    if "members" in drawn:
        handles.append(Line2D([], [], **line, label=words))
    return handles
