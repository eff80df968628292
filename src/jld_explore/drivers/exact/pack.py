"""A proof in several threads of this process: each draws labellings from a formula of its own, and shrinks them.

Solver and kernel hold no lock of the interpreter, so that drawing is shared out as well as shrinking, and nobody waits
for anybody: what one has found the others take in before their next draw, and they go on while this thread has
labellings evaluated. Threads that draw at a time would find the same conflicts: each looks where the face that
conflicts of late are most about has another label, as long as there is anything left.

What is proven does not depend on who was quicker. A formula without any model holds nothing but conflicts, labellings
that were handed over and halves of it that were empty; which conflicts those are differs from run to run.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from threading import Condition
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflicts import Conflicts
from jld_explore.drivers.exact.cubes import EVERYTHING, Cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.hunting import Catch, Hunt
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.shrinking import AnyRelaxation, Conflict
from jld_explore.space import Range, SearchSpace

_PATIENCE: Final = 0.1
"""Seconds the first thread waits at the most before it looks at the clock again."""

_FADING: Final = 0.999
"""What a face's weight in conflicts is multiplied by at each conflict after."""


class _Chase:
    """What the threads share while one formula is refuted. count: as `Formula` takes it; threshold: scaled λ.

    conflicts, passed: what each is to take in, those that were known before first. weight: (m,) of faces.
    """

    def __init__(
        self, known: Sequence[Conflict], passed: Sequence[Bits], count: int | Range | None, threshold: float, faces: int
    ) -> None:
        self.conflicts, self.passed = list(known), list(passed)
        self.count, self.threshold = count, threshold
        self.names: set[tuple[bytes, bytes]] = set()
        self.weight, self._gain = np.zeros(faces), 1.0
        self.exhausted = False

    def is_new(self, conflict: Conflict) -> bool:
        """Whether nobody has found a conflict before; its faces weigh more from now on."""
        name = conflict.faces.tobytes(), conflict.labels.tobytes()
        if name in self.names:
            return False
        self.names.add(name)
        self.conflicts.append(conflict)
        self._gain /= _FADING
        self.weight[conflict.faces] += self._gain
        if self._gain > 1e100:
            self.weight /= self._gain
            self._gain = 1.0
        return True


class _Member:
    """What one thread has of its own: its draws, and its formula of the present chase. number: of the thread."""

    def __init__(self, hunt: Hunt, number: int) -> None:
        self._hunt, self._dry = hunt, number % 2 == 0
        self._chase: _Chase | None = None
        self._formula: Formula | None = None
        self._heard = self._dealt = 0
        self._closed: set[int] = set()
        self._cube = EVERYTHING

    def step(self, chase: _Chase, space: SearchSpace, blocks: PossibleBlocks | None, free: Bools) -> Catch:
        """Conflicts of some labellings; exhausted: no labelling is left at all."""
        if chase is not self._chase:
            self.leave()
            self._chase, self._formula = chase, Formula(space, blocks, chase.count)
            self._heard = self._dealt = 0
            self._closed, self._cube = set(), EVERYTHING
            self._hunt.begin(self._formula, self._hear)
        assert self._formula is not None
        caught = self._hunt.step(chase.threshold, self._cube)
        if caught.exhausted and self._cube is not EVERYTHING:
            # nothing is left there: all faces, once, before another half is looked at
            self._formula.forbid(self._cube.faces, self._cube.labels)
            self._closed.update(self._cube.faces)
            self._cube, caught.exhausted = EVERYTHING, False
        else:
            self._cube = self._half(chase, free)
        return caught

    def leave(self) -> None:
        """Free the formula."""
        if self._formula is not None:
            self._formula.close()
        self._chase = self._formula = None

    def _hear(self) -> None:
        """Take in what is known by now."""
        assert self._chase is not None
        assert self._formula is not None
        chase = self._chase
        news, passed = chase.conflicts[self._heard :], chase.passed[self._dealt :]
        self._heard, self._dealt = self._heard + len(news), self._dealt + len(passed)
        for conflict in news:
            if conflict.bound <= chase.threshold and not self._hunt.knows(conflict):
                self._formula.forbid(conflict.faces, conflict.labels)
        for labels in passed:
            self._formula.forbid(np.arange(len(labels)), labels)

    def _half(self, chase: _Chase, free: Bools) -> Cube:
        """Where to look next: a label of the weightiest face."""
        weight = np.where(free, chase.weight, 0.0)
        weight[list(self._closed)] = 0.0
        face = int(weight.argmax())
        return Cube((face,), (self._dry,)) if weight[face] > 0.0 else EVERYTHING


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
        self._recipe = space, blocks, free
        self._known, self._passed = known, passed
        hunts = [Hunt(relaxation, free, seed + 1000 * number) for number in range(threads)]
        self._members = [_Member(hunt, number) for number, hunt in enumerate(hunts)]
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
                known = [*self._known, *self._caught.conflicts]
                self._chase = _Chase(known, self._passed, self._count, threshold, len(self._recipe[2]))
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
                member.leave()
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
            last = self._chase or chase
            self._caught.conflicts += [conflict for conflict in caught.conflicts if last.is_new(conflict)]
            if chase is self._chase:
                self._caught.unrefuted += caught.unrefuted
                chase.passed += caught.unrefuted
                chase.exhausted |= caught.exhausted
            if self._caught.conflicts or self._caught.unrefuted or caught.exhausted:
                self._heard.notify()
