"""All conflicts of a proof, in memory and on record, and what they depend on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence

import numpy as np

from jld_core.program import Template
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.shrinking import Conflict
from jld_explore.evaluation import Records
from jld_explore.space import SearchSpace


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
    """All conflicts of a proof, on the record of a study where there is one, so that it goes on where it was."""

    def __init__(self, faces: int) -> None:
        self._faces = faces
        self._known: list[Conflict] = []
        self._records: Records | None = None

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
            Conflict(np.flatnonzero(on), labels[on], float(bound), bool(closed)) for on, labels, bound, closed in rows
        ]
        self._records = records

    def add(self, conflicts: Sequence[Conflict]) -> None:
        """Take new ones."""
        self._known += conflicts
        if self._records is not None and conflicts:
            decided, labels = np.zeros((2, len(conflicts), self._faces), dtype=bool)
            for row, conflict in enumerate(conflicts):
                decided[row, conflict.faces], labels[row, conflict.faces] = True, conflict.labels
            bounds, closed = [conflict.bound for conflict in conflicts], [conflict.closed for conflict in conflicts]
            self._records.add_conflicts(decided, labels, bounds, closed)
