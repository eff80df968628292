"""A bound on all labellings from the relaxation by blocks, and the blocks that no labelling worth finding holds.

One program over all possible blocks bounds λ far closer than face by face where blocks are of several cells and the gap
is wide (docs/method.md (6.5)), but takes as long as thousands of relaxations in the kernel. So a proof by conflicts of
faces turns to it once it has taken about as long itself. What the mechanism of the program says of single blocks is a
conflict of each block that is ruled out: all inside it inner, all around it dry. Without those blocks the next program
is smaller, and bounds closer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bools
from jld_core.limit import BlockRelaxation, CaseBlockRelaxation, LimitAnalysis, applies_to
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.shrinking import Conflict
from jld_explore.space import SearchSpace

_RELAXATIONS: Final = (5.0, 0.25)
"""Relaxations, with the kernel and without, that take as long as the program does for each side of a block: 1 ms."""

_MOST: Final = 60_000
"""Sides of blocks above which it is not tried: of 40 000 the program takes 41 s."""

_AGAIN: Final = 0.9
"""Part of the blocks, of those before, with which another program is worth its while."""

_BETTER: Final = 1e-3
"""How much stronger, relative, a labelling must have been found for all this to be done again."""

_SHARE: Final = 0.5
"""Part of the time left that the programs may take."""


@dataclass(frozen=True)
class Narrowed:
    """bound: scaled λ that no labelling exceeds. conflicts: one for each block that was ruled out."""

    bound: float
    conflicts: tuple[Conflict, ...]


class Narrowing:
    """Of one space. analyses: of its load cases. blocks: its possible blocks, None where they are not listed. many:
    whether the kernel solves relaxations. wanted: whether it is to be tried at all.
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

    def narrow(self, least: float, most: float, left: float, late: Callable[[], bool]) -> Narrowed:
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
            # made anew for those that are left: what is kept of the others would be most of it
            chosen = np.flatnonzero(self._allowed)
            found = self._relaxation(chosen, end - time.perf_counter())
            said = found.choose(np.ones(len(chosen), dtype=bool), least, most)
            self.solves += found.solves
            most = min(most, least if said.refuted else said.bound)
            out = chosen if said.refuted else chosen[said.useless]
            if not said.refuted:
                self._allowed[out] = False
            conflicts += [one for one in (self._without(p, least) for p in out.tolist()) if len(one.faces)]
            if said.refuted or self._allowed.sum() > _AGAIN * before or not self._allowed.any():
                break
        return Narrowed(most, tuple(conflicts))

    def _relaxation(self, chosen: np.ndarray, seconds: float) -> BlockRelaxation | CaseBlockRelaxation:
        """Of some of the blocks (k,). seconds: that each program may take."""
        assert self._blocks is not None
        members = [self._blocks.members[p] for p in chosen.tolist()]
        inside = [self._blocks.inside[p] for p in chosen.tolist()]
        each = [BlockRelaxation(analysis, members, inside, seconds) for analysis in self._analyses]
        required = self._space.assembly.required.tolist()
        return CaseBlockRelaxation(each, required) if self._space.assembly.cases else each[0]

    def _without(self, p: int, least: float) -> Conflict:
        """No labelling that has block p exceeds a scaled λ."""
        assert self._blocks is not None
        faces, members = self._space.assembly.interfaces, self._blocks.members[p]
        touched = (np.isin(faces.a, members) | np.isin(faces.b, members)) & self._space.candidates
        labels = np.ones(len(touched), dtype=bool)
        labels[list(self._blocks.inside[p])] = False
        where = np.flatnonzero(touched)
        return Conflict(where, labels[where], least)


def _sides_of(space: SearchSpace, blocks: PossibleBlocks) -> int:
    """Faces around all blocks."""
    faces = space.assembly.interfaces
    around = np.bincount(np.concatenate([faces.a, faces.b]), minlength=len(space.assembly.elements))
    pairs = zip(blocks.members, blocks.inside, strict=True)
    return int(sum(around[list(members)].sum() - 2 * len(inside) for members, inside in pairs))
