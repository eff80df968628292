"""Check of conflicts that come from possible blocks: refute them again from their labels alone.

Such a conflict rests on several block relaxations. Each excludes some possible blocks, and the last one refutes the
blocks that are left. The check repeats this chain with the mechanisms in memory, without a solver. Where the chain is
not in memory, or does not end, new block relaxations are solved, and branched until nothing is left.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Ints
from jld_core.limit.case_relaxation import AnyBlockRelaxation, block_relaxation_of
from jld_explore.drivers.exact.context import CheckedProof
from jld_explore.drivers.exact.possible_blocks import BlockTables, PossibleBlocks
from jld_explore.drivers.exact.proof_state import Conflict, Evidence


class BlockConflictCheck:
    """Repeated refutation of conflicts of possible blocks.

    context: space, possible blocks, free faces and relaxation of the proof. done: number of conflicts that were refuted
    again.
    """

    def __init__(self, context: CheckedProof) -> None:
        self._context = context
        self.done = 0

    def refute_again(self, conflicts: Sequence[Conflict], end: float) -> str:
        """Refute conflicts of possible blocks again, in random order, until a time.

        Conflicts that the time does not suffice for stay unchecked; `done` counts the others. Without listed blocks, or
        without a bound on all labellings, nothing is checked.

        conflicts: conflicts of the proof; those of another kind are skipped. end: time to stop, on the clock of
        `time.perf_counter`, s. Result: the first problem, "" for none.
        """
        mine = [one for one in conflicts if one.evidence is Evidence.BLOCKS]
        if not mine or self._context.blocks is None or time.perf_counter() >= end:
            return ""
        known = self._context.relaxation.least_bound(self._context.labels, self._context.free)
        if known is None:
            return ""
        check = _BlockRefutation(self._context, self._context.blocks, known.bound, end)
        unfinished = []
        for k in np.random.default_rng(len(mine)).permutation(len(mine)).tolist():
            if time.perf_counter() >= end:
                return ""
            if check.by_mechanisms(mine[k]):
                self.done += 1
            else:
                unfinished.append(mine[k])
        for one in unfinished:
            refuted = check.by_programs(one)
            if refuted is None:
                return ""
            if not refuted:
                return f"a conflict of blocks that was to keep λ at {one.bound:.9g} is not refuted (scaled)"
            self.done += 1
        return ""


class _BlockRefutation:
    """Refutation of single conflicts of possible blocks.

    context: of the proof. blocks: its possible blocks. most: scaled λ that no labelling exceeds. end: time to stop.
    """

    def __init__(self, context: CheckedProof, blocks: PossibleBlocks, most: float, end: float) -> None:
        self._context, self._blocks, self._most, self._end = context, blocks, most, end
        self._tables = BlockTables(context.space, blocks)
        self._relaxations: dict[bytes, AnyBlockRelaxation] = {}

    def by_mechanisms(self, conflict: Conflict) -> bool:
        """Return True if the mechanisms stored in a conflict refute its labels, without a solver.

        False says nothing: the mechanisms may not be in memory.
        """
        threshold, most = _raised(conflict.bound), self._most
        left = self._tables.propagated(self._tables.agreeing(conflict.faces, conflict.labels))
        if left is None or most <= threshold:
            return True
        for one in conflict.by_blocks:
            known = np.arange(len(self._blocks)) if one.blocks is None else one.blocks
            if left[np.setdiff1d(np.arange(len(self._blocks)), known)].any():
                return False
            choice = self._relaxation(one.blocks).evaluate(one.mechanism, left[known], threshold, most)
            if choice.refuted:
                return True
            most = min(most, choice.bound)
            kept = left.copy()
            kept[known[choice.useless]] = False
            left = self._tables.propagated(kept)
            if left is None or most <= threshold:
                return True
        return False

    def by_programs(self, conflict: Conflict) -> bool | None:
        """Return True if new block relaxations refute a conflict, and False if they do not.

        None if time ran out.
        """
        threshold = _raised(conflict.bound)
        for labels in self._labellings(conflict, threshold):
            if time.perf_counter() >= self._end:
                return None
            nothing = np.zeros(len(self._context.free), dtype=bool)
            if labels is not None and self._context.relaxation.refute(labels, nothing, threshold) is None:
                return False
        return True

    def _labellings(self, conflict: Conflict, threshold: float) -> Iterator[Bits | None]:
        """Yield the labellings (m,) of a conflict that no block relaxation refutes.

        Yields None before each program, so that the caller can check the time. threshold: scaled λ.
        """
        nodes = [self._tables.agreeing(conflict.faces, conflict.labels)] if self._most > threshold else []
        while nodes:
            left = self._tables.propagated(nodes.pop())
            if left is None:
                continue
            yield None
            choice = self._relaxation(None).choose(left, threshold, self._most)
            left = None if choice.refuted else self._tables.propagated(left & ~choice.useless)
            if left is None:
                continue
            undecided = self._tables.undecided(left)
            if undecided.size:
                face = int(undecided[0])
                nodes += [left & ~self._tables.inside[face], left & ~self._tables.separated_by[face]]
            else:
                yield self._blocks.labelling(self._context.space, np.flatnonzero(left))

    def _relaxation(self, blocks: Ints | None) -> AnyBlockRelaxation:
        """Return the block relaxation of possible blocks (k,), made at its first call.

        blocks: indices; None for all blocks.
        """
        key = b"" if blocks is None else blocks.tobytes()
        if key not in self._relaxations:
            chosen = range(len(self._blocks)) if blocks is None else blocks.tolist()
            members = [self._blocks.members[p] for p in chosen]
            inside = [self._blocks.inside[p] for p in chosen]
            left = max(0.0, self._end - time.perf_counter())
            self._relaxations[key] = block_relaxation_of(self._context.space.assembly, members, inside, (), left)
        return self._relaxations[key]


def _raised(bound: float) -> float:
    """Return a scaled λ raised by the tolerance of a proof, `tolerances.PROVEN`."""
    return bound + tolerances.PROVEN * max(1.0, abs(bound))
