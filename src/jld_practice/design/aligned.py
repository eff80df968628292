"""Cells aligned with the principal stresses of a planar body: head joints normal to the compression, beds along it."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import spsolve

from jld_core import Floats, InputError, Ints
from jld_core.refinement import arrangement

_SMOOTH: Final = 0.8  # length over which stresses are averaged, relative to a cell

# Weight of equal spacing of joints beside their direction: spacing may vary, as between voussoirs of an arch
_STRETCH: Final = 0.15

_FAINT: Final = 0.02  # weight of the direction where there is no stress, relative to that under the mean stress

_LITTLE: Final = 0.3  # stress, relative to the mean, whose direction counts half

_STRAIGHT: Final = 0.12  # distance, relative to a cell, by which a joint may leave its curve; joints have few corners

# Distance from the outline, relative to a cell, within which joints do not run along it: cells would be slivers
_BESIDE: Final = 0.15

_ALONG: Final = 2.5  # length of a joint near the outline, over that distance, from which on it runs along it

# Area of a cell, over the square of the wanted side, above which it is halved: few lines pass where stress is weak
_LARGEST: Final = 1.8

# Distance by which cells reach beyond the outline, relative to a cell: it cuts them, and shares no edges
_OUTSIDE: Final = 1e-3

_PAST: Final = 5.0  # length by which joints are extended beyond the outline, over that distance

_ON: Final = 1e-7  # distance from the outline, relative to the structure, up to which a line lies on it


@dataclass(frozen=True)
class AlignedCells:
    """Cells whose joints follow the principal stresses of a body."""

    cells: list[shapely.Polygon]  # cells that cover the body
    # mean angle between the normals of head joints and the compression, weighted by length and stress, radians
    deviation: float


@dataclass(frozen=True)
class TriangleStresses:
    """Stresses on the triangles of a planar body."""

    points: Floats  # (p, 2) nodes, length
    triangles: Ints  # (t, 3) nodes of each triangle, counter-clockwise
    stress: Floats  # (t, 3) mean σx, σy, τxy in each triangle, tension positive

    @property
    def gradients(self) -> tuple[Floats, Floats]:
        """Return the gradients (t, 3, 2) of the linear shape functions, and the areas (t,)."""
        p = self.points[self.triangles]
        opposite = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
        one, two = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        twice = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
        turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
        return turned / twice[:, None, None], 0.5 * twice


def aligned_cells(field: TriangleStresses, size: float) -> AlignedCells:
    """Cut a planar body along the principal directions of its stresses."""
    # Head joints are level lines of a function whose gradient follows the compression, and beds those of a function
    # whose gradient is at right angles to it. Both are weighted least-squares fits; the sign of the direction is made
    # alike from triangle to triangle. Lines between two crossings become straight where they leave the curve by little.
    gradient, area = field.gradients
    deviator = _smoothed(field, gradient, area, _SMOOTH * size)
    strength = np.hypot(*deviator.T)
    mean = float(strength @ area / area.sum())
    if not mean > 0.0:
        raise InputError("stresses", "they have no direction: all are 0 or alike in every direction", "a loaded body")
    weight = strength / (strength + _LITTLE * mean) + _FAINT
    # the compression is at right angles to the largest principal stress
    angle = 0.5 * np.arctan2(deviator[:, 1], deviator[:, 0]) + 0.5 * np.pi
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    part = _oriented(field.triangles, direction, weight * area)
    across = np.column_stack([-direction[:, 1], direction[:, 0]])
    heads = _fitted(field, gradient, area * weight, direction)
    beds = _fitted(field, gradient, area * weight, across)
    lines: list[shapely.LineString] = []
    deviation, total = 0.0, 0.0
    for number in range(int(part.max()) + 1):
        own = field.triangles[part == number]
        for values, normal in ((heads, direction[part == number]), (beds, None)):
            ends, triangle = _level_lines(field.points, own, values, size)
            lines += list(shapely.linestrings(ends))
            if normal is not None and len(ends):
                along = ends[:, 1] - ends[:, 0]
                length = np.hypot(*along.T)
                share = length * strength[part == number][triangle]
                turned = np.abs(np.einsum("sd,sd->s", along, normal[triangle])) / np.maximum(length, 1e-300)
                deviation += float(share @ np.arcsin(np.minimum(turned, 1.0)))
                total += float(share.sum())
    if len(lines) > arrangement.MOST:
        raise InputError("cell", f"that makes {len(lines):.3g} pieces of joints", f"at most {arrangement.MOST}")
    cells = _halved(_cells(field, lines, size), field, direction, _LARGEST * size**2)
    return AlignedCells(cells, deviation / total if total > 0.0 else 0.0)


def _matrix(triangles: Ints, blocks: Floats, count: int) -> csr_matrix:
    """Assemble element matrices (t, 3, 3) to a sparse matrix of all nodes."""
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count)).tocsr()


def _lumped(triangles: Ints, values: Floats, count: int) -> Floats:
    """Return the sum (count,) at each node of a third of the values (t,) of its triangles."""
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(values / 3.0, 3), count), dtype=float)


def _smoothed(field: TriangleStresses, gradient: Floats, area: Floats, length: float) -> Floats:
    """Return (σx − σy)/2 and τxy (t, 2) of the triangles, averaged over a length."""
    # One implicit step of diffusion: (M + l² K) v = M v0 at the nodes.
    count = len(field.points)
    raw = np.column_stack([0.5 * (field.stress[:, 0] - field.stress[:, 1]), field.stress[:, 2]])
    mass = _lumped(field.triangles, area, count)
    mass = np.where(mass > 0.0, mass, 1.0)
    stiffness = _matrix(field.triangles, np.einsum("tid,tjd,t->tij", gradient, gradient, area), count)
    system = (diags(mass) + length**2 * stiffness).tocsc()
    nodal = [spsolve(system, _lumped(field.triangles, one * area, count)) for one in raw.T]
    return np.asarray(np.column_stack(nodal)[field.triangles].mean(axis=1))


def _oriented(triangles: Ints, direction: Floats, weight: Floats) -> Ints:
    """Give directions (t, 2) like signs in place, from the triangles of largest weight on; return the parts (t,)."""
    # Triangles that hang together over edges are one part.
    edges: dict[tuple[int, int], list[int]] = {}
    for number, (a, b, c) in enumerate(triangles.tolist()):
        for pair in ((a, b), (b, c), (c, a)):
            edges.setdefault((min(pair), max(pair)), []).append(number)
    beside: list[list[int]] = [[] for _ in triangles]
    for both in edges.values():
        if len(both) == 2:
            beside[both[0]].append(both[1])
            beside[both[1]].append(both[0])
    part = np.full(len(triangles), -1, dtype=np.int64)
    number = 0
    for root in np.argsort(-weight, kind="stable").tolist():
        if part[root] >= 0:
            continue
        heap = [(-float(weight[root]), root, root)]
        while heap:
            _, here, before = heapq.heappop(heap)
            if part[here] >= 0:
                continue
            part[here] = number
            if float(direction[here] @ direction[before]) < 0.0:
                direction[here] *= -1.0
            for other in beside[here]:
                if part[other] < 0:
                    heapq.heappush(heap, (-float(weight[other]), other, here))
        number += 1
    return part


def _fitted(field: TriangleStresses, gradient: Floats, weight: Floats, direction: Floats) -> Floats:
    """Return the function (p,) at nodes whose gradient is parallel to directions (t, 2), and about as long.

    weight: (t,).
    """
    # Minimises Σ w [(∇φ·d⊥)² + η (∇φ·d − 1)²], with a small part of w alike in all directions.
    count = len(field.points)
    along = np.einsum("tid,td->ti", gradient, direction)
    across = np.einsum("tid,td->ti", gradient, np.column_stack([-direction[:, 1], direction[:, 0]]))
    blocks = np.einsum("ti,tj->tij", across, across) + _STRETCH * np.einsum("ti,tj->tij", along, along)
    matrix = _matrix(field.triangles, blocks * weight[:, None, None], count)
    right = np.bincount(field.triangles.ravel(), (_STRETCH * weight[:, None] * along).ravel(), count)
    # the mean is free: a small mass fixes it, far below the stiffness
    scale = float(matrix.diagonal().mean())
    return np.asarray(spsolve((matrix + diags(np.full(count, 1e-9 * scale))).tocsc(), right))


def _level_lines(points: Floats, triangles: Ints, values: Floats, size: float) -> tuple[Floats, Ints]:
    """Return the segments (s, 2, 2) of level lines at about a distance, and the triangle (s,) of each.

    points: (p, 2). triangles: (t, 3). values: (p,).
    """
    # The levels divide the range of the values in equal parts.
    own = values[triangles]
    low, high = float(own.min()), float(own.max())
    levels = np.linspace(low, high, max(1, round((high - low) / size)) + 1)[1:-1]
    segments, owner = [np.zeros((0, 2, 2))], [np.zeros(0, dtype=np.int64)]
    for level in levels.tolist():
        # a level through a node passes beside it
        apart = np.where(np.abs(own - level) < 1e-9 * (high - low), 1e-9 * (high - low), own - level)
        cut = np.flatnonzero((apart.min(axis=1) < 0.0) & (apart.max(axis=1) > 0.0))
        d = apart[cut]
        lone = np.where((d > 0.0).sum(axis=1) == 1, (d > 0.0).argmax(axis=1), (d < 0.0).argmax(axis=1))
        row = np.arange(len(cut))
        ends = []
        for step in (1, 2):
            other = (lone + step) % 3
            share = d[row, lone] / (d[row, lone] - d[row, other])
            p, q = points[triangles[cut, lone]], points[triangles[cut, other]]
            # the same point from both triangles of an edge
            ends.append(p + share[:, None] * (q - p))
        segments.append(np.stack(ends, axis=1))
        owner.append(cut)
    return np.concatenate(segments), np.concatenate(owner)


def _cells(field: TriangleStresses, lines: list[shapely.LineString], size: float) -> list[shapely.Polygon]:
    """Return the polygons that joints and the outline enclose; joints straightened between crossings."""
    # Cells reach a little beyond the outline.
    body = shapely.union_all(shapely.polygons(field.points[field.triangles]))
    extent = float(np.ptp(field.points, axis=0).max())
    outline = shapely.boundary(body)
    whole = shapely.line_merge(shapely.union_all([outline, *lines], grid_size=1e-9 * extent))
    near, beside = outline.buffer(_ON * extent), outline.buffer(_BESIDE * size)
    chains = []
    for chain in shapely.get_parts(whole):
        if near.covers(chain):
            continue
        straight = shapely.simplify(chain, _STRAIGHT * size)
        along = [
            piece
            for piece in shapely.get_parts(shapely.intersection(straight, beside))
            if piece.length > _ALONG * _BESIDE * size
        ]
        # what is left of such a joint ends in a cell, and is no border of cells
        left = shapely.difference(straight, shapely.union_all(along)) if along else straight
        chains += [_extended(one, near, _PAST * _OUTSIDE * size) for one in shapely.get_parts(left) if not one.is_empty]
    around = shapely.boundary(body.buffer(_OUTSIDE * size, join_style="mitre"))
    noded = shapely.union_all([around, *chains], grid_size=1e-9 * extent)
    found = shapely.get_parts(shapely.polygonize(list(shapely.get_parts(noded))))
    return [one for one in found if body.contains(one.representative_point())]


def _extended(line: shapely.LineString, near: shapely.Geometry, length: float) -> shapely.LineString:
    """Return a line whose ends on the outline are moved beyond it by a length."""
    points = shapely.get_coordinates(line)
    for end, before in ((0, 1), (-1, -2)):
        if near.covers(shapely.Point(points[end])):
            away = points[end] - points[before]
            points[end] = points[end] + length * away / max(float(np.hypot(*away)), 1e-300)
    return shapely.LineString(points)


def _halved(
    cells: list[shapely.Polygon], field: TriangleStresses, direction: Floats, largest: float
) -> list[shapely.Polygon]:
    """Cut cells across their longer principal direction until none is larger than an area.

    direction: (t, 2) of compression in each triangle.
    """
    tree = shapely.STRtree(shapely.polygons(field.points[field.triangles]))
    done: list[shapely.Polygon] = []
    left = cells[::-1]
    while left:
        cell = left.pop()
        if cell.area <= largest:
            done.append(cell)
            continue
        along = direction[int(tree.nearest(cell.representative_point()))]
        across = np.array([-along[1], along[0]])
        points = shapely.get_coordinates(cell)
        normal, other = (along, across) if np.ptp(points @ along) >= np.ptp(points @ across) else (across, along)
        middle, far = shapely.get_coordinates(cell.centroid)[0], 2.0 * float(np.ptp(points, axis=0).sum())
        halves = [
            shapely.Polygon(
                [middle - far * other, middle + far * other, middle + far * (other + way), middle + far * (way - other)]
            )
            for way in (normal, -normal)
        ]
        parts = [
            part
            for half in halves
            for part in shapely.get_parts(shapely.intersection(cell, half))
            if part.geom_type == "Polygon"
        ]
        left += parts[::-1]
    return done
