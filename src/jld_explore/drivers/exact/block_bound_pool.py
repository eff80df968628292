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
from jld_explore.evaluation.worker_pool import PoolWorker, WorkerPool, is_lost
from jld_explore.space import SearchSpace

ALONE: Final = 40
"""Programs solved in this process before the worker process starts.

The worker process needs two seconds before it can solve programs.
"""

BlockAnswer = tuple[Choice, int]
"""Result of one block relaxation, and the number of programs solved for that result."""

_kept: dict[str, AnyBlockRelaxation] = {}


@dataclass(frozen=True)
class Space:
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
def bound_blocks(name: str, recipe: bytes | None, asked: Asked | None) -> BlockAnswer | None:
    """Solve a block relaxation in this worker process.

    Parameters
    ----------
    name : str
        Name of the worker, under which the relaxation is stored between calls.
    recipe : bytes or None
        Pickled `Space` that replaces every stored relaxation; None keeps them.
    asked : Asked or None
        Arguments of `BlockRelaxation.choose`; None only sets up the relaxation.

    Returns
    -------
    tuple of Choice and int, or None
        Result and number of programs solved. None if `asked` is None or no relaxation is stored under the name.
    """
    if recipe is not None:
        _kept.clear()
        made: Space = pickle.loads(recipe)
        _kept[name] = made.relaxation()
    if asked is None or name not in _kept:
        return None
    relaxation = _kept[name]
    before = relaxation.solves
    choice = relaxation.choose(*asked)
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
    elsewhere : int
        Programs solved by the worker process.
    """

    def __init__(self, analyses: Sequence[LimitAnalysis], space: SearchSpace, blocks: PossibleBlocks) -> None:
        self._recipe = Space(space, blocks)
        self._here = self._recipe.relaxation(analyses)
        self._helped = False
        self._seats: WorkerPool | None = None
        self._seat: PoolWorker | None = None
        self._ready: Future[BlockAnswer | None] | None = None
        self._pool: ThreadPoolExecutor | None = None
        self.elsewhere = 0

    @property
    def solves(self) -> int:
        """Number of programs solved, here and in the worker process."""
        return self._here.solves + self.elsewhere

    def set_workers(self, jobs: int) -> None:
        """Allow a second thread or process if `jobs` exceeds 1 or a cluster is connected."""
        self._helped = jobs > 1 or client_of_cluster() is not None

    def close(self) -> None:
        """Stop the worker process and the thread pool."""
        self._helped = False
        if self._seats is not None:
            self._seats.close()
        self._seats = self._seat = None
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """Solve one block relaxation in this process; see `BlockRelaxation.choose`."""
        return self._here.bound_all([(allowed, threshold, most)])[0]

    @property
    def many(self) -> bool:
        """Whether the batch solver solves many programs in one call."""
        return self._here.batched

    def bound_all(self, asked: Sequence[Asked]) -> list[Choice]:
        """Solve several block relaxations and return their results in the same order.

        The batch solver uses a second thread where `set_workers` allows it. Without the batch solver the last program
        goes to the worker process if that process is ready.
        """
        if self._here.batched:
            if self._helped and self._pool is None:
                self._pool = ThreadPoolExecutor(1)
            return self._here.bound_all(asked, self._pool)
        away = self._send(asked[-1]) if len(asked) > 1 else None
        found = [self._here.choose(*one) for one in (asked if away is None else asked[:-1])]
        if away is not None:
            answer = self._answer(away)
            if answer is None:
                found.append(self._here.choose(*asked[-1]))
            else:
                found.append(answer[0])
                self.elsewhere += answer[1]
        return found

    def _send(self, asked: Asked) -> Future[BlockAnswer | None] | None:
        """Submit a program to the worker process; return None while that process is unavailable."""
        if not self._helped or self._here.solves < ALONE:
            return None
        if self._seats is None:
            self._seats = WorkerPool(1)
        if self._seat is None or self._seat not in self._seats:
            self._seats.fill()
            self._seat, self._ready = next(iter(self._seats), None), None
            if self._seat is not None:
                self._ready = self._submit(self._seat, cloudpickle.dumps(self._recipe), None)
        if self._seat is None or self._ready is None or not self._ready.done():
            return None
        if self._ready.exception() is not None:
            self._lose()
            return None
        return self._submit(self._seat, None, asked)

    def _submit(self, seat: PoolWorker, recipe: bytes | None, asked: Asked | None) -> Future[BlockAnswer | None] | None:
        """Submit a set-up or a program; return None if the process has died."""
        try:
            return seat.submit(bound_blocks, seat.name, recipe, asked)
        except Exception:  # the exception of a pool whose process died depends on the kind of pool
            self._lose()
            return None

    def _answer(self, future: Future[BlockAnswer | None]) -> BlockAnswer | None:
        """Return the result of the worker process, or None if it failed."""
        try:
            return future.result()
        except Exception as error:  # a worker that was killed or left costs one program
            if not is_lost(error):
                raise
            self._lose()
            return None

    def _lose(self) -> None:
        """Drop the worker process after a failure."""
        if self._seats is not None and self._seat is not None and self._seat in self._seats:
            self._seats.lose(self._seat)
        self._seat = self._ready = None
