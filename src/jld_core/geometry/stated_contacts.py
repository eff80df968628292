"""Normals of contacts that a scene states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.errors import InputError
from jld_core.geometry import polygons as measures
from jld_core.geometry.facet_planes import FacetFrames, project, regions_in_planes
from jld_core.geometry.polyhedra import Facets, spread


def given_normals(polygons: list[Floats], a: Ints, facets: Facets, where: Callable[[int], str]) -> Floats:
    """Compute the unit normals of stated contacts, out of element a of each.

    The stated polygon gives the direction. The face of a that it lies on only gives the sign.

    polygons: corners of the m contacts in order, k ≥ 3. a: (m,) index of the first element of each contact. facets:
    facets of all elements. where: maps the index of a contact to its key in the scene, for error messages. Returns (m,
    3). Raises InputError: a contact has no area, or its corners do not lie in a plane.
    """
    normal, place, size = np.empty((len(a), 3)), np.empty((len(a), 3)), np.empty(len(a))
    for chosen, stack in measures.by_corner_count(polygons):
        arm = stack - stack[:, :1]
        vector = 0.5 * np.cross(arm, np.roll(arm, -1, axis=1)).sum(axis=1)
        amount = np.linalg.norm(vector, axis=1)
        extent = np.ptp(stack, axis=1).max(axis=1)
        for index in chosen[~(2.0 * amount > tolerances.FACE * extent**2)][:1]:
            raise InputError(f"{where(int(index))}.polygon", "it has no area", "three or more corners in order")
        normal[chosen] = vector / amount[:, None]
        height = np.abs(np.einsum("nkj,nj->nk", stack - stack.mean(axis=1)[:, None], normal[chosen])).max(axis=1)
        for index in chosen[height > tolerances.FACE * extent][:1]:
            raise InputError(f"{where(int(index))}.polygon", "its corners do not lie in a plane", "a plane polygon")
        place[chosen], size[chosen] = stack.mean(axis=1), extent
    return normal * _sides(normal, place, size, a, facets)[:, None]


def _sides(normal: Floats, place: Floats, size: Floats, a: Ints, facets: Facets) -> Floats:
    """Return the sense (m,) of each contact's normal: +1 if it points out of element a, or −1.

    The nearest face of a decides. normal: (m, 3). place: (m, 3) a point of each contact. size: (m,) of the contacts,
    lengths. a: (m,) element of each contact.
    """
    count = np.bincount(facets.element)
    start = np.concatenate([[0], np.cumsum(count)])[:-1]
    owner, facet = spread(start[a], count[a])
    cosine = np.einsum("ij,ij->i", normal[owner], facets.normal[facet])
    off = np.abs(np.einsum("ij,ij->i", place[owner] - facets.origin[facet], facets.normal[facet]))
    outside = np.maximum(facets.lower[facet] - place[owner], place[owner] - facets.upper[facet]).max(axis=1)
    # A body may have faces of both directions in one plane: count the distance of the place from a face's box too.
    far = np.where(np.abs(cosine) < 0.9, np.inf, off + np.maximum(outside, 0.0))
    best = np.minimum.reduceat(far, np.concatenate([[0], np.cumsum(count[a])])[:-1])
    close = far <= (best + tolerances.FACE * size)[owner]
    vote = np.where(close & np.isfinite(far), np.sign(cosine), 0.0)
    plus = np.bincount(owner, weights=np.maximum(vote, 0.0), minlength=len(a))
    minus = np.bincount(owner, weights=np.maximum(-vote, 0.0), minlength=len(a))
    side = np.where(plus >= minus, 1.0, -1.0)
    unclear = np.flatnonzero((plus > 0.0) == (minus > 0.0)).tolist()
    if not unclear:
        return side
    frames = FacetFrames.on(facets)
    for index in unclear:
        # Boxes are ambiguous here: measure distances to the faces themselves, of any direction if none is parallel.
        rows = np.flatnonzero(owner == index)
        distance = []
        for row in rows:
            which = facet[[row]]
            spot = project(place[[index]], facets, frames, which)
            region = regions_in_planes(facets, frames, which, which)[0]
            distance.append(
                off[row] + shapely.distance(region, shapely.Point(spot[0])) + size[index] * (1.0 - abs(cosine[row]))
            )
        nearest = rows[int(np.argmin(distance))]
        side[index] = 1.0 if cosine[nearest] >= 0.0 else -1.0
    return np.asarray(side)
