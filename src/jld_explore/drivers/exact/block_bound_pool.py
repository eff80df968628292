"""Solve several block relaxations at a time: in the batch solver or a worker process.

The branch and bound (`block_tree`) requests the bounds of several children together. The batch solver computes them
in two threads. Without the batch solver one program of each request goes to a worker process. A thread would not help
there, because the interior-point solver holds the interpreter lock. Each program is solved from scratch, so the tree
under one load case does not depend on the number of workers. If the worker process dies, its program is solved in
this process.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import cloudpickle

from jld_core.arrays import Bools
from jld_core.limit import LimitAnalysis
from jld_core.limit.block_relaxation import Asked, Choice
from jld_core.limit.case_relaxation import AnyBlockRelaxation, block_relaxation_of
from jld_core.threads import one_thread
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.evaluation.worker_pool import LOST, PoolWorker, WorkerPool
from jld_explore.space import SearchSpace

SOLO_PROGRAMS: Final = 40
"""Programs solved in this process before the worker process starts.

The worker process needs two seconds before it can solve programs.
"""

SolvedProgram = tuple[Choice, int]
"""Result of one block relaxation, and the number of programs solved for that result."""

_relaxations: dict[str, AnyBlockRelaxation] = {}


@dataclass(frozen=True)
class BlockSpace:
    """Search space and possible blocks, as sent to a worker process."""

    space: SearchSpace
    blocks: PossibleBlocks

    def relaxation(self, analyses: Sequence[LimitAnalysis] = (), seconds: float = math.inf) -> AnyBlockRelaxation:
        """Return the block relaxation of the space.

        Parameters
        ----------
        analyses : sequence of LimitAnalysis, optional
            Analyses of the load cases, in their order, where they exist already.
        seconds : float, default inf
            Time limit of one program, s.
        """
        members, inside = self.blocks.members, self.blocks.inside
        return block_relaxation_of(self.space.assembly, members, inside, analyses, seconds)


@one_thread()
def bound_blocks(name: str, block_space: bytes | None, program: Asked | None) -> SolvedProgram | None:
    """Solve a block relaxation in this worker process.

    Parameters
    ----------
    name : str
        Name of the worker, under which the relaxation is stored between calls.
    block_space : bytes or None
        Pickled `BlockSpace` that replaces every stored relaxation; None keeps them.
    program : Asked or None
        Arguments of `BlockRelaxation.choose`; None only sets up the relaxation.

    Returns
    -------
    tuple of Choice and int, or None
        Result and number of programs solved. None if `program` is None or no relaxation is stored under the name.
    """
    if block_space is not None:
        _relaxations.clear()
        made: BlockSpace = pickle.loads(block_space)
        _relaxations[name] = made.relaxation()
    if program is None or name not in _relaxations:
        return None
    relaxation = _relaxations[name]
    before = relaxation.solves
    choice = relaxation.choose(*program)
    return choice, relaxation.solves - before


class BlockBoundPool:
    """Block relaxation of a space, solved in this process and in a worker process.

    Parameters
    ----------
    analyses : sequence of LimitAnalysis
        Analyses of the load cases of the space, in their order.
    space : SearchSpace
        Space of planar segmentations.
    blocks : PossibleBlocks
        Possible blocks of the space.

    Attributes
    ----------
    solves_in_worker : int
        Programs solved by the worker process.
    """

    def __init__(self, analyses: Sequence[LimitAnalysis], space: SearchSpace, blocks: PossibleBlocks) -> None:
        self._block_space = BlockSpace(space, blocks)
        self._here = self._block_space.relaxation(analyses)
        self._worker_allowed = False
        self._workers: WorkerPool | None = None
        self._worker: PoolWorker | None = None
        self._ready: Future[SolvedProgram | None] | None = None
        self._threads: ThreadPoolExecutor | None = None
        self.solves_in_worker = 0

    @property
    def solves(self) -> int:
        """Number of programs solved, here and in the worker process."""
        return self._here.solves + self.solves_in_worker

    def set_workers(self, jobs: int) -> None:
        """Allow a second thread or process if `jobs` exceeds 1 or a cluster is connected."""
        self._worker_allowed = jobs > 1 or client_of_cluster() is not None

    def close(self) -> None:
        """Stop the worker process and the thread pool."""
        self._worker_allowed = False
        if self._workers is not None:
            self._workers.close()
        self._workers = self._worker = self._ready = None
        if self._threads is not None:
            self._threads.shutdown()
            self._threads = None

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """Solve one block relaxation in this process; see `BlockRelaxation.choose`."""
        return self._here.bound_all([(allowed, threshold, most)])[0]

    @property
    def many(self) -> bool:
        """Whether the batch solver solves many programs in one call."""
        return self._here.many

    def bound_all(self, programs: Sequence[Asked]) -> list[Choice]:
        """Solve several block relaxations and return their results in the same order.

        The batch solver uses a second thread where `set_workers` allows it. Without the batch solver the last program
        goes to the worker process if that process is ready.
        """
        if self._here.many:
            if self._worker_allowed and self._threads is None:
                self._threads = ThreadPoolExecutor(1)
            return self._here.bound_all(programs, self._threads)
        future = self._submit_program(programs[-1]) if len(programs) > 1 else None
        found = [self._here.choose(*one) for one in (programs if future is None else programs[:-1])]
        if future is not None:
            result = self._result(future)
            if result is None:
                found.append(self._here.choose(*programs[-1]))
            else:
                found.append(result[0])
                self.solves_in_worker += result[1]
        return found

    def _submit_program(self, program: Asked) -> Future[SolvedProgram | None] | None:
        """Submit a program to the worker process; return None while that process is unavailable."""
        if not self._worker_allowed or self._here.solves < SOLO_PROGRAMS:
            return None
        if self._workers is None:
            self._workers = WorkerPool(1)
        if self._ready is None:
            self._worker = self._workers.first()
            if self._worker is not None:
                self._ready = self._submit(cloudpickle.dumps(self._block_space), None)
        if self._worker is None or self._ready is None or not self._ready.done():
            return None
        if self._workers.result(self._worker, self._ready) is LOST:
            self._ready = None
            return None
        return self._submit(None, program)

    def _submit(self, block_space: bytes | None, program: Asked | None) -> Future[SolvedProgram | None] | None:
        """Submit a set-up or a program to the worker process; return None if it has died."""
        worker, future = self._worker, None
        if self._workers is not None and worker is not None:
            future = self._workers.submit(worker, bound_blocks, worker.name, block_space, program)
        if future is None:
            self._ready = None
        return future

    def _result(self, future: Future[SolvedProgram | None]) -> SolvedProgram | None:
        """Return the result of the worker process; None if it died or lacks the block relaxation."""
        if self._workers is None or self._worker is None:
            return None
        result = self._workers.result(self._worker, future)
        if result is not None and result is not LOST:
            return result
        self._ready = None  # send the block relaxation again, to another process where this one died
        return None
