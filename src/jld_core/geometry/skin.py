"""Boundary of the union of solid elements: the faces that no two of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.geometry.rings import PLACE, SNAP, straightened
from jld_core.geometry.vectors import across, area_vector


@dataclass(frozen=True)
class Facet:
    """Face of a solid element, prepared for the union of elements.

    ring: (k, 3) corners in order, scene units. normal: (3,) unit normal, outwards. offset: distance of the plane from
    the origin along the normal. area: area, scene units. corners: corners in grid steps: equal for a face of a
    neighbour that covers this one exactly.
    """

    ring: Floats
    normal: Floats
    offset: float
    area: float
    corners: frozenset[tuple[int, ...]]

    @property
    def length(self) -> float:
        """Return the length of the boundary, scene units."""
        return float(np.linalg.norm(np.diff(self.ring, axis=0, append=self.ring[:1]), axis=1).sum())


def facets_of(corners: Floats, faces: tuple[tuple[int, ...], ...], step: float) -> list[Facet]:
    """Prepare the faces of a solid element.

    corners: (k, 3). faces: corners of each face in order. step: grid width to which corners are rounded.
    """
    places = [tuple(place) for place in np.floor(corners / step + PLACE).astype(np.int64).tolist()]
    found = []
    for loop in faces:
        ring = corners[list(loop)]
        vector = area_vector(ring)
        area = float(np.linalg.norm(vector))
        normal = vector / area
        offset = float(ring.mean(axis=0) @ normal)
        found.append(Facet(ring, normal, offset, area, frozenset(places[k] for k in loop)))
    return found


def skin(facets: Sequence[Facet], reach: float) -> list[Floats]:
    """Compute the boundary loops (k, 3) of the outer faces of a union of solids.

    facets: faces of all solids. Parts of faces that two solids share are left out, and so are corners in straight
    edges. reach: distance from the line of its neighbours within which a corner is left out, and width up to which a
    face is.
    """
    seen: dict[frozenset[tuple[int, ...]], Facet] = {}
    for facet in facets:
        # two solids that share a whole face have it with opposite normals
        other = seen.get(facet.corners)
        if other is not None and other.normal @ facet.normal < 0.0:
            del seen[facet.corners]
        else:
            seen[facet.corners] = facet
    found: list[Floats] = []
    for members in _planes(list(seen.values()), reach):
        if len(members) > 1:
            found += _united(members, reach)
        elif members[0].area > reach * members[0].length:
            plane = across(members[0].normal)
            flat = straightened(members[0].ring @ plane.T, reach)
            found.append(flat @ plane + members[0].offset * members[0].normal)
    return found


def _planes(facets: Sequence[Facet], reach: float) -> list[list[Facet]]:
    """Group facets by the plane they lie in, with normals of either sense.

    reach: largest distance of the middle of a facet from the plane of the first one.
    """
    normals = np.array([facet.normal for facet in facets])
    middles = np.array([facet.ring.mean(axis=0) for facet in facets])
    found, left = [], np.ones(len(facets), dtype=bool)
    for k, facet in enumerate(facets):
        if not left[k]:
            continue
        parallel = abs(abs(normals @ facet.normal) - 1.0) < 1e-9
        here = left & parallel & (abs(middles @ facet.normal - facet.offset) < reach)
        here[k] = True
        left &= ~here
        found.append([facets[j] for j in np.flatnonzero(here).tolist()])
    return found


def _united(facets: Sequence[Facet], reach: float) -> list[Floats]:
    """Unite the facets of one plane, and return the boundary loops (k, 3) of their regions.

    Regions where facets of opposite normals meet lie inside the union of solids and are left out. reach: see `skin`.
    """
    normal, offset, grid = facets[0].normal, facets[0].offset, SNAP * reach
    plane = across(normal)
    members: tuple[list[shapely.Polygon], list[shapely.Polygon]] = ([], [])
    for facet in facets:
        members[int(facet.normal @ normal < 0.0)].append(shapely.Polygon(facet.ring @ plane.T))
    front, back = (shapely.union_all(side, grid_size=grid) for side in members)
    outer = [front]
    if members[1]:
        outer = [shapely.difference(*pair, grid_size=grid) for pair in ((front, back), (back, front))]
    found = []
    for part in [part for region in outer for part in shapely.get_parts(region)]:
        if part.geom_type != "Polygon" or part.area <= reach * part.length:
            continue
        for ring in [part.exterior, *part.interiors]:
            flat = straightened(shapely.get_coordinates(ring)[:-1], reach)
            found.append(flat @ plane + offset * normal)
    return found
