"""Drawing of elements and interfaces: planar outlines, or an axonometric view, at rest or displaced."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from shapely.geometry import Polygon

from jld_core import Assembly, Bits, Bools, Floats, Ints, blocks_of
from jld_core import assembly as core_assembly
from jld_core.geometry import area_vector
from jld_views.look import EYE, HATCH, INK, INNER_DASH, SOFT, SUPPORT
from jld_views.quantities import typical

Drawn = dict[str, list[Artist]]
Move = Callable[[int, Floats], Floats]  # displacement for drawing: (element index, points (k, d)) → points (k, d)
DOTTED: Final = (0, INNER_DASH)  # dash pattern of inner faces for matplotlib


@dataclass(frozen=True)
class Projection:
    """Linear projection of the scene onto the paper; call it with points or vectors."""

    across: Floats  # (d, 2) its columns are the directions right and up on the paper
    toward: Floats  # (d,) unit vector to the viewer; zero in the plane

    def __call__(self, points: Floats) -> Floats:
        """Project points or vectors (k, d) to (k, 2), in the scene's unit of length."""
        return np.asarray(points @ self.across)


@dataclass(frozen=True)
class LineStyle:
    colours: list[Any]  # one matplotlib colour per interface
    widths: Floats  # (m,) points
    tick: float = 0.0  # half length of ticks on dry faces, scene units, 0 for none


def projection_of(assembly: Assembly) -> Projection:
    """Return the projection of an assembly: itself in the plane, an axonometric view in space."""
    if assembly.dimension == 2:
        return Projection(np.eye(2), np.zeros(2))
    azimuth, elevation = np.radians(EYE)
    toward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return Projection(np.column_stack([right, np.cross(toward, right)]), toward)


def extent(assembly: Assembly, projection: Projection, move: Move | None = None) -> tuple[Floats, Floats]:
    """Return the lower and upper corner (2,) of the structure on paper, perhaps displaced, scene units."""
    shapes = [shape if move is None else move(k, shape) for k, shape in enumerate(assembly.elements.shape)]
    points = projection(np.vstack([*shapes, *assembly.fill]))
    return points.min(axis=0), points.max(axis=0)


def element_points(ax: Axes, assembly: Assembly) -> float:
    """Return the size that a typical element has on axes before they are laid out, points."""
    lower, upper = extent(assembly, projection_of(assembly))
    figure = ax.get_figure(root=True)
    dots = float(figure.dpi) if figure is not None else 100.0
    width, height = upper - lower
    scale = min(ax.bbox.width / max(width, 1e-300), ax.bbox.height / max(height, 1e-300))
    return float(72.0 / dots * scale * typical(assembly))


def default_ink(ax: Axes, assembly: Assembly, labels: Bits) -> LineStyle:
    """Return the usual style of faces: dry ones thick and dark, inner ones thin and grey, wider on larger elements."""
    points = element_points(ax, assembly)
    thick, thin = float(np.clip(0.07 * points, 0.5, 2.4)), float(np.clip(0.04 * points, 0.3, 0.9))
    tick = (1.3 * thick + 1.0) / points * typical(assembly) if points > 14.0 else 0.0
    return LineStyle([INK if dry else SOFT for dry in labels], np.where(labels, thick, thin), tick)


def paint(
    ax: Axes, assembly: Assembly, labels: Bits, fills: list[str], ink: LineStyle | None = None, move: Move | None = None
) -> Drawn:
    """Draw the elements and interfaces of a structure, without those of members, at rest or displaced."""
    assembly, labels = core_assembly.faces_of(assembly), labels[: assembly.faces]
    ink = default_ink(ax, assembly, labels) if ink is None else ink
    return (_paint_planar if assembly.dimension == 2 else _paint_spatial)(ax, assembly, labels, fills, ink, move)


def _paint_planar(
    ax: Axes, assembly: Assembly, labels: Bits, fills: list[str], ink: LineStyle, move: Move | None
) -> Drawn:
    move_points = move or (lambda _, points: points)
    shapes = [move_points(k, shape) for k, shape in enumerate(assembly.elements.shape)]
    support = assembly.elements.support
    drawn: Drawn = {}
    kinds: list[tuple[str, Ints, dict[str, Any]]] = [
        ("elements", np.flatnonzero(~support), {"linewidths": 0.0}),
        ("supports", np.flatnonzero(support), {"linewidths": 0.4, "hatch": "////", "edgecolors": HATCH}),
    ]
    for name, members, style in kinds:
        polygons = PolyCollection(
            [shapes[k] for k in members],
            facecolors=[SUPPORT if support[k] else fills[k] for k in members],
            label=name,
            zorder=1.0,
            **style,
        )
        drawn[name] = [ax.add_collection(polygons, autolim=False)]
    thin = float(np.clip(ink.widths.min(initial=0.6), 0.3, 0.7))
    outlines = _outlines(assembly, shapes, blocks_of(assembly, labels))
    drawn["outlines"] = [_lines(ax, outlines, "outlines", [SOFT] * len(outlines), thin, "solid", 2.0)]
    faces = assembly.interfaces
    sides = [faces.b] if move is None else [faces.a, faces.b]
    for name, mask, dash, zorder in (("inner", ~labels, DOTTED, 2.1), ("dry", labels, "solid", 2.2)):
        chosen = np.flatnonzero(mask)
        segments = [move_points(int(side[k]), faces.polygon[k]) for side in sides for k in chosen]
        colours = [ink.colours[k] for _ in sides for k in chosen]
        widths = np.concatenate([ink.widths[chosen] for _ in sides])
        drawn[name] = [_lines(ax, segments, name, colours, widths, dash, zorder)]
    if ink.tick > 0.0 and move is None:
        chosen = np.flatnonzero(labels)
        feet, arm = faces.origin[chosen], ink.tick * faces.normal[chosen]
        ticks = list(np.stack([feet - arm, feet + arm], axis=1))
        width = 0.5 * float(ink.widths.max(initial=1.0))
        drawn["ticks"] = [_lines(ax, ticks, "ticks", [INK] * len(ticks), width, "solid", 2.2)]
    return drawn


def _lines(
    ax: Axes, segments: list[Floats], name: str, colours: list[Any], widths: float | Floats, dash: Any, zorder: float
) -> LineCollection:
    style: dict[str, Any] = {"colors": colours, "linewidths": widths, "linestyles": [dash]}
    lines = LineCollection(segments, label=name, zorder=zorder, capstyle="butt", **style)
    ax.add_collection(lines, autolim=False)
    return lines


def _outlines(assembly: Assembly, shapes: list[Floats], blocks: Ints) -> list[Floats]:
    """Return the boundaries of the free part of each block; blocks: (n,) of elements."""
    # Lines between touching elements of a block are left out; open cracks are drawn.
    seam = 2e-3 * typical(assembly)
    lines: list[Floats] = []
    free = assembly.elements.free
    for block in np.unique(blocks[free]):
        parts = [Polygon(shapes[k]) for k in free if blocks[k] == block]
        if len(parts) == 1:
            union: Any = parts[0]
        else:
            grown = shapely.union_all(shapely.buffer(parts, seam, join_style="mitre"))
            union = shapely.buffer(grown, -seam, join_style="mitre")
        for polygon in shapely.get_parts(union):
            lines += [np.asarray(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    return lines


def painter_order(assembly: Assembly, toward: Floats) -> list[int]:
    """Return the elements from the farthest to the nearest to the viewer; toward: (3,) unit vector to the viewer."""
    # Of two elements in contact, the one on the viewer's side of the contact plane is nearer. Depth of the centroids
    # decides for other pairs and in cycles.
    faces, count = assembly.interfaces, len(assembly.elements)
    depth = assembly.elements.centroid @ toward
    behind: list[set[int]] = [set() for _ in range(count)]
    nearer: list[set[int]] = [set() for _ in range(count)]
    for a, b, tilt in zip(faces.a.tolist(), faces.b.tolist(), (faces.normal @ toward).tolist(), strict=True):
        far, near = (a, b) if tilt > 0.0 else (b, a)
        if abs(tilt) > 1e-9 and near not in behind[far]:
            behind[near].add(far)
            nearer[far].add(near)
    ready = [(float(depth[k]), k) for k in range(count) if not behind[k]]
    heapq.heapify(ready)
    order: list[int] = []
    is_drawn = np.zeros(count, dtype=bool)
    while len(order) < count:
        if ready:
            element = heapq.heappop(ready)[1]
        else:
            element = int(min(np.flatnonzero(~is_drawn), key=lambda k: depth[k]))
        if is_drawn[element]:
            continue
        is_drawn[element] = True
        order.append(element)
        for k in nearer[element]:
            behind[k].discard(element)
            if not behind[k] and not is_drawn[k]:
                heapq.heappush(ready, (float(depth[k]), k))
    return order


def _paint_spatial(
    ax: Axes, assembly: Assembly, labels: Bits, fills: list[str], ink: LineStyle, move: Move | None
) -> Drawn:
    projection, faces, elements = projection_of(assembly), assembly.interfaces, assembly.elements
    moved_to = move or (lambda _, points: points)
    order = painter_order(assembly, projection.toward)
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    # Draw a face right after the nearer of its elements, so that only elements in front of both hide it.
    drawn_after: list[list[int]] = [[] for _ in order]
    for k in range(len(faces)):
        drawn_after[max(int(position[faces.a[k]]), int(position[faces.b[k]]))].append(k)
    drawn: Drawn = {"elements": [], "supports": []}
    thin = float(np.clip(0.6 * ink.widths.min(initial=0.8), 0.25, 0.6))
    # what is drawn as one collection: points, colour of the face, colour, width and style of the line
    run: list[tuple[Floats, Any, Any, float, Any]] = []
    for step, element in enumerate(order):
        grey = bool(elements.support[element])
        shape = moved_to(element, elements.shape[element])
        for corners in visible_faces(shape, elements.faces[element], projection.toward):
            shade = _shade(SUPPORT if grey else fills[element], shape[list(corners)])
            run.append((_close_ring(projection(shape[list(corners)])), shade, SOFT, thin, "solid"))
        for k in drawn_after[step]:
            sides = {int(faces.b[k])} if move is None else {int(faces.a[k]), int(faces.b[k])}
            dash = "solid" if labels[k] else DOTTED
            for side in sorted(sides):
                contact = faces.polygon[k]
                moved = projection(moved_to(side, contact))
                for i, in_front in enumerate(_front_edges(contact, faces.normal[k], projection.toward)):
                    width = float(ink.widths[k]) * (1.0 if in_front else 0.3)
                    edge = moved[[i, (i + 1) % len(contact)]]
                    run.append((edge, "none", ink.colours[k] if in_front else (0.4, 0.4, 0.4, 0.5), width, dash))
        last = step + 1 == len(order)
        if last or bool(elements.support[order[step + 1]]) != grey:
            polygons, shades, colours, widths, dashes = (list(part) for part in zip(*run, strict=True))
            style: dict[str, Any] = {
                "facecolors": shades, "edgecolors": colours, "linewidths": widths, "linestyles": dashes,
            }  # fmt: skip
            if grey:
                style["hatch"] = "////"
            name = "supports" if grey else "elements"
            zorder = 1.0 + step / len(order)
            collection = PolyCollection(polygons, closed=False, label=name, zorder=zorder, joinstyle="round", **style)
            ax.add_collection(collection, autolim=False)
            drawn[name].append(collection)
            run = []
    return drawn


def visible_faces(shape: Floats, faces: tuple[tuple[int, ...], ...], toward: Floats) -> list[tuple[int, ...]]:
    """Return the faces of vertices (k, 3) that point to the viewer, the farthest first."""
    visible = [face for face in faces if float(area_vector(shape[list(face)]) @ toward) > 0.0]
    return sorted(visible, key=lambda face: float(shape[list(face)].mean(axis=0) @ toward))


def _close_ring(points: Floats) -> Floats:
    """Return a ring (k, 2) with its first point repeated at the end."""
    return np.vstack([points, points[:1]])


def _shade(colour: str, corners: Floats) -> tuple[float, float, float, float]:
    """Darken a tint on a face (k, 3) that points sideways, for light from above and the right.

    Return RGB and opacity.
    """
    from matplotlib.colors import to_rgb

    normal = area_vector(corners)
    light = float(normal @ np.array([0.35, -0.15, 0.92])) / max(float(np.linalg.norm(normal)), 1e-300)
    red, green, blue = (channel * (0.86 + 0.14 * light) for channel in to_rgb(colour))
    return red, green, blue, 0.88


def _front_edges(corners: Floats, normal: Floats, toward: Floats) -> Bools:
    """Return a mask (k,) of the edges of a contact polygon (k, 3) on the viewer's side of its middle."""
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.cross(along, normal)
    sense = float(area_vector(corners) @ normal)
    return np.asarray(outward @ toward * np.sign(sense) > 0.0)
