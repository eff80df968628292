"""Collector of yield rows of sets of faces at once: of dry faces, of inner ones, and of sets that enclose both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.mechanics.yield_set import RowPattern

Term = tuple[Ints, list[Floats]]
"""Columns (k,) of a family of rows, and their coefficients (k,) in each of the sets."""

Row = tuple[list[Term], list[Floats]]
"""Terms of a family of rows, and their right-hand sides (k,) in each of the sets."""


class Sheet:
    """Rows of two or three `sets` of `faces` faces, collected family by family; further numbers are left out."""

    def __init__(self, faces: int, freedoms: int, sets: int) -> None:
        self.faces, self.freedoms, self.sets, self.rows, self.extra = faces, freedoms, sets, 0, 0
        self._entries: list[tuple[Ints, Ints, Ints, Floats]] = []
        self._sides: list[tuple[Ints, Ints, Floats]] = []
        self._capacity: list[Ints] = []
        self._length = self._cones = 0

    def column(self, face: Ints, resultant: int) -> Ints:
        """Return the columns of one resultant of the faces (k,)."""
        return self.freedoms * face + resultant

    def new_columns(self, count: int) -> Ints:
        """Return the columns of `count` new variables beyond the resultants."""
        columns = self.freedoms * self.faces + self.extra + np.arange(count)
        self.extra += count
        return columns

    def add(
        self,
        face: Ints,
        terms: list[Term],
        sides: list[Floats],
        place: Ints | None = None,
        *,
        limits_shear: bool = False,
    ) -> None:
        """Add one row for each face (k,), by default after the present ones; limits_shear: the first term is −μN."""
        if place is None:
            place = self.rows + np.arange(len(face))
            self.rows += len(face)
        for number, (column, values) in enumerate(terms):
            table = np.array(values[: self.sets])
            # Planar entries stay if they are zero: they hold the columns of a face together.
            used = np.any(table != 0.0, axis=0)
            if used.all() or (limits_shear and self.freedoms == 3):
                entries = place, column, face, table
            else:
                entries = place[used], column[used], face[used], table[:, used]
            if len(entries[0]):
                self._entries.append(entries)
            if limits_shear and number == 0:
                self._capacity.append(self._length + np.arange(len(entries[0])))
            self._length += len(entries[0])
        self._sides.append((place, face, np.array(sides[: self.sets])))

    def cones(self, face: Ints, rows: list[Row], *, limits_shear: bool = False) -> None:
        """Add one second-order cone per face (k,); limits_shear: True if its first row begins with −μN."""
        for offset, (terms, sides) in enumerate(rows):
            place, limits = self.rows + len(rows) * np.arange(len(face)) + offset, limits_shear and offset == 0
            self.add(face, terms, sides, place, limits_shear=limits)
        self.rows += len(rows) * len(face)
        self._cones += len(face)

    def patterns(self, linear: int) -> tuple[RowPattern, ...]:
        """Return the rows of both labels, and those with enclosing rows in place of dry ones."""
        row, column, face, values = (np.concatenate(part, axis=-1) for part in zip(*self._entries, strict=True))
        order = np.argsort(np.concatenate([place for place, _, _ in self._sides]))
        h = np.concatenate([side for _, _, side in self._sides], axis=1)[:, order]
        plain = RowPattern(
            row=row,
            column=column,
            face=face,
            dry=values[0],
            inner=values[1],
            h_dry=h[0],
            h_inner=h[1],
            row_face=np.concatenate([faces for _, faces, _ in self._sides])[order],
            linear=linear,
            cones=(3,) * self._cones,
            capacity=np.concatenate([np.zeros(0, dtype=np.int64), *self._capacity]),
            extra=self.extra,
        )
        return plain, *(replace(plain, dry=one, h_dry=side) for one, side in zip(values[2:], h[2:], strict=True))
