"""Graphs of many labellings in the compiled batch solver: their blocks, and parts that are joined in the order of keys.

Whole numbers only: each answers as its slower statement beside it, `blocks_of` and `Batches` of jld_explore, does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Ints
from jld_core.batch import library

Names = NDArray[np.int32]


class Graph:
    """Elements and the faces between them.

    elements: how many. a, b: (m,) elements of each face. always: (t, 2) elements that are one whatever the labels.
    variant: see `library`; default the one in use, where there is one.
    """

    def __init__(self, elements: int, a: Ints, b: Ints, always: Ints, variant: str | None = None) -> None:
        self._elements = elements
        self._a, self._b, self._always = (np.ascontiguousarray(part, dtype=np.int32) for part in (a, b, always))
        self._variant = variant

    def blocks(self, labellings: Bits) -> Ints | None:
        """(k, n) the smallest element in the block of each, of labellings (k, m); None without a batch solver."""
        kernel = _library(self._variant)
        if kernel is None:
            return None
        labels = np.ascontiguousarray(labellings, dtype=np.uint8)
        names = np.empty((len(labels), self._elements), dtype=np.int64)
        failed = kernel.jld_blocks(
            self._elements, len(self._always), self._always.ctypes.data, len(self._a), self._a.ctypes.data,
            self._b.ctypes.data, len(labels), labels.ctypes.data, names.ctypes.data,
        )  # fmt: skip
        if failed:
            raise MemoryError("the kernel's workspace")
        return names


class Joining:
    """Atoms and the pairs of them that may be joined.

    first, second: (pairs,) atoms. cells: (atoms,) cells of each; least, most: of a part. rounds: passes in which what
    is too small is joined to what it touches. variant: see `Graph`.
    """

    def __init__(
        self, first: Ints, second: Ints, cells: Ints, least: int, most: float, rounds: int, variant: str | None = None
    ) -> None:
        self._first, self._second = (np.ascontiguousarray(part, dtype=np.int32) for part in (first, second))
        self._cells = np.ascontiguousarray(cells, dtype=np.int64)
        # what exceeds all cells is no limit, nor is infinity
        self._least, self._most = least, int(min(most, self._cells.sum()))
        self._rounds = rounds
        self._variant = variant

    def parts(self, order: Ints, wanted: Ints) -> tuple[Names, Bools] | None:
        """(k, atoms) the part of each atom and (k,) whether no part is too small; None without a batch solver.

        order: (k, pairs) the order in which pairs are joined, of which the first `wanted` (k,) ask for it.
        """
        kernel = _library(self._variant)
        if kernel is None:
            return None
        rows, most = (np.ascontiguousarray(part, dtype=np.int64) for part in (order, wanted))
        names = np.empty((len(rows), len(self._cells)), dtype=np.int32)
        good = np.empty(len(rows), dtype=np.uint8)
        failed = kernel.jld_parts(
            len(self._cells), len(self._first), self._first.ctypes.data, self._second.ctypes.data,
            self._cells.ctypes.data, self._least, self._most, self._rounds, len(rows), rows.ctypes.data,
            most.ctypes.data, names.ctypes.data, good.ctypes.data,
        )  # fmt: skip
        if failed:
            raise MemoryError("the kernel's workspace")
        return names, good.astype(bool)


def _library(variant: str | None) -> Any:
    name = variant or library.chosen()
    return None if name is None else library.library(name)
