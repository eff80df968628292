"""Conic program: its structure and its numbers.

minimise  q·y   subject to   M y + s = r,   s in {0} × R₊ × second-order cones
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints
from jld_core.program.bodies import Bodies


@dataclass(frozen=True)
class Structure:
    """Sparsity of M (compressed columns) and cones that all programs of one template share.

    Attributes
    ----------
    indices, indptr : int arrays
        Row indices and column starts of M.
    shape : (int, int)
        Rows and columns of M.
    equalities : int
        Number of rows with s = 0; they come first.
    linear : int
        Number of rows with s ≥ 0; they follow.
    cones : tuple of int
        Sizes of the second-order cones, which come last.
    places : (equalities, d) array or None
        Coordinates of the element of each equation, a hint for the elimination order; None if equations have no
        elements.
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
        """Return the first row of each second-order cone, (cones,)."""
        return self.equalities + self.linear + beginnings(self.cones)


def beginnings(sizes: Sequence[int]) -> Ints:
    """Return the first row of each of several cones whose rows follow one another.

    Parameters
    ----------
    sizes : sequence of int
        Number of rows of each cone.

    Returns
    -------
    (k,) int array
        First row of each cone; the first cone starts at 0.
    """
    return np.cumsum([0, *sizes], dtype=np.int64)[:-1]


def pack(
    rows: Any,
    rhs: Floats,
    objective: Floats,
    equalities: int,
    linear: int,
    cones: tuple[int, ...],
    places: Floats | None = None,
    bodies: Bodies | None = None,
) -> ConicProgram:
    """Make a conic program from a sparse matrix and vectors.

    The program is: minimise q·y subject to M y + s = r. The slacks s are 0 in equations, at least 0 in inequalities,
    and in second-order cones in the last rows. Its sparsity pattern is not shared with other programs.

    Parameters
    ----------
    rows : (rows, columns) sparse matrix
        M: equations, then inequalities, then cones.
    rhs : (rows,) array
        Right-hand side r.
    objective : (columns,) array
        Objective q.
    equalities, linear : int
        Number of equations and of inequalities.
    cones : tuple of int
        Sizes of the second-order cones.
    places : (equalities, d) array, optional
        Coordinates of the element of each equation (see `Structure`).
    bodies : Bodies, optional
        Blocks of the labelling (see `ConicProgram`).

    Returns
    -------
    ConicProgram
        The program.
    """
    matrix = sp.csc_array(rows)
    matrix.sort_indices()
    shape = (int(matrix.shape[0]), int(matrix.shape[1]))
    indices, indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    structure = Structure(indices, indptr, shape, equalities, linear, cones, places)
    return ConicProgram(structure, np.asarray(matrix.data, dtype=float), rhs, objective, bodies)


# Leading bits of a number that scenes share if they differ by units alone. With 42 bits all of 180 programs of random
# scenes are the same in other units, with 44 bits 97 % of them.
_SHARED_BITS: Final = 43


def _round(values: Floats) -> Floats:
    """Round an array of any shape to `_SHARED_BITS` bits, by Veltkamp's splitting."""
    high = (2.0 ** (53 - _SHARED_BITS) + 1.0) * values
    return np.asarray(high - (high - values))


@dataclass(frozen=True)
class ConicProgram:
    """Conic program: minimise q·y subject to M y + s = r, with s in a product of cones.

    Attributes
    ----------
    structure : Structure
        Sparsity of M, and cones.
    data : (nnz,) array
        Values of M in the order of the structure.
    rhs : (rows,) array
        Right-hand side r.
    objective : (columns,) array
        Objective q.
    bodies : Bodies or None
        Blocks of the labelling, a hint for solvers of large programs; None where unknown.
    """

    structure: Structure
    data: Floats
    rhs: Floats
    objective: Floats
    bodies: Bodies | None = None

    @cached_property
    def rounded(self) -> ConicProgram:
        """Return the program that solvers get: M and r rounded to `_SHARED_BITS` bits.

        The last digits of a solver's answer then depend neither on units nor on the order of a sum. Bounds proven from
        that answer use the numbers as they are.
        """
        return replace(self, data=_round(self.data), rhs=_round(self.rhs))

    @cached_property
    def matrix(self) -> sp.csc_array:
        """Return the matrix M as a sparse array (rows, columns) in compressed columns."""
        s = self.structure
        return sp.csc_array((self.data, s.indices, s.indptr), shape=s.shape)
