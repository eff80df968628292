"""Generate conflicts in several threads of this process, each with its own formula.

The satisfiability solver and the batch solver release the interpreter lock, so threads draw and minimise labellings
in parallel without waiting. Each thread takes in the conflicts of the others before its next draw. Threads continue
while the main thread has labellings evaluated. Each thread has its own preferred labels, so few conflicts are found
twice. Assigning each thread a half of the labellings, by the face most frequent in recent conflicts, saves none and
makes drawing 20 % slower.

The proof does not depend on the order of the threads. A formula without a model holds only conflicts and handed-over
labellings, and `ProofState` owns both. Which conflicts are found differs from run to run.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import Condition
from typing import Final

from jld_core.arrays import Bools
from jld_core.limit.case_relaxation import AnyRelaxation
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictBatch, ConflictGenerator
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.space import SearchSpace
from jld_explore.space.measures import Range

_PATIENCE: Final = 0.1
"""Longest time, s, that the main thread waits for results before the next deadline check."""


def reached(place: str) -> None:
    """Do nothing; tests put delays here, where threads interact."""


@dataclass
class _Target:
    """Current target of refutation.

    Attributes
    ----------
    count : int, Range or None
        Count as in `Formula.aim`.
    threshold : float
        Scaled λ to refute.
    exhausted : bool
        Whether no labelling is left above the threshold.
    """

    count: int | Range | None
    threshold: float
    exhausted: bool = False


class _GeneratorThread:
    """State of one thread: its conflict generator and its formula."""

    def __init__(self, hunt: ConflictGenerator, state: ProofState) -> None:
        self._generator, self._state = hunt, state
        self._chase: _Target | None = None
        self._formula: Formula | None = None
        self._heard = self._dealt = 0

    def step(self, chase: _Target, space: SearchSpace, blocks: PossibleBlocks | None) -> ConflictBatch:
        """Draw labellings for a target and return their conflicts."""
        if self._formula is None:
            self._formula = Formula(space, blocks)
        if chase is not self._chase:
            self._chase = chase
            self._formula.aim(chase.threshold, chase.count)
            self._generator.begin(self._formula, partial(self._hear, self._formula))
        return self._generator.step(chase.threshold)

    def _hear(self, formula: Formula) -> None:
        """Add the new conflicts and handed-over labellings of all threads to the formula."""
        reached("before hearing")
        news, passed = self._state.conflicts[self._heard :], self._state.handed_over_since(self._dealt)
        self._heard, self._dealt = self._heard + len(news), self._dealt + len(passed)
        formula.learn(news, passed)


class ThreadedGenerator:
    """Threads that generate conflicts and add them to the state of the proof.

    Parameters
    ----------
    relaxation : Relaxation or CaseRelaxation
        Relaxation of the space, solved by the batch solver.
    space : SearchSpace
        The search space.
    blocks : PossibleBlocks or None
        Possible blocks, where they are listed.
    free : (m,) bool array
        Faces that may take either label.
    seed : int
        Seed of the preferred labels.
    threads : int
        Number of threads.
    state : ProofState
        State of the proof; other sources of conflicts may add to the same state.
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
        """Set the count of the next target, as in `Formula.aim`, from the next step on."""
        self.end()
        self._count = count

    def end(self) -> None:
        """Drop the current target; results in progress are still added to the proof."""
        with self._heard:
            self._chase = None

    def step(self, threshold: float) -> bool:
        """Wait briefly for results; return True once no labelling is left that may exceed the threshold.

        `threshold` is a scaled λ that must not decrease between calls for the same target, which `begin` sets. An
        exception of a thread is raised here.
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
        """Stop all threads; results in progress are still added to the proof."""
        self.end()
        self._pool.shutdown(wait=False)

    def _send(self, number: int) -> None:
        """Submit the next task of a thread."""
        # a pool that is shut down, or whose interpreter ends, accepts no task
        with suppress(RuntimeError):
            self._pool.submit(self._turn, number)

    @one_thread()
    def _turn(self, number: int) -> None:
        """Run one step of a thread and submit the next one while there is a target."""
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
        except BaseException as error:  # the main thread raises the error
            with self._heard:
                self._error = error
                self._heard.notify()
        else:
            self._send(number)

    def _hand_over(self, chase: _Target, caught: ConflictBatch) -> None:
        """Add the results of a thread to the state of the proof, whatever the current target."""
        with self._heard:
            threshold = chase.threshold if self._chase is None else self._chase.threshold
            new = self._state.add_conflicts(caught.conflicts, threshold)
            new += self._state.hand_over(caught.unrefuted)
            # Set this flag last: a thread that sees the flag must also see the labellings handed over.
            chase.exhausted |= caught.exhausted
            self._news |= new > 0 or caught.exhausted
            if self._news:
                self._heard.notify()
