"""Choose where conflicts are generated: in this process, in its threads, or in workers.

With the batch solver this process uses two threads where two are allowed. Worker processes replace the threads where
more are allowed, or where there is no batch solver.
"""

from __future__ import annotations

from typing import Final

from jld_core.arrays import Bools
from jld_core.limit.case_relaxation import AnyRelaxation
from jld_explore.drivers.exact.conflict_generation import ConflictGenerator
from jld_explore.drivers.exact.cube_workers import CubeWorkers
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.drivers.exact.threaded_generation import ThreadedGenerator
from jld_explore.evaluation.cluster import client_of_cluster
from jld_explore.space import SearchSpace
from jld_explore.space.measures import Range

SOLO_RELAXATIONS: Final = (8000, 1000)
"""Relaxations before worker processes start, with and without the batch solver.

They take about as long as starting the processes.
"""

_THREADS: Final = 2
"""Largest number of threads that generate conflicts in this process.

A third thread draws labellings that are mostly refuted for the same reasons at the same time.
"""

_CLOSING_SECONDS: Final = 0.5
"""Time, s, for which results of the workers are still accepted at the end."""


class ConflictSources:
    """Source of conflicts for one formula after another, in one process or several.

    Parameters
    ----------
    relaxation : Relaxation or CaseRelaxation
        Relaxation of the space.
    space : SearchSpace
        The search space.
    blocks : PossibleBlocks or None
        Possible blocks, where they are listed.
    free : (m,) bool array
        Faces that may take either label.
    seed : int
        Seed of the preferred labels.
    state : ProofState
        State of the proof, to which all results are added.
    solo_relaxations : int or None
        Relaxations before worker processes start. 0: the workers solve from the first relaxation. None: start them
        where they are useful.

    Attributes
    ----------
    solves : int
        Number of relaxations solved by the workers.
    cube_workers : CubeWorkers or None
        The worker processes, None until they start.
    """

    def __init__(
        self,
        relaxation: AnyRelaxation,
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        free: Bools,
        seed: int,
        state: ProofState,
        solo_relaxations: int | None = None,
    ) -> None:
        self._generator = ConflictGenerator(relaxation, free, seed)
        self._relaxation, self._space, self._blocks, self._free, self._seed = relaxation, space, blocks, free, seed
        self._state = state
        self._solo_relaxations = solo_relaxations
        self._jobs, self._workers_allowed, self._on_cluster = 1, False, False
        self.solves = 0
        self._formula: Formula | None = None
        self._count: int | Range | None = None
        self._threads: ThreadedGenerator | None = None
        self.cube_workers: CubeWorkers | None = None

    def set_workers(self, jobs: int) -> None:
        """Set the number of worker processes; a connected cluster contributes all its workers."""
        self._jobs, self._on_cluster = jobs, client_of_cluster() is not None
        self._workers_allowed = jobs > 1 or self._on_cluster
        if jobs > 1 and self._threads is None and self._relaxation.many:
            recipe = self._relaxation, self._space, self._blocks, self._free, self._seed
            self._threads = ThreadedGenerator(*recipe, min(jobs, _THREADS), self._state)

    @property
    def formula(self) -> Formula:
        """Formula of the labellings that are left; raises RuntimeError before `begin`."""
        if self._formula is None:
            raise RuntimeError("there is no formula yet; call `begin` first")
        return self._formula

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Continue with another formula.

        Parameters
        ----------
        formula : Formula
            Formula of the labellings that are left.
        count : int, Range or None
            Count as in `Formula.aim`.
        threshold : float
            Scaled λ to refute.
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
        """Exchange results and tasks with the workers while this process does something else."""
        if self.cube_workers is not None:
            self.cube_workers.exchange()

    def step(self, threshold: float) -> bool:
        """Add the conflicts of a short time to the proof; return whether no labelling is left.

        `threshold` is a scaled λ, at least that of the call before with the same formula.
        """
        formula = self.formula
        if self.cube_workers is None and self._workers_allowed and self._workers_due():
            formula.learn(self._state.conflicts)  # threads add conflicts to formulas of their own only
            self.cube_workers = CubeWorkers(self._space, self._blocks, self._free, self._seed, self._jobs, self._state)
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
        """Generate conflicts in this process; return whether no labelling is left."""
        if self._threads is not None:
            return self._threads.step(threshold)
        batch = self._generator.step(threshold)
        self._state.add_conflicts(batch.conflicts)
        self._state.hand_over(batch.unrefuted)
        return batch.exhausted

    def _workers_due(self) -> bool:
        """Return True if worker processes should start now."""
        if self._solo_relaxations is not None:
            return self._relaxation.solves >= self._solo_relaxations
        others = self._on_cluster or self._jobs > _THREADS or not self._relaxation.many
        return others and self._relaxation.solves >= SOLO_RELAXATIONS[not self._relaxation.many]

    def close(self) -> None:
        """Stop threads and workers, and keep the results that arrive within `_CLOSING_SECONDS` seconds."""
        cube_workers, self.cube_workers = self.cube_workers, None
        self._workers_allowed = False
        if self._threads is not None:
            self._threads.close()
        self._threads = None
        if cube_workers is not None:
            cube_workers.close(_CLOSING_SECONDS)
