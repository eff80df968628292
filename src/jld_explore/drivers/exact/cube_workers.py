"""Cube-and-conquer proof: split the search space into cubes and refute them in workers.

This process keeps the formula, the bound and the records. Each worker receives a cube for a short time
(`exact.worker_tasks`) and returns conflicts and labellings that no mechanism refutes. Conflicts hold for the whole
space and are sent to all other workers. A cube without any labelling left is **closed**. A cube that lasts is split
in two by the most promising face (`exact.cubes`) as soon as there are too few cubes for all workers. A worker that
dies loses only its current task; another worker receives the cube.

The proof does not depend on the workers. Every conflict is proven by the same code wherever it is found. A closed
cube is the answer of a satisfiability solver to a formula of such conflicts.
"""

from __future__ import annotations

from collections import Counter, deque
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_explore.drivers.exact.context import SEED_STEP, ProofContext
from jld_explore.drivers.exact.cubes import EVERYTHING, Cube, split_cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import Conflict, Evidence, ProofState
from jld_explore.drivers.exact.worker_tasks import Task, TaskResult, run_task
from jld_explore.evaluation.worker_pool import LOST, PoolWorker, WorkerPool
from jld_explore.space.measures import Range

TASK_SECONDS: Final = 0.3
"""Time, s, that a worker spends on a cube per task.

Sending a task takes 1 % of this time. The conflicts that a worker knows are at most this old.
"""

_TASKS_PER_WORKER: Final = 2  # tasks that a worker holds at a time: one in progress and one to continue with at once

_CUBES_PER_WORKER: Final = 2  # least number of cubes per worker, counting assigned ones, while any cube can be split

# Tasks on one cube after which the cube is split in any case. Parts of the cube may then be closed and saved.
_TASKS_PER_CUBE: Final = 20

_SCORE_DECAY: Final = 0.999  # decay of the face scores per conflict, so that recent conflicts count most

_WAIT_SECONDS: Final = 0.1  # longest time, s, that this process waits for workers before the next deadline check


@dataclass
class _WorkerState:
    """Counts of what a worker was sent, and of its results.

    tasks: tasks sent. conflicts, handed_over: conflicts and handed-over labellings sent. results: results received.
    """

    tasks: int = 0
    conflicts: int = 0
    handed_over: int = 0
    results: int = 0


@dataclass(frozen=True)
class _AssignedCube:
    """Cube assigned to a worker, with the number of earlier tasks on it and its target.

    The target consists of its number, the count and the scaled λ to refute.
    """

    worker: PoolWorker
    cube: Cube
    tasks_done: int
    target: int
    count: int | Range | None
    threshold: float


class CubeWorkers:
    """Worker processes that refute cubes of the search space.

    Call `begin` for a formula, then `step` until it returns True, and `close` at the end.

    context: space, relaxation and other data that stay fixed during the proof. jobs: number of processes; a connected
    cluster contributes all its workers instead. state: state of the proof, to which all results are added. solves,
    closed: numbers of relaxations solved and of cubes closed. task_seconds: processor time of each task, s.
    """

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
        """True if there are workers, including those that are starting."""
        return len(self._pool) > 0

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Continue with another formula, whose whole space becomes the first cube.

        formula: formula of the labellings that are left. count: count as in `Formula.aim`. threshold: scaled λ to
        refute.
        """
        self._formula, self._count, self._threshold = formula, count, threshold
        self._target += 1
        self._cubes = deque([(EVERYTHING, 0)])

    def end(self) -> None:
        """Drop all waiting cubes; no task is sent until `begin`."""
        self._formula = None
        self._cubes.clear()

    def step(self, threshold: float, *, wait_for_results: bool) -> bool:
        """Add results to the state of the proof; return True once every cube is closed.

        threshold: scaled λ to refute, at least that of the call before with the same formula. wait_for_results: whether
        to wait a short time for results if there are none.
        """
        self._threshold = threshold
        self.exchange()
        if wait_for_results and self._assigned and not self._has_new_results:
            wait(list(self._assigned), timeout=_WAIT_SECONDS, return_when=FIRST_COMPLETED)
            self.exchange()
        self._has_new_results = False
        return not self._cubes and not any(one.target == self._target for one in self._assigned.values())

    def exchange(self) -> None:
        """Collect finished tasks and send waiting cubes to free workers, without waiting.

        Tasks of workers that have died or left are sent to others.
        """
        for future in [future for future in self._assigned if future.done()]:
            if future in self._assigned:  # an earlier result may have returned all cubes of a lost worker
                self._collect(future, self._assigned.pop(future))
        if self._formula is None:
            return
        for worker in self._pool.fill():
            self._reclaim_cubes(worker)
        for most in range(_TASKS_PER_WORKER):
            tasks_held = Counter(one.worker.name for one in self._assigned.values())
            for worker in [worker for worker in self._pool if tasks_held[worker.name] <= most]:
                self._split_cubes()
                if not self._cubes:
                    return
                self._assign(worker, *self._cubes.popleft())

    def close(self, seconds: float) -> None:
        """Stop all workers; keep results that arrive within so many seconds."""
        self.end()
        wait(list(self._assigned), timeout=seconds)
        self.exchange()
        self._pool.close()
        self._assigned.clear()

    # --- cubes ------------------------------------------------------------------------------------------

    def _split_cubes(self) -> None:
        """Split waiting cubes until there are enough for all workers."""
        if self._formula is None:
            return
        wanted = _CUBES_PER_WORKER * max(len(self._pool), 1) - len(self._assigned)
        while len(self._cubes) < wanted:
            # An untried cube may be closed quickly and is not split, except the whole space, which is never closed
            # quickly.
            place = next(
                (k for k, (cube, tasks_done) in enumerate(self._cubes) if tasks_done or cube == EVERYTHING), None
            )
            if place is None:
                return
            cube, _ = self._cubes[place]
            del self._cubes[place]
            self._cubes.extend((part, 0) for part in split_cube(cube, self._formula, self._face_scores))

    def _assign(self, worker: PoolWorker, cube: Cube, tasks_done: int) -> None:
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
            new_conflicts=tuple(replace(one, mechanism=None, by_blocks=()) for one in new_conflicts),
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

    def _reclaim_cubes(self, worker: PoolWorker) -> None:
        """Return the cubes of a lost worker to the queue."""
        self._worker_states.pop(worker.name, None)
        for future, one in list(self._assigned.items()):
            if one.worker is worker:
                del self._assigned[future]
                self._requeue(one)

    def _requeue(self, one: _AssignedCube) -> None:
        """Put a cube back at the front of the queue, unless its formula is no longer current."""
        if one.target == self._target and self._formula is not None:
            self._cubes.appendleft((one.cube, one.tasks_done))

    def _collect(self, future: Future[TaskResult], one: _AssignedCube) -> None:
        """Add the results of a finished task; close, split or requeue its cube."""
        result = self._pool.result(one.worker, future)
        if result is LOST:  # a worker that was killed or left costs one task
            self._requeue(one)
            self._reclaim_cubes(one.worker)
            return
        if result.forgotten:  # a new process replaced the worker, so all data is sent again
            self._requeue(one)
            self._worker_states.pop(one.worker.name, None)
            return
        if one.worker.name in self._worker_states:
            self._worker_states[one.worker.name].results += 1
        self.solves += result.solves
        self.task_seconds.append(result.seconds)
        new = self._state.hand_over(result.unrefuted) + self._state.add_conflicts(result.conflicts)
        self._has_new_results |= new > 0 or result.closed
        for conflict in result.conflicts:
            self._score_faces(conflict)
            if self._formula is not None:
                self._formula.forbid(conflict.faces, conflict.labels, conflict.bound)
        if result.closed:
            self._record_closed(one, result)
        elif one.target == self._target and self._formula is not None:
            continued = one.cube, one.tasks_done + 1
            if continued[1] % _TASKS_PER_CUBE == 0:
                self._cubes.extendleft((part, 0) for part in split_cube(one.cube, self._formula, self._face_scores))
            else:
                self._cubes.appendleft(continued)

    def _record_closed(self, one: _AssignedCube, result: TaskResult) -> None:
        """Exclude a closed cube from the formula, and state it as a conflict where that is valid.

        The conflict is valid without a count, and if neither a handed-over labelling nor an image of one lies in the
        cube.
        """
        self.closed += 1
        faces, labels = np.array(one.cube.faces, dtype=np.int64), np.array(one.cube.labels, dtype=bool)
        if one.target == self._target and self._formula is not None:
            self._formula.set_aside(faces, labels)
        group = self._context.space.group
        handed_over = self._state.handed_over
        if one.count is None and not any(one.cube.holds(image) for row in handed_over for image in row[group]):
            self._state.add_conflicts([Conflict(faces, labels, one.threshold, Evidence.CUBE)])

    def _score_faces(self, conflict: Conflict) -> None:
        """Increase the scores of the faces of a conflict, which decide where cubes are split."""
        self._score_increment /= _SCORE_DECAY
        self._face_scores[conflict.faces] += self._score_increment
        if self._score_increment > 1e100:
            self._face_scores /= self._score_increment
            self._score_increment = 1.0
