"""Faces whose label is not decided: what bounds λ over all labellings that agree on the faces that are.

The relaxation of an **undecided** face is the closed hull of its dry and its inner set, docs/method.md (6.3), which the
yield set knows (`YieldSet.hull`); a set that does not leaves no relaxation. Where planar joints may crush, its rows are
wide of the hull, and two copies share the forces instead (`SharedHull`); the batch solver follows it with rows of its
own, to
some hundredths of a percent in an arch (`YieldSet.bow`).

What a mechanism then bounds is measured with the hull's own support function, max(D_dry, D_inner), whatever the
rows were: a bound is right for every labelling it speaks of, however loose the program that it came from.
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import CARRIED, CARRIES, FALLS, OPEN, REFUTED, BatchSolver, ConflictRequest, chosen, fits
from jld_core.deadline import checkpoint
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.shared_hull import SharedHull
from jld_core.program import ConicProgram
from jld_core.solvers import make_solver

_TINY: Final = 1e-6
"""Margins, relative to the largest jump, that are worth closing by opening all faces a little."""

_ANY: Final = 1e12
"""A scaled λ above any that is of use."""

_RESIDUAL: Final = 1e-10
"""Asked of the solver: bounds are computed from its answer, so that it need not be exact."""

_COUNTING: Final = Lock()
"""Several threads may shrink, each its own labellings."""


@dataclass(frozen=True)
class DualBound:
    """Why no labelling that agrees on some faces reaches a load factor.

    excess: threshold · b_λ·u + b·u − Σ D, above zero with what rounding may take. cost: (m,) what a face takes from
    the excess when it becomes undecided, inf where the mechanism bounds nothing then. bound: λ that no such
    labelling exceeds, scaled; −inf where none stands. velocity: (q·free,) the mechanism, scaled. case: index of the
    load case under which it was weighed.
    """

    excess: float
    cost: Floats
    bound: float
    velocity: Floats
    case: int = 0


@dataclass(frozen=True)
class MinimizedConflict:
    """What became of a labelling, or of a neighbour of it, that was shrunk.

    labelling: which of those asked. drawn: that one itself. decided: (m,) faces that matter. bound: scaled λ that no
    labelling exceeds that has its labels there, −inf where none stands; None where nothing refuted it. carries: its
    forces were seen to carry more. velocity: (q·free,) the mechanism that refuted it, scaled; case: index of the load
    case under which that mechanism was weighed.
    """

    labelling: int
    drawn: bool
    decided: Bools
    bound: float | None
    carries: bool = False
    velocity: Floats | None = None
    case: int = 0


@dataclass(frozen=True)
class _WorkBalance:
    """Work balance of k mechanisms: λ · work ≤ total for every labelling that agrees where decided.

    velocities: (k, q·free) with the opening that rounding asked for. work: (k,) of the live load. total: (k,)
    dissipation less dead work, with what rounding may take. sound: (k,) whether the dissipation is finite. own, either:
    (k, m) dissipation of each face under its own label, and the larger of both labels.
    """

    velocities: Floats
    work: Floats
    total: Floats
    sound: Bools
    own: Floats
    either: Floats


class Relaxation:
    """Upper bounds on λ for partial labellings of one assembly.

    analysis: of the assembly; template, prover and the motion that opens all faces are shared with it.
    """

    def __init__(self, analysis: LimitAnalysis) -> None:
        self.template = analysis.template
        self._prover, self._interior = analysis.prover, analysis.repair
        hull = self.template.yield_set.hull()
        if hull is None:
            raise TypeError("no hull is known of these yield sets")
        self._open = self.template.with_rows(hull)
        strengths, planar = self.template.assembly.strengths, self.template.assembly.dimension == 2
        # while dry joints never crush the hull has rows
        self._shared = SharedHull(self.template) if planar and np.isfinite(strengths.crush_dry).any() else None
        self._batch: BatchSolver | None = None
        if chosen() is not None and fits(self.template, hull):
            opening = analysis.repair.opening()
            velocity = None if opening is None else opening.velocity
            self._batch = BatchSolver(self.template, velocity, zero=analysis.floor, undecided=hull)
        self._route = make_solver("clarabel", tolerance=max(_RESIDUAL, self.template.precision.residual))
        self._margin = max(_RESIDUAL, self.template.precision.margin)
        self.solves = 0

    def program(self, labels: Bits, undecided: Bools) -> ConicProgram:
        """The program of a partial labelling: labels (m,) True dry, of no force where undecided (m,)."""
        if self._shared is not None:
            return self._shared.program(labels, undecided, self._margin)
        return self.template.program(labels, self._margin, other=self._open, taken=undecided)

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """A proof that no labelling that agrees where decided reaches a scaled λ; None where there is none.

        labels: (m,) True dry. undecided: (m,). threshold: scaled λ.
        """
        return self.refute_all(labels[None], undecided[None], np.array([threshold]))[0]

    @property
    def many(self) -> bool:
        """Whether relaxations are solved many at a time."""
        return self._batch is not None

    @property
    def unit(self) -> float:
        """λ in scene units for each of what is bounded here."""
        return self.template.scaling.load

    @property
    def each(self) -> tuple[Relaxation, ...]:
        """The relaxation of every load: of this one alone."""
        return (self,)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """The same for labellings and undecided faces (k, m) and thresholds (k,): at once where the batch solver can.

        thorough: (k,) whether what the batch solver leaves open is worth another route, default all.
        """
        count = len(labellings)
        self.solves += count
        found: list[DualBound | None] = [None] * count
        left = np.arange(count)
        if self._batch is not None:
            answers = self._batch.solve(labellings, undecided=undecided, thresholds=thresholds, vectors=True)
            assert answers.velocity is not None
            # forces that carry more are a hint: to refute nothing is never wrong
            told = np.flatnonzero(answers.verdict != CARRIES)
            self._weigh_all(answers.velocity[told], told, labellings, undecided, thresholds, found)
            # between abutments the batch solver bounds what a weighing, which is to the last digit, does not
            low = (answers.verdict == OPEN) | (answers.verdict == FALLS) | (answers.high < thresholds)
            left = np.array([k for k in told.tolist() if found[k] is None and low[k]], dtype=int)
            if thorough is not None:
                left = left[thorough[left]]
        if len(left):
            others = self._by_route(labellings[left], undecided[left], thresholds[left])
            for k, one in zip(left.tolist(), others, strict=True):
                found[k] = one
        return found

    def minimize_conflicts(self, asked: ConflictRequest) -> list[MinimizedConflict]:
        """Labellings with as few faces decided as still keep λ at their thresholds, scaled, and neighbours of them;
        where the batch solver solves many at a time. Whatever it refuted is weighed here.
        """
        assert self._batch is not None
        raw = self._batch.minimize_conflicts(asked)
        with _COUNTING:
            self.solves += int(raw.relaxations.sum())
        begun = np.flatnonzero(raw.relaxations)
        of = raw.labelling[begun]
        left = np.arange(len(begun))[raw.fate[begun] == REFUTED]
        open_ = asked.free & ~raw.decided[begun]
        found: list[DualBound | None] = [None] * len(begun)
        self._weigh_all(raw.velocity[begun[left]], left, asked.labellings[of], open_, asked.thresholds[of], found)
        drawn = begun % (1 + asked.how.neighbours) == 0
        rows = zip(of.tolist(), drawn.tolist(), raw.decided[begun], found, raw.fate[begun].tolist(), strict=True)
        return [
            MinimizedConflict(k, own, faces, None, fate == CARRIED)
            if one is None
            else MinimizedConflict(k, own, faces, one.bound, fate == CARRIED, one.velocity)
            for k, own, faces, one, fate in rows
        ]

    def weigh(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Weigh known mechanisms again, without solving anything.

        Parameters
        ----------
        case : int
            Index of the load case; a single load has only case 0.
        velocities : (k, q·free) float array
            Mechanisms, scaled.
        labellings : (k, m) bool array
            Labels, True = dry; of no force where undecided.
        undecided : (k, m) bool array
            Faces that may have either label.

        Returns
        -------
        (k,) float array
            Scaled λ that no labelling exceeds that agrees where decided; −inf where none stands, inf where the
            mechanism proves nothing.

        Raises
        ------
        ValueError
            For a load case that does not exist.
        """
        if case != 0:
            raise ValueError(f"case: there is one load, and no load case {case}")
        balance = self._balance(velocities, labellings, undecided)
        with np.errstate(invalid="ignore", divide="ignore"):
            bound = np.where(balance.work > 0.0, balance.total / balance.work, np.inf)
        bound[(balance.work == 0.0) & (balance.total < 0.0)] = -np.inf
        bound[~balance.sound] = np.inf
        return bound

    def _weigh_all(
        self,
        velocities: Floats,
        which: Ints,
        labellings: Bits,
        undecided: Bools,
        thresholds: Floats,
        found: list[DualBound | None],
    ) -> None:
        """Put into `found` what velocities (j, q·free) bound, as they are or with a little of a motion that opens all.

        which: (j,) which of the k labellings they are of.
        """
        fine = np.isfinite(velocities).all(axis=1)
        which, velocities = which[fine], velocities[fine]
        size = abs(velocities).max(axis=1, initial=0.0)
        moving = (size > 0.0) & (size < 1e30)  # what a failed solve leaves behind may be anything
        which, velocities = which[moving], velocities[moving] / size[moving, None]
        opening = self._interior.opening()
        for parted in (False, True):
            if parted:
                if opening is None:
                    return
                velocities = velocities + 1e-9 / float(abs(opening.velocity).max()) * opening.velocity
            if not len(which):
                return
            answers = self._weigh(velocities, labellings[which], undecided[which], thresholds[which])
            for k, answer in zip(which.tolist(), answers, strict=True):
                found[k] = answer
            lacking = np.array([answer is None for answer in answers])
            which, velocities = which[lacking], velocities[lacking]

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Scaled λ that no labelling exceeds that agrees where decided; inf where none was found."""
        found = self.least_bound(labels, undecided)
        return np.inf if found is None else found.bound

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """The mechanism of least bound that was found for a partial labelling; None where none was."""
        found = self.refute_all(labels[None], undecided[None], np.array([_ANY]))
        if self._shared is not None and self._batch is not None:
            # the batch solver's rows enclose the hull of joints that crush: what the hull itself bounds is a little
            # less
            found += self._by_route(labels[None], undecided[None], np.array([_ANY]))
        return min((one for one in found if one is not None), key=lambda one: one.bound, default=None)

    def _by_route(self, labellings: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """The same by the other route, one after the other."""
        rows, found = self.template.matrix.shape[0], []
        for pair in zip(labellings, undecided, strict=True):
            checkpoint()
            found.append(self._route.solve(self.program(*pair)).dual[:rows])
        answers: list[DualBound | None] = [None] * len(labellings)
        self._weigh_all(np.array(found), np.arange(len(labellings)), labellings, undecided, thresholds, answers)
        return answers

    def _weigh(self, velocities: Floats, labels: Bits, undecided: Bools, thresholds: Floats) -> list[DualBound | None]:
        """What velocities (k, q·free), none faster than one or so, bound of labellings (k, m)."""
        balance = self._balance(velocities, labels, undecided)
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

    def _balance(self, velocities: Floats, labels: Bits, undecided: Bools) -> _WorkBalance:
        """Work balance of mechanisms (k, q·free) for labellings (k, m), rounding charged against the mechanism."""
        velocities, jumps, finite = self._opened(velocities)
        dissipation = np.where(finite >= 0.0, self._measured(jumps, margins=False), np.inf)
        either = dissipation.max(axis=0)
        own = np.where(undecided, either, np.where(labels, dissipation[0], dissipation[1]))
        # sums row by row: a product of matrices would round by how many rows there are
        powers = velocities * self.template.live
        work = powers.sum(axis=1)
        # what is left of terms that cancel bounds nothing
        work[abs(work) < tolerances.ROUNDING * abs(powers).sum(axis=1)] = 0.0
        total = own.sum(axis=1) - (velocities * self.template.dead).sum(axis=1)
        sound = np.isfinite(total) & (work >= 0.0)
        total = np.where(sound, total, 0.0)
        total += self._prover.noises(velocities, total)
        return _WorkBalance(velocities, work, total, sound, own, either)

    def _measured(self, jumps: Floats, *, margins: bool) -> Floats:
        """(2, k, m) margins or dissipation of jumps (k, m, q), dry then inner."""
        sets, faces = self.template.yield_set, jumps.shape[1]
        measure = sets.margin if margins else sets.dissipation
        every = np.ones(faces, dtype=bool)
        if self.template.assembly.dimension == 2:
            return np.array([measure(jumps, every), measure(jumps, ~every)])
        each = [[measure(one, labels) for one in jumps] for labels in (every, ~every)]
        return np.array(each).reshape(2, *jumps.shape[:2])

    def _opened(self, velocities: Floats) -> tuple[Floats, Floats, Floats]:
        """Velocities with the opening added that margins missed by rounding need, their jumps, and margins then."""
        jumps = self._prover.jumps(velocities)
        finite = self._measured(jumps, margins=True)
        opening = self._interior.opening()
        reach = _TINY * np.maximum(abs(jumps).max(axis=(1, 2)), 1e-300)
        lacks = np.where((finite < 0.0) & (finite > -reach[None, :, None]), -finite, 0.0).max(axis=(0, 2))
        rows = np.flatnonzero(lacks > 0.0)
        if opening is None or not rows.size:
            return velocities, jumps, finite
        velocities = velocities.copy()
        velocities[rows] += (1.01 * lacks[rows] / opening.margin)[:, None] * opening.velocity
        jumps[rows] = self._prover.jumps(velocities[rows])
        finite[:, rows] = self._measured(jumps[rows], margins=True)
        return velocities, jumps, finite
