"""State of a proof: every labelling is refuted by a conflict, handed over or still open.

A labelling that no conflict refutes is **handed over**. This single operation adds the labelling to the list that
formulas exclude, and to the queue for evaluation. No labelling is ever removed from the list. A labelling that
formulas exclude therefore has an evaluation, or the proof knows that it lacks one.
"""

from __future__ import annotations

from collections.abc import Iterable
from threading import Lock

import numpy as np

from jld_core.arrays import Bits
from jld_explore.drivers.exact.conflict_minimization import Conflict
from jld_explore.drivers.exact.conflicts import Conflicts
from jld_explore.space import SearchSpace
from jld_explore.space.labelling import canonical


class ProofState:
    """Conflicts and handed-over labellings of one proof, shared by all its threads.

    Parameters
    ----------
    space : SearchSpace
        Search space of the proof.

    Attributes
    ----------
    space : SearchSpace
        As the parameter.
    conflicts : Conflicts
        All conflicts of the proof.
    """

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
        """Take labellings (m,) that no conflict refutes; return how many were new.

        Formulas may exclude these labellings from now on. A labelling without an evaluation is queued for one.
        """
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
            taken, self._waiting = self._waiting, []
            # skip labellings that annealing has evaluated meanwhile
            taken = [row for row in taken if _key(row) in self._without_evaluation]
        return np.array(taken, dtype=bool).reshape(len(taken), len(self.space.fixed))

    def note_evaluated(self, labellings: Bits) -> None:
        """Record that canonical labellings (k, m) have an evaluation."""
        with self._lock:
            for key in map(_key, labellings):
                self._evaluated.add(key)
                self._without_evaluation.pop(key, None)

    def is_evaluated(self, labels: Bits) -> bool:
        """Return True if a canonical labelling (m,) has an evaluation."""
        return _key(labels) in self._evaluated

    @property
    def handed_over(self) -> list[Bits]:
        """All labellings (m,) that were handed over."""
        return self._handed_over[:]

    @property
    def without_evaluation(self) -> list[Bits]:
        """Labellings (m,) that were handed over and have no evaluation yet."""
        with self._lock:
            return list(self._without_evaluation.values())

    def add_conflicts(self, conflicts: Iterable[Conflict], threshold: float = -np.inf) -> int:
        """Add conflicts and return how many were added; see `Conflicts.add`."""
        return self.conflicts.add(conflicts, threshold)

    def clear(self) -> None:
        """Forget all conflicts and handed-over labellings, but not which ones were evaluated."""
        with self._lock:
            self._handed_over, self._waiting = [], []
            self._without_evaluation, self._keys = {}, set()
        self.conflicts.clear()


def _key(labels: Bits) -> bytes:
    """Return the labels packed to bytes."""
    return np.packbits(labels).tobytes()
