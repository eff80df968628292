"""Convex polyhedra cut by planes; both parts share the vertices of the cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull

from jld_core.arrays import Floats
from jld_core.geometry import Faces, solids

_ON: Final = 1e-9  # distance from a plane, relative to the size of a cell, below which a vertex lies on the plane

# Volume between a solid and its convex hull, relative to the hull, below which the solid is convex
_CONVEX: Final = 1e-9

Plane = tuple[Floats, float]
"""Unit normal (3,) and offset of a plane; points x with normal·x > offset lie outside."""


@dataclass(frozen=True, eq=False)
class ConvexCell:
    """Convex polyhedron.

    vertices: (k, 3) vertices, scene units. faces: loops of vertex indices, counter-clockwise seen from outside.
    """

    vertices: Floats
    faces: Faces

    @cached_property
    def volume(self) -> float:
        """Return the volume, scene units."""
        return float(solids(["cell"], [self.vertices], [self.faces])[2][0])

    @cached_property
    def size(self) -> float:
        """Return the largest extent along an axis, length."""
        return float(np.ptp(self.vertices, axis=0).max())

    def is_convex(self) -> bool:
        """Return True if the polyhedron fills its convex hull."""
        hull = float(ConvexHull(self.vertices - self.vertices.mean(axis=0)).volume)
        return hull - self.volume <= _CONVEX * hull

    def cut(self, plane: Plane) -> tuple[ConvexCell | None, ConvexCell | None]:
        """Cut the polyhedron by a plane; return the parts inside and outside, None if empty."""
        normal, offset = plane
        height = self.vertices @ normal - offset
        height[abs(height) <= _ON * self.size] = 0.0
        if (height <= 0.0).all():
            return self, None
        if (height >= 0.0).all():
            return None, self
        points, crossing = list(self.vertices), dict[tuple[int, int], int]()
        kept: tuple[list[list[int]], list[list[int]]] = ([], [])
        for loop in self.faces:
            sides: tuple[list[int], list[int]] = ([], [])
            for one, other in zip(loop, (*loop[1:], loop[0]), strict=True):
                for side, sign in zip(sides, (-1.0, 1.0), strict=True):
                    if sign * height[one] >= 0.0:
                        side.append(one)
                if height[one] * height[other] < 0.0:
                    key = (min(one, other), max(one, other))
                    if key not in crossing:
                        low, high = key
                        share = height[low] / (height[low] - height[high])
                        crossing[key] = len(points)
                        points.append((1.0 - share) * self.vertices[low] + share * self.vertices[high])
                    for side in sides:
                        side.append(crossing[key])
            for side, found, sign in zip(sides, kept, (-1.0, 1.0), strict=True):
                beyond = [k for k in side if k < len(height) and sign * height[k] > 0.0]
                if len(side) > 2 and (beyond or any(k >= len(height) for k in side)):
                    found.append(side)
        on = [*np.flatnonzero(height == 0.0).tolist(), *crossing.values()]
        cap = _around(np.array(points)[on], on, normal)
        places = np.array(points)
        return _cell(places, [*kept[0], cap]), _cell(places, [*kept[1], cap[::-1]])


def _around(points: Floats, names: list[int], normal: Floats) -> list[int]:
    """Return the names of points (k, 3) of a plane, counter-clockwise around their middle.

    normal: (3,) of the plane, towards the viewer.
    """
    arm = points - points.mean(axis=0)
    first = arm[int(np.argmax(np.linalg.norm(arm, axis=1)))]
    angle = np.arctan2(arm @ np.cross(normal, first), arm @ first)
    return [names[k] for k in np.argsort(angle, kind="stable").tolist()]


def _cell(places: Floats, loops: list[list[int]]) -> ConvexCell:
    """Return the polyhedron of loops, with only the vertices that they use; places: (k, 3)."""
    used = sorted({vertex for loop in loops for vertex in loop})
    number = {vertex: k for k, vertex in enumerate(used)}
    return ConvexCell(places[used], tuple(tuple(number[vertex] for vertex in loop) for loop in loops))


def inside(cell: ConvexCell, planes: Sequence[Plane]) -> ConvexCell | None:
    """Return the part of a cell inside all planes; None if it is empty."""
    left: ConvexCell | None = cell
    for plane in planes:
        if left is not None:
            left = left.cut(plane)[0]
    return left


def subtract(cell: ConvexCell, planes: Sequence[Plane]) -> tuple[ConvexCell | None, list[ConvexCell]]:
    """Cut a cell by successive planes; return the part inside all, and the parts cut off."""
    left: ConvexCell | None = cell
    parts = []
    for plane in planes:
        if left is None:
            break
        left, outside = left.cut(plane)
        if outside is not None:
            parts.append(outside)
    return left, parts
