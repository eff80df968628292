"""State of a proof: its conflicts, and every labelling that no conflict refutes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import IntEnum
from threading import Lock
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit.block_relaxation import BlockMechanism
from jld_explore.evaluation import Records
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import SearchSpace


class Evidence(IntEnum):
    """Kind of proof of a conflict; the numbers are stored in records."""

    MECHANISM = 0  # one mechanism over faces, evaluated for all labellings with the labels of the conflict
    CUBE = 1  # answer of a satisfiability solver, derived from other conflicts on record
    BLOCKS = 2  # mechanism of possible blocks (`jld_core.limit.BlockRelaxation`)


@dataclass(frozen=True)
class Mechanism:
    case: int  # index of the load case
    velocity: Floats  # (q · free,) scaled velocities of the free elements


@dataclass(frozen=True)
class BlockEvidence:
    """Mechanism of one block relaxation, as part of the proof of a conflict."""

    mechanism: BlockMechanism
    blocks: Ints | None = None  # (k,) indices of the possible blocks that the relaxation had; None for all of them


@dataclass(frozen=True)
class Conflict:
    """Labels on some faces that no labelling above a scaled λ has together."""

    faces: Ints  # (k,) faces of the conflict
    labels: Bits  # (k,) labels of those faces, True = dry
    bound: float  # scaled λ that no labelling with these labels exceeds
    evidence: Evidence = Evidence.MECHANISM  # kind of proof
    # the proof, where it is a mechanism that is still in memory
    mechanism: Mechanism | None = field(default=None, compare=False, repr=False)
    # the proof, where it comes from block relaxations that are still in memory: each excludes blocks, in this order
    by_blocks: tuple[BlockEvidence, ...] = field(default=(), compare=False, repr=False)

    @property
    def from_cube(self) -> bool:
        """True if the conflict follows from other conflicts alone."""
        return self.evidence is Evidence.CUBE

    @property
    def by_possible_blocks(self) -> bool:
        """True if the conflict follows from mechanisms of possible blocks."""
        return self.evidence is Evidence.BLOCKS

    @property
    def size(self) -> int:
        """Memory of the proof in bytes; of several block relaxations only the last, as others are shared."""
        used = 0 if self.mechanism is None else self.mechanism.velocity.nbytes
        if self.by_blocks:
            last = self.by_blocks[-1].mechanism.multipliers
            used += last.velocity.nbytes + last.wall.nbytes
        return used

    @property
    def key(self) -> tuple[bytes, bytes]:
        """Key of the conflict: its faces and labels as bytes, without its bound."""
        return self.faces.tobytes(), self.labels.tobytes()


# Largest memory for mechanisms, bytes. Later conflicts are stored without their mechanism, and are proven again when
# the proof is checked.
_MOST_BYTES: Final = 500_000_000


class LeastBounds:
    """Least known bound of each conflict, by which conflicts without news are left out."""

    def __init__(self) -> None:
        self._bounds: dict[tuple[bytes, bytes], float] = {}

    def lowered(self, conflict: Conflict, threshold: float = -math.inf) -> bool:
        """Record a conflict; return True if it refutes more than is known above a threshold."""
        if self._bounds.get(conflict.key, math.inf) <= max(conflict.bound, threshold):
            return False
        self._bounds[conflict.key] = conflict.bound
        return True


class Conflicts:
    """All conflicts of a proof, shared by threads, and saved so that the proof can resume."""

    def __init__(self, faces: int) -> None:
        self._faces = faces
        self._conflicts: list[Conflict] = []
        self._bounds = LeastBounds()
        self._lock = Lock()
        self._records: Records | None = None
        self._saved = 0
        self._mechanisms = 0

    def __len__(self) -> int:
        return len(self._conflicts)

    def __iter__(self) -> Iterator[Conflict]:
        return iter(self._conflicts)

    def __getitem__(self, part: slice) -> list[Conflict]:
        return self._conflicts[part]

    def keep(self, records: Records, key: str) -> None:
        """Load the conflicts stored under a key, and save later conflicts to the same records."""
        # Loaded conflicts replace those in memory. The records delete conflicts of another key.
        rows = zip(*records.conflicts(key), strict=True)
        self._conflicts = [
            Conflict(np.flatnonzero(on), labels[on], float(bound), Evidence(evidence))
            for on, labels, bound, evidence in rows
        ]
        for conflict in self._conflicts:
            self._bounds.lowered(conflict)
        self._saved = len(self._conflicts)
        self._records = records

    def add(self, conflicts: Iterable[Conflict], threshold: float = -math.inf) -> int:
        """Add conflicts that refute more than is known; return how many were added."""
        with self._lock:
            new = [conflict for conflict in conflicts if self._bounds.lowered(conflict, threshold)]
            for index, conflict in enumerate(new):
                self._mechanisms += conflict.size
                if self._mechanisms > _MOST_BYTES:
                    new[index] = replace(conflict, mechanism=None, by_blocks=())
            self._conflicts += new
        return len(new)

    def save(self) -> None:
        """Write the conflicts added since the last call to the records, if there are records."""
        new = self._conflicts[self._saved :]
        self._saved += len(new)
        if self._records is not None and new:
            decided, labels = np.zeros((2, len(new), self._faces), dtype=bool)
            for row, conflict in enumerate(new):
                decided[row, conflict.faces], labels[row, conflict.faces] = True, conflict.labels
            bounds = [conflict.bound for conflict in new]
            self._records.add_conflicts(decided, labels, bounds, [int(conflict.evidence) for conflict in new])

    def correct(self, corrected: Iterable[Conflict], reason: str) -> None:
        """Replace conflicts by corrected ones; forget those from cubes, and the bound on record."""
        better = {conflict.key: conflict for conflict in corrected}
        conflicts = [better.get(conflict.key, conflict) for conflict in self._conflicts if not conflict.from_cube]
        if self._records is not None:
            self._records.withdraw_bound(reason)
        self.clear()
        self.add(conflicts)
        self.save()

    def clear(self) -> None:
        with self._lock:
            self._conflicts, self._bounds = [], LeastBounds()
            self._saved = self._mechanisms = 0
        if self._records is not None:
            self._records.forget_conflicts()


class ProofState:
    """Conflicts and handed-over labellings of one proof, shared by all its threads."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.conflicts = Conflicts(len(space.fixed))
        self._lock = Lock()
        self._handed_over: list[Bits] = []
        self._waiting: list[Bits] = []
        self._without_evaluation: dict[bytes, Bits] = {}
        self._keys: set[bytes] = set()
        self._evaluated: set[bytes] = set()

    def hand_over(self, labellings: Iterable[Bits]) -> int:
        """Queue labellings (m,) that no conflict refutes for evaluation; return how many were new."""
        # Labellings are stored as canonical images under symmetry. Formulas may exclude them from now on, so none is
        # ever removed: each has an evaluation, or the proof knows that it lacks one.
        new = 0
        for labels in labellings:
            row = np.asarray(canonical(labels[None], self.space.group))[0]
            key = _key(row)
            with self._lock:
                if key in self._keys:
                    continue
                self._keys.add(key)
                self._handed_over.append(row)
                new += 1
                if key not in self._evaluated:
                    self._without_evaluation[key] = row
                    self._waiting.append(row)
        return new

    def handed_over_since(self, number: int) -> list[Bits]:
        """Return the labellings (m,) that were handed over, from index `number` on."""
        return self._handed_over[number:]

    def take_waiting(self) -> Bits:
        """Return the labellings (k, m) queued for evaluation, and empty the queue."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
            # skip labellings that annealing has evaluated meanwhile
            waiting = [row for row in waiting if _key(row) in self._without_evaluation]
        return np.array(waiting, dtype=bool).reshape(len(waiting), len(self.space.fixed))

    def note_evaluated(self, labellings: Bits) -> None:
        """Record that canonical labellings (k, m) have an evaluation."""
        with self._lock:
            for key in map(_key, labellings):
                self._evaluated.add(key)
                self._without_evaluation.pop(key, None)

    @property
    def has_evaluations(self) -> bool:
        return bool(self._evaluated)

    def is_evaluated(self, labels: Bits) -> bool:
        return _key(labels) in self._evaluated

    @property
    def handed_over(self) -> list[Bits]:
        """All labellings (m,) that were handed over, in their order."""
        return self._handed_over[:]

    @property
    def without_evaluation(self) -> list[Bits]:
        """Labellings (m,) that were handed over and have no evaluation yet."""
        with self._lock:
            return list(self._without_evaluation.values())

    def add_conflicts(self, conflicts: Iterable[Conflict], threshold: float = -np.inf) -> int:
        """Add conflicts that refute more than is known; return how many were added."""
        return self.conflicts.add(conflicts, threshold)

    def clear(self) -> None:
        """Forget all conflicts and handed-over labellings, but not which ones were evaluated."""
        with self._lock:
            self._handed_over, self._waiting = [], []
            self._without_evaluation, self._keys = {}, set()
        self.conflicts.clear()


def _key(labels: Bits) -> bytes:
    return np.packbits(labels).tobytes()
