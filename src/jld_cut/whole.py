"""Surface of touching bodies as one: faces that lie back to back are taken away, and edges are made to match."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from jld_core import Floats, Ints

_SPLITS: Final = 50  # pieces of a triangle, on average, up to which a surface is split at points on its edges
_SAME: Final = 1e-6  # difference of unit normals, and of offsets by size, of one plane


def outer_surface(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return points (n, 3) and triangles (k, 3) of what touching closed surfaces enclose together."""
    points, triangles = _sound(points, triangles, tolerance)
    points, triangles = _sound(*_without_shared(points, triangles, tolerance), tolerance)
    triangles = _split_at(points, triangles, tolerance)
    # two triangles of the same corners, back to back, enclose nothing
    turn = np.sign(np.linalg.det(np.eye(3)[np.argsort(triangles, axis=1)])) if len(triangles) else np.zeros(0)
    kinds, kind = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)
    balance = np.bincount(kind.reshape(-1), turn, len(kinds)).astype(int)
    triangles = np.repeat(np.where((balance < 0)[:, None], kinds[:, ::-1], kinds), np.abs(balance), axis=0)
    used, place = np.unique(triangles, return_inverse=True)
    return points[used], place.reshape(-1, 3)


def groups(pairs: Ints, count: int) -> Ints:
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _sound(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return a surface whose near corners are one, without triangles lower than the tolerance."""
    group = groups(cKDTree(points).query_pairs(tolerance, output_type="ndarray"), len(points))
    _, first = np.unique(group, return_index=True)
    points, triangles = points[first], group[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    return points, triangles[normals_of(corners)[1] > tolerance * longest]


def normals_of(corners: Floats) -> tuple[Floats, Floats]:
    """Return normals (k, 3) of triangles (k, 3, 3), twice their area long, and these lengths."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal, np.linalg.norm(normal, axis=1)


def _without_shared(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return a surface without the regions in which faces of a plane lie back to back."""
    corners = points[triangles]
    normal, length = normals_of(corners)
    normal = normal / length[:, None]
    size = float(np.ptp(points, axis=0).max())
    planes = np.column_stack([normal, np.einsum("ij,ij->i", normal, corners.mean(axis=1)) / size])
    tree = cKDTree(planes)
    back = cKDTree(-planes).sparse_distance_matrix(tree, _SAME, output_type="coo_matrix")
    like = tree.query_pairs(_SAME, output_type="ndarray")
    group = groups(np.concatenate([like, np.column_stack([back.row, back.col])]), len(triangles))
    kept = np.ones(len(triangles), dtype=bool)
    made = [np.zeros((0, 3, 3))]
    for name in np.unique(group[back.row]).tolist():
        members = np.flatnonzero(group == name)
        largest = members[np.argmax(length[members])]
        up, offset = normal[largest], float(planes[largest, 3]) * size
        first = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
        first /= np.linalg.norm(first)
        frame = np.array([first, np.cross(up, first)])
        looks = normal[members] @ up > 0.0
        plan = shapely.polygons(corners[members] @ frame.T)
        grid = 0.01 * tolerance
        above, below = (shapely.union_all(plan[side], grid_size=grid) for side in (looks, ~looks))
        if shapely.intersection(above, below, grid_size=grid).area < tolerance**2:
            continue
        kept[members] = False
        for one, other, sign in ((above, below, 1), (below, above, -1)):
            rest = shapely.get_parts(shapely.difference(one, other, grid_size=grid))
            rest = rest[shapely.get_type_id(rest) == 3]
            flat = [triangle for region in rest for triangle in triangles_of(region)]
            if flat:
                ring = shapely.get_coordinates(shapely.orient_polygons(flat)).reshape(-1, 4, 2)[:, :3][:, ::sign]
                made.append(ring @ frame + offset * up)
    new = np.concatenate(made)
    numbers = np.arange(3 * len(new)).reshape(-1, 3) + len(points)
    return np.concatenate([points, new.reshape(-1, 3)]), np.concatenate([triangles[kept], numbers])


def triangles_of(region: Any) -> list[Any]:
    try:
        return list(shapely.get_parts(shapely.constrained_delaunay_triangles(region)))
    except shapely.errors.GEOSException:  # a ring that touches itself
        within = shapely.intersection(shapely.get_parts(shapely.delaunay_triangles(region)), region)
        return [one for one in shapely.get_parts(within) if one.geom_type == "Polygon"]


def _split_at(points: Floats, triangles: Ints, tolerance: float) -> Ints:
    """Return triangles split at the points that lie on their edges."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    start, ray = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    length = np.linalg.norm(ray, axis=1)
    used = np.unique(triangles)
    near = cKDTree(points[used]).query_ball_point(start + ray / 2, length / 2 + tolerance)
    on: dict[tuple[int, int], list[int]] = {}
    for k, found in enumerate(near):
        away = points[used[found]] - start[k]
        along = away @ ray[k] / length[k]
        off = np.linalg.norm(away - np.outer(along, ray[k] / length[k]), axis=1)
        inside = (off <= tolerance) & (along > 0.0) & (along < length[k])
        inside &= ~np.isin(used[found], edges[k])
        if inside.any():
            on[int(edges[k, 0]), int(edges[k, 1])] = used[found][inside][np.argsort(along[inside])].tolist()
    done, todo = [], [tuple(one) for one in triangles.tolist()]
    left = _SPLITS * (len(triangles) + 10)  # two points just apart may each lie on an edge to the other
    while todo:
        left -= 1
        if left < 0:
            raise ValueError("edges that cannot be split")
        a, b, c = todo.pop()
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
            if between := on.get((min(p, q), max(p, q)), []):
                # parts of an edge hold the points between them; a third corner among them: it encloses nothing
                chain = [min(p, q), *between, max(p, q)]
                at = len(chain) // 2
                for part in (chain[: at + 1], chain[at:]):
                    ends, inner = (part[0], part[-1]), part[1:-1]
                    on[min(ends), max(ends)] = inner if ends[0] < ends[1] else inner[::-1]
                todo += [one for one in ((p, chain[at], r), (chain[at], q, r)) if len(set(one)) == 3]
                break
        else:
            done.append((a, b, c))
    return np.array(done, dtype=np.int64).reshape(-1, 3)
