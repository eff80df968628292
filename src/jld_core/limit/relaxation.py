"""Upper bounds on λ over all labellings that agree on the decided faces.

The relaxation of an undecided face is the closed hull of its dry and its inner set, docs/method.md (6.3). The yield
set supplies it (`YieldSet.hull`); without a hull there is no relaxation. Where planar joints may crush, the rows of
the hull are too wide, and two copies of the face share its forces instead (`SharedHull`). There the batch solver uses
rows of its own (`YieldSet.parabolic_bending`), which in an arch deviate by some hundredths of a percent.

The bound of a mechanism is always measured with the support function of the hull, max(D_dry, D_inner). It therefore
holds for every labelling that agrees, however loose the program that supplied the mechanism.
"""

from __future__ import annotations

from threading import Lock
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import ConflictRequest, chosen
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.conflict_request import CARRIED, REFUTED
from jld_core.batch.rows import fits
from jld_core.batch.verdicts import CARRIES, FALLS, OPEN
from jld_core.deadline import checkpoint
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.dual_bounds import DualBound, MinimizedConflict
from jld_core.limit.partial_labellings import PartialLabellingBounds
from jld_core.limit.shared_hull import SharedHull
from jld_core.limit.work_balance import WorkBalances
from jld_core.program import ConicProgram
from jld_core.solvers import make_solver

_ANY: Final = 1e12  # threshold above every scaled λ of interest; with it any finite bound counts as a refutation

# Residual requested from the solver; bounds are computed from its answer, so it need not be exact
_RESIDUAL: Final = 1e-10


class Relaxation(PartialLabellingBounds):
    """Upper bounds on the scaled λ of partial labellings of one assembly under one load.

    Methods and units are documented in `PartialLabellingBounds`.

    analysis: analysis of the assembly; its template, prover and opening motion are shared. Raises TypeError if no hull
    of the yield sets is known.
    """

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
        """Return the program of a partial labelling.

        labels: (m,) labels, True = dry; ignored where undecided. undecided: (m,) faces that may have either label.
        """
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
        """Return the relaxations of all load cases: this one alone."""
        return (self,)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute scaled λ for many partial labellings, under one load.

        labellings, undecided: (k, m) labels, True = dry, and faces that may have either. thresholds: (k,) scaled λ.
        thorough: (k,) True where another solver is tried if the batch solver finds no proof; None: everywhere. The
        result has a mechanism for each labelling, or None where no proof is found.
        """
        count = len(labellings)
        with self._counting:
            self.solves += count
        found: list[DualBound | None] = [None] * count
        left = np.arange(count)
        if self._batch is not None:
            answers = self._batch.solve(labellings, undecided=undecided, thresholds=thresholds, vectors=True)
            # Skip labellings whose forces carry more than the threshold. Unchecked forces suffice: skipping proves
            # nothing false.
            candidates = np.flatnonzero(answers.verdict != CARRIES)
            self._add_refutations(answers.velocities[candidates], candidates, labellings, undecided, thresholds, found)
            # Between abutments the batch solver reports bounds that the exact work balance cannot confirm.
            low = (answers.verdict == OPEN) | (answers.verdict == FALLS) | (answers.high < thresholds)
            left = np.array([k for k in candidates.tolist() if found[k] is None and low[k]], dtype=int)
            if thorough is not None:
                left = left[thorough[left]]
        if len(left):
            others = self._refute_by_solver(labellings[left], undecided[left], thresholds[left])
            for k, one in zip(left.tolist(), others, strict=True):
                found[k] = one
        return found

    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Minimise the conflicts of labellings under one load, by the batch solver.

        Parameters and results: see `PartialLabellingBounds.minimize_conflicts`. Raises RuntimeError without the batch
        solver.
        """
        if self._batch is None:
            raise RuntimeError("conflicts are minimised by the batch solver alone; ask `batched` first")
        raw = self._batch.minimize_conflicts(request)
        with self._counting:
            self.solves += int(raw.relaxations.sum())
        begun = np.flatnonzero(raw.relaxations)
        of = raw.labelling[begun]
        left = np.arange(len(begun))[raw.fate[begun] == REFUTED]
        open_ = request.free & ~raw.decided[begun]
        found: list[DualBound | None] = [None] * len(begun)
        self._add_refutations(
            raw.velocity[begun[left]], left, request.labellings[of], open_, request.thresholds[of], found
        )
        drawn = begun % (1 + request.how.neighbours) == 0
        rows = zip(of.tolist(), drawn.tolist(), raw.decided[begun], found, raw.fate[begun].tolist(), strict=True)
        return [
            MinimizedConflict(k, own, faces, None, fate == CARRIED)
            if one is None
            else MinimizedConflict(k, own, faces, one.bound, fate == CARRIED, one.velocity)
            for k, own, faces, one, fate in rows
        ]

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Bound scaled λ (k,) by known mechanisms, under one load.

        case: 0. velocities: (k, q·free) scaled. labellings, undecided: (k, m) labels, True = dry, and faces that may
        have either. The result is inf where a mechanism proves nothing, and −inf where no λ is admissible. Raises
        ValueError for another case.
        """
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
        """Write the refutations that velocities prove into the list `found`.

        velocities: (j, q·free) mechanisms, each for one labelling. which: (j,) index of the labelling of each
        mechanism. labellings, undecided: (k, m). thresholds: (k,) scaled λ. found: list of k, changed. If a mechanism
        proves nothing, it is tried again with a small opening motion added.
        """
        fine = np.isfinite(velocities).all(axis=1)
        which, velocities = which[fine], velocities[fine]
        size = abs(velocities).max(axis=1, initial=0.0)
        moving = (size > 0.0) & (size < 1e30)  # A failed solve may leave any values behind.
        which, velocities = which[moving], velocities[moving] / size[moving, None]
        opening = self._repair.opening()
        for parted in (False, True):
            if parted:
                if opening is None:
                    return
                velocities = velocities + 1e-9 / float(abs(opening.velocity).max()) * opening.velocity
            if not len(which):
                return
            answers = self._refutations(velocities, labellings[which], undecided[which], thresholds[which])
            for k, answer in zip(which.tolist(), answers, strict=True):
                found[k] = answer
            lacking = np.array([answer is None for answer in answers])
            which, velocities = which[lacking], velocities[lacking]

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the mechanism with the least bound found on scaled λ; None if none is found.

        labels, undecided: (m,) labels, True = dry, and faces that may have either.
        """
        found = self.refute_all(labels[None], undecided[None], np.array([_ANY]))
        if self._shared is not None and self._batch is not None:
            # The rows of the batch solver enclose the hull of crushing joints; the exact hull gives a slightly lower
            # bound.
            found += self._refute_by_solver(labels[None], undecided[None], np.array([_ANY]))
        return min((one for one in found if one is not None), key=lambda one: one.bound, default=None)

    def _refute_by_solver(self, labellings: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """Refute scaled λ for partial labellings one by one, by the interior-point solver.

        labellings, undecided: (k, m). thresholds: (k,).
        """
        rows, found = self.template.matrix.shape[0], []
        for pair in zip(labellings, undecided, strict=True):
            checkpoint()
            with self._solving:
                found.append(self._solver.solve(self.program(*pair)).dual[:rows])
        answers: list[DualBound | None] = [None] * len(labellings)
        self._add_refutations(np.array(found), np.arange(len(labellings)), labellings, undecided, thresholds, answers)
        return answers

    def _refutations(
        self, velocities: Floats, labels: Bits, undecided: Bools, thresholds: Floats
    ) -> list[DualBound | None]:
        """Return the refutations (k,) that velocities prove; None for thresholds not refuted.

        velocities: (k, q·free) scaled, of order one. labels, undecided: (k, m) labels, True = dry, and faces that may
        have either. thresholds: (k,) scaled λ.
        """
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
