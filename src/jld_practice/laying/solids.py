"""Translations of spatial blocks: which elements the swept volume of a block meets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely

from jld_core import Assembly, Elements, Floats, Ints, ParameterError
from jld_core.geometry import across, area_of, area_vector

# relative volume by which a sweep may overlap an element by rounding; its power 2/3 times the size is a depth
SHARED: Final = 1e-6


class Solids:
    """Tests whether elements of a spatial assembly meet others when translated to infinity."""

    def __init__(self, assembly: Assembly) -> None:
        # an element that is not convex is its surface, or its hull where it moves past one that is not convex
        elements = assembly.elements
        self.elements = elements
        self.size = (elements.upper - elements.lower).max(axis=1)
        from scipy.spatial import ConvexHull  # local, here and below: slow to import, spatial scenes only

        hulls = [ConvexHull(corners) for corners in elements.shape]
        self.planes = [np.unique(np.round(hull.equations, 12), axis=0) for hull in hulls]
        self._met: dict[tuple[int, int, bytes], bool] = {}
        self.convex = np.array([hull.volume for hull in hulls]) <= (1.0 + SHARED) * _volumes(elements)

    def swept(self, mine: Ints, others: Ints, direction: Floats) -> Ints:
        """Return those of `others` (k,) that an element of `mine` meets along a unit vector (3,)."""
        low, high = self.elements.lower, self.elements.upper
        met = np.zeros(len(others), dtype=bool)
        for e in mine.tolist():
            reach = 1e-9 * self.size[e]
            # exclude boxes that can never be met: cheap, and nearly all of them
            ahead = (high[others] > low[e] + reach) | (direction < -1e-12)
            behind = (low[others] < high[e] - reach) | (direction > 1e-12)
            for place in np.flatnonzero(np.all(ahead & behind, axis=1) & ~met).tolist():
                met[place] = self.meets(e, int(others[place]), direction)
        return others[met]

    def meets(self, moving: int, still: int, direction: Floats) -> bool:
        """Return whether an element moved along a unit vector (3,) would overlap another; results are stored."""
        key = (moving, still, direction.tobytes())
        if key not in self._met:
            self._met[key] = self._meets(moving, still, direction)
        return self._met[key]

    def _meets(self, moving: int, still: int, direction: Floats) -> bool:
        if self.convex[still]:
            if self.convex[moving]:
                return self._solid_meets(moving, still, direction)
            # equivalent: move the convex element at rest the opposite way, past the surface of the other
            return any(self._solid_meets_face(still, face, -direction) for face in self._skin(moving))
        return any(self._solid_meets_face(moving, face, direction) for face in self._skin(still))

    def _solid_meets(self, moving: int, still: int, direction: Floats) -> bool:
        """Return whether a convex element moved along a direction overlaps a convex one."""
        p, q = self.planes[moving], self.planes[still]
        depth = self._depth(moving, still)
        ahead = (self.elements.shape[still] @ p[:, :3].T).min(axis=0) + p[:, 3]
        if np.any((ahead >= -depth) & (p[:, :3] @ direction <= 1e-9)):
            return False
        behind = (self.elements.shape[moving] @ q[:, :3].T).min(axis=0) + q[:, 3]
        if np.any((behind >= -depth) & (q[:, :3] @ direction >= -1e-9)):
            return False
        # maximise the depth of a point x in the moving element for which x + t·d lies in the other at the same depth
        rows = np.block(
            [
                [p[:, :3], np.zeros((len(p), 1)), np.ones((len(p), 1))],
                [q[:, :3], (q[:, :3] @ direction)[:, None], np.ones((len(q), 1))],
            ]
        )
        return bool(self._inside(rows, -np.concatenate([p[:, 3], q[:, 3]]), None) > depth)

    def _solid_meets_face(self, moving: int, face: Floats, direction: Floats) -> bool:
        """Return whether a convex element, moved along a direction, takes in a triangle (3, 3)."""
        p = self.planes[moving]
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        normal = normal / np.linalg.norm(normal)
        depth = SHARED ** (2.0 / 3.0) * float(self.size[moving])
        ahead = (face @ p[:, :3].T).min(axis=0) + p[:, 3]
        if np.any((ahead >= -depth) & (p[:, :3] @ direction <= 1e-9)):
            return False
        height = (self.elements.shape[moving] - face[0]) @ normal
        way = float(normal @ direction)
        if (height.min() >= -depth and way >= -1e-9) or (height.max() <= depth and way <= 1e-9):
            return False
        edge = np.cross(np.roll(face, -1, axis=0) - face, normal)
        rows = np.block(
            [
                [p[:, :3], np.zeros((len(p), 1)), np.ones((len(p), 1))],
                [edge, (edge @ direction)[:, None], np.zeros((3, 1))],
            ]
        )
        right = np.concatenate([-p[:, 3], np.einsum("ij,ij->i", edge, face)])
        equal = np.concatenate([normal, [way, 0.0]])[None], np.array([float(normal @ face[0])])
        return bool(self._inside(rows, right, equal) > depth)

    def _depth(self, moving: int, still: int) -> float:
        """Return the penetration, a length, up to which two elements only touch."""
        return float(SHARED ** (2.0 / 3.0) * min(self.size[moving], self.size[still]))

    def _inside(self, rows: Floats, right: Floats, equal: tuple[Floats, Floats] | None) -> float:
        """Maximise the depth over the unknowns (x, t, depth) with t ≥ 0; −inf if infeasible."""
        bounds = [(None, None)] * 3 + [(0.0, None), (None, float(self.size.max()))]
        matrix, values = equal or (None, None)
        from scipy.optimize import linprog

        answer = linprog([0.0] * 4 + [-1.0], A_ub=rows, b_ub=right, A_eq=matrix, b_eq=values, bounds=bounds)
        return -np.inf if answer.x is None else float(answer.x[4])

    def _skin(self, element: int) -> Floats:
        """Return the triangles (t, 3, 3) of the surface of an element."""
        if element not in self._skins:
            corners = self.elements.shape[element]
            faces = [corners[list(loop)] for loop in self.elements.faces[element]]
            self._skins[element] = np.concatenate([_triangles(face) for face in faces])
        return self._skins[element]

    @cached_property
    def _skins(self) -> dict[int, Floats]:
        return {}


def _volumes(elements: Elements) -> Floats:
    """Compute the volumes (n,) of polyhedra from their faces."""
    # Volumes given by a scene are ignored.
    found = []
    for corners, faces in zip(elements.shape, elements.faces, strict=True):
        total = 0.0
        for loop in faces:
            points = corners[list(loop)] - corners[0]
            total += float((np.cross(points[1:-1], points[2:]) @ points[0]).sum())
        found.append(abs(total) / 6.0)
    return np.array(found)


def _triangles(face: Floats) -> Floats:
    """Split a plane polygon (k, 3) into triangles (t, 3, 3)."""
    if len(face) == 3:
        return face[None]
    normal = area_vector(face)
    plane = across(normal / np.linalg.norm(normal))
    # a face with a hole is one outline with a bridge, which is not an edge of the region
    flat = area_of(shapely.Polygon((face - face[0]) @ plane.T))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    return np.array([face[0] + shapely.get_coordinates(part)[:3] @ plane for part in parts])


def tangents(normal: Floats) -> Floats:
    """Return two axes of the plane of a unit normal (3,), and their negatives: (4, 3)."""
    plane = across(normal)
    return np.concatenate([plane, -plane])


_MOST: Final = 500  # largest number of places; more indicate a spacing in another unit


@dataclass(frozen=True)
class Stations:
    """Places at which props push upwards along the underside of a planar structure."""

    points: Floats  # (s, 2) places, scene units
    element: Ints  # (s,) element above each, which has to be laid for the prop to act


def stations_below(assembly: Assembly, spacing: float) -> Stations:
    """Return places at equal distances below a planar structure; ParameterError for a wrong spacing."""
    # Places are the same on both sides of the structure's middle. Places above a support are left out.
    if assembly.dimension != 2:
        raise ParameterError("props", "props along a line are for planar scenes", "a search without it")
    if not 0.0 < spacing < math.inf:
        raise ParameterError("props", f"a spacing of {spacing:g} is wrong", "a length above 0")
    elements = assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    up = -total / np.linalg.norm(total) if np.any(total) else np.array([0.0, 1.0])
    right = np.array([up[1], -up[0]])
    along = np.concatenate([elements.shape[e] @ right for e in elements.free])
    low, high = float(along.min()), float(along.max())
    count = math.floor((high - low) / spacing * (1.0 + 1e-9))
    if count + 1 > _MOST:
        raise ParameterError("props", f"a spacing of {spacing:g} gives {count + 1} places", f"at most {_MOST} places")
    first = low + 0.5 * (high - low - count * spacing)
    points, owner = [], []
    for place in first + spacing * np.arange(count + 1):
        below = {
            e: _lowest(elements.shape[e] @ right, elements.shape[e] @ up, float(place)) for e in range(len(elements))
        }
        known = {e: height for e, height in below.items() if height is not None}
        held = any(elements.support[e] for e in known)
        if known and not held:
            element = min(known, key=lambda e: (known[e], e))
            points.append(place * right + known[element] * up)
            owner.append(element)
    if not points:
        ends = [elements.shape[e] @ right for e in range(len(elements)) if elements.support[e]]
        grounds = shapely.union_all([shapely.LineString([(one.min(), 0.0), (one.max(), 0.0)]) for one in ends])
        whole = shapely.LineString([(low, 0.0), (high, 0.0)])
        if shapely.difference(whole, shapely.buffer(grounds, 1e-9 * assembly.size)).is_empty:
            problem = "the structure stands on supports along its whole length: places lie below a free underside only"
            raise ParameterError("props", problem, "no such option; each stage then says which blocks need props")
        raise ParameterError("props", f"a spacing of {spacing:g} leaves no place below the structure", "a shorter one")
    return Stations(np.array(points), np.array(owner, dtype=np.int64))


def _lowest(across: Floats, height: Floats, place: float) -> float | None:
    """Return the lowest height of a polygon, by its corners (k,), at a horizontal place; None beside it."""
    after, above = np.roll(across, -1), np.roll(height, -1)
    crossed = (np.minimum(across, after) <= place) & (place <= np.maximum(across, after)) & (across != after)
    if not crossed.any():
        return None
    share = (place - across[crossed]) / (after - across)[crossed]
    return float((height[crossed] + share * (above - height)[crossed]).min())
