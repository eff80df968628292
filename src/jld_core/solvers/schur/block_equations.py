"""Equations of whole blocks in place of those of one element each, before the Schur complement is formed.

Stiff inner faces tie the elements of a block. In the equations of its elements, what dry faces say about the rigid
motion of the block is lost below the stiff entries. The equations of the whole block contain no inner face, so nothing
cancels in them. Source: docs/method.md (8.6).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure

# Entry in the equations of a block, relative to the largest term of its column, below which it is rounding. Terms of
# faces within the block cancel up to rounding, which grows with the distance from the root in element sizes.
_CANCELLED = 1e-11


class BlockEquations:
    """Equations of a program replaced by those of whole blocks, for one labelling.

    program: program with `bodies`. sums: matrix T that replaces the equations of roots, see `Bodies.sums`.
    """

    def __init__(self, program: ConicProgram, sums: sp.csr_array) -> None:
        old = program.structure
        edge, width = old.equalities, old.shape[1]
        self._sums, self._edge = sums, edge
        self._program, self._inside = program, old.indices < edge
        column = np.repeat(np.arange(width), np.diff(old.indptr))
        inside = self._inside
        picked, row = np.flatnonzero(inside), old.indices[inside]
        by_column = sp.csc_array(sums)
        count = np.diff(by_column.indptr)[row]
        source = np.repeat(picked, count)
        start = np.cumsum(count) - count
        position = np.arange(len(source)) - np.repeat(start - by_column.indptr[row], count)
        target, factor = by_column.indices[position].astype(np.int64), by_column.data[position]
        # Yield rows stay as they are.
        rest = np.flatnonzero(~inside)
        source = np.concatenate([source, rest])
        target = np.concatenate([target, old.indices[rest]])
        factor = np.concatenate([factor, np.ones(len(rest))])
        keys, place = np.unique(column[source] * old.shape[0] + target, return_inverse=True)
        terms = factor * program.data[source]
        total = np.bincount(place, terms, len(keys))
        largest = np.zeros(width)
        np.maximum.at(largest, column[source], abs(terms))
        roots = np.zeros(old.shape[0], dtype=bool)
        roots[:edge][np.diff(sums.indptr) > 1] = True
        kept = ~roots[keys % old.shape[0]] | (abs(total) > _CANCELLED * largest[keys // old.shape[0]])
        number = np.cumsum(kept) - 1
        chosen = kept[place]
        self._map = sp.csr_array(
            (factor[chosen], (number[place[chosen]], source[chosen])), shape=(int(kept.sum()), len(program.data))
        )
        keys = keys[kept]
        self.structure = Structure(
            indices=keys % old.shape[0],
            indptr=np.searchsorted(keys // old.shape[0], np.arange(width + 1)),
            shape=old.shape,
            equalities=edge,
            linear=old.linear,
            cones=old.cones,
            places=old.places,
        )

    def fits(self, program: ConicProgram) -> bool:
        """Return True if `changed` applies: same structure, labelling and equation coefficients."""
        mine = self._program
        if program is mine:
            return True
        if program.structure is not mine.structure or program.bodies is None or mine.bodies is None:
            return False
        same = np.array_equal(program.bodies.labels, mine.bodies.labels)
        return same and np.array_equal(program.data[self._inside], mine.data[self._inside])

    def changed(self, program: ConicProgram) -> ConicProgram:
        """Replace the equations of a program that fits by those of whole blocks."""
        rhs = np.concatenate([self._sums @ program.rhs[: self._edge], program.rhs[self._edge :]])
        return replace(program, structure=self.structure, data=np.asarray(self._map @ program.data), rhs=rhs)

    def multipliers(self, dual: Floats) -> Floats:
        """Return the multipliers (rows,) of the original program from those of the changed one."""
        return np.concatenate([self._sums.T @ dual[: self._edge], dual[self._edge :]])
