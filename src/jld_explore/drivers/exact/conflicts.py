"""From one labelling that is too weak to all labellings that are too weak for the same reason.

A mechanism bounds λ of every labelling by a sum over faces (docs/method.md (6.2)), so faces whose label changes
that sum by less than what is to spare are free. Solving again with those undecided moves the mechanism to the
faces that are left; what cannot be freed any more is the **conflict**: labels that no labelling worth finding has
together.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.limit import CaseRelaxation, DualBound, Relaxation
from jld_core.program import Template
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation import Records
from jld_explore.space import SearchSpace

AnyRelaxation = Relaxation | CaseRelaxation
"""What refutes partial labellings, under one load or several."""

_TRIES: Final = 2
"""Single faces tried in vain, the most promising first, before a conflict is taken as it is."""


@dataclass(frozen=True)
class Conflict:
    """No labelling with `labels` (k,) on `faces` (k,) has a scaled λ above `bound`."""

    faces: Ints
    labels: Bits
    bound: float


def key_of(templates: Sequence[Template], space: SearchSpace, blocks: PossibleBlocks | None) -> str:
    """What conflicts depend on: the numbers of the programs, which faces are free, which blocks there can be."""
    parts = [
        space.candidates.tobytes(),
        space.fixed.tobytes(),
        space.group.tobytes(),
        space.assembly.required.tobytes(),
    ]
    for template in templates:
        pattern = template.yield_set.pattern
        numbers = (template.matrix.data, template.dead, template.live, pattern.dry, pattern.inner)
        parts += [part.tobytes() for part in (*numbers, pattern.h_dry, pattern.h_inner)]
    names = repr(None if blocks is None else blocks.members).encode()
    return hashlib.sha256(b"".join([*parts, names])).hexdigest()


class Conflicts:
    """All conflicts of a proof, on the record of a study where there is one, so that it goes on where it was."""

    def __init__(self, faces: int) -> None:
        self._faces = faces
        self._known: list[Conflict] = []
        self._records: Records | None = None

    def __len__(self) -> int:
        return len(self._known)

    def __iter__(self) -> Iterator[Conflict]:
        return iter(self._known)

    def keep(self, records: Records, key: str) -> None:
        """Take in what is on record under a key, and put there what is added from now on."""
        rows = zip(*records.conflicts(key), strict=True)
        self._known = [Conflict(np.flatnonzero(on), labels[on], float(bound)) for on, labels, bound in rows]
        self._records = records

    def add(self, conflict: Conflict) -> None:
        """Take a new one."""
        self._known.append(conflict)
        if self._records is not None:
            decided, labels = np.zeros((2, self._faces), dtype=bool)
            decided[conflict.faces], labels[conflict.faces] = True, conflict.labels
            self._records.add_conflict(decided, labels, conflict.bound)


def conflict_of(relaxation: AnyRelaxation, labels: Bits, candidates: Bools, threshold: float) -> Conflict | None:
    """A conflict that the labelling is one example of; None where it may reach the threshold.

    labels: (m,) True dry. candidates: (m,) faces that may take either label. threshold: scaled λ.
    """
    shrinking = _Shrinking(relaxation, labels, candidates, threshold)
    if not shrinking.solved():
        return None
    shrinking.free_together()
    shrinking.free_singly()
    faces = np.flatnonzero(shrinking.decided)
    return Conflict(faces, labels[faces], shrinking.bound)


class _Shrinking:
    """A conflict on its way from all candidates to few."""

    def __init__(self, relaxation: AnyRelaxation, labels: Bits, candidates: Bools, threshold: float) -> None:
        self._relaxation, self._labels, self._threshold = relaxation, labels, threshold
        self._candidates = candidates
        self.decided = candidates.copy()
        self.bound = threshold
        self._found: DualBound | None = None

    def solved(self) -> bool:
        """Refute what is decided now."""
        undecided = self._candidates & ~self.decided
        found = self._relaxation.refute(self._labels, undecided, self._threshold)
        if found is not None:
            self._found, self.bound = found, min(found.bound, self._threshold)
        return found is not None

    def free_together(self) -> None:
        """Free what the mechanism at hand can spare, solve, and look again."""
        while self._found is not None:
            order = self._order()
            spent = np.cumsum(self._found.cost[order])
            freed = order[spent < self._found.excess]
            if not freed.size:
                return
            self.decided[freed] = False
            # the mechanism at hand proves this much whatever comes of the next solve
            self._found, self.bound = None, self._threshold
            self.solved()

    def free_singly(self) -> None:
        """Try faces one by one, in the order of what the mechanism would lose by them."""
        vain = 0
        for face in self._order().tolist() if self._found is not None else []:
            if not self.decided[face]:
                continue
            self.decided[face] = False
            if self.solved():
                self.free_together()
                if self._found is None:
                    return
                continue
            self.decided[face] = True
            vain += 1
            if vain >= _TRIES:
                return

    def _order(self) -> Ints:
        assert self._found is not None
        decided = np.flatnonzero(self.decided)
        return decided[np.argsort(self._found.cost[decided], kind="stable")]
