"""Blocks of many labellings, and joined parts of graphs, computed by the compiled batch solver.

All values are integers. The results equal those of the slower Python versions, `blocks_of` and `Batches` of
jld_explore.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Ints
from jld_core.batch import library

Names = NDArray[np.int32]
"""Array of int32 with the name of the part of each atom."""


class Graph:
    """Graph of elements and interfaces, from which the blocks of labellings are computed.

    elements: number n of elements. a, b: (m,) elements of each interface. always: (t, 2) pairs of elements that are of
    one block under every labelling. variant: variant or path of the compiled library (see `library`); default: the
    variant in use, if any.
    """

    def __init__(self, elements: int, a: Ints, b: Ints, always: Ints, variant: str | None = None) -> None:
        self._elements = elements
        self._a, self._b, self._always = (np.ascontiguousarray(part, dtype=np.int32) for part in (a, b, always))
        self._variant = variant

    def blocks(self, labellings: Bits) -> Ints | None:
        """Return the block of each element under each labelling.

        labellings: (k, m) True = dry. Returns (k, n): smallest element in the block of each element; None without a
        batch solver. Raises MemoryError: the compiled library cannot allocate its workspace.
        """
        kernel = _library(self._variant)
        if kernel is None:
            return None
        labels = np.ascontiguousarray(labellings, dtype=np.uint8)
        names = np.empty((len(labels), self._elements), dtype=np.int64)
        joins, first, second = library.pointers(joins=self._always, first=self._a, second=self._b).values()
        places = library.pointers(labels=labels, names=names)
        counts = self._elements, len(self._always), len(self._a)
        library.require_success(
            kernel.jld_find_blocks(
                counts[0], counts[1], joins, counts[2], first, second, len(labels), places["labels"], places["names"]
            )
        )
        return names


class Joining:
    """Graph whose vertices (atoms) are joined into parts, pair by pair in a given order.

    An atom is a set of cells that always stay together.

    first, second: (pairs,) atoms of each pair that may be joined. cells: (atoms,) number of cells of each atom. least,
    most: smallest and largest number of cells of a part; `most` may be inf. rounds: passes that join parts with too few
    cells to a part that they touch. variant: variant or path of the compiled library (see `library`); default: the
    variant in use, if any.
    """

    def __init__(
        self, first: Ints, second: Ints, cells: Ints, least: int, most: float, rounds: int, variant: str | None = None
    ) -> None:
        self._first, self._second = (np.ascontiguousarray(part, dtype=np.int32) for part in (first, second))
        self._cells = np.ascontiguousarray(cells, dtype=np.int64)
        # A limit above the number of all cells, or infinity, has no effect and must fit an integer.
        self._least, self._most = least, int(min(most, self._cells.sum()))
        self._rounds = rounds
        self._variant = variant

    def parts(self, order: Ints, wanted: Ints) -> tuple[Names, Bools] | None:
        """Join atoms into parts, once for each order of the pairs.

        A pair is joined unless the part would have more than `most` cells.

        order: (k, pairs) indices of the pairs, in the order in which they are tried. wanted: (k,) number of leading
        pairs of each order that are tried; the others only serve to enlarge parts with too few cells. Result: part of
        each atom, and True where no part has too few cells; None without a batch solver. Raises MemoryError: the
        compiled library cannot allocate its workspace.
        """
        kernel = _library(self._variant)
        if kernel is None:
            return None
        rows, most = (np.ascontiguousarray(part, dtype=np.int64) for part in (order, wanted))
        names = np.empty((len(rows), len(self._cells)), dtype=np.int32)
        good = np.empty(len(rows), dtype=np.uint8)
        given = library.pointers(first=self._first, second=self._second, cells=self._cells)
        places = library.pointers(order=rows, wanted=most, names=names, complete=good)
        sizes = self._least, self._most, self._rounds, len(rows)
        library.require_success(
            kernel.jld_join_parts(len(self._cells), len(self._first), *given.values(), *sizes, *places.values())
        )
        return names, good.astype(bool)


def _library(variant: str | None) -> Any:
    """Return the loaded library of a variant, or None if there is none.

    variant: name or path; None: the variant in use.
    """
    name = variant or library.chosen()
    return None if name is None else library.library(name)
