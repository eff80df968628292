"""Conflict minimization: reduce one weak labelling to the few labels that make it weak.

A mechanism bounds λ of every labelling by a sum over faces (docs/method.md (6.2)). Faces whose label changes that sum
by less than the excess can become undecided. Solving again with those faces undecided gives a mechanism that depends
on the remaining faces. The faces that cannot be freed form the **conflict**: labels that no labelling above the
threshold has together. This module minimises one labelling by one relaxation after the other. The batch solver
minimises many in one call by the same rules (`Relaxation.minimize_conflicts`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, Protocol

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit.dual_bounds import DualBound

_TRIES: Final = 2
"""Single faces tried without success before a conflict is accepted.

Faces are tried in the order of their cost to the excess, least first.
"""


class Refuting(Protocol):
    """Relaxation that refutes λ of partial labellings and weighs mechanisms, by rigid blocks or by fields."""

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute thresholds (k,) for partial labellings (k, m); see `Relaxation.refute_all`."""
        ...

    def weigh(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Evaluate known mechanisms of one load case; see `Relaxation.weigh`."""
        ...


class Evidence(IntEnum):
    """Kind of proof of a conflict; the numbers are stored in records."""

    MECHANISM = 0
    """One mechanism over faces, evaluated for all labellings with the labels of the conflict."""

    CUBE = 1
    """Answer of a satisfiability solver, derived from other conflicts on record."""

    BLOCKS = 2
    """Mechanism of possible blocks (`jld_core.limit.BlockRelaxation`)."""


@dataclass(frozen=True)
class Mechanism:
    """Mechanism that proves a conflict.

    Attributes
    ----------
    case : int
        Index of the load case.
    velocity : (q · free,) float array
        Scaled velocities of the free elements.
    """

    case: int
    velocity: Floats


@dataclass(frozen=True)
class Conflict:
    """Labels on some faces that no labelling above a scaled λ has together.

    Parameters
    ----------
    faces : (k,) int array
        Faces of the conflict.
    labels : (k,) bool array
        Labels of those faces, True = dry.
    bound : float
        Scaled λ that no labelling with these labels exceeds.
    evidence : Evidence
        Kind of proof.
    mechanism : Mechanism or None
        The proof, where it is a mechanism that is still in memory.

    Attributes
    ----------
    faces, labels, bound, evidence, mechanism
        As the parameters.
    """

    faces: Ints
    labels: Bits
    bound: float
    evidence: Evidence = Evidence.MECHANISM
    mechanism: Mechanism | None = field(default=None, compare=False, repr=False)

    @property
    def closed(self) -> bool:
        """Whether the conflict follows from other conflicts alone."""
        return self.evidence is Evidence.CUBE

    @property
    def name(self) -> tuple[bytes, bytes]:
        """Key of the conflict: its faces and labels as bytes, without its bound."""
        return self.faces.tobytes(), self.labels.tobytes()


def conflict_of(
    relaxation: Refuting, labels: Bits, candidates: Bools, threshold: float, tries: int = _TRIES
) -> Conflict | None:
    """Minimise one labelling to a conflict that refutes it.

    Parameters
    ----------
    relaxation : Refuting
        Relaxation of the structure.
    labels : (m,) bool array
        Labels, True = dry.
    candidates : (m,) bool array
        Faces that may take either label.
    threshold : float
        Scaled λ that the labelling must not reach.
    tries : int
        Single faces that may be tried in vain.

    Returns
    -------
    Conflict or None
        Conflict whose labels the labelling has; None where the labelling may reach the threshold.
    """
    decided = candidates.copy()

    def refuted(whole: bool = False) -> DualBound | None:
        # A complete labelling that is not refuted needs an evaluation, so only then is the relaxation solved
        # thoroughly.
        undecided, thorough = candidates & ~decided, np.array([whole])
        return relaxation.refute_all(labels[None], undecided[None], np.array([threshold]), thorough)[0]

    found = refuted(whole=True)
    if found is None:
        return None
    tried: set[int] = set()
    vain = 0
    while True:
        order = _order(found, decided)
        # free all faces whose total cost is below the excess of the current mechanism
        freed = order[np.cumsum(found.cost[order]) < found.excess]
        if freed.size:
            decided[freed] = False
            sent = refuted()
            if sent is None:
                # the previous mechanism proves this conflict whatever the next solve gives
                return _conflict(labels, decided, threshold, found)
            found = sent
            continue
        bound = min(found.bound, threshold)
        face = next((f for f in order.tolist() if f not in tried), None)
        if face is None or vain >= tries:
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
    """Return the conflict of the decided faces (m,) with the mechanism of a dual bound."""
    faces = np.flatnonzero(decided)
    return Conflict(faces, labels[faces], bound, mechanism=Mechanism(found.case, found.velocity))


def _order(found: DualBound, decided: Bools) -> Ints:
    """Return the decided faces, least cost to the excess of the mechanism first."""
    faces = np.flatnonzero(decided)
    return np.asarray(faces[np.argsort(found.cost[faces], kind="stable")])
