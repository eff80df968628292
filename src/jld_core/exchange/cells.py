"""Cells of a planar drawing: from outlines, lines across and between them, and openings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import log
from typing import Final

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn_loads import MOST, Cell
from jld_core.exchange.options import ImportOptions, Notes, several
from jld_core.exchange.paths import Path
from jld_core.geometry import Faces, area_vector
from jld_core.geometry import outlines as polygons
from jld_core.geometry.snapping import Snapped
from jld_core.geometry.unions import triangulate_region
from jld_core.geometry.vectors import across
from jld_core.scene.units import METRES

_CHUNK, _CROSSINGS = 64, 5
"""Number of lines per batch in counting crossings, and largest number of crossings in units of `MOST`."""

# Share of a cell's boundary on lines of its own above which it is an element beside closed outlines
_DRAWN: Final = 0.5

_LARGE: Final = 6.0  # area of a cell, relative to the median, above which the report asks whether it is an opening

_FEW: Final = 4  # least number of free cells whose median says what is large


def find_cells(
    paths: list[Path], snapped: Snapped, options: ImportOptions, size: float, tolerance: float, notes: Notes
) -> list[Cell]:
    """Find the cells of a drawing that become elements; cells in openings are left out.

    Raises InputError where nothing is enclosed, or there are too many cells.
    """
    # Cells are closed outlines, cut by lines that cross them, and areas that lines enclose beside them. Without
    # outlines of free elements they are the cells of the network of lines.
    kept = [k for k in range(len(paths)) if k not in snapped.collapsed]
    role = [options.role(path.layer) for path in paths]
    outlines = [k for k in kept if paths[k].closed and role[k] != "hole"]
    lines = [k for k in kept if not paths[k].closed and role[k] != "hole"]
    rings = [_line(paths[k], snapped.paths[k]) for k in kept if role[k] == "hole"]
    empty = _openings(rings, notes)
    notes.skip("holes", sum(len(paths[k].holes) for k in outlines), "an element has none; what lies in them is empty")
    segments = [shapely.LineString(snapped.paths[k]) for k in lines]
    if all(role[k] == "support" for k in outlines) and not segments + rings:
        raise InputError("", "all it holds are supports", "at least one outline, or a network of lines, that is free")
    _refuse_crossings(segments + rings)
    used = _one_outline_each(outlines, paths, snapped, notes)
    if all(role[k] == "support" for k in outlines):
        layers = [*(paths[k].layer for k in lines), *[""] * len(rings)]
        cells = _network(segments + rings, layers, options, size, notes)
        cells += [Cell(snapped.paths[k], paths[k].layer, paths[k].name) for k in used]
    else:
        cells = _outlined(used, paths, snapped, segments + rings, options, size, notes)
        own = [(s, paths[k].layer) for s, k in zip(segments, lines, strict=True) if role[k] in (None, "support")]
        cells += _beside(cells, own, options, size, notes)
    shapes = [shapely.Polygon(cell.points).representative_point() for cell in cells]
    cells = [cell for cell, point in zip(cells, shapes, strict=True) if not empty.contains(point)]
    if not cells:
        raise InputError("", "its lines enclose nothing", "lines that meet within `tolerance` around every cell")
    if len(cells) > MOST:
        raise InputError("", f"it makes {len(cells)} cells", f"at most {MOST}")
    _count_unused(segments, [paths[k].layer for k in lines], cells, max(2.0 * tolerance, 1e-7 * size), notes)
    return cells


def say_large(cells: list[Cell], notes: Notes) -> None:
    """Note the free cells that are far larger than the others, which may be openings."""
    free = [cell for cell in cells if not cell.support]
    areas = np.array([shapely.Polygon(cell.points).area for cell in free])
    if len(free) < _FEW:
        return
    usual = float(np.median(areas))
    for cell, area in zip(free, areas.tolist(), strict=True):
        if area > _LARGE * usual:
            what = f"element {cell.name!r} has {area / usual:.3g} times the area of the median element"
            notes.doubtful.append(f"{what}: if it is an opening, draw its outline on a layer of --hole")


def _line(path: Path, points: Floats) -> shapely.LineString:
    """Return a path after snapping as a line, closed where the path is."""
    return shapely.LineString(np.concatenate([points, points[:1]]) if path.closed else points)


def _openings(rings: list[shapely.LineString], notes: Notes) -> shapely.Geometry:
    """Return the area that the lines of openings enclose, outlines or single lines."""
    if not rings:
        return shapely.Polygon()
    found = shapely.polygonize([shapely.union_all(rings)])
    if len(found.geoms):
        notes.found.append(several(len(found.geoms), "opening"))
    return shapely.union_all(found)


def _outlined(
    used: list[int],
    paths: list[Path],
    snapped: Snapped,
    segments: list[shapely.LineString],
    options: ImportOptions,
    size: float,
    notes: Notes,
) -> list[Cell]:
    """Return the cells of closed outlines, cut by the lines that cross them."""
    # Supports are not cut. An outline around others loses their areas.
    cells: list[Cell] = []
    cut = pieces_in_all = 0
    tree = shapely.STRtree(segments) if segments else None
    shapes = {k: shapely.Polygon(snapped.paths[k]) for k in used}
    inside = _inside(shapes)
    for k, shape in shapes.items():
        if k in inside:
            held = shapely.difference(shape, shapely.union_all([shapes[j] for j in inside[k]]))
            near = [] if tree is None else [segments[i] for i in sorted(tree.query(shape).tolist())]
            parts = [part for part in shapely.get_parts(held) if part.geom_type == "Polygon"]
            found = [_cut(part, near, paths[k].layer, size) or _pieces(part, paths[k].layer) for part in parts]
            cells += [cell for pieces in found for cell in pieces]
            notes.found.append(f"an outline around {several(len(inside[k]), 'outline')}, without their areas")
            continue
        uncut = tree is None or options.role(paths[k].layer) == "support"
        near = [] if uncut or tree is None else [segments[i] for i in sorted(tree.query(shape).tolist())]
        pieces = _cut(shape, near, paths[k].layer, size) if shape.is_valid else []
        if len(pieces) > 1:
            cells += pieces
            cut, pieces_in_all = cut + 1, pieces_in_all + len(pieces)
        else:
            cells.append(Cell(snapped.paths[k], paths[k].layer, paths[k].name))
    if cut:
        notes.found.append(f"{several(cut, 'outline')} cut into {pieces_in_all} cells by the lines that cross them")
    return cells


def _inside(shapes: dict[int, shapely.Polygon]) -> dict[int, list[int]]:
    """Map each outline that covers others to the outlines inside it, by their keys."""
    # The map is empty if any outline crosses itself.
    found: dict[int, list[int]] = {}
    keys, polygons = list(shapes), list(shapes.values())
    if not all(polygon.is_valid for polygon in polygons):
        return {}
    inner, outer = shapely.STRtree(polygons).query(polygons, predicate="covered_by")
    for one, other in zip(inner.tolist(), outer.tolist(), strict=True):
        if one != other:
            found.setdefault(keys[other], []).append(keys[one])
    return found


def _beside(
    cells: list[Cell], own: list[tuple[shapely.LineString, str]], options: ImportOptions, size: float, notes: Notes
) -> list[Cell]:
    """Return the cells that lines enclose beside closed outlines, with the layer of each."""
    shapes = [shape for shape in (shapely.Polygon(cell.points) for cell in cells) if shape.is_valid]
    if not own or not shapes:
        return []
    covered = shapely.union_all(shapes)
    inside = covered.buffer(-1e-7 * size)
    loose = [pair for pair in own if not pair[0].intersects(inside)]
    if not loose:
        return []
    drawn = shapely.union_all([line for line, _ in loose])
    supports = [line for line, layer in loose if options.role(layer) == "support"]
    ground = shapely.union_all(supports) if supports else None
    near = 1e-7 * size
    faces: list[tuple[shapely.Polygon, str]] = []
    for face in shapely.polygonize([shapely.union_all([drawn, covered.boundary])]).geoms:
        if face.area <= 1e-12 * size**2 or covered.contains(face.representative_point()):
            continue
        outer = face.exterior
        if outer.intersection(drawn.buffer(near)).length <= _DRAWN * outer.length:
            continue
        onto = 0.0 if ground is None else outer.intersection(ground.buffer(near)).length / outer.length
        layer = next(la for _, la in loose if options.role(la) == "support") if onto > _DRAWN else ""
        faces.append((face, layer))
    found = [cell for face, layer in _reached(faces, covered) for cell in _pieces(face, layer)]
    if found:
        notes.found.append(f"{several(len(found), 'cell')} that lines enclose beside the outlines")
    return found


def _reached(faces: list[tuple[shapely.Polygon, str]], covered: shapely.Geometry) -> list[tuple[shapely.Polygon, str]]:
    """Drop the faces that are not connected to an area, directly or through other faces."""
    shapes = [face for face, _ in faces]
    reached = set(np.flatnonzero(shapely.intersects(shapes, covered)).tolist()) if shapes else set()
    tree, pending = shapely.STRtree(shapes), list(reached)
    while pending:
        fresh = set(tree.query(shapes[pending.pop()], predicate="intersects").tolist()) - reached
        reached |= fresh
        pending += fresh
    return [faces[k] for k in sorted(reached)]


def _count_unused(
    segments: list[shapely.LineString], layers: list[str], cells: list[Cell], reach: float, notes: Notes
) -> None:
    """Note by layer how many lines bound no cell, and so have no effect."""
    edges = [shapely.LinearRing(cell.points) for cell in cells]
    tree = shapely.STRtree(edges)
    unused: Counter[str] = Counter()
    for line, layer in zip(segments, layers, strict=True):
        strip = line.buffer(reach)
        near = [edges[k] for k in tree.query(strip).tolist()]
        along = shapely.length(shapely.intersection(near, strip)) if near else np.zeros(0)
        # a line that only crosses a boundary has a few times its half width in common with it
        if not (along > min(10.0 * reach, 0.5 * line.length)).any():
            unused[layer] += 1
    for layer, count in sorted(unused.items()):
        what = f"line{'s' * (count != 1)} on layer {layer or '(none)'}"
        notes.skip(what, count, "they bound and divide no cell")


def _refuse_crossings(segments: list[shapely.LineString]) -> None:
    """Raise InputError for too many crossings, before these are computed.

    A few thousand lines may have millions of crossings.
    """
    if len(segments) ** 2 <= MOST:
        return
    tree, total = shapely.STRtree(segments), 0
    for begin in range(0, len(segments), _CHUNK):
        total += tree.query(np.array(segments[begin : begin + _CHUNK]), predicate="intersects").shape[1]
        if total > _CROSSINGS * MOST:
            raise InputError("", "its lines have too many crossings", "a network of cells")


def _one_outline_each(outlines: list[int], paths: list[Path], snapped: Snapped, notes: Notes) -> list[int]:
    """Return the indices of outlines without those drawn twice; the first of equal ones stays."""
    seen: dict[bytes, int] = {}
    kept = []
    for k in outlines:
        corners = snapped.paths[k]
        key = np.sort(corners.view([("x", corners.dtype), ("y", corners.dtype)]).ravel(), order=("x", "y")).tobytes()
        if key in seen:
            continue
        seen[key] = k
        kept.append(k)
    notes.skip("outlines", len(outlines) - len(kept), "drawn twice")
    return kept


def _network(
    segments: list[shapely.LineString], layers: list[str], options: ImportOptions, size: float, notes: Notes
) -> list[Cell]:
    """Return the cells enclosed by a network of lines, from below to above."""
    # A cell is a support where more than half of its boundary lies on support lines.
    noded = shapely.node(shapely.MultiLineString(segments))
    cells, _, _, invalid = shapely.polygonize_full([noded])
    notes.skip("rings", len(invalid.geoms), "they cross themselves")
    found = []
    supports = [s for s, layer in zip(segments, layers, strict=True) if options.role(layer) == "support"]
    ground = shapely.union_all(supports) if supports else None
    for cell in cells.geoms:
        if cell.area <= 1e-12 * size**2:
            continue
        drawn = 0.0 if ground is None else cell.exterior.intersection(ground).length / cell.exterior.length
        layer = next(la for la in layers if options.role(la) == "support") if drawn > 0.5 else ""
        found += _pieces(cell, layer)
    found.sort(key=lambda cell: _height(cell, size))
    notes.found.append(f"a network of {several(len(segments), 'line')} around {several(len(found), 'cell')}")
    return found


def _pieces(face: shapely.Polygon, layer: str) -> list[Cell]:
    """Convert a polygon to cells without holes, joined as one block."""
    parts = _without_holes(face)
    cells = [Cell(shapely.get_coordinates(part.exterior)[:-1], layer, None) for part in parts]
    for cell in cells[1:]:
        cells[0].joined, cell.joined = cells[0], cells[0]
    return cells


def _cut(shape: shapely.Polygon, lines: list[shapely.LineString], layer: str, size: float) -> list[Cell]:
    """Cut an outline by lines; return its cells, lowest first, or none if no line crosses."""
    inside = [shapely.intersection(shape, line) for line in lines]
    kept = [part for part in inside if part.length > 1e-9 * size]
    if not kept:
        return []
    noded = shapely.union_all([shape.boundary, *kept])
    pieces = [piece for piece in shapely.polygonize([noded]).geoms if piece.area > 1e-12 * size**2]
    cells = [cell for piece in pieces if shape.covers(piece.representative_point()) for cell in _pieces(piece, layer)]
    return sorted(cells, key=lambda cell: _height(cell, size))


def _height(cell: Cell, size: float) -> tuple[float, ...]:
    """Return the sort key (height, x) of a cell: the mean of its corners over `size`."""
    return tuple(np.round(cell.points.mean(axis=0)[::-1] / size, 9).tolist())


def _without_holes(cell: shapely.Polygon) -> list[shapely.Polygon]:
    """Cut a polygon through its holes into polygons without holes.

    An element has one outline.
    """
    if not cell.interiors:
        return [cell]
    x0, y0, x1, y1 = cell.bounds
    middle = shapely.Polygon(cell.interiors[0]).centroid.x
    halves = [cell.intersection(shapely.box(a, y0, b, y1)) for a, b in ((x0, middle), (middle, x1))]
    parts = [part for half in halves for part in shapely.get_parts(half) if part.geom_type == "Polygon"]
    return [piece for part in parts for piece in _without_holes(part)]


def without_holes(points: Floats, loops: Sequence[Sequence[int]], title: str) -> Faces:
    """Return a plane face as loops of corners without holes, in the sense of its outline.

    points: (k, 3). Raises InputError where a hole reaches beyond the outline, or they lie in no common plane.
    """
    if len(loops) == 1:
        return (tuple(loops[0]),)
    areas = [area_vector(points[list(loop)]) for loop in loops]
    order = sorted(range(len(loops)), key=lambda k: -float(np.linalg.norm(areas[k])))
    outline, *holes = [loops[k] for k in order]
    length = float(np.linalg.norm(areas[order[0]]))
    corners = points[[index for loop in loops for index in loop]]
    size = float(np.ptp(corners, axis=0).max())
    normal = areas[order[0]] / length if length > 0.0 else np.zeros(3)
    if length == 0.0 or np.ptp(corners @ normal) > tolerances.FACE * size:
        raise InputError(title, "a face with a hole is no plane", "plane faces")
    flat = points @ across(normal).T
    region = shapely.Polygon(flat[list(outline)], [flat[list(hole)] for hole in holes])
    triangles = triangulate_region(flat, [outline, *holes]) if region.is_valid else []
    covered = sum(float(np.linalg.norm(area_vector(points[list(triangle)]))) for triangle in triangles)
    if not triangles or abs(covered - region.area) > 1e-9 * length:
        raise InputError(title, "a hole of a face crosses its outline or another hole", "holes inside, apart")
    return tuple(triangles)


# Least and largest extent of a structure that passes without a word, m: models on a table to long bridges
_WHOLE: Final = (0.05, 300.0)

_BLOCK: Final = 3.0  # largest usual block, m, in a structure larger than `_LONG`

_LONG: Final = 20.0  # extent of a structure, m, up to which blocks may be outlines that are still to be cut

_USUAL: Final = (3.0, 0.35)  # usual extent of a structure and of a block, m, by which the likely unit is chosen

_COMMON: Final = ("mm", "cm", "m", "in", "ft")  # units that are proposed


def hardly_meant(size: float) -> bool:
    """Return True if a largest extent, m, is that of no structure."""
    return not _WHOLE[0] <= size <= _WHOLE[1]


def say_size(size: float, outlines: Sequence[Floats], unit: str, drawn_in: str, notes: Notes) -> None:
    """Note a size of a structure or of its blocks that can hardly be meant, and a likely unit.

    outlines: (k, 2) corners of each free element.
    """
    if unit != "m" or not outlines:
        return
    block = float(np.median([abs(polygons.area(outline[None])[0]) ** 0.5 for outline in outlines]))
    if not hardly_meant(size) and (block <= _BLOCK or size <= _LONG):
        return
    per_unit = 1.0 / METRES[drawn_in]

    def strangeness(name: str) -> float:
        """Return the sum of |log(size / usual size)| of structure and block, in unit `name`."""
        factor = METRES[name] * per_unit
        return abs(log(size * factor / _USUAL[0])) + abs(log(block * factor / _USUAL[1]))

    likely = min(_COMMON, key=strangeness)
    factor = METRES[likely] * per_unit
    what = f"the structure is {size:.3g} m large, its median element {block:.3g} m, with lengths in {drawn_in}"
    if likely == drawn_in:
        notes.doubtful.append(what)
        return
    notes.doubtful.append(
        f"{what}: in {likely} it is {size * factor:.3g} m and {block * factor:.3g} m, --unit {likely}"
    )
