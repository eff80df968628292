"""Merge points that lie within a tolerance of one another."""

from __future__ import annotations

import itertools

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.linalg import components


def merge_points(points: Floats, tolerance: float) -> Ints:
    """Assign points to numbered nodes; a point joins the first node within the tolerance.

    Nodes are more than the tolerance apart, and no point is further than the tolerance from its node: chains of
    points do not merge.

    Parameters
    ----------
    points : (n, d) array
        Coordinates.
    tolerance : float
        Length; 0 merges equal points only.

    Returns
    -------
    (n,) int array
        Node of each point, numbered by first appearance.
    """
    unique, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    point = rank[inverse.reshape(-1)]
    if tolerance <= 0.0:
        return point
    ordered = unique[order]
    cluster = _clusters(ordered, tolerance)
    leader = np.unique(cluster, return_index=True)[1][cluster]
    # Points all within the tolerance of the first one of their cluster join it.
    chain = np.zeros(len(leader), dtype=bool)
    chain[leader[np.linalg.norm(ordered - ordered[leader], axis=1) > tolerance]] = True
    chained = np.flatnonzero(chain[leader])
    leader[chained] = chained[_first_within(ordered[chained], tolerance)]
    return np.unique(leader, return_inverse=True)[1][point]


def _clusters(points: Floats, tolerance: float) -> Ints:
    """Return the cluster (n,) of each point; clusters are further apart than the tolerance.

    points: (n, d). Clusters are numbered by their first points.
    """
    one, two = [], []
    # Coordinates that differ by less than half a box lie in one box of one of two grids shifted by half a box.
    with np.errstate(over="ignore"):
        scaled = points / max(2.01 * tolerance, 1e-300)
    for shift in itertools.product((0.0, 0.5), repeat=points.shape[1]):
        box = np.floor(scaled + np.array(shift))
        order = np.lexsort(box.T)
        same = np.flatnonzero(np.all(box[order[1:]] == box[order[:-1]], axis=1))
        one.append(order[same])
        two.append(order[same + 1])
    return components(len(points), np.concatenate(one), np.concatenate(two))


def _first_within(points: Floats, tolerance: float) -> Ints:
    """Return the index (n,) of the point (n, d) that each point joins, one after the other.

    A point joins the first one within the tolerance that joined none, else it joins none and keeps its own index.
    """
    width = max(tolerance, 1e-300)
    # Boxes are as wide as the tolerance, so that all candidates lie in neighbouring boxes: no search is needed.
    boxes: dict[tuple[int, ...], list[int]] = {}
    joined = np.arange(len(points))
    around = np.array(np.meshgrid(*[[-1, 0, 1]] * points.shape[1])).reshape(points.shape[1], -1).T
    for index, point in enumerate(points):
        with np.errstate(over="ignore"):
            box = np.floor(point / width)
        near = [k for step in around for k in boxes.get(tuple(box + step), ())]
        close = [k for k in near if np.linalg.norm(points[k] - point) <= tolerance]
        if close:
            joined[index] = min(close)
        else:
            boxes.setdefault(tuple(box), []).append(index)
    return joined
