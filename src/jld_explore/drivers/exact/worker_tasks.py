"""Tasks of a worker process that helps with a proof: refute a cube, given all conflicts.

Between two tasks a worker keeps its formula, its generator and all conflicts, so a task brings only new conflicts.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final

from jld_core.arrays import Bits
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictGenerator
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.cubes import Cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import Conflict, LeastBounds
from jld_explore.space.measures import Range

# Number of proofs whose state a worker keeps. A worker of a cluster may serve several proofs, one after the other.
_MOST_PROOFS: Final = 4


@dataclass(frozen=True)
class Task:
    """Task of a worker: refute labellings of a cube for a limited time.

    worker: name of the worker. number: number of tasks that the worker received before. context: packed `ProofContext`,
    with the first task only. new_conflicts: conflicts since the last task. handed_over: (k, m) labellings since the
    last task that no conflict refutes and that are given to evaluation. target: number of the target; each has its own
    aim of the formula. count: count as in `Formula.aim`. threshold: scaled λ to refute, never lower within a step.
    cube: labels that all drawn labellings have. seconds: time for the task, s.
    """

    worker: str
    number: int
    context: bytes | None
    new_conflicts: tuple[Conflict, ...]
    handed_over: Bits
    target: int
    count: int | Range | None
    threshold: float
    cube: Cube
    seconds: float


@dataclass
class TaskResult:
    """Result of a task.

    conflicts: conflicts found. unrefuted: labellings that no mechanism refutes. closed: whether no labelling of the
    cube is left. solves: number of relaxations solved. seconds: processor time of the worker, s. forgotten: whether the
    worker lacks the state of earlier tasks and did nothing.
    """

    conflicts: list[Conflict] = field(default_factory=list)
    unrefuted: list[Bits] = field(default_factory=list)
    closed: bool = False
    solves: int = 0
    seconds: float = 0.0
    forgotten: bool = False


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
        """Carry out a task and return its result."""
        self.number += 1
        began = time.process_time()
        solved = self._context.relaxation.solves
        end = time.perf_counter() + task.seconds
        self._learn(task)
        result = TaskResult()
        while not result.closed:
            batch = self._generator.step(task.threshold, task.cube)
            result.conflicts += [one for one in batch.conflicts if self._bounds.lowered(one)]
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
        self._formula.learn([one for one in task.new_conflicts if self._bounds.lowered(one)], task.handed_over)
        if task.target != self._target:
            self._target = task.target
            self._formula.aim(task.threshold, task.count)
            self._generator.begin(self._formula)


_proofs: OrderedDict[str, _WorkerProof] = OrderedDict()


@one_thread()
def run_task(task: Task) -> TaskResult:
    """Carry out a task in this process, with the state kept from earlier tasks of its worker.

    A task with a context starts a new state. If the state is absent or has missed a task, do nothing and return a
    result with `forgotten` True.
    """
    if task.context is not None:
        _proofs[task.worker] = _WorkerProof(ProofContext.unpacked(task.context))
        while len(_proofs) > _MOST_PROOFS:
            _proofs.popitem(last=False)
    proof = _proofs.get(task.worker)
    if proof is None or proof.number != task.number:
        return TaskResult(forgotten=True)
    return proof.work(task)
