"""All conflicts of a proof, in memory and on record, and what they depend on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from threading import Lock
from typing import Final

import numpy as np

from jld_core.program import Template
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.evaluation import Records
from jld_explore.space import SearchSpace

_MOST_BYTES: Final = 500_000_000
"""Memory for mechanisms, bytes; later conflicts go without, and are proven anew when the proof is checked."""


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


class LeastBounds:
    """The least bound known of each conflict: one that comes again is of use where it comes with a smaller one."""

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes], float] = {}

    def lowered(self, conflict: Conflict, threshold: float = -math.inf) -> bool:
        """Whether a conflict rules out what is not known to be ruled out above a threshold; it is from now on."""
        if self._known.get(conflict.name, math.inf) <= max(conflict.bound, threshold):
            return False
        self._known[conflict.name] = conflict.bound
        return True


class Conflicts:
    """All conflicts of a proof, on the record of a study where there is one, so that it goes on where it was.

    Threads may add and read; `save` and `keep` belong to the thread that opened the record. A conflict is never taken
    out again, except all together by `clear`.
    """

    def __init__(self, faces: int) -> None:
        self._faces = faces
        self._known: list[Conflict] = []
        self._bounds = LeastBounds()
        self._lock = Lock()
        self._records: Records | None = None
        self._saved = 0
        self._mechanisms = 0

    def __len__(self) -> int:
        return len(self._known)

    def __iter__(self) -> Iterator[Conflict]:
        return iter(self._known)

    def __getitem__(self, part: slice) -> list[Conflict]:
        return self._known[part]

    def keep(self, records: Records, key: str) -> None:
        """Take in what is on record under a key, and put there what is added from now on."""
        rows = zip(*records.conflicts(key), strict=True)
        self._known = [
            Conflict(np.flatnonzero(on), labels[on], float(bound), Evidence(evidence))
            for on, labels, bound, evidence in rows
        ]
        for conflict in self._known:
            self._bounds.lowered(conflict)
        self._saved = len(self._known)
        self._records = records

    def add(self, conflicts: Iterable[Conflict], threshold: float = -math.inf) -> int:
        """Add conflicts, unless one is known that rules out the same above a scaled λ; return how many were added."""
        with self._lock:
            new = [one for one in conflicts if self._bounds.lowered(one, threshold)]
            for place, one in enumerate(new):
                if one.mechanism is None:
                    continue
                self._mechanisms += one.mechanism.velocity.nbytes
                if self._mechanisms > _MOST_BYTES:
                    new[place] = replace(one, mechanism=None)
            self._known += new
        return len(new)

    def save(self) -> None:
        """Put on record what was added since the last time."""
        new = self._known[self._saved :]
        self._saved += len(new)
        if self._records is not None and new:
            decided, labels = np.zeros((2, len(new), self._faces), dtype=bool)
            for row, conflict in enumerate(new):
                decided[row, conflict.faces], labels[row, conflict.faces] = True, conflict.labels
            bounds = [conflict.bound for conflict in new]
            self._records.add_conflicts(decided, labels, bounds, [int(conflict.evidence) for conflict in new])

    def clear(self) -> None:
        """Forget all conflicts, those on record too."""
        with self._lock:
            self._known, self._bounds = [], LeastBounds()
            self._saved = self._mechanisms = 0
        if self._records is not None:
            self._records.forget_conflicts()
