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
from jld_core.limit.block_relaxation import Asked, BlockMechanism, BlockRelaxation, Choice
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
    def each(self) -> tuple[PartialLabellingBounds, ...]:
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
        found = self.least_bound(labels, undecided)
        return np.inf if found is None else found.bound

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
        first = equalities + 1 + 2 * faces
        count = len(pattern.h_dry)
        places = [self._places(pattern.linear, count, copy) + first for copy in (0, 1)]
        entries = _HullEntries()
        for copy in (0, 1):
            self._add_copy(entries, template, copy, places[copy])
        live = np.flatnonzero(template.live)
        nobody = np.zeros(live.size, dtype=np.int64)
        entries.add(live, nobody + load, nobody, template.live[live])
        every, one = np.arange(faces), np.ones(faces)
        share = 2 * resultants + every
        entries.add(np.array([equalities]), np.array([load]), np.array([0]), -np.ones(1))
        entries.add(equalities + 1 + every, share, every, -one)
        entries.add(equalities + 1 + faces + every, share, every, one)
        rows, columns, self._owner, self._dry, self._inner = entries.by_column()
        self.structure = Structure(
            indices=rows,
            indptr=np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=load + 1))]),
            shape=(first + 2 * count, load + 1),
            equalities=equalities,
            linear=1 + 2 * faces + 2 * pattern.linear,
            cones=(*pattern.cones, *pattern.cones),
        )
        head = np.concatenate([-template.dead, [template.floor], np.zeros(faces), np.ones(faces)])
        self._rhs = np.zeros((2, first + 2 * count))  # Row 0 holds the dry values, row 1 the inner values.
        self._rhs[:, :first] = head
        self._rhs[0, places[0]], self._rhs[1, places[0]] = pattern.h_dry, pattern.h_inner
        self._first, self._row_face = places[0], pattern.row_face
        self._objective = np.zeros(load + 1)
        self._objective[-1] = -1.0
        self._pressure = np.zeros(load + 1)
        self._pressure[0 : 2 * resultants : template.assembly.freedoms] = -1.0

    def _add_copy(self, entries: _HullEntries, template: Template, copy: int, places: Ints) -> None:
        """Add equilibrium and yield rows of copy 0 or 1; places: (rows,) rows of its yield set."""
        sets, pattern, matrix = template.yield_set, template.yield_set.pattern, template.matrix.tocoo()
        faces, resultants = len(template.assembly.interfaces), matrix.shape[1]
        first_column, first_owner = resultants * copy, faces * copy
        row, column = (np.asarray(part, dtype=np.int64) for part in matrix.coords)
        # equilibrium of the resultants that a label has at all
        every = np.ones(faces, dtype=bool)
        dry, inner = (
            np.asarray(matrix.data * sets.active(labels).ravel()[column], dtype=float) for labels in (every, ~every)
        )
        face = column // template.assembly.freedoms
        entries.add(row, column + first_column, face + first_owner, dry, inner)
        entries.add(
            places[pattern.row], pattern.column + first_column, pattern.face + first_owner, pattern.dry, pattern.inner
        )
        # right-hand sides are shared: h (1 − w) of copy 0, with its constant in the vector, h w of copy 1
        sign = -1.0 if copy else 1.0
        share = 2 * resultants + pattern.row_face  # columns of w
        entries.add(places, share, pattern.row_face + first_owner, sign * pattern.h_dry, sign * pattern.h_inner)

    @staticmethod
    def _places(linear: int, count: int, copy: int) -> Ints:
        """Return the rows (count,) of one of two copies: linear rows of both first, then cones of both."""
        rows = np.arange(count)
        return np.where(rows < linear, rows + linear * copy, rows + linear + (count - linear) * copy)

    def program(self, labels: Bits, undecided: Bools, margin: float) -> ConicProgram:
        """Return the scaled program; columns: resultants of both copies, share of the second of each face, λ."""
        copies = np.concatenate([labels | undecided, labels & ~undecided])
        data = np.where(copies[self._owner], self._dry, self._inner)
        rhs = self._rhs[0].copy()
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
        self._open = self.template.with_rows(hull)
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
        return self.template.program(labels, self._margin, other=self._open, taken=undecided)

    @property
    def batched(self) -> bool:
        """Return True if the batch solver supports these yield rows."""
        return self._batch is not None

    @property
    def unit(self) -> float:
        """Return λ in scene units per unit of the bounds of this relaxation."""
        return self.template.scaling.load

    @property
    def each(self) -> tuple[Relaxation, ...]:
        return (self,)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        count = len(labellings)
        with self._counting:
            self.solves += count
        bounds: list[DualBound | None] = [None] * count
        open_ones = np.arange(count)
        if self._batch is not None:
            answers = self._batch.solve(labellings, undecided=undecided, thresholds=thresholds, vectors=True)
            # Skip labellings whose forces carry more than the threshold. Unchecked forces suffice: skipping proves
            # nothing false.
            candidates = np.flatnonzero(answers.verdict != CARRIES)
            self._add_refutations(answers.velocities[candidates], candidates, labellings, undecided, thresholds, bounds)
            # Between abutments the batch solver reports bounds that the exact work balance cannot confirm.
            low = (answers.verdict == OPEN) | (answers.verdict == FALLS) | (answers.high < thresholds)
            open_ones = np.array([k for k in candidates.tolist() if bounds[k] is None and low[k]], dtype=int)
            if thorough is not None:
                open_ones = open_ones[thorough[open_ones]]
        if len(open_ones):
            others = self._refute_by_solver(labellings[open_ones], undecided[open_ones], thresholds[open_ones])
            for k, bound in zip(open_ones.tolist(), others, strict=True):
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
        of = raw.labelling[begun]
        refuted = np.arange(len(begun))[raw.fate[begun] == REFUTED]
        open_ = request.free & ~raw.decided[begun]
        bounds: list[DualBound | None] = [None] * len(begun)
        self._add_refutations(
            raw.velocity[begun[refuted]], refuted, request.labellings[of], open_, request.thresholds[of], bounds
        )
        drawn = begun % (1 + request.how.neighbours) == 0
        rows = zip(of.tolist(), drawn.tolist(), raw.decided[begun], bounds, raw.fate[begun].tolist(), strict=True)
        return [
            MinimizedConflict(k, own, faces, None, fate == CARRIED)
            if one is None
            else MinimizedConflict(k, own, faces, one.bound, fate == CARRIED, one.velocity)
            for k, own, faces, one, fate in rows
        ]

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        if case != 0:
            raise ValueError(f"case: there is one load, and no load case {case}")
        balance = self._balances.balance(velocities, labellings, undecided, known=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            bound = np.where(balance.work > 0.0, balance.total / balance.work, np.inf)
        bound[(balance.work == 0.0) & (balance.total < 0.0)] = -np.inf
        bound[~balance.sound] = np.inf
        return bound

    def _add_refutations(
        self,
        velocities: Floats,
        which: Ints,
        labellings: Bits,
        undecided: Bools,
        thresholds: Floats,
        found: list[DualBound | None],
    ) -> None:
        """Write into `found` the refutations that velocities (j, q·free) of labellings `which` (j,) prove."""
        fine = np.isfinite(velocities).all(axis=1)
        which, velocities = which[fine], velocities[fine]
        size = abs(velocities).max(axis=1, initial=0.0)
        moving = (size > 0.0) & (size < DIVERGED)  # A failed solve may leave any values behind.
        which, velocities = which[moving], velocities[moving] / size[moving, None]
        opening = self._repair.opening()
        for parted in (False, True):
            if parted:
                if opening is None:
                    return
                velocities = velocities + _OPENED / float(abs(opening.velocity).max()) * opening.velocity
            if not len(which):
                return
            answers = self._refutations(velocities, labellings[which], undecided[which], thresholds[which])
            for k, answer in zip(which.tolist(), answers, strict=True):
                found[k] = answer
            lacking = np.array([answer is None for answer in answers])
            which, velocities = which[lacking], velocities[lacking]

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        bounds = self.refute_all(labels[None], undecided[None], np.array([_ANY]))
        if self._shared is not None and self._batch is not None:
            # The rows of the batch solver enclose the hull of crushing joints; the exact hull gives a slightly lower
            # bound.
            bounds += self._refute_by_solver(labels[None], undecided[None], np.array([_ANY]))
        return min((one for one in bounds if one is not None), key=lambda one: one.bound, default=None)

    def _refute_by_solver(self, labellings: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """Refute scaled λ one by one, by the interior-point solver."""
        rows, duals = self.template.matrix.shape[0], []
        for pair in zip(labellings, undecided, strict=True):
            checkpoint()
            with self._solving:
                duals.append(self._solver.solve(self.program(*pair)).dual[:rows])
        answers: list[DualBound | None] = [None] * len(labellings)
        self._add_refutations(np.array(duals), np.arange(len(labellings)), labellings, undecided, thresholds, answers)
        return answers

    def _refutations(
        self, velocities: Floats, labels: Bits, undecided: Bools, thresholds: Floats
    ) -> list[DualBound | None]:
        """Return the refutations (k,) that scaled velocities (k, q·free) prove; None where they prove none."""
        balance = self._balances.balance(velocities, labels, undecided)
        work, total = balance.work, balance.total
        excess = thresholds * work - total
        with np.errstate(invalid="ignore", divide="ignore"):
            cost = np.where(undecided, 0.0, balance.either - balance.own)
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
    """Relaxations of all load cases with their units, governing factor per scaled λ.

    The one that refuted most first.
    """

    def __init__(self, cases: Sequence[_Kind], required: Sequence[float]) -> None:
        self._cases: list[_Kind] = list(cases)
        self._units = [one.template.scaling.load / factor for one, factor in zip(cases, required, strict=True)]
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
    def each(self) -> tuple[Relaxation, ...]:
        return tuple(self._cases)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        refutations: list[DualBound | None] = [None] * len(labellings)
        open_ones = np.arange(len(labellings))
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not open_ones.size:
                break
            unit = self._units[case]
            careful = None if thorough is None else thorough[open_ones]
            answers = self._cases[case].refute_all(
                labellings[open_ones], undecided[open_ones], thresholds[open_ones] / unit, careful
            )
            for k, of_case in zip(open_ones.tolist(), answers, strict=True):
                if of_case is not None:
                    refutations[k] = replace(of_case, bound=_raise_by_rounding(of_case.bound * unit), case=case)
                    counts[case] += 1
            open_ones = np.array([k for k in open_ones.tolist() if refutations[k] is None], dtype=np.int64)
        self._reorder(counts)
        return refutations

    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Minimise conflicts of labellings, each under the first case that refutes it."""
        # Labellings that no case refutes come last, without bound. Parameters: see
        # `PartialLabellingBounds.minimize_conflicts`.
        conflicts: list[MinimizedConflict] = []
        open_ones, carried = np.arange(len(request.labellings)), np.ones(len(request.labellings), dtype=bool)
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not open_ones.size:
                break
            unit = self._units[case]
            refuted: set[int] = set()
            for conflict in self._cases[case].minimize_conflicts(request.take(open_ones).in_units(unit)):
                labelling = int(open_ones[conflict.labelling])
                if conflict.bound is None:
                    carried[labelling] &= conflict.carries or not conflict.drawn
                    continue
                bound = _raise_by_rounding(conflict.bound * unit)
                conflicts.append(replace(conflict, labelling=labelling, bound=bound, case=case))
                if conflict.drawn:
                    refuted.add(labelling)
            counts[case] = len(refuted)
            open_ones = np.array([k for k in open_ones.tolist() if k not in refuted], dtype=np.int64)
        self._reorder(counts)
        unrefuted = [
            MinimizedConflict(k, drawn=True, decided=request.free, bound=None, carries=bool(carried[k]))
            for k in open_ones.tolist()
        ]
        return conflicts + unrefuted

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        if not 0 <= case < len(self._cases):
            raise ValueError(f"case: there is no load case {case}; expected 0 to {len(self._cases) - 1}")
        bounds = self._cases[case].evaluate_mechanisms(0, velocities, labellings, undecided) * self._units[case]
        return np.array([_raise_by_rounding(bound) for bound in bounds.tolist()])

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        found = [case.least_bound(labels, undecided) for case in self._cases]
        known = [
            replace(one, bound=_raise_by_rounding(one.bound * unit), case=case)
            for case, (one, unit) in enumerate(zip(found, self._units, strict=True))
            if one is not None
        ]
        return min(known, key=lambda one: one.bound, default=None)


class CaseBlockRelaxation(_Cases[BlockRelaxation]):
    """Block relaxation under load cases, in governing factors; the least bound of all cases holds."""

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        return self.bound_all([(allowed, threshold, most)])[0]

    def evaluate(self, mechanism: BlockMechanism, allowed: Bools, threshold: float, most: float) -> Choice:
        unit = self._units[mechanism.case]
        scaled = self._in_units(threshold, most, unit)
        found = self._cases[mechanism.case].evaluate(mechanism, allowed, *scaled)
        bound = threshold if found.refuted else _raise_by_rounding(found.bound * unit)
        return replace(found, bound=min(most, bound), mechanisms=(mechanism,))

    def bound_all(self, asked: Sequence[Asked], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """Bound the governing factor for many sets of allowed blocks."""
        choices: list[Choice | None] = [None] * len(asked)  # of all cases so far
        open_ones, counts = list(range(len(asked))), [0] * len(self._cases)
        for case in tuple(self._order):
            unit = self._units[case]
            scaled = [(allowed, *self._in_units(threshold, upper, unit)) for allowed, threshold, upper in asked]
            answers = self._cases[case].bound_all([scaled[k] for k in open_ones], pool)
            for k, of_case in zip(open_ones, answers, strict=True):
                _, threshold, upper = asked[k]
                before = choices[k]
                useless = of_case.useless if before is None else of_case.useless | before.useless
                proof = tuple(replace(mechanism, case=case) for mechanism in of_case.mechanisms)
                proof = proof if before is None else (*before.mechanisms, *proof)
                if of_case.refuted:
                    counts[case] += 1
                    choices[k] = replace(of_case, bound=min(upper, threshold), useless=useless, mechanisms=proof)
                    continue
                bound = min(upper, _raise_by_rounding(of_case.bound * unit))
                if before is None or bound < before.bound:
                    choices[k] = replace(of_case, bound=bound, useless=useless, mechanisms=proof)
                else:
                    choices[k] = replace(before, useless=useless, mechanisms=proof)
            open_ones = [k for k in open_ones if (known := choices[k]) is not None and not known.refuted]
        self._reorder(counts)
        return [choice for choice in choices if choice is not None]

    @staticmethod
    def _in_units(threshold: float, most: float, unit: float) -> tuple[float, float]:
        """Convert factors to scaled λ of a case: threshold rounded down, most rounded up, so that bounds hold."""
        return (threshold - abs(threshold) * _ROUNDING) / unit, _raise_by_rounding(most) / unit


AnyRelaxation = Relaxation | CaseRelaxation  # relaxation of partial labellings under one load or several load cases
AnyBlockRelaxation = BlockRelaxation | CaseBlockRelaxation  # block relaxation under one load or several load cases


def relaxation_of(assembly: Assembly, analyses: Sequence[LimitAnalysis] = ()) -> AnyRelaxation | None:
    """Create the relaxation of a structure with all its load cases; None where no hull is known."""
    known = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    if any(analysis.template.yield_set.hull() is None for analysis in known):
        return None
    each = [Relaxation(analysis) for analysis in known]
    return CaseRelaxation(each, assembly.required.tolist()) if assembly.cases else each[0]


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
    known = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    held = caps or [None] * len(known)
    each = [BlockRelaxation(one, members, inside, seconds, most) for one, most in zip(known, held, strict=True)]
    return CaseBlockRelaxation(each, assembly.required.tolist()) if assembly.cases else each[0]


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
        place = 3 * np.arange(faces)  # columns of N
        pick = sp.csr_array((np.ones(faces), (np.arange(faces), place)), shape=(faces, structure.shape[1]))
        rows = sp.vstack([program.matrix.tocsr(), pick]).tocsc()
        low = np.full(rows.shape[0], -np.inf)
        low[: structure.equalities] = program.rhs[: structure.equalities]
        high = np.concatenate([program.rhs, self.caps])
        high[structure.equalities] = -threshold
        free = np.full(structure.shape[1], np.inf)
        highs = highs_of(rows, np.zeros(structure.shape[1]), low, high, -free, free, _SOLVER)
        for f in range(faces):
            if deadline.passed():
                break
            highs.changeColCost(int(place[f]), -1.0)
            highs.run()
            dual = -np.array(highs.getSolution().row_dual)
            highs.changeColCost(int(place[f]), 0.0)
            cap = self._cap(dual[: structure.equalities], f, threshold, most)
            if cap < self.caps[f]:
                self.caps[f] = max(cap, 0.0)
                highs.changeRowBounds(int(structure.shape[0] + f), -np.inf, self.caps[f])

    def _cap(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        """Return the bound on N of a face that velocities prove; inf where they prove none."""
        if not np.isfinite(velocity).all():
            return math.inf
        velocities = [velocity]
        if self._opening is not None:
            step = _OPENED * float(abs(velocity).max(initial=1.0)) / float(abs(self._opening.velocity).max())
            velocities.append(velocity + step * self._opening.velocity)
        return min(self._value(one, face, threshold, most) for one in velocities)

    def _value(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        template, every = self._template, np.arange(len(self._labels))
        jumps = self._prover.jumps(velocity[None])[0].copy()
        jumps[face, 0] -= 1.0
        dry, inner = (CappedWedge(wedge, self.caps).dissipation(jumps, every) for wedge in self._wedges)
        cost = np.where(self._undecided, np.maximum(dry, inner), np.where(self._labels, dry, inner))
        work = float(template.live @ velocity)
        load = threshold if work >= 0.0 else most
        size = float(
            abs(cost).sum() + abs(template.dead) @ abs(velocity) + abs(load) * abs(template.live) @ abs(velocity)
        )
        return float(cost.sum() - template.dead @ velocity - load * work) + tolerances.ROUNDING * size
