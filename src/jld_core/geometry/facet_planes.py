"""Facets in the planes of facets: local frames, and regions as shapely has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.geometry import polygons as measures
from jld_core.geometry.overlay import area_of
from jld_core.geometry.polyhedra import Facets

PARALLEL: Final = 1e-9
"""Sine of the angle, and share of the diagonals, up to which sides count as parallel and a facet as a rectangle."""


@dataclass(frozen=True)
class FacetFrames:
    """Per facet: e1 (f, 3) along its longest edge, e2 = n × e1, and whether it is exactly a rectangle."""

    e1: Floats
    e2: Floats
    rectangle: Bools

    @classmethod
    def on(cls, facets: Facets) -> FacetFrames:
        e1 = np.empty((len(facets), 3))
        rectangle = np.zeros(len(facets), dtype=bool)
        for chosen, stack in measures.by_corner_count([loops[0] for loops in facets.loops]):
            e1[chosen] = longest_edge(stack)
            simple = np.array([len(facets.loops[index]) == 1 for index in chosen])
            rectangle[chosen] = simple & measures.is_rectangle(stack, PARALLEL)
        e1 = unit_vectors(e1 - np.einsum("ij,ij->i", e1, facets.normal)[:, None] * facets.normal)
        return cls(e1, np.cross(facets.normal, e1), rectangle)


def unit_vectors(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def longest_edge(polygons: Floats) -> Floats:
    """Unit direction (n, 3) of the longest edge of each polygon (n, k, 3), the first among equals."""
    edge = np.roll(polygons, -1, axis=1) - polygons
    length = np.linalg.norm(edge, axis=2)
    first = np.argmax(length >= (1.0 - 1e-9) * length.max(axis=1)[:, None], axis=1)
    return unit_vectors(edge[np.arange(len(edge)), first])


def regions_in_planes(facets: Facets, frames: FacetFrames, which: Ints, plane: Ints) -> Sequence[shapely.Geometry]:
    """Facets `which` as shapely polygons in the planes of facets `plane`."""
    shells = [facets.loops[index][0] for index in which]
    count = np.array([len(shell) for shell in shells])
    owner = np.repeat(np.arange(len(which)), count)
    flat = project(np.concatenate(shells), facets, frames, plane[owner])
    regions = shapely.polygons(shapely.linearrings(flat, indices=owner))
    for position in [k for k, index in enumerate(which) if len(facets.loops[index]) > 1]:
        at = plane[position]
        rings = [project(loop, facets, frames, np.full(len(loop), at)) for loop in facets.loops[which[position]]]
        regions[position] = shapely.Polygon(rings[0], rings[1:])
    for position in np.flatnonzero(~shapely.is_valid(regions)).tolist():
        # lines and points that are left over have no area, and intersections do not take them beside polygons
        regions[position] = area_of(regions[position])
    return regions  # type: ignore[no-any-return]


def project(points: Floats, facets: Facets, frames: FacetFrames, plane: Ints) -> Floats:
    """Coordinates (k, 2) of points (k, 3) in the frames of facets plane (k,), about their origins."""
    arm = points - facets.origin[plane]
    return np.column_stack([np.einsum("ij,ij->i", arm, frames.e1[plane]), np.einsum("ij,ij->i", arm, frames.e2[plane])])
