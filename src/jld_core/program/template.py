"""Template of the conic programs of one assembly: data independent of the labelling.

Rows: equilibrium, λ ≥ −c (feasible near zero; gives proofs of instability their sign), yield rows. A labelling chooses
between two arrays of numbers.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.mechanics import Scaling, YieldSet, equilibrium_matrix, load_vectors, scaling_of, yield_set
from jld_core.mechanics.yield_set import Rows
from jld_core.program.conic import Bodies, ConicProgram, Structure
from jld_core.strengths import CRITERIA, STANDARD, Route
from jld_core.tolerances import Precision

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
        other = self.with_rows(sets)
        other.yield_set = sets
        return other

    def with_rows(self, rows: Rows) -> Template:
        """Return a template with other rows in its programs, whose attribute `yield_set` stays."""
        other = copy.copy(self)
        other._lay_out(rows)
        old, new = self.structure, other.structure
        same = (old.shape, old.linear, old.cones) == (new.shape, new.linear, new.cones)
        if same and np.array_equal(old.indptr, new.indptr) and np.array_equal(old.indices, new.indices):
            other.structure = old
        return other

    @property
    def columns(self) -> int:
        """Return the number of resultants, extra variables and λ."""
        return self.structure.shape[1]

    def _lay_out(self, sets: Rows) -> None:
        """Build structure, coefficients and right-hand sides of the programs under either label."""
        pattern, matrix, q = sets.pattern, self.matrix, self.assembly.freedoms
        equalities, resultants = matrix.shape
        every = np.ones(len(self.assembly.interfaces), dtype=bool)
        on_dry, on_inner = sets.active(every), sets.active(~every)
        coo = matrix.tocoo()
        row, column = coo.coords
        keep_dry, keep_inner = on_dry.ravel()[column], on_inner.ravel()[column]
        live = np.flatnonzero(self.live)
        last = resultants + pattern.extra
        rows = np.concatenate([row, live, [equalities], pattern.row + equalities + 1])
        columns = np.concatenate([column, np.full(live.size, last), [last], pattern.column])
        dry = np.concatenate([coo.data * keep_dry, self.live[live], [-1.0], pattern.dry])
        inner = np.concatenate([coo.data * keep_inner, self.live[live], [-1.0], pattern.inner])
        face = np.concatenate([column // q, np.zeros(live.size + 1, dtype=np.int64), pattern.face])
        order = np.lexsort((rows, columns))
        self._dry, self._inner, self._face = dry[order], inner[order], face[order]
        count = equalities + 1 + len(pattern.h_dry)
        indptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=last + 1))])
        self.structure = Structure(
            indices=rows[order],
            indptr=indptr,
            shape=(count, last + 1),
            equalities=equalities,
            linear=1 + pattern.linear,
            cones=pattern.cones,
            places=self._places(),
        )
        head = np.concatenate([-self.dead, [self.floor]])
        self._rhs_dry = np.concatenate([head, pattern.h_dry])
        self._rhs_inner = np.concatenate([head, pattern.h_inner])
        self._row_face = np.concatenate([np.zeros(len(head), dtype=np.int64), pattern.row_face])
        self._tips = np.zeros(count)
        self._tips[len(head) : len(head) + pattern.linear] = 1.0
        self._tips[self.structure.heads] = 1.0
        self._objective = np.zeros(last + 1)
        self._objective[-1] = -1.0
        self._pressure = np.zeros(last + 1)
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
            rhs = rhs - margin * self._tips
            objective = objective + margin * self._pressure
        return ConicProgram(self.structure, data, rhs, objective, Bodies(self.assembly, self.scaling, labels))
