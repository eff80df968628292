"""A proof in several processes: the space is parted into cubes, and whoever is free hunts in the next.

This process keeps the formula, the bound and the record. The others are lent a cube for a moment at a time
(`exact.at_seat`), and bring back conflicts, which hold for the whole space and are told to all others, and labellings
that nothing refutes. A cube without any labelling left is **closed**; one that lasts is parted in two, by the face
that looks best (`exact.cubes`), as soon as there are too few for all. A process that dies takes nothing along but
what it did in that moment: its cube is lent to another.

What is proven rests on what it rests on alone: conflicts are proven where they were found by the same code, and a
closed cube is what a satisfiability solver says of a formula of such conflicts.
"""

from __future__ import annotations

from collections import Counter, deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
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
from jld_explore.evaluation import PoolWorker, WorkerPool
from jld_explore.space import Range, SearchSpace

MOMENT: Final = 0.3
"""Seconds for which a cube is lent: sending takes a hundredth of that, and news are no older."""

_AHEAD: Final = 2
"""Cubes that a process has at a time: one where it hunts, and one to go on with at once."""

_WAITING: Final = 2
"""Cubes for each process there are to be at the least, while any lasts."""

_LONG: Final = 20
"""Moments after which a cube is parted in any case, so that a part of it may be closed, and on record."""

_FADING: Final = 0.999
"""What a face's weight in conflicts is multiplied by at each conflict after."""

_PATIENCE: Final = 0.1
"""Seconds this process waits at the most before it looks at the clock again."""


_DEATHS: Final = (BrokenExecutor, CancelledError, OSError)
"""What is raised where a process died; a cluster has its own."""


@dataclass
class _WorkerState:
    """What a seat was told so far: orders, conflicts, labellings that are dealt with."""

    orders: int = 0
    conflicts: int = 0
    passed: int = 0


@dataclass(frozen=True)
class _AssignedCube:
    """A cube that is lent, how often it was before, in which step of the ladder, its count and threshold."""

    seat: PoolWorker
    cube: Cube
    times: int
    step: int
    count: int | Range | None
    threshold: float


class CubeWorkers:
    """Processes that hunt in cubes. jobs: how many; on a cluster every worker instead. space, blocks, free, seed: of
    the proof. state: of the proof, to which all that is found is added.
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
        """Whether any process has answered, so that it is there."""
        return any(told.orders > 1 for told in self._told.values())

    @property
    def expected(self) -> bool:
        """Whether there are processes, or some are being started."""
        return len(self._seats) > 0

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Go on with another formula. count: as `Formula` takes it; threshold: scaled λ."""
        self._formula, self._count, self._threshold = formula, count, threshold
        self._step += 1
        self._cubes = deque([(EVERYTHING, 0)])

    def end(self) -> None:
        """Nothing more is to be hunted, until it begins again."""
        self._formula = None
        self._cubes.clear()

    def step(self, threshold: float, *, idle: bool) -> bool:
        """Add to the state of the proof what was found; return whether every cube is closed.

        threshold: scaled λ, not lower than before in this formula. idle: whether to wait for something.
        """
        self._threshold = threshold
        self.pump()
        if idle and self._lent and not self._news:
            wait(list(self._lent), timeout=_PATIENCE, return_when=FIRST_COMPLETED)
            self.pump()
        self._news = False
        return not self._cubes and not any(one.step == self._step for one in self._lent.values())

    def pump(self) -> None:
        """Take what has been done, and lend what waits to those who are free."""
        for future in [future for future in self._lent if future.done()]:
            if future in self._lent:  # what another says of a seat may take back all that it was lent
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
        """Let all go, and keep what is found meanwhile. patience: seconds."""
        self.end()
        wait(list(self._lent), timeout=patience)
        self.pump()
        self._seats.close()
        self._lent.clear()

    # --- cubes ------------------------------------------------------------------------------------------

    def _part(self) -> None:
        """Part waiting cubes until there are enough."""
        assert self._formula is not None
        enough = _WAITING * max(len(self._seats), 1) - len(self._lent)
        while len(self._cubes) < enough:
            # what nobody has tried yet may be closed in a moment; the first one of all never is
            place = next((k for k, (cube, times) in enumerate(self._cubes) if times or cube == EVERYTHING), None)
            if place is None:
                return
            cube, _ = self._cubes[place]
            del self._cubes[place]
            self._cubes.extend((part, 0) for part in split_cube(cube, self._formula, self._weight))

    def _lend(self, seat: PoolWorker, cube: Cube, times: int) -> None:
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
        except Exception:  # whatever a pool says whose process has died
            self._cubes.appendleft((cube, times))
            self._seats.lose(seat)
            self._lost(seat)
            return
        told.orders, told.conflicts = told.orders + 1, told.conflicts + len(news)
        told.passed += len(passed)
        self._lent[future] = _AssignedCube(seat, cube, times, self._step, self._count, self._threshold)

    def _lost(self, seat: PoolWorker) -> None:
        """Take back what was lent to a seat that is no more."""
        self._told.pop(seat.name, None)
        for future, one in list(self._lent.items()):
            if one.seat is seat:
                del self._lent[future]
                self._return(one)

    def _return(self, one: _AssignedCube) -> None:
        """A cube waits again, behind none; of an earlier step it is of no use."""
        if one.step == self._step and self._formula is not None:
            self._cubes.appendleft((one.cube, one.times))

    def _take(self, future: Future[TaskResult], one: _AssignedCube) -> None:
        try:
            answer = future.result()
        except Exception as error:  # a process that was killed, a worker that left: each costs one moment
            if not isinstance(error, _DEATHS) and not type(error).__module__.startswith("distributed"):
                raise  # a task that broke
            self._return(one)
            self._seats.lose(one.seat)
            self._lost(one.seat)
            return
        if answer.forgotten:  # another process at the same place, which is told all again
            self._return(one)
            self._told.pop(one.seat.name, None)
            return
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
        """Nothing of a cube is left but what was passed; where that is nothing either it holds as a conflict does."""
        self.closed += 1
        faces, labels = np.array(one.cube.faces, dtype=np.int64), np.array(one.cube.labels, dtype=bool)
        if one.step == self._step and self._formula is not None:
            self._formula.set_aside(faces, labels)
        group = self._recipe[0].group
        passed = self._state.handed_over
        if one.count is None and not any(one.cube.holds(image) for row in passed for image in row[group]):
            self._state.add_conflicts([Conflict(faces, labels, one.threshold, Evidence.CUBE)])

    def _weigh(self, conflict: Conflict) -> None:
        self._gain /= _FADING
        self._weight[conflict.faces] += self._gain
        if self._gain > 1e100:
            self._weight /= self._gain
            self._gain = 1.0
