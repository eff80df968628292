"""Figures of stress and velocity fields: stress trajectories, and where blocks crack."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.fields.bounds import FieldBounds, Stresses, Velocities
from jld_core.views import annotations as notes
from jld_core.views import quantities
from jld_core.views.figure_layout import figure_for, finish
from jld_core.views.figures import draw_assembly, draw_rest, tints_of
from jld_core.views.look import HATCH, INK, LOAD, PLAIN, PRESS, SUPPORT
from jld_core.views.structure import Drawn, LineStyle, default_ink, extent, paint, projection_of
from jld_core.views.trajectories import APART, Sign, Trajectory, averaged, trajectories

DISPLACED: Final = 0.06
"""Largest displacement that is drawn, over the size of the scene."""

JUMP: Final = 0.02
"""Share of the largest velocity above which the jump across an edge is drawn."""

# Width of a trajectory at the largest stress of its sign, points; it falls to a fifth with the stress
_WIDEST: Final = 2.2

_DASH: Final = (5, 3)  # steps of a tensile trajectory that are drawn, and steps that are left out

_CRUSHED: Final = 0.02  # share of the largest dissipation per area above which a triangle is shaded


def draw_stresses(ax: Axes, assembly: Assembly, labels: Bits, stresses: Stresses | None) -> Drawn:
    """Draw the trajectories of principal stresses of a layout on axes, wider with stress.

    labels: (m,) True = dry.
    """
    # Compression is solid, tension dashed. Stresses are first averaged over about a twelfth of an element.
    base = default_ink(ax, assembly, labels)
    faded = LineStyle([INK if dry else HATCH for dry in labels], 0.7 * base.widths)
    drawn = paint(ax, assembly, labels, [PLAIN] * len(assembly.elements), faded)
    notes.frame(ax, assembly, notes.draw_loads(ax, assembly, drawn))
    handles = [*notes.label_handles(assembly, labels, faded), *notes.load_handles(drawn)]
    if stresses is None:
        notes.legend(ax, handles)
        ax.set_title("Stresses\nnone: no stress field was found", fontsize=10)
        return drawn
    grid = averaged(assembly, stresses)
    unit = f"{assembly.units[1]}/{assembly.units[0]}²"
    styles: tuple[tuple[Sign, str, Any], ...] = (("compression", PRESS, "solid"), ("tension", LOAD, (0, (3.0, 1.6))))
    for kind, colour, dash in styles:
        found = trajectories(grid, kind, APART * quantities.typical(assembly))
        if not found:
            continue
        largest = max(float(one.stress.max()) for one in found)
        drawn[kind] = [ax.add_collection(_lines(found, largest, colour, kind), autolim=False)]
        text = f"{kind} ({'solid' if kind == 'compression' else 'dashed'}), up to {largest:.3g} {unit}"
        handles.append(Line2D([], [], color=colour, linewidth=1.6, linestyle=dash, label=text))
    notes.legend(ax, handles)
    ax.set_title("Stress trajectories at the lower bound", fontsize=10)
    return drawn


def _lines(found: list[Trajectory], largest: float, colour: str, kind: str) -> LineCollection:
    """Build a line collection of trajectories whose line width grows with the stress."""
    pieces, widths = [], []
    for one in found:
        share = np.sqrt(one.stress / largest)
        for start in range(0, len(one.points) - 1, 1 if kind == "compression" else sum(_DASH)):
            end = start + (1 if kind == "compression" else _DASH[0])
            piece = one.points[start : end + 1]
            if len(piece) > 1:
                pieces.append(piece)
                widths.append(_WIDEST * max(0.2, float(share[start : end + 1].mean())))
    style: dict[str, Any] = {"colors": colour, "linewidths": widths, "capstyle": "butt"}
    return LineCollection(pieces, label=kind, zorder=3.0, **style)


def draw_cracks(ax: Axes, assembly: Assembly, labels: Bits, velocities: Velocities | None) -> Drawn:
    """Draw the displaced triangles of a velocity field, and where velocity jumps, on axes.

    labels: (m,) True = dry.
    """
    base = default_ink(ax, assembly, labels)
    if velocities is None:
        drawn = paint(ax, assembly, labels, [PLAIN] * len(assembly.elements))
        notes.frame(ax, assembly, list(extent(assembly, projection_of(assembly))))
        notes.legend(ax, notes.label_handles(assembly, labels, base))
        ax.set_title("Cracks\nnone: no velocity field was certified", fontsize=10)
        return drawn
    mesh, velocity = velocities.mesh, velocities.velocity
    top = max(float(np.hypot(velocity[..., 0], velocity[..., 1]).max()), 1e-300)
    scale = DISPLACED * assembly.size / top
    moved = mesh.corners + scale * velocity
    drawn = _blocks(ax, assembly, labels, velocities, moved)
    drawn["rest"] = draw_rest(ax, assembly)
    thick = float(np.clip(1.2 * base.widths.max(initial=1.0), 0.9, 2.4))
    sides, joint, size = _jumps(labels, velocities, moved, top, len(assembly.interfaces))
    for name, mask, colour, width in (("joints", joint, INK, thick), ("cracks", ~joint, LOAD, 0.7 * thick)):
        if mask.any():
            widths = width * np.clip(np.sqrt(size[mask] / max(float(size.max()), 1e-300)), 0.3, 1.0)
            style: dict[str, Any] = {"colors": colour, "linewidths": np.repeat(widths, 2), "capstyle": "round"}
            segments = sides[mask].reshape(-1, 2, 2)
            lines = LineCollection(list(segments), label=name, zorder=3.4 if name == "joints" else 3.2, **style)
            drawn[name] = [ax.add_collection(lines, autolim=False)]
    notes.frame(ax, assembly, [*extent(assembly, projection_of(assembly)), moved.reshape(-1, 2)])
    notes.legend(ax, _crack_handles(drawn, thick))
    ax.set_title(f"Cracks at the upper bound, live power 1, drawn × {scale:.3g}", fontsize=10)
    return drawn


def _blocks(ax: Axes, assembly: Assembly, labels: Bits, velocities: Velocities, moved: Floats) -> Drawn:
    """Draw supports and displaced triangles in the tints of blocks; shade deforming ones.

    labels: (m,) True = dry. moved: (t, 3, 2) displaced corners. Artists are returned by name.
    """
    mesh, tints = velocities.mesh, tints_of(assembly, labels)
    fills = [tints[cell] for cell in mesh.cell]
    support = assembly.elements.support
    ground: dict[str, Any] = {"facecolors": SUPPORT, "edgecolors": HATCH, "linewidths": 0.4, "hatch": "////"}
    shapes = [assembly.elements.shape[k] for k in np.flatnonzero(support)]
    # edges in the colour of the fill close the hairlines between triangles
    look: dict[str, Any] = {"facecolors": fills, "edgecolors": fills, "linewidths": 0.3, "zorder": 1.1}
    drawn: Drawn = {
        "supports": [ax.add_collection(PolyCollection(shapes, label="supports", zorder=1.0, **ground), autolim=False)],
        "blocks": [ax.add_collection(PolyCollection(list(moved), label="blocks", **look), autolim=False)],
    }
    rate = strain_power(velocities) / mesh.volume
    share = rate / max(float(np.quantile(rate, 0.98)), 1e-300)
    chosen = np.flatnonzero(share > _CRUSHED)
    if chosen.size:
        shade = 0.12 + 0.38 * np.clip(share[chosen], 0.0, 1.0)
        colours = np.column_stack([np.zeros((len(chosen), 3)), shade])
        shaded: dict[str, Any] = {"facecolors": colours, "linewidths": 0.0, "label": "deforming", "zorder": 1.2}
        drawn["deforming"] = [ax.add_collection(PolyCollection(list(moved[chosen]), **shaded), autolim=False)]
    return drawn


def strain_power(velocities: Velocities) -> Floats:
    """Return the integral (t,) of the rate of deformation over each triangle of a mesh.

    The rate is that of largest shear plus that of dilation, where velocities give the live load power 1. Figures shade
    the triangles in which it is large.
    """
    mesh = velocities.mesh
    slope = np.einsum("tki,tkj->tij", velocities.velocity, mesh.gradient)
    shear = np.hypot(slope[:, 0, 0] - slope[:, 1, 1], slope[:, 0, 1] + slope[:, 1, 0])
    return np.asarray((shear + abs(slope[:, 0, 0] + slope[:, 1, 1])) * mesh.volume)


def _jumps(labels: Bits, velocities: Velocities, moved: Floats, top: float, faces: int) -> tuple[Floats, Bools, Floats]:
    """Compute the displaced sides of dry joints and cracks, a mask of joints, and their jumps.

    labels: (m,) True = dry. moved: (t, 3, 2) displaced corners of triangles. faces: number m of faces. Returns sides
    (k, 2, 2, 2), with axes edge, side, end and coordinate; mask (k,); largest velocity jump (k,) of each edge. A
    support does not move.
    """
    mesh, e = velocities.mesh, velocities.mesh.sides
    face = np.where(e.tag < faces, e.tag, -1)
    rows = np.flatnonzero((e.b >= 0) | (face >= 0))
    both = e.b[rows] >= 0
    own = e.a[rows][:, None], e.corner_a[rows]
    other = np.where(both, e.b[rows], e.a[rows])[:, None], np.where(both[:, None], e.corner_b[rows], e.corner_a[rows])
    jump = np.where(both[:, None, None], velocities.velocity[other], 0.0) - velocities.velocity[own]
    size = np.hypot(jump[..., 0], jump[..., 1]).max(axis=1)
    there = np.where(both[:, None, None], moved[other], mesh.corners[own])
    joint = (face[rows] >= 0) & labels[np.maximum(face[rows], 0)]
    chosen = joint | (size > JUMP * top)
    sides = np.stack([moved[own], there], axis=1)[chosen]
    return sides, np.asarray(joint[chosen]), size[chosen]


def _crack_handles(drawn: Drawn, thick: float) -> list[Any]:
    """Return legend handles of a figure of cracks."""
    handles: list[Any] = []
    if "joints" in drawn:
        handles.append(Line2D([], [], color=INK, linewidth=thick, label="dry joint (thick: opens or slides)"))
    if "cracks" in drawn:
        handles.append(Line2D([], [], color=LOAD, linewidth=0.6 * thick, label="crack in a block (thin, no joint)"))
    if "deforming" in drawn:
        handles.append(Patch(facecolor=(0.0, 0.0, 0.0, 0.4), label="deforms (darker: faster)"))
    handles.append(Line2D([], [], color=HATCH, linewidth=0.6, label="at rest"))
    return handles


def figure_of_fields(assembly: Assembly, labels: Bits, bounds: FieldBounds) -> Figure:
    """Return a figure of labels, stress trajectories and cracks of one layout under one load.

    labels: (m,) True = dry.
    """
    figure, axes = figure_for(assembly, 3)
    draw_assembly(axes[0], assembly, labels)
    draw_stresses(axes[1], assembly, labels, bounds.stresses)
    draw_cracks(axes[2], assembly, labels, bounds.velocities)
    finish(figure, axes, title_of_fields(assembly, bounds))
    return figure


def figure_of_field_layouts(layouts: Sequence[tuple[Assembly, Bits, FieldBounds]], titles: Sequence[str]) -> Figure:
    """Return a figure of layouts side by side, stress trajectories above cracks.

    layouts: for each an assembly under one load, its labels (m,), True = dry, and its bounds.
    """
    count = len(layouts)
    figure, axes = figure_for(layouts[0][0], 2 * count, columns=count)
    for k, ((assembly, labels, bounds), title) in enumerate(zip(layouts, titles, strict=True)):
        draw_stresses(axes[k], assembly, labels, bounds.stresses)
        axes[k].set_title(title, fontsize=10)
        draw_cracks(axes[count + k], assembly, labels, bounds.velocities)
    finish(figure, axes, textwrap.shorten(layouts[0][0].name, 60, placeholder=" …"), columns=count)
    return figure


def title_of_fields(assembly: Assembly, bounds: FieldBounds) -> str:
    """Return the title of a figure of fields: name, bounds on λ and number of triangles."""
    low, high = (f"{end:.4g}" if math.isfinite(end) else "none" for end in (bounds.lower, bounds.upper))
    name = textwrap.shorten(assembly.name, 90, placeholder=" …")
    value = "no λ ≥ 0 is admissible" if bounds.upper < 0.0 else f"λ of the blocks in [{low}, {high}]"
    return f"{name}\n{value}  ·  {bounds.simplices} triangles"
