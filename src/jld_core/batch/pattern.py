"""Symbolic factorisation of a block-sparse symmetric matrix: elimination order, fill, and products.

It is computed once per assembly. The compiled solver then follows these lists without a branch.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from heapq import heapify, heappop, heappush
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Floats, Ints
from jld_core.batch import library
from jld_core.linalg.dissection import nested_dissection

Int32s = NDArray[np.int32]
"""Array of int32."""

# Numbers of nodes at which nested dissection stops; each order is compared with minimum degree
_LEAVES: Final = (4, 12)


@dataclass(frozen=True)
class FactorPattern:
    """Pattern of a block Cholesky factor; matrix blocks are numbered column by column.

    order: (n,) node eliminated at each step. column_start, row: (n + 1,) matrix blocks below the diagonal of each
    column. entered: (blocks,) 1 where the matrix itself has an entry, 0 where elimination fills one in. pair_start,
    pair: (blocks + 1,) pairs of earlier matrix blocks whose product is subtracted from each matrix block. left_start,
    left, left_column: (n + 1,) matrix blocks of each block row, and their columns.
    """

    order: Ints
    column_start: Int32s
    row: Int32s
    entered: NDArray[np.uint8]
    pair_start: Int32s
    pair: Int32s
    left_start: Int32s
    left: Int32s
    left_column: Int32s

    def as_ctypes(self) -> library.FactorPattern:
        """Return the pattern as a ctypes structure that points to these arrays."""
        names = ("column_start", "row", "entered", "pair_start", "pair", "left_start", "left", "left_column")
        arrays = {name: getattr(self, name) for name in names}
        return library.FactorPattern(nodes=len(self.order), **library.pointers(**arrays))

    @property
    def products(self) -> int:
        """Return the number of products of matrix blocks in one factorisation.

        Products on the diagonal are included.
        """
        return len(self.pair) + len(self.left)


def factor_pattern(a: Ints, b: Ints, places: Floats) -> FactorPattern:
    """Return the pattern with the fewest products among a few elimination orders.

    Results are cached, so that the load cases of one structure share a pattern. a, b: (e,) pairs of nodes that share a
    matrix block off the diagonal; a pair of a node with itself is ignored. places: (n, d) coordinates of the n nodes,
    in any unit.
    """
    return _pattern(*_key(a, b, places))


def number_of_products(a: Ints, b: Ints, places: Floats) -> int:
    """Return `FactorPattern.products` of a pattern without laying it out.

    a, b, places: as in `factor_pattern`.
    """
    return _products(_elimination(*_key(a, b, places))[1])


def _key(a: Ints, b: Ints, places: Floats) -> tuple[bytes, bytes, bytes, tuple[int, ...]]:
    """Return the key of the caches: bytes of the ends of edges and of coordinates, and the shape of these."""
    a, b, places = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64), np.asarray(places, dtype=float)
    proper = a != b
    return a[proper].tobytes(), b[proper].tobytes(), places.tobytes(), places.shape


def _ends(first: bytes, second: bytes) -> tuple[Ints, Ints]:
    """Return the ends (e,), (e,) of the edges of a key."""
    return np.frombuffer(first, dtype=np.int64), np.frombuffer(second, dtype=np.int64)


@lru_cache(maxsize=4)
def _pattern(first: bytes, second: bytes, where: bytes, shape: tuple[int, ...]) -> FactorPattern:
    """Compute the factor pattern of a key, see `_key`."""
    return _laid_out(*_ends(first, second), *_elimination(first, second, where, shape))


@lru_cache(maxsize=4)
def _elimination(first: bytes, second: bytes, where: bytes, shape: tuple[int, ...]) -> tuple[Ints, list[list[int]]]:
    """Return the elimination order with the fewest products, and the rows of its columns; see `_fill`.

    first, second: ends of the edges. where: coordinates of the nodes. shape: shape of these coordinates.
    """
    a, b = _ends(first, second)
    places = np.frombuffer(where, dtype=float).reshape(shape)
    count = len(places)
    orders = [_minimum_degree(a, b, count)]
    orders += [nested_dissection(a, b, count, leaf, places).order for leaf in _LEAVES if len(a) and count > leaf]
    columns = [_fill(a, b, order) for order in orders]
    # The first order wins ties.
    best = int(np.argmin([_products(found) for found in columns]))
    return orders[best], columns[best]


def _products(columns: list[list[int]]) -> int:
    """Return the number of products of a factorisation: k (k + 1) / 2 for a column with k matrix blocks."""
    return sum(len(column) * (len(column) + 1) // 2 for column in columns)


def _neighbours(a: Ints, b: Ints, count: int) -> list[dict[int, None]]:
    """Return the neighbours of each node of a graph, in a fixed order.

    a, b: (e,) ends of the edges. count: number of nodes.
    """
    found: list[dict[int, None]] = [{} for _ in range(count)]
    for one, other in sorted(zip(a.tolist(), b.tolist(), strict=True)):
        found[one][other] = None
        found[other][one] = None
    return found


def _minimum_degree(a: Ints, b: Ints, count: int) -> Ints:
    """Return the minimum-degree elimination order of a graph.

    a, b: (e,) ends of the edges. count: number of nodes.
    """
    near = _neighbours(a, b, count)
    # entries whose degree has changed since are stale
    waiting = [(len(around), node) for node, around in enumerate(near)]
    heapify(waiting)
    done, order = [False] * count, []
    while waiting:
        degree, node = heappop(waiting)
        if done[node] or degree != len(near[node]):
            continue
        done[node] = True
        order.append(node)
        around = near[node]
        for one in around:
            mine = near[one]
            mine |= around
            del mine[node], mine[one]
            heappush(waiting, (len(mine), one))
    return np.array(order, dtype=np.int64)


def _fill(a: Ints, b: Ints, order: Ints) -> list[list[int]]:
    """Return the row numbers below the diagonal of each column of the factor, fill included.

    a, b: (e,) ends of the edges. order: elimination order.
    """
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    below: list[set[int]] = [set() for _ in order]
    for one, other in zip(place[a].tolist(), place[b].tolist(), strict=True):
        below[min(one, other)].add(max(one, other))
    columns = []
    for column in range(len(order)):
        rows = sorted(below[column])
        columns.append(rows)
        if rows:
            below[rows[0]].update(rows[1:])
    return columns


def _laid_out(a: Ints, b: Ints, order: Ints, columns: list[list[int]]) -> FactorPattern:
    """Build the factor pattern of an elimination order.

    a, b: (e,) ends of the edges. columns: row numbers below the diagonal of each column.
    """
    start = np.concatenate([[0], np.cumsum([len(rows) for rows in columns])])
    place = {(row, j): int(start[j]) + k for j, rows in enumerate(columns) for k, row in enumerate(rows)}
    entered = np.zeros(len(place), dtype=np.uint8)
    step = np.argsort(order)
    for one, other in zip(step[a].tolist(), step[b].tolist(), strict=True):
        entered[place[max(one, other), min(one, other)]] = 1
    lefts: list[list[tuple[int, int]]] = [[] for _ in columns]
    products: list[list[tuple[int, int]]] = [[] for _ in range(int(start[-1]))]
    for j, rows in enumerate(columns):
        for k, row in enumerate(rows):
            block = int(start[j]) + k
            lefts[row].append((block, j))
            for other in rows[k + 1 :]:
                products[place[other, row]].append((place[other, j], block))
    return FactorPattern(
        order=order,
        column_start=start.astype(np.int32),
        row=_flat(columns),
        entered=entered,
        pair_start=_starts(products),
        pair=_flat([[end for pair in pairs for end in pair] for pairs in products]).reshape(-1, 2),
        left_start=_starts(lefts),
        left=_flat([[block for block, _ in row] for row in lefts]),
        left_column=_flat([[column for _, column in row] for row in lefts]),
    )


def _starts(lists: list[list[tuple[int, int]]]) -> Int32s:
    """Return where each list starts in the concatenation of all, then its total length."""
    return np.concatenate([[0], np.cumsum([len(one) for one in lists])]).astype(np.int32)


def _flat(lists: list[list[int]]) -> Int32s:
    """Concatenate lists of integers."""
    return np.array([value for one in lists for value in one], dtype=np.int32)
