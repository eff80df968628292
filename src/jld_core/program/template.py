"""Template of the conic programs of one assembly: data independent of the labelling.

The row λ ≥ −c, feasible near zero, gives proofs of instability their sign.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.geometry import moment_about
from jld_core.mechanics import Scaling, YieldSet, equilibrium_matrix, load_vectors, scaling_of, yield_set
from jld_core.mechanics.yield_set import Rows
from jld_core.strengths import CRITERIA, STANDARD, Route
from jld_core.tolerances import Precision


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
        has_support = np.zeros(int(block.max(initial=-1)) + 1, dtype=bool)
        has_support[block[elements.support]] = True
        free = elements.free
        block, centroid = block[free], elements.centroid[free]
        size = np.maximum(np.bincount(block, minlength=len(has_support)), 1)
        centre = np.column_stack([np.bincount(block, coordinate, len(has_support)) / size for coordinate in centroid.T])
        # Rounding lets the choice between elements at the same distance depend neither on units nor on position.
        distance = np.round(np.linalg.norm(centroid - centre[block], axis=1) / self.assembly.size, 6)
        order = np.lexsort((distance, block))
        nearest = np.full(len(has_support), -1)
        blocks, start = np.unique(block[order], return_index=True)
        nearest[blocks] = order[start]
        return np.asarray(np.where(has_support[block], np.arange(len(free)), nearest[block]), dtype=np.int64)

    def sums(self, equations: int) -> sp.csr_array | None:
        """Return the invertible matrix T that replaces the equations of each root by those of its block.

        None where every free block is one element.
        """
        # A block's equations are sums over its elements, with moments about the centroid of the root. Source:
        # docs/method.md (8.6).
        root = self.root
        members = np.flatnonzero(root != np.arange(len(root)))
        if not len(members):
            return None
        assembly = self.assembly
        d, q = assembly.dimension, assembly.freedoms
        centroid = assembly.elements.centroid[assembly.elements.free]
        scale = self.scaling.row.reshape(-1, q)
        root_of_member = root[members]
        arm = centroid[members] - centroid[root_of_member]
        block = np.tile(np.eye(q), (len(members), 1, 1))
        for j in range(d):
            block[:, d:, j] = moment_about(arm, np.broadcast_to(np.eye(d)[j], arm.shape))
        block *= scale[members][:, None, :] / scale[root_of_member][:, :, None]
        rows = q * root_of_member[:, None, None] + np.arange(q)[:, None]
        columns = q * members[:, None, None] + np.arange(q)
        rows, columns = np.broadcast_to(rows, block.shape).ravel(), np.broadcast_to(columns, block.shape).ravel()
        nonzero = block.ravel() != 0.0
        shape = (equations, equations)
        return sp.eye_array(equations, format="csr") + sp.csr_array(
            (block.ravel()[nonzero], (rows[nonzero], columns[nonzero])), shape=shape
        )


@dataclass(frozen=True)
class Structure:
    """Sparsity of M (compressed columns) and cones that all programs of one template share."""

    indices: Ints
    indptr: Ints
    shape: tuple[int, int]
    equalities: int  # number of first rows, with s = 0
    linear: int  # number of rows after them, with s ≥ 0
    cones: tuple[int, ...]  # sizes of the second-order cones of the other rows
    places: Floats | None = None  # (equalities, d) of the element of each equation, a hint for the elimination order

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
        structure = self.structure
        return sp.csc_array((self.data, structure.indices, structure.indptr), shape=structure.shape)


_ROUTE: Final = Route("programs", STANDARD | CRITERIA)


@dataclass(frozen=True)
class Beside:
    """One scaled equation in addition to equilibrium: row·F + dead + λ live = 0.

    Parameters
    ----------
    row : (q·m,) array
        Coefficients of the resultants.
    dead, live : float
        Constant term and coefficient of λ.
    """

    row: Floats
    dead: float
    live: float


class Template:
    """Programs of one assembly: all their data that do not depend on the labelling, scaled.

    Make it once per assembly, and call `program` for each labelling.

    Parameters
    ----------
    assembly : Assembly
        Structure with one load case.
    scaling : Scaling, optional
        Default: `scaling_of(assembly)`.
    sets : YieldSet, optional
        Default: `yield_set(assembly, scaling)`.
    beside : Beside, optional
        One more equation, whose multiplier is the last velocity.

    Attributes
    ----------
    assembly, scaling, yield_set, beside
        As above.
    matrix : (q·free, q·m) sparse array
        Scaled equilibrium matrix with all resultants active; one row longer with `beside`.
    dead, live : (q·free,) arrays
        Scaled load vectors, one entry longer with `beside`.
    floor : float
        Lower limit of the program on scaled λ: λ ≥ −floor.
    structure : Structure
        Structure of all programs.

    Raises
    ------
    ValueError
        The assembly has load cases; make one template for each of `Assembly.by_case`.
    """

    def __init__(
        self,
        assembly: Assembly,
        scaling: Scaling | None = None,
        sets: YieldSet | None = None,
        beside: Beside | None = None,
    ) -> None:
        if assembly.cases:
            raise ValueError("an assembly with load cases has a template for each: see Assembly.by_case")
        self.assembly = assembly
        self.scaling = scaling or scaling_of(assembly)
        self.yield_set: YieldSet = sets or yield_set(assembly, self.scaling)
        row, face = self.scaling.row.ravel(), self.scaling.face.ravel()
        matrix = equilibrium_matrix(assembly)
        self.matrix = sp.csc_array(sp.diags_array(1.0 / row) @ matrix @ sp.diags_array(face))
        dead, live = load_vectors(assembly)
        self.dead = dead / row
        self.live = self.scaling.load * live / row
        self.beside = beside
        if beside is not None:
            self.matrix = sp.csc_array(sp.vstack([self.matrix, sp.csr_array(beside.row[None, :])]))
            self.dead = np.append(self.dead, beside.dead)
            self.live = np.append(np.zeros(len(self.live)), beside.live)
        self.matrix.sort_indices()
        # A fraction other than one of the weight: a live load that mirrors the dead load would otherwise put
        # λ = −floor on the boundary of the admissible range.
        self.floor = 0.3 * (assembly.total_dead / self.scaling.force or 1.0)
        self._lay_out(self.yield_set)

    @property
    def precision(self) -> Precision:
        if not self.structure.cones:
            return tolerances.LINEAR
        strengths = self.assembly.strengths(_ROUTE)
        crushing = strengths.crushes
        return tolerances.CRUSHING if (crushing & ~self.assembly.of_members).any() else tolerances.FRICTION_CONES

    def renumbered(self, sets: YieldSet) -> Template:
        """Return a template with another yield set, which shares scaling, equilibrium and, if equal, sparsity."""
        copied = self.with_rows(sets)
        copied.yield_set = sets
        return copied

    def with_rows(self, rows: Rows) -> Template:
        """Return a template with other rows in its programs, whose attribute `yield_set` stays."""
        copied = copy.copy(self)
        copied._lay_out(rows)
        before, after = self.structure, copied.structure
        same = (before.shape, before.linear, before.cones) == (after.shape, after.linear, after.cones)
        if same and np.array_equal(before.indptr, after.indptr) and np.array_equal(before.indices, after.indices):
            copied.structure = before
        return copied

    @property
    def columns(self) -> int:
        """Return the number of resultants, extra variables and λ."""
        return self.structure.shape[1]

    def _lay_out(self, sets: Rows) -> None:
        """Build structure, coefficients and right-hand sides of the programs under either label."""
        pattern, matrix, q = sets.pattern, self.matrix, self.assembly.freedoms
        equalities, resultants = matrix.shape
        all_dry = np.ones(len(self.assembly.interfaces), dtype=bool)
        on_dry, on_inner = sets.active(all_dry), sets.active(~all_dry)
        coo = matrix.tocoo()
        row, column = coo.coords
        active_dry, active_inner = on_dry.ravel()[column], on_inner.ravel()[column]
        live = np.flatnonzero(self.live)
        column_of_load = resultants + pattern.extra
        rows = np.concatenate([row, live, [equalities], pattern.row + equalities + 1])
        columns = np.concatenate([column, np.full(live.size, column_of_load), [column_of_load], pattern.column])
        dry = np.concatenate([coo.data * active_dry, self.live[live], [-1.0], pattern.dry])
        inner = np.concatenate([coo.data * active_inner, self.live[live], [-1.0], pattern.inner])
        face = np.concatenate([column // q, np.zeros(live.size + 1, dtype=np.int64), pattern.face])
        order = np.lexsort((rows, columns))
        self._dry, self._inner, self._face = dry[order], inner[order], face[order]
        count = equalities + 1 + len(pattern.h_dry)
        indptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=column_of_load + 1))])
        self.structure = Structure(
            indices=rows[order],
            indptr=indptr,
            shape=(count, column_of_load + 1),
            equalities=equalities,
            linear=1 + pattern.linear,
            cones=pattern.cones,
            places=self._places(),
        )
        shared_rhs = np.concatenate([-self.dead, [self.floor]])
        self._rhs_dry = np.concatenate([shared_rhs, pattern.h_dry])
        self._rhs_inner = np.concatenate([shared_rhs, pattern.h_inner])
        self._row_face = np.concatenate([np.zeros(len(shared_rhs), dtype=np.int64), pattern.row_face])
        self._slack_rows = np.zeros(count)
        self._slack_rows[len(shared_rhs) : len(shared_rhs) + pattern.linear] = 1.0
        self._slack_rows[self.structure.heads] = 1.0
        self._objective = np.zeros(column_of_load + 1)
        self._objective[-1] = -1.0
        self._pressure = np.zeros(column_of_load + 1)
        self._pressure[np.arange(0, resultants, q)] = -1.0

    def _places(self) -> Floats:
        """Return coordinates (equations, d) for the elimination order.

        Centroids of free elements, their mean for `beside`.
        """
        elements = self.assembly.elements
        places = np.repeat(elements.centroid[elements.free], self.assembly.freedoms, axis=0)
        return places if self.beside is None else np.vstack([places, places.mean(axis=0)])

    def program(
        self, labels: Bits, margin: float = 0.0, *, other: Template | None = None, taken: Bools | None = None
    ) -> ConicProgram:
        """Return the conic program of one labelling: maximise λ over admissible forces.

        Parameters
        ----------
        labels : (m,) bool array
            True = dry.
        margin : float
            Scaled distance that forces keep from the boundary of every yield set, and reward per unit of normal force.
            A value above 0 leaves room to repair the solution; all joints then open in the mechanism.
        other : Template, optional
            Template of the same structure, whose rows of dry faces replace those of the faces `taken`.
        taken : (m,) bool array, optional
            Faces with the rows of `other`; without it `other` has no effect.

        Returns
        -------
        ConicProgram
            Program with the unknowns resultants, extra variables and λ, all scaled.
        """
        data = np.where(labels[self._face], self._dry, self._inner)
        rhs = np.where(labels[self._row_face], self._rhs_dry, self._rhs_inner)
        if other is not None and taken is not None:
            data = np.where(taken[self._face], other._dry, data)
            rhs = np.where(taken[self._row_face], other._rhs_dry, rhs)
        objective = self._objective
        if margin:
            rhs = rhs - margin * self._slack_rows
            objective = objective + margin * self._pressure
        return ConicProgram(self.structure, data, rhs, objective, Bodies(self.assembly, self.scaling, labels))
