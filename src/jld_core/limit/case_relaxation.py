"""Relaxations under several load cases, any of which refutes a factor, and upper bounds on normal forces (6.7)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Lock
from typing import Final, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.batch.batch_solver import CARRIED, CARRIES, FALLS, OPEN, REFUTED, BatchSolver, ConflictRequest
from jld_core.batch.rows import fits
from jld_core.deadline import Deadline, checkpoint
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_program import CappedWedge
from jld_core.limit.block_relaxation import BlockMechanism, BlockRelaxation, BlockRequest, Choice
from jld_core.limit.bounds import DIVERGED
from jld_core.limit.mechanism import DualBound, MinimizedConflict, WorkBalances
from jld_core.program import ConicProgram, Template
from jld_core.program.template import Structure
from jld_core.solvers import highs_of, make_solver


class PartialLabellingBounds(ABC):
    """Upper bounds that hold for every labelling that agrees where `undecided` is False.

    Unit: scaled λ of one load (`Relaxation`), or the governing factor of load cases (`CaseRelaxation`).
    """

    @property
    @abstractmethod
    def batched(self) -> bool:
        """Return True if the batch solver solves many relaxations at a time."""

    @property
    @abstractmethod
    def unit(self) -> float:
        """Return the load factor in scene units, or the governing factor, per unit of the bounds."""

    @property
    @abstractmethod
    def by_case(self) -> tuple[PartialLabellingBounds, ...]:
        """Return the relaxations of all load cases; of a single load, one."""

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """Return a mechanism that proves that no labelling reaches a threshold; None where none is found."""
        return self.refute_all(labels[None], undecided[None], np.array([threshold]))[0]

    @abstractmethod
    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute thresholds (k,), of the first load case that does; None where no proof is found.

        thorough: (k,) True where another solver is tried if the batch solver finds no proof; default: everywhere.
        """

    @abstractmethod
    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Remove decided faces of labellings and neighbours while bounds stay below thresholds; needs `batched`.

        Result: one entry for each that was begun, its work balance evaluated again; those that no case refutes come
        last, without bound.
        """

    @abstractmethod
    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Bound labellings (k,) by velocities (k, q·free) without a solver; −inf: none admissible, inf: no proof."""

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Return an upper bound of a partial labelling; inf where none was found."""
        least = self.least_bound(labels, undecided)
        return np.inf if least is None else least.bound

    @abstractmethod
    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the mechanism of the least bound found; None where none was found."""


class _HullEntries:
    """Entries of the matrix of a shared hull, with their values under either label of their owner.

    Owners are the faces of both copies: face, then faces + face.
    """

    def __init__(self) -> None:
        self._parts: list[tuple[Ints, Ints, Ints, Floats, Floats]] = []

    def add(self, row: Ints, column: Ints, owner: Ints, dry: Floats, inner: Floats | None = None) -> None:
        """Add k entries; inner: None where the label changes nothing."""
        self._parts.append((row, column, owner, dry, dry if inner is None else inner))

    def by_column(self) -> tuple[Ints, Ints, Ints, Floats, Floats]:
        """Return rows, columns, owners, dry and inner values, column by column."""
        rows, columns, owners, dry, inner = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        order = np.lexsort((rows, columns))
        return rows[order], columns[order], owners[order], dry[order], inner[order]


_OPENED: Final = 1e-9  # share of its speed by which a mechanism is opened, so that rounding closes no face


class SharedHull:
    """Programs of partial labellings of a template whose joints may crush; ValueError for rows of extra columns."""

    # Convex hull of both labels: forces are the sum of two copies, 1 − w and w times forces within the yield set of a
    # label. An undecided face has copy 0 dry and copy 1 inner, any other face both with its label.

    def __init__(self, template: Template) -> None:
        pattern = template.yield_set.pattern
        if pattern.extra:
            raise ValueError("the perspective of rows with extra columns is not defined")
        faces, (equalities, resultants) = len(template.assembly.interfaces), template.matrix.shape
        # Columns: resultants of both copies, share w of the second copy of each face, λ.
        load = 2 * resultants + faces
        # Linear rows are λ ≥ −floor, 0 ≤ w, w ≤ 1, then those of both copies; cones are last.
        first_row = equalities + 1 + 2 * faces
        count = len(pattern.h_dry)
        copy_rows = [self._rows_of_copy(pattern.linear, count, copy) + first_row for copy in (0, 1)]
        entries = _HullEntries()
        for copy in (0, 1):
            self._add_copy(entries, template, copy, copy_rows[copy])
        live = np.flatnonzero(template.live)
        no_owner = np.zeros(live.size, dtype=np.int64)
        entries.add(live, no_owner + load, no_owner, template.live[live])
        face, ones = np.arange(faces), np.ones(faces)
        share = 2 * resultants + face
        entries.add(np.array([equalities]), np.array([load]), np.array([0]), -np.ones(1))
        entries.add(equalities + 1 + face, share, face, -ones)
        entries.add(equalities + 1 + faces + face, share, face, ones)
        rows, columns, self._owner, self._dry, self._inner = entries.by_column()
        self.structure = Structure(
            indices=rows,
            indptr=np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=load + 1))]),
            shape=(first_row + 2 * count, load + 1),
            equalities=equalities,
            linear=1 + 2 * faces + 2 * pattern.linear,
            cones=(*pattern.cones, *pattern.cones),
        )
        shared_rhs = np.concatenate([-template.dead, [template.floor], np.zeros(faces), np.ones(faces)])
        self._rhs = np.zeros((2, first_row + 2 * count))  # Row 0 holds the dry values, row 1 the inner values.
        self._rhs[:, :first_row] = shared_rhs
        self._rhs[0, copy_rows[0]], self._rhs[1, copy_rows[0]] = pattern.h_dry, pattern.h_inner
        self._first, self._row_face = copy_rows[0], pattern.row_face
        self._objective = np.zeros(load + 1)
        self._objective[-1] = -1.0
        self._pressure = np.zeros(load + 1)
        self._pressure[0 : 2 * resultants : template.assembly.freedoms] = -1.0

    def _add_copy(self, entries: _HullEntries, template: Template, copy: int, copy_rows: Ints) -> None:
        """Add equilibrium and yield rows of copy 0 or 1; copy_rows: (rows,) rows of its yield set."""
        sets, pattern, matrix = template.yield_set, template.yield_set.pattern, template.matrix.tocoo()
        faces, resultants = len(template.assembly.interfaces), matrix.shape[1]
        first_column, first_owner = resultants * copy, faces * copy
        row, column = (np.asarray(coordinate, dtype=np.int64) for coordinate in matrix.coords)
        # equilibrium of the resultants that a label has at all
        all_dry = np.ones(faces, dtype=bool)
        dry, inner = (
            np.asarray(matrix.data * sets.active(labels).ravel()[column], dtype=float) for labels in (all_dry, ~all_dry)
        )
        face = column // template.assembly.freedoms
        entries.add(row, column + first_column, face + first_owner, dry, inner)
        column, face = pattern.column + first_column, pattern.face + first_owner
        entries.add(copy_rows[pattern.row], column, face, pattern.dry, pattern.inner)
        # right-hand sides are shared: h (1 − w) of copy 0, with its constant in the vector, h w of copy 1
        sign = -1.0 if copy else 1.0
        share = 2 * resultants + pattern.row_face  # columns of w
        entries.add(copy_rows, share, pattern.row_face + first_owner, sign * pattern.h_dry, sign * pattern.h_inner)

    @staticmethod
    def _rows_of_copy(linear: int, count: int, copy: int) -> Ints:
        """Return the rows (count,) of one of two copies: linear rows of both first, then cones of both."""
        rows = np.arange(count)
        return np.where(rows < linear, rows + linear * copy, rows + linear + (count - linear) * copy)

    def program(self, labels: Bits, undecided: Bools, margin: float) -> ConicProgram:
        """Return the scaled program; columns: resultants of both copies, share of the second of each face, λ."""
        copies = np.concatenate([labels | undecided, labels & ~undecided])
        data = np.where(copies[self._owner], self._dry, self._inner)
        rhs = self._rhs[0].copy()  # that of the second copy stands in the columns of shares
        rhs[self._first] = np.where(copies[self._row_face], self._rhs[0, self._first], self._rhs[1, self._first])
        return ConicProgram(self.structure, data, rhs, self._objective + margin * self._pressure)


_ANY: Final = 1e12  # threshold above every scaled λ of interest; with it any finite bound counts as a refutation

# Residual requested from the solver; bounds are computed from its answer, so it need not be exact
_RESIDUAL: Final = 1e-10


class Relaxation(PartialLabellingBounds):
    """Upper bounds on the scaled λ of partial labellings under one load; TypeError if no hull is known."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        self.template = analysis.template
        self._repair = analysis.repair
        self._balances = WorkBalances(self.template, analysis.prover, analysis.repair)
        hull = self.template.yield_set.hull()
        if hull is None:
            raise TypeError("the hull of these yield sets is not known")
        self._hull_rows = self.template.with_rows(hull)
        # The hull has exact rows only as long as dry joints never crush.
        planar = self.template.assembly.dimension == 2
        self._shared = SharedHull(self.template) if planar and self.template.yield_set.pattern.cones else None
        self._batch: BatchSolver | None = None
        if chosen() is not None and fits(self.template, hull):
            opening = analysis.repair.opening()
            velocity = None if opening is None else opening.velocity
            self._batch = BatchSolver(self.template, velocity, load_scale=analysis.load_scale, undecided=hull)
        self._solver = make_solver("clarabel", tolerance=max(_RESIDUAL, self.template.precision.residual))
        self._margin = max(_RESIDUAL, self.template.precision.margin)
        self.solves = 0
        # Several threads may refute labellings at the same time. The batch solver needs no lock; `solves` does, and the
        # conic solver updates its program in place.
        self._counting, self._solving = Lock(), Lock()

    def program(self, labels: Bits, undecided: Bools) -> ConicProgram:
        if self._shared is not None:
            return self._shared.program(labels, undecided, self._margin)
        return self.template.program(labels, self._margin, other=self._hull_rows, taken=undecided)

    @property
    def batched(self) -> bool:
        """Return True if the batch solver supports these yield rows."""
        return self._batch is not None

    @property
    def unit(self) -> float:
        """Return λ in scene units per unit of the bounds of this relaxation."""
        return self.template.scaling.load

    @property
    def by_case(self) -> tuple[Relaxation, ...]:
        return (self,)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        count = len(labellings)
        with self._counting:
            self.solves += count
        bounds: list[DualBound | None] = [None] * count
        unrefuted = np.arange(count)
        if self._batch is not None:
            answers = self._batch.solve(labellings, undecided=undecided, thresholds=thresholds, vectors=True)
            # Skip labellings whose forces carry more than the threshold. Unchecked forces suffice: skipping proves
            # nothing false.
            candidates = np.flatnonzero(answers.verdict != CARRIES)
            self._add_refutations(answers.velocities[candidates], candidates, labellings, undecided, thresholds, bounds)
            # Between abutments the batch solver reports bounds that the exact work balance cannot confirm.
            low = (answers.verdict == OPEN) | (answers.verdict == FALLS) | (answers.high < thresholds)
            unrefuted = np.array([k for k in candidates.tolist() if bounds[k] is None and low[k]], dtype=int)
            if thorough is not None:
                unrefuted = unrefuted[thorough[unrefuted]]
        if len(unrefuted):
            by_solver = self._refute_by_solver(labellings[unrefuted], undecided[unrefuted], thresholds[unrefuted])
            for k, bound in zip(unrefuted.tolist(), by_solver, strict=True):
                bounds[k] = bound
        return bounds

    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        # Parameters and results: see `PartialLabellingBounds.minimize_conflicts`.
        if self._batch is None:
            raise RuntimeError("conflicts are minimised by the batch solver alone; ask `batched` first")
        raw = self._batch.minimize_conflicts(request)
        with self._counting:
            self.solves += int(raw.relaxations.sum())
        begun = np.flatnonzero(raw.relaxations)
        labelling, decided = raw.labelling[begun], raw.decided[begun]
        refuted = np.arange(len(begun))[raw.fate[begun] == REFUTED]
        labels, thresholds = request.labellings[labelling], request.thresholds[labelling]
        bounds: list[DualBound | None] = [None] * len(begun)
        self._add_refutations(
            raw.velocity[begun[refuted]], refuted, labels, request.free & ~decided, thresholds, bounds
        )
        drawn = begun % (1 + request.how.neighbours) == 0
        carries = raw.fate[begun] == CARRIED
        return [
            MinimizedConflict(int(labelling[k]), bool(drawn[k]), decided[k], None, bool(carries[k]))
            if bound is None
            else MinimizedConflict(
                int(labelling[k]), bool(drawn[k]), decided[k], bound.bound, bool(carries[k]), bound.velocity
            )
            for k, bound in enumerate(bounds)
        ]

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        if case != 0:
            raise ValueError(f"case: there is one load, and no load case {case}")
        balance = self._balances.balance(velocities, labellings, undecided, from_earlier=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            bound = np.where(balance.work > 0.0, balance.total / balance.work, np.inf)
        bound[(balance.work == 0.0) & (balance.total < 0.0)] = -np.inf
        bound[~balance.sound] = np.inf
        return bound

    def _add_refutations(
        self,
        velocities: Floats,
        candidates: Ints,
        labellings: Bits,
        undecided: Bools,
        thresholds: Floats,
        bounds: list[DualBound | None],
    ) -> None:
        """Write into `bounds` the refutations that velocities (j, q·free) of labellings `candidates` (j,) prove."""
        finite = np.isfinite(velocities).all(axis=1)
        candidates, velocities = candidates[finite], velocities[finite]
        size = abs(velocities).max(axis=1, initial=0.0)
        moving = (size > 0.0) & (size < DIVERGED)  # A failed solve may leave any values behind.
        candidates, velocities = candidates[moving], velocities[moving] / size[moving, None]
        opening = self._repair.opening()
        for opened in (False, True):
            if opened:
                if opening is None:
                    return
                velocities = velocities + _OPENED / float(abs(opening.velocity).max()) * opening.velocity
            if not len(candidates):
                return
            partial = labellings[candidates], undecided[candidates], thresholds[candidates]
            answers = self._refutations(velocities, *partial)
            for k, answer in zip(candidates.tolist(), answers, strict=True):
                bounds[k] = answer
            unproven = np.array([answer is None for answer in answers])
            candidates, velocities = candidates[unproven], velocities[unproven]

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        bounds = self.refute_all(labels[None], undecided[None], np.array([_ANY]))
        if self._shared is not None and self._batch is not None:
            # The rows of the batch solver enclose the hull of crushing joints; the exact hull gives a slightly lower
            # bound.
            bounds += self._refute_by_solver(labels[None], undecided[None], np.array([_ANY]))
        return min((bound for bound in bounds if bound is not None), key=lambda bound: bound.bound, default=None)

    def _refute_by_solver(self, labellings: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """Refute scaled λ one by one, by the interior-point solver."""
        rows, duals = self.template.matrix.shape[0], []
        for pair in zip(labellings, undecided, strict=True):
            checkpoint()
            with self._solving:
                duals.append(self._solver.solve(self.program(*pair)).dual[:rows])
        bounds: list[DualBound | None] = [None] * len(labellings)
        self._add_refutations(np.array(duals), np.arange(len(labellings)), labellings, undecided, thresholds, bounds)
        return bounds

    def _refutations(
        self, velocities: Floats, labels: Bits, undecided: Bools, thresholds: Floats
    ) -> list[DualBound | None]:
        """Return the refutations (k,) that scaled velocities (k, q·free) prove; None where they prove none."""
        balance = self._balances.balance(velocities, labels, undecided)
        work, total = balance.work, balance.total
        excess = thresholds * work - total
        with np.errstate(invalid="ignore", divide="ignore"):
            cost = np.where(undecided, 0.0, balance.larger - balance.labelled)
            bound = np.where(work > 0.0, total / work, -np.inf)
        return [
            DualBound(float(excess[k]), cost[k], float(bound[k]), balance.velocities[k].copy())
            if balance.sound[k] and excess[k] > 0.0
            else None
            for k in range(len(labels))
        ]


# Relative amount by which bounds are raised and thresholds lowered on a change of units, so that bounds stay valid
_ROUNDING = 4.0 * float(np.finfo(float).eps)
_Kind = TypeVar("_Kind", Relaxation, BlockRelaxation)  # kind of relaxation of the single load cases


class _Cases(Generic[_Kind]):
    """Relaxations of all load cases with their governing factor per scaled λ; the one that refuted most first."""

    def __init__(self, cases: Sequence[_Kind], required: Sequence[float]) -> None:
        self._cases: list[_Kind] = list(cases)
        self._units = [case.template.scaling.load / factor for case, factor in zip(cases, required, strict=True)]
        self._order = list(range(len(self._cases)))

    @property
    def solves(self) -> int:
        return sum(case.solves for case in self._cases)

    @property
    def batched(self) -> bool:
        """Return True if the batch solver solves the programs of every case many at a time."""
        return all(case.batched for case in self._cases)

    def _reorder(self, refuted: Sequence[int]) -> None:
        """Sort the cases by refutations (c,), in a new list, as other threads may iterate over the old one."""
        self._order = sorted(self._order, key=lambda case: -refuted[case])


def _raise_by_rounding(bound: float) -> float:
    """Raise a bound by the rounding error of a change of units."""
    return bound + abs(bound) * _ROUNDING if math.isfinite(bound) else bound


class CaseRelaxation(_Cases[Relaxation], PartialLabellingBounds):
    """Upper bounds on the governing factor, least λ / required, of partial labellings under load cases."""

    @property
    def unit(self) -> float:
        """Return the governing factor per unit of the bounds: 1, as they are not scaled."""
        return 1.0

    @property
    def by_case(self) -> tuple[Relaxation, ...]:
        return tuple(self._cases)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        refutations: list[DualBound | None] = [None] * len(labellings)
        unrefuted = np.arange(len(labellings))
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not unrefuted.size:
                break
            unit = self._units[case]
            thorough_of_case = None if thorough is None else thorough[unrefuted]
            answers = self._cases[case].refute_all(
                labellings[unrefuted], undecided[unrefuted], thresholds[unrefuted] / unit, thorough_of_case
            )
            for k, of_case in zip(unrefuted.tolist(), answers, strict=True):
                if of_case is not None:
                    refutations[k] = replace(of_case, bound=_raise_by_rounding(of_case.bound * unit), case=case)
                    counts[case] += 1
            unrefuted = np.array([k for k in unrefuted.tolist() if refutations[k] is None], dtype=np.int64)
        self._reorder(counts)
        return refutations

    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Minimise conflicts of labellings, each under the first case that refutes it."""
        # Labellings that no case refutes come last, without bound. Parameters: see
        # `PartialLabellingBounds.minimize_conflicts`.
        conflicts: list[MinimizedConflict] = []
        unrefuted, carried = np.arange(len(request.labellings)), np.ones(len(request.labellings), dtype=bool)
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not unrefuted.size:
                break
            unit = self._units[case]
            refuted: set[int] = set()
            for conflict in self._cases[case].minimize_conflicts(request.take(unrefuted).in_units(unit)):
                labelling = int(unrefuted[conflict.labelling])
                if conflict.bound is None:
                    carried[labelling] &= conflict.carries or not conflict.drawn
                    continue
                bound = _raise_by_rounding(conflict.bound * unit)
                conflicts.append(replace(conflict, labelling=labelling, bound=bound, case=case))
                if conflict.drawn:
                    refuted.add(labelling)
            counts[case] = len(refuted)
            unrefuted = np.array([k for k in unrefuted.tolist() if k not in refuted], dtype=np.int64)
        self._reorder(counts)
        return conflicts + [
            MinimizedConflict(k, drawn=True, decided=request.free, bound=None, carries=bool(carried[k]))
            for k in unrefuted.tolist()
        ]

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        if not 0 <= case < len(self._cases):
            raise ValueError(f"case: there is no load case {case}; expected 0 to {len(self._cases) - 1}")
        bounds = self._cases[case].evaluate_mechanisms(0, velocities, labellings, undecided) * self._units[case]
        return np.array([_raise_by_rounding(bound) for bound in bounds.tolist()])

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        bounds = [case.least_bound(labels, undecided) for case in self._cases]
        raised = [
            replace(bound, bound=_raise_by_rounding(bound.bound * unit), case=case)
            for case, (bound, unit) in enumerate(zip(bounds, self._units, strict=True))
            if bound is not None
        ]
        return min(raised, key=lambda bound: bound.bound, default=None)


class CaseBlockRelaxation(_Cases[BlockRelaxation]):
    """Block relaxation under load cases, in governing factors; the least bound of all cases holds."""

    # allowed: (p,) blocks that may occur. threshold: governing factor that is to be refuted. most: known upper bound.

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        return self.bound_all([(allowed, threshold, most)])[0]

    def evaluate(self, mechanism: BlockMechanism, allowed: Bools, threshold: float, most: float) -> Choice:
        """Bound the factor by an earlier mechanism of one case, without a solver."""
        unit = self._units[mechanism.case]
        scaled = self._scaled_for_case(threshold, most, unit)
        choice = self._cases[mechanism.case].evaluate(mechanism, allowed, *scaled)
        # a refuted threshold is itself the bound; converting it back would round it
        bound = threshold if choice.refuted else _raise_by_rounding(choice.bound * unit)
        return replace(choice, bound=min(most, bound), mechanisms=(mechanism,))

    def bound_all(self, programs: Sequence[BlockRequest], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """Bound the governing factor for many sets of allowed blocks."""
        choices: list[Choice | None] = [None] * len(programs)  # of all cases so far
        unrefuted, counts = list(range(len(programs))), [0] * len(self._cases)
        for case in tuple(self._order):
            unit = self._units[case]
            scaled = [(programs[k][0], *self._scaled_for_case(*programs[k][1:], unit)) for k in unrefuted]
            answers = self._cases[case].bound_all(scaled, pool)
            for k, choice in zip(unrefuted, answers, strict=True):
                _, threshold, upper = programs[k]
                previous = choices[k]
                useless = choice.useless if previous is None else choice.useless | previous.useless
                proof = tuple(replace(mechanism, case=case) for mechanism in choice.mechanisms)
                proof = proof if previous is None else (*previous.mechanisms, *proof)
                if choice.refuted:
                    counts[case] += 1
                    choices[k] = replace(choice, bound=min(upper, threshold), useless=useless, mechanisms=proof)
                    continue
                bound = min(upper, _raise_by_rounding(choice.bound * unit))
                if previous is None or bound < previous.bound:
                    choices[k] = replace(choice, bound=bound, useless=useless, mechanisms=proof)
                else:
                    choices[k] = replace(previous, useless=useless, mechanisms=proof)
            unrefuted = [k for k, choice in zip(unrefuted, answers, strict=True) if not choice.refuted]
        self._reorder(counts)
        return [choice for choice in choices if choice is not None]

    @staticmethod
    def _scaled_for_case(threshold: float, most: float, unit: float) -> tuple[float, float]:
        """Convert factors to scaled λ of a case: threshold rounded down, most rounded up, so that bounds hold."""
        return (threshold - abs(threshold) * _ROUNDING) / unit, _raise_by_rounding(most) / unit


AnyRelaxation = Relaxation | CaseRelaxation  # relaxation of partial labellings under one load or several load cases
AnyBlockRelaxation = BlockRelaxation | CaseBlockRelaxation  # block relaxation under one load or several load cases


def relaxation_of(assembly: Assembly, analyses: Sequence[LimitAnalysis] = ()) -> AnyRelaxation | None:
    """Create the relaxation of a structure with all its load cases; None where no hull is known."""
    case_analyses = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    if any(analysis.template.yield_set.hull() is None for analysis in case_analyses):
        return None
    relaxations = [Relaxation(analysis) for analysis in case_analyses]
    return CaseRelaxation(relaxations, assembly.required.tolist()) if assembly.cases else relaxations[0]


def block_relaxation_of(
    assembly: Assembly,
    members: Sequence[Sequence[int]],
    inside: Sequence[Sequence[int]],
    analyses: Sequence[LimitAnalysis] = (),
    seconds: float = math.inf,
    caps: Sequence[Floats | None] = (),
) -> AnyBlockRelaxation:
    """Create the block relaxation with all load cases; TypeError where `applies_to` is False.

    caps: (m,) normal forces of each case that no layout exceeds, see `BlockRelaxation`.
    """
    case_analyses = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    caps_by_case = caps or [None] * len(case_analyses)
    relaxations = [
        BlockRelaxation(analysis, members, inside, seconds, caps_of_case)
        for analysis, caps_of_case in zip(case_analyses, caps_by_case, strict=True)
    ]
    return CaseBlockRelaxation(relaxations, assembly.required.tolist()) if assembly.cases else relaxations[0]


_SOLVER = {"threads": 1, "solver": "simplex", "presolve": "off"}


class NormalCaps:
    """Caps (m,) on the scaled normal forces of the faces of all labellings that agree where `undecided` is False.

    TypeError where joints may crush or are spatial.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits, undecided: Bools) -> None:
        self._template, self._prover = analysis.template, analysis.prover
        self._labels, self._undecided = labels, undecided
        dry, inner = (self._template.yield_set.coulomb_wedge(label) for label in (True, False))
        if dry is None or inner is None:
            raise TypeError("normal forces are bounded for planar joints that do not crush")
        self._wedges = (dry, inner)
        self._opening = analysis.repair.opening()
        self._program = Relaxation(analysis).program(labels, undecided)
        self.caps = np.full(len(labels), math.inf)

    @property
    def unit(self) -> float:
        """Return λ in scene units per scaled λ."""
        return self._template.scaling.load

    def tighten(self, threshold: float, most: float, deadline: Deadline) -> None:
        """Lower the caps for labellings whose scaled λ is from `threshold` to `most`, as far as time allows."""
        program, structure = self._program, self._program.structure
        faces = len(self._labels)
        column = 3 * np.arange(faces)  # columns of N
        selection = sp.csr_array((np.ones(faces), (np.arange(faces), column)), shape=(faces, structure.shape[1]))
        rows = sp.vstack([program.matrix.tocsr(), selection]).tocsc()
        low = np.full(rows.shape[0], -np.inf)
        low[: structure.equalities] = program.rhs[: structure.equalities]
        high = np.concatenate([program.rhs, self.caps])
        high[structure.equalities] = -threshold
        free = np.full(structure.shape[1], np.inf)
        highs = highs_of(rows, np.zeros(structure.shape[1]), low, high, -free, free, _SOLVER)
        for face in range(faces):
            if deadline.passed():
                break
            highs.changeColCost(int(column[face]), -1.0)
            highs.run()
            dual = -np.array(highs.getSolution().row_dual)
            highs.changeColCost(int(column[face]), 0.0)
            cap = self._cap(dual[: structure.equalities], face, threshold, most)
            if cap < self.caps[face]:
                self.caps[face] = max(cap, 0.0)
                highs.changeRowBounds(int(structure.shape[0] + face), -np.inf, self.caps[face])

    def _cap(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        """Return the bound on N of a face that velocities prove; inf where they prove none."""
        if not np.isfinite(velocity).all():
            return math.inf
        velocities = [velocity]
        if self._opening is not None:
            step = _OPENED * float(abs(velocity).max(initial=1.0)) / float(abs(self._opening.velocity).max())
            velocities.append(velocity + step * self._opening.velocity)
        return min(self._bound_on_normal_force(candidate, face, threshold, most) for candidate in velocities)

    def _bound_on_normal_force(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        # The work balance of jumps with one less opening of the face bounds its N, at any λ in [threshold, most].
        template, faces = self._template, np.arange(len(self._labels))
        jumps = self._prover.jumps(velocity[None])[0].copy()
        jumps[face, 0] -= 1.0
        dry, inner = (CappedWedge(wedge, self.caps).dissipation(jumps, faces) for wedge in self._wedges)
        cost = np.where(self._undecided, np.maximum(dry, inner), np.where(self._labels, dry, inner))
        work = float(template.live @ velocity)
        load = threshold if work >= 0.0 else most
        size = float(
            abs(cost).sum() + abs(template.dead) @ abs(velocity) + abs(load) * abs(template.live) @ abs(velocity)
        )
        return float(cost.sum() - template.dead @ velocity - load * work) + tolerances.ROUNDING * size
