"""Prove the strongest layout of blocks that crack anywhere, to a gap, without enumeration."""

from __future__ import annotations

import io
import math
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError
from jld_core.fields.mesh import Mesh
from jld_core.files import whole_file
from jld_core.limit.options import Status
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim
from jld_explore.drivers.exact.context import TargetSchedule, listed_blocks, without_formula
from jld_explore.drivers.exact.driver import ProvingDriver
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_check import check_proof
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism, ProofState
from jld_explore.drivers.field_proof import (
    CommonMeshes,
    FieldIncumbents,
    FieldRefuter,
    aim_of,
    has_conflict,
    holds,
    refuting_step,
)
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Records
from jld_explore.evaluation.field_evaluator import TOGETHER, FieldPool
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space.labelling import canonical
from jld_explore.space.limits import Range
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


CONFLICTS_FILE: Final = "conflicts.npz"  # name of the file of conflicts in the folder of a study
_MESH: Final = [one.name for one in fields(Mesh)]  # arrays of a mesh


def save_conflicts(folder: Path, driver: FieldExact) -> None:
    """Write the conflicts of a proof with their velocity fields and meshes to one file."""
    # The file `CONFLICTS_FILE` is replaced as a whole. Conflicts without a velocity field in memory are left out.
    # Without any conflict nothing is written.
    conflicts = [conflict for conflict in driver.state.conflicts if conflict.mechanism is not None]
    if not conflicts:
        return
    problems, shared = driver.refuter.relaxation.problems, driver.refuter.cases
    mechanisms = [conflict.mechanism for conflict in conflicts if conflict.mechanism is not None]
    extra_cases = sorted({mechanism.case for mechanism in mechanisms if mechanism.case >= shared})
    number_of = {case: shared + index for index, case in enumerate(extra_cases)}
    content: dict[str, Any] = {
        "shared": np.array(shared),
        "case": np.array([number_of.get(mechanism.case, mechanism.case) for mechanism in mechanisms], dtype=np.int64),
        "load": np.array([driver.refuter.load_case(problems[case]) for case in extra_cases], dtype=np.int64),
        **_join_all("faces", [conflict.faces for conflict in conflicts]),
        **_join_all("labels", [conflict.labels for conflict in conflicts]),
        **_join_all("velocity", [mechanism.velocity.ravel() for mechanism in mechanisms]),
    }
    for name in _MESH:
        arrays = [getattr(problems[case].mesh, name) for case in extra_cases]
        content |= _join_all(f"mesh_{name}", [array.ravel() for array in arrays])
    with whole_file(folder / CONFLICTS_FILE) as fresh, fresh.open("wb") as file:
        np.savez(file, **content)


def load_conflicts(folder: Path, driver: FieldExact) -> list[Conflict]:
    """Read stored conflicts and weigh them again; those without a finite bound are left out."""
    # The meshes of the file are added to the proof. The caller adds the conflicts.
    path = folder / CONFLICTS_FILE
    if not path.exists():
        return []
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        conflicts = _conflicts_in(content, driver)
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"it is damaged ({text})", "a file as jld explore left it, or none") from None
    return conflicts


def _conflicts_in(content: dict[str, Any], driver: FieldExact) -> list[Conflict]:
    """Add the meshes of a file to `proof`; return its conflicts of finite bounds, weighed again."""
    if int(content["shared"]) != driver.refuter.cases:
        return []
    cases = content["case"].tolist()
    parts = {name: _split(content, f"mesh_{name}") for name in _MESH}
    for index, load in enumerate(content["load"].tolist()):
        shapes = {"points": (-1, 2), "simplices": (-1, 3), "tagged": (-1, 2)}
        arrays: dict[str, Any] = {name: parts[name][index].reshape(shapes.get(name, (-1,))) for name in _MESH}
        driver.refuter.add_problem(load, Mesh(**arrays))
    triples = zip(_split(content, "faces"), _split(content, "labels"), _split(content, "velocity"), cases, strict=True)
    conflicts = []
    for faces, labels, velocity, case in triples:
        mechanism = Mechanism(case, velocity.reshape(-1, 3, 2))
        conflict = Conflict(faces.astype(np.int64), labels.astype(bool), np.inf, mechanism=mechanism)
        bound = driver.refuter.weigh(conflict)
        if np.isfinite(bound):
            conflicts.append(replace(conflict, bound=bound))
    return conflicts


def _join_all(name: str, arrays: list[Any]) -> dict[str, Any]:
    """Return arrays (j,) of different lengths as one array `name`, with lengths `name_sizes`."""
    sizes = np.array([len(array) for array in arrays], dtype=np.int64)
    return {name: np.concatenate(arrays) if arrays else np.empty(0), f"{name}_sizes": sizes}


def _split(content: dict[str, Any], name: str) -> list[Floats]:
    """Return the arrays that `_join_arrays` joined under a name."""
    return np.split(content[name], np.cumsum(content[f"{name}_sizes"])[:-1]) if len(content[f"{name}_sizes"]) else []


_ANNEALED: Final = 0.25  # largest share of a time limit for the labellings evaluated before the proof
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


class FieldExact(ProvingDriver):
    """Driver that proves, to a gap, the largest λ of a planar space whose blocks crack anywhere."""

    def __init__(
        self, space: SearchSpace, seed: int = 0, aim: Aim = "best", *, gap: float = 0.05, search: int = 30
    ) -> None:
        # A labelling that a velocity field proves too weak is minimised to a conflict, as by rigid blocks; a formula
        # gives labellings that no conflict rules out. What the coarsest mesh does not refute is evaluated and refined
        # until its own fields refute it or make it the strongest. A bracket as narrow as the gap is always refuted
        # above best / (1 − gap).
        super().__init__(space, seed)
        self._aim, self._aim_name = aim_of(space, aim, gap), aim
        if space.void is not None:
            raise ParameterError("driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
        self._blocks = listed_blocks(space)
        if (count := without_formula(space, self._blocks, self._aim.count)) is not None:
            raise ParameterError("driver", f"exact by fields has no formula for the count {count.name}", "enumeration")
        self._search = Anneal(space, seed) if self._aim.count is None else Genetic(space, seed, aim=aim)
        # labellings that the search before the proof still gives, and its end
        self._search_left = search * int(space.candidates.sum())
        self._search_deadline = Deadline()
        self._folder: Path | None = None
        self._search_asked = False
        self.refuter = FieldRefuter(space, self._blocks)
        self.incumbents = FieldIncumbents(space, self._aim)
        self._batch_seconds = 0.0
        self._restart()

    @classmethod
    def to_gap(cls, gap: float, space: SearchSpace, seed: int, values: Mapping[str, Any]) -> FieldExact:
        """Make a driver that proves to a gap; InputError for a wrong option."""
        options = {key: value for key, value in values.items() if value is not None}
        for key in options:
            if key not in cls.Options.model_fields:
                raise ParameterError(key, "the driver exact has no such option", "an option that it has")
        driver = cls.made(space, seed, options)
        driver._aim.gap = gap
        return driver

    def _restart(self) -> None:
        """Forget all conflicts and bounds on targets; keep evaluations and the pool."""
        self._aim.restart()
        self._state = ProofState(self.space)
        self.refuter.restart()
        self._formula: Formula | None = None
        self._rng = np.random.default_rng([self.seed, 3])  # other drivers have streams 1 and 2
        self._schedule = TargetSchedule(_PATIENCE)
        # λ above which labellings are refuted now; upper bounds on λ of the target, and of all labellings
        self._threshold = self._upper = self._bound = math.inf
        self._target: int | Range | None = None
        self._known_conflicts = 0  # conflicts when the aim was set
        self._waiting: list[Bits] = []  # drawn, to be handed over
        # the first aim is set; time left a target open; ended with a proof of all targets; ended without
        self._has_begun = self._left_open = self._settled = self._stopped = False
        self._refuted_at = np.full(len(self.pool), np.inf)  # least bound of a conflict of each labelling of the pool
        self.pool.given_up[:] = False
        self._proof_check = None

    # --- what is known ----------------------------------------------------------------------------------

    @property
    def pool(self) -> FieldPool:
        return self.incumbents.pool

    @property
    def best(self) -> float:
        """Largest proven lower bound on the governing factor; −inf without a layout."""
        return max(self.incumbents.best().values(), default=-math.inf)

    def bounds_above(self, labellings: Bits) -> Floats:
        """Return proven upper bounds (k,) on the governing factor of labellings (k, m)."""
        return np.full(len(labellings), np.inf) if self.complaints else self._conflict_bounds(labellings)

    def _conflict_bounds(self, labellings: Bits) -> Floats:
        """Return upper bounds (k,) on the governing factor of labellings (k, m) by the conflicts."""
        bounds = np.full(len(labellings), self._bound)
        for conflict in self._state.conflicts:
            matching = has_conflict(conflict, labellings, self.space.group)
            bounds[matching] = np.minimum(bounds[matching], conflict.bound)
        return bounds

    @property
    def bound(self) -> float | None:
        """Proven upper bound on all governing factors; None after a failed check or two contradictions."""
        failed = self._proof_check is not None and not self._proof_check.passed
        return None if failed or self._given_up or not math.isfinite(self._bound) else self._bound

    @property
    def open_layouts(self) -> int:
        """Number of layouts of better count that may carry the required factor."""
        return int(self._aim.facts({}, False).get("open_layouts", 0))

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self._aim_name} if self._aim_name == "front" else {}

    @property
    def working(self) -> bool:
        return not self._settled and not self._given_up

    @property
    def relaxations(self) -> int:
        return self.refuter.programs + self.pool.programs

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        return super().facts(results, complete) | self._aim.facts(self.incumbents.best(), not self.complaints)

    def set_workers(self, jobs: int) -> None:
        self.pool.tasks.jobs = jobs

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        super().start(deadline, heartbeat, records)
        self.pool.deadline = self._deadline
        self._search_deadline = self._deadline.within(_ANNEALED * self._deadline.remaining())
        if records is not None:
            self._folder = records.folder
            self._add_conflicts(load_conflicts(self._folder, self))

    def close(self) -> None:
        self.pool.tasks.close()
        if self._folder is not None and self._folder.is_dir():
            save_conflicts(self._folder, self)

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        # The first labellings come from a search. Later calls continue the proof until it needs evaluations.
        if not self._search_asked:
            self._search_asked = True
            self._bound_at_root()
            if self._reached:
                self._search_left = 1  # nothing is left to prove, but a study has one result
        elif self._reached:
            self._search_left = 0
        if self._search_left > 0 and not self._search_deadline.passed():
            labellings = self._search.ask(self._search_left if limit is None else min(limit, self._search_left))
            if len(labellings):
                self._search_left -= len(labellings)
                return labellings
        self._search_left = 0  # the search is over: the time is up, or it has no more labellings
        while not self._waiting and self.working and not self._stopped and not self._time_is_up:
            self._work()
            self._heartbeat()
        count = len(self._waiting) if limit is None else limit
        first, self._waiting = self._waiting[:count], self._waiting[count:]
        return np.array(first, dtype=bool).reshape(len(first), len(self.space.fixed))

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        self._search.tell(labellings, evaluations)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        low = [evaluation.low if evaluation.status is Status.COLLAPSE else -math.inf for evaluation in evaluations]
        high = [evaluation.high if math.isfinite(evaluation.high) else math.inf for evaluation in evaluations]
        self.incumbents.learn(labellings, low, high)
        if self._has_begun:
            self._join(list(labellings))

    def _join(self, labellings: Sequence[Bits]) -> None:
        self._refuted_at = np.concatenate([self._refuted_at, self._conflict_bounds(self.incumbents.join(labellings))])

    # --- the proof --------------------------------------------------------------------------------------

    @property
    def _goal(self) -> float:
        """Governing factor above which labellings of the target must be refuted."""
        return self._aim.goal(self.incumbents.best())

    def _work(self) -> None:
        """Take one step of the proof: begin, refine, draw labellings, or lower the bound."""
        # The caller repeats it, and evaluates `_waiting` labellings, until `_settled` or `_stopped`.
        if not self._has_begun:
            self._begin()
            return
        best = self.incumbents.best()
        goal_rose = self._aim.goal(best) > self._threshold
        if goal_rose or self._threshold >= self._upper or self._aim.target(best) != self._target:
            self._aim_formula()
        elif (rows := self._open_rows()).size:  # evaluated labellings that nothing refutes yet
            self._refine(rows)
        elif (rows := self._wide_rows()).size:  # strong ones whose lower bounds may still rise
            self._refine_lower(rows)
        elif not self._draw():  # the formula has no labelling left
            self._lower_bound()
        elif self._schedule.is_stuck(len(self._state.conflicts) - self._known_conflicts, self._upper, self._threshold):
            self._aim_formula()

    def _begin(self) -> None:
        """Bound all labellings on finer meshes, and aim at the first target."""
        self._has_begun = True
        self._bound_finer()
        self._upper = self._bound
        self._join_promising()
        self._aim_formula()

    def _join_promising(self) -> None:
        """Put the best evaluated labellings of the target into the pool."""
        best = self.incumbents.best()
        target, goal = self._aim.target(best), self._aim.enough(best)
        number = _FIRST if target is None or isinstance(target, Range) else _FIRST_OF_COUNT
        self._join(self.incumbents.promising(target, goal, number, _ALIKE))

    def _bound_at_root(self) -> None:
        """Lower `_bound` by one program for each load case, on the coarsest meshes."""
        for case in range(self.refuter.cases):
            self._bound_by(self.refuter.common(case), case)

    def _bound_by(self, meshes: CommonMeshes, case: int) -> None:
        """Bound all labellings on the next mesh of a load case; store a lower bound."""
        start, no_faces = time.perf_counter(), np.empty(0, dtype=np.int64)
        result = meshes.step()
        if result is not None and result.bound < self._bound:
            mechanism = Mechanism(self.refuter.add_problem(case, result.mesh), result.found.velocity)
            self._add_conflicts([Conflict(no_faces, no_faces.astype(bool), result.bound, mechanism=mechanism)])
            self._bound = result.bound
        self._batch_seconds = time.perf_counter() - start

    def _bound_finer(self) -> None:
        """Bound all labellings on finer meshes in the time there is; from then on refute labellings on some too."""
        cases = [self.refuter.common(case) for case in range(self.refuter.cases)]
        while not self._reached and self._deadline.remaining() > _ROOT_CAUTION * self._batch_seconds:
            unfinished = [case for case, meshes in enumerate(cases) if not meshes.ended]
            if not unfinished:
                break
            for case in unfinished:
                self._bound_by(cases[case], case)
        self.refuter.refute_on(cases)

    @property
    def _reached(self) -> bool:
        """True if `_bound` meets the goal of the target, or proves that no layout stands."""
        return self._bound <= max(self._goal, 0.0)

    def _aim_formula(self) -> None:
        """Aim the formula at the next factor to refute, or end a target that is reached."""
        best = self.incumbents.best()
        goal = self._aim.goal(best)
        if self._upper <= max(goal, 0.0):
            self._end_target()
            return
        following = self._schedule.next_target(self._upper, goal) if self._aim.in_steps else goal
        self._threshold, self._target = max(goal, following), self._aim.target(best)
        self._known_conflicts = len(self._state.conflicts)
        self._formula = self._formula or self._make_formula()
        self._formula.aim(self._threshold, self._target)
        for labels in [*self._waiting, *self.pool.labellings]:
            self._formula.set_aside(np.arange(len(labels)), labels)

    def _make_formula(self) -> Formula:
        """Return the formula of the labellings that no conflict rules out."""
        formula = Formula(self.space, self._blocks)
        formula.learn(self._state.conflicts)
        return formula

    def _in_target(self) -> Bools:
        """Return (k,) True for the labellings of the pool that belong to the target."""
        return holds(self._target, self.incumbents.counts)

    def _open_rows(self) -> Ints:
        """Return rows of the pool to refine, not refuted: best lower and upper bounds in turns."""
        low, high = self.pool.low(), self.pool.high()
        rows = np.flatnonzero((self._refuted_at > self._threshold) & ~self.pool.given_up & self._in_target())
        by_high, by_low = rows[np.lexsort((-low[rows], -high[rows]))], rows[np.argsort(-low[rows], kind="stable")]
        turns = [int(row) for pair in zip(by_low, by_high, strict=True) for row in pair]
        return np.array(list(dict.fromkeys(turns)), dtype=np.int64)[:TOGETHER]

    def _wide_rows(self) -> Ints:
        """Return rows of the pool whose refinement may raise the best lower bound of a long proof."""
        low, high = self.pool.low(), self.pool.high()
        best = self._aim.enough(self.incumbents.best())
        if len(self._state.conflicts) < _LONG or not best > 0.0 or not self._aim.in_steps:
            return np.empty(0, dtype=np.int64)
        allowed = _SHARPENING * self._deadline.remaining()
        wide = high > best / (1.0 - _SHARP * self._aim.gap)
        rows = np.flatnonzero(wide & ~self.pool.given_up & self._in_target())
        rows = rows[[self.pool.expected_seconds(row) < allowed for row in rows.tolist()]] if rows.size else rows
        return rows[np.argsort(-low[rows], kind="stable")][:_SHARPENED]

    def _refine_lower(self, rows: Ints) -> None:
        self.pool.refine(rows.tolist(), self._enough())

    def _enough(self) -> Floats:
        """Return for each labelling of the pool the factor (k,) that a useful lower bound exceeds."""
        return np.full(len(self.pool), self._aim.enough(self.incumbents.best()))

    def _refine(self, rows: Ints) -> None:
        """Refine `rows` of the pool by one mesh; add the conflicts that their fields prove."""
        steps = self.pool.refine(rows.tolist(), self._enough(), refuting_step, (self.refuter.free, self._threshold))
        for _, case, mesh, step in steps:
            conflict: Conflict | None = step.more
            if conflict is None or conflict.mechanism is None:
                continue
            mechanism = replace(conflict.mechanism, case=self.refuter.add_problem(case, mesh))
            self._add_conflicts([replace(conflict, mechanism=mechanism), *self._conflicts_of_others(mechanism)])

    def _conflicts_of_others(self, mechanism: Mechanism) -> list[Conflict]:
        """Return conflicts by a mechanism with other labellings that it refutes as well."""
        rows = np.flatnonzero(self._refuted_at > self._threshold)
        count, faces = len(rows), np.flatnonzero(self.refuter.free)
        if not count:
            return []
        labels = self.pool.labellings[rows]
        velocities = np.broadcast_to(mechanism.velocity, (count, *mechanism.velocity.shape))
        bounds = self.refuter.relaxation.evaluate_mechanisms(
            mechanism.case, velocities, labels, np.zeros_like(labels)
        ).tolist()
        pairs = zip(labels, bounds, strict=True)
        return [
            Conflict(faces, other[faces], bound, mechanism=mechanism)
            for other, bound in pairs
            if bound <= self._threshold
        ]

    def _draw(self) -> bool:
        """Draw and refute a batch, or set `stopped` without time for it; False if none is left."""
        formula = self._formula
        if formula is None:
            raise RuntimeError("the proof has no formula before its first aim")
        drawn: list[Bits] = []
        while len(drawn) < TOGETHER:
            preferred = self._rng.random(len(self.refuter.free)) < _DRY
            labels = formula.next(preferred=preferred)
            if labels is None:
                break
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        if _CAUTION * self._batch_seconds > self._deadline.remaining():
            self._stopped = True
            return True
        start = time.perf_counter()
        conflicts = self.refuter.refute(drawn, self._threshold, self.pool.tasks)
        self._batch_seconds = max(self._batch_seconds, time.perf_counter() - start)
        for labels, conflict in zip(drawn, conflicts, strict=True):
            if conflict is None:
                self._hand_over(np.asarray(canonical(labels[None], self.space.group))[0])
            else:
                self._add_conflicts([conflict])
        return bool(drawn)

    def _hand_over(self, labels: Bits) -> None:
        """Add a canonical labelling (m,) to the pool; one without evaluation waits for it first."""
        if self.incumbents.is_known(labels):
            self._join([labels])
        else:
            self._waiting.append(labels)

    def _add_conflicts(self, conflicts: Sequence[Conflict]) -> None:
        self._state.add_conflicts(conflicts)
        if self._formula is not None:
            self._formula.learn(conflicts)
        for conflict in conflicts:
            matching = has_conflict(conflict, self.pool.labellings, self.space.group)
            self._refuted_at[matching] = np.minimum(self._refuted_at[matching], conflict.bound)

    def _lower_bound(self) -> None:
        """Lower the bound to the factor aimed at, or to that of the worst unrefuted labelling."""
        largest = float(self._refuted_at[self._in_target()].max(initial=-math.inf))
        self._upper = min(self._upper, max(self._threshold, largest))
        if self._target is None:
            self._bound = min(self._bound, self._upper)
        self._schedule.note_proven(len(self._state.conflicts) - self._known_conflicts)
        if self._upper <= self._threshold and self._upper > self._goal:
            self._aim_formula()
        else:
            self._end_target()

    def _end_target(self) -> None:
        """Record the bound of a target; begin the next that has a labelling, or end the proof."""
        self._left_open |= self.pool.late and self._upper > self._goal
        open_rows = (self._refuted_at > self._goal) & self._in_target() & (self._upper > self._goal)
        bound = self._aim.next(self._upper, self.incumbents.best(), self.incumbents.counts[open_rows])
        while bound is not None and not self._target_has_labelling():
            bound = self._aim.next(-math.inf, {}, np.empty(0))
        if bound is None:
            self._settle()
            return
        self._upper, self._threshold = bound, math.inf
        self._schedule = TargetSchedule(_PATIENCE)
        self._join_promising()
        self._aim_formula()

    def _target_has_labelling(self) -> bool:
        """Return whether the target has any labelling, however weak."""
        self._formula = self._formula or self._make_formula()
        self._formula.aim(-math.inf, self._aim.target(self.incumbents.best()))
        return self._formula.next() is not None

    def _settle(self) -> None:
        """Check the ended proof, or set `stopped` if time left a target open."""
        self._stopped, self._settled = self._left_open, not self._left_open
        if self._stopped:
            return
        claims = self._aim.claims()
        finite = all(math.isfinite(claim.threshold) for claim in claims)
        problem = "" if finite else "a layout has no upper bound"
        strongest = self.incumbents.strongest(_COMPARED)
        self._proof_check = check_proof(
            self.refuter.context(), self._state, claims, strongest, problem, self._deadline.elapsed()
        )
