"""The state of a proof, with one owner: every layout is refuted by a stated conflict, evaluated, or still open.

A layout that no conflict refutes is **handed over**. Handing over is one operation: the layout joins the list from
which formulas learn what they need not draw again, and in the same moment it waits for its evaluation. Nothing takes
a layout off that list, so a layout that formulas leave out has an evaluation, or the proof knows that it has none.
"""

from __future__ import annotations

from collections.abc import Iterable
from threading import Lock

import numpy as np

from jld_core.arrays import Bits
from jld_explore.drivers.exact.conflict_minimization import Conflict
from jld_explore.drivers.exact.conflicts import Conflicts
from jld_explore.space import SearchSpace, canonical


class ProofState:
    """Conflicts and handed-over layouts of one proof, shared by all threads that work on it.

    Parameters
    ----------
    space : SearchSpace
        The layouts that the proof is about.
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
        """Take layouts (m,) that no conflict refutes; return how many were new.

        From now on formulas may leave them out. A layout without an evaluation waits for one.
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
        """Layouts (m,) that were handed over, from the one with this number on."""
        return self._handed_over[number:]

    def take_waiting(self) -> Bits:
        """Layouts (k, m) that wait for their evaluation and were not taken before."""
        with self._lock:
            taken, self._waiting = self._waiting, []
            # evaluated meanwhile by a search beside the proof
            taken = [row for row in taken if _key(row) in self._without_evaluation]
        return np.array(taken, dtype=bool).reshape(len(taken), len(self.space.fixed))

    def note_evaluated(self, labellings: Bits) -> None:
        """Note that canonical layouts (k, m) have an evaluation now."""
        with self._lock:
            for key in map(_key, labellings):
                self._evaluated.add(key)
                self._without_evaluation.pop(key, None)

    def is_evaluated(self, labels: Bits) -> bool:
        """Return True if a canonical layout (m,) has an evaluation."""
        return _key(labels) in self._evaluated

    @property
    def handed_over(self) -> list[Bits]:
        """All layouts (m,) that were handed over."""
        return self._handed_over[:]

    @property
    def without_evaluation(self) -> list[Bits]:
        """Layouts (m,) that were handed over and have no evaluation yet."""
        with self._lock:
            return list(self._without_evaluation.values())

    def add_conflicts(self, conflicts: Iterable[Conflict], threshold: float = -np.inf) -> int:
        """Add conflicts: see `Conflicts.add`."""
        return self.conflicts.add(conflicts, threshold)

    def clear(self) -> None:
        """Forget all conflicts and all that was handed over; evaluations stay known."""
        with self._lock:
            self._handed_over, self._waiting = [], []
            self._without_evaluation, self._keys = {}, set()
        self.conflicts.clear()


def _key(labels: Bits) -> bytes:
    return np.packbits(labels).tobytes()
