"""Surfaces of convex cells, cut along interfaces and load patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry import facets_of
from jld_core.geometry.facet_planes import FacetFrames
from jld_core.linalg import components


@dataclass(frozen=True)
class Facet:
    """Plane face of a free cell.

    cell: element. origin: (3,) point of the plane. normal: (3,) outward unit vector. e1, e2: (3,) unit vectors of the
    plane. ring: (k,) nodes of the outline, counter-clockwise from outside. faces: interfaces on it.
    """

    cell: int
    origin: Floats
    normal: Floats
    e1: Floats
    e2: Floats
    ring: Ints
    faces: tuple[int, ...]

    def flat(self, places: Floats) -> Floats:
        """Convert places (k, 3) to coordinates (k, 2) along e1 and e2 from the origin."""
        arm = places - self.origin
        return np.column_stack([arm @ self.e1, arm @ self.e2])

    def placed(self, flat: Floats) -> Floats:
        """Convert coordinates (k, 2) along e1 and e2 from the origin to places (k, 3)."""
        return np.asarray(self.origin + flat[:, :1] * self.e1 + flat[:, 1:] * self.e2)


@dataclass(frozen=True)
class Patch:
    """Part of a facet that carries a live traction.

    facet: index of the facet. rings: corners (k, 3) of the outline, then of each hole, scene units.
    """

    facet: int
    rings: tuple[Floats, ...]


@dataclass(frozen=True)
class Surface:
    """Surfaces of all free cells, cut along interfaces and load patches, over common nodes.

    points: (p, 3) nodes, scene units. facets: facets of all free cells. faces: nodes of the outline of each of the m
    interfaces, None between two supports. patches: for each load patch its facet, and the nodes of its outline and
    holes. reach: distance up to which two points count as one node, scene units.
    """

    points: Floats
    facets: tuple[Facet, ...]
    faces: tuple[Ints | None, ...]
    patches: tuple[tuple[int, tuple[Ints, ...]], ...]
    reach: float

    def covered(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the interfaces on a facet as polygons, in the coordinates of `Facet.flat`."""
        return [
            shapely.Polygon(facet.flat(self.points[ring])) for f in facet.faces if (ring := self.faces[f]) is not None
        ]

    def free(self, facet: Facet) -> list[shapely.Polygon]:
        """Return the regions of a facet outside its interfaces, as polygons in the plane.

        Load patches are not cut out. Slivers thinner than about `reach` are left out.
        """
        whole = shapely.Polygon(facet.flat(self.points[facet.ring]))
        rest = shapely.difference(whole, shapely.union_all(self.covered(facet)))
        return [part for part in shapely.get_parts(rest) if part.area > self.reach * part.length]

    def loaded(self, index: int) -> list[shapely.Polygon]:
        """Return the load patches on facet number `index` as polygons in the plane."""
        flat = self.facets[index].flat
        rings = [[flat(self.points[ring]) for ring in loops] for place, loops in self.patches if place == index]
        return [shapely.Polygon(outer, holes) for outer, *holes in rings]


def surface_of(assembly: Assembly, patches: tuple[Patch, ...] = (), more: Floats | None = None) -> Surface:
    """Return the surfaces of the free cells of a spatial assembly.

    assembly: spatial assembly. patches: load patches, whose corners become nodes. more: (k, 3) further places that
    become nodes. Result: corners of cells, interfaces and patches within the reach are one node. Raises InputError: a
    cell that is not convex or has a face that is not plane.
    """
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    facets = facets_of([elements.shape[k] for k in free], [elements.faces[k] for k in free])
    frames = FacetFrames.on(facets)
    reach = 2.0 * tolerances.FACE * float(np.ptp(np.array([elements.lower[free], elements.upper[free]]), axis=0).min())
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        height = (elements.shape[cell] - facets.origin[index]) @ facets.normal[index]
        own = (facets.loops[index][0] - facets.origin[index]) @ facets.normal[index]
        if len(facets.loops[index]) > 1 or height.max() > reach or own.min() < -reach:
            raise InputError(
                f"element {elements.ids[cell]!r}",
                "fields in space fill convex cells with plane faces, and it is none",
                "a convex element, or several of them",
            )
    loops = [facets.loops[k][0] for k in range(len(facets))]
    every = [*loops, *faces.polygon, *(ring for patch in patches for ring in patch.rings)]
    points, number = _merged(np.concatenate([*every, np.zeros((0, 3)) if more is None else more]), reach)
    split = np.split(number, np.cumsum([len(one) for one in every]))[:-1]
    rings = [ring_of(points, corners, reach) for corners in split]
    free_side = ~(elements.support[faces.a] & elements.support[faces.b])
    face_rings = rings[len(loops) : len(loops) + len(faces)]
    made = []
    for index in range(len(facets)):
        cell = int(free[facets.element[index]])
        origin, normal = facets.origin[index], facets.normal[index]
        on = []
        for face in np.flatnonzero((faces.a == cell) | (faces.b == cell)).tolist():
            outward = faces.normal[face] if faces.a[face] == cell else -faces.normal[face]
            off = abs((points[face_rings[face]] - origin) @ normal).max()
            if outward @ normal > 0.5 and off <= 2.0 * reach:
                on.append(face)
        made.append(Facet(cell, origin, normal, frames.e1[index], frames.e2[index], rings[index], tuple(on)))
    chosen = tuple(ring if ok else None for ring, ok in zip(face_rings, free_side, strict=True))
    rest = iter(rings[len(loops) + len(faces) :])
    placed = tuple((patch.facet, tuple(next(rest) for _ in patch.rings)) for patch in patches)
    return Surface(points, tuple(made), chosen, placed, reach)


def _merged(places: Floats, reach: float) -> tuple[Floats, Ints]:
    """Merge places (k, 3) within `reach`; return points (p, 3) and the point (k,) of each."""
    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    group = components(len(places), pairs[:, 0], pairs[:, 1])
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return places[first], np.asarray(number)


def ring_of(points: Floats, corners: Ints, reach: float) -> Ints:
    """Return the nodes of a closed polygon: its corners, and all nodes on its edges, in order.

    points: (p, 3) nodes. corners: (k,) nodes of the polygon. reach: distance from an edge within which a node lies on
    it.
    """
    corners = corners[corners != np.roll(corners, 1)]
    nodes: list[int] = []
    for a, b in zip(corners.tolist(), np.roll(corners, -1).tolist(), strict=True):
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        away = points - points[a]
        place = away @ (along / length)
        off = np.linalg.norm(away - place[:, None] * (along / length), axis=1)
        between = np.flatnonzero((off <= reach) & (place > reach) & (place < length - reach))
        nodes += [a, *between[np.argsort(place[between])].tolist()]
    return np.array(nodes, dtype=np.int64)
