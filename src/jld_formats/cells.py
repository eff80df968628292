"""Cells of a planar drawing: from outlines, lines across and between them, and openings."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Final

import numpy as np
import shapely

from jld_core import Floats, InputError, tolerances
from jld_core.geometry import Faces, across, area_vector, snapping, unions
from jld_core.scene import units
from jld_formats.drawn_loads import MOST, Cell, Mark
from jld_formats.options import ImportOptions, Measures, Notes, listed, several
from jld_formats.paths import Path

_CHUNK, _CROSSINGS = 64, 5
"""Number of lines per batch in counting crossings, and largest number of crossings in units of `MOST`."""

# Share of a cell's boundary on lines of its own above which it is an element beside closed outlines
_DRAWN: Final = 0.5

# Least clearance of a frame, and largest distance of outlines that touch, relative to the size of the frame
_APART: Final = 5e-4

_DOUBLED: Final = 0.75  # least area of the inner one of two frames, relative to that of the outer one

_SHEET: Final = 0.005  # largest relative difference of the sides of a frame from the ratio of a sheet, the root of 2

_LARGE: Final = 6.0  # area of a cell, relative to the median, above which the report asks whether it is an opening

_FEW: Final = 4  # least number of free cells whose median says what is large


class NothingEnclosed(InputError):
    """Lines that enclose no element."""


@dataclass(frozen=True)
class FoundCells:
    """Cells of a drawing, with what was left out; nested: cell and outline around it, both elements."""

    cells: list[Cell]
    nested: list[tuple[Cell, Cell]]
    closed: list[int]
    empty: shapely.Geometry
    unused: int


@dataclass(frozen=True)
class Gap:
    """End of a line that does not quite meet another line: width and place (2,), scene units."""

    width: float
    at: Floats


def with_holes(paths: list[Path]) -> tuple[list[Path], dict[int, list[int]]]:
    """Append the holes of paths as closed paths, and return the indices of the holes of each path that has some."""
    rings = [(k, Path(hole, closed=True, layer=path.layer)) for k, path in enumerate(paths) for hole in path.holes]
    holes: dict[int, list[int]] = {}
    for number, (k, _) in enumerate(rings, len(paths)):
        holes.setdefault(k, []).append(number)
    return [*paths, *(ring for _, ring in rings)], holes


def without_frames(paths: list[Path], marks: list[Mark], options: ImportOptions, notes: Notes) -> list[Path]:
    """Drop rectangles around everything that are title frames."""
    # A frame touches nothing, and holds supports, outlines that touch one another, or has the shape of a sheet.
    remaining = list(range(len(paths)))
    boxes = np.array([[*path.points[:, :2].min(axis=0), *path.points[:, :2].max(axis=0)] for path in paths])
    grounds = {k for k, path in enumerate(paths) if options.role(path.layer) == "support"}
    pins = any(options.role(mark.layer) == "support" for mark in marks)
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    before = 0.0
    while len(remaining) > 1:
        k, other = sorted(remaining, key=lambda k: -float(areas[k]))[:2]
        others = [j for j in remaining if j != k]
        wide, tall = boxes[k, 2:] - boxes[k, :2]
        sheet = abs(max(wide, tall) / max(min(wide, tall), 1e-300) / 2.0**0.5 - 1.0) <= _SHEET
        if all(options.role(paths[j].layer) not in (None, "hole") for j in others):
            break  # what it holds stands on nothing: it is the structure itself
        doubled = max(before, float(areas[k])) * _DOUBLED <= (areas[k] if before else areas[other])
        if not (_is_clear(paths[k], boxes, k, others) and options.role(paths[k].layer) is None):
            break
        if doubled and not before:
            inside = [j for j in others if j != other]
            doubled = bool(inside) and _is_clear(paths[other], boxes, other, inside)
        structure_inside = _touching([paths[j] for j in others], max(wide, tall))
        if not (sheet or doubled or pins or grounds & set(others) or structure_inside):
            break
        remaining, before = others, float(areas[k])
        notes.skip("outline", 1, f"a frame around everything, on layer {paths[k].layer or '(none)'}")
    return [paths[k] for k in remaining]


def _is_clear(path: Path, boxes: Floats, k: int, others: list[int]) -> bool:
    """Return True if a path is an upright rectangle around boxes (n, 4) of others, which it does not touch."""
    if not path.closed or len(path.points) < 3 or path.points[:, 2].any():
        return False
    wide, tall = boxes[k, 2:] - boxes[k, :2]
    inner = np.concatenate([boxes[others, :2].min(axis=0) - boxes[k, :2], boxes[k, 2:] - boxes[others, 2:].max(axis=0)])
    area = float(shapely.Polygon(path.points[:, :2]).area)
    return bool(inner.min() > _APART * max(wide, tall) and area >= (1.0 - 1e-6) * wide * tall)


def _touching(paths: list[Path], size: float) -> bool:
    """Return True if two closed outlines lie side by side, or lines touch an outline from outside."""
    shapes = [shapely.Polygon(p.points[:, :2]) for p in paths if p.closed and len(p.points) > 2]
    shapes = [shape for shape in shapes if shape.is_valid]
    if len(shapes) < 2:
        return False
    first, second = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=_APART * size)
    pairs = [(shapes[i], shapes[j]) for i, j in zip(first.tolist(), second.tolist(), strict=True) if i < j]
    return any(a.intersection(b).area <= 1e-3 * min(a.area, b.area) for a, b in pairs)


def find_gaps(points: list[Floats], paths: list[Path], options: ImportOptions, reach: float) -> list[Gap]:
    """Return the ends of lines, before snapping, that nearly meet another line or their own other end."""
    chosen = [k for k, path in enumerate(paths) if options.role(path.layer) in (None, "support") and len(points[k]) > 1]
    if not any(not paths[k].closed for k in chosen):
        return []
    lines = [line_of(paths[k], points[k]) for k in chosen]
    tree = shapely.STRtree(lines)
    ends = [(n, side) for n, k in enumerate(chosen) if not paths[k].closed for side in (0, -1)]
    points_of_ends = np.array([points[chosen[n]][side] for n, side in ends])
    touching = 1e-12 * float(np.abs(points_of_ends).max())
    number, other = tree.query(shapely.points(points_of_ends), predicate="dwithin", distance=reach)
    distance = shapely.distance(shapely.points(points_of_ends[number]), np.array(lines, dtype=object)[other])
    same_line = other == np.array([n for n, _ in ends])[number]
    best = np.full(len(ends), np.inf)
    np.minimum.at(best, number[~same_line], distance[~same_line])
    for index, (n, _) in enumerate(ends):
        line = points[chosen[n]]
        if len(line) > 2:
            best[index] = min(best[index], float(np.hypot(*(line[0] - line[-1]))))
    # a line that goes on past the one that it meets leaves no gap
    narrow = np.flatnonzero((touching < best) & (best <= reach)).tolist()
    pieces = [points[chosen[n]][:2] if side == 0 else points[chosen[n]][-2:] for n, side in (ends[k] for k in narrow)]
    piece, other = tree.query([shapely.LineString(end) for end in pieces], predicate="crosses") if narrow else ([], [])
    best[[narrow[p] for p, j in zip(piece, other, strict=True) if j != ends[narrow[p]][0]]] = np.inf
    gaps: dict[tuple[float, ...], Gap] = {}
    for width, point in zip(best.tolist(), points_of_ends, strict=True):
        if touching < width <= reach and not any(np.hypot(*(point - gap.at)) <= 1.01 * width for gap in gaps.values()):
            gaps[tuple(point)] = Gap(width, point)
    return list(gaps.values())


def find_cells(
    paths: list[Path],
    snapped: snapping.Snapped,
    holes: dict[int, list[int]],
    options: ImportOptions,
    size: float,
    tolerance: float,
    notes: Notes,
) -> FoundCells:
    """Find the cells that become elements; NothingEnclosed where nothing free is, InputError for too many."""
    # Cells are closed outlines, cut by lines that cross them, and areas that lines enclose beside them. Without
    # outlines of free elements they are the cells of the network of lines.
    cut_out = {k for rings in holes.values() for k in rings}
    read = [k for k in range(len(paths)) if k not in snapped.collapsed and k not in cut_out]
    role = [options.role(path.layer) for path in paths]
    outlines = [k for k in read if paths[k].closed and role[k] != "hole"]
    lines = [k for k in read if not paths[k].closed and role[k] != "hole"]
    rings = [line_of(paths[k], snapped.paths[k]) for k in read if role[k] == "hole"]
    empty = _openings(rings, notes)
    lines = _without_doubles(lines, snapped)
    segments = [shapely.LineString(snapped.paths[k]) for k in lines]
    if all(role[k] == "support" for k in outlines) and not segments + rings:
        raise InputError("", "all it holds are supports", "at least one outline, or a network of lines, that is free")
    used = _one_outline_each(outlines, paths, snapped, holes, notes)
    nested: list[tuple[Cell, Cell]] = []
    if all(role[k] == "support" for k in outlines):
        layers = [*(paths[k].layer for k in lines), *[""] * len(rings)]
        cells = _network(segments + rings, layers, options, size, notes)
        if not cells:
            raise NothingEnclosed(
                "", "its lines enclose nothing", "lines that meet within `tolerance` around every cell"
            )
        cells += [Cell(snapped.paths[k], paths[k].layer, paths[k].name) for k in used]
    else:
        shapes = {k: _shape(k, snapped, holes) for k in used}
        cells, nested = _cells_of_outlines(shapes, paths, snapped, segments + rings, options, size, notes)
        own_lines = [(s, paths[k].layer) for s, k in zip(segments, lines, strict=True) if role[k] in (None, "support")]
        cells += _beside(cells, own_lines, options, size, notes)
    if not empty.is_empty:
        points = shapely.point_on_surface([shapely.Polygon(cell.points) for cell in cells])
        shapely.prepare(empty)
        cells = [cell for cell, out in zip(cells, shapely.contains(empty, points).tolist(), strict=True) if not out]
    if not cells:
        raise NothingEnclosed("", "its lines enclose nothing", "lines that meet within `tolerance` around every cell")
    if len(cells) > MOST:
        raise InputError("", f"it makes {len(cells)} cells", f"at most {MOST}")
    unused = _count_unused(segments, [paths[k].layer for k in lines], cells, max(2.0 * tolerance, 1e-7 * size), notes)
    present = {id(cell) for cell in cells}
    nested = [pair for pair in nested if id(pair[0]) in present and id(pair[1]) in present]
    return FoundCells(cells, nested, used, empty, unused)


def _shape(k: int, snapped: snapping.Snapped, holes: dict[int, list[int]]) -> shapely.Geometry:
    """Return a closed outline after snapping, without its holes: a polygon, or several."""
    rings = [snapped.paths[j] for j in holes.get(k, ()) if j not in snapped.collapsed]
    polygon = shapely.Polygon(snapped.paths[k], rings)
    if rings and not polygon.is_valid:  # a hole that touches the outline
        shell = shapely.make_valid(shapely.Polygon(snapped.paths[k]))
        parts = shapely.get_parts(shell.difference(shapely.union_all([shapely.Polygon(ring) for ring in rings])))
        areas = [part for part in parts if part.geom_type == "Polygon" and part.area > 1e-9 * shell.area]
        return areas[0] if len(areas) == 1 else shapely.MultiPolygon(areas)
    return polygon


def say_nested(nested: list[tuple[Cell, Cell]], notes: Notes) -> None:
    """Note elements that lie within others, which may be openings."""
    inner_names: dict[str, list[str]] = {}
    layers: dict[str, str] = {}
    for inner, outer in nested:
        if not inner.support:
            inner_names.setdefault(str(outer.name), []).append(str(inner.name))
            layers[str(outer.name)] = inner.layer if inner.layer not in ("", "0", outer.layer) else ""
    for outer_name, names in inner_names.items():
        verb = "lies" if len(names) == 1 else "lie"
        openings = "an opening" if len(names) == 1 else "openings"
        remedy = (
            f"--hole {layers[outer_name]}" if layers[outer_name] else "draw it on a layer of its own, and --hole LAYER"
        )
        notes.doubtful.append(f"{listed(names)} {verb} within {outer_name}: {openings}? {remedy}")
        notes.doubted += names


def say_large(cells: list[Cell], notes: Notes) -> None:
    """Note the free cells that are far larger than the others, which may be openings."""
    free = [cell for cell in cells if not cell.support]
    areas = np.array([shapely.Polygon(cell.points).area for cell in free])
    if len(free) < _FEW:
        return
    usual = float(np.median(areas))
    for cell, area in zip(free, areas.tolist(), strict=True):
        if area > _LARGE * usual:
            remark = f"element {cell.name!r} has {area / usual:.3g} times the area of the median element"
            notes.doubtful.append(f"{remark}: if it is an opening, draw its outline on a layer of --hole")
            notes.doubted.append(str(cell.name))


def line_of(path: Path, points: Floats) -> shapely.LineString:
    """Return a path after snapping as a line, closed where the path is."""
    return shapely.LineString(np.concatenate([points, points[:1]]) if path.closed else points)


def _openings(rings: list[shapely.LineString], notes: Notes) -> shapely.Geometry:
    """Return the area that the lines of openings enclose, outlines or single lines."""
    if not rings:
        return shapely.Polygon()
    areas = shapely.polygonize([shapely.union_all(rings)])
    if len(areas.geoms):
        notes.found.append(several(len(areas.geoms), "opening"))
    return shapely.union_all(areas)


def _cells_of_outlines(
    shapes: dict[int, shapely.Geometry],
    paths: list[Path],
    snapped: snapping.Snapped,
    segments: list[shapely.LineString],
    options: ImportOptions,
    size: float,
    notes: Notes,
) -> tuple[list[Cell], list[tuple[Cell, Cell]]]:
    """Return the cells of closed outlines, cut by the lines that cross them, and pairs of nested ones."""
    # Supports are not cut. An outline around others loses their areas.
    of_outline: dict[int, list[Cell]] = {}
    cut = pieces_in_all = 0
    tree = shapely.STRtree(segments) if segments else None
    inside = _inside(shapes)
    for k, shape in shapes.items():
        if k in inside:
            ring = shapely.difference(shape, shapely.union_all([shapes[j] for j in inside[k]]))
            crossing = [] if tree is None else [segments[i] for i in sorted(tree.query(shape).tolist())]
            parts = [part for part in shapely.get_parts(ring) if part.geom_type == "Polygon"]
            parts = [part for part in parts if part.area > 1e-9 * size**2]
            pieces_of_part = [
                _cut(part, crossing, paths[k].layer, size) or _pieces(part, paths[k].layer) for part in parts
            ]
            of_outline[k] = [cell for pieces in pieces_of_part for cell in pieces]
            remark = ", without their areas" if parts else ", which fill it: no element"
            notes.found.append(f"an outline around {several(len(inside[k]), 'outline')}{remark}")
            continue
        uncut = tree is None or options.role(paths[k].layer) == "support"
        crossing = [] if uncut or tree is None else [segments[i] for i in sorted(tree.query(shape).tolist())]
        pieces = _cut(shape, crossing, paths[k].layer, size) if crossing and shape.is_valid else []
        if len(pieces) > 1:
            cut, pieces_in_all = cut + 1, pieces_in_all + len(pieces)
        elif shapely.Polygon(snapped.paths[k]).area > (1.0 + 1e-12) * shape.area > 0.0:  # it has holes
            pieces = [cell for part in shapely.get_parts(shape) for cell in _pieces(part, paths[k].layer)]
            pieces[0].name = paths[k].name
        else:
            pieces = [Cell(snapped.paths[k], paths[k].layer, paths[k].name)]
        of_outline[k] = pieces
    if cut:
        notes.found.append(f"{several(cut, 'outline')} cut into {pieces_in_all} cells by the lines that cross them")
    nested = [
        (of_outline[j][0], of_outline[k][0])
        for k, within in inside.items()
        for j in within
        if of_outline[j] and of_outline[k] and not any(j in inside.get(i, ()) for i in within)
    ]
    return [cell for pieces in of_outline.values() for cell in pieces], nested


def _inside(shapes: dict[int, shapely.Geometry]) -> dict[int, list[int]]:
    """Map each outline that covers others to the outlines inside it, by their keys."""
    # The map is empty if any outline crosses itself.
    inside: dict[int, list[int]] = {}
    keys, polygons = list(shapes), list(shapes.values())
    if not all(polygon.is_valid for polygon in polygons):
        return {}
    inner, outer = shapely.STRtree(polygons).query(polygons, predicate="covered_by")
    for a, b in zip(inner.tolist(), outer.tolist(), strict=True):
        if a != b:
            inside.setdefault(keys[b], []).append(keys[a])
    return inside


def _beside(
    cells: list[Cell], lines: list[tuple[shapely.LineString, str]], options: ImportOptions, size: float, notes: Notes
) -> list[Cell]:
    """Return the cells that lines enclose beside closed outlines, with the layer of each."""
    shapes = [shape for shape in (shapely.Polygon(cell.points) for cell in cells) if shape.is_valid]
    if not lines or not shapes:
        return []
    covered = shapely.union_all(shapes)
    inside = covered.buffer(-1e-7 * size)
    shapely.prepare(inside)
    outside_cells = ~shapely.intersects(inside, [line for line, _ in lines])
    loose = [pair for pair, out in zip(lines, outside_cells.tolist(), strict=True) if out]
    if not loose:
        return []
    faces = list(shapely.polygonize([shapely.union_all([*(line for line, _ in loose), covered.boundary])]).geoms)
    shapely.prepare(covered)
    faces = [face for face in faces if face.area > 1e-12 * size**2]
    outside = ~shapely.contains(covered, shapely.point_on_surface(faces)) if faces else np.zeros(0, bool)
    faces = [face for face, out in zip(faces, outside.tolist(), strict=True) if out]
    supports = [line for line, layer in loose if options.role(layer) == "support"]
    own_share = _share_on(faces, [line for line, _ in loose], 1e-7 * size)
    grounded = _share_on(faces, supports, 1e-7 * size)
    ground = next((layer for _, layer in loose if options.role(layer) == "support"), "")
    linestrings = [
        (face, ground if onto > _DRAWN else "")
        for face, share, onto in zip(faces, own_share, grounded, strict=True)
        if share > _DRAWN
    ]
    cells_found = [cell for face, layer in _drop_unconnected(linestrings, covered) for cell in _pieces(face, layer)]
    if cells_found:
        notes.found.append(f"{several(len(cells_found), 'cell')} that lines enclose beside the outlines")
    return cells_found


def _share_on(faces: list[shapely.Polygon], lines: list[shapely.LineString], near: float) -> list[float]:
    """Return the share of the boundary of each face whose edges lie on some of the lines."""
    if not faces or not lines:
        return [0.0] * len(faces)
    rings = [shapely.get_coordinates(face.exterior) for face in faces]
    middles = np.concatenate([0.5 * (ring[1:] + ring[:-1]) for ring in rings])
    lengths = np.concatenate([np.hypot(*np.diff(ring, axis=0).T) for ring in rings])
    on = np.zeros(len(middles), bool)
    on[shapely.STRtree(lines).query(shapely.points(middles), predicate="dwithin", distance=near)[0]] = True
    stops = np.cumsum([0, *(len(ring) - 1 for ring in rings)])
    return [float(lengths[a:b][on[a:b]].sum() / lengths[a:b].sum()) for a, b in itertools.pairwise(stops.tolist())]


def _drop_unconnected(
    faces: list[tuple[shapely.Polygon, str]], covered: shapely.Geometry
) -> list[tuple[shapely.Polygon, str]]:
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
) -> int:
    """Note by layer how many lines bound no cell, and so have no effect; return their number."""
    if not segments:
        return 0
    starts = np.concatenate([cell.points for cell in cells])
    ends = np.concatenate([np.roll(cell.points, -1, axis=0) for cell in cells])
    near = []
    for share in (0.25, 0.75):
        points = shapely.points(starts + share * (ends - starts))
        near.append(shapely.STRtree(segments).query(points, predicate="dwithin", distance=reach))
    wide = len(segments)
    both = np.intersect1d(near[0][0] * wide + near[0][1], near[1][0] * wide + near[1][1])
    edge, line = both // wide, both % wide
    along = np.bincount(line, np.hypot(*(ends - starts).T)[edge], minlength=wide)
    # a line that only crosses a boundary has a few times its half width in common with it
    free = along <= np.minimum(10.0 * reach, 0.5 * shapely.length(segments))
    unused = Counter(layers[k] for k in np.flatnonzero(free).tolist())
    for layer, count in sorted(unused.items()):
        words = f"line{'s' * (count != 1)} on layer {layer or '(none)'}"
        notes.skip(words, count, "they bound and divide no cell")
    return unused.total()


def refuse_crossings(lines: list[shapely.LineString], paths: list[Path]) -> None:
    """Raise InputError for too many crossings of lines, each of a path, before these are computed."""
    # A few thousand lines may have millions of crossings.
    if all(path.closed for path in paths) or len(lines) ** 2 <= MOST:
        return
    tree, total = shapely.STRtree(lines), 0
    for begin in range(0, len(lines), _CHUNK):
        total += tree.query(np.array(lines[begin : begin + _CHUNK]), predicate="intersects").shape[1]
        if total > _CROSSINGS * MOST:
            raise InputError("", "its lines have too many crossings", "a network of cells")


def _one_outline_each(
    outlines: list[int], paths: list[Path], snapped: snapping.Snapped, holes: dict[int, list[int]], notes: Notes
) -> list[int]:
    """Return the indices of outlines without those drawn twice; holes of any of equal ones count."""
    first_of: dict[bytes, int] = {}
    for k in outlines:
        corners = snapped.paths[k]
        key = np.sort(corners.view([("x", corners.dtype), ("y", corners.dtype)]).ravel(), order=("x", "y")).tobytes()
        first = first_of.setdefault(key, k)
        if first != k and k in holes and first not in holes:
            holes[first] = holes.pop(k)
    notes.skip("outlines", len(outlines) - len(first_of), "drawn twice")
    return list(first_of.values())


def _without_doubles(lines: list[int], snapped: snapping.Snapped) -> list[int]:
    """Return the indices of lines (k, 2), the first of equal ones, whatever their direction."""
    first_of: dict[bytes, int] = {}
    for k in lines:
        points = snapped.paths[k]
        first_of.setdefault(min(points.tobytes(), points[::-1].tobytes()), k)
    return list(first_of.values())


def _network(
    segments: list[shapely.LineString], layers: list[str], options: ImportOptions, size: float, notes: Notes
) -> list[Cell]:
    # A cell is a support where more than half of its boundary lies on support lines.
    noded = shapely.node(shapely.MultiLineString(segments))
    cells, _, _, invalid = shapely.polygonize_full([noded])
    notes.skip("rings", len(invalid.geoms), "they cross themselves")
    found_cells = []
    supports = [s for s, layer in zip(segments, layers, strict=True) if options.role(layer) == "support"]
    ground = shapely.union_all(supports) if supports else None
    for cell in cells.geoms:
        if cell.area <= 1e-12 * size**2:
            continue
        on_support = 0.0 if ground is None else cell.exterior.intersection(ground).length / cell.exterior.length
        layer = next(la for la in layers if options.role(la) == "support") if on_support > 0.5 else ""
        found_cells += _pieces(cell, layer)
    found_cells.sort(key=lambda cell: _height(cell, size))
    notes.found.append(f"a network of {several(len(segments), 'line')} around {several(len(found_cells), 'cell')}")
    return found_cells


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
    inside_lines = [part for part in inside if part.length > 1e-9 * size]
    if not inside_lines:
        return []
    noded = shapely.union_all([shape.boundary, *inside_lines])
    pieces = [piece for piece in shapely.polygonize([noded]).geoms if piece.area > 1e-12 * size**2]
    cells = [cell for piece in pieces if shape.covers(piece.representative_point()) for cell in _pieces(piece, layer)]
    return sorted(cells, key=lambda cell: _height(cell, size))


def _height(cell: Cell, size: float) -> tuple[float, ...]:
    """Return the sort key (height, x) of a cell: the mean of its corners over `size`."""
    return tuple(np.round(cell.points.mean(axis=0)[::-1] / size, 9).tolist())


def _without_holes(cell: shapely.Polygon) -> list[shapely.Polygon]:
    """Cut a polygon through its holes, as an element has one outline."""
    if not cell.interiors:
        return [cell]
    x0, y0, x1, y1 = cell.bounds
    middle = shapely.Polygon(cell.interiors[0]).centroid.x
    halves = [cell.intersection(shapely.box(a, y0, b, y1)) for a, b in ((x0, middle), (middle, x1))]
    parts = [part for half in halves for part in shapely.get_parts(half) if part.geom_type == "Polygon"]
    return [piece for part in parts for piece in _without_holes(part)]


def without_holes(points: Floats, loops: Sequence[Sequence[int]], title: str) -> Faces:
    """Return a plane face as its outline or, with holes, as triangles; InputError if not plane, or loops cross."""
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
    triangles = unions.triangulate_region(flat, [outline, *holes]) if region.is_valid else []
    covered = sum(float(np.linalg.norm(area_vector(points[list(triangle)]))) for triangle in triangles)
    if not triangles or abs(covered - region.area) > 1e-9 * length:
        raise InputError(title, "a hole of a face crosses its outline or another hole", "holes inside, apart")
    return tuple(triangles)


# Least and largest extent of a structure that passes without a word, m: models on a table to long bridges
_WHOLE: Final = (0.05, 300.0)

_BLOCK: Final = 3.0  # largest usual block, m, in a structure larger than `_LONG`

_LONG: Final = 20.0  # extent of a structure, m, up to which blocks may be outlines that are still to be cut

_USUAL: Final = (3.0, 0.35)  # usual extent of a structure and of a block, m, by which the likely unit is chosen

# Least sum of the |log| of both sizes over the usual ones by which another unit is nearer by far
_FAR: Final = 4.0

_COMMON: Final = ("mm", "cm", "m", "in", "ft")  # units that are proposed


def hardly_meant(size: float) -> bool:
    """Return True if a largest extent, m, is that of no structure."""
    return not _WHOLE[0] <= size <= _WHOLE[1]


def say_size(measured: Measures, unit: str, drawn_in: str, notes: Notes) -> None:
    """Note a size of a structure or of its blocks that can hardly be meant, and a likely unit."""
    if unit != "m" or drawn_in not in units.METRES or not min(measured.block, default=0.0) > 0.0:
        return
    size, block = max(measured.size), float(np.prod(measured.block)) ** (1.0 / len(measured.block))
    per_unit = 1.0 / units.METRES[drawn_in]

    def strangeness(name: str) -> float:
        factor = units.METRES[name] * per_unit
        return abs(log(size * factor / _USUAL[0])) + abs(log(block * factor / _USUAL[1]))

    likely = min(_COMMON, key=strangeness)
    far = strangeness(drawn_in) - strangeness(likely) > _FAR
    if not far and not hardly_meant(size) and (block <= _BLOCK or size <= _LONG):
        return
    factor = units.METRES[likely] * per_unit
    remark = f"the structure is {size:.3g} m large, its median element {block:.3g} m, with lengths in {drawn_in}"
    if likely == drawn_in:
        notes.doubtful.append(remark)
        return
    notes.doubtful.append(
        f"{remark}: in {likely} it is {size * factor:.3g} m and {block * factor:.3g} m, --unit {likely}"
    )
