"""Multifrontal Cholesky in the compiled library or in numpy, and Nesterov–Todd scaling of cones.

Source: Nesterov & Todd, Math. Oper. Res. 22 (1997) 1–42; Vandenberghe, The CVXOPT linear and quadratic cone program
solvers (2010), section 4.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack

from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import chosen
from jld_core.batch.library import Fronts as FrontsOfC
from jld_core.batch.library import library, pointers, require_success
from jld_core.errors import SolverError
from jld_core.linalg import components
from jld_core.linalg.factors import Fronts
from jld_core.program import ConicProgram
from jld_core.program.template import Structure

_LONGEST = 1e10  # longest step, where no cone bounds it


@dataclass(frozen=True)
class Cones:
    """Product of `linear` half-lines and then `count` second-order cones of `size` dimensions each."""

    linear: int
    count: int
    size: int

    @property
    def degree(self) -> int:
        """Barrier parameter: one per half-line and one per cone."""
        return self.linear + self.count

    def parts(self, vector: Floats) -> tuple[Floats, Floats]:
        """Split a vector into views (linear,) and (count, size)."""
        return vector[: self.linear], vector[self.linear :].reshape(self.count, self.size)

    def join(self, linear: Floats, cones: Floats) -> Floats:
        return np.concatenate([linear, cones.ravel()])

    def unit(self) -> Floats:
        """Return the identity of the Jordan product: 1 on half-lines, (1, 0, …, 0) in cones."""
        cones = np.zeros((self.count, self.size))
        cones[:, :1] = 1.0
        return self.join(np.ones(self.linear), cones)

    def product(self, u: Floats, v: Floats) -> Floats:
        """Return the Jordan product u ∘ v: u v on half-lines, (u·v, u₀v₁ + v₀u₁) in cones."""
        (ul, uc), (vl, vc) = self.parts(u), self.parts(v)
        out = uc[:, :1] * vc + vc[:, :1] * uc
        out[:, :1] = np.einsum("ij,ij->i", uc, vc)[:, None]
        return self.join(ul * vl, out)

    def quotient(self, u: Floats, v: Floats) -> Floats:
        (ul, uc), (vl, vc) = self.parts(u), self.parts(v)
        u0, u1, v0, v1 = uc[:, 0], uc[:, 1:], vc[:, 0], vc[:, 1:]
        cross = np.einsum("ij,ij->i", u1, v1)
        first = (u0 * v0 - cross) / _determinant(uc)
        rest = (v1 - first[:, None] * u1) / u0[:, None]
        return self.join(vl / ul, np.column_stack([first, rest]))

    def slack(self, vector: Floats) -> float:
        """Return the least eigenvalue of a vector: positive inside the cones, negative outside."""
        linear, cones = self.parts(vector)
        inside = cones[:, 0] - np.sqrt(np.einsum("ij,ij->i", cones[:, 1:], cones[:, 1:]))
        return float(min(linear.min(initial=np.inf), inside.min(initial=np.inf)))

    def step(self, vector: Floats, direction: Floats) -> float:
        """Return the step length α ≤ `_LONGEST` to the boundary of the cones, from a vector inside."""
        # α is the largest number for which vector + α·direction lies in the cones.
        (vl, vc), (dl, dc) = self.parts(vector), self.parts(direction)
        ratio = 1.0 / _LONGEST
        if self.linear:
            ratio = max(ratio, float((-dl / vl).max()))
        if self.count:
            # In the frame of the vector the least eigenvalue of the direction limits the step.
            root = np.sqrt(_determinant(vc))
            v0, v1 = vc[:, 0] / root, vc[:, 1:] / root[:, None]
            first = (v0 * dc[:, 0] - np.einsum("ij,ij->i", v1, dc[:, 1:])) / root
            tail = dc[:, 1:] / root[:, None] - ((first + dc[:, 0] / root) / (v0 + 1.0))[:, None] * v1
            ratio = max(ratio, float((np.sqrt(np.einsum("ij,ij->i", tail, tail)) - first).max()))
        return 1.0 / ratio


def _determinant(cones: Floats) -> Floats:
    """Return v₀² − ‖v₁‖² of each cone (k, size), as a product that keeps digits near the boundary."""
    norm = np.sqrt(np.einsum("ij,ij->i", cones[:, 1:], cones[:, 1:]))
    return np.asarray(np.maximum((cones[:, 0] - norm) * (cones[:, 0] + norm), 1e-300))


class NesterovTodd:
    """Scaling W of the cones at slack s and multiplier z inside them: symmetric, with W z = W⁻¹ s = `point`."""

    def __init__(self, cones: Cones, s: Floats, z: Floats) -> None:
        self.cones = cones
        (sl, sc), (zl, zc) = cones.parts(s), cones.parts(z)
        self.linear = np.sqrt(sl / zl)
        s_root, z_root = np.sqrt(_determinant(sc)), np.sqrt(_determinant(zc))
        s_bar, z_bar = sc / s_root[:, None], zc / z_root[:, None]
        gamma = np.sqrt(0.5 * (1.0 + np.einsum("ij,ij->i", s_bar, z_bar)))
        w = s_bar - z_bar
        w[:, 0] += 2.0 * z_bar[:, 0]
        w /= 2.0 * gamma[:, None]
        eta = np.sqrt(s_root / z_root)
        self.blocks = _blocks(w) * eta[:, None, None]
        w[:, 1:] *= -1.0
        self.inverse = _blocks(w) / eta[:, None, None]
        self.point = self.times(z)

    def times(self, vector: Floats) -> Floats:
        linear, cones = self.cones.parts(vector)
        return self.cones.join(self.linear * linear, np.einsum("nij,nj->ni", self.blocks, cones))

    def divide(self, vector: Floats) -> Floats:
        linear, cones = self.cones.parts(vector)
        return self.cones.join(linear / self.linear, np.einsum("nij,nj->ni", self.inverse, cones))


def _blocks(w: Floats) -> Floats:
    """Return the symmetric square-root matrices (k, size, size) of unit vectors w (k, size)."""
    # The matrices are [w₀, w₁ᵀ; w₁, I + w₁ w₁ᵀ / (1 + w₀)], where w₀² − ‖w₁‖² = 1.
    count, size = w.shape
    blocks = np.zeros((count, size, size))
    if size:
        first = np.sqrt(1.0 + np.einsum("ij,ij->i", w[:, 1:], w[:, 1:]))
        blocks[:, 0, 0] = first
        blocks[:, 0, 1:] = blocks[:, 1:, 0] = w[:, 1:]
        blocks[:, 1:, 1:] = np.eye(size - 1)
        blocks[:, 1:, 1:] += w[:, 1:, None] * (w[:, None, 1:] / (1.0 + first)[:, None, None])
    return blocks


# Routines in the order in which `JldFronts` takes them
_ROUTINES: Final = (
    (cython_lapack, "dpotrf"),
    (cython_blas, "dtrsm"),
    (cython_blas, "dsyrk"),
    (cython_blas, "dtrsv"),
    (cython_blas, "dgemv"),
)


class Solves(Protocol):
    def solve(self, rhs: Floats) -> Floats:
        """Solve the system for right-hand sides (n,) or (n, k)."""


class Factorisation(Protocol):
    """Symbolic Cholesky analysis of one sparsity pattern, reused for matrices of that pattern."""

    def factor(self, data: Floats) -> Solves:
        """Compute the Cholesky factor; raise np.linalg.LinAlgError if the matrix is indefinite."""


def factorisation(fronts: Fronts) -> Factorisation:
    """Return the compiled factorisation of a pattern; `fronts` itself without library or a BLAS of 32-bit integers."""
    variant, routines = chosen(), _addresses()
    return fronts if variant is None or routines is None else CompiledFronts(fronts, variant, routines)


@cache
def _addresses() -> tuple[int, ...] | None:
    """Return the addresses of `_ROUTINES`; None if scipy's BLAS has no 32-bit integers."""
    if any("int *" not in repr(module.__pyx_capi__[name]) for module, name in _ROUTINES):
        return None
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    capsules = [module.__pyx_capi__[name] for module, name in _ROUTINES]
    return tuple(api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule)) for capsule in capsules)


class CompiledFronts:
    def __init__(self, fronts: Fronts, variant: str, routines: tuple[int, ...]) -> None:
        self._library = library(variant)
        self.order, self.rank = fronts.order, fronts.rank
        pivots = np.diff(fronts.bounds)
        passed_count = np.array([len(passed) for passed in fronts.passed], dtype=np.int64)
        ends = np.cumsum(pivots * (pivots + passed_count))
        start, self.size = ends - pivots * (pivots + passed_count), int(ends[-1]) if len(ends) else 0
        # Entries are numbered in the pivot matrix and in the panel of their front; here both are one array, column by
        # column.
        part = np.repeat(np.arange(2 * len(pivots)), np.diff(fronts.cut))
        front, below = part // 2, part % 2
        height = np.where(below == 1, passed_count[front], pivots[front])
        column, row = fronts.target // height, fronts.target % height
        self._entries = fronts.entries
        self._target = start[front] + column * (pivots + passed_count)[front] + row + below * pivots[front]
        self._arrays: dict[str, NDArray[Any]] = {
            "bounds": np.ascontiguousarray(fronts.bounds, dtype=np.int64),
            "passed_start": np.concatenate([[0], np.cumsum(passed_count)]).astype(np.int64),
            "passed": np.concatenate([*fronts.passed, np.zeros(0, dtype=np.int64)]).astype(np.int64),
            "place": _rows_in_parents(fronts),
            "parent": fronts.parent.astype(np.int32),
            "factor_start": start.astype(np.int64),
            "routines": np.array(routines, dtype=np.int64),
        }
        self._struct = FrontsOfC(count=len(pivots), **pointers(**self._arrays))

    def factor(self, data: Floats) -> CompiledFactor:
        values, definite = np.zeros(self.size), np.zeros(1, dtype=np.uint8)
        values[self._target] = data[self._entries]
        arguments = pointers(factor=values, definite=definite)
        require_success(self._library.jld_factor_fronts(self._struct, arguments["factor"], arguments["definite"]))
        if not definite[0]:
            raise np.linalg.LinAlgError("matrix is not positive definite")
        return CompiledFactor(self, values)

    def solve(self, factor: Floats, columns: Floats) -> None:
        """Solve for right-hand sides (k, n) in the order of elimination, in place."""
        arguments = pointers(factor=factor, x=columns)
        require_success(self._library.jld_solve_fronts(self._struct, arguments["factor"], len(columns), arguments["x"]))


class CompiledFactor:
    """Cholesky factorisation; numbers: pivot columns of all fronts."""

    def __init__(self, fronts: CompiledFronts, values: Floats) -> None:
        self._fronts, self._values = fronts, values

    def solve(self, rhs: Floats) -> Floats:
        fronts = self._fronts
        columns = np.ascontiguousarray(np.atleast_2d(rhs.T)[:, fronts.order], dtype=float)
        fronts.solve(self._values, columns)
        return np.asarray(columns[:, fronts.rank].T.reshape(rhs.shape))


def _rows_in_parents(fronts: Fronts) -> Ints:
    """Return the row of each unknown of the update matrices in its parent front."""
    # The pivot unknowns of the parent come first. Fronts follow each other; roots have zeros.
    rows = [np.zeros(0, dtype=np.int64)]
    for passed, parent in zip(fronts.passed, fronts.parent.tolist(), strict=True):
        if parent < 0:
            rows.append(np.zeros(len(passed), dtype=np.int64))
            continue
        first, last = fronts.bounds[parent : parent + 2].tolist()
        below = np.searchsorted(fronts.passed[parent], passed)
        rows.append(np.where(passed < last, passed - first, last - first + below))
    return np.concatenate(rows).astype(np.int32)


# Entry in the equations of a block, relative to the largest term of its column, below which it is rounding. Terms of
# faces within the block cancel up to rounding, which grows with the distance from the root in element sizes.
_CANCELLED = 1e-11


class BlockEquations:
    """Equations of a program replaced by those of whole blocks, for one labelling; sums: matrix T of `Bodies.sums`.

    Only data change from program to program: the new ones are a linear map of the old.
    """

    def __init__(self, program: ConicProgram, sums: sp.csr_array) -> None:
        structure = program.structure
        equalities, (height, width) = structure.equalities, structure.shape
        self._sums, self._equalities = sums, equalities
        self._program, self._is_equation = program, structure.indices < equalities
        column = np.repeat(np.arange(width), np.diff(structure.indptr))
        is_equation = self._is_equation
        # An entry in equation j becomes one term, with a factor, in each equation i where T has an entry (i, j).
        in_equations, row = np.flatnonzero(is_equation), structure.indices[is_equation]
        by_column = sp.csc_array(sums)
        count = np.diff(by_column.indptr)[row]
        source = np.repeat(in_equations, count)
        start = np.cumsum(count) - count
        entry = np.arange(len(source)) - np.repeat(start - by_column.indptr[row], count)
        target, factor = by_column.indices[entry].astype(np.int64), by_column.data[entry]
        # Yield rows stay as they are.
        yield_entries = np.flatnonzero(~is_equation)
        source = np.concatenate([source, yield_entries])
        target = np.concatenate([target, structure.indices[yield_entries]])
        factor = np.concatenate([factor, np.ones(len(yield_entries))])
        keys, key_of_term = np.unique(column[source] * height + target, return_inverse=True)
        terms = factor * program.data[source]
        total = np.bincount(key_of_term, terms, len(keys))
        largest = np.zeros(width)
        np.maximum.at(largest, column[source], abs(terms))
        summed = np.zeros(height, dtype=bool)  # equations of blocks of several elements
        summed[:equalities][np.diff(sums.indptr) > 1] = True
        significant = ~summed[keys % height] | (abs(total) > _CANCELLED * largest[keys // height])
        position = np.cumsum(significant) - 1
        used = significant[key_of_term]
        shape = int(significant.sum()), len(program.data)
        self._map = sp.csr_array((factor[used], (position[key_of_term[used]], source[used])), shape=shape)
        keys = keys[significant]
        indptr = np.searchsorted(keys // height, np.arange(width + 1))
        self.structure = replace(structure, indices=keys % height, indptr=indptr)

    def fits(self, program: ConicProgram) -> bool:
        """Return True if `changed` applies: same structure, labelling and equation coefficients."""
        original = self._program
        if program is original:
            return True
        if program.structure is not original.structure or program.bodies is None or original.bodies is None:
            return False
        same = np.array_equal(program.bodies.labels, original.bodies.labels)
        return same and np.array_equal(program.data[self._is_equation], original.data[self._is_equation])

    def changed(self, program: ConicProgram) -> ConicProgram:
        """Replace the equations of a program that fits by those of whole blocks."""
        rhs = np.concatenate([self._sums @ program.rhs[: self._equalities], program.rhs[self._equalities :]])
        return replace(program, structure=self.structure, data=np.asarray(self._map @ program.data), rhs=rhs)

    def multipliers(self, dual: Floats) -> Floats:
        """Return the multipliers (rows,) of the original program from those of the changed one."""
        return np.concatenate([self._sums.T @ dual[: self._equalities], dual[self._equalities :]])


_WIDE = 100  # a column with more entries borders the system and belongs to no face
_MOST_BORDER = 8  # largest number of border columns, which are solved for densely
_MOST = 60  # largest number of columns of a matrix block; larger ones mean that the program has no faces


class Entries(NamedTuple):
    """Positions of entries in a program's data, and in a flat array that they fill."""

    data: Ints
    place: Ints


class BorderEntries(NamedTuple):
    """Positions in a program's data of entries in border columns, with their equation or yield row."""

    data: Ints
    row: Ints
    column: Ints  # number among the border columns

    def table(self, data: Floats, rows: int, columns: int) -> Floats:
        """Return the entries as an array (rows, columns), zero elsewhere."""
        table = np.zeros((rows, columns))
        table[self.row, self.column] = data[self.data]
        return table


@dataclass(frozen=True)
class Family:
    """Data positions of m faces whose matrix blocks have equal sizes, as stacked arrays."""

    columns: Ints  # (m, k) program columns of each face
    rows: Ints  # (m, rows) yield rows of each face, numbered after the equations, half-lines first
    equations: Ints  # (m, r) equations that each face enters
    # linear, cones: number of half-lines and of cones per face
    linear: int
    cones: int
    g: Entries  # (m, rows, k) of yield rows
    a: Entries  # (m, r, k) of equations
    border: Entries  # (m, rows, border) of yield rows in border columns


@dataclass(frozen=True)
class FaceBlocks:
    """Rows and columns of a program grouped by face, as positions in the program's data."""

    cones: Cones  # product of cones of the yield rows
    families: tuple[Family, ...]  # faces, grouped by size
    border: Ints  # (border,) columns that belong to no face
    idle: Ints  # columns without yield rows; no program may have entries in them
    border_yields: BorderEntries  # in yield rows that only border columns enter
    border_equations: BorderEntries  # in equations


def face_blocks(structure: Structure) -> FaceBlocks:
    """Find which columns, rows and equations belong to each face.

    Raises SolverError for cones of several sizes, or columns that do not separate into small blocks.
    """
    sizes = set(structure.cones)
    if len(sizes) > 1:
        raise SolverError("the Schur route takes cones of one size only")
    size = sizes.pop() if sizes else 1
    cones = Cones(structure.linear, len(structure.cones), size)
    equalities, (rows, columns) = structure.equalities, structure.shape
    # column, row and position of each entry of the program's data
    column = np.repeat(np.arange(columns), np.diff(structure.indptr))
    row, data = structure.indices, np.arange(len(structure.indices))
    yields = row >= equalities
    # The first row of a cone stands for all of its rows.
    head = np.arange(rows)
    first = equalities + structure.linear
    head[first:] = first + (np.arange(rows - first) // size) * size
    touched = np.zeros(columns, dtype=bool)
    touched[column[yields]] = True
    part, is_border = _parts(column, row, yields, head, touched)
    idle = np.flatnonzero(~touched & ~is_border)
    face_column = np.flatnonzero(touched & ~is_border)
    border = np.flatnonzero(is_border)
    if len(border) > _MOST_BORDER:
        raise SolverError("the columns of this program are not separable by face")
    faces, column_face = np.unique(part[face_column], return_inverse=True)
    row_part = part[columns + head]
    nearest = np.minimum(np.searchsorted(faces, row_part), max(len(faces) - 1, 0))
    row_face = np.where(faces[nearest] == row_part, nearest, -1) if len(faces) else np.full(rows, -1)
    row_face[:equalities] = -1
    border_index = np.full(columns, -1)
    border_index[border] = np.arange(len(border))
    if np.any(row_face[first:] < 0):
        raise SolverError("a cone of this program belongs to no face")
    in_equations, in_yields = is_border[column] & ~yields, is_border[column] & yields & (row_face[row] < 0)
    layout = _Layout(face_column, column_face, row_face, equalities, first, columns)
    return FaceBlocks(
        cones=cones,
        families=layout.families(row, column, data, yields, is_border, border_index, size),
        border=border,
        idle=idle,
        border_yields=BorderEntries(data[in_yields], row[in_yields] - equalities, border_index[column[in_yields]]),
        border_equations=BorderEntries(data[in_equations], row[in_equations], border_index[column[in_equations]]),
    )


def _parts(column: Ints, row: Ints, yields: Bools, head: Ints, touched: Bools) -> tuple[Ints, Bools]:
    """Return the parts (columns + rows,) that yield rows join, and a mask (columns,) of those that border them.

    column, row, yields: of each entry; head: (rows,) row that stands for it; touched: (columns,) enter yield rows.
    """
    columns, rows = len(touched), len(head)
    is_border = np.zeros(columns, dtype=bool)
    is_border[np.bincount(column, minlength=columns) > _WIDE] = True
    is_border[-1] = True
    chosen = yields & ~is_border[column]
    part = components(columns + rows, column[chosen], columns + head[row[chosen]])
    # A column that shares its rows with no other column is a load factor and belongs to no face.
    columns_of_part = np.bincount(part[:columns][~is_border], minlength=part.max() + 1)
    if columns_of_part.max(initial=0) > _MOST:
        raise SolverError("the columns of this program are not separable by face")
    return part, is_border | (touched & (columns_of_part[part[:columns]] == 1))


class _Layout:
    """Local numbers of columns, yield rows and equations within their faces."""

    def __init__(
        self, face_column: Ints, column_face: Ints, row_face: Ints, equalities: int, first: int, columns: int
    ) -> None:
        self.equalities = equalities
        self.count = int(column_face.max(initial=-1)) + 1
        self.face_of_column = np.full(columns, -1)
        self.face_of_column[face_column] = column_face
        self.face_of_row = row_face
        self.columns = _Groups.by_owner(self.face_of_column, self.count)
        self.rows = _Groups.by_owner(row_face, self.count)
        self.half_lines = np.bincount(row_face[equalities:first][row_face[equalities:first] >= 0], minlength=self.count)

    def families(
        self, row: Ints, column: Ints, data: Ints, yields: Bools, is_border: Bools, border_index: Ints, size: int
    ) -> tuple[Family, ...]:
        """Group the faces by size, and locate their data; yields: entries of yield rows, is_border: (columns,)."""
        # entries of equations, of yield rows, and of yield rows in border columns
        in_a = ~yields & (self.face_of_column[column] >= 0)
        in_g = yields & (self.face_of_column[column] >= 0)
        in_border = yields & is_border[column] & (self.face_of_row[row] >= 0)
        face_a = self.face_of_column[column[in_a]]
        # equations of each face, once each
        face_equations, equation = np.unique(face_a * self.equalities + row[in_a], return_inverse=True)
        pair_face = face_equations // max(self.equalities, 1)
        equations = np.searchsorted(pair_face, np.arange(self.count + 1))
        local_equation = equation - equations[face_a]
        sizes = np.column_stack(
            [np.diff(self.columns.start), np.diff(self.rows.start), np.diff(equations), self.half_lines]
        )
        kinds, family = np.unique(sizes, axis=0, return_inverse=True)
        border = int((border_index >= 0).sum())
        families = []
        for number, (k, rows, r, half_lines) in enumerate(kinds.tolist()):  # k columns and r equations of a face
            faces = np.flatnonzero(family == number)
            place_in_family = np.full(self.count + 1, -1)  # place of each face in this family, −1 elsewhere
            place_in_family[faces] = np.arange(len(faces))
            family_place_a, family_place_g = place_in_family[face_a], place_in_family[self.face_of_column[column[in_g]]]
            family_place_border = place_in_family[self.face_of_row[row[in_border]]]
            # positions in the flat arrays of `Family`
            place_a = (family_place_a * r + local_equation) * k + self.columns.number[column[in_a]]
            place_g = (family_place_g * rows + self.rows.number[row[in_g]]) * k + self.columns.number[column[in_g]]
            place_border = (family_place_border * rows + self.rows.number[row[in_border]]) * border
            place_border += border_index[column[in_border]]
            families.append(
                Family(
                    columns=self.columns.of(faces, k),
                    rows=self.rows.of(faces, rows) - self.equalities,
                    equations=(face_equations % max(self.equalities, 1))[equations[faces][:, None] + np.arange(r)],
                    linear=half_lines,
                    cones=(rows - half_lines) // size,
                    g=Entries(data[in_g][family_place_g >= 0], place_g[family_place_g >= 0]),
                    a=Entries(data[in_a][family_place_a >= 0], place_a[family_place_a >= 0]),
                    border=Entries(data[in_border][family_place_border >= 0], place_border[family_place_border >= 0]),
                )
            )
        return tuple(families)


class _Groups(NamedTuple):
    """Members of groups, ascending in each."""

    members: Ints  # group by group
    start: Ints  # first member of each group
    number: Ints  # (n,) number of each member in its group, −1 without one

    @classmethod
    def by_owner(cls, owner: Ints, count: int) -> _Groups:
        """Group n members by owner (n,), −1 for none."""
        members = np.argsort(owner, kind="stable")
        members = members[np.searchsorted(owner[members], 0) :]
        start = np.searchsorted(owner[members], np.arange(count + 1))
        number = np.full(len(owner), -1)
        number[members] = np.arange(len(members)) - start[owner[members]]
        return cls(members, start, number)

    def of(self, groups: Ints, size: int) -> Ints:
        """Return the members (k, size) of groups (k,) of equal size."""
        return np.asarray(self.members[self.start[groups][:, None] + np.arange(size)])


def filled(shape: tuple[int, ...], entries: Entries, data: Floats) -> Floats:
    """Place some entries of a program's data in an array, zero elsewhere."""
    array = np.zeros(shape)
    array.ravel()[entries.place] = data[entries.data]
    return array
