"""Store the conflicts of a proof in memory and on record."""

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
"""Largest memory for mechanisms, bytes.

Later conflicts are stored without their mechanism, and are proven again when the proof is checked.
"""


def key_of(templates: Sequence[Template], space: SearchSpace, blocks: PossibleBlocks | None) -> str:
    """Return a hash of all data that conflicts depend on.

    The hash covers the numbers of the programs, the free faces, the symmetry group and the possible blocks.
    """
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
    """Least known bound of each conflict.

    A conflict that is found again is useful only with a smaller bound.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes], float] = {}

    def lowered(self, conflict: Conflict, threshold: float = -math.inf) -> bool:
        """Record a conflict; return True if it refutes more than is known above a threshold.

        Parameters
        ----------
        conflict : Conflict
            The conflict.
        threshold : float
            Scaled λ below which a smaller bound does not matter.
        """
        if self._known.get(conflict.key, math.inf) <= max(conflict.bound, threshold):
            return False
        self._known[conflict.key] = conflict.bound
        return True


class Conflicts:
    """All conflicts of a proof, saved in the records of a study so that the proof can resume.

    Threads may add and read conflicts. Only the thread that opened the records may call `save` and `keep`. A single
    conflict is never removed; `clear` removes all of them.

    Parameters
    ----------
    faces : int
        Number m of faces of a labelling.
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
        """Load the conflicts stored under a key, and save later conflicts to the same records."""
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
        """Add conflicts that refute more than is known; return how many were added.

        Parameters
        ----------
        conflicts : iterable of Conflict
            The conflicts.
        threshold : float
            Scaled λ below which a smaller bound does not matter.
        """
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
        """Write the conflicts added since the last call to the records."""
        new = self._known[self._saved :]
        self._saved += len(new)
        if self._records is not None and new:
            decided, labels = np.zeros((2, len(new), self._faces), dtype=bool)
            for row, conflict in enumerate(new):
                decided[row, conflict.faces], labels[row, conflict.faces] = True, conflict.labels
            bounds = [conflict.bound for conflict in new]
            self._records.add_conflicts(decided, labels, bounds, [int(conflict.evidence) for conflict in new])

    def clear(self) -> None:
        """Forget all conflicts, in memory and on record."""
        with self._lock:
            self._known, self._bounds = [], LeastBounds()
            self._saved = self._mechanisms = 0
        if self._records is not None:
            self._records.forget_conflicts()
