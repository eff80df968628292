"""A proof in several threads of this process: each draws labellings from a formula of its own, and shrinks them.

Solver and batch solver hold no lock of the interpreter, so that drawing is shared out as well as shrinking, and nobody
waits
for anybody: what one has found the others take in before their next draw, and they go on while this thread has
labellings evaluated. Each draws by preferences of its own, so that few conflicts are found twice; giving each a half of
the labellings, by the face that conflicts of late are most about, saves none and makes drawing a fifth slower.

What is proven does not depend on who was quicker. A formula without any model holds nothing but conflicts and
labellings that were handed over, and `ProofState` owns both; which conflicts those are differs from run to run.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from threading import Condition
from typing import Final

from jld_core.arrays import Bools
from jld_core.limit import AnyRelaxation
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictBatch, ConflictGenerator
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.space import Range, SearchSpace

_PATIENCE: Final = 0.1
"""Seconds the first thread waits at the most before it looks at the clock again."""


def reached(place: str) -> None:
    """Do nothing; tests put delays here, at the places where a thread's work meets that of others."""


@dataclass
class _Target:
    """What is refuted at present. count: as `Formula` takes it; threshold: scaled λ."""

    count: int | Range | None
    threshold: float
    exhausted: bool = False


class _GeneratorThread:
    """What one thread has of its own: its draws, and a formula."""

    def __init__(self, hunt: ConflictGenerator, state: ProofState) -> None:
        self._generator, self._state = hunt, state
        self._chase: _Target | None = None
        self._formula: Formula | None = None
        self._heard = self._dealt = 0

    def step(self, chase: _Target, space: SearchSpace, blocks: PossibleBlocks | None) -> ConflictBatch:
        """Conflicts of some labellings; exhausted: no labelling is left at all."""
        if self._formula is None:
            self._formula = Formula(space, blocks)
        if chase is not self._chase:
            self._chase = chase
            self._formula.aim(chase.threshold, chase.count)
            self._generator.begin(self._formula, self._hear)
        return self._generator.step(chase.threshold)

    def _hear(self) -> None:
        """Take in what is known by now."""
        assert self._formula is not None
        reached("before hearing")
        news, passed = self._state.conflicts[self._heard :], self._state.handed_over_since(self._dealt)
        self._heard, self._dealt = self._heard + len(news), self._dealt + len(passed)
        self._formula.learn(news, passed)


class ThreadedGenerator:
    """Threads that find conflicts together; what they find goes to the state of the proof at once.

    relaxation, space, blocks, free, seed: of the proof; the batch solver solves many at once. threads: how many. state:
    of
    the proof, which other ways to find conflicts may add to as well.
    """

    def __init__(
        self,
        relaxation: AnyRelaxation,
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        free: Bools,
        seed: int,
        threads: int,
        state: ProofState,
    ) -> None:
        self._recipe = space, blocks
        self._state = state
        hunts = [ConflictGenerator(relaxation, free, seed + 1000 * number) for number in range(threads)]
        self._members = [_GeneratorThread(hunt, state) for hunt in hunts]
        self._pool = ThreadPoolExecutor(threads)
        self._idle = set(range(threads))
        self._chase: _Target | None = None
        self._count: int | Range | None = None
        self._news = False
        self._heard = Condition()
        self._error: BaseException | None = None

    def begin(self, count: int | Range | None) -> None:
        """Another formula is to be refuted, from the next step on. count: as `Formula` takes it."""
        self.end()
        self._count = count

    def end(self) -> None:
        """Give up what is hunted; what is found meanwhile is kept in the state of the proof."""
        with self._heard:
            self._chase = None

    def step(self, threshold: float) -> bool:
        """Wait until something is found, a moment at the most; return whether no labelling is left.

        threshold: scaled λ, not lower than before in this formula.
        """
        with self._heard:
            if self._chase is None:
                self._chase = _Target(self._count, threshold)
            self._chase.threshold = threshold
            while self._idle and not self._chase.exhausted:
                self._send(self._idle.pop())
            if not (self._news or self._chase.exhausted or self._error):
                self._heard.wait(_PATIENCE)
            self._news = False
            if self._error is not None:
                raise self._error
            return self._chase.exhausted

    def close(self) -> None:
        """Let all threads go; what each is at is still kept in the state of the proof."""
        self.end()
        self._pool.shutdown(wait=False)

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
            caught = member.step(chase, *self._recipe)
            reached("before handing over")
            self._hand_over(chase, caught)
        except BaseException as error:  # the first thread's to raise
            with self._heard:
                self._error = error
                self._heard.notify()
        else:
            self._send(number)

    def _hand_over(self, chase: _Target, caught: ConflictBatch) -> None:
        """Give what a thread has found to the state of the proof, whatever is hunted by now."""
        with self._heard:
            threshold = chase.threshold if self._chase is None else self._chase.threshold
            new = self._state.add_conflicts(caught.conflicts, threshold)
            new += self._state.hand_over(caught.unrefuted)
            # last: whoever sees that nothing is left must see what was handed over
            chase.exhausted |= caught.exhausted
            self._news |= new > 0 or caught.exhausted
            if self._news:
                self._heard.notify()
