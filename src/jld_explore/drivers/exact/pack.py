"""A proof in several threads of this process: each draws labellings from a formula of its own, and shrinks them.

Solver and kernel hold no lock of the interpreter, so that drawing is shared out as well as shrinking, and nobody waits
for anybody: what one has found the others take in before their next draw, and they go on while this thread has
labellings evaluated. Each draws by preferences of its own, so that few conflicts are found twice; giving each a half of
the labellings, by the face that conflicts of late are most about, saves none and makes drawing a fifth slower.

What is proven does not depend on who was quicker. A formula without any model holds nothing but conflicts and
labellings that were handed over; which conflicts those are differs from run to run.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from threading import Condition
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.limit import AnyRelaxation
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflicts import Conflicts, LeastBounds
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.hunting import Catch, Hunt
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.shrinking import Conflict
from jld_explore.space import Range, SearchSpace

_PATIENCE: Final = 0.1
"""Seconds the first thread waits at the most before it looks at the clock again."""


class _Known:
    """What all threads are told: conflicts, with smaller bounds as they are found, and labellings dealt with."""

    def __init__(self) -> None:
        self.conflicts: list[Conflict] = []
        self.passed: list[Bits] = []
        self._bounds = LeastBounds()

    def add(self, conflict: Conflict, threshold: float) -> bool:
        """Take a conflict, unless that is known which rules out the same above a threshold; whether it was not."""
        new = self._bounds.lowered(conflict, threshold)
        if new:
            self.conflicts.append(conflict)
        return new


@dataclass
class _Chase:
    """What is refuted at present. count: as `Formula` takes it; threshold: scaled λ."""

    count: int | Range | None
    threshold: float
    exhausted: bool = False


class _Member:
    """What one thread has of its own: its draws, and a formula."""

    def __init__(self, hunt: Hunt, known: _Known) -> None:
        self._hunt, self._known = hunt, known
        self._chase: _Chase | None = None
        self._formula: Formula | None = None
        self._heard = self._dealt = 0

    def step(self, chase: _Chase, space: SearchSpace, blocks: PossibleBlocks | None) -> Catch:
        """Conflicts of some labellings; exhausted: no labelling is left at all."""
        if self._formula is None:
            self._formula = Formula(space, blocks)
        if chase is not self._chase:
            self._chase = chase
            self._formula.aim(chase.threshold, chase.count)
            self._hunt.begin(self._formula, self._hear)
        return self._hunt.step(chase.threshold)

    def _hear(self) -> None:
        """Take in what is known by now."""
        assert self._formula is not None
        news, passed = self._known.conflicts[self._heard :], self._known.passed[self._dealt :]
        self._heard, self._dealt = self._heard + len(news), self._dealt + len(passed)
        self._formula.learn(news, passed)


class Pack:
    """Threads that hunt together. relaxation, space, blocks, free, seed: of the proof; the kernel solves many at once.

    known, passed: the proof's conflicts and labellings that are dealt with, to which whoever steps adds.
    """

    def __init__(
        self,
        relaxation: AnyRelaxation,
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        free: Bools,
        seed: int,
        threads: int,
        known: Conflicts,
        passed: Sequence[Bits],
    ) -> None:
        self._recipe = space, blocks
        self._of_proof, self._said = (known, passed), (0, 0)
        self._known = _Known()
        hunts = [Hunt(relaxation, free, seed + 1000 * number) for number in range(threads)]
        self._members = [_Member(hunt, self._known) for hunt in hunts]
        self._pool = ThreadPoolExecutor(threads)
        self._idle = set(range(threads))
        self._chase: _Chase | None = None
        self._count: int | Range | None = None
        self._caught = Catch()
        self._heard = Condition()
        self._error: BaseException | None = None

    def begin(self, count: int | Range | None) -> None:
        """Another formula is to be refuted, from the next step on. count: as `Formula` takes it."""
        self.end()
        self._count = count

    def end(self) -> None:
        """Give up what is hunted; conflicts that were found meanwhile are handed over at the next step."""
        with self._heard:
            self._chase, self._caught.unrefuted = None, []

    def step(self, threshold: float) -> Catch:
        """What was found since the last time, a moment's wait at the most. threshold: scaled λ, not lower than before
        in this formula."""
        with self._heard:
            if self._chase is None:
                self._take_in()
                self._chase = _Chase(self._count, threshold)
            self._chase.threshold = threshold
            while self._idle and not self._chase.exhausted:
                self._send(self._idle.pop())
            if not (self._caught.conflicts or self._caught.unrefuted or self._chase.exhausted or self._error):
                self._heard.wait(_PATIENCE)
            if self._error is not None:
                raise self._error
            caught, self._caught = self._caught, Catch()
            # what nothing refutes is dealt with first
            caught.exhausted = self._chase.exhausted and not caught.unrefuted
            return caught

    def close(self) -> Catch:
        """Let all go, and return what was found meanwhile."""
        self.end()
        self._pool.shutdown(wait=False)
        with self._heard:
            caught, self._caught = self._caught, Catch()
            return caught

    def _take_in(self) -> None:
        """Tell all what the proof knows by other ways."""
        known, passed = self._of_proof
        for conflict in known[self._said[0] :]:
            self._known.add(conflict, -np.inf)
        self._known.passed += passed[self._said[1] :]
        self._said = len(known), len(passed)

    def _send(self, number: int) -> None:
        # once the interpreter ends, or all are let go, no task is taken any more
        with suppress(RuntimeError):
            self._pool.submit(self._turn, number)

    @one_thread()
    def _turn(self, number: int) -> None:
        """A step of one thread, and another after it, as long as there is something to hunt."""
        member = self._members[number]
        with self._heard:
            chase = self._chase
            if chase is None or chase.exhausted:
                self._idle.add(number)
                return
        try:
            self._hand_over(chase, member.step(chase, *self._recipe))
        except BaseException as error:  # the first thread's to raise
            with self._heard:
                self._error = error
                self._heard.notify()
        else:
            self._send(number)

    def _hand_over(self, chase: _Chase, caught: Catch) -> None:
        with self._heard:
            threshold = chase.threshold if self._chase is None else self._chase.threshold
            self._caught.conflicts += [one for one in caught.conflicts if self._known.add(one, threshold)]
            if chase is self._chase:
                self._caught.unrefuted += caught.unrefuted
                self._known.passed += caught.unrefuted
                chase.exhausted |= caught.exhausted
            if self._caught.conflicts or self._caught.unrefuted or caught.exhausted:
                self._heard.notify()
