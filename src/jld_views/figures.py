"""Figures of an assembly, its forces and its mechanism, on any matplotlib axes, without pyplot state.

Each draw function returns artist lists by their meaning.
"""

from __future__ import annotations

import io
import math
import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jld_core import Assembly, Bits, Floats, InputError, LimitAnalysisResult, Status, files
from jld_core import assembly as core_assembly
from jld_core.limit import displacement, mechanism
from jld_views import annotations as notes
from jld_views import quantities
from jld_views.annotations import draw_members, member_handles
from jld_views.look import HATCH, PLAIN, PRESS, REST, SUPPORT, TINTS
from jld_views.structure import Drawn, LineStyle, default_ink, element_points, extent, paint, projection_of
from jld_views.writing import as_written, write_forces, write_ids, write_loads


def figure_for(assembly: Assembly, count: int, columns: int | None = None) -> tuple[Figure, list[Axes]]:
    """Return a new figure with axes of about their final size, on which line widths depend."""
    lower, upper = extent(assembly, projection_of(assembly))
    figure = Figure(dpi=120)
    FigureCanvasAgg(figure)
    axes = [figure.add_axes((0.0, 0.0, 1.0, 1.0), label=str(k)) for k in range(count)]
    _place(figure, axes, upper - lower + 0.2 * float(np.max(upper - lower)), columns)
    return figure, axes


def finish(figure: Figure, axes: list[Axes], title: str, columns: int | None = None) -> None:
    """Give all axes of a figure one scale and their final sizes, and set the figure's title."""
    limits = np.array([[ax.get_xlim(), ax.get_ylim()] for ax in axes])
    low, high = limits[:, :, 0].min(axis=0), limits[:, :, 1].max(axis=0)
    for ax in axes:
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
    _place(figure, axes, high - low, columns)
    figure.suptitle(title, fontsize=11, y=1.0 - 0.1 / figure.get_figheight(), va="top")


# Inches: room beside axes for ticks, least width of a column, for its title, height of a title, height of the title of
# the figure, and margin at the left
_TICKS, _LEAST_COLUMN, _TITLE, _FIGURE_TITLE, _LEFT = 0.75, 3.7, 0.45, 0.55, 0.25
_HIGHEST: Final = 6.0  # largest height of axes, inches


def _place(figure: Figure, axes: list[Axes], span: Floats, columns: int | None = None) -> None:
    """Set sizes in inches from the extent (2,) of the data, ticks, titles and the longest legend."""
    stacked = columns is None and len(axes) > 1 and span[1] < 0.4 * span[0]
    width = 9.5 if stacked else 4.4 if len(axes) > 1 else 6.0
    height = width * float(span[1] / span[0])
    if height > _HIGHEST:
        width, height = width * _HIGHEST / height, _HIGHEST
    legend = max(notes.legend_inches(ax) for ax in axes)
    column_width, row_height = max(width + _TICKS, _LEAST_COLUMN), _TITLE + height + legend
    columns = columns or (1 if stacked else len(axes))
    total = (columns * column_width + 0.1, math.ceil(len(axes) / columns) * row_height + _FIGURE_TITLE)
    figure.set_size_inches(*total)
    for k, ax in enumerate(axes):
        row, column = divmod(k, columns)
        left = column * column_width + 0.5 * (column_width - width) + _LEFT
        bottom = total[1] - _FIGURE_TITLE - row * row_height - _TITLE - height
        ax.set_position((left / total[0], bottom / total[1], width / total[0], height / total[1]))


def title_of(result: LimitAnalysisResult) -> str:
    """Return the title of a figure of a result: name, λ with its bracket, status, friction."""
    digits = 4
    if math.isfinite(result.gap) and result.gap > 0.0:
        digits = int(np.clip(math.ceil(-math.log10(result.gap)) + 2, 4, 14))
    low, high = (f"{end:.{digits}g}" if math.isfinite(end) else "unproven" for end in result.bracket)
    if result.status is Status.LOCKED:
        value = f"no finite collapse load (admissible from λ = {low} upwards)"
    elif result.status is Status.UNSTABLE:
        value = "no λ ≥ 0 is admissible"
    elif math.isfinite(result.load_factor):
        value = f"λ = {result.load_factor:.{max(digits - 2, 4)}g}  in  [{low}, {high}]"
    else:
        value = f"λ in [{low}, {high}]"
    name = textwrap.shorten(result.assembly.name, 90, placeholder=" …")
    return f"{name}\n{value}  ·  {result.status}  ·  {result.friction} friction"


FADED: Final = HATCH  # colour of faces where forces or mechanism are missing

NO_MECHANISM: Final = {  # texts by status for a missing mechanism
    Status.LOCKED: "none: no live load, however large, brings it down",
    Status.UNSTABLE: "none: it does not stand under any λ ≥ 0",
    Status.UNCERTIFIED: "none was proven",
    Status.FAILED: "none: the solve failed",
    Status.COLLAPSE: "not computed",
}


def draw_assembly(ax: Axes, assembly: Assembly, labels: Bits | None = None, *, plain: bool = False) -> Drawn:
    """Draw an assembly on axes.

    Blocks in tints, dry and inner faces, supports, live loads. labels: (m,), default the assembly's own.
    """
    # Dry faces are thick with ticks, inner faces thin and dotted, supports hatched. In space faces and elements are in
    # "elements" and "supports", in the order in which they are painted.
    labels = _labels(assembly, labels)
    assembly, labels = core_assembly.faces_of(assembly), labels[: assembly.faces]
    drawn = paint(ax, assembly, labels, tints_of(assembly, labels))
    draw_members(ax, assembly, drawn)
    if plain:
        notes.frame(ax, assembly, list(extent(assembly, projection_of(assembly))), bare=True)
        return drawn
    covered = notes.draw_loads(ax, assembly, drawn)
    notes.frame(ax, assembly, covered)
    handles = notes.label_handles(assembly, labels, default_ink(ax, assembly, labels))
    handles += [notes.block_handle(assembly, labels), *member_handles(drawn), *notes.load_handles(drawn)]
    notes.legend(ax, handles)
    ax.set_title("Labels", fontsize=10)
    return drawn


def draw_forces(ax: Axes, result: LimitAnalysisResult) -> Drawn:
    """Draw the forces on the faces of a result on axes, with utilisation and thrust line."""
    # Arrows are centred at centres of pressure and point along the load path; hollow arrows are tension (N < 0). A
    # turning arrow at the centroid marks a face without a centre of pressure on it. Forces below 1 % of the largest are
    # left out. Without forces the title says so.
    with_members, result = result, mechanism.result_of_faces(result)
    assembly, labels = result.assembly, result.labels
    base = default_ink(ax, assembly, labels)
    fills = [PLAIN] * len(assembly.elements)
    forces = result.forces
    if forces is None:
        faded = LineStyle([FADED] * len(labels), base.widths)
        drawn = paint(ax, assembly, labels, fills, faded)
        notes.frame(ax, assembly, notes.draw_loads(ax, assembly, drawn))
        handles = notes.label_handles(assembly, labels, faded)
        notes.legend(ax, [*handles, *notes.load_handles(drawn)])
        ax.set_title("Forces\nnone: no admissible forces are known", fontsize=10)
        return drawn
    used = quantities.utilisation(result)
    thick = float(base.widths.max(initial=0.5))
    ink = LineStyle([tuple(notes.USED(float(u))) for u in used], thick * (0.45 + 1.15 * used))
    drawn = paint(ax, assembly, labels, fills, ink)
    covered = notes.draw_loads(ax, assembly, drawn)
    covered += _draw_face_forces(ax, result, forces, drawn)
    _draw_thrust(ax, result, forces, drawn)
    _draw_yielding(ax, result, forces, used, drawn)
    draw_members(ax, with_members.assembly, drawn, with_members.forces)
    notes.frame(ax, assembly, covered)
    words = f"member with its tension, of a pin its shear [{assembly.units[1]}]"
    notes.legend(ax, [*notes.force_handles(result, forces, drawn, thick), *member_handles(drawn, words)])
    where = "at the best λ found" if result.status is Status.UNCERTIFIED else "at the proven λ"
    ax.set_title(f"Forces on the faces, {where}", fontsize=10)
    return drawn


def _draw_face_forces(ax: Axes, result: LimitAnalysisResult, forces: Floats, drawn: Drawn) -> list[Floats]:
    """Draw arrows and couples of face forces (m, q); return the points (k, 2) that they cover."""
    assembly, projection = result.assembly, projection_of(result.assembly)
    vectors = quantities.down_the_load_path(assembly, quantities.face_vectors(assembly, forces))
    size = np.linalg.norm(vectors, axis=1)
    largest = float(size.max(initial=0.0))
    visible = size > quantities.SMALL * largest
    if not visible.any():
        return []
    # cap the length of few large forces, so that ordinary ones remain visible
    longest = float(np.clip(0.35 * largest / np.median(size[visible]), 0.85, 2.0)) * quantities.typical(assembly)
    shaft = float(np.clip(0.045 * element_points(ax, assembly), 0.3, 1.3))
    at, on_face = quantities.pressure_points(assembly, forces)
    feet, arrows = projection(at), projection(vectors) * longest / largest
    for name, mask in (("press", visible & (forces[:, 0] >= 0.0)), ("tension", visible & (forces[:, 0] < 0.0))):
        if mask.any():
            hollow = name == "tension"
            colour = PRESS
            drawn[name] = [notes.arrows(ax, feet[mask], arrows[mask], name, colour, "mid", shaft, hollow)]
    couple = np.linalg.norm(forces[:, assembly.dimension :], axis=1)
    turning = ~on_face & (couple > quantities.SMALL * largest * quantities.typical(assembly))
    if turning.any():
        size_pt = float(np.clip(0.16 * element_points(ax, assembly), 4.0, 9.0))
        drawn["couples on faces"] = [
            *ax.plot(*feet[turning].T, **notes.TURN, color=PRESS, markersize=size_pt, zorder=4.2, label="couples")
        ]
    return [feet - 0.5 * arrows, feet + 0.5 * arrows]


def _draw_thrust(ax: Axes, result: LimitAnalysisResult, forces: Floats, drawn: Drawn) -> None:
    """Draw the thrust line of forces (m, q), if there is one, and add it to `drawn`."""
    projection = projection_of(result.assembly)
    pieces = [projection(piece) for piece in quantities.thrust_segments(result.assembly, forces)]
    if pieces:
        drawn["thrust"] = [
            line for piece in pieces for line in ax.plot(*piece.T, **notes.THRUST, zorder=3.0, label="thrust")
        ]


def _draw_yielding(ax: Axes, result: LimitAnalysisResult, forces: Floats, used: Floats, drawn: Drawn) -> None:
    """Mark each face at yield by a symbol on the half opposite to its centre of pressure; used: (m,) utilisation."""
    faces, labels = result.assembly.interfaces, result.labels
    size = float(np.clip(0.11 * element_points(ax, result.assembly), 2.0, 5.5))
    at = quantities.pressure_points(result.assembly, forces)[0]
    side = np.where(np.einsum("ij,ij->i", at - faces.origin, faces.e1) > 0.0, -0.3, 0.3)
    points = projection_of(result.assembly)(faces.origin + (side * faces.l1)[:, None] * faces.e1)
    for name, mask in (("yield dry", labels), ("yield inner", ~labels)):
        chosen = mask & (used >= quantities.YIELDING)
        if chosen.any():
            look = {**notes.YIELD[name], "markersize": size, "linestyle": "none", "zorder": 4.5}
            drawn[name] = [*ax.plot(*points[chosen].T, label=name, **look)]


def draw_mechanism(ax: Axes, result: LimitAnalysisResult, share: float = 1.0) -> Drawn:
    """Draw a share of the mechanism of a result on axes: displaced elements over the outline at rest."""
    result = mechanism.result_of_faces(result)
    assembly, labels, projection = result.assembly, result.labels, projection_of(result.assembly)
    ink, falls = default_ink(ax, assembly, labels), result.instability_mechanism is not None
    if falls:
        result = replace(result, mechanism=result.instability_mechanism)
    if result.mechanism is None:
        faded = LineStyle([FADED] * len(labels), ink.widths)
        drawn = paint(ax, assembly, labels, [PLAIN] * len(assembly.elements), faded)
        notes.frame(ax, assembly, list(extent(assembly, projection)))
        notes.legend(ax, notes.label_handles(assembly, labels, faded))
        ax.set_title(f"Mechanism\n{NO_MECHANISM[result.status]}", fontsize=10)
        return drawn
    velocity, scale = result.mechanism, quantities.mechanism_scale(assembly, result.mechanism)

    def move(element: int, points: Floats) -> Floats:
        return np.asarray(points + share * scale * displacement(assembly, velocity, element, points))

    def fully(element: int, points: Floats) -> Floats:
        return np.asarray(points + scale * displacement(assembly, velocity, element, points))

    drawn = paint(ax, assembly, labels, tints_of(assembly, labels), LineStyle(ink.colours, 0.8 * ink.widths), move)
    drawn["rest"] = draw_rest(ax, assembly)
    draw_members(ax, assembly, drawn, move=move)
    kinds, positions = quantities.movements(result)
    size = float(np.clip(0.13 * element_points(ax, assembly), 2.0, 6.0))
    for kind, style in notes.MOVES.items():
        chosen = [k for k, title in enumerate(kinds) if title is kind]
        if chosen:
            faces = assembly.interfaces
            sides = [[move(int(side[k]), positions[[k]])[0] for k in chosen] for side in (faces.a, faces.b)]
            look = {**style, "linestyle": "none", "markersize": size, "markeredgewidth": 0.13 * size}
            drawn[str(kind)] = [*ax.plot(*projection(np.mean(sides, axis=0)).T, label=str(kind), zorder=4.0, **look)]
    notes.frame(ax, assembly, [*extent(assembly, projection), *extent(assembly, projection, fully)])
    notes.legend(ax, [*notes.mechanism_handles(assembly, labels, ink, drawn), *member_handles(drawn)])
    title = "Falls whatever the live load: the motion that proves it" if falls else "Mechanism for live power 1"
    ax.set_title(title if falls else f"{title}, drawn × {scale:.3g}", fontsize=10)
    return drawn


def draw_rest(ax: Axes, assembly: Assembly) -> list[Artist]:
    """Draw thin outlines of the free elements at rest; return the one artist."""
    projection, rings = projection_of(assembly), []
    for k in assembly.elements.free:
        shape = projection(assembly.elements.shape[k])
        spatial = assembly.dimension == 3
        for ring in assembly.elements.faces[k] if spatial else [tuple(range(len(shape)))]:
            rings += [shape[[*ring, ring[0]]], np.full((1, 2), np.nan)]
    return [*ax.plot(*np.vstack(rings).T, color=REST, linewidth=0.5, zorder=0.9, label="rest")]


def figure_of_assembly(assembly: Assembly, *, ids: bool = False, values: bool = False) -> Figure:
    """Return a figure of an assembly under the name of the scene."""
    figure, axes = figure_for(assembly, 1)
    draw_assembly(axes[0], assembly)
    if ids:
        write_ids(axes[0], assembly)
    if values:
        write_loads(axes[0], assembly)
    axes[0].set_title("")
    finish(figure, axes, textwrap.shorten(assembly.name, 60, placeholder=" …"))
    return figure


def figure_of_mechanism(result: LimitAnalysisResult) -> tuple[Figure, Axes]:
    """Return a figure of the mechanism of a result, titled by name, λ and status, and its axes for an animation."""
    figure, axes = figure_for(result.assembly, 1)
    draw_mechanism(axes[0], result)
    name = textwrap.shorten(result.assembly.name, 50, placeholder=" …")
    finish(figure, axes, f"{name}\nλ = {result.load_factor:.5g}, {result.status}")
    return figure, axes[0]


def figure_of_result(result: LimitAnalysisResult, *, ids: bool = False, values: bool = False) -> Figure:
    """Return a figure of labels, forces and mechanism of one result."""
    # The axes are side by side, or above one another for very wide scenes. The title has name, λ with its bracket, and
    # status. Of several load cases the governing one is drawn.
    if result.governing is not None:
        result = result.cases[result.governing]
    figure, axes = figure_for(result.assembly, 3)
    draw_assembly(axes[0], result.assembly, result.labels)
    draw_forces(axes[1], result)
    draw_mechanism(axes[2], result)
    if ids:
        write_ids(axes[0], result.assembly)
    if values:
        write_loads(axes[0], result.assembly)
        write_forces(axes[1], result)
    finish(figure, axes, title_of(result))
    return figure


def figure_of_layouts(results: Sequence[LimitAnalysisResult], titles: Sequence[str]) -> Figure:
    """Return a figure of layouts of one assembly side by side, labels above mechanisms."""
    count = len(results)
    figure, axes = figure_for(results[0].assembly, 2 * count, columns=count)
    for k, (result, title) in enumerate(zip(results, titles, strict=True)):
        draw_assembly(axes[k], result.assembly, result.labels)
        axes[k].set_title(title, fontsize=10)
        draw_mechanism(axes[count + k], result)
    finish(figure, axes, textwrap.shorten(results[0].assembly.name, 60, placeholder=" …"), columns=count)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a .png, .svg or .pdf file, completely or not at all; equal figures give equal bytes."""
    ending = Path(path).suffix.lower()
    undated: dict[str, dict[str, Any]] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    if ending not in undated:
        raise InputError(str(path), f"{ending!r} is no ending of a picture", "a name ending in .png, .svg or .pdf")
    with mpl.rc_context({"svg.hashsalt": "jld"}), as_written(figure), files.whole_file(Path(path)) as fresh:
        figure.savefig(fresh, format=ending[1:], metadata=undated[ending])


def svg_of(figure: Figure) -> str:
    """Return a figure as SVG text that can stand in an HTML page; equal figures give equal text."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "jld"}), as_written(figure):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _labels(assembly: Assembly, labels: Bits | None) -> Bits:
    """Return labels as an array, default the assembly's; raise ValueError for a wrong length."""
    labels = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    if labels.shape not in ((assembly.faces,), (len(assembly.interfaces),)):
        raise ValueError(f"labels have shape {labels.shape}, expected ({assembly.faces},)")
    return labels


def tints_of(assembly: Assembly, labels: Bits) -> list[str]:
    """Return the fill colour (#rrggbb) of each element: by block, and grey for supports."""
    colours = quantities.block_colours(assembly, labels, len(TINTS))
    return [TINTS[colour] if colour >= 0 else SUPPORT for colour in colours]


# Number of frames from rest to the drawn displacement and back; the opposite one would let blocks penetrate.
FRAMES: Final = 24
PER_SECOND: Final = 12  # frames per second


def save_animation(result: LimitAnalysisResult, path: str | Path) -> None:
    """Write the mechanism of a result as a looped .gif or .mp4; raise InputError without mechanism or ffmpeg."""
    ending = Path(path).suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError(str(path), f"{ending!r} is no ending of an animation", "a name ending in .gif or .mp4")
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(str(path), "ffmpeg is not on this machine", "a name ending in .gif")
    if result.mechanism is None:
        raise InputError(result.assembly.name, f"it has no mechanism to move ({result.status})", "one that collapses")
    writer: Any = PillowWriter(fps=PER_SECOND) if ending == ".gif" else FFMpegWriter(fps=PER_SECOND)
    figure, ax = figure_of_mechanism(result)
    with writer.saving(figure, str(path), dpi=100):
        for k in range(FRAMES):
            ax.clear()
            draw_mechanism(ax, result, share=float(0.5 - 0.5 * np.cos(2.0 * np.pi * k / FRAMES)))
            with as_written(figure):
                writer.grab_frame()


_SVG: Final = 50_000  # largest size of a drawing as SVG text, bytes; a notebook stores it in two forms
_PNG: Final = 45_000  # largest size of a drawing as PNG, bytes; larger ones are drawn with fewer pixels

# Pixels per inch of a PNG, of which the first that is small enough is taken, else the last
_DOTS: Final = (100, 75, 55, 40, 25)
_COLOURS: Final = 64  # number of colours of a PNG


def drawing_of(figure: Figure) -> str | bytes:
    """Return a figure as SVG text, or as PNG content if the text would be large."""
    text = svg_of(figure)
    return text if len(text) <= _SVG else png_of(figure)


def png_of(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file in few colours, of fewer pixels where it would be large.

    Parameters
    ----------
    figure : Figure
        Figure.

    Returns
    -------
    bytes
        Content.
    """
    from PIL import Image  # comes with matplotlib; slow to import

    reduced = io.BytesIO()
    for dots in _DOTS:
        picture, reduced = io.BytesIO(), io.BytesIO()
        figure.savefig(picture, format="png", dpi=dots)
        Image.open(picture).convert("RGB").quantize(_COLOURS).save(reduced, format="png", optimize=True)
        if reduced.tell() <= _PNG:
            break
    return reduced.getvalue()
