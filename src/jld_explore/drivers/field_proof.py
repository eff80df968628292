"""Proof by fields that no layout carries more than the best by a gap."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import Deadline
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_check import ProofCheck, check_proof
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism, ProofState
from jld_explore.drivers.exact.schedules import TargetSchedule
from jld_explore.drivers.field_aims import ProofAim, holds
from jld_explore.drivers.field_incumbents import FieldIncumbents, has_conflict
from jld_explore.drivers.field_meshes import CommonMeshes
from jld_explore.drivers.field_refuter import FieldRefuter
from jld_explore.drivers.field_tasks import refuting_step
from jld_explore.evaluation.field_pool import TOGETHER, FieldPool
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical
from jld_explore.space.measures import Range

_PATIENCE: Final = 300  # conflicts before the bound is lowered in smaller steps, about a minute

_FIRST: Final = 8  # evaluated labellings of greatest lower bound that are refined before the proof begins

_FIRST_OF_COUNT: Final = 2  # number as `_FIRST`, for each count of a front

# Relative difference of lower bounds below which two evaluated labellings count as alike; one of them is refined
_ALIKE: Final = 1e-4

_DRY: Final = 0.5  # probability that a drawn labelling prefers a face dry

_COMPARED: Final = 300  # number of the strongest labellings compared with all conflicts at the end of a proof

_ROOT_CAUTION: Final = 4.0  # least time left for another mesh that bounds all labellings, over the time of the last one

# Relative gap, over the gap asked for, down to which brackets of the best labellings are refined in a long proof
_SHARP: Final = 0.4

_LONG: Final = 40  # conflicts from which a proof counts as long

_SHARPENED: Final = 2  # number of labellings refined together for a larger lower bound, in order of their lower bounds

_SHARPENING: Final = 0.1  # largest share of the time left that one more mesh for a larger lower bound may take

_CAUTION: Final = 1.5  # least time left for another batch of labellings, over the time of the longest batch


class FieldProof:
    """Proof of upper bounds on the governing factor of labellings, one target after another.

    space: the search space, of a planar assembly. blocks: possible blocks, where they are listed. refuter: meshes on
    which labellings are refuted. incumbents: labellings that were evaluated, and the pool of those that the meshes of
    all labellings do not refute. state: conflicts of the proof. bound: governing factor that no labelling exceeds, inf
    before the first bound. check: check of the proof, None before its end. waiting: labellings that wait for their
    evaluation on the coarsest mesh. stopped: whether time ended the proof before its targets were settled.
    """

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks | None, seed: int, aim: ProofAim) -> None:
        self.space, self.aim, self._blocks, self._seed = space, aim, blocks, seed
        self.refuter = FieldRefuter(space, blocks)
        self.incumbents = FieldIncumbents(space, aim)
        self._batch_seconds = 0.0
        self.deadline = Deadline()
        self.restart()

    def restart(self) -> None:
        """Forget all conflicts and bounds on targets; keep evaluations and the pool."""
        self.aim.restart()
        self.state = ProofState(self.space)
        self.refuter.restart()
        self._formula: Formula | None = None
        self._rng = np.random.default_rng([self._seed, 3])
        self._schedule = TargetSchedule(_PATIENCE)
        self.bound = self._left_open = self._aimed = math.inf
        self._target: int | Range | None = None
        self._began = 0
        self.waiting: list[Bits] = []
        self._begun = self._cut = self.settled = self.stopped = False
        self._refuted = np.full(len(self.pool), np.inf)
        self.pool.given_up[:] = False
        self.check: ProofCheck | None = None

    @property
    def pool(self) -> FieldPool:
        """Labellings that are refined one by one, with their bounds."""
        return self.incumbents.pool

    @property
    def best(self) -> float:
        """Largest proven lower bound on the governing factor; −inf without a layout."""
        return max(self.incumbents.best().values(), default=-math.inf)

    def bounds_above(self, labellings: Bits) -> Floats:
        """Return proven upper bounds (k,) on the governing factor of labellings (k, m)."""
        found = np.full(len(labellings), self.bound)
        for one in self.state.conflicts:
            matching = has_conflict(one, labellings, self.space.group)
            found[matching] = np.minimum(found[matching], one.bound)
        return found

    def learn(self, labellings: Bits, low: Sequence[float], high: Sequence[float]) -> None:
        """Store bounds on the governing factor of evaluated labellings (k, m), True = dry.

        low, high: k each, −inf and inf for none. Once `work` has begun, all of them join the pool.
        """
        self.incumbents.learn(labellings, low, high)
        if self._begun:
            self._join(list(labellings))

    def _join(self, labellings: Sequence[Bits]) -> None:
        """Add evaluated labellings (m,) to the pool."""
        self._refuted = np.concatenate([self._refuted, self.bounds_above(self.incumbents.join(labellings))])

    def take(self, conflicts: Sequence[Conflict]) -> None:
        """Add conflicts of an earlier run, weighed again, to the proof; see `load_conflicts`."""
        self._add(conflicts)

    # --- the proof --------------------------------------------------------------------------------------

    @property
    def _goal(self) -> float:
        """Governing factor above which labellings of the target must be refuted."""
        return self.aim.goal(self.incumbents.best())

    def work(self) -> None:
        """Take one step of the proof: begin, refine, draw labellings, or lower the bound.

        The caller repeats it, and evaluates `waiting` labellings, until `settled` or `stopped`.
        """
        best = self.incumbents.best() if self._begun else {}
        if not self._begun:
            self._begin()
        elif (
            self.aim.goal(best) > self._aimed or self._aimed >= self._left_open or self.aim.target(best) != self._target
        ):
            self._aim()
        elif (rows := self._open()).size:
            self._refine(rows)
        elif (rows := self._wide_rows()).size:
            self._refine_lower(rows)
        elif not self._draw():
            self._lower()
        elif self._schedule.is_stuck(len(self.state.conflicts) - self._began, self._left_open, self._aimed):
            self._aim()

    def _begin(self) -> None:
        """Bound all labellings on finer meshes, and aim at the first target."""
        self._begun = True
        self._bound_finer()
        self._left_open = self.bound
        self._join_promising()
        self._aim()

    def _join_promising(self) -> None:
        """Put the best evaluated labellings of the target into the pool."""
        best = self.incumbents.best()
        target, goal = self.aim.target(best), self.aim.enough(best)
        number = _FIRST if target is None or isinstance(target, Range) else _FIRST_OF_COUNT
        self._join(self.incumbents.promising(target, goal, number, _ALIKE))

    def bound_all(self) -> None:
        """Lower `bound` by one program for each load case, on the coarsest meshes."""
        for case in range(self.refuter.cases):
            self._bound_by(self.refuter.common(case), case)

    def _bound_by(self, meshes: CommonMeshes, case: int) -> None:
        """Bound all labellings on the next mesh of load case `case`; store a lower bound."""
        start, nothing = time.perf_counter(), np.empty(0, dtype=np.int64)
        found = meshes.step()
        if found is not None and found.bound < self.bound:
            mechanism = Mechanism(self.refuter.add_problem(case, found.mesh), found.found.velocity)
            self._add([Conflict(nothing, nothing.astype(bool), found.bound, mechanism=mechanism)])
            self.bound = found.bound
        self._batch_seconds = time.perf_counter() - start

    def _bound_finer(self) -> None:
        """Bound all labellings on finer meshes in the time there is; refute labellings on some."""
        cases = [self.refuter.common(case) for case in range(self.refuter.cases)]
        while not self.reached and self.deadline.remaining() > _ROOT_CAUTION * self._batch_seconds:
            left = [case for case, meshes in enumerate(cases) if not meshes.ended]
            if not left:
                break
            for case in left:
                self._bound_by(cases[case], case)
        self.refuter.refute_on(cases)

    @property
    def reached(self) -> bool:
        """True if `bound` meets the goal of the target, or proves that no layout stands."""
        return self.bound <= max(self._goal, 0.0)

    def _aim(self) -> None:
        """Aim the formula at the next factor to refute, or end a target that is reached."""
        best = self.incumbents.best()
        goal = self.aim.goal(best)
        if self._left_open <= max(goal, 0.0):
            self._end_target()
            return
        following = self._schedule.next_target(self._left_open, goal) if self.aim.in_steps else goal
        self._aimed, self._target = max(goal, following), self.aim.target(best)
        self._began = len(self.state.conflicts)
        self._formula = self._formula or self._stated()
        self._formula.aim(self._aimed, self._target)
        for labels in [*self.waiting, *self.pool.labellings]:
            self._formula.set_aside(np.arange(len(labels)), labels)

    def _stated(self) -> Formula:
        """Return the formula of the labellings that no conflict rules out."""
        formula = Formula(self.space, self._blocks)
        formula.learn(self.state.conflicts)
        return formula

    def _in_target(self) -> Bools:
        """Return (k,) True for the labellings of the pool that belong to the target."""
        return holds(self._target, self.incumbents.counts)

    def _open(self) -> Ints:
        """Return rows of the pool to refine, not refuted: best lower and upper bounds in turns."""
        low, high = self.pool.low(), self.pool.high()
        rows = np.flatnonzero((self._refuted > self._aimed) & ~self.pool.given_up & self._in_target())
        by_high, by_low = rows[np.lexsort((-low[rows], -high[rows]))], rows[np.argsort(-low[rows], kind="stable")]
        turns = [int(row) for pair in zip(by_low, by_high, strict=True) for row in pair]
        return np.array(list(dict.fromkeys(turns)), dtype=np.int64)[:TOGETHER]

    def _wide_rows(self) -> Ints:
        """Return rows of the pool whose refinement may raise the best lower bound of a long proof."""
        low, high = self.pool.low(), self.pool.high()
        best = self.aim.enough(self.incumbents.best())
        if len(self.state.conflicts) < _LONG or not best > 0.0 or not self.aim.in_steps:
            return np.empty(0, dtype=np.int64)
        allowed = _SHARPENING * self.deadline.remaining()
        wide = high > best / (1.0 - _SHARP * self.aim.gap)
        rows = np.flatnonzero(wide & ~self.pool.given_up & self._in_target())
        rows = rows[[self.pool.expected_seconds(row) < allowed for row in rows.tolist()]] if rows.size else rows
        return rows[np.argsort(-low[rows], kind="stable")][:_SHARPENED]

    def _refine_lower(self, rows: Ints) -> None:
        """Refine `rows` of the pool by one mesh for their lower bounds."""
        self.pool.refine(rows.tolist(), self._enough())

    def _enough(self) -> Floats:
        """Return for each labelling of the pool the factor (k,) that a useful lower bound exceeds."""
        return np.full(len(self.pool), self.aim.enough(self.incumbents.best()))

    def _refine(self, rows: Ints) -> None:
        """Refine `rows` of the pool by one mesh; add the conflicts that their fields prove."""
        steps = self.pool.refine(rows.tolist(), self._enough(), refuting_step, (self.refuter.free, self._aimed))
        for _, case, mesh, step in steps:
            conflict: Conflict | None = step.more
            if conflict is None or conflict.mechanism is None:
                continue
            mechanism = replace(conflict.mechanism, case=self.refuter.add_problem(case, mesh))
            self._add([replace(conflict, mechanism=mechanism), *self._conflicts_of_others(mechanism)])

    def _conflicts_of_others(self, mechanism: Mechanism) -> list[Conflict]:
        """Return conflicts of other labellings of the pool that a mechanism refutes."""
        rows = np.flatnonzero(self._refuted > self._aimed)
        count, faces = len(rows), np.flatnonzero(self.refuter.free)
        if not count:
            return []
        labels = self.pool.labellings[rows]
        velocities = np.broadcast_to(mechanism.velocity, (count, *mechanism.velocity.shape))
        bounds = self.refuter.relaxation.evaluate_mechanisms(
            mechanism.case, velocities, labels, np.zeros_like(labels)
        ).tolist()
        pairs = zip(labels, bounds, strict=True)
        return [Conflict(faces, own[faces], bound, mechanism=mechanism) for own, bound in pairs if bound <= self._aimed]

    def _draw(self) -> bool:
        """Draw and refute a batch, or set `stopped` without time for it; False if none is left."""
        formula = self._formula
        if formula is None:
            raise RuntimeError("the proof has no formula before its first aim")
        drawn: list[Bits] = []
        while len(drawn) < TOGETHER:
            wish = self._rng.random(len(self.refuter.free)) < _DRY
            labels = formula.next(preferred=wish)
            if labels is None:
                break
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        if _CAUTION * self._batch_seconds > self.deadline.remaining():
            self.stopped = True
            return True
        start = time.perf_counter()
        found = self.refuter.refute(drawn, self._aimed, self.pool.tasks)
        self._batch_seconds = max(self._batch_seconds, time.perf_counter() - start)
        for labels, conflict in zip(drawn, found, strict=True):
            if conflict is None:
                self._hand_over(np.asarray(canonical(labels[None], self.space.group))[0])
            else:
                self._add([conflict])
        return bool(drawn)

    def _hand_over(self, labels: Bits) -> None:
        """Add a canonical labelling (m,) to the pool; one without evaluation waits for it first."""
        if self.incumbents.is_known(labels):
            self._join([labels])
        else:
            self.waiting.append(labels)

    def _add(self, conflicts: Sequence[Conflict]) -> None:
        """Add conflicts to the proof, the formula, and the bounds of the pool."""
        self.state.add_conflicts(conflicts)
        if self._formula is not None:
            self._formula.learn(conflicts)
        for one in conflicts:
            matching = has_conflict(one, self.pool.labellings, self.space.group)
            self._refuted[matching] = np.minimum(self._refuted[matching], one.bound)

    def _lower(self) -> None:
        """Lower the bound to the factor aimed at, or to that of the worst unrefuted labelling."""
        rest = float(self._refuted[self._in_target()].max(initial=-math.inf))
        self._left_open = min(self._left_open, max(self._aimed, rest))
        if self._target is None:
            self.bound = min(self.bound, self._left_open)
        self._schedule.note_proven(len(self.state.conflicts) - self._began)
        if self._left_open <= self._aimed and self._left_open > self._goal:
            self._aim()
        else:
            self._end_target()

    def _end_target(self) -> None:
        """Record the bound of a target; begin the next that has a labelling, or `_settle`."""
        self._cut |= self.pool.late and self._left_open > self._goal
        open_rows = (self._refuted > self._goal) & self._in_target() & (self._left_open > self._goal)
        known = self.aim.next(self._left_open, self.incumbents.best(), self.incumbents.counts[open_rows])
        while known is not None and not self._exists():
            known = self.aim.next(-math.inf, {}, np.empty(0))
        if known is None:
            self._settle()
            return
        self._left_open, self._aimed = known, math.inf
        self._schedule = TargetSchedule(_PATIENCE)
        self._join_promising()
        self._aim()

    def _exists(self) -> bool:
        """Return True if the target has any labelling, however weak."""
        self._formula = self._formula or self._stated()
        self._formula.aim(-math.inf, self.aim.target(self.incumbents.best()))
        return self._formula.next() is not None

    def _settle(self) -> None:
        """Check the ended proof, or set `stopped` if time left a target open."""
        self.stopped, self.settled = self._cut, not self._cut
        if self.stopped:
            return
        claims = self.aim.claims()
        finite = all(math.isfinite(claim.threshold) for claim in claims)
        problem = "" if finite else "a layout has no upper bound"
        strongest = self.incumbents.strongest(_COMPARED)
        self.check = check_proof(
            self.refuter.context(), self.state, claims, strongest, problem, self.deadline.elapsed()
        )
