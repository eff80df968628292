"""Pool of children that wait for evaluation, with the data for their predicted rank."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.surrogate import MEMORY, Surrogate
from jld_explore.evaluation.ranking import front_counts
from jld_explore.space import SearchSpace

Names = NDArray[Any]
"""Array of keys (bytes objects) of labellings."""


class Pool:
    """Labellings that wait for evaluation, with keys and counts.

    The covariances with the labellings that the surrogate remembers are stored. Only those with newly remembered
    labellings are computed again.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    surrogate : Surrogate
        Predicts the rank of the labellings.

    Attributes
    ----------
    rows : (k, m) bool array
        Labels, True = dry.
    counts : (k, c) float array
        Counts of the front, signed so that less is better.
    names : (k,) object array
        Keys of the labellings.
    """

    def __init__(self, space: SearchSpace, surrogate: Surrogate) -> None:
        self._space, self._surrogate = space, surrogate
        self.rows: Bits = np.empty((0, len(space.fixed)), dtype=bool)
        self.counts: Floats = np.empty((0, len(space.search.front.axes)))
        self.names: Names = np.empty(0, dtype=object)
        self._signs = surrogate.signs(self.rows)
        self._alike = np.empty((0, MEMORY), dtype=np.float32)
        self._clock = surrogate.clock

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, rows: Bits, names: list[bytes]) -> None:
        """Add labellings (k, m) with their keys."""
        own = np.empty(len(names), dtype=object)
        own[:] = names
        self._refresh()
        signs = self._surrogate.signs(rows)
        alike = np.empty((len(rows), MEMORY), dtype=np.float32)
        known = len(self._surrogate)
        alike[:, :known] = self._surrogate.alike(signs, np.arange(known))
        self.rows = np.concatenate([self.rows, rows])
        self.counts = np.concatenate([self.counts, front_counts(self._space, rows)])
        self.names = np.concatenate([self.names, own])
        self._signs = np.concatenate([self._signs, signs])
        self._alike = np.concatenate([self._alike, alike])

    def keep(self, places: Ints) -> None:
        """Remove all labellings except those at the given positions."""
        self.rows, self.counts, self.names = self.rows[places], self.counts[places], self.names[places]
        self._signs, self._alike = self._signs[places], self._alike[places]

    def guess(self) -> Floats:
        """Return the prediction of the surrogate for each labelling, (k,)."""
        self._refresh()
        return self._surrogate.weighed(self._alike)

    def _refresh(self) -> None:
        """Update the covariances with labellings that the surrogate has learned since."""
        fresh = np.flatnonzero(self._surrogate.since > self._clock)
        self._clock = self._surrogate.clock
        if fresh.size and len(self):
            self._alike[:, fresh] = self._surrogate.alike(self._signs, fresh)
