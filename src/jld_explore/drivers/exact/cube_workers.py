"""Cube-and-conquer proof: split the search space into cubes and refute them in workers.

Each worker receives a cube for a short time and returns conflicts, which hold for the whole space and go to all others,
and labellings that no mechanism refutes. A cube without any labelling left is **closed**, by a satisfiability solver. A
cube that lasts is split by the most promising face once there are too few for all workers.
"""

from __future__ import annotations

import time
from collections import Counter, OrderedDict, deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Condition
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictBatch, ConflictGenerator
from jld_explore.drivers.exact.context import SEED_STEP, ProofContext
from jld_explore.drivers.exact.formula import EVERYTHING, Cube, Formula, split_cube
from jld_explore.drivers.exact.proof_state import Conflict, Evidence, LeastBounds, ProofState
from jld_explore.evaluation import Pool
from jld_explore.evaluation.pool import LOST, WorkerPool, client_of_cluster, done_in
from jld_explore.space.limits import Range

# Number of proofs whose state a worker keeps. A worker of a cluster may serve several proofs, one after the other.
_MOST_PROOFS: Final = 4


@dataclass(frozen=True)
class Task:
    """Task of a worker: refute labellings of a cube for a limited time."""

    worker: str  # name of the worker
    number: int  # number of tasks that the worker received before
    context: bytes | None  # packed `ProofContext`, with the first task only
    new_conflicts: tuple[Conflict, ...]  # conflicts since the last task
    handed_over: Bits  # (k, m) labellings since the last task that no conflict refutes and that are given to evaluation
    target: int  # number of the target; each has its own aim of the formula
    count: int | Range | None  # count as in `Formula.aim`
    threshold: float  # scaled λ to refute, never lower within a step
    cube: Cube  # labels that all drawn labellings have
    seconds: float  # time for the task, s


@dataclass
class TaskResult:
    conflicts: list[Conflict] = field(default_factory=list)  # conflicts found
    unrefuted: list[Bits] = field(default_factory=list)  # labellings that no mechanism refutes
    closed: bool = False  # whether no labelling of the cube is left
    solves: int = 0  # number of relaxations solved
    seconds: float = 0.0  # processor time of the worker, s
    forgotten: bool = False  # whether the worker lacks the state of earlier tasks and did nothing


class _WorkerProof:
    """State that a worker keeps of one proof between tasks."""

    def __init__(self, context: ProofContext) -> None:
        self._context = context
        self._generator = ConflictGenerator(context)
        self._formula: Formula | None = None
        self._bounds = LeastBounds()
        self._target = -1
        self.number = 0

    def work(self, task: Task) -> TaskResult:
        self.number += 1
        began = time.process_time()
        solved = self._context.relaxation.solves
        end = time.perf_counter() + task.seconds
        self._learn(task)
        result = TaskResult()
        while not result.closed:
            batch = self._generator.step(task.threshold, task.cube)
            result.conflicts += [conflict for conflict in batch.conflicts if self._bounds.lowered(conflict)]
            result.unrefuted += batch.unrefuted
            result.closed = batch.exhausted
            if time.perf_counter() >= end:
                break
        result.solves = self._context.relaxation.solves - solved
        result.seconds = time.process_time() - began
        return result

    def _learn(self, task: Task) -> None:
        """Add new conflicts and labellings to the formula, and aim it at the target of the task."""
        if self._formula is None:
            self._formula = Formula(self._context.space, self._context.blocks)
        self._formula.learn(
            [conflict for conflict in task.new_conflicts if self._bounds.lowered(conflict)], task.handed_over
        )
        if task.target != self._target:
            self._target = task.target
            self._formula.aim(task.threshold, task.count)
            self._generator.begin(self._formula)


_proofs: OrderedDict[str, _WorkerProof] = OrderedDict()


@one_thread()
def run_task(task: Task) -> TaskResult:
    """Carry out a task in this process, with the state kept from earlier tasks of its worker."""
    # A task with a context starts a new state. If the state is absent or has missed a task, do nothing and return a
    # result with `forgotten` True.
    if task.context is not None:
        _proofs[task.worker] = _WorkerProof(ProofContext.unpacked(task.context))
        while len(_proofs) > _MOST_PROOFS:
            _proofs.popitem(last=False)
    proof = _proofs.get(task.worker)
    if proof is None or proof.number != task.number:
        return TaskResult(forgotten=True)
    return proof.work(task)


# Time, s, that a worker spends on a cube per task.
# Sending a task takes 1 % of this time. The conflicts that a worker knows are at most this old.
TASK_SECONDS: Final = 0.3
_TASKS_PER_WORKER: Final = 2  # tasks that a worker holds at a time: one in progress and one to continue with at once
_CUBES_PER_WORKER: Final = 2  # least number of cubes per worker, counting assigned ones, while any cube can be split

# Tasks on one cube after which the cube is split in any case. Parts of the cube may then be closed and saved.
_TASKS_PER_CUBE: Final = 20
_SCORE_DECAY: Final = 0.999  # decay of the face scores per conflict, so that recent conflicts count most
_LARGEST_SCORE: Final = 1e100  # score at which all are scaled down, long before numbers overflow
_WAIT_SECONDS: Final = 0.1  # longest time, s, that this process waits for workers before the next deadline check


@dataclass
class _WorkerState:
    """Counts of what a worker was sent, and of its results."""

    tasks: int = 0  # tasks sent
    # conflicts, handed_over: conflicts and handed-over labellings sent
    conflicts: int = 0
    handed_over: int = 0
    results: int = 0  # results received


@dataclass(frozen=True)
class _AssignedCube:
    """Cube assigned to a worker, with the number of earlier tasks on it and its target (number, count, scaled λ)."""

    worker: Pool
    cube: Cube
    tasks_done: int
    target: int
    count: int | Range | None
    threshold: float


class CubeWorkers:
    """Worker processes that refute cubes: `begin` for a formula, `step` until True, `close`."""

    def __init__(self, context: ProofContext, jobs: int, state: ProofState) -> None:
        self._context, self._contexts_sent = context, 0
        self._state = state
        self._pool = WorkerPool(jobs)
        self._worker_states: dict[str, _WorkerState] = {}
        self._assigned: dict[Future[TaskResult], _AssignedCube] = {}
        self._cubes: deque[tuple[Cube, int]] = deque()
        self._face_scores = np.zeros(len(context.space.fixed))
        self._score_increment = 1.0
        self._has_new_results = False
        self._formula: Formula | None = None
        self._target, self._threshold = 0, 0.0
        self._count: int | Range | None = None
        self.solves, self.closed = 0, 0
        self.task_seconds: list[float] = []

    @property
    def started(self) -> bool:
        """True if any worker has returned a result, so that it has started."""
        return any(worker_state.results > 0 for worker_state in self._worker_states.values())

    @property
    def has_workers(self) -> bool:
        return len(self._pool) > 0

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Continue with another formula, whose whole space becomes the first cube."""
        self._formula, self._count, self._threshold = formula, count, threshold
        self._target += 1
        self._cubes = deque([(EVERYTHING, 0)])

    def end(self) -> None:
        """Drop all waiting cubes; no task is sent until `begin`."""
        self._formula = None
        self._cubes.clear()

    def step(self, threshold: float, *, wait_for_results: bool) -> bool:
        """Add results to the state of the proof; return True once every cube is closed."""
        self._threshold = threshold
        self.exchange()
        if wait_for_results and self._assigned and not self._has_new_results:
            done_in(self._assigned, _WAIT_SECONDS)
            self.exchange()
        self._has_new_results = False
        return not self._cubes and not any(cube.target == self._target for cube in self._assigned.values())

    def exchange(self) -> None:
        """Collect finished tasks and send waiting cubes to free workers, without waiting."""
        # Tasks of workers that have died or left are sent to others.
        for future in [future for future in self._assigned if future.done()]:
            if future in self._assigned:  # an earlier result may have returned all cubes of a lost worker
                self._collect(future, self._assigned.pop(future))
        if self._formula is None:
            return
        for worker in self._pool.fill():
            self._reclaim_cubes(worker)
        for most_held in range(_TASKS_PER_WORKER):
            tasks_held = Counter(cube.worker.name for cube in self._assigned.values())
            for worker in [worker for worker in self._pool if tasks_held[worker.name] <= most_held]:
                self._split_cubes()
                if not self._cubes:
                    return
                self._assign(worker, *self._cubes.popleft())

    def close(self, seconds: float) -> None:
        """Stop all workers; keep results that arrive within so many seconds."""
        self.end()
        done_in(self._assigned, seconds, all_done=True)
        self.exchange()
        self._pool.close()
        self._assigned.clear()

    # --- cubes ------------------------------------------------------------------------------------------

    def _split_cubes(self) -> None:
        if self._formula is None:
            return
        cubes_needed = _CUBES_PER_WORKER * max(len(self._pool), 1) - len(self._assigned)
        while len(self._cubes) < cubes_needed:
            # An untried cube may be closed quickly and is not split, except the whole space, which is never closed
            # quickly.
            index = next(
                (k for k, (cube, tasks_done) in enumerate(self._cubes) if tasks_done or cube == EVERYTHING), None
            )
            if index is None:
                return
            cube, _ = self._cubes[index]
            del self._cubes[index]
            self._cubes.extend((part, 0) for part in split_cube(cube, self._formula, self._face_scores))

    def _assign(self, worker: Pool, cube: Cube, tasks_done: int) -> None:
        """Send a cube to a worker, with the conflicts and labellings that the worker lacks."""
        worker_state = self._worker_states.setdefault(worker.name, _WorkerState())
        content = None
        if worker_state.tasks == 0:
            self._contexts_sent += 1
            content = self._context.packed(self._context.seed + SEED_STEP * self._contexts_sent)
        new_conflicts = self._state.conflicts[worker_state.conflicts :]
        handed_over = self._state.handed_over_since(worker_state.handed_over)
        task = Task(
            worker=worker.name,
            number=worker_state.tasks,
            context=content,
            new_conflicts=tuple(replace(conflict, mechanism=None, by_blocks=()) for conflict in new_conflicts),
            handed_over=np.array(handed_over, dtype=bool).reshape(len(handed_over), len(self._face_scores)),
            target=self._target,
            count=self._count,
            threshold=self._threshold,
            cube=cube,
            seconds=TASK_SECONDS,
        )
        future = self._pool.submit(worker, run_task, task)
        if future is None:
            self._cubes.appendleft((cube, tasks_done))
            self._reclaim_cubes(worker)
            return
        worker_state.tasks, worker_state.conflicts = worker_state.tasks + 1, worker_state.conflicts + len(new_conflicts)
        worker_state.handed_over += len(handed_over)
        self._assigned[future] = _AssignedCube(worker, cube, tasks_done, self._target, self._count, self._threshold)

    def _reclaim_cubes(self, worker: Pool) -> None:
        self._worker_states.pop(worker.name, None)
        for future, assigned in list(self._assigned.items()):
            if assigned.worker is worker:
                del self._assigned[future]
                self._requeue(assigned)

    def _requeue(self, assigned: _AssignedCube) -> None:
        """Put a cube back at the front of the queue, unless its formula is no longer current."""
        if assigned.target == self._target and self._formula is not None:
            self._cubes.appendleft((assigned.cube, assigned.tasks_done))

    def _collect(self, future: Future[TaskResult], assigned: _AssignedCube) -> None:
        """Add the results of a finished task; close, split or requeue its cube."""
        result = self._pool.result(assigned.worker, future)
        if result is LOST:  # a worker that was killed or left costs one task
            self._requeue(assigned)
            self._reclaim_cubes(assigned.worker)
            return
        if result.forgotten:  # a new process replaced the worker, so all data is sent again
            self._requeue(assigned)
            self._worker_states.pop(assigned.worker.name, None)
            return
        if assigned.worker.name in self._worker_states:
            self._worker_states[assigned.worker.name].results += 1
        self.solves += result.solves
        self.task_seconds.append(result.seconds)
        new = self._state.hand_over(result.unrefuted) + self._state.add_conflicts(result.conflicts)
        self._has_new_results |= new > 0 or result.closed
        for conflict in result.conflicts:
            self._score_faces(conflict)
            if self._formula is not None:
                self._formula.forbid(conflict.faces, conflict.labels, conflict.bound)
        if result.closed:
            self._record_closed(assigned, result)
        elif assigned.target == self._target and self._formula is not None:
            tasks_done = assigned.tasks_done + 1
            if tasks_done % _TASKS_PER_CUBE == 0:
                parts = split_cube(assigned.cube, self._formula, self._face_scores)
                self._cubes.extendleft((part, 0) for part in parts)
            else:
                self._cubes.appendleft((assigned.cube, tasks_done))

    def _record_closed(self, assigned: _AssignedCube, result: TaskResult) -> None:
        """Exclude a closed cube from the formula, and state it as a conflict where that is valid."""
        # The conflict is valid without a count, and if neither a handed-over labelling nor an image of one lies in the
        # cube.
        self.closed += 1
        faces, labels = np.array(assigned.cube.faces, dtype=np.int64), np.array(assigned.cube.labels, dtype=bool)
        if assigned.target == self._target and self._formula is not None:
            self._formula.set_aside(faces, labels)
        group = self._context.space.group
        handed_over = self._state.handed_over
        if assigned.count is None and not any(
            assigned.cube.holds(image) for row in handed_over for image in row[group]
        ):
            self._state.add_conflicts([Conflict(faces, labels, assigned.threshold, Evidence.CUBE)])

    def _score_faces(self, conflict: Conflict) -> None:
        """Increase the scores of the faces of a conflict, which decide where cubes are split."""
        self._score_increment /= _SCORE_DECAY
        self._face_scores[conflict.faces] += self._score_increment
        if self._score_increment > _LARGEST_SCORE:
            self._face_scores /= self._score_increment
            self._score_increment = 1.0


def delay_point(name: str) -> None:
    """Do nothing; tests replace this function to delay threads where they interact."""


@dataclass
class _Target:
    count: int | Range | None  # count as in `Formula.aim`
    threshold: float  # scaled λ to refute
    exhausted: bool = False  # whether no labelling is left above the threshold


class _GeneratorThread:
    def __init__(self, generator: ConflictGenerator, state: ProofState) -> None:
        self._generator, self._state = generator, state
        self._target: _Target | None = None
        self._formula: Formula | None = None
        self._conflicts_seen = self._handed_over_seen = 0

    def step(self, target: _Target, context: ProofContext) -> ConflictBatch:
        if self._formula is None:
            self._formula = Formula(context.space, context.blocks)
        if target is not self._target:
            self._target = target
            self._formula.aim(target.threshold, target.count)
            self._generator.begin(self._formula, partial(self._take_in_others, self._formula))
        return self._generator.step(target.threshold)

    def _take_in_others(self, formula: Formula) -> None:
        """Add the new conflicts and handed-over labellings of all threads to the formula."""
        delay_point("before taking in conflicts")
        new_conflicts = self._state.conflicts[self._conflicts_seen :]
        handed_over = self._state.handed_over_since(self._handed_over_seen)
        self._conflicts_seen += len(new_conflicts)
        self._handed_over_seen += len(handed_over)
        formula.learn(new_conflicts, handed_over)


class ThreadedGenerator:
    """Threads that add conflicts to the state: `begin` for a target, `step` until True, `close`."""

    def __init__(self, context: ProofContext, threads: int, state: ProofState) -> None:
        self._context, self._state = context, state
        self._threads = [_GeneratorThread(ConflictGenerator(context, number), state) for number in range(threads)]
        self._pool = ThreadPoolExecutor(threads)
        self._idle_threads = set(range(threads))
        self._target: _Target | None = None
        self._count: int | Range | None = None
        self._has_new_results = False
        self._results_changed = Condition()
        self._error: BaseException | None = None

    def begin(self, count: int | Range | None) -> None:
        """Set the count of the next target, which takes effect from the next step on."""
        self.end()
        self._count = count

    def end(self) -> None:
        """Drop the current target; results in progress are still added to the proof."""
        with self._results_changed:
            self._target = None

    def step(self, threshold: float) -> bool:
        """Wait briefly for results, start idle threads; True once none may exceed scaled λ `threshold`."""
        with self._results_changed:
            if self._target is None:
                self._target = _Target(self._count, threshold)
            self._target.threshold = threshold
            while self._idle_threads and not self._target.exhausted:
                self._submit_step(self._idle_threads.pop())
            if not (self._has_new_results or self._target.exhausted or self._error):
                self._results_changed.wait(_WAIT_SECONDS)
            self._has_new_results = False
            if self._error is not None:
                raise self._error
            return self._target.exhausted

    def close(self) -> None:
        """Stop all threads; results in progress are still added to the proof."""
        self.end()
        self._pool.shutdown(wait=False)

    def _submit_step(self, number: int) -> None:
        # a pool that is shut down, or whose interpreter ends, accepts no task
        with suppress(RuntimeError):
            self._pool.submit(self._run_step, number)

    @one_thread()
    def _run_step(self, number: int) -> None:
        """Run one step of a thread and submit the next one while there is a target."""
        thread = self._threads[number]
        with self._results_changed:
            target = self._target
            if target is None or target.exhausted:
                self._idle_threads.add(number)
                return
        try:
            batch = thread.step(target, self._context)
            delay_point("before handing over")
            self._hand_over(target, batch)
        except BaseException as error:  # the main thread raises the error
            with self._results_changed:
                self._error = error
                self._results_changed.notify()
        else:
            self._submit_step(number)

    def _hand_over(self, target: _Target, batch: ConflictBatch) -> None:
        """Add the results of a thread to the state of the proof, whatever the current target."""
        with self._results_changed:
            threshold = target.threshold if self._target is None else self._target.threshold
            new = self._state.add_conflicts(batch.conflicts, threshold)
            new += self._state.hand_over(batch.unrefuted)
            # Set this flag last: a thread that sees the flag must also see the labellings handed over.
            target.exhausted |= batch.exhausted
            self._has_new_results |= new > 0 or batch.exhausted
            if self._has_new_results:
                self._results_changed.notify()


# Relaxations before worker processes start, with and without the batch solver.
# They take about as long as starting the processes.
SOLO_RELAXATIONS: Final = (8000, 1000)

# Largest number of threads that generate conflicts in this process. A third thread draws labellings that are mostly
# refuted for the same reasons at the same time.
_THREADS: Final = 2
_CLOSING_SECONDS: Final = 0.5  # time, s, for which results of the workers are still accepted at the end


class ConflictSources:
    """Source of conflicts in one process or several: `begin` with a formula, `step` until True, `close`.

    solo_relaxations: relaxations before worker processes start; None: where they are useful. solves: by the workers.
    """

    def __init__(self, context: ProofContext, state: ProofState, solo_relaxations: int | None = None) -> None:
        self._generator = ConflictGenerator(context)
        self._context = context
        self._state = state
        self._solo_relaxations = solo_relaxations
        self._jobs, self._workers_allowed, self._on_cluster = 1, False, False
        self.solves = 0
        self._formula: Formula | None = None
        self._count: int | Range | None = None
        self._threads: ThreadedGenerator | None = None
        self.cube_workers: CubeWorkers | None = None

    def set_workers(self, jobs: int) -> None:
        """Set the number of worker processes, which start in `step`; a cluster contributes all."""
        self._jobs, self._on_cluster = jobs, client_of_cluster() is not None
        self._workers_allowed = jobs > 1 or self._on_cluster
        if jobs > 1 and self._threads is None and self._context.relaxation.batched:
            self._threads = ThreadedGenerator(self._context, min(jobs, _THREADS), self._state)

    @property
    def formula(self) -> Formula:
        """Formula of the labellings that are left; raises RuntimeError before `begin`."""
        if self._formula is None:
            raise RuntimeError("there is no formula yet; call `begin` first")
        return self._formula

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        self._formula, self._count = formula, count
        self._generator.begin(formula)
        if self._threads is not None:
            self._threads.begin(count)
        if self.cube_workers is not None:
            self.cube_workers.begin(formula, count, threshold)

    def end(self) -> None:
        """Drop the formula and stop generating conflicts for it."""
        self._formula = None
        if self._threads is not None:
            self._threads.end()
        if self.cube_workers is not None:
            self.cube_workers.end()

    def exchange(self) -> None:
        """Collect results of the workers and send them new tasks, without waiting."""
        if self.cube_workers is not None:
            self.cube_workers.exchange()

    def step(self, threshold: float) -> bool:
        """Add the conflicts of a short time to the proof; return True if no labelling is left."""
        formula = self.formula
        if self.cube_workers is None and self._workers_allowed and self._workers_due():
            formula.learn(self._state.conflicts)  # threads add conflicts to formulas of their own only
            self.cube_workers = CubeWorkers(self._context, self._jobs, self._state)
            self.cube_workers.begin(formula, self._count, threshold)
        if self.cube_workers is None:
            return self._generate_here(threshold)
        formula.raise_threshold(threshold)
        self.cube_workers.exchange()
        # this process also generates conflicts until a worker has started
        if not self.cube_workers.started and (self._solo_relaxations != 0 or not self.cube_workers.has_workers):
            before = len(self._state.conflicts)
            exhausted = self._generate_here(threshold)
            formula.learn(self._state.conflicts[before:])
            closed = self.cube_workers.step(threshold, wait_for_results=False)
        else:
            exhausted = False
            if self._threads is not None:
                self._threads.close()
                self._threads = None
                formula.learn(self._state.conflicts, self._state.handed_over)
            closed = self.cube_workers.step(threshold, wait_for_results=True)
        self.solves = self.cube_workers.solves
        if closed:
            formula.learn((), self._state.handed_over)
            if formula.next() is None:
                return True
            # labellings left although their cube was closed are assigned again
            self.cube_workers.begin(formula, self._count, threshold)
        return exhausted

    def _generate_here(self, threshold: float) -> bool:
        """Generate conflicts in this process or its threads; return True if no labelling is left."""
        if self._threads is not None:
            return self._threads.step(threshold)
        batch = self._generator.step(threshold)
        self._state.add_conflicts(batch.conflicts)
        self._state.hand_over(batch.unrefuted)
        return batch.exhausted

    def _workers_due(self) -> bool:
        if self._solo_relaxations is not None:
            return self._context.relaxation.solves >= self._solo_relaxations
        others = self._on_cluster or self._jobs > _THREADS or not self._context.relaxation.batched
        return others and self._context.relaxation.solves >= SOLO_RELAXATIONS[not self._context.relaxation.batched]

    def close(self) -> None:
        """Stop threads and workers; keep results that arrive within `_CLOSING_SECONDS`."""
        cube_workers, self.cube_workers = self.cube_workers, None
        self._workers_allowed = False
        if self._threads is not None:
            self._threads.close()
        self._threads = None
        if cube_workers is not None:
            cube_workers.close(_CLOSING_SECONDS)
