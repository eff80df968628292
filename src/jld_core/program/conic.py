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

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.geometry import moment_about
from jld_core.mechanics import Scaling


@dataclass(frozen=True)
class Bodies:
    """Blocks that a labelling makes of an assembly, computed where a solver asks for them."""

    assembly: Assembly  # elements and interfaces
    scaling: Scaling
    labels: Bits  # (m,) True = dry

    @cached_property
    def root(self) -> Ints:
        """Return the representative element (free,) of the block of each free element."""
        # Entries are indices among the free elements. The representative is the element nearest to the middle of the
        # block. Elements of blocks that contain a support represent themselves.
        elements = self.assembly.elements
        block = blocks_of(self.assembly, self.labels)
        held = np.zeros(int(block.max(initial=-1)) + 1, dtype=bool)
        held[block[elements.support]] = True
        free = elements.free
        block, centroid = block[free], elements.centroid[free]
        size = np.maximum(np.bincount(block, minlength=len(held)), 1)
        middle = np.column_stack([np.bincount(block, way, len(held)) / size for way in centroid.T])
        # Rounding lets the choice between elements at the same distance depend neither on units nor on position.
        distance = np.round(np.linalg.norm(centroid - middle[block], axis=1) / self.assembly.size, 6)
        order = np.lexsort((distance, block))
        first = np.full(len(held), -1)
        names, start = np.unique(block[order], return_index=True)
        first[names] = order[start]
        return np.asarray(np.where(held[block], np.arange(len(free)), first[block]), dtype=np.int64)

    def sums(self, equations: int) -> sp.csr_array | None:
        """Return the invertible matrix T that replaces the equations of each root by those of its block.

        None where every free block is one element.
        """
        # A block's equations are sums over its elements, with moments about the centroid of the root. Source:
        # docs/method.md (8.6).
        root = self.root
        member = np.flatnonzero(root != np.arange(len(root)))
        if not len(member):
            return None
        assembly = self.assembly
        d, q = assembly.dimension, assembly.freedoms
        centroid = assembly.elements.centroid[assembly.elements.free]
        scale = self.scaling.row.reshape(-1, q)
        head = root[member]
        arm = centroid[member] - centroid[head]
        block = np.tile(np.eye(q), (len(member), 1, 1))
        for j in range(d):
            block[:, d:, j] = moment_about(arm, np.broadcast_to(np.eye(d)[j], arm.shape))
        block *= scale[member][:, None, :] / scale[head][:, :, None]
        rows = q * head[:, None, None] + np.arange(q)[:, None]
        columns = q * member[:, None, None] + np.arange(q)
        rows, columns = np.broadcast_to(rows, block.shape).ravel(), np.broadcast_to(columns, block.shape).ravel()
        kept = block.ravel() != 0.0
        shape = (equations, equations)
        return sp.eye_array(equations, format="csr") + sp.csr_array(
            (block.ravel()[kept], (rows[kept], columns[kept])), shape=shape
        )


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
    """Round an array to `_SHARED_BITS` bits, by Veltkamp's splitting."""
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
        """Return the program that solvers get, in `_SHARED_BITS` bits: no effect of units or order of sums."""
        return replace(self, data=_round(self.data), rhs=_round(self.rhs))

    @cached_property
    def matrix(self) -> sp.csc_array:
        """Return M as a sparse array (rows, columns) in compressed columns."""
        s = self.structure
        return sp.csc_array((self.data, s.indices, s.indptr), shape=s.shape)
