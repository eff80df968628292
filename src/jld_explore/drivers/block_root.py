"""Bound on λ of all layouts by the block relaxation, computed in a process beside any search."""

from __future__ import annotations

import os
import pickle
import time
from concurrent.futures import Future, wait
from typing import Final

import cloudpickle
import numpy as np

from jld_core.deadline import Deadline
from jld_core.limit import LimitAnalysis, SolveOptions
from jld_core.limit.block_relaxation import applies_to
from jld_core.limit.case_relaxation import relaxation_of
from jld_core.threads import memory_limit, one_thread
from jld_explore.drivers.exact.block_bounds import BlockSpace, sides_of
from jld_explore.drivers.exact.context import listed_blocks
from jld_explore.evaluation import Pool
from jld_explore.evaluation.pool import is_lost
from jld_explore.space import SearchSpace

LEAST_SECONDS: Final = 5.0  # shortest time of a search with this bound; its process takes two seconds to start

_SIDE_SECONDS: Final = 6e-4  # time of the program for each side of a block; 40 000 to 77 000 sides took 24 to 48 s
_SIDE_MEMORY: Final = 16e3  # memory of the program for each side of a block, bytes
_MEMORY_SHARE: Final = 0.4  # largest share of the memory for the program
_LISTED_WITHIN: Final = 0.3  # share of the time that is open to listing the possible blocks
_CLOSE: Final = 1.0  # time before the deadline at which the solver ends, s
_NICE: Final = 5  # the search goes first where it uses every core


class BlockRoot:
    """Block relaxation of all possible blocks of a space, solved in a process of its own."""

    def __init__(self, blocks: BlockSpace, seconds: float, *, busy: bool) -> None:
        self._pool = Pool(1)
        self._bound: float | None = None
        nice = _NICE if busy else 0
        self._future: Future[float | None] | None = self._pool.submit(_bound, cloudpickle.dumps(blocks), seconds, nice)

    @classmethod
    def beside(cls, space: SearchSpace, model: SolveOptions, deadline: Deadline, jobs: int) -> BlockRoot | None:
        """Start the process for a search; None where the bound does not exist or would come too late."""
        left = deadline.remaining()
        assembly = space.assembly
        if not LEAST_SECONDS <= left < float("inf") or space.void is not None:
            return None
        if not model.supports_bounds_over_labellings or not all(
            applies_to(LimitAnalysis(case)) for case in assembly.by_case
        ):
            return None
        with Deadline(_LISTED_WITHIN * left).enforced():
            blocks = listed_blocks(space)  # in a share of that time
        if blocks is None or not len(blocks):
            return None
        sides = sides_of(space, blocks)
        if sides * _SIDE_SECONDS > deadline.remaining() or sides * _SIDE_MEMORY > _MEMORY_SHARE * memory_limit():
            return None
        return cls(BlockSpace(space, blocks), deadline.remaining() - _CLOSE, busy=jobs >= (os.cpu_count() or 1))

    def poll(self, seconds: float = 0.0) -> float | None:
        """Return the bound, scene units, after waiting for it up to some seconds; None without one."""
        future = self._future
        if future is None or not wait([future], timeout=seconds).done:
            return self._bound
        self._future = None
        try:
            self._bound = future.result()
        except Exception as error:
            if not is_lost(error):  # a process that is killed costs its bound alone
                raise
        return self._bound

    @property
    def running(self) -> bool:
        """True while the bound may still come."""
        return self._future is not None

    def close(self) -> None:
        """End the process; a bound that has not come is lost."""
        self._future = None
        self._pool.close()


@one_thread()
def _bound(work: bytes, seconds: float, nice: int) -> float | None:
    """Solve the block relaxation for at most some seconds; return the bound, scene units."""
    start = time.perf_counter()
    os.nice(nice)
    blocks: BlockSpace = pickle.loads(work)
    space = blocks.space
    whole = relaxation_of(space.assembly)
    if whole is None:
        return None
    most = whole.bound(space.fixed, space.candidates)
    relaxation = blocks.relaxation(seconds=seconds - (time.perf_counter() - start))
    bound = relaxation.choose(np.ones(len(blocks.blocks), dtype=bool), 0.0, most).bound * whole.unit
    return float(bound) if np.isfinite(bound) else None
