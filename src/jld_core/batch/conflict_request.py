"""Request and results of conflict minimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import interface

_FATES: Final = interface.codes("JldFate")
REFUTED: Final = _FATES["REFUTED"]
"""Fate of a labelling that a mechanism refutes at its threshold."""

CARRIED: Final = _FATES["CARRIED"]
"""Fate of a labelling whose forces carry more than its threshold."""


@dataclass(frozen=True)
class MinimizationOptions:
    """Options of conflict minimisation.

    Minimisation makes decided faces undecided, as long as the relaxation still proves λ below the threshold.

    neighbours: further minimisations per refuted labelling; each starts with one face of its conflict undecided. tries:
    number of single faces tried without success after which a conflict is accepted as minimal. inner: true: make inner
    faces undecided before dry ones. balance: equilibrium error (scaled) up to which forces that carry more than the
    threshold end a relaxation.
    """

    neighbours: int = 0
    tries: int = 2
    inner: bool = False
    balance: float = 1e-6


@dataclass(frozen=True)
class ConflictRequest:
    """Labellings whose conflicts are to be minimised.

    The batch solver, the relaxation of one load and the relaxation of several load cases all take this request.

    Attributes
    ----------
    labellings : (k, m) bool array
        True = dry.
    free : (m,) bool array
        Faces that may take either label.
    thresholds : (k,) array
        λ that each labelling is to be proven to stay below, in the unit of the solver asked.
    undecided : (k, m) bool array or None
        Free faces that are undecided from the start; None for none.
    how : MinimizationOptions
        Options.
    seed : int
        Seed of the random choice of the face that a neighbour leaves undecided.
    """

    labellings: Bits
    free: Bools
    thresholds: Floats
    undecided: Bools | None = None
    how: MinimizationOptions = MinimizationOptions()
    seed: int = 0

    def take(self, rows: Ints) -> ConflictRequest:
        """Return the request for some of the k labellings.

        Parameters
        ----------
        rows : (j,) int array
            Indices of the labellings.
        """
        undecided = None if self.undecided is None else self.undecided[rows]
        return replace(self, labellings=self.labellings[rows], thresholds=self.thresholds[rows], undecided=undecided)

    def in_units(self, unit: float) -> ConflictRequest:
        """Return the same request with thresholds divided by `unit`, a value of λ.

        For example, thresholds in scene units over `Scaling.load` are scaled.
        """
        return replace(self, thresholds=self.thresholds / unit)


@dataclass(frozen=True)
class MinimizationResults:
    """Minimised conflicts of k labellings and their neighbours, r = k · (1 + neighbours) rows.

    The row of a labelling comes before those of its neighbours.

    labelling: (r,) index of the labelling among the k. fate: (r,) 0 (open, or never begun), `REFUTED` or `CARRIED`.
    decided: (r, m) faces of the conflict, that is, the faces that stay decided. velocity: (r, q·free) velocities of the
    mechanism. relaxations: (r,) number of relaxations solved.
    """

    labelling: Ints
    fate: NDArray[np.uint8]
    decided: Bools
    velocity: Floats
    relaxations: NDArray[np.int32]
