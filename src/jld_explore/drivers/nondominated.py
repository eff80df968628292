"""Non-dominated fronts of labellings, and crowding on them, as in NSGA-II.

Source: Deb et al. 2002.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints

_PAIRS: Final = 1 << 22  # largest number of pairs compared in one step; limits temporary memory to some 10 MB


def fronts_of(values: Floats, enough: int) -> list[Ints]:
    """Sort objective values into non-dominated fronts until enough rows are ranked.

    A row dominates another if it is nowhere larger and somewhere smaller. The first front holds the rows that none
    dominates, each further front those that only rows of earlier fronts dominate. Equal rows share a front.

    values: (k, c) objective values, to be minimised. enough: number of rows after which no further front is formed.
    Result: positions of the rows of each front in ascending order, best front first.

    Deb et al. 2002, section III.A: count the rows that dominate each row, and take away the fronts one by one. Up to
    two objectives take O(k log k), more take O(k² c).
    """
    if values.shape[1] <= 2:
        rank = _ranks_of_pairs(values)
        order = np.argsort(rank, kind="stable")
        begins = np.flatnonzero(np.diff(rank[order])) + 1
        return np.split(order, begins)[: int(np.searchsorted(begins, enough)) + 1]
    left = _dominators(values, np.arange(len(values)))
    fronts: list[Ints] = []
    ranked = 0
    front = np.flatnonzero(left == 0)
    while len(front) and ranked < enough:
        fronts.append(front)
        ranked += len(front)
        left -= _dominators(values, front)
        left[front] = -1
        front = np.flatnonzero(left == 0)
    return fronts


def _ranks_of_pairs(values: Floats) -> Ints:
    """Return the front number of each row of values (k, 1 or 2)."""
    order = np.lexsort(values.T[::-1])
    rows = values[order]
    new = np.append(True, (rows[1:] != rows[:-1]).any(axis=1)).tolist()
    least: list[float] = []  # Smallest last value on each front, ascending: an earlier row with one as small dominates.
    rank = np.empty(len(values), dtype=np.int64)
    place = 0
    for position, value, differs in zip(order.tolist(), rows[:, -1].tolist(), new, strict=True):
        if differs:
            place = bisect_right(least, value)
            least[place : place + 1] = [value]
        rank[position] = place
    return rank


def _dominators(values: Floats, rivals: Ints) -> Ints:
    """Count for each row of values (k, c) the rivals, given by position, that dominate it."""
    found = np.zeros(len(values), dtype=np.int64)
    step = max(1, _PAIRS // max(1, len(values)))
    for start in range(0, len(rivals), step):
        some = values[rivals[start : start + step]]
        weak: Bits = np.ones((len(some), len(values)), dtype=bool)
        strict: Bits = np.zeros((len(some), len(values)), dtype=bool)
        for column in range(values.shape[1]):
            weak &= some[:, column, None] <= values[:, column]
            strict |= some[:, column, None] < values[:, column]
        found += np.count_nonzero(weak & strict, axis=0)
    return found


def crowding_of(values: Floats, front: Floats) -> Floats:
    """Return the crowding distance of each labelling on its front.

    Selection prefers labellings of large distance. It is infinite at the ends of a front, and 0 for labellings of equal
    values between others.

    values: (k, c) objective values. front: (k,) front number of each labelling. Returns (k,): crowding distances: mean
    over the objectives of the distance between both neighbours, in widths of the front.

    Deb et al. 2002, section III.B, for all fronts at once.
    """
    found = np.zeros(len(values))
    for column in values.T if len(values) else ():
        order = np.lexsort((column, front))
        own, name = column[order], front[order]
        begins = np.append(True, name[1:] != name[:-1])
        first, last = np.flatnonzero(begins), np.flatnonzero(np.append(begins[1:], True))
        gap = np.diff(own)
        before, after = np.append(np.inf, gap), np.append(gap, np.inf)
        before[first] = after[last] = np.inf
        width = np.repeat(own[last] - own[first], last - first + 1)
        found[order] += np.divide(before + after, width, out=np.zeros(len(own)), where=width > 0.0)
    found /= max(1, values.shape[1])
    return found
