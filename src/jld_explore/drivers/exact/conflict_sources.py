"""Who hunts: this process, in two threads where there may be two and the batch solver solves; then a crew of other
processes
in its place, where there may be more, or where there is no batch solver.
"""

from __future__ import annotations

from typing import Final

from jld_core.arrays import Bools
from jld_core.limit import AnyRelaxation
from jld_explore.drivers.exact.conflict_generation import ConflictGenerator
from jld_explore.drivers.exact.cube_workers import CubeWorkers
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.drivers.exact.threaded_generation import ThreadedGenerator
from jld_explore.evaluation import client_of_cluster
from jld_explore.space import Range, SearchSpace

SOLO_RELAXATIONS: Final = (8000, 1000)
"""Relaxations after which others help, with the batch solver and without: about as long as it takes to start them."""

_THREADS: Final = 2
"""Threads of this process that hunt: what a third draws at the same time falls for much the same reasons."""

_LAST: Final = 0.5
"""Seconds in which what others are at is still taken in at the end."""


class ConflictSources:
    """Conflicts of one formula after the other, by one process or several.

    relaxation: of the space. blocks: listed. free: (m,) faces that may take either label. seed: of preferences. state:
    of the proof, to which all that is found is added. alone: relaxations after which other processes help, 0: it is
    left to them from the first; None: where they are of use. `solves`: relaxations that others solved.
    """

    def __init__(
        self,
        relaxation: AnyRelaxation,
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        free: Bools,
        seed: int,
        state: ProofState,
        alone: int | None = None,
    ) -> None:
        self._generator = ConflictGenerator(relaxation, free, seed)
        self._relaxation, self._space, self._blocks, self._free, self._seed = relaxation, space, blocks, free, seed
        self._state = state
        self._alone = alone
        self._jobs, self._helped, self._away = 1, False, False
        self.solves = 0
        self._formula: Formula | None = None
        self._count: int | Range | None = None
        self._threads: ThreadedGenerator | None = None
        self.cube_workers: CubeWorkers | None = None

    def set_workers(self, jobs: int) -> None:
        """How many processes may help; on a cluster its workers do, however many."""
        self._jobs, self._away = jobs, client_of_cluster() is not None
        self._helped = jobs > 1 or self._away
        if jobs > 1 and self._threads is None and self._relaxation.many:
            recipe = self._relaxation, self._space, self._blocks, self._free, self._seed
            self._threads = ThreadedGenerator(*recipe, min(jobs, _THREADS), self._state)

    def begin(self, formula: Formula, count: int | Range | None, threshold: float) -> None:
        """Go on with another formula. count: as `Formula` takes it; threshold: scaled λ."""
        self._formula, self._count = formula, count
        self._generator.begin(formula)
        if self._threads is not None:
            self._threads.begin(count)
        if self.cube_workers is not None:
            self.cube_workers.begin(formula, count, threshold)

    def end(self) -> None:
        """Let go of the formula."""
        self._formula = None
        if self._threads is not None:
            self._threads.end()
        if self.cube_workers is not None:
            self.cube_workers.end()

    def pump(self) -> None:
        """Keep the others at work while this process does something else."""
        if self.cube_workers is not None:
            self.cube_workers.pump()

    def step(self, threshold: float) -> bool:
        """Add a moment's findings to the state of the proof; return whether no labelling is left.

        threshold: scaled λ, not lower than before in this formula.
        """
        assert self._formula is not None
        if self.cube_workers is None and self._helped and self._is_time():
            self._formula.learn(self._state.conflicts)  # threads have told formulas of their own
            self.cube_workers = CubeWorkers(self._space, self._blocks, self._free, self._seed, self._jobs, self._state)
            self.cube_workers.begin(self._formula, self._count, threshold)
        if self.cube_workers is None:
            return self._near(threshold)
        self._formula.rise(threshold)
        self.cube_workers.pump()
        # alone as long as none of the others is there
        if not self.cube_workers.at_work and (self._alone != 0 or not self.cube_workers.expected):
            before = len(self._state.conflicts)
            exhausted = self._near(threshold)
            self._formula.learn(self._state.conflicts[before:])
            closed = self.cube_workers.step(threshold, idle=False)
        else:
            exhausted = False
            if self._threads is not None:
                self._threads.close()
                self._threads = None
                self._formula.learn(self._state.conflicts, self._state.handed_over)
            closed = self.cube_workers.step(threshold, idle=True)
        self.solves = self.cube_workers.solves
        if closed:
            self._formula.learn((), self._state.handed_over)
            if self._formula.next() is None:
                return True
            # what is left of a cube although it was closed is hunted again
            self.cube_workers.begin(self._formula, self._count, threshold)
        return exhausted

    def _near(self, threshold: float) -> bool:
        """Let this process find conflicts; return whether no labelling is left."""
        if self._threads is not None:
            return self._threads.step(threshold)
        caught = self._generator.step(threshold)
        self._state.add_conflicts(caught.conflicts)
        self._state.hand_over(caught.unrefuted)
        return caught.exhausted

    def _is_time(self) -> bool:
        """Whether other processes are of use by now."""
        if self._alone is not None:
            return self._relaxation.solves >= self._alone
        others = self._away or self._jobs > _THREADS or not self._relaxation.many
        return others and self._relaxation.solves >= SOLO_RELAXATIONS[not self._relaxation.many]

    def close(self) -> None:
        """Send the others home; what they had found is kept."""
        cube_workers, self.cube_workers = self.cube_workers, None
        self._helped = False
        if self._threads is not None:
            self._threads.close()
        self._threads = None
        if cube_workers is not None:
            cube_workers.close(_LAST)
