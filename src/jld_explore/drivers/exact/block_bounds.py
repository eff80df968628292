"""Bounds by block relaxations: several at a time for the tree, and one over all blocks for any long proof."""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import cloudpickle
import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_relaxation import BlockRequest, Choice, applies_to
from jld_core.limit.case_relaxation import AnyBlockRelaxation, block_relaxation_of
from jld_core.threads import one_thread
from jld_explore.drivers.exact.context import BlockTables, CheckedProof, PossibleBlocks, ProofContext
from jld_explore.drivers.exact.proof_state import BlockEvidence, Conflict, Evidence
from jld_explore.evaluation.pool import LOST, WorkerPool, client_of_cluster, done_in
from jld_explore.space.search_space import SearchSpace

SolvedProgram = tuple[Choice, int]  # result of one block relaxation, and the number of programs solved for it


@dataclass(frozen=True)
class BlockSpace:
    """Search space and possible blocks, as sent to a worker process."""

    space: SearchSpace
    blocks: PossibleBlocks

    def relaxation(
        self, analyses: Sequence[LimitAnalysis] = (), seconds: float = math.inf, caps: Sequence[Floats | None] = ()
    ) -> AnyBlockRelaxation:
        """Make the block relaxation of the space, which bounds λ over choices of blocks; caps (m,) of each case."""
        members, inside = self.blocks.members, self.blocks.inside
        return block_relaxation_of(self.space.assembly, members, inside, analyses, seconds, caps)


@one_thread()
def bound_blocks(block_space: bytes, program: BlockRequest) -> SolvedProgram:
    """Solve a block relaxation in this worker process, with the number of programs."""
    unpacked: BlockSpace = pickle.loads(block_space)
    relaxation = unpacked.relaxation()
    return relaxation.choose(*program), relaxation.solves


class BlockBoundPool:
    """Block relaxation of a space; the batch solver may use a second thread."""

    def __init__(self, context: ProofContext, blocks: PossibleBlocks) -> None:
        # each program is solved from scratch, so that trees do not depend on threads
        self._relaxation = BlockSpace(context.space, blocks).relaxation(context.analyses)
        self._two_threads = False
        self._threads: ThreadPoolExecutor | None = None

    @property
    def solves(self) -> int:
        return self._relaxation.solves

    def set_workers(self, jobs: int) -> None:
        """Allow a second thread if `jobs` exceeds 1 or a cluster is connected."""
        self._two_threads = jobs > 1 or client_of_cluster() is not None

    def close(self) -> None:
        self._two_threads = False
        if self._threads is not None:
            self._threads.shutdown()
            self._threads = None

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """Solve one block relaxation of allowed blocks (p,) in this process."""
        return self._relaxation.bound_all([(allowed, threshold, most)])[0]

    @property
    def batched(self) -> bool:
        """True if the batch solver solves many programs in one call."""
        return self._relaxation.batched

    def bound_all(self, programs: Sequence[BlockRequest]) -> list[Choice]:
        """Solve block relaxations (allowed (p,), threshold, most), and return their results in order."""
        if self._relaxation.batched and self._two_threads and self._threads is None:
            self._threads = ThreadPoolExecutor(1)
        return self._relaxation.bound_all(programs, self._threads)


# Relaxations face by face that take as long as the program takes per side of a block, times the number of faces. The
# first value applies with the batch solver, the second without it. The program takes 1 ms per side, eight of them in
# the batch solver 0.25 ms, a relaxation of 60 faces there 0.04 ms and of 291 faces 0.3 ms.
_RELAXATIONS: Final = (300.0, 15.0)
_MOST_SIDES: Final = 100_000  # largest number of sides of blocks; the program of 74 000 sides takes 60 s and 1.2 GB

# Largest number of sides for which this process solves the program. Such a program takes at most two seconds, as long
# as another process needs to start.
_SIDES_HERE: Final = 2000

# Interval, s, at which the deadline is checked while another process solves the program
_DEADLINE_CHECK_SECONDS: Final = 0.2
_REMAINING_SHARE: Final = 0.9  # largest share of the blocks that may remain for another program
_INCREASE: Final = 1e-3  # relative increase of the best known λ after which the programs are solved again
_BACKOFF: Final = 4.0  # factor on the number of relaxations to wait for after each round
_TIME_SHARE: Final = 0.5  # share of the remaining time that the programs may take


@dataclass(frozen=True)
class TightenedBound:
    """Bound on scaled λ of all labellings, with the conflicts of refuted blocks."""

    bound: float  # scaled λ that no labelling exceeds
    conflicts: tuple[Conflict, ...]  # one conflict for each refuted block
    # mechanisms of all programs so far, which prove the bound
    proof: tuple[BlockEvidence, ...] = field(default=(), compare=False, repr=False)


class BlockBoundTightening:
    """Repeated block relaxation of one space without the blocks that are refuted."""

    def __init__(self, context: ProofContext, *, wanted: bool) -> None:
        # docs/method.md (6.5); a program takes as long as thousands of relaxations face by face, so a proof solves it
        # only after as much time. Each refuted block is a conflict: inner inside, dry around.
        self._context, self._blocks = context, context.blocks
        blocks, space = context.blocks, context.space
        self._allowed: Bools = np.ones(0 if blocks is None else len(blocks), dtype=bool)
        self._sides = 0 if blocks is None else sides_of(space, blocks)
        usable = (
            wanted and blocks is not None and 0 < self._sides <= _MOST_SIDES and all(map(applies_to, context.analyses))
        )
        relaxations_per_side = _RELAXATIONS[not context.relaxation.batched] / len(space.fixed)
        self._next = relaxations_per_side * self._sides if usable else math.inf
        self._target: float | None = None
        self._proof: tuple[BlockEvidence, ...] = ()
        self.solves = 0

    @property
    def _listed_blocks(self) -> PossibleBlocks:
        if self._blocks is None:
            raise RuntimeError("the possible blocks are not listed, so their bounds cannot be tightened")
        return self._blocks

    def disable(self) -> None:
        """Disable the tightening from now on: `is_due` is then always False."""
        self._next = math.inf

    def is_due(self, relaxations: int, best: float) -> bool:
        last = self._target
        return relaxations >= self._next and (last is None or best > last + _INCREASE * abs(last))

    def tighten(
        self, target: float, bound: float, seconds_left: float, time_is_up: Callable[[], bool]
    ) -> TightenedBound:
        """Solve relaxations without refuted blocks until few more are refuted or time ends.

        target, bound: scaled λ up to which labellings are refuted, and that none exceeds.
        """
        self._next *= _BACKOFF
        self._target = target
        end = time.perf_counter() + _TIME_SHARE * seconds_left
        conflicts: list[Conflict] = []
        while not time_is_up() and time.perf_counter() < end:
            remaining = np.flatnonzero(self._allowed)
            choice = self._solve(remaining, (target, bound), end - time.perf_counter(), time_is_up)
            if choice is None:
                break
            self._proof += tuple(BlockEvidence(mechanism, remaining) for mechanism in choice.mechanisms)
            bound = min(bound, target if choice.refuted else choice.bound)
            refuted = remaining if choice.refuted else remaining[choice.useless]
            if not choice.refuted:
                self._allowed[refuted] = False
            of_blocks = (self._conflict_of_block(p, target) for p in refuted.tolist())
            conflicts += [conflict for conflict in of_blocks if len(conflict.faces)]
            if choice.refuted or self._allowed.sum() > _REMAINING_SHARE * len(remaining) or not self._allowed.any():
                break
        return TightenedBound(bound, tuple(conflicts), self._proof)

    def _solve(
        self, remaining: Ints, ends: tuple[float, float], seconds: float, time_is_up: Callable[[], bool]
    ) -> Choice | None:
        """Solve the relaxation of blocks `remaining` (k,); None if time runs out or the worker fails."""
        listed, chosen = self._listed_blocks, remaining.tolist()
        remaining_blocks = PossibleBlocks(
            tuple(listed.members[p] for p in chosen), tuple(listed.inside[p] for p in chosen)
        )
        block_space = BlockSpace(self._context.space, remaining_blocks)
        program = np.ones(len(remaining), dtype=bool), *ends
        if self._sides <= _SIDES_HERE:
            relaxation = block_space.relaxation(self._context.analyses, seconds)
            choice = relaxation.choose(*program)
            self.solves += relaxation.solves
            return choice
        workers = WorkerPool(1)
        try:
            worker = workers.first()
            if worker is None:
                return None
            future = workers.submit(worker, bound_blocks, cloudpickle.dumps(block_space), program)
            if future is None:
                return None
            end = time.perf_counter() + seconds
            while not done_in([future], _DEADLINE_CHECK_SECONDS):
                if time_is_up() or time.perf_counter() > end:
                    return None
            result = workers.result(worker, future)
        finally:
            workers.close()
        if result is None or result is LOST:  # if the process is killed only this bound is lost
            return None
        self.solves += result[1]
        return result[0]

    def _conflict_of_block(self, p: int, bound: float) -> Conflict:
        """Return the conflict of the labels that make p a block, which keep scaled λ at `bound`."""
        faces, members = self._context.space.assembly.interfaces, self._listed_blocks.members[p]
        touched = (np.isin(faces.a, members) | np.isin(faces.b, members)) & self._context.space.candidates
        labels = np.ones(len(touched), dtype=bool)
        labels[list(self._listed_blocks.inside[p])] = False
        where = np.flatnonzero(touched)
        return Conflict(where, labels[where], bound, Evidence.BLOCKS, by_blocks=self._proof)


def sides_of(space: SearchSpace, blocks: PossibleBlocks) -> int:
    """Return the number of faces on the edges of blocks, summed over all blocks."""
    faces = space.assembly.interfaces
    around = np.bincount(np.concatenate([faces.a, faces.b]), minlength=len(space.assembly.elements))
    pairs = zip(blocks.members, blocks.inside, strict=True)
    return int(sum(around[list(members)].sum() - 2 * len(inside) for members, inside in pairs))


class BlockConflictCheck:
    def __init__(self, context: CheckedProof) -> None:
        self._context = context
        self.done = 0

    def refute_again(self, conflicts: Sequence[Conflict], end: float) -> str:
        """Refute conflicts of possible blocks again, in random order, until a time; "" or a problem."""
        # Conflicts that the time does not suffice for stay unchecked; `done` counts the others. Without listed blocks,
        # or without a bound on all labellings, nothing is checked.
        of_blocks = [conflict for conflict in conflicts if conflict.evidence is Evidence.BLOCKS]
        if not of_blocks or self._context.blocks is None or time.perf_counter() >= end:
            return ""
        bound_of_all = self._context.relaxation.least_bound(self._context.labels, self._context.free)
        if bound_of_all is None:
            return ""
        check = _BlockRefutation(self._context, self._context.blocks, bound_of_all.bound, end)
        unfinished = []
        for k in np.random.default_rng(len(of_blocks)).permutation(len(of_blocks)).tolist():
            if time.perf_counter() >= end:
                return ""
            if check.by_mechanisms(of_blocks[k]):
                self.done += 1
            else:
                unfinished.append(of_blocks[k])
        for conflict in unfinished:
            refuted = check.by_programs(conflict)
            if refuted is None:
                return ""
            if not refuted:
                return f"a conflict of blocks that was to keep λ at {conflict.bound:.9g} is not refuted (scaled)"
            self.done += 1
        return ""


class _BlockRefutation:
    def __init__(self, context: CheckedProof, blocks: PossibleBlocks, bound: float, end: float) -> None:
        self._context, self._blocks, self._bound, self._end = context, blocks, bound, end
        self._tables = BlockTables(context.space, blocks)
        self._relaxations: dict[bytes, AnyBlockRelaxation] = {}

    def by_mechanisms(self, conflict: Conflict) -> bool:
        """Return whether the mechanisms that a conflict states show that no segmentation of its labels is stronger."""
        # Each mechanism bounds λ of all segmentations into the blocks left, and rules out the blocks that occur in none
        # above the threshold. Without those, propagation leaves fewer blocks for the next mechanism. The threshold is
        # the stated bound raised by rounding. True: no block is left for an element, or no segmentation exceeds it.
        threshold, bound = _raise_by_tolerance(conflict.bound), self._bound
        possible = self._tables.propagated(self._tables.agreeing(conflict.faces, conflict.labels))
        if possible is None or bound <= threshold:
            return True
        for evidence in conflict.by_blocks:
            listed = np.arange(len(self._blocks)) if evidence.blocks is None else evidence.blocks
            # a mechanism of some blocks says nothing about others
            if possible[np.setdiff1d(np.arange(len(self._blocks)), listed)].any():
                return False
            choice = self._relaxation(evidence.blocks).evaluate(evidence.mechanism, possible[listed], threshold, bound)
            if choice.refuted:
                return True
            bound = min(bound, choice.bound)
            remaining = possible.copy()
            remaining[listed[choice.useless]] = False
            possible = self._tables.propagated(remaining)
            if possible is None or bound <= threshold:
                return True
        return False

    def by_programs(self, conflict: Conflict) -> bool | None:
        """Return whether new block relaxations refute a conflict, None if time ran out."""
        threshold = _raise_by_tolerance(conflict.bound)
        for labels in self._labellings(conflict, threshold):
            if time.perf_counter() >= self._end:
                return None
            nothing = np.zeros(len(self._context.free), dtype=bool)
            if labels is not None and self._context.relaxation.refute(labels, nothing, threshold) is None:
                return False
        return True

    def _labellings(self, conflict: Conflict, threshold: float) -> Iterator[Bits | None]:
        """Yield labellings (m,) of a conflict that no relaxation refutes, and None before each program."""
        # The None lets the caller check the time.
        nodes = [self._tables.agreeing(conflict.faces, conflict.labels)] if self._bound > threshold else []
        while nodes:
            possible = self._tables.propagated(nodes.pop())
            if possible is None:
                continue
            yield None
            choice = self._relaxation(None).choose(possible, threshold, self._bound)
            possible = None if choice.refuted else self._tables.propagated(possible & ~choice.useless)
            if possible is None:
                continue
            undecided = self._tables.undecided(possible)
            if undecided.size:
                face = int(undecided[0])
                nodes += [possible & ~self._tables.inside[face], possible & ~self._tables.separated_by[face]]
            else:
                yield self._blocks.labelling(self._context.space, np.flatnonzero(possible))

    def _relaxation(self, blocks: Ints | None) -> AnyBlockRelaxation:
        """Return the block relaxation of possible blocks (k,), made at its first call."""
        key = b"" if blocks is None else blocks.tobytes()
        if key not in self._relaxations:
            chosen = range(len(self._blocks)) if blocks is None else blocks.tolist()
            members = [self._blocks.members[p] for p in chosen]
            inside = [self._blocks.inside[p] for p in chosen]
            seconds = max(0.0, self._end - time.perf_counter())
            self._relaxations[key] = block_relaxation_of(self._context.space.assembly, members, inside, (), seconds)
        return self._relaxations[key]


def _raise_by_tolerance(bound: float) -> float:
    """Return a scaled λ raised by the tolerance of a proof, `tolerances.PROVEN`."""
    return bound + tolerances.PROVEN * max(1.0, abs(bound))
