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
from jld_core.fields.bounds import Fields, FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import weighed
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.context import free_faces
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism
from jld_explore.drivers.field_aims import ProofAim, holds
from jld_explore.drivers.field_relaxation import CommonMeshes, FieldProblem, FieldProofContext, FieldRelaxation, raised
from jld_explore.evaluation import Pool
from jld_explore.evaluation.field_pool import FieldPool, FieldStep, step_of
from jld_explore.space import SearchSpace, values_of
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
        self.free = free_faces(space, blocks)
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
        """Prove that labellings carry less than a governing factor: a conflict each, None if unproven."""
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
