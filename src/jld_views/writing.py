"""Text in figures: ids of elements, values of loads and of forces."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from jld_core import Assembly, Floats, LimitAnalysisResult, files
from jld_core.limit import mechanism
from jld_views import quantities
from jld_views.look import INK, LOAD, PRESS, SOFT, WHITE
from jld_views.structure import element_points, extent, painter_order, projection_of, visible_faces

_HALO: Final = [withStroke(linewidth=1.8, foreground=WHITE)]  # white outline of texts

# Least distance of a number from the edge of its planar block, relative to the radius of the largest circle in it
_DEEP: Final = 0.7

# Radius of the largest circle on the part of a block that is seen, relative to the assembly, for its number
_LEAST_SEEN: Final = 0.008


@contextmanager
def as_written(figure: Figure) -> Iterator[None]:
    """Make figures drawn inside this context show all text literally."""
    # Dollar signs do not begin formulas, unprintable characters become blanks, and missing glyphs cause no warning.
    artists: list[Artist] = [figure]
    while artists:
        artist = artists.pop()
        if isinstance(artist, Text):
            artist.set_parse_math(False)
            artist.set_text(files.printable(artist.get_text()))
        # an axis makes its ticks when they are asked for, if it is seen or not; its numbers stay
        artists += [artist.label, artist.offsetText] if isinstance(artist, Axis) else artist.get_children()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from", category=UserWarning)
        yield


def write_ids(ax: Axes, assembly: Assembly) -> list[Artist]:
    """Write the id of each element at its centroid on axes; return the texts."""
    size = float(np.clip(0.16 * element_points(ax, assembly), 3.0, 8.0))
    points = projection_of(assembly)(assembly.elements.centroid)
    look: dict[str, Any] = {"ha": "center", "va": "center", "color": SOFT, "fontsize": size}
    return [_text(ax, point, name, **look) for point, name in zip(points, assembly.elements.ids, strict=True)]


def write_loads(ax: Axes, assembly: Assembly) -> list[Artist]:
    """Write the value and unit of each live load at its arrow on axes; return the texts."""
    projection, unit = projection_of(assembly), assembly.units[1]
    length = 0.13 * assembly.size
    written: list[Artist] = []
    loads = assembly.live_loads.arrows()
    vectors = [force for _, _, force in loads]
    most = max((float(np.linalg.norm(projection(v))) for v in vectors), default=1.0)
    for (_, at, _), vector in zip(loads, vectors, strict=True):
        tail = projection(at) - projection(vector) * length / max(most, 1e-300)
        written.append(_text(ax, tail, f" {np.linalg.norm(vector):.3g} {unit} × λ", va="bottom", color=LOAD))
    total = quantities.body_load(assembly)
    if total is not None:
        lower, upper = extent(assembly, projection)
        along = projection(total) / max(float(np.linalg.norm(projection(total))), 1e-300)
        with np.errstate(divide="ignore"):
            leave = float(np.min(0.5 * (upper - lower) / abs(along)))
        middle = 0.5 * (lower + upper) - along * (leave + 0.04 * assembly.size + 0.5 * length)
        above = np.array([0.0, 0.03 * assembly.size])
        value = f"{np.linalg.norm(total):.3g} {unit} × λ"
        written.append(_text(ax, middle + above, value, va="bottom", ha="center", color=LOAD))
    for k in quantities.live_couples(assembly):
        moment = float(np.linalg.norm(assembly.live[k, assembly.dimension :]))
        point = projection(assembly.elements.centroid[k])
        written.append(_text(ax, point, f"  {moment:.3g} {unit}·{assembly.units[0]} × λ", va="bottom", color=LOAD))
    return written


def write_numbers(
    ax: Axes, assembly: Assembly, blocks: Sequence[Sequence[int]], centroids: Sequence[Any], size: float = 7.0
) -> list[Text]:
    """Write the number of each block, from 1, into a drawing."""
    # Return the texts. In space it stands on the largest visible part, if that is large enough.
    if assembly.dimension == 2:
        points = [_inside(assembly, block, np.asarray(at)) for block, at in zip(blocks, centroids, strict=True)]
        projected: list[Any] = [projection_of(assembly)(point[None])[0] for point in points]
    else:
        projected = _seen_places(assembly, blocks)
    look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": size}
    return [_text(ax, point, str(n), **look) for n, point in enumerate(projected, 1) if point is not None]


def _inside(assembly: Assembly, block: Sequence[int], centroid: Floats) -> Floats:
    """Return the place (2,) of the number of a planar block: its centroid, or the centre of its largest circle."""
    elements = assembly.elements
    outlines = [shapely.Polygon(elements.shape[k]) for k in block if not elements.support[k]]
    if not outlines:
        return centroid
    # elements overlap by a hair, so that no seam is left between them
    largest = max(
        shapely.get_parts(shapely.union_all(shapely.buffer(outlines, 1e-6 * assembly.size))), key=shapely.area
    )
    circle = shapely.maximum_inscribed_circle(largest, tolerance=0.02 * float(np.sqrt(largest.area)))
    point = shapely.Point(centroid)
    deep = largest.covers(point) and largest.boundary.distance(point) >= _DEEP * shapely.length(circle)
    return centroid if deep else shapely.get_coordinates(circle)[0]


def _seen_places(assembly: Assembly, blocks: Sequence[Sequence[int]]) -> list[Floats | None]:
    """Return the middle (2,) of the largest visible part of each block; None if too small."""
    projection, elements = projection_of(assembly), assembly.elements
    free = ~elements.support
    owner = {element: number for number, block in enumerate(blocks) for element in block if free[element]}
    parts: list[list[shapely.Geometry]] = [[] for _ in blocks]
    hidden = shapely.Polygon()
    for element in reversed(painter_order(assembly, projection.toward)):
        shape = elements.shape[element]
        faces = visible_faces(shape, elements.faces[element], projection.toward)
        outlines = [shapely.make_valid(shapely.Polygon(projection(shape[list(face)]))) for face in faces]
        if element in owner:
            parts[owner[element]] += [outline.difference(hidden) for outline in outlines]
        hidden = shapely.union_all([hidden, *outlines])
    points: list[Floats | None] = []
    for visible in parts:
        pieces = [
            polygon
            for part in visible
            for polygon in shapely.get_parts(part)
            if polygon.geom_type == "Polygon" and polygon.area
        ]
        radii = [shapely.maximum_inscribed_circle(piece, tolerance=0.02 * np.sqrt(piece.area)) for piece in pieces]
        best = max(radii, key=shapely.length, default=None)
        wide = best is not None and shapely.length(best) > _LEAST_SEEN * assembly.size
        points.append(shapely.get_coordinates(best)[0] if wide else None)
    return points


def write_forces(ax: Axes, result: LimitAnalysisResult) -> list[Artist]:
    """Write the magnitude of each face's force beside its arrow on axes; return the texts."""
    # Forces below the share `SMALL` of the largest are left out. The list is empty for a result without forces.
    result = mechanism.result_of_faces(result)
    assembly, forces = result.assembly, result.forces
    if forces is None:
        return []
    size = np.linalg.norm(quantities.face_vectors(assembly, forces), axis=1)
    positions = projection_of(assembly)(quantities.pressure_points(assembly, forces)[0])
    visible = size > quantities.SMALL * size.max(initial=0.0)
    points = float(np.clip(0.13 * element_points(ax, assembly), 3.0, 7.0))
    return [
        _text(ax, point, f" {value:.3g}", va="bottom", color=PRESS, fontsize=points)
        for point, value in zip(positions[visible], size[visible], strict=True)
    ]


def _text(ax: Axes, point: Any, text: str, **look: Any) -> Text:
    """Add a text with a halo, without parsing formulas."""
    style: dict[str, Any] = {"fontsize": 7.5, "color": INK, "zorder": 6.0, "path_effects": _HALO, **look}
    # parse_math=False, since a single dollar sign in a name would begin a formula
    return ax.text(float(point[0]), float(point[1]), text, parse_math=False, **style)
