"""What the batch solver is asked when it shrinks labellings to what makes them too weak, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints

REFUTED: Final = 1
"""Fate of a labelling that was to be shrunk: a mechanism proves it too weak. Numbers as in `JldFate` of problem.h."""

CARRIED: Final = 2
"""The same where its forces were seen to carry more than its threshold."""


@dataclass(frozen=True)
class MinimizationOptions:
    """How labellings are shrunk to what makes them too weak.

    neighbours: of each labelling that falls, the same with one face of its conflict undecided from the start. tries:
    single faces tried in vain before a conflict is taken as it is. inner: whether inner faces are tried before dry
    ones. balance: error of equilibrium with which forces that carry more end a relaxation.
    """

    neighbours: int = 0
    tries: int = 2
    inner: bool = False
    balance: float = 1e-6


@dataclass(frozen=True)
class ConflictRequest:
    """Labellings to be shrunk, whoever is asked: the batch solver, the relaxation of one load or that of several cases.

    labellings: (k, m), True dry. free: (m,) faces that may take either label. thresholds: (k,) λ that each is to stay
    below, in the unit of who is asked. undecided: (k, m) free faces that are so from the start, None for none. how:
    see `MinimizationOptions`. seed: of the faces that neighbours do without.
    """

    labellings: Bits
    free: Bools
    thresholds: Floats
    undecided: Bools | None = None
    how: MinimizationOptions = MinimizationOptions()
    seed: int = 0

    def take(self, rows: Ints) -> ConflictRequest:
        """Some of the labellings, (j,) of the k."""
        undecided = None if self.undecided is None else self.undecided[rows]
        return replace(self, labellings=self.labellings[rows], thresholds=self.thresholds[rows], undecided=undecided)

    def in_units(self, unit: float) -> ConflictRequest:
        """The same with thresholds in another unit of λ."""
        return replace(self, thresholds=self.thresholds / unit)


@dataclass(frozen=True)
class MinimizationResults:
    """What shrinking k labellings with their neighbours came to, r = k · (1 + neighbours) rows, each labelling before
    its neighbours.

    labelling: (r,) which of the k it is of. fate: (r,) 0 (open, or never begun), REFUTED or CARRIED. decided:
    (r, m) faces that matter. velocity: (r, q·free) of the mechanism. relaxations: (r,) solved.
    """

    labelling: Ints
    fate: NDArray[np.uint8]
    decided: Bools
    velocity: Floats
    relaxations: NDArray[np.int32]
