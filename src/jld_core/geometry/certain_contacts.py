"""Count contacts that corners and bounding boxes alone prove."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.geometry.merging import merge_points
from jld_core.geometry.polyhedra import Faces, Surface, lay_out
from jld_core.geometry.spatial_contacts import near_pairs


def certain_contacts(vertices: list[Floats], faces: list[Faces], support: Bools) -> int:
    """Count pairs of polyhedra that certainly share a contact.

    Counted are pairs with a face of equal corners, or pairs of boxes along the axes that touch; the larger count is
    returned. Pairs of two supports are left out.

    vertices: vertices of each of n elements, scene units. faces: loops of vertex indices of each element. support: (n,)
    True for supports. Result: lower bound on the number of interfaces of the scene.
    """
    surface = lay_out(vertices, faces)
    begin = np.concatenate([[0], np.cumsum([len(v) for v in vertices])])[:-1]
    lower = np.minimum.reduceat(surface.points, begin)
    upper = np.maximum.reduceat(surface.points, begin)
    found = (_equal_faces(surface, upper - lower), _touching_boxes(surface, lower, upper, vertices))
    return max(int(np.count_nonzero(~(support[one] & support[two]))) for one, two in found)


def _equal_faces(surface: Surface, sides: Floats) -> tuple[Ints, Ints]:
    """Return the distinct pairs (p,) of elements that have a face of the same corners.

    sides: (n, 3) sides of the elements' bounding boxes.
    """
    node = merge_points(surface.points, tolerances.FACE * float(sides.max(axis=1).min()))[surface.vertex]
    pairs = []
    for corners in np.unique(surface.count).tolist():
        which = np.flatnonzero(surface.count == corners)
        keys = np.sort(node[surface.start[which, None] + np.arange(corners)], axis=1)
        order = np.lexsort(keys.T)
        same = np.flatnonzero(np.all(keys[order[1:]] == keys[order[:-1]], axis=1))
        owner = surface.element[which[order]]
        pairs.append(np.sort(np.stack([owner[same], owner[same + 1]], axis=1), axis=1))
    both = np.concatenate(pairs)
    one, two = np.unique(both[both[:, 0] < both[:, 1]], axis=0).T
    return one, two


def _touching_boxes(surface: Surface, lower: Floats, upper: Floats, vertices: Sequence[Floats]) -> tuple[Ints, Ints]:
    """Return the pairs (p,) of boxes along the axes that touch along an area.

    lower, upper: (n, 3) corners of the elements' bounding boxes.
    """
    size = (upper - lower).max(axis=1)
    owner = np.repeat(np.arange(len(size)), [len(v) for v in vertices])
    off = np.minimum(np.abs(surface.points - lower[owner]), np.abs(upper[owner] - surface.points)).max(axis=1)
    wrong = np.bincount(owner, weights=off > tolerances.FACE * size[owner], minlength=len(size))
    # Six faces whose corners are all corners of the bounding box, eight of them: a box.
    six = np.bincount(surface.element, minlength=len(size)) == 6
    eight = np.bincount(owner, minlength=len(size)) == 8
    box = np.flatnonzero((wrong == 0.0) & six & eight)
    if len(box) < 2:
        return box[:0], box[:0]
    reach = tolerances.FACE * size
    left, right = near_pairs(lower[box], upper[box], reach[box])
    one, two = box[left], box[right]
    depth = np.sort(np.minimum(upper[one], upper[two]) - np.maximum(lower[one], lower[two]), axis=1)
    touching = (np.abs(depth[:, 0]) <= np.minimum(reach[one], reach[two])) & (depth[:, 1] > 1e2 * reach[one])
    return one[touching], two[touching]
