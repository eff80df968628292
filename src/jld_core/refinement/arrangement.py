"""Cutting of planar elements by cells in one arrangement of lines.

Neighbouring parts share their corners exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats, Ints
from jld_core.errors import InputError, ParameterError
from jld_core.geometry import Faces, facets_of, merge_points

_GRID: Final = 1e-13  # grid width for cutting lines, relative to the structure: near the rounding of its coordinates
_ON_LINE: Final = 1e-10  # distance, relative to the structure, within which a node lies on an outline

# Distance, relative to a cell, within which nodes merge, so that a line that nearly passes a corner meets it
_MERGE: Final = 1e-6
_LOST: Final = 1e-6  # share of an element's area by which its parts may differ from it after nodes merge
_Edge = tuple[tuple[float, ...], tuple[float, ...]]  # edge of a polygon: two points


def split_by_cells(
    ids: Sequence[str],
    outlines: Sequence[Floats],
    fixed: Sequence[Floats],
    cells: Sequence[shapely.Polygon],
    size: float,
    snap: float = 0.0,
) -> list[list[shapely.Polygon]]:
    """Cut elements (n,) along cells into parts that share corners exactly; InputError if parts do not add up."""
    corners = np.concatenate([*outlines, *fixed])
    origin, extent = corners.min(axis=0), float(np.ptp(corners, axis=0).max())
    shapes = [shapely.Polygon(outline) for outline in outlines]
    parts: list[list[tuple[int, shapely.Polygon]]] = [[] for _ in outlines]
    faces = _faces(outlines, corners, cells, origin, extent, size, snap)
    inside = shapely.point_on_surface(faces)
    element_tree, cell_tree = shapely.STRtree(shapes), shapely.STRtree(list(cells))
    cell_of = np.full(len(faces), len(cells), dtype=np.int64)
    face_of, cell = cell_tree.query(inside, predicate="intersects")
    np.minimum.at(cell_of, face_of, cell)
    for face, element in zip(*element_tree.query(inside, predicate="within"), strict=True):
        parts[element].append((int(cell_of[face]), faces[face]))
    for name, shape, of_element in zip(ids, shapes, parts, strict=True):
        if abs(sum(part.area for _, part in of_element) - shape.area) > _LOST * shape.area:
            raise InputError(f"element {name!r}", "its cells do not add up to it", "`cell` with another size")
    return [
        [part for _, part in sorted(of_element, key=lambda entry: (entry[0], entry[1].bounds))] for of_element in parts
    ]


def _faces(
    outlines: Sequence[Floats],
    exact_corners: Floats,
    cells: Sequence[shapely.Polygon],
    origin: Floats,
    extent: float,
    size: float,
    snap: float,
) -> list[shapely.Polygon]:
    """Return the polygons that outlines and cell boundaries enclose, about `origin`; exact_corners: (c, 2)."""
    rings = [shapely.LinearRing(outline - origin) for outline in outlines]
    borders = shapely.transform(shapely.boundary(np.array(list(cells))), lambda points: points - origin)
    pieces = shapely.get_parts(shapely.union_all([*rings, *borders], grid_size=_GRID * extent))
    # what runs outside along an outline would come to lie on it by snapping, past corners that it does not meet
    middle = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    shapes = shapely.STRtree([shapely.Polygon(ring) for ring in rings])
    pieces = pieces[np.unique(shapes.query(middle, predicate="dwithin", distance=_ON_LINE * extent)[0])]
    points, owner = shapely.get_coordinates(pieces, return_index=True)
    node, nodes = _nodes(points, exact_corners - origin, rings, extent, size)
    if snap > 0.0:
        node = _snap_nodes(node, nodes, len(exact_corners), rings, _ON_LINE * extent, snap * size)
    continues = np.flatnonzero(owner[1:] == owner[:-1])
    ends = np.sort(np.column_stack([node[continues], node[continues + 1]]), axis=1)
    ends = np.unique(ends[ends[:, 0] < ends[:, 1]], axis=0)
    exact = np.concatenate([exact_corners, nodes[len(exact_corners) :] + origin])
    # Forces at the very edge of a joint ask for the last digits, which the grid of the union has rounded away.
    for corners in (shapely.get_coordinates(list(cells)), exact_corners):
        exact[len(exact_corners) :] = _on_coordinates(exact[len(exact_corners) :], corners, 10.0 * _GRID * extent)
    return list(shapely.get_parts(shapely.polygonize(shapely.linestrings(exact[ends]))))


def _on_coordinates(points: Floats, corners: Floats, reach: float) -> Floats:
    """Return points (k, 2) with each coordinate replaced by the nearest of corners (c, 2) within `reach`."""
    snapped = points.copy()
    for axis in (0, 1):
        values = np.unique(corners[:, axis])
        index = np.searchsorted(values, points[:, axis])
        for neighbour in (np.maximum(index - 1, 0), np.minimum(index, len(values) - 1)):
            within_reach = abs(values[neighbour] - points[:, axis]) <= reach
            snapped[within_reach, axis] = values[neighbour][within_reach]
    return snapped


def _nodes(
    points: Floats, corners: Floats, rings: Sequence[shapely.LinearRing], extent: float, size: float
) -> tuple[Ints, Floats]:
    """Merge near points (k, 2); return the row (k,) of each in a table of nodes (r, 2), and the table."""
    # The table holds the unchanged corners, then the points. Points merge with corners first, then with points on
    # outlines, then with others, so that a node on an outline stays on it.
    on_outline_rows = shapely.STRtree(list(rings)).query(
        shapely.points(points), predicate="dwithin", distance=_ON_LINE * extent
    )[0]
    on_outline = np.zeros(len(points), dtype=bool)
    on_outline[on_outline_rows] = True
    order = np.argsort(~on_outline, kind="stable")
    table = np.concatenate([corners, points[order]])
    node_of = merge_points(table, _MERGE * size)
    # the first point of each node stands for it
    first = np.full(int(node_of.max()) + 1, len(table), dtype=np.int64)
    np.minimum.at(first, node_of, np.arange(len(table)))
    node = np.empty(len(points), dtype=np.int64)
    node[order] = first[node_of[len(corners) :]]
    return node, table


def _snap_nodes(
    node: Ints, table: Floats, corner_count: int, rings: Sequence[shapely.LinearRing], width: float, reach: float
) -> Ints:
    """Move nodes (k,), rows of a table (r, 2) with corners first, to near ones for few short edges; new rows."""
    # Corners stay. A node on outlines moves to the nearest corner on them, else to a node that stays there; other nodes
    # move to the nearest corner or node that stays.
    rows = np.concatenate([np.arange(corner_count), np.unique(node[node >= corner_count])])
    outlines: list[set[int]] = [set() for _ in range(len(table))]
    incidences = shapely.STRtree(list(rings)).query(shapely.points(table[rows]), predicate="dwithin", distance=width)
    for point, ring in zip(*incidences.tolist(), strict=True):
        outlines[int(rows[point])].add(ring)
    staying = list(range(corner_count))
    target = np.arange(len(table))
    for row in sorted(rows[corner_count:].tolist(), key=lambda k: (not outlines[k], k)):
        # a node where elements meet stays on the outlines of all of them
        candidates = [other for other in staying if outlines[row] <= outlines[other]]
        distance = np.hypot(*(table[candidates] - table[row]).T)
        # corners of the outlines are preferred to nodes within reach
        order = np.lexsort((distance, np.array(candidates) >= corner_count, distance > reach))
        if len(order) and distance[order[0]] <= reach:
            target[row] = candidates[int(order[0])]
        else:
            staying.append(row)
    return np.asarray(target[node])


def join_small(parts: list[shapely.Polygon], least: float) -> list[shapely.Polygon]:
    """Join parts smaller than a least area to the neighbour with the longest common boundary."""
    parts, unjoinable = list(parts), set[bytes]()
    while len(parts) > 1:
        small = [part for part in parts if part.area < least and part.wkb not in unjoinable]
        if not small:
            break
        part = min(small, key=lambda p: (p.area, p.bounds))
        others = [other for other in parts if other is not part]
        joined = _join_to_neighbour(part, others)
        if joined is None:
            unjoinable.add(part.wkb)
            continue
        index, union = joined
        others[index] = union
        parts = others
    return parts


def _join_to_neighbour(part: shapely.Polygon, others: list[shapely.Polygon]) -> tuple[int, shapely.Polygon] | None:
    """Join a polygon to the neighbour of longest common boundary: its index and the union, or None."""
    # Neighbours whose union with it would have a hole or two components are passed over.
    edges = _edges(part)
    lengths = [sum(float(np.hypot(*np.subtract(*edge))) for edge in edges & _edges(other)) for other in others]
    for index in sorted(range(len(others)), key=lambda k: -lengths[k]):
        if lengths[index] > 0.0:
            union = shapely.get_parts(shapely.coverage_union(others[index], part))
            if len(union) == 1 and not union[0].interiors:
                return index, union[0]
    return None


def _edges(part: shapely.Polygon) -> set[_Edge]:
    """Return the edges of a part's outer boundary, each with ordered ends."""
    points = [tuple(point) for point in shapely.get_coordinates(part.exterior).tolist()]
    return {(min(a, b), max(a, b)) for a, b in pairwise(points)}


MOST: Final = 100_000  # largest number of cells of a refinement
_ON: Final = 1e-9  # distance from a plane, relative to a solid, up to which a corner lies in the plane


def squares(lower: Floats, upper: Floats, cell: tuple[float, float]) -> list[shapely.Polygon]:
    """Cover a box (2,), (2,) with rectangles, row by row from below; ParameterError for more than `MOST`."""
    counts = [
        max(1, int(np.ceil((high - low) / size - 1e-9))) for low, high, size in zip(lower, upper, cell, strict=True)
    ]
    refuse_more(counts[0] * counts[1])
    x = lower[0] + cell[0] * np.arange(counts[0] + 1)
    y = lower[1] + cell[1] * np.arange(counts[1] + 1)
    return [shapely.box(x[i], y[j], x[i + 1], y[j + 1]) for j in range(counts[1]) for i in range(counts[0])]


def refuse_more(count: float) -> None:
    """Raise ParameterError if the number of cells exceeds `MOST`."""
    if count > MOST:
        raise ParameterError("cell", f"that makes {count:.3g} cells", f"at most {MOST}")


def cut(vertices: Floats, faces: Faces, normal: Floats, offset: float) -> list[tuple[Floats, Faces]]:
    """Cut a convex polyhedron by the plane n·x = offset into two closed polyhedra.

    vertices: (k, 3). normal: (3,) unit vector n. Returns vertices and faces of the part below the plane, then above; of
    the polyhedron alone where the plane does not cross it.
    """
    height = vertices @ normal - offset
    size = float(np.ptp(vertices, axis=0).max())
    height = np.where(np.abs(height) <= _ON * size, 0.0, height)
    if not (height.min() < 0.0 < height.max()):
        return [(vertices, faces)]
    return [_half(vertices, faces, sign * height, sign * normal) for sign in (-1.0, 1.0)]


def _half(vertices: Floats, faces: Faces, height: Floats, normal: Floats) -> tuple[Floats, Faces]:
    """Return a convex polyhedron above a plane; height: (k,) of vertices, exactly 0 on it, of both signs."""
    points: list[Floats] = []
    index_of: dict[tuple[int, int], int] = {}  # of the point on the edge (a, b); of vertex a at (a, a)

    def add(edge: tuple[int, int], point: Floats) -> int:
        """Return the index of a point, added once though several faces share it."""
        if edge not in index_of:
            index_of[edge] = len(points)
            points.append(point)
        return index_of[edge]

    loops = []
    on_plane: set[int] = set()
    for loop in faces:
        clipped = []
        for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
            if height[a] >= 0.0:
                index = add((a, a), vertices[a])
                clipped.append(index)
                if height[a] == 0.0:
                    on_plane.add(index)
            if height[a] * height[b] < 0.0:
                # interpolate from the lower to the higher vertex number, so that both parts get the same point
                i, j = min(a, b), max(a, b)
                share = height[i] / (height[i] - height[j])
                index = add((i, j), vertices[i] + share * (vertices[j] - vertices[i]))
                clipped.append(index)
                on_plane.add(index)
        if len(clipped) > 2 and not on_plane.issuperset(clipped):
            loops.append(tuple(clipped))
    above = np.array(points)
    loops.append(_face_on_plane(above, sorted(on_plane), normal))
    return above, tuple(loops)


def _face_on_plane(points: Floats, corners: list[int], normal: Floats) -> tuple[int, ...]:
    """Order the corners of a convex face clockwise about a normal (3,) that points into the solid."""
    arms = points[corners] - points[corners].mean(axis=0)
    e1 = arms[0] / np.linalg.norm(arms[0])
    angle = np.arctan2(arms @ np.cross(normal, e1), arms @ e1)
    return tuple(corners[k] for k in np.argsort(-angle, kind="stable").tolist())


def convex(vertices: Floats, faces: Faces) -> bool:
    """Return True if a polyhedron of vertices (k, 3) is convex, up to 1e-5 of its size."""
    facets = facets_of([vertices], [faces])
    size = float(np.ptp(vertices, axis=0).max())
    height = np.einsum("fd,fvd->fv", facets.normal, vertices[None] - facets.origin[:, None])
    return bool(height.max() <= 1e-5 * size)
