"""Pool of children that wait for evaluation, with the data for their predicted rank."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.surrogate import SLOTS, Surrogate
from jld_explore.evaluation.ranking import front_counts
from jld_explore.space import SearchSpace

Names = NDArray[Any]
"""Array of keys (bytes objects) of labellings."""


class Pool:
    """Labellings that wait for evaluation, with keys and counts.

    The covariances with the labellings that the surrogate remembers are stored. Only those with newly remembered
    labellings are computed again.

    surrogate: predicts the rank of the labellings. rows: (k, m) True = dry. counts: (k, c) counts of the front, signed
    so that less is better. names: (k,) keys of the labellings.
    """

    def __init__(self, space: SearchSpace, surrogate: Surrogate) -> None:
        self._space, self._surrogate = space, surrogate
        self.rows: Bits = np.empty((0, len(space.fixed)), dtype=bool)
        self.counts: Floats = np.empty((0, len(space.search.front.axes)))
        self.names: Names = np.empty(0, dtype=object)
        self._signs = surrogate.signs(self.rows)
        self._covariances = np.empty((0, SLOTS), dtype=np.float32)
        self._clock = surrogate.batches_learned

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, rows: Bits, names: list[bytes]) -> None:
        """Add labellings (k, m), True = dry, with their keys (k of bytes), at the end."""
        own = np.empty(len(names), dtype=object)
        own[:] = names
        self._refresh()
        signs = self._surrogate.signs(rows)
        covariance = np.empty((len(rows), SLOTS), dtype=np.float32)
        known = len(self._surrogate)
        covariance[:, :known] = self._surrogate.covariance(signs, np.arange(known))
        self.rows = np.concatenate([self.rows, rows])
        self.counts = np.concatenate([self.counts, front_counts(self._space, rows)])
        self.names = np.concatenate([self.names, own])
        self._signs = np.concatenate([self._signs, signs])
        self._covariances = np.concatenate([self._covariances, covariance])

    def keep(self, places: Ints) -> None:
        """Remove all labellings except those at the positions `places` (k,), in this order."""
        self.rows, self.counts, self.names = self.rows[places], self.counts[places], self.names[places]
        self._signs, self._covariances = self._signs[places], self._covariances[places]

    def predict(self) -> Floats:
        """Predict the rank of each labelling of the pool, (k,); see `Surrogate.predict`.

        Covariances with labellings learned since the last call are computed first.
        """
        self._refresh()
        return self._surrogate.predict_from(self._covariances)

    def _refresh(self) -> None:
        """Update the covariances with labellings that the surrogate has learned since."""
        fresh = np.flatnonzero(self._surrogate.filled_at > self._clock)
        self._clock = self._surrogate.batches_learned
        if fresh.size and len(self):
            self._covariances[:, fresh] = self._surrogate.covariance(self._signs, fresh)
