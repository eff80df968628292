"""Choose where conflicts are generated: in this process, in its threads, or in workers.

With the batch solver this process uses two threads where two are allowed. Worker processes replace the threads where
more are allowed, or where there is no batch solver.

The satisfiability solver and the batch solver release the interpreter lock, so threads draw and minimise labellings in
parallel without waiting. Each thread has its own formula and its own preferred labels, and takes in the conflicts of
the others before its next draw. Threads continue while the main thread has labellings evaluated. Assigning each thread
a half of the labellings, by the face most frequent in recent conflicts, saves none and makes drawing 20 % slower.

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

from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import ConflictBatch, ConflictGenerator
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.cube_workers import CubeWorkers
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.space.measures import Range

_WAIT_SECONDS: Final = 0.1  # longest time, s, that the main thread waits for results before the next deadline check


def delay_point(place: str) -> None:
    """Do nothing; tests replace this function to delay threads where they interact."""


@dataclass
class _Target:
    """Current target of refutation.

    count: count as in `Formula.aim`. threshold: scaled λ to refute. exhausted: whether no labelling is left above the
    threshold.
    """

    count: int | Range | None
    threshold: float
    exhausted: bool = False


class _GeneratorThread:
    """State of one thread: its conflict generator and its formula."""

    def __init__(self, generator: ConflictGenerator, state: ProofState) -> None:
        self._generator, self._state = generator, state
        self._target: _Target | None = None
        self._formula: Formula | None = None
        self._conflicts_seen = self._handed_over_seen = 0

    def step(self, target: _Target, context: ProofContext) -> ConflictBatch:
        """Draw labellings for a target and return their conflicts."""
        if self._formula is None:
            self._formula = Formula(context.space, context.blocks)
        if target is not self._target:
            self._target = target
            self._formula.aim(target.threshold, target.count)
            self._generator.begin(self._formula, partial(self._take_in_others, self._formula))
        return self._generator.step(target.threshold)

    def _take_in_others(self, formula: Formula) -> None:
        """Add the new conflicts and handed-over labellings of all threads to the formula."""
        delay_point("before taking in conflicts")
        new_conflicts, handed_over = (
            self._state.conflicts[self._conflicts_seen :],
            self._state.handed_over_since(self._handed_over_seen),
        )
        self._conflicts_seen, self._handed_over_seen = (
            self._conflicts_seen + len(new_conflicts),
            self._handed_over_seen + len(handed_over),
        )
        formula.learn(new_conflicts, handed_over)


class ThreadedGenerator:
    """Threads that generate conflicts and add them to the state of the proof.

    Call `begin` for a target, `step` until it returns True, and `close` at the end.

    context: data that stay fixed during the proof; the batch solver solves its relaxation. threads: number of threads.
    state: state of the proof; other sources of conflicts may add to the same state.
    """

    def __init__(self, context: ProofContext, threads: int, state: ProofState) -> None:
        self._context, self._state = context, state
        self._threads = [_GeneratorThread(ConflictGenerator(context, number), state) for number in range(threads)]
        self._pool = ThreadPoolExecutor(threads)
        self._idle_threads = set(range(threads))
        self._target: _Target | None = None
        self._count: int | Range | None = None
        self._has_new_results = False
        self._results_changed = Condition()
        self._error: BaseException | None = None

    def begin(self, count: int | Range | None) -> None:
        """Set the count of the next target, which takes effect from the next step on.

        count: as in `Formula.aim`.
        """
        self.end()
        self._count = count

    def end(self) -> None:
        """Drop the current target; results in progress are still added to the proof."""
        with self._results_changed:
            self._target = None

    def step(self, threshold: float) -> bool:
        """Wait briefly for results of the threads, and start those that are idle.

        Returns True once no labelling is left that may exceed the threshold. `threshold` is a scaled λ that must not
        decrease between calls for the same target, which `begin` sets. An exception of a thread is raised here.
        """
        with self._results_changed:
            if self._target is None:
                self._target = _Target(self._count, threshold)
            self._target.threshold = threshold
            while self._idle_threads and not self._target.exhausted:
                self._submit_step(self._idle_threads.pop())
            if not (self._has_new_results or self._target.exhausted or self._error):
                self._results_changed.wait(_WAIT_SECONDS)
            self._has_new_results = False
            if self._error is not None:
                raise self._error
            return self._target.exhausted

    def close(self) -> None:
        """Stop all threads; results in progress are still added to the proof."""
        self.end()
        self._pool.shutdown(wait=False)

    def _submit_step(self, number: int) -> None:
        """Submit the next task of a thread."""
        # a pool that is shut down, or whose interpreter ends, accepts no task
        with suppress(RuntimeError):
            self._pool.submit(self._run_step, number)

    @one_thread()
    def _run_step(self, number: int) -> None:
        """Run one step of a thread and submit the next one while there is a target."""
        thread = self._threads[number]
        with self._results_changed:
            target = self._target
            if target is None or target.exhausted:
                self._idle_threads.add(number)
                return
        try:
            batch = thread.step(target, self._context)
            delay_point("before handing over")
            self._hand_over(target, batch)
        except BaseException as error:  # the main thread raises the error
            with self._results_changed:
                self._error = error
                self._results_changed.notify()
        else:
            self._submit_step(number)

    def _hand_over(self, target: _Target, batch: ConflictBatch) -> None:
        """Add the results of a thread to the state of the proof, whatever the current target."""
        with self._results_changed:
            threshold = target.threshold if self._target is None else self._target.threshold
            new = self._state.add_conflicts(batch.conflicts, threshold)
            new += self._state.hand_over(batch.unrefuted)
            # Set this flag last: a thread that sees the flag must also see the labellings handed over.
            target.exhausted |= batch.exhausted
            self._has_new_results |= new > 0 or batch.exhausted
            if self._has_new_results:
                self._results_changed.notify()


SOLO_RELAXATIONS: Final = (8000, 1000)
"""Relaxations before worker processes start, with and without the batch solver.

They take about as long as starting the processes.
"""

# Largest number of threads that generate conflicts in this process. A third thread draws labellings that are mostly
# refuted for the same reasons at the same time.
_THREADS: Final = 2

_CLOSING_SECONDS: Final = 0.5  # time, s, for which results of the workers are still accepted at the end


class ConflictSources:
    """Source of conflicts for one formula after another, in one process or several.

    Call `begin` with a formula, `step` until it returns True, and `close` at the end. A formula describes the
    labellings that no conflict refutes yet.

    context: space, relaxation and other data that stay fixed during the proof. state: state of the proof, to which all
    results are added. solo_relaxations: relaxations before worker processes start. 0: the workers solve from the first
    relaxation. None: start them where they are useful. solves: number of relaxations solved by the workers.
    cube_workers: the worker processes, None until they start.
    """

    def __init__(self, context: ProofContext, state: ProofState, solo_relaxations: int | None = None) -> None:
        self._generator = ConflictGenerator(context)
        self._context = context
        self._state = state
        self._solo_relaxations = solo_relaxations
        self._jobs, self._workers_allowed, self._on_cluster = 1, False, False
        self.solves = 0
        self._formula: Formula | None = None
        self._count: int | Range | None = None
        self._threads: ThreadedGenerator | None = None
        self.cube_workers: CubeWorkers | None = None

    def set_workers(self, jobs: int) -> None:
        """Set the number of worker processes; a connected cluster contributes all its workers.

        Workers start in `step`, once the proof is long enough; a second thread is made at once where it helps.
        """
        self._jobs, self._on_cluster = jobs, client_of_cluster() is not None
        self._workers_allowed = jobs > 1 or self._on_cluster
        if jobs > 1 and self._threads is None and self._context.relaxation.batched:
            self._threads = ThreadedGenerator(self._context, min(jobs, _THREADS), self._state)

    @property
    def formula(self) -> Formula:
        """Formula of the labellings that are left; raises RuntimeError before `begin`."""
        if self._formula is None:
            raise RuntimeError("there is no formula yet; call `begin` first")
        return self._formula

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Continue with another formula.

        formula: formula of the labellings that are left. count: count as in `Formula.aim`. threshold: scaled λ to
        refute.
        """
        self._formula, self._count = formula, count
        self._generator.begin(formula)
        if self._threads is not None:
            self._threads.begin(count)
        if self.cube_workers is not None:
            self.cube_workers.begin(formula, count, threshold)

    def end(self) -> None:
        """Drop the formula and stop generating conflicts for it."""
        self._formula = None
        if self._threads is not None:
            self._threads.end()
        if self.cube_workers is not None:
            self.cube_workers.end()

    def exchange(self) -> None:
        """Collect results of the workers and send them new tasks, without waiting.

        Call it while this process does something else; without workers it does nothing.
        """
        if self.cube_workers is not None:
            self.cube_workers.exchange()

    def step(self, threshold: float) -> bool:
        """Add the conflicts of a short time to the proof; return True if no labelling is left.

        `threshold` is a scaled λ, at least that of the call before with the same formula.
        """
        formula = self.formula
        if self.cube_workers is None and self._workers_allowed and self._workers_due():
            formula.learn(self._state.conflicts)  # threads add conflicts to formulas of their own only
            self.cube_workers = CubeWorkers(self._context, self._jobs, self._state)
            self.cube_workers.begin(formula, self._count, threshold)
        if self.cube_workers is None:
            return self._generate_here(threshold)
        formula.raise_threshold(threshold)
        self.cube_workers.exchange()
        # this process also generates conflicts until a worker has started
        if not self.cube_workers.started and (self._solo_relaxations != 0 or not self.cube_workers.has_workers):
            before = len(self._state.conflicts)
            exhausted = self._generate_here(threshold)
            formula.learn(self._state.conflicts[before:])
            closed = self.cube_workers.step(threshold, wait_for_results=False)
        else:
            exhausted = False
            if self._threads is not None:
                self._threads.close()
                self._threads = None
                formula.learn(self._state.conflicts, self._state.handed_over)
            closed = self.cube_workers.step(threshold, wait_for_results=True)
        self.solves = self.cube_workers.solves
        if closed:
            formula.learn((), self._state.handed_over)
            if formula.next() is None:
                return True
            # labellings left although their cube was closed are assigned again
            self.cube_workers.begin(formula, self._count, threshold)
        return exhausted

    def _generate_here(self, threshold: float) -> bool:
        """Generate conflicts in this process or its threads; return True if no labelling is left.

        threshold: scaled λ. Results are added to the state of the proof.
        """
        if self._threads is not None:
            return self._threads.step(threshold)
        batch = self._generator.step(threshold)
        self._state.add_conflicts(batch.conflicts)
        self._state.hand_over(batch.unrefuted)
        return batch.exhausted

    def _workers_due(self) -> bool:
        """Return True if worker processes should start now."""
        if self._solo_relaxations is not None:
            return self._context.relaxation.solves >= self._solo_relaxations
        others = self._on_cluster or self._jobs > _THREADS or not self._context.relaxation.batched
        return others and self._context.relaxation.solves >= SOLO_RELAXATIONS[not self._context.relaxation.batched]

    def close(self) -> None:
        """Stop threads and workers; keep results that arrive within `_CLOSING_SECONDS`."""
        cube_workers, self.cube_workers = self.cube_workers, None
        self._workers_allowed = False
        if self._threads is not None:
            self._threads.close()
        self._threads = None
        if cube_workers is not None:
            cube_workers.close(_CLOSING_SECONDS)
