"""Matrix blocks of a conic program: columns, rows and equations of each face.

Columns that share yield rows form a matrix block, which touches the equations of two elements. A few columns stand
apart (λ, a common slack) and border the system. Faces of equal sizes form a family, computed as arrays with one row per
face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import SolverError
from jld_core.linalg import components
from jld_core.program import Structure
from jld_core.solvers.schur.nesterov_todd import Cones

_WIDE = 100  # a column with more entries borders the system and belongs to no face
_MOST = 60  # largest number of columns of a matrix block; larger ones mean that the program has no faces


@dataclass(frozen=True)
class Family:
    """Data positions of m faces whose matrix blocks have equal sizes, as stacked arrays.

    columns: (m, k) program columns of each face. rows: (m, rows) yield rows of each face, numbered after the equations,
    half-lines first. equations: (m, r) equations that each face enters. linear, cones: number of half-lines and of
    cones per face. g, a, edge: (int array, int array) entries of the program's data, and their positions in a flat
    array. The arrays are: `g` (m, rows, k) of yield rows, `a` (m, r, k) of equations, `edge` (m, rows, border) of yield
    rows in border columns.
    """

    columns: Ints
    rows: Ints
    equations: Ints
    linear: int
    cones: int
    g: tuple[Ints, Ints]
    a: tuple[Ints, Ints]
    edge: tuple[Ints, Ints]


@dataclass(frozen=True)
class FaceBlocks:
    """Rows and columns of a program grouped by face, as positions in the program's data.

    cones: product of cones of the yield rows. families: faces, grouped by size. border: (border,) columns that belong
    to no face. idle: columns without yield rows; no program may have entries in them. loose: data entries in yield rows
    of border columns alone, with their yield row and border column. edge: data entries in equations of border columns,
    with their equation and border column.
    """

    cones: Cones
    families: tuple[Family, ...]
    border: Ints
    idle: Ints
    loose: tuple[Ints, Ints, Ints]
    edge: tuple[Ints, Ints, Ints]


def face_blocks(structure: Structure) -> FaceBlocks:
    """Find which columns, rows and equations of a structure belong to each face.

    Raises SolverError if cones have several sizes, or if columns do not separate into small matrix blocks.
    """
    sizes = set(structure.cones)
    if len(sizes) > 1:
        raise SolverError("the Schur route takes cones of one size only")
    size = sizes.pop() if sizes else 1
    cones = Cones(structure.linear, len(structure.cones), size)
    equalities, (rows, columns) = structure.equalities, structure.shape
    column = np.repeat(np.arange(columns), np.diff(structure.indptr))
    row, data = structure.indices, np.arange(len(structure.indices))
    yields = row >= equalities
    # The first row of a cone stands for all of its rows.
    head = np.arange(rows)
    first = equalities + structure.linear
    head[first:] = first + (np.arange(rows - first) // size) * size
    apart = np.zeros(columns, dtype=bool)
    apart[np.bincount(column, minlength=columns) > _WIDE] = True
    apart[-1] = True
    chosen = yields & ~apart[column]
    part = components(columns + rows, column[chosen], columns + head[row[chosen]])
    # A column that shares its rows with no other column is a load factor and belongs to no face.
    own = np.bincount(part[:columns][~apart], minlength=part.max() + 1)
    touched = np.zeros(columns, dtype=bool)
    touched[column[yields]] = True
    apart |= touched & (own[part[:columns]] == 1)
    idle = np.flatnonzero(~touched & ~apart)
    face_column = np.flatnonzero(touched & ~apart)
    border = np.flatnonzero(apart)
    if len(border) > 8 or own.max(initial=0) > _MOST:
        raise SolverError("the columns of this program are not separable by face")
    faces, column_face = np.unique(part[face_column], return_inverse=True)
    row_part = part[columns + head]
    place = np.minimum(np.searchsorted(faces, row_part), max(len(faces) - 1, 0))
    row_face = np.where(faces[place] == row_part, place, -1) if len(faces) else np.full(rows, -1)
    row_face[:equalities] = -1
    loose = row_face[row] < 0
    border_index = np.full(columns, -1)
    border_index[border] = np.arange(len(border))
    if np.any(row_face[first:] < 0):
        raise SolverError("a cone of this program belongs to no face")
    in_edge, in_loose = apart[column] & ~yields, apart[column] & yields & loose
    laid = _Layout(face_column, column_face, row_face, equalities, first, columns)
    return FaceBlocks(
        cones=cones,
        families=laid.families(row, column, data, yields, apart, border_index, size),
        border=border,
        idle=idle,
        loose=(data[in_loose], row[in_loose] - equalities, border_index[column[in_loose]]),
        edge=(data[in_edge], row[in_edge], border_index[column[in_edge]]),
    )


class _Layout:
    """Local numbers of columns, yield rows and equations within the faces they belong to."""

    def __init__(
        self, face_column: Ints, column_face: Ints, row_face: Ints, equalities: int, first: int, columns: int
    ) -> None:
        self.equalities = equalities
        self.count = int(column_face.max(initial=-1)) + 1
        self.face_of_column = np.full(columns, -1)
        self.face_of_column[face_column] = column_face
        self.face_of_row = row_face
        self.columns, self.local_column = _numbered(self.face_of_column, self.count)
        self.rows, self.local_row = _numbered(row_face, self.count)
        self.half_lines = np.bincount(row_face[equalities:first][row_face[equalities:first] >= 0], minlength=self.count)

    def families(
        self, row: Ints, column: Ints, data: Ints, yields: Bools, apart: Bools, border_index: Ints, size: int
    ) -> tuple[Family, ...]:
        """Group the faces by their sizes, and locate the program data of each family.

        row, column, data: entries of the program's matrix. yields: True for entries of yield rows. apart: True for
        border columns. border_index: number of each border column. size: rows per cone.
        """
        in_a = ~yields & (self.face_of_column[column] >= 0)
        in_g = yields & (self.face_of_column[column] >= 0)
        in_edge = yields & apart[column] & (self.face_of_row[row] >= 0)
        face_a = self.face_of_column[column[in_a]]
        pairs, equation = np.unique(face_a * self.equalities + row[in_a], return_inverse=True)
        pair_face = pairs // max(self.equalities, 1)
        equations = np.searchsorted(pair_face, np.arange(self.count + 1))
        local_equation = equation - equations[face_a]
        k, g, r = np.diff(self.columns[1]), np.diff(self.rows[1]), np.diff(equations)
        kinds, family = np.unique(np.column_stack([k, g, r, self.half_lines]), axis=0, return_inverse=True)
        found = []
        for number, (wide, high, deep, half) in enumerate(kinds.tolist()):
            faces = np.flatnonzero(family == number)
            at = np.full(self.count + 1, -1)
            at[faces] = np.arange(len(faces))
            of_a, of_g, of_edge = at[face_a], at[self.face_of_column[column[in_g]]], at[self.face_of_row[row[in_edge]]]
            mine_a, mine_g, mine_edge = of_a >= 0, of_g >= 0, of_edge >= 0
            where_a = (of_a * deep + local_equation) * wide + self.local_column[column[in_a]]
            where_g = (of_g * high + self.local_row[row[in_g]]) * wide + self.local_column[column[in_g]]
            edge = int((border_index >= 0).sum())
            where_edge = (of_edge * high + self.local_row[row[in_edge]]) * edge + border_index[column[in_edge]]
            found.append(
                Family(
                    columns=self.columns[0][self.columns[1][faces][:, None] + np.arange(wide)],
                    rows=self.rows[0][self.rows[1][faces][:, None] + np.arange(high)] - self.equalities,
                    equations=(pairs % max(self.equalities, 1))[equations[faces][:, None] + np.arange(deep)],
                    linear=half,
                    cones=(high - half) // size,
                    g=(data[in_g][mine_g], where_g[mine_g]),
                    a=(data[in_a][mine_a], where_a[mine_a]),
                    edge=(data[in_edge][mine_edge], where_edge[mine_edge]),
                )
            )
        return tuple(found)


def _numbered(owner: Ints, count: int) -> tuple[tuple[Ints, Ints], Ints]:
    """Group members by owner, and number them within their group.

    owner: (n,) group of each member, −1 for none. count: number of groups. Returns (members, start), with the members
    of each group ascending, and the number (n,) of each member in its group, −1 for none.
    """
    members = np.argsort(owner, kind="stable")
    members = members[np.searchsorted(owner[members], 0) :]
    start = np.searchsorted(owner[members], np.arange(count + 1))
    local = np.full(len(owner), -1)
    local[members] = np.arange(len(members)) - start[owner[members]]
    return (members, start), local


def filled(shape: tuple[int, ...], entries: tuple[Ints, Ints], data: Floats) -> Floats:
    """Place some entries of a program's data in an array, zero elsewhere.

    shape: shape of the array. entries: indices into `data`, and the positions of these values in the flat array.
    """
    array = np.zeros(shape)
    array.ravel()[entries[1]] = data[entries[0]]
    return array
