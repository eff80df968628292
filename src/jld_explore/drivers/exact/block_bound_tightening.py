"""A bound on all labellings from the relaxation by blocks, and the blocks that no labelling worth finding holds.

One program over all possible blocks bounds λ far closer than face by face where blocks are of several cells and the gap
is wide (docs/method.md (6.5)), but takes as long as thousands of relaxations in the batch solver. So a proof by
conflicts of
faces turns to it once it has taken about as long itself. What the mechanism of the program says of single blocks is a
conflict of each block that is ruled out: all inside it inner, all around it dry. Without those blocks the next program
is smaller, and bounds closer. A long one is solved by a process of its own, which can be stopped while it is at it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, wait
from dataclasses import dataclass
from typing import Final

import cloudpickle
import numpy as np

from jld_core.arrays import Bools, Ints
from jld_core.limit import Choice, LimitAnalysis, applies_to
from jld_explore.drivers.exact.block_bound_pool import Space, bound_blocks
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation import WorkerPool
from jld_explore.space import SearchSpace

_RELAXATIONS: Final = (5.0, 0.25)
"""Relaxations, with the batch solver and without, that take as long as the program does for each side of a block: 1
ms."""

_MOST: Final = 60_000
"""Sides of blocks above which it is not tried: of 40 000 the program takes 41 s."""

_HERE: Final = 2000
"""Sides up to which it is solved in this process: within two seconds, which another takes to begin."""

_LOOK: Final = 0.2
"""Seconds after which it is asked whether time is up."""

_AGAIN: Final = 0.9
"""Part of the blocks, of those before, with which another program is worth its while."""

_BETTER: Final = 1e-3
"""How much stronger, relative, a labelling must have been found for all this to be done again."""

_SHARE: Final = 0.5
"""Part of the time left that the programs may take."""


@dataclass(frozen=True)
class TightenedBound:
    """bound: scaled λ that no labelling exceeds. conflicts: one for each block that was ruled out."""

    bound: float
    conflicts: tuple[Conflict, ...]


class BlockBoundTightening:
    """Of one space. analyses: of its load cases. blocks: its possible blocks, None where they are not listed. many:
    whether the batch solver solves relaxations. wanted: whether it is to be tried at all.
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
        possible = wanted and blocks is not None and 0 < self._sides <= _MOST and all(map(applies_to, analyses))
        self._next = _RELAXATIONS[not many] * self._sides if possible else math.inf
        self._least: float | None = None
        self.solves = 0

    def leave(self) -> None:
        """Do without it from now on."""
        self._next = math.inf

    def due(self, relaxations: int, least: float) -> bool:
        """Whether its time has come. relaxations: solved so far; least: scaled λ that a labelling must exceed."""
        before = self._least
        return relaxations >= self._next and (before is None or least > before + _BETTER * abs(before))

    def tighten(self, least: float, most: float, left: float, late: Callable[[], bool]) -> TightenedBound:
        """What the programs say. least, most: scaled λ to reach, and bound. left: seconds until time is up, inf for
        none. late: asked between programs.
        """
        assert self._blocks is not None
        self._next *= 4.0
        self._least = least
        end = time.perf_counter() + _SHARE * left
        conflicts: list[Conflict] = []
        while not late() and time.perf_counter() < end:
            before = int(self._allowed.sum())
            chosen = np.flatnonzero(self._allowed)
            said = self._choose(chosen, (least, most), end - time.perf_counter(), late)
            if said is None:
                break
            most = min(most, least if said.refuted else said.bound)
            out = chosen if said.refuted else chosen[said.useless]
            if not said.refuted:
                self._allowed[out] = False
            conflicts += [one for one in (self._without(p, least) for p in out.tolist()) if len(one.faces)]
            if said.refuted or self._allowed.sum() > _AGAIN * before or not self._allowed.any():
                break
        return TightenedBound(most, tuple(conflicts))

    def _choose(
        self, chosen: Ints, range_: tuple[float, float], seconds: float, late: Callable[[], bool]
    ) -> Choice | None:
        """What the relaxation of some of the blocks (k,) says, None where it was given up. seconds: it may take."""
        assert self._blocks is not None
        members = tuple(self._blocks.members[p] for p in chosen.tolist())
        part = Space(self._space, PossibleBlocks(members, tuple(self._blocks.inside[p] for p in chosen.tolist())))
        asked = np.ones(len(chosen), dtype=bool), *range_
        if self._sides <= _HERE:
            relaxation = part.relaxation(self._analyses, seconds)
            said = relaxation.choose(*asked)
            self.solves += relaxation.solves
            return said
        seats = WorkerPool(1)
        try:
            seats.fill()
            seat = next(iter(seats), None)
            if seat is None:
                return None
            future = seat.submit(bound_blocks, seat.name, cloudpickle.dumps(part), asked)
            end = time.perf_counter() + seconds
            while not wait([future], timeout=_LOOK).done:
                if late() or time.perf_counter() > end:
                    return None
            answer: tuple[Choice, int] = future.result()
        except BrokenExecutor:  # a process that was killed costs this bound, and no more
            return None
        finally:
            seats.close()
        self.solves += answer[1]
        return answer[0]

    def _without(self, p: int, least: float) -> Conflict:
        """No labelling that has block p exceeds a scaled λ."""
        assert self._blocks is not None
        faces, members = self._space.assembly.interfaces, self._blocks.members[p]
        touched = (np.isin(faces.a, members) | np.isin(faces.b, members)) & self._space.candidates
        labels = np.ones(len(touched), dtype=bool)
        labels[list(self._blocks.inside[p])] = False
        where = np.flatnonzero(touched)
        return Conflict(where, labels[where], least, Evidence.BLOCKS)


def _sides_of(space: SearchSpace, blocks: PossibleBlocks) -> int:
    """Faces around all blocks."""
    faces = space.assembly.interfaces
    around = np.bincount(np.concatenate([faces.a, faces.b]), minlength=len(space.assembly.elements))
    pairs = zip(blocks.members, blocks.inside, strict=True)
    return int(sum(around[list(members)].sum() - 2 * len(inside) for members, inside in pairs))
