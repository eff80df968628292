"""A conic program: its structure, and its numbers.

minimise  q·y   subject to   M y + s = r,   s in {0} × R₊ × second-order cones
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints


@dataclass(frozen=True)
class Structure:
    """What all programs of one template share: sparsity of M (csc) and the cones.

    shape: (rows, columns) of M. equalities: rows with s = 0. linear: rows with s ≥ 0 that follow. cones:
    sizes of the second-order cones that follow. places: (equalities, d) where the element of each equation is,
    a hint for orders of elimination; None where the equations are not those of elements.
    """

    indices: Ints
    indptr: Ints
    shape: tuple[int, int]
    equalities: int
    linear: int
    cones: tuple[int, ...]
    places: Floats | None = None

    @property
    def heads(self) -> Ints:
        """(cones,) the first row of each cone."""
        return self.equalities + self.linear + beginnings(self.cones)


def beginnings(sizes: Sequence[int]) -> Ints:
    """(k,) where each of some cones begins among their rows, one after the other."""
    return np.cumsum([0, *sizes], dtype=np.int64)[:-1]


def pack(
    rows: Any,
    rhs: Floats,
    objective: Floats,
    equalities: int,
    linear: int,
    cones: tuple[int, ...],
    places: Floats | None = None,
) -> ConicProgram:
    """A program of its own structure from sparse rows: equations, then inequalities, then cones."""
    matrix = sp.csc_array(rows)
    matrix.sort_indices()
    shape = (int(matrix.shape[0]), int(matrix.shape[1]))
    indices, indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    structure = Structure(indices, indptr, shape, equalities, linear, cones, places)
    return ConicProgram(structure, np.asarray(matrix.data, dtype=float), rhs, objective)


@dataclass(frozen=True)
class ConicProgram:
    """Numbers of one program: M's data in the structure's order, right-hand side r, objective q."""

    structure: Structure
    data: Floats
    rhs: Floats
    objective: Floats

    @cached_property
    def matrix(self) -> sp.csc_array:
        """M as a sparse array."""
        s = self.structure
        return sp.csc_array((self.data, s.indices, s.indptr), shape=s.shape)
