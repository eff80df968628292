"""Tighten the bound on all labellings by one block relaxation, and refute single blocks.

One program over all possible blocks bounds λ much closer than the relaxation face by face (docs/method.md (6.5)).
This holds where blocks have several cells and the gap is wide. The program takes as long as thousands of relaxations
in the batch solver. A proof by conflicts of faces therefore solves the program only after spending about the same
time itself.

The mechanism of the program may refute single blocks. Each refuted block becomes a conflict: all faces inside it
inner, all faces around it dry. The next program leaves those blocks out, so it is smaller and its bound tighter. A
large program is solved in a separate process, which can be stopped before it ends.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from dataclasses import dataclass
from typing import Final

import cloudpickle
import numpy as np

from jld_core.arrays import Bools, Ints
from jld_core.limit import LimitAnalysis
from jld_core.limit.block_relaxation import Choice, applies_to
from jld_explore.drivers.exact.block_bound_pool import BlockSpace, bound_blocks
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation.worker_pool import LOST, WorkerPool
from jld_explore.space import SearchSpace

_RELAXATIONS: Final = (5.0, 0.25)
"""Relaxations face by face that take as long as the program takes per side of a block.

The first value applies with the batch solver, the second without it. The program takes 1 ms per side.
"""

_MOST_SIDES: Final = 60_000
"""Largest number of sides of blocks; the program of 40 000 sides takes 41 s."""

_SIDES_HERE: Final = 2000
"""Largest number of sides for which this process solves the program.

Such a program takes at most two seconds, which is the time that another process needs to start.
"""

_DEADLINE_CHECK_SECONDS: Final = 0.2
"""Interval, s, at which the deadline is checked while another process solves the program."""

_REMAINING_SHARE: Final = 0.9
"""Largest share of the blocks that may remain for another program to be solved."""

_INCREASE: Final = 1e-3
"""Relative increase of the best known λ after which the programs are solved again."""

_TIME_SHARE: Final = 0.5
"""Share of the remaining time that the programs may take."""


@dataclass(frozen=True)
class TightenedBound:
    """Result of `BlockBoundTightening.tighten`.

    Attributes
    ----------
    bound : float
        Scaled λ that no labelling exceeds.
    conflicts : tuple of Conflict
        One conflict for each refuted block.
    """

    bound: float
    conflicts: tuple[Conflict, ...]


class BlockBoundTightening:
    """Repeated block relaxation of one space without the blocks that are refuted.

    Parameters
    ----------
    analyses : sequence of LimitAnalysis
        Analyses of the load cases of the space, in their order.
    space : SearchSpace
        The search space.
    blocks : PossibleBlocks or None
        Possible blocks of the space; None where they are not listed.
    many : bool
        Whether the batch solver solves the relaxations face by face.
    wanted : bool
        Whether the block relaxation may be used at all.

    Attributes
    ----------
    solves : int
        Number of programs solved.
    """

    def __init__(
        self,
        analyses: Sequence[LimitAnalysis],
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        *,
        many: bool,
        wanted: bool,
    ) -> None:
        self._analyses, self._space, self._blocks = analyses, space, blocks
        self._allowed: Bools = np.ones(0 if blocks is None else len(blocks), dtype=bool)
        self._sides = 0 if blocks is None else _sides_of(space, blocks)
        usable = wanted and blocks is not None and 0 < self._sides <= _MOST_SIDES and all(map(applies_to, analyses))
        self._next = _RELAXATIONS[not many] * self._sides if usable else math.inf
        self._least: float | None = None
        self.solves = 0

    @property
    def _listed_blocks(self) -> PossibleBlocks:
        """The possible blocks; raises RuntimeError where they are not listed, so that the tightening is never due."""
        if self._blocks is None:
            raise RuntimeError("the possible blocks are not listed, so their bounds cannot be tightened")
        return self._blocks

    def disable(self) -> None:
        """Disable the tightening from now on."""
        self._next = math.inf

    def is_due(self, relaxations: int, least: float) -> bool:
        """Return True if the programs should be solved now.

        Parameters
        ----------
        relaxations : int
            Number of relaxations solved so far.
        least : float
            Scaled λ that a labelling must exceed.
        """
        before = self._least
        return relaxations >= self._next and (before is None or least > before + _INCREASE * abs(before))

    def tighten(self, least: float, most: float, left: float, time_is_up: Callable[[], bool]) -> TightenedBound:
        """Solve block relaxations until no further block is refuted or time runs out.

        Parameters
        ----------
        least, most : float
            Scaled λ to reach, and scaled λ that no labelling exceeds.
        left : float
            Time until the deadline, s; inf for no deadline.
        time_is_up : callable
            Returns True once the deadline has passed; called between programs.

        Returns
        -------
        TightenedBound
            Bound not above `most`, and the conflicts of the refuted blocks.
        """
        self._next *= 4.0
        self._least = least
        end = time.perf_counter() + _TIME_SHARE * left
        conflicts: list[Conflict] = []
        while not time_is_up() and time.perf_counter() < end:
            before = int(self._allowed.sum())
            remaining = np.flatnonzero(self._allowed)
            choice = self._solve(remaining, (least, most), end - time.perf_counter(), time_is_up)
            if choice is None:
                break
            most = min(most, least if choice.refuted else choice.bound)
            out = remaining if choice.refuted else remaining[choice.useless]
            if not choice.refuted:
                self._allowed[out] = False
            conflicts += [one for one in (self._conflict_of_block(p, least) for p in out.tolist()) if len(one.faces)]
            if choice.refuted or self._allowed.sum() > _REMAINING_SHARE * before or not self._allowed.any():
                break
        return TightenedBound(most, tuple(conflicts))

    def _solve(
        self, remaining: Ints, ends: tuple[float, float], seconds: float, time_is_up: Callable[[], bool]
    ) -> Choice | None:
        """Solve the relaxation of some blocks (k,); return None if time runs out first."""
        members = tuple(self._listed_blocks.members[p] for p in remaining.tolist())
        block_space = BlockSpace(
            self._space, PossibleBlocks(members, tuple(self._listed_blocks.inside[p] for p in remaining.tolist()))
        )
        program = np.ones(len(remaining), dtype=bool), *ends
        if self._sides <= _SIDES_HERE:
            relaxation = block_space.relaxation(self._analyses, seconds)
            choice = relaxation.choose(*program)
            self.solves += relaxation.solves
            return choice
        workers = WorkerPool(1)
        try:
            worker = workers.first()
            if worker is None:
                return None
            future = workers.submit(worker, bound_blocks, worker.name, cloudpickle.dumps(block_space), program)
            if future is None:
                return None
            end = time.perf_counter() + seconds
            while not wait([future], timeout=_DEADLINE_CHECK_SECONDS).done:
                if time_is_up() or time.perf_counter() > end:
                    return None
            result = workers.result(worker, future)
        finally:
            workers.close()
        if result is None or result is LOST:  # if the process is killed only this bound is lost
            return None
        self.solves += result[1]
        return result[0]

    def _conflict_of_block(self, p: int, least: float) -> Conflict:
        """Return the conflict that no labelling with block p exceeds the scaled λ `least`."""
        faces, members = self._space.assembly.interfaces, self._listed_blocks.members[p]
        touched = (np.isin(faces.a, members) | np.isin(faces.b, members)) & self._space.candidates
        labels = np.ones(len(touched), dtype=bool)
        labels[list(self._listed_blocks.inside[p])] = False
        where = np.flatnonzero(touched)
        return Conflict(where, labels[where], least, Evidence.BLOCKS)


def _sides_of(space: SearchSpace, blocks: PossibleBlocks) -> int:
    """Return the number of faces around all blocks, counted once per block."""
    faces = space.assembly.interfaces
    around = np.bincount(np.concatenate([faces.a, faces.b]), minlength=len(space.assembly.elements))
    pairs = zip(blocks.members, blocks.inside, strict=True)
    return int(sum(around[list(members)].sum() - 2 * len(inside) for members, inside in pairs))
