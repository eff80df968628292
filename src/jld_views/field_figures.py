"""Figures of fields of stress and velocity, with trajectories of principal stress."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import gaussian_filter, map_coordinates

from jld_core import Assembly, Bits, Bools, Floats
from jld_core.fields import bounds as core_bounds
from jld_views import annotations as notes
from jld_views import quantities
from jld_views.figures import draw_assembly, draw_rest, figure_for, finish, tints_of
from jld_views.look import HATCH, INK, LOAD, PLAIN, PRESS, SUPPORT
from jld_views.quantities import typical
from jld_views.structure import Drawn, LineStyle, default_ink, extent, paint, projection_of

Sign = Literal["compression", "tension"]  # sign of a principal stress
GRID: Final = 12  # grid points along a typical element on which stresses are averaged for drawing
APART: Final = 0.2  # distance between trajectories over the size of a typical element
FAINT: Final = 0.06  # share of the largest principal stress of its sign below which no trajectory is drawn
_MOST_POINTS: Final = 400  # largest number of grid points along one side of the structure
_STEPS: Final = 600  # largest number of steps of one trajectory in each direction; one step is half a grid spacing
_PIECES: Final = 4  # parts of each edge of a triangle: stresses are sampled at the middles of its equal parts


@dataclass(frozen=True)
class AveragedStresses:
    """Stresses averaged on a regular grid of ny × nx points."""

    origin: Floats  # (2,) first grid point
    spacing: float  # of grid points, length
    stress: Floats  # (ny, nx, 3) σx, σy, τxy, tension positive
    inside: Bools  # (ny, nx) True within free elements

    def at(self, points: Floats) -> Floats:
        """Return the stresses (k, 3) at points (k, 2), interpolated linearly between grid points."""
        grid_points = ((points - self.origin) / self.spacing)[:, ::-1].T
        parts = [map_coordinates(self.stress[..., c], grid_points, order=1, mode="nearest") for c in range(3)]
        return np.stack(parts, axis=1)

    def holds(self, points: Floats) -> Bools:
        """Return a mask (k,) of points (k, 2) whose nearest grid point is inside free elements."""
        column, row = np.round((points - self.origin) / self.spacing).astype(np.int64).T
        rows, columns = self.inside.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        contained = np.zeros(len(points), dtype=bool)
        contained[inside] = self.inside[row[inside], column[inside]]
        return contained


@dataclass(frozen=True)
class Trajectory:
    points: Floats  # (k, 2) along it, scene units
    stress: Floats  # (k,) magnitude of the principal stress there


def averaged(assembly: Assembly, stresses: core_bounds.Stresses) -> AveragedStresses:
    """Average a planar stress field on a regular grid, so that its trajectories can be drawn."""
    # The spacing of the grid is a share of a typical element. A Gaussian filter of this width smooths jumps between
    # triangles.
    elements = assembly.elements
    lower, upper = elements.lower[elements.free].min(axis=0), elements.upper[elements.free].max(axis=0)
    spacing = max(typical(assembly) / GRID, float((upper - lower).max()) / _MOST_POINTS)
    count = np.ceil((upper - lower) / spacing).astype(np.int64) + 1
    corners, values = stresses.mesh.corners, stresses.stress
    # centres of the equal parts of a triangle, by their shares of the second and third corner
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(_PIECES) for j in range(_PIECES - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(_PIECES - 1) for j in range(_PIECES - 1 - i)]
    total = np.zeros((*count[::-1], 4))
    flat = total.reshape(-1, 4)
    for first, second in upright + turned:
        weights = np.array([_PIECES - first - second, first, second]) / _PIECES
        cell = np.round((np.einsum("k,tkd->td", weights, corners) - lower) / spacing).astype(np.int64)
        number = np.clip(cell[:, 1], 0, count[1] - 1) * count[0] + np.clip(cell[:, 0], 0, count[0] - 1)
        stress = np.einsum("k,tkc->tc", weights, values)
        np.add.at(flat, number, np.column_stack([stress, np.ones(len(stress))]) * stresses.mesh.volume[:, None])
    smooth = np.stack([gaussian_filter(total[..., c], 1.0, mode="constant") for c in range(4)], axis=-1)
    x, y = (lower[axis] + spacing * np.arange(count[axis]) for axis in (0, 1))
    shapes = shapely.union_all([shapely.Polygon(elements.shape[k]) for k in elements.free])
    inside = shapely.contains_xy(shapely.buffer(shapes, 0.3 * spacing), *np.meshgrid(x, y))
    weight = smooth[..., 3]
    covered = weight > 1e-6 * float(weight.max())
    stress = np.where(covered[..., None], smooth[..., :3] / np.where(covered, weight, 1.0)[..., None], 0.0)
    return AveragedStresses(lower, spacing, stress, np.asarray(inside & covered))


def principal(stress: Floats, kind: Sign) -> tuple[Floats, Floats]:
    """Return the principal stress (k,) of one sign, 0 where there is none, and its directions (k, 2).

    stress: (k, 3) σx, σy, τxy, tension positive.
    """
    m, d, s = 0.5 * (stress[:, 0] + stress[:, 1]), 0.5 * (stress[:, 0] - stress[:, 1]), stress[:, 2]
    radius, angle = np.hypot(d, s), 0.5 * np.arctan2(s, d)
    if kind == "compression":
        return np.maximum(radius - m, 0.0), np.column_stack([-np.sin(angle), np.cos(angle)])
    return np.maximum(m + radius, 0.0), np.column_stack([np.cos(angle), np.sin(angle)])


def trajectories(grid: AveragedStresses, kind: Sign, spacing: float) -> list[Trajectory]:
    """Trace evenly spaced trajectories of principal stress, the most stressed first."""
    rows, columns = np.nonzero(grid.inside)
    seeds = grid.origin + grid.spacing * np.column_stack([columns, rows])
    size = principal(grid.at(seeds), kind)[0]
    least = FAINT * float(size.max(initial=0.0))
    if not least > 0.0:
        return []
    occupied = _Occupied(grid, spacing)
    lines = []
    for seed in seeds[np.argsort(-size, kind="stable")][: int((size > least).sum())]:
        if occupied.near(seed, 1.0):
            continue
        halves = [_trace(grid, kind, seed, sign, least, occupied) for sign in (-1.0, 1.0)]
        points = np.concatenate([halves[0][:0:-1], halves[1]])
        occupied.add(points)
        if len(points) > 3:
            lines.append(Trajectory(points, principal(grid.at(points), kind)[0]))
    return lines


class _Occupied:
    """Points of the trajectories traced so far, in squares whose side is the distance `apart`."""

    def __init__(self, grid: AveragedStresses, spacing: float) -> None:
        self._origin, self._spacing = grid.origin, spacing
        self._squares: dict[tuple[int, int], list[tuple[float, float]]] = {}

    def add(self, points: Floats) -> None:
        for x, y in points.tolist():
            self._squares.setdefault(self._square(x, y), []).append((x, y))

    def near(self, point: Floats, share: float) -> bool:
        """Return True if a stored point lies within `share` of the distance between trajectories."""
        x, y = float(point[0]), float(point[1])
        column, row = self._square(x, y)
        limit = share * self._spacing
        return any(
            math.hypot(x - other[0], y - other[1]) < limit
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
            for other in self._squares.get((column + i, row + j), ())
        )

    def _square(self, x: float, y: float) -> tuple[int, int]:
        return math.floor((x - self._origin[0]) / self._spacing), math.floor((y - self._origin[1]) / self._spacing)


def _trace(
    grid: AveragedStresses,
    kind: Literal["compression", "tension"],
    seed: Floats,
    sign: float,
    least: float,
    occupied: _Occupied,
) -> Floats:
    """Trace a trajectory from its seed (2,) in one direction; return its points (k, 2)."""
    # The midpoint rule is used.
    step, points, point = 0.5 * grid.spacing, [seed], seed
    ahead = sign * principal(grid.at(seed[None]), kind)[1][0]
    for _ in range(_STEPS):
        middle = point + 0.5 * step * ahead
        size, direction = principal(grid.at(middle[None]), kind)
        along = direction[0] if float(direction[0] @ ahead) >= 0.0 else -direction[0]
        after = point + step * along
        closed = len(points) > 8 and float(np.hypot(*(after - seed))) < step
        if size[0] < least or not grid.holds(after[None])[0] or occupied.near(after, 0.5) or closed:
            break
        points.append(after)
        point, ahead = after, along
    return np.array(points)


DISPLACED: Final = 0.06  # largest displacement that is drawn, over the size of the scene
JUMP: Final = 0.02  # share of the largest velocity above which the jump across an edge is drawn

# Width of a trajectory at the largest stress of its sign, points; it falls to a fifth with the stress
_WIDEST: Final = 2.2
_DASH: Final = (5, 3)  # steps of a tensile trajectory that are drawn, and steps that are left out
_CRUSHED: Final = 0.02  # share of the largest dissipation per area above which a triangle is shaded


def draw_stresses(ax: Axes, assembly: Assembly, labels: Bits, stresses: core_bounds.Stresses | None) -> Drawn:
    """Draw the trajectories of principal stresses of a layout on axes, wider with stress."""
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
        lines = trajectories(grid, kind, APART * quantities.typical(assembly))
        if not lines:
            continue
        largest = max(float(line.stress.max()) for line in lines)
        drawn[kind] = [ax.add_collection(_lines(lines, largest, colour, kind), autolim=False)]
        text = f"{kind} ({'solid' if kind == 'compression' else 'dashed'}), up to {largest:.3g} {unit}"
        handles.append(Line2D([], [], color=colour, linewidth=1.6, linestyle=dash, label=text))
    notes.legend(ax, handles)
    ax.set_title("Stress trajectories at the lower bound", fontsize=10)
    return drawn


def _lines(lines: list[Trajectory], largest: float, colour: str, kind: str) -> LineCollection:
    """Build a line collection of trajectories whose line width grows with the stress."""
    pieces, widths = [], []
    for line in lines:
        share = np.sqrt(line.stress / largest)
        for start in range(0, len(line.points) - 1, 1 if kind == "compression" else sum(_DASH)):
            end = start + (1 if kind == "compression" else _DASH[0])
            piece = line.points[start : end + 1]
            if len(piece) > 1:
                pieces.append(piece)
                widths.append(_WIDEST * max(0.2, float(share[start : end + 1].mean())))
    style: dict[str, Any] = {"colors": colour, "linewidths": widths, "capstyle": "butt"}
    return LineCollection(pieces, label=kind, zorder=3.0, **style)


def draw_cracks(ax: Axes, assembly: Assembly, labels: Bits, velocities: core_bounds.Velocities | None) -> Drawn:
    """Draw the displaced triangles of a velocity field, and where velocity jumps, on axes."""
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


def _blocks(ax: Axes, assembly: Assembly, labels: Bits, velocities: core_bounds.Velocities, moved: Floats) -> Drawn:
    """Draw supports and displaced triangles (t, 3, 2) in the tints of blocks; shade deforming ones."""
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


def strain_power(velocities: core_bounds.Velocities) -> Floats:
    """Return the integral (t,) of the rates of shear and dilation over each triangle, for a live load of power 1."""
    mesh = velocities.mesh
    slope = np.einsum("tki,tkj->tij", velocities.velocity, mesh.gradient)
    shear = np.hypot(slope[:, 0, 0] - slope[:, 1, 1], slope[:, 0, 1] + slope[:, 1, 0])
    return np.asarray((shear + abs(slope[:, 0, 0] + slope[:, 1, 1])) * mesh.volume)


def _jumps(
    labels: Bits, velocities: core_bounds.Velocities, moved: Floats, top: float, faces: int
) -> tuple[Floats, Bools, Floats]:
    """Return displaced sides (k, side, end, coordinate) of dry joints and cracks, a mask of joints, largest jumps."""
    # A support does not move.
    mesh, e = velocities.mesh, velocities.mesh.sides
    face = np.where(e.tag < faces, e.tag, -1)
    rows = np.flatnonzero((e.b >= 0) | (face >= 0))
    both = e.b[rows] >= 0
    of_side = e.a[rows][:, None], e.corner_a[rows]
    other = np.where(both, e.b[rows], e.a[rows])[:, None], np.where(both[:, None], e.corner_b[rows], e.corner_a[rows])
    jump = np.where(both[:, None, None], velocities.velocity[other], 0.0) - velocities.velocity[of_side]
    size = np.hypot(jump[..., 0], jump[..., 1]).max(axis=1)
    there = np.where(both[:, None, None], moved[other], mesh.corners[of_side])
    joint = (face[rows] >= 0) & labels[np.maximum(face[rows], 0)]
    chosen = joint | (size > JUMP * top)
    sides = np.stack([moved[of_side], there], axis=1)[chosen]
    return sides, np.asarray(joint[chosen]), size[chosen]


def _crack_handles(drawn: Drawn, thick: float) -> list[Any]:
    handles: list[Any] = []
    if "joints" in drawn:
        handles.append(Line2D([], [], color=INK, linewidth=thick, label="dry joint (thick: opens or slides)"))
    if "cracks" in drawn:
        handles.append(Line2D([], [], color=LOAD, linewidth=0.6 * thick, label="crack in a block (thin, no joint)"))
    if "deforming" in drawn:
        handles.append(Patch(facecolor=(0.0, 0.0, 0.0, 0.4), label="deforms (darker: faster)"))
    handles.append(Line2D([], [], color=HATCH, linewidth=0.6, label="at rest"))
    return handles


def figure_of_fields(assembly: Assembly, labels: Bits, bounds: core_bounds.FieldBounds) -> Figure:
    """Return a figure of labels, stress trajectories and cracks of one layout under one load."""
    figure, axes = figure_for(assembly, 3)
    draw_assembly(axes[0], assembly, labels)
    draw_stresses(axes[1], assembly, labels, bounds.stresses)
    draw_cracks(axes[2], assembly, labels, bounds.velocities)
    finish(figure, axes, title_of_fields(assembly, bounds))
    return figure


def figure_of_field_layouts(
    layouts: Sequence[tuple[Assembly, Bits, core_bounds.FieldBounds]], titles: Sequence[str]
) -> Figure:
    """Return a figure of layouts side by side, stress trajectories above cracks."""
    count = len(layouts)
    figure, axes = figure_for(layouts[0][0], 2 * count, columns=count)
    for k, ((assembly, labels, bounds), title) in enumerate(zip(layouts, titles, strict=True)):
        draw_stresses(axes[k], assembly, labels, bounds.stresses)
        axes[k].set_title(title, fontsize=10)
        draw_cracks(axes[count + k], assembly, labels, bounds.velocities)
    finish(figure, axes, textwrap.shorten(layouts[0][0].name, 60, placeholder=" …"), columns=count)
    return figure


def title_of_fields(assembly: Assembly, bounds: core_bounds.FieldBounds) -> str:
    """Return the title of a figure of fields: name, bounds on λ and number of triangles."""
    low, high = (f"{end:.4g}" if math.isfinite(end) else "none" for end in (bounds.lower, bounds.upper))
    name = textwrap.shorten(assembly.name, 90, placeholder=" …")
    value = "no λ ≥ 0 is admissible" if bounds.upper < 0.0 else f"λ of the blocks in [{low}, {high}]"
    return f"{name}\n{value}  ·  {bounds.simplices} triangles"
