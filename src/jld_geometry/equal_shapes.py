"""Equations on distances of corners that keep elements congruent while joints move."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints

# Difference of distances of corners, relative to the larger element, up to which two elements are equal
_EQUAL: Final = 1e-6


def equal_corners(outlines: list[Ints], places: Floats, changing: Bools) -> list[tuple[Ints, Ints]]:
    """Pair equal outlines corner by corner: the first of each kind with every further one.

    Elements are equal if one is the other moved, turned or mirrored. Kinds without an element that changes are left
    out.

    outlines: vertices of the corners around each element. places: (v, 2) positions. changing: (n,) True for elements
    with a vertex that moves. Each pair holds two equally long arrays of vertices.
    """
    kinds: list[list[tuple[int, Ints]]] = []
    for element, outline in enumerate(outlines):
        for kind in kinds:
            match = _matched(places, kind[0][1], outline)
            if match is not None:
                kind.append((element, match))
                break
        else:
            kinds.append([(element, outline)])
    return [
        (kind[0][1], other) for kind in kinds if any(changing[element] for element, _ in kind) for _, other in kind[1:]
    ]


def _matched(places: Floats, one: Ints, other: Ints) -> Ints | None:
    """Reorder the corners `other` to match an equal outline `one`; None if they are not equal.

    places: (v, 2) positions. one, other: vertices around two elements.
    """
    if len(one) != len(other):
        return None
    wanted = _distances(places[one])
    for way in (other, other[::-1]):
        for shift in range(len(way)):
            turned = np.roll(way, -shift)
            if abs(_distances(places[turned]) - wanted).max() <= _EQUAL * wanted.max():
                return turned
    return None


def _distances(corners: Floats) -> Floats:
    """Return the distances (k, k) between corners (k, 2)."""
    return np.asarray(np.linalg.norm(corners[:, None] - corners[None], axis=2))


class EqualShapes:
    """Equations that keep pairs of outlines equal, by squared distances of corners.

    Each equation keeps the difference of two squared distances as it is at the start.

    Of an outline with k corners, the k edges and the k − 3 diagonals from its first corner are compared.

    pairs: equal outlines, corner by corner. places: (v, 2) positions at the start.
    """

    def __init__(self, pairs: list[tuple[Ints, Ints]], places: Floats) -> None:
        rows = []
        for one, other in pairs:
            ends = [(k, (k + 1) % len(one)) for k in range(len(one))] + [(0, k) for k in range(2, len(one) - 1)]
            rows += [[one[i], one[j], other[i], other[j]] for i, j in ends]
        self._rows: Ints = np.array(rows, dtype=np.int64).reshape(-1, 4)
        self._unit = np.linalg.norm(places[self._rows[:, 1]] - places[self._rows[:, 0]], axis=1) ** 2
        self._start, _ = self._differences(places)

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, places: Floats) -> tuple[Floats, sp.csr_array]:
        """Return the values (r,) of the equations and their derivatives (r, 2v).

        places: (v, 2) positions.
        """
        values, slopes = self._differences(places)
        columns = (2 * self._rows[:, :, None] + np.arange(2)).reshape(len(self._rows), 8)
        row = np.repeat(np.arange(len(self._rows)), 8)
        entries = (slopes.ravel(), (row, columns.ravel()))
        return values - self._start, sp.csr_array(entries, shape=(len(self._rows), places.size))

    def _differences(self, places: Floats) -> tuple[Floats, Floats]:
        """Compute differences (r,) of squared distances, relative to the start, and derivatives.

        The derivatives (r, 4, 2) are by the positions of the four vertices of each equation. places: (v, 2) positions.
        """
        first, second = (places[self._rows[:, k + 1]] - places[self._rows[:, k]] for k in (0, 2))
        values = ((first**2).sum(axis=1) - (second**2).sum(axis=1)) / self._unit
        slopes = 2.0 * np.stack([-first, first, second, -second], axis=1) / self._unit[:, None, None]
        return np.asarray(values), np.asarray(slopes)
