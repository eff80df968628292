"""Relaxations by blocks several at a time: in the batch solver, by two threads, or else one in another process.

Children of nodes of the tree are asked for together. Who answers changes nothing: a program is solved from scratch, so
that under one load the tree is that of one job. Without the batch solver an interior point holds the interpreter, so
that a
thread would be of no use. A process that dies costs the program it was at, which is then solved here.
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
from jld_core.limit import AnyBlockRelaxation, Asked, Choice, LimitAnalysis, block_relaxation_of
from jld_core.threads import one_thread
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation import PoolWorker, WorkerPool, client_of_cluster
from jld_explore.space import SearchSpace

ALONE: Final = 40
"""Programs solved before another process is begun: it takes two seconds until it is of use."""

BlockAnswer = tuple[Choice, int]
"""And the programs solved for it."""

_kept: dict[str, AnyBlockRelaxation] = {}


@dataclass(frozen=True)
class Space:
    """What a process needs to begin."""

    space: SearchSpace
    blocks: PossibleBlocks

    def relaxation(self, analyses: Sequence[LimitAnalysis] = (), seconds: float = math.inf) -> AnyBlockRelaxation:
        """The relaxation by blocks. analyses: of the load cases, where they are at hand; seconds: that a program may
        take.
        """
        members, inside = self.blocks.members, self.blocks.inside
        return block_relaxation_of(self.space.assembly, members, inside, analyses, seconds)


@one_thread()
def bound_blocks(name: str, recipe: bytes | None, asked: Asked | None) -> BlockAnswer | None:
    """Answer in this process; None where there is nothing to answer, or nothing is known of a seat of that name."""
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
    """The relaxation by blocks of a space, in this process and another. analyses: of its load cases."""

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
        """Programs solved."""
        return self._here.solves + self.elsewhere

    def set_workers(self, jobs: int) -> None:
        """Whether there may be another process: with more than one job, or on a cluster."""
        self._helped = jobs > 1 or client_of_cluster() is not None

    def close(self) -> None:
        """Let the other process go."""
        self._helped = False
        if self._seats is not None:
            self._seats.close()
        self._seats = self._seat = None
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """See `BlockRelaxation.choose`."""
        return self._here.bound_all([(allowed, threshold, most)])[0]

    @property
    def many(self) -> bool:
        """Whether the batch solver solves many programs at a time."""
        return self._here.many

    def bound_all(self, asked: Sequence[Asked]) -> list[Choice]:
        """The same of several: in the batch solver, by two threads where there may be another; else the last one
        elsewhere."""
        if self._here.many:
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
        """Ask the other process, where it is there."""
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
        try:
            return seat.submit(bound_blocks, seat.name, recipe, asked)
        except Exception:  # whatever a pool says whose process has died
            self._lose()
            return None

    def _answer(self, future: Future[BlockAnswer | None]) -> BlockAnswer | None:
        try:
            return future.result()
        except Exception:  # a process that was killed, a worker that left; an error of the task comes again here
            self._lose()
            return None

    def _lose(self) -> None:
        if self._seats is not None and self._seat is not None and self._seat in self._seats:
            self._seats.lose(self._seat)
        self._seat = self._ready = None
