"""From one labelling that is too weak to all labellings that are too weak for the same reason.

A mechanism bounds λ of every labelling by a sum over faces (docs/method.md (6.2)), so faces whose label changes
that sum by less than what is to spare are free. Solving again with those undecided moves
the mechanism to the faces that are left; what cannot be freed any more is the **conflict**: labels that no labelling
worth finding has together. Here one labelling is shrunk by one relaxation after the other; the batch solver shrinks
many in
one call, by the same rules (`Relaxation.minimize_conflicts`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit import AnyRelaxation, DualBound

_TRIES: Final = 2
"""Single faces tried in vain, the most promising first, before a conflict is taken as it is."""


class Evidence(IntEnum):
    """What proves a conflict; the numbers stand in records."""

    MECHANISM = 0
    """One mechanism over faces, weighed for all labellings that agree on the faces of the conflict."""

    CUBE = 1
    """A satisfiability solver, from other conflicts that are on record."""

    BLOCKS = 2
    """A mechanism of possible blocks (`jld_core.limit.BlockRelaxation`)."""


@dataclass(frozen=True)
class Mechanism:
    """Velocities (q·free,), scaled, and the index of the load case under which they prove a conflict."""

    case: int
    velocity: Floats


@dataclass(frozen=True)
class Conflict:
    """No labelling with `labels` (k,) on `faces` (k,) has a scaled λ above `bound`.

    evidence: what proves it. mechanism: the proof, where the evidence is a mechanism that is still in memory.
    """

    faces: Ints
    labels: Bits
    bound: float
    evidence: Evidence = Evidence.MECHANISM
    mechanism: Mechanism | None = field(default=None, compare=False, repr=False)

    @property
    def closed(self) -> bool:
        """Whether it follows from other conflicts alone."""
        return self.evidence is Evidence.CUBE

    @property
    def name(self) -> tuple[bytes, bytes]:
        """What tells it from others, whatever its bound."""
        return self.faces.tobytes(), self.labels.tobytes()


def conflict_of(relaxation: AnyRelaxation, labels: Bits, candidates: Bools, threshold: float) -> Conflict | None:
    """A conflict that the labelling is one example of; None where it may reach the threshold.

    labels: (m,) True dry. candidates: (m,) faces that may take either label. threshold: scaled λ.
    """
    decided = candidates.copy()

    def refuted(whole: bool = False) -> DualBound | None:
        # a whole labelling that nothing refutes has to be evaluated; elsewhere a face less is freed, no more
        undecided, thorough = candidates & ~decided, np.array([whole])
        return relaxation.refute_all(labels[None], undecided[None], np.array([threshold]), thorough)[0]

    found = refuted(whole=True)
    if found is None:
        return None
    tried: set[int] = set()
    vain = 0
    while True:
        order = _order(found, decided)
        # what the mechanism at hand can do without, all together
        freed = order[np.cumsum(found.cost[order]) < found.excess]
        if freed.size:
            decided[freed] = False
            sent = refuted()
            if sent is None:
                # the mechanism at hand proves this much whatever comes of the next solve
                return _conflict(labels, decided, threshold, found)
            found = sent
            continue
        bound = min(found.bound, threshold)
        face = next((f for f in order.tolist() if f not in tried), None)
        if face is None or vain >= _TRIES:
            return _conflict(labels, decided, bound, found)
        tried.add(face)
        decided[face] = False
        sent = refuted()
        if sent is None:
            decided[face] = True
            vain += 1
        else:
            found = sent


def _conflict(labels: Bits, decided: Bools, bound: float, found: DualBound) -> Conflict:
    faces = np.flatnonzero(decided)
    return Conflict(faces, labels[faces], bound, mechanism=Mechanism(found.case, found.velocity))


def _order(found: DualBound, decided: Bools) -> Ints:
    """Decided faces in the order of what the mechanism would lose by them."""
    faces = np.flatnonzero(decided)
    return np.asarray(faces[np.argsort(found.cost[faces], kind="stable")])
