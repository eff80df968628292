"""Forces and mechanisms that prove as much as possible about other labellings.

The forces and the mechanism that prove one λ are seldom unique. Interior points choose the middle of them, where
nothing is exactly at rest and little is exactly free; a linear program chooses those that leave most faces free
(METHOD §6). Planar programs without cones only: what comes back is a vertex, computed afresh each time, so that
it depends on the labelling and λ alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.assembly import Bits, Bools, Floats, Ints
from jld_core.bracket import Motion, Prover, State
from jld_core.interior import Interior
from jld_core.program import Template

_MARGIN = 1e-12  # slack asked of every row, so that a vertex is inside after rounding
_SPARSE = 1e-2  # excess below which a face counts as nearly free when weights are chosen anew
_WANDERING = 5.0  # price of a jump that the other label does not allow, per unit of jump
_IDLE = 1e-3  # price of any motion at all, beside what it dissipates
_WORK = 1e-8  # work of the live load asked of a falling motion, so that repairs cannot turn it negative
_REST = 1e-12  # jumps below this, relative to the largest velocity, are the rounding of zero
_INF = highspy.kHighsInf


class Sharpener:
    """Linear programs on one template. candidates: (m,) faces whose other label counts."""

    def __init__(self, template: Template, prover: Prover, interior: Interior, candidates: Bools) -> None:
        self.template, self.prover, self.interior = template, prover, interior
        every = np.ones(len(candidates), dtype=bool)
        sets = template.yield_set
        self.usable = bool(not template.structure.cones and sets.active(every).all() and sets.active(~every).all())
        self._cover = np.isin(sets.pattern.row_face, np.flatnonzero(candidates))
        if self.usable:
            self._force_table = self._lay_out_forces()
            self._motion_table = self._lay_out_motions()

    # --- forces -----------------------------------------------------------------------------------------

    def forces(self, labels: Bits, load: float) -> State | None:
        """A state of a labelling at λ ≥ load that the other label of as many faces as possible would admit.

        minimise Σ w_f v_f  subject to  A F + b + λ b_λ = 0,  G F ≤ h,  G' F ≤ h' + v_f, where G', h' are the
        rows of the other labels; w = 1, then 1/v of the first answer. None where no admissible state is found.
        """
        state = None
        for margin in (_MARGIN, 0.0):
            point = self._spread(labels, load, margin)
            if point is None:
                return None
            state = self.prover.state(point, labels)
            if state.admissible:
                return state
        # sets that leave no room at all: a vertex meets its equations exactly, so rounding is no violation
        assert state is not None
        noise = tolerances.ROUNDING * max(1.0, float(abs(state.forces).max()))
        if state.slack >= -noise and state.error <= noise:
            return State(state.forces, state.load, 0.0, 0.0)
        return None

    def _lay_out_forces(self) -> _Layout:
        s, pattern = self.template.structure, self.template.yield_set.pattern
        own, other = _tagged(self.template, 0), _tagged(self.template, len(s.indices))
        rows = other.tocsr()[s.equalities + 1 :][self._cover]
        face = pattern.row_face[self._cover]
        faces, count = len(self.template.assembly.interfaces), len(face)
        excess = sp.csr_array((np.arange(count) + 1.0, (np.arange(count), face)), shape=(count, faces))
        excess.data += 2.0 * len(s.indices)
        table = sp.csc_array(sp.block_array([[own, None], [rows, excess]]))
        # there are four times as many rows as columns: the dual program is the quicker one
        return _Layout.of([[table.T]], -np.ones(count))

    def _spread(self, labels: Bits, load: float, margin: float) -> Floats | None:
        own, other = self.template.program(labels), self.template.program(~labels)
        s, faces = own.structure, len(labels)
        upper = np.concatenate([own.rhs, other.rhs[s.equalities + 1 :][self._cover] - margin])
        upper[s.equalities] = -load
        upper[s.equalities + 1 : s.shape[0]] -= margin
        width = s.shape[1]
        weight = np.concatenate([np.zeros(width), -np.ones(faces)])
        least = np.concatenate([np.full(s.equalities, -_INF), np.zeros(len(upper) - s.equalities)])
        most = np.concatenate([np.zeros(width), np.full(faces, _INF)])
        highs = self._force_table.program((own.data, other.data), weight, most, upper, least)
        if _run(highs) is None:
            return None
        point = np.array(highs.getSolution().row_dual)
        places = np.arange(width, width + faces)
        weight = -1.0 / (np.maximum(point[width:], 0.0) + _SPARSE)
        for place, least_weight in zip(places.tolist(), weight.tolist(), strict=True):
            highs.changeRowBounds(place, least_weight, _INF)
        if _run(highs) is not None:
            point = np.array(highs.getSolution().row_dual)
        return point[:width]

    # --- mechanisms -------------------------------------------------------------------------------------

    def motion(self, labels: Bits, bound: float) -> Motion | None:
        """A mechanism of a labelling with λ ≤ bound at which the other labels would dissipate least."""
        return self._move(labels, 1.0, 1.0, bound)

    def fall(self, labels: Bits) -> Motion | None:
        """A motion that gains energy under the dead load, b_λ·u ≥ 0, as useful for other labellings."""
        for work in (_WORK, 0.0):
            found = self._move(labels, work, _INF, -1.0, falls=True)
            if found is not None:
                return found
        return None

    def _lay_out_motions(self) -> _Layout:
        template, skip = self.template, self.template.structure.equalities + 1
        columns, kept = template.matrix.shape[1], self._kept
        size = len(template.structure.indices)
        yields = _tagged(template, 0).tocsr()[skip:, :columns]
        others = _tagged(template, size).tocsr()[skip:, :columns][self._cover]
        first, loose = yields.shape[0], int(kept.sum())
        shares = sp.csr_array(2.0 * size + 1.0 + np.arange(first)[None])
        constants: list[Floats] = []
        start = 2.0 * size + first

        def constant(table: Any) -> Any:
            nonlocal start
            table = sp.csr_array(table)
            constants.append(table.data)
            table = sp.csr_array((start + 1.0 + np.arange(table.nnz), table.indices, table.indptr), shape=table.shape)
            start += table.nnz
            return table

        transposed = self.prover.transposed
        one = sp.eye_array(loose)
        blocks = [
            [constant(transposed), yields.T, None, None, None],
            [constant(transposed[kept]), None, others.T.tocsr()[kept], constant(one), constant(-one)],
            [constant(template.live[None]), None, None, None, None],
            [constant(-template.dead[None]), shares, None, None, None],
        ]
        return _Layout.of(blocks, np.concatenate(constants))

    @property
    def _kept(self) -> Bools:
        """(q·m,) jumps of the candidates."""
        face = self.template.yield_set.pattern.row_face[self._cover]
        faces = np.isin(np.arange(len(self.template.assembly.interfaces)), face)
        return np.repeat(faces, self.template.assembly.freedoms)

    def _move(
        self, labels: Bits, least_work: float, most_work: float, bound: float, *, falls: bool = False
    ) -> Motion | None:
        """minimise Σ h'·z' + price of w  subject to  Aᵀu = −Gᵀz,  Aᵀu + w = −G'ᵀz',  h·z − b·u ≤ bound."""
        template = self.template
        own, other = template.program(labels), template.program(~labels)
        size = own.structure.equalities
        loose = int(self._kept.sum())
        prices = np.maximum(other.rhs[size + 1 :][self._cover], 0.0) + _IDLE
        shares = own.rhs[size + 1 :]
        layout = self._motion_table
        lower, upper = np.zeros(layout.shape[0]), np.zeros(layout.shape[0])
        lower[-2:] = least_work, -_INF
        upper[-2:] = most_work, bound
        cost = np.concatenate([np.zeros(size + len(shares)), prices, np.full(2 * loose, _WANDERING)])
        floor = np.concatenate([np.full(size, -_INF), np.zeros(len(cost) - size)])
        point = _run(layout.program((own.data, other.data, shares), lower, upper, cost, floor))
        return None if point is None else self._checked(point[:size], labels, falls=falls)

    def _checked(self, velocity: Floats, labels: Bits, *, falls: bool) -> Motion | None:
        """The motion with every joint opened by more than rounding, or, in confined assemblies, rid of rounding."""
        motion = self.prover.motion(velocity, labels, normalise=not falls)
        rest = _REST * float(abs(motion.velocity).max())
        opening = self.interior.opening()
        if opening is not None:
            share = max(rest, -1.001 * motion.margin) / opening.margin
            motion = self.prover.motion(motion.velocity + share * opening.velocity, labels, normalise=not falls)
        else:
            # a vertex meets its equations exactly: what is left of them in floating point is zero
            jumps = np.where(abs(motion.jumps) < rest, 0.0, motion.jumps)
            tight = [self._tight(jumps, label, rest) for label in (labels, ~labels)]
            jumps[:, 0] += np.where(tight[0] | tight[1], rest, 0.0)
            motion = self.prover.measure(motion.velocity, jumps, motion.work, labels)
        if not motion.margin >= 0.0:
            return None
        # a work that is zero but for rounding gains nothing from the live load
        idle = -tolerances.ROUNDING * float(abs(self.template.live).sum() * abs(motion.velocity).max())
        if falls and (motion.work < idle or motion.bound >= -tolerances.ROUNDING):
            return None
        return motion

    def _tight(self, jumps: Floats, labels: Bits, rest: float) -> Bools:
        """(m,) faces whose opening misses what a label asks for by rounding alone."""
        margin = self.template.yield_set.margin(jumps, labels)
        return np.asarray((margin < 0.0) & (margin > -rest))


def _tagged(template: Template, offset: int) -> Any:
    """The sparsity of a program's M, every entry naming its place in the program's data, from offset + 1 on."""
    s = template.structure
    places = offset + 1.0 + np.arange(len(s.indices))
    return sp.csc_array((places, s.indices, s.indptr), shape=s.shape)


@dataclass(frozen=True)
class _Layout:
    """A sparse table whose entries are picked from parts that change and constants that stay.

    pick: (nnz,) places in the parts one after the other, the constants last.
    """

    shape: tuple[int, int]
    indptr: Ints
    indices: Ints
    pick: Ints
    constants: Floats

    @classmethod
    def of(cls, blocks: list[list[Any]], constants: Floats) -> _Layout:
        table = sp.csc_array(sp.block_array(blocks))
        table.sort_indices()
        pick = np.rint(table.data).astype(np.int64) - 1
        return cls(table.shape, table.indptr.astype(np.int64), table.indices.astype(np.int64), pick, constants)

    def program(
        self, parts: tuple[Floats, ...], lower: Floats, upper: Floats, cost: Floats, floor: Floats
    ) -> highspy.Highs:
        """min cost·x, lower ≤ table x ≤ upper, x ≥ floor, ready to run."""
        model = highspy.HighsLp()
        model.num_row_, model.num_col_ = self.shape
        model.col_cost_, model.col_lower_ = cost, floor
        model.col_upper_ = np.full(len(cost), _INF)
        model.row_lower_, model.row_upper_ = lower, upper
        model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        model.a_matrix_.start_ = self.indptr.astype(np.int32)
        model.a_matrix_.index_ = self.indices.astype(np.int32)
        model.a_matrix_.value_ = np.concatenate([*parts, self.constants])[self.pick]
        highs = highspy.Highs()  # type: ignore[no-untyped-call]
        for key, value in _OPTIONS.items():
            highs.setOptionValue(key, value)
        highs.passModel(model)
        return highs


_OPTIONS: dict[str, bool | int | float | str] = {
    "output_flag": False,
    "threads": 1,
    "solver": "simplex",
    "presolve": "off",  # these programs are too small to gain by it
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}


def _run(highs: highspy.Highs) -> Floats | None:
    """An optimal vertex, or None."""
    highs.run()
    if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        return None
    return np.array(highs.getSolution().col_value)
