"""What a process does that helps with a proof: it hunts in the cube it is given, with all conflicts that it is told of.

Between two tasks it keeps its formula, what it had begun and every conflict, so that a task brings only what is new.
"""

from __future__ import annotations

import pickle
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final

import cloudpickle

from jld_core.arrays import Bits, Bools
from jld_core.limit import relaxation_of
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictGenerator
from jld_explore.drivers.exact.conflict_minimization import Conflict
from jld_explore.drivers.exact.conflicts import LeastBounds
from jld_explore.drivers.exact.cubes import Cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.space import Range, SearchSpace

_KEPT: Final = 4
"""Proofs that a process keeps what it knows of; a worker of a cluster may serve several, one after the other."""


@dataclass(frozen=True)
class WorkerSetup:
    """What a process needs to begin. space, blocks, free: of the proof; seed: of this process's preferences."""

    space: SearchSpace
    blocks: PossibleBlocks | None
    free: Bools
    seed: int

    def packed(self) -> bytes:
        """As it is sent; limits hold functions without a name, which the plain pickle refuses."""
        content: bytes = cloudpickle.dumps(self)
        return content


@dataclass(frozen=True)
class Task:
    """One task. seat: its name. number: orders the seat was given before. recipe: with the first one.

    news: conflicts since the last order. passed: labellings (k, m) that are dealt with, since then. step: of the
    ladder, each of which has a formula of its own; count: as `Formula` takes it;
    threshold: scaled λ to be refuted, never lower within a step. cube: where to hunt; seconds: how long.
    """

    seat: str
    number: int
    recipe: bytes | None
    news: tuple[Conflict, ...]
    passed: Bits
    step: int
    count: int | Range | None
    threshold: float
    cube: Cube
    seconds: float


@dataclass
class TaskResult:
    """What came of it: conflicts; labellings (m,) that nothing refutes; closed: no labelling of the cube is left.

    solves: relaxations. seconds: of this process's time. forgotten: the process knows nothing of the orders before, and
    did nothing.
    """

    conflicts: list[Conflict] = field(default_factory=list)
    unrefuted: list[Bits] = field(default_factory=list)
    closed: bool = False
    solves: int = 0
    seconds: float = 0.0
    forgotten: bool = False


class _WorkerProof:
    """What a process keeps of one proof."""

    def __init__(self, recipe: WorkerSetup) -> None:
        self._space, self._blocks = recipe.space, recipe.blocks
        relaxation = relaxation_of(recipe.space.assembly)
        assert relaxation is not None  # or there would be no proof to help with
        self._relaxation = relaxation
        self._generator = ConflictGenerator(relaxation, recipe.free, recipe.seed)
        self._formula: Formula | None = None
        self._bounds = LeastBounds()
        self._step = -1
        self.number = 0

    def work(self, order: Task) -> TaskResult:
        self.number += 1
        began = time.process_time()
        solved = self._relaxation.solves
        end = time.perf_counter() + order.seconds
        self._learn(order)
        answer = TaskResult()
        while not answer.closed:
            caught = self._generator.step(order.threshold, order.cube)
            answer.conflicts += [one for one in caught.conflicts if self._bounds.lowered(one)]
            answer.unrefuted += caught.unrefuted
            answer.closed = caught.exhausted
            if time.perf_counter() >= end:
                break
        answer.solves = self._relaxation.solves - solved
        answer.seconds = time.process_time() - began
        return answer

    def _learn(self, order: Task) -> None:
        """Take in what is new, and aim at what is asked for."""
        if self._formula is None:
            self._formula = Formula(self._space, self._blocks)
        self._formula.learn([one for one in order.news if self._bounds.lowered(one)], order.passed)
        if order.step != self._step:
            self._step = order.step
            self._formula.aim(order.threshold, order.count)
            self._generator.begin(self._formula)


_kept: OrderedDict[str, _WorkerProof] = OrderedDict()


@one_thread()
def run_task(order: Task) -> TaskResult:
    """Do what an order says, in this process."""
    if order.recipe is not None:
        _kept[order.seat] = _WorkerProof(pickle.loads(order.recipe))
        while len(_kept) > _KEPT:
            _kept.popitem(last=False)
    helper = _kept.get(order.seat)
    if helper is None or helper.number != order.number:
        return TaskResult(forgotten=True)
    return helper.work(order)
