"""Interface of the relaxations of partial labellings, under one load or several load cases."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch import ConflictRequest
from jld_core.limit.dual_bounds import DualBound, MinimizedConflict


class PartialLabellingBounds(ABC):
    """Upper bounds that hold for every labelling that agrees on the decided faces.

    `Relaxation` bounds the scaled λ of one load. `CaseRelaxation` bounds the governing factor of several load cases.
    Bounds and thresholds of all methods are in this unit, the unit of the object.

    Partial labellings are given by two arrays. labels: (m,) bool array, True = dry, ignored where undecided. undecided:
    (m,) bool array, True for faces that may have either label.
    """

    @property
    @abstractmethod
    def batched(self) -> bool:
        """Return True if the batch solver solves many relaxations at a time."""

    @property
    @abstractmethod
    def unit(self) -> float:
        """Return the load factor in scene units, or the governing factor, per unit of the bounds."""

    @property
    @abstractmethod
    def each(self) -> tuple[PartialLabellingBounds, ...]:
        """Return the relaxations of all load cases; of a single load, one."""

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """Refute a threshold for all labellings that agree on the decided faces.

        labels: (m,) labels, True = dry; ignored where undecided. undecided: (m,) faces that may have either label.
        threshold: value to refute, in the unit of the object. Result: mechanism that proves it; None where no proof is
        found.
        """
        return self.refute_all(labels[None], undecided[None], np.array([threshold]))[0]

    @abstractmethod
    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute thresholds for many partial labellings, by the batch solver where it applies.

        labellings: (k, m) labels, True = dry; ignored where undecided. undecided: (k, m) faces that may have either
        label. thresholds: (k,) values to refute, in the unit of the object. thorough: (k,) True where another solver is
        tried if the batch solver finds no proof. Default: everywhere. Result: mechanism that refutes each threshold, of
        the first load case that does; None where no proof is found.
        """

    @abstractmethod
    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Remove decided faces of labellings while the bounds stay below their thresholds.

        Neighbours of the labellings are treated as well. The work balance of every refutation is evaluated again here.
        It requires the batch solver, see `batched`.

        request: labellings and thresholds, in the unit of the object. Result: one entry for each labelling or neighbour
        that was begun. With load cases, a labelling is treated under the first case that refutes it; labellings that no
        case refutes come last, without bound.
        """

    @abstractmethod
    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Evaluate the work balance of known mechanisms, without solving a program.

        case: index of the load case; a single load has only case 0. velocities: (k, q·free) mechanisms, scaled.
        labellings: (k, m) labels, True = dry; ignored where undecided. undecided: (k, m) faces that may have either
        label. Result: (k,) values that no labelling exceeds that agrees where decided, in the unit of the object. −inf
        where none is admissible at any λ, inf where the mechanism proves nothing. Raises ValueError if the load case
        does not exist.
        """

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Return an upper bound for a partial labelling.

        labels: (m,) labels, True = dry; ignored where undecided. undecided: (m,) faces that may have either label.
        Result: value that no labelling exceeds that agrees where decided, in the unit of the object; inf where no bound
        was found.
        """
        found = self.least_bound(labels, undecided)
        return np.inf if found is None else found.bound

    @abstractmethod
    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the mechanism with the least bound found for a partial labelling.

        labels: (m,) labels, True = dry; ignored where undecided. undecided: (m,) faces that may have either label.
        Result: mechanism with its bound, in the unit of the object; None where no bound was found.
        """
