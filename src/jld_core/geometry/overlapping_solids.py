"""Refuse solids that share a volume."""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.geometry.misfits import Overlap, refuse_overlaps
from jld_core.geometry.polyhedra import Facets, spread


def check_overlaps(ids: list[str], vertices: list[Floats], facets: Facets, pairs: tuple[Ints, Ints]) -> None:
    """Refuse convex polyhedra that share a volume.

    Pairs with a polyhedron that is not convex are not checked.

    ids: names of the n elements. vertices: vertices of each element, scene units. facets: facets of all elements.
    pairs: elements whose bounding boxes touch. Raises InputError: elements overlap; the message names the pairs, depth
    and place.

    Two elements are apart where all of one lies in front of a facet of the other. For the few remaining pairs, a linear
    program finds the largest ball within both.
    """
    lower = np.array([v.min(axis=0) for v in vertices])
    upper = np.array([v.max(axis=0) for v in vertices])
    span = (upper - lower).max(axis=1)
    a, b = pairs
    reach = tolerances.FACE * np.minimum(span[a], span[b])
    deep = np.all(np.minimum(upper[a], upper[b]) - np.maximum(lower[a], lower[b]) > reach[:, None], axis=1)
    a, b, reach = a[deep], b[deep], reach[deep]
    if not len(a):
        return
    points = np.concatenate(vertices)
    corners = np.array([len(v) for v in vertices])
    first_corner = np.concatenate([[0], np.cumsum(corners)])[:-1]
    count = np.bincount(facets.element, minlength=len(ids))
    start = np.concatenate([[0], np.cumsum(count)])[:-1]

    def heights(facet: Ints, other: Ints) -> tuple[Floats, Floats]:
        """Return the least and greatest height of an element's vertices above each facet's plane."""
        owner, corner = spread(first_corner[other], corners[other])
        height = np.einsum("ij,ij->i", points[corner] - facets.origin[facet[owner]], facets.normal[facet[owner]])
        begin = np.concatenate([[0], np.cumsum(corners[other])])[:-1]
        return np.minimum.reduceat(height, begin), np.maximum.reduceat(height, begin)

    bulge = np.concatenate(
        [
            heights(part, facets.element[part])[1]
            for part in np.array_split(np.arange(len(facets)), 1 + len(facets) // 50_000)
        ]
    )
    convex = np.maximum.reduceat(bulge, start) <= tolerances.FACE * span
    both = convex[a] & convex[b]
    found = []
    a, b, reach = a[both], b[both], reach[both]
    for part in np.array_split(np.arange(len(a)), 1 + len(a) // 10_000):
        apart = np.zeros(len(part), dtype=bool)
        for one, two in ((a[part], b[part]), (b[part], a[part])):
            if len(part):
                owner, facet = spread(start[one], count[one])
                lowest = heights(facet, two[owner])[0]
                apart |= np.bincount(owner, weights=lowest >= -reach[part][owner], minlength=len(part)) > 0.0
        for index in part[~apart].tolist():
            planes = np.flatnonzero((facets.element == a[index]) | (facets.element == b[index]))
            radius, place = _ball(facets, planes)
            if radius > 0.5 * reach[index]:
                found.append(Overlap(ids[a[index]], ids[b[index]], 2.0 * radius, place))
    refuse_overlaps(found, "elements that touch along faces at the most")


def _ball(facets: Facets, planes: Ints) -> tuple[float, Floats]:
    """Return radius and centre of the largest ball behind all planes.

    The radius is negative where no such ball exists.
    """
    normal, middle = facets.normal[planes], facets.origin[planes].mean(axis=0)
    behind = np.einsum("ij,ij->i", facets.origin[planes] - middle, normal)
    rows = np.column_stack([normal, np.ones(len(planes))])
    from scipy.optimize import linprog  # loaded on first use: it takes longer than reading most scenes

    answer = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=behind, bounds=[(None, None)] * 4)
    place = middle if answer.x is None else middle + answer.x[:3]
    return -float(answer.fun or 0.0), np.asarray(place)
