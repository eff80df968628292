"""Proof by fields that no layout carries more than the best by a gap: conflicts, and a pool of layouts to refine."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import Deadline
from jld_core.fields.adaptive import FieldSetting
from jld_core.fields.mesh import Mesh, subdivide
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_check import Claim, ProofCheck, check_proof
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism, ProofState
from jld_explore.drivers.exact.schedules import TargetSchedule
from jld_explore.drivers.field_relaxation import FieldProblem, FieldProofContext, FieldRelaxation
from jld_explore.drivers.field_tasks import ProofSetup, level_conflict, refuting_step
from jld_explore.evaluation.field_pool import TOGETHER, FieldPool
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical

_PATIENCE: Final = 300
"""Conflicts before the bound is lowered in smaller steps, about a minute."""

_FIRST: Final = 8
"""Evaluated labellings of greatest lower bound that are refined before the proof begins."""

_ALIKE: Final = 1e-4
"""Relative difference of lower bounds below which two evaluated labellings count as alike; one of them is refined."""

_DRY: Final = 0.5
"""Probability that a drawn labelling prefers a face dry."""

_COMPARED: Final = 300
"""Number of the strongest labellings compared with all conflicts at the end of a proof."""

_ROOT_PARTS: Final = (2, 4)
"""Parts of each edge of the coarsest mesh, for the finer meshes that bound all labellings at once."""

_LEVELS: Final = (1, 2)
"""Parts of each edge of the coarsest mesh, for the meshes on which all labellings are refuted."""

_FADING: Final = 0.1
"""Weight of the last labelling in the share of labellings that a mesh refutes."""

_RARELY: Final = 0.1
"""Share of labellings refuted by a mesh below which it is left out."""

_AGAIN: Final = 8
"""A mesh that is left out is still tried once in this number of batches."""

_CAUTION: Final = 1.5
"""Multiple of the longest batch of labellings that must be left of the time for another one."""

_BELOW: Final = 1e-9
"""Relative distance from best / (1 − gap), below which the bound ends, that covers rounding of the gap."""


class FieldProof:
    """Proof of an upper bound on the governing factor of all labellings, down to that of the best and a gap.

    Parameters
    ----------
    space : SearchSpace
        The search space, of a planar assembly.
    blocks : PossibleBlocks or None
        Possible blocks, where they are listed.
    seed : int
        Seed of the preferred labels.
    gap : float
        Relative distance between the best lower bound and the bound on all labellings at which the proof ends.

    Attributes
    ----------
    gap : float
        As the parameter.
    pool : FieldPool
        Labellings that the meshes of all labellings do not refute, with their bounds.
    state : ProofState
        Conflicts of the proof.
    bound : float
        Governing factor that no labelling exceeds, inf before the first bound.
    check : ProofCheck or None
        Check of the proof, None before its end.
    waiting : list of (m,) bool array
        Labellings that wait for their evaluation on the coarsest mesh.
    stopped : bool
        Whether time ended the refinement of a labelling on which the proof depends.
    programs : int
        Number of programs solved for conflicts.
    """

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks | None, seed: int, gap: float) -> None:
        self.space, self.gap, self._blocks = space, gap, blocks
        self._free = space.candidates.copy()
        if blocks is not None:
            joined = {face for inside in blocks.inside for face in inside}
            self._free &= np.isin(np.arange(len(self._free)), list(joined))
        # candidates outside every possible block are dry
        self._root_labels = space.fixed | (space.candidates & ~self._free)
        assembly = space.assembly
        settings = tuple(FieldSetting.of(case) for case in assembly.by_case)
        required = tuple(assembly.required.tolist())
        self._setup = ProofSetup(uuid.uuid4().hex, settings, required, self._free, _LEVELS)
        self.pool = FieldPool(assembly, np.empty((0, len(space.fixed)), dtype=bool))
        self._known: dict[bytes, tuple[float, float]] = {}
        self._rows: dict[bytes, None] = {}
        self._rng = np.random.default_rng([seed, 3])
        self.programs, self._drawn, self._batch_seconds = 0, 0, 0.0
        self.deadline = Deadline()
        self.restart()

    def restart(self) -> None:
        """Begin anew, with what was evaluated."""
        self.state = ProofState(self.space)
        self.relaxation = FieldRelaxation(self._setup.problems(0))
        for level in range(1, len(_LEVELS)):
            for problem in self._setup.problems(level):
                self.relaxation.add(problem)
        self._refuting = [1.0] * len(_LEVELS)
        self._formula: Formula | None = None
        self._schedule = TargetSchedule(_PATIENCE)
        self.bound, self._aimed, self._began = math.inf, math.inf, 0
        self.waiting: list[Bits] = []
        self._begun = self.settled = self.stopped = False
        self._refuted = np.full(len(self.pool), np.inf)
        self.pool.given_up[:] = False
        self.check: ProofCheck | None = None

    @property
    def best(self) -> float:
        """Largest proven lower bound on the governing factor, −inf without any."""
        known = max((low for low, _ in self._known.values()), default=-math.inf)
        return max(known, float(self.pool.low().max(initial=-math.inf)))

    def bounds_above(self, labellings: Bits) -> Floats:
        """Return upper bounds (k,) on the governing factor of labellings (k, m) by all conflicts, inf without any."""
        found = np.full(len(labellings), self.bound)
        for one in self.state.conflicts:
            matching = (labellings[:, one.faces] == one.labels).all(axis=1)
            found[matching] = np.minimum(found[matching], one.bound)
        return found

    def learn(self, labels: Bits, low: float, high: float) -> None:
        """Take the bounds of an evaluated labelling (m,), infinite where there is none.

        One that the proof asked for joins the pool.
        """
        self._known[labels.tobytes()] = low, high
        if self._begun and labels.tobytes() not in self._rows:
            self._join([labels])

    def _join(self, labellings: Sequence[Bits]) -> None:
        """Add evaluated labellings (m,) to the pool."""
        known = np.array([self._known[labels.tobytes()] for labels in labellings]).reshape(-1, 2)
        if len(known):
            self._rows.update(dict.fromkeys(labels.tobytes() for labels in labellings))
            self.pool.add(np.array(labellings), known[:, 0], known[:, 1])
            bounds = [self._conflict_bound(labels) for labels in labellings]
            self._refuted = np.concatenate([self._refuted, bounds])

    def _conflict_bound(self, labels: Bits) -> float:
        """Return the least bound of a conflict that a labelling (m,) has, inf without any."""
        mine = (one.bound for one in self.state.conflicts if (labels[one.faces] == one.labels).all())
        return min(mine, default=math.inf)

    # --- conflicts of an earlier run --------------------------------------------------------------------

    @property
    def shared(self) -> int:
        """Number of problems that every proof of the space has."""
        return len(_LEVELS) * len(self._setup.settings)

    def load_case(self, problem: FieldProblem) -> int:
        """Return the load case of a problem."""
        return next(case for case, setting in enumerate(self._setup.settings) if setting is problem.setting)

    def add_problem(self, case: int, mesh: Mesh) -> int:
        """Add a mesh of a load case, on which mechanisms are weighed; return the position of the problem."""
        return self.relaxation.add(FieldProblem(self._setup.settings[case], mesh, self._setup.required[case]))

    def weigh(self, conflict: Conflict) -> float:
        """Return the bound that the mechanism of a conflict proves, inf without any."""
        if conflict.mechanism is None:
            return math.inf
        labels, undecided = self._root_labels.copy(), self._free.copy()
        labels[conflict.faces], undecided[conflict.faces] = conflict.labels, False
        one = conflict.mechanism
        return float(
            self.relaxation.evaluate_mechanisms(one.case, one.velocity[None], labels[None], undecided[None])[0]
        )

    def take(self, conflicts: Sequence[Conflict]) -> None:
        """Take over conflicts that were weighed again."""
        self._add(conflicts)

    # --- the proof --------------------------------------------------------------------------------------

    @property
    def _goal(self) -> float:
        """Governing factor above which labellings must be refuted for the gap, 0 where none is known to stand."""
        best = self.best
        if best <= 0.0:
            return 0.0
        return best / (1.0 - self.gap) * (1.0 - _BELOW) if self.gap < 1.0 else math.inf

    def work(self) -> None:
        """Take one step: begin, refine labellings of the pool, draw others, or lower the bound."""
        if not self._begun:
            self._begin()
        elif self._goal > self._aimed or self._aimed >= self.bound:
            self._aim()
        elif (rows := self._open()).size:
            self._refine(rows)
        elif not self._draw():
            self._lower()
        elif self._schedule.is_stuck(len(self.state.conflicts) - self._began, self.bound, self._aimed):
            self._aim()

    def _begin(self) -> None:
        """Bound all labellings on finer meshes, and put the best evaluated ones into the pool."""
        self._begun = True
        for parts in _ROOT_PARTS:
            # four times the triangles take some ten times as long
            if self.reached or self.deadline.remaining() < 10.0 * self._batch_seconds:
                break
            self.bound_all(parts)
        self._join([labels for labels in self._promising() if labels.tobytes() not in self._rows])
        self._aim()

    def bound_all(self, parts: int = 1) -> None:
        """Bound all labellings by one program for each load case, with edges of the coarsest mesh in some parts."""
        start, nothing = time.perf_counter(), np.empty(0, dtype=np.int64)
        for case, setting in enumerate(self._setup.settings):
            one = FieldProblem(setting, subdivide(setting.coarse, parts), self._setup.required[case])
            found = FieldRelaxation([one]).refute(self._root_labels, self._free, self.bound)
            if found is not None:
                mechanism = Mechanism(self.add_problem(case, one.mesh), found.velocity)
                self._add([Conflict(nothing, nothing.astype(bool), found.bound, mechanism=mechanism)])
                self.bound = found.bound
        self._batch_seconds = time.perf_counter() - start

    @property
    def reached(self) -> bool:
        """Whether the bound is as near to the best as the gap asks for, or no layout stands."""
        return self.bound <= self._goal

    def _promising(self) -> list[Bits]:
        """Return the evaluated labellings of greatest lower bounds, of those alike one."""
        stands = sorted((-low, key) for key, (low, _) in self._known.items() if low > 0.0)
        chosen: list[Bits] = []
        last = -math.inf
        for weaker, key in stands:
            if weaker - last > _ALIKE * abs(weaker):
                chosen.append(np.frombuffer(key, dtype=bool))
                last = weaker
        return chosen[:_FIRST]

    def _aim(self) -> None:
        """Aim the formula at the next factor to refute, or end the proof where the goal is reached."""
        goal = self._goal
        if self.bound <= max(goal, 0.0):
            self._settle()
            return
        self._aimed = max(goal, self._schedule.next_target(self.bound, goal))
        self._began = len(self.state.conflicts)
        if self._formula is None:
            self._formula = Formula(self.space, self._blocks)
            self._formula.learn(self.state.conflicts)
        self._formula.aim(self._aimed)
        for labels in [*self.waiting, *self.pool.labellings]:
            self._formula.set_aside(np.arange(len(labels)), labels)

    def _open(self) -> Ints:
        """Return the rows of the pool to refine next: not refuted by a conflict, in turns by either bound."""
        low, high = self.pool.low(), self.pool.high()
        rows = np.flatnonzero((self._refuted > self._aimed) & ~self.pool.given_up)
        by_high, by_low = rows[np.lexsort((-low[rows], -high[rows]))], rows[np.argsort(-low[rows], kind="stable")]
        turns = [int(row) for pair in zip(by_low, by_high, strict=True) for row in pair]
        return np.array(list(dict.fromkeys(turns)), dtype=np.int64)[:TOGETHER]

    def _refine(self, rows: Ints) -> None:
        """Take labellings of the pool one mesh further, and learn what their velocity fields prove."""
        enough = np.full(len(self.pool), self.best)
        steps = self.pool.refine(rows.tolist(), enough, refuting_step, (self._free, self._aimed))
        for _, case, mesh, step in steps:
            conflict: Conflict | None = step.more
            if conflict is None or conflict.mechanism is None:
                continue
            mechanism = replace(conflict.mechanism, case=self.add_problem(case, mesh))
            self._add([replace(conflict, mechanism=mechanism), *self._of_others(mechanism)])

    def _of_others(self, mechanism: Mechanism) -> list[Conflict]:
        """Return conflicts of whole labellings of the pool that the velocity field of another one refutes."""
        rows = np.flatnonzero(self._refuted > self._aimed)
        count, faces = len(rows), np.flatnonzero(self._free)
        if not count:
            return []
        labels = self.pool.labellings[rows]
        velocities = np.broadcast_to(mechanism.velocity, (count, *mechanism.velocity.shape))
        bounds = self.relaxation.evaluate_mechanisms(mechanism.case, velocities, labels, np.zeros_like(labels)).tolist()
        pairs = zip(labels, bounds, strict=True)
        return [Conflict(faces, own[faces], bound, mechanism=mechanism) for own, bound in pairs if bound <= self._aimed]

    def _draw(self) -> bool:
        """Draw labellings that no conflict rules out and minimise them; return False where none is left."""
        formula = self._formula
        if formula is None:
            raise RuntimeError("the proof has no formula before its first aim")
        drawn: list[Bits] = []
        while len(drawn) < TOGETHER:
            wish = self._rng.random(len(self._free)) < _DRY
            labels = formula.next(preferred=wish)
            if labels is None:
                break
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        if _CAUTION * self._batch_seconds > self.deadline.remaining():
            self.stopped = True
            return True
        start, levels = time.perf_counter(), self._levels()
        tasks = [(self._setup, labels, self._aimed, levels) for labels in drawn]
        found = self.pool.tasks.run(level_conflict, tasks)
        self._batch_seconds = max(self._batch_seconds, time.perf_counter() - start)
        self.programs += sum(one.solves for one in found)
        for labels, one in zip(drawn, found, strict=True):
            for level in levels[: levels.index(one.level) + 1 if one.level >= 0 else None]:
                self._refuting[level] += _FADING * ((level == one.level) - self._refuting[level])
            if one.conflict is None or one.conflict.mechanism is None:
                self._hand_over(np.asarray(canonical(labels[None], self.space.group))[0])
                continue
            number = one.conflict.mechanism.case + one.level * len(self._setup.settings)
            self._add([replace(one.conflict, mechanism=replace(one.conflict.mechanism, case=number))])
        return bool(drawn)

    def _levels(self) -> tuple[int, ...]:
        """Return the meshes on which labellings are refuted: those that rarely do are tried now and then."""
        self._drawn += 1
        wanted = [level for level, share in enumerate(self._refuting) if share >= _RARELY or not self._drawn % _AGAIN]
        return tuple(wanted)

    def _hand_over(self, labels: Bits) -> None:
        """Have a labelling (m,) that the coarsest mesh does not refute evaluated, unless it was."""
        if labels.tobytes() in self._rows:
            return
        if labels.tobytes() in self._known:
            self._join([labels])
        else:
            self.waiting.append(labels)

    def _add(self, conflicts: Sequence[Conflict]) -> None:
        """Add conflicts to the proof, the formula, and what is known of the labellings of the pool."""
        self.state.add_conflicts(conflicts)
        if self._formula is not None:
            self._formula.learn(conflicts)
        for one in conflicts:
            matching = (self.pool.labellings[:, one.faces] == one.labels).all(axis=1)
            self._refuted[matching] = np.minimum(self._refuted[matching], one.bound)

    def _lower(self) -> None:
        """Lower the bound to the factor aimed at, or to what labellings that are refined no more leave open."""
        self.bound = min(self.bound, max(self._aimed, float(self._refuted.max(initial=-math.inf))))
        self._schedule.note_proven(len(self.state.conflicts) - self._began)
        if self.bound <= self._aimed and self.bound > self._goal:
            self._aim()
        elif self.pool.late:
            self.stopped = True
        else:
            self._settle()

    def _settle(self) -> None:
        """End the proof and check it."""
        self.settled = True
        context = FieldProofContext(self.relaxation, self.space, self._blocks, self._free)
        self.relaxation.forget()  # all mechanisms are weighed again
        claim = Claim(None, max(self.bound, 0.0))
        problem = "" if math.isfinite(self.bound) else "a layout has no upper bound"
        self.check = check_proof(context, self.state, [claim], self._strongest(), problem, self.deadline.elapsed())

    def _strongest(self) -> tuple[Bits, Floats]:
        """Return the labellings (k, m) of greatest lower bounds (k,)."""
        lows = {key: low for key, (low, _) in self._known.items()}
        for key, low in zip(self._rows, self.pool.low().tolist(), strict=True):
            lows[key] = max(low, lows.get(key, -math.inf))
        stands = sorted((-low, key) for key, low in lows.items() if math.isfinite(low))[:_COMPARED]
        rows = np.frombuffer(b"".join(key for _, key in stands), dtype=bool).reshape(len(stands), len(self._free))
        return rows, np.array([-low for low, _ in stands])
