"""Proof by fields that no layout carries more than the best by a gap."""

from __future__ import annotations

import math
import threading
import time
import uuid
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import Deadline
from jld_core.fields.bounds import Fields, FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import weighed
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.context import TargetSchedule
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_check import ProofCheck, check_proof
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism, ProofState
from jld_explore.drivers.field_aims import ProofAim, holds
from jld_explore.drivers.field_relaxation import CommonMeshes, FieldProblem, FieldProofContext, FieldRelaxation, raised
from jld_explore.evaluation.field_pool import TOGETHER, FieldPool, FieldStep, step_of
from jld_explore.evaluation.pool import Pool
from jld_explore.space import SearchSpace, values_of
from jld_explore.space.labelling import canonical
from jld_explore.space.limits import Range


def has_conflict(conflict: Conflict, labellings: Bits, group: Ints) -> Bools:
    """Return True for labellings that a conflict, or its mirror image, rules out, (k,).

    labellings: (k, m), True = dry. group: (g, m) permutations of faces, the symmetries of the scene.
    """
    images = labellings[:, group[:, conflict.faces]]
    return np.asarray((images == conflict.labels).all(axis=2).any(axis=1))


class FieldIncumbents:
    """Bounds of all evaluated labellings, and a pool of those that are refined.

    A proof by fields asks it for the best lower bounds, and for labellings to refine.

    aim: aim of the proof, whose count tells labellings apart. pool: labellings that are refined, with their bounds.
    counts: (k,) counts of the labellings of the pool, 0 where the aim has none.
    """

    def __init__(self, space: SearchSpace, aim: ProofAim) -> None:
        self._space, self._aim = space, aim
        self.pool = FieldPool(space.assembly, np.empty((0, len(space.fixed)), dtype=bool))
        self.counts: Floats = np.empty(0)
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._rows: dict[bytes, int] = {}

    def counts_of(self, labellings: Bits) -> Floats:
        """Return the value (k,) of the aim's count for each labelling.

        labellings: (k, m), True = dry. All are 0 where the aim has no count.
        """
        count = self._aim.count
        if count is None or not len(labellings):
            return np.zeros(len(labellings))
        return np.asarray(values_of(count, self._space.assembly, labellings, self._space.graph), dtype=float)

    def learn(self, labellings: Bits, low: Sequence[float], high: Sequence[float]) -> None:
        """Store the bounds on the governing factor of evaluated labellings.

        labellings: (k, m), canonical, True = dry.
        """
        for labels, *bounds, count in zip(labellings, low, high, self.counts_of(labellings).tolist(), strict=True):
            self._known[labels.tobytes()] = bounds[0], bounds[1], int(count)

    def is_known(self, labels: Bits) -> bool:
        """Return True if `learn` has stored bounds of exactly this labelling (m,)."""
        return labels.tobytes() in self._known

    def in_pool(self, labels: Bits) -> bool:
        """Return True if exactly this labelling (m,) is in the pool."""
        return labels.tobytes() in self._rows

    def join(self, labellings: Sequence[Bits]) -> Bits:
        """Add labellings to the pool with their stored bounds, and return the new ones (k, m).

        labellings: (m,) each, distinct; those in the pool already are skipped. Raises KeyError for one without bounds
        from `learn`.
        """
        new = [labels for labels in labellings if not self.in_pool(labels)]
        added = np.array(new, dtype=bool).reshape(len(new), len(self._space.fixed))
        known = np.array([self._known[labels.tobytes()] for labels in new]).reshape(-1, 3)
        for labels in new:
            self._rows[labels.tobytes()] = len(self._rows)
        self.pool.add(added, known[:, 0], known[:, 1])
        self.counts = np.concatenate([self.counts, known[:, 2]])
        return added

    def best(self) -> dict[int, float]:
        """Return the largest proven governing factor of a layout of each count.

        Counts of evaluated labellings are the keys. −inf: no such layout is proven to stand.
        """
        found: dict[int, float] = {}
        for low, _, count in self._known.values():
            found[count] = max(low, found.get(count, -math.inf))
        for low, count in zip(self.pool.low().tolist(), self.counts.tolist(), strict=True):
            found[int(count)] = max(low, found.get(int(count), -math.inf))
        return found

    def promising(self, target: int | Range | None, over: float, number: int, alike: float) -> list[Bits]:
        """Choose evaluated labellings of a target to refine, greatest lower bounds first."""
        # Only those with a lower bound above 0 are taken.
        rows = [(-low, key, count) for key, (low, high, count) in self._known.items() if low > 0.0 and high > over]
        rows.sort()
        inside = holds(target, np.array([count for *_, count in rows]))
        chosen: list[Bits] = []
        last = -math.inf
        for (weaker, key, _), within in zip(rows, inside.tolist(), strict=True):
            if within and weaker - last > alike * abs(weaker):
                chosen.append(np.frombuffer(key, dtype=bool))
                last = weaker
        return chosen[:number]

    def strongest(self, number: int) -> tuple[Bits, Floats]:
        """Return at most `number` labellings (k, m) of greatest lower bounds, with these (k,).

        Only finite bounds count, those of the pool included; the greatest is first. The check of a proof compares its
        claims with them.
        """
        lows = {key: low for key, (low, *_) in self._known.items()}
        for key, low in zip(self._rows, self.pool.low().tolist(), strict=True):
            lows[key] = max(low, lows.get(key, -math.inf))
        stands = sorted((-low, key) for key, low in lows.items() if math.isfinite(low))[:number]
        rows = np.frombuffer(b"".join(key for _, key in stands), dtype=bool)
        return rows.reshape(len(stands), len(self._space.fixed)), np.array([-low for low, _ in stands])


_KEPT: Final = 4  # number of meshes whose programs a process keeps

# Single faces tried in vain on each mesh before a conflict is accepted. With three on the finest mesh alone the 4 × 6
# wall of 20 kPa takes over 168 s of processor time instead of 131 s.
_TRIES: Final = 1

_SHORT: Final = 5  # number of faces of a conflict up to which finer meshes are not tried to shorten it


class _Kept(threading.local):
    """Relaxations that a thread keeps, by proof and level; the one used last is at the end."""

    def __init__(self) -> None:
        self.relaxations: OrderedDict[tuple[str, int], FieldRelaxation] = OrderedDict()


_kept = _Kept()


@dataclass(frozen=True)
class ProofSetup:
    """Data that all tasks of a proof share."""

    name: str  # name of the proof, unlike that of any other; each process keeps relaxations by it
    settings: tuple[FieldSetting, ...]  # setting of each load case
    required: tuple[float, ...]  # required factor of each load case
    free: Bools  # (m,) faces that may take either label
    # meshes that all labellings share, from coarse to fine: each level has one mesh for each load case
    levels: tuple[tuple[Mesh, ...], ...]

    def problems(self, level: int) -> list[FieldProblem]:
        """Return one problem for each load case, on the meshes of `levels[level]`."""
        triples = zip(self.settings, self.levels[level], self.required, strict=True)
        return [FieldProblem(*one) for one in triples]


@dataclass(frozen=True)
class LevelConflict:
    """Result of refuting one labelling on the meshes that all labellings share."""

    first: int  # level (position in `ProofSetup.levels`) that refutes the labelling first, −1 for none
    level: int  # level whose meshes the mechanism of the conflict belongs to, −1 for none
    # the conflict; `Mechanism.case` is the load case. None where no level refutes the labelling.
    conflict: Conflict | None
    solves: int  # programs solved


@one_thread()
def level_conflict(setup: ProofSetup, labels: Bits, threshold: float, levels: tuple[int, ...]) -> LevelConflict:
    """Refute a factor for a labelling, and minimise the labelling to a conflict.

    labels: (m,) True = dry. Result: the last conflict that has fewer faces than the one before.
    """
    # The first level that refutes it gives a conflict; finer levels then try to shorten it.
    solves, last = 0, len(setup.levels) - 1
    first, level, found = -1, -1, None
    for place in range(last + 1):
        if (found is None and place not in levels) or (found is not None and len(found.faces) <= _SHORT):
            continue
        relaxation = _relaxation(setup, place)
        before = relaxation.solves
        decided = None if found is None else np.isin(np.arange(len(labels)), found.faces)
        one = conflict_of(relaxation, labels, setup.free, threshold, _TRIES, decided)
        solves += relaxation.solves - before
        if one is not None and (found is None or len(one.faces) < len(found.faces)):
            first, level, found = (place if found is None else first), place, one
    return LevelConflict(first, level, found, solves)


def _relaxation(setup: ProofSetup, level: int) -> FieldRelaxation:
    """Return the relaxation on the meshes of a level, which this thread keeps for a while."""
    # The order of its problems is reset, so that results do not depend on earlier tasks.
    name, known = (setup.name, level), _kept.relaxations
    if name not in known:
        known[name] = FieldRelaxation(setup.problems(level))
        while len(known) > _KEPT:
            known.popitem(last=False)
    known.move_to_end(name)
    known[name].restart()
    return known[name]


@one_thread()
def refuting_step(
    setting: FieldSetting, labels: Bits, mesh: Mesh, required: float, enough: float, free: Bools, over: float
) -> FieldStep:
    """Bound a labelling on one mesh, and minimise it if its velocity field refutes a factor.

    labels: (m,) True = dry. free: (m,) faces that may take either label. Result: as of `refined_step`, with a conflict
    in `more`: that of a refuted labelling, else the bound of the labelling alone, or None.
    """
    start = time.perf_counter()
    fields = Fields.on(setting, mesh, labels, enough * required)
    conflict = None
    if fields.bounds[1] < over * required:
        relaxation = FieldRelaxation([FieldProblem(setting, mesh, required)])
        conflict = conflict_of(relaxation, labels, free, over, tries=0)
    return step_of(fields, start, _whole_conflict(fields, required, free) if conflict is None else conflict)


def _whole_conflict(fields: Fields, required: float, free: Bools) -> Conflict | None:
    """Return the bound of a velocity field on its labelling, as a conflict of all free faces.

    None without a field or a finite bound.
    """
    if fields.velocity is None:
        return None
    found = weighed(fields.upper, fields.velocity.velocity)
    bound = np.inf if found is None else found.bound_of(fields.labels, np.zeros_like(free)) / required
    if not np.isfinite(bound):
        return None
    faces = np.flatnonzero(free)
    return Conflict(faces, fields.labels[faces], raised(bound), mechanism=Mechanism(0, fields.velocity.velocity))


_FADING: Final = 0.1  # weight of the last labelling in the share of labellings that a mesh refutes

_RARELY: Final = 0.1  # share of labellings refuted by a mesh below which it is left out

_AGAIN: Final = 8  # A mesh that is left out is still tried once in this number of batches


class FieldRefuter:
    """Refuter of the labellings of one search space by velocity fields on common meshes.

    `refute` solves for a velocity field on the coarsest mesh of each load case and on those added by `refute_on`. It
    returns a conflict for each refuted labelling. `weigh` recomputes the bound that the mechanism of a conflict proves,
    without a solver. A **problem** is one mesh of one load case.

    space: the search space, of a planar assembly. blocks: possible blocks; None where they are not listed: all
    candidates are then free. free: (m,) faces that may take either label in some labelling. relaxation: evaluates
    mechanisms on all problems. programs: number of programs solved for conflicts.
    """

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks | None) -> None:
        self._space, self._blocks = space, blocks
        self.free = space.candidates.copy()
        if blocks is not None:
            joined = {face for inside in blocks.inside for face in inside}
            self.free &= np.isin(np.arange(len(self.free)), list(joined))
        # candidates outside every possible block are dry
        self._labels = space.fixed | (space.candidates & ~self.free)
        assembly = space.assembly
        settings = tuple(FieldSetting.of(case) for case in assembly.by_case)
        coarsest = (tuple(setting.coarse for setting in settings),)
        required = tuple(assembly.required.tolist())
        self._setup = ProofSetup(uuid.uuid4().hex, settings, required, self.free, coarsest)
        self.programs = self._batches = 0
        self.restart()

    def restart(self) -> None:
        """Forget all problems but those on the coarsest mesh of each load case."""
        # the problems of each level follow each other; the finer levels are added as the proof begins
        self._setup = replace(self._setup, name=uuid.uuid4().hex, levels=self._setup.levels[:1])
        self.relaxation, self._first = FieldRelaxation(self._setup.problems(0)), [0]
        self._share = [1.0]

    @property
    def cases(self) -> int:
        """Number of load cases."""
        return len(self._setup.settings)

    def load_case(self, problem: FieldProblem) -> int:
        """Return the index of the load case of a problem.

        The setting of the problem must be one of this object; else StopIteration is raised.
        """
        return next(case for case, setting in enumerate(self._setup.settings) if setting is problem.setting)

    def add_problem(self, case: int, mesh: Mesh) -> int:
        """Add a mesh (scene units) of load case number `case`, to weigh mechanisms on it.

        Returns the position of the problem, for `Mechanism.case`. No labelling is refuted on it.
        """
        return self.relaxation.add(FieldProblem(self._setup.settings[case], mesh, self._setup.required[case]))

    def weigh(self, conflict: Conflict) -> float:
        """Compute the bound that the mechanism of a conflict proves, without a solver.

        Result: the governing factor that no labelling with the labels of the conflict exceeds; inf without a mechanism,
        or where it proves none.
        """
        if conflict.mechanism is None:
            return math.inf
        labels, undecided = self._labels.copy(), self.free.copy()
        labels[conflict.faces], undecided[conflict.faces] = conflict.labels, False
        one = conflict.mechanism
        return float(
            self.relaxation.evaluate_mechanisms(one.case, one.velocity[None], labels[None], undecided[None])[0]
        )

    def common(self, case: int) -> CommonMeshes:
        """Make new meshes of load case number `case`, to bound all labellings on."""
        return CommonMeshes(self._setup.settings[case], self._setup.required[case], self._labels, self.free)

    def refute_on(self, meshes: Sequence[CommonMeshes]) -> None:
        """Refute labellings on some finer meshes too from now on, beside the coarsest."""
        places = dict.fromkeys(zip(*(one.shared for one in meshes), strict=True))
        levels = tuple(tuple(one.meshes[k] for one, k in zip(meshes, row, strict=True)) for row in places)
        self._setup = replace(self._setup, levels=levels)
        self._share = [1.0] * len(levels)
        for level in range(1, len(levels)):
            self._first.append(len(self.relaxation.problems))
            for problem in self._setup.problems(level):
                self.relaxation.add(problem)

    def refute(self, labellings: Sequence[Bits], threshold: float, tasks: Pool) -> list[Conflict | None]:
        """Prove that labellings carry less than a factor, and minimise each refuted one to a conflict.

        threshold: governing factor. Result: one conflict for each labelling, None where no mesh refutes it.
        """
        levels = self._levels()
        found = list(tasks.run(level_conflict, [(self._setup, labels, threshold, levels) for labels in labellings]))
        self.programs += sum(one.solves for one in found)
        conflicts: list[Conflict | None] = []
        for one in found:
            # The level that refuted the labelling, and coarser ones that did not, shift the shares by which `_levels`
            # picks.
            for level in levels[: levels.index(one.first) + 1 if one.first >= 0 else None]:
                self._share[level] += _FADING * ((level == one.first) - self._share[level])
            conflict = one.conflict
            # `case` counts from the first problem of the level; in a proof it is the position among all problems
            if conflict is not None and conflict.mechanism is not None:
                number = conflict.mechanism.case + self._first[one.level]
                conflict = replace(conflict, mechanism=replace(conflict.mechanism, case=number))
            conflicts.append(conflict)
        return conflicts

    def _levels(self) -> tuple[int, ...]:
        """Return the levels of meshes to try first; levels that rarely refute are tried at intervals only."""
        self._batches += 1
        again = not self._batches % _AGAIN
        return tuple(level for level, share in enumerate(self._share) if share >= _RARELY or again)

    def context(self) -> FieldProofContext:
        """Return the data that the check of a proof needs, and forget stored results of weighing.

        All mechanisms are therefore weighed again by the check.
        """
        self.relaxation.forget()
        return FieldProofContext(self.relaxation, self._space, self._blocks, self.free)


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
        """Store bounds on the governing factor of evaluated labellings (k, m), True = dry."""
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
        """Take one step of the proof: begin, refine, draw labellings, or lower the bound."""
        # The caller repeats it, and evaluates `waiting` labellings, until `settled` or `stopped`.
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
