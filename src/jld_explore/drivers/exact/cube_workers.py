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

from jld_core.arrays import Bools
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.cubes import EVERYTHING, Cube, split_cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.drivers.exact.worker_tasks import Task, TaskResult, WorkerSetup, run_task
from jld_explore.evaluation.worker_pool import PoolWorker, WorkerPool, is_lost
from jld_explore.space import SearchSpace
from jld_explore.space.measures import Range

MOMENT: Final = 0.3
"""Time, s, that a worker spends on a cube per task.

Sending a task takes 1 % of this time. The conflicts that a worker knows are at most this old.
"""

_AHEAD: Final = 2
"""Tasks that a worker holds at a time: one in progress and one to continue with at once."""

_WAITING: Final = 2
"""Least number of cubes per worker, counting assigned ones, while any cube can be split."""

_LONG: Final = 20
"""Tasks on one cube after which the cube is split in any case.

Parts of the cube may then be closed and saved.
"""

_FADING: Final = 0.999
"""Decay of the face scores per conflict, so that recent conflicts count most."""

_PATIENCE: Final = 0.1
"""Longest time, s, that this process waits for workers before the next deadline check."""


@dataclass
class _WorkerState:
    """Numbers of tasks, conflicts and handed-over labellings that a worker has received, and of its results."""

    orders: int = 0
    conflicts: int = 0
    passed: int = 0
    results: int = 0


@dataclass(frozen=True)
class _AssignedCube:
    """Cube assigned to a worker, with the number of earlier tasks on it and its target.

    The target consists of the step, that is the number of the formula, the count and the scaled λ threshold.
    """

    seat: PoolWorker
    cube: Cube
    times: int
    step: int
    count: int | Range | None
    threshold: float


class CubeWorkers:
    """Worker processes that refute cubes of the search space.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    blocks : PossibleBlocks or None
        Possible blocks, where they are listed.
    free : (m,) bool array
        Faces that may take either label.
    seed : int
        Seed of the preferred labels.
    jobs : int
        Number of processes; a connected cluster contributes all its workers instead.
    state : ProofState
        State of the proof, to which all results are added.

    Attributes
    ----------
    solves, closed : int
        Numbers of relaxations solved and of cubes closed.
    moments : list of float
        Processor time of each task, s.
    """

    def __init__(
        self,
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        free: Bools,
        seed: int,
        jobs: int,
        state: ProofState,
    ) -> None:
        self._recipe = space, blocks, free
        self._seed, self._made = seed, 0
        self._state = state
        self._seats = WorkerPool(jobs)
        self._told: dict[str, _WorkerState] = {}
        self._lent: dict[Future[TaskResult], _AssignedCube] = {}
        self._cubes: deque[tuple[Cube, int]] = deque()
        self._weight = np.zeros(len(space.fixed))
        self._gain = 1.0
        self._news = False
        self._formula: Formula | None = None
        self._step, self._threshold = 0, 0.0
        self._count: int | Range | None = None
        self.solves, self.closed = 0, 0
        self.moments: list[float] = []

    @property
    def at_work(self) -> bool:
        """Whether any worker has returned a result, so that it has started."""
        return any(told.results > 0 for told in self._told.values())

    @property
    def expected(self) -> bool:
        """Whether there are workers, including those that are starting."""
        return len(self._seats) > 0

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Continue with another formula.

        Parameters
        ----------
        formula : Formula
            Formula of the labellings that are left.
        count : int, Range or None
            Count as in `Formula.aim`.
        threshold : float
            Scaled λ to refute.
        """
        self._formula, self._count, self._threshold = formula, count, threshold
        self._step += 1
        self._cubes = deque([(EVERYTHING, 0)])

    def end(self) -> None:
        """Drop all waiting cubes; no task is sent until `begin`."""
        self._formula = None
        self._cubes.clear()

    def step(self, threshold: float, *, idle: bool) -> bool:
        """Add results to the state of the proof; return whether every cube is closed.

        Parameters
        ----------
        threshold : float
            Scaled λ to refute, at least that of the call before with the same formula.
        idle : bool
            Whether to wait a short time for results if there are none.
        """
        self._threshold = threshold
        self.pump()
        if idle and self._lent and not self._news:
            wait(list(self._lent), timeout=_PATIENCE, return_when=FIRST_COMPLETED)
            self.pump()
        self._news = False
        return not self._cubes and not any(one.step == self._step for one in self._lent.values())

    def pump(self) -> None:
        """Collect finished tasks and send waiting cubes to free workers."""
        for future in [future for future in self._lent if future.done()]:
            if future in self._lent:  # an earlier result may have returned all cubes of a lost worker
                self._take(future, self._lent.pop(future))
        if self._formula is None:
            return
        for seat in self._seats.fill():
            self._lost(seat)
        for most in range(_AHEAD):
            held = Counter(one.seat.name for one in self._lent.values())
            for seat in [seat for seat in self._seats if held[seat.name] <= most]:
                self._part()
                if not self._cubes:
                    return
                self._lend(seat, *self._cubes.popleft())

    def close(self, patience: float) -> None:
        """Stop all workers; keep results that arrive within `patience` seconds."""
        self.end()
        wait(list(self._lent), timeout=patience)
        self.pump()
        self._seats.close()
        self._lent.clear()

    # --- cubes ------------------------------------------------------------------------------------------

    def _part(self) -> None:
        """Split waiting cubes until there are enough for all workers."""
        if self._formula is None:
            return
        enough = _WAITING * max(len(self._seats), 1) - len(self._lent)
        while len(self._cubes) < enough:
            # An untried cube may be closed quickly and is not split, except the whole space, which is never closed
            # quickly.
            place = next((k for k, (cube, times) in enumerate(self._cubes) if times or cube == EVERYTHING), None)
            if place is None:
                return
            cube, _ = self._cubes[place]
            del self._cubes[place]
            self._cubes.extend((part, 0) for part in split_cube(cube, self._formula, self._weight))

    def _lend(self, seat: PoolWorker, cube: Cube, times: int) -> None:
        """Send a cube to a worker, with the conflicts and labellings that the worker lacks."""
        told = self._told.setdefault(seat.name, _WorkerState())
        recipe = None
        if told.orders == 0:
            self._made += 1
            recipe = WorkerSetup(*self._recipe, seed=self._seed + 1000 * self._made).packed()
        news = self._state.conflicts[told.conflicts :]
        passed = self._state.handed_over_since(told.passed)
        order = Task(
            seat=seat.name,
            number=told.orders,
            recipe=recipe,
            news=tuple(replace(one, mechanism=None) for one in news),
            passed=np.array(passed, dtype=bool).reshape(len(passed), len(self._weight)),
            step=self._step,
            count=self._count,
            threshold=self._threshold,
            cube=cube,
            seconds=MOMENT,
        )
        try:
            future = seat.submit(run_task, order)
        except Exception:  # the exception of a pool whose process died depends on the kind of pool
            self._cubes.appendleft((cube, times))
            self._seats.lose(seat)
            self._lost(seat)
            return
        told.orders, told.conflicts = told.orders + 1, told.conflicts + len(news)
        told.passed += len(passed)
        self._lent[future] = _AssignedCube(seat, cube, times, self._step, self._count, self._threshold)

    def _lost(self, seat: PoolWorker) -> None:
        """Return the cubes of a lost worker to the queue."""
        self._told.pop(seat.name, None)
        for future, one in list(self._lent.items()):
            if one.seat is seat:
                del self._lent[future]
                self._return(one)

    def _return(self, one: _AssignedCube) -> None:
        """Put a cube back at the front of the queue, unless its formula is no longer current."""
        if one.step == self._step and self._formula is not None:
            self._cubes.appendleft((one.cube, one.times))

    def _take(self, future: Future[TaskResult], one: _AssignedCube) -> None:
        """Add the results of a finished task; close, split or requeue its cube."""
        try:
            answer = future.result()
        except Exception as error:  # a worker that was killed or left costs one task
            if not is_lost(error):
                raise  # an error of the task itself
            self._return(one)
            self._seats.lose(one.seat)
            self._lost(one.seat)
            return
        if answer.forgotten:  # a new process replaced the worker, so all data is sent again
            self._return(one)
            self._told.pop(one.seat.name, None)
            return
        if one.seat.name in self._told:
            self._told[one.seat.name].results += 1
        self.solves += answer.solves
        self.moments.append(answer.seconds)
        new = self._state.hand_over(answer.unrefuted) + self._state.add_conflicts(answer.conflicts)
        self._news |= new > 0 or answer.closed
        for conflict in answer.conflicts:
            self._weigh(conflict)
            if self._formula is not None:
                self._formula.forbid(conflict.faces, conflict.labels, conflict.bound)
        if answer.closed:
            self._close(one, answer)
        elif one.step == self._step and self._formula is not None:
            again = one.cube, one.times + 1
            if again[1] % _LONG == 0:
                self._cubes.extendleft((part, 0) for part in split_cube(one.cube, self._formula, self._weight))
            else:
                self._cubes.appendleft(again)

    def _close(self, one: _AssignedCube, answer: TaskResult) -> None:
        """Exclude a closed cube from the formula, and state it as a conflict where that is valid.

        The conflict is valid without a count and if no handed-over labelling, nor an image of one, lies in the cube.
        """
        self.closed += 1
        faces, labels = np.array(one.cube.faces, dtype=np.int64), np.array(one.cube.labels, dtype=bool)
        if one.step == self._step and self._formula is not None:
            self._formula.set_aside(faces, labels)
        group = self._recipe[0].group
        passed = self._state.handed_over
        if one.count is None and not any(one.cube.holds(image) for row in passed for image in row[group]):
            self._state.add_conflicts([Conflict(faces, labels, one.threshold, Evidence.CUBE)])

    def _weigh(self, conflict: Conflict) -> None:
        """Increase the scores of the faces of a conflict, which decide where cubes are split."""
        self._gain /= _FADING
        self._weight[conflict.faces] += self._gain
        if self._gain > 1e100:
            self._weight /= self._gain
            self._gain = 1.0
