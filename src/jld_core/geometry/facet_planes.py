"""Local frames of facets, and facets as shapely polygons in the planes of other facets."""

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
"""Tolerance for parallel sides (sine of the angle) and for rectangles (share of the diagonals)."""


@dataclass(frozen=True)
class FacetFrames:
    """Two axes in the plane of each of f facets, and which facets are rectangles.

    e1: (f, 3) unit vectors along the longest edge. e2: (f, 3) normal × e1. rectangle: (f,) True for rectangles without
    holes, within the tolerance `PARALLEL`.
    """

    e1: Floats
    e2: Floats
    rectangle: Bools

    @classmethod
    def on(cls, facets: Facets) -> FacetFrames:
        """Compute the axes of all facets."""
        e1 = np.empty((len(facets), 3))
        rectangle = np.zeros(len(facets), dtype=bool)
        for chosen, stack in measures.by_corner_count([loops[0] for loops in facets.loops]):
            e1[chosen] = longest_edge(stack)
            simple = np.array([len(facets.loops[index]) == 1 for index in chosen])
            rectangle[chosen] = simple & measures.is_rectangle(stack, PARALLEL)
        e1 = unit_vectors(e1 - np.einsum("ij,ij->i", e1, facets.normal)[:, None] * facets.normal)
        return cls(e1, np.cross(facets.normal, e1), rectangle)


def unit_vectors(vectors: Floats) -> Floats:
    """Scale vectors (…, d) to unit length; none of them may be zero."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def longest_edge(polygons: Floats) -> Floats:
    """Return the unit direction (n, 3) of the longest edge of each polygon (n, k, 3).

    Among edges of equal length the first one counts.
    """
    edge = np.roll(polygons, -1, axis=1) - polygons
    length = np.linalg.norm(edge, axis=2)
    first = np.argmax(length >= (1.0 - 1e-9) * length.max(axis=1)[:, None], axis=1)
    return unit_vectors(edge[np.arange(len(edge)), first])


def regions_in_planes(facets: Facets, frames: FacetFrames, which: Ints, plane: Ints) -> Sequence[shapely.Geometry]:
    """Return facets as shapely polygons in the planes of other facets.

    which: (k,) indices of the facets to convert. plane: (k,) index of the facet whose axes give the coordinates of
    each. Holes are kept. Invalid polygons are replaced by the polygons that their area consists of.
    """
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
        # Remaining lines and points have no area, and shapely does not intersect them together with polygons.
        regions[position] = area_of(regions[position])
    return regions  # type: ignore[no-any-return]


def project(points: Floats, facets: Facets, frames: FacetFrames, plane: Ints) -> Floats:
    """Project points to coordinates (k, 2) in the planes of facets.

    points: (k, 3). plane: (k,) index of the facet for each point; its origin and axes in `frames` give the coordinates.
    """
    arm = points - facets.origin[plane]
    return np.column_stack([np.einsum("ij,ij->i", arm, frames.e1[plane]), np.einsum("ij,ij->i", arm, frames.e2[plane])])
