"""Gaussian process that predicts the rank of labellings before they are solved.

The covariance of two labellings is exp(−d / REACH), where d is the share of candidate faces that differ. It is summed
over the symmetric images of one of them. The predicted value is the share of known labellings that a labelling
exceeds, so units and outliers of λ do not matter. Predictions only decide the order of evaluation and never a result.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import sposv

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.space import SearchSpace

REACH: Final = 0.1
"""Share of differing candidate faces at which the covariance is 1 / e."""

NOISE: Final = 0.01
"""Noise variance added to the diagonal of the covariance matrix."""

MEMORY: Final = 192
"""Number of labellings remembered: half the best ones known, half the latest ones."""

_DIGITS: Final = 4
"""Decimal digits of a prediction, so that rounding errors do not decide an order."""

_SHARE: Final = MEMORY // 2
"""Number of labellings learned at a time, equal to the number of latest ones remembered."""

Single = NDArray[np.float32]


class Surrogate:
    """Gaussian process that predicts the rank of labellings from evaluated ones.

    A remembered labelling keeps its slot among `MEMORY` slots until another one replaces it.

    Parameters
    ----------
    space : SearchSpace
        Space whose candidate faces and symmetries define the covariance.

    Attributes
    ----------
    since : (MEMORY,) int array
        Value of `clock` when each slot was filled.
    clock : int
        Number of batches learned.
    """

    def __init__(self, space: SearchSpace) -> None:
        self._faces = np.flatnonzero(space.candidates)
        self._group = space.group
        self._images = np.zeros((len(space.group), MEMORY, len(self._faces)), dtype=np.float32)
        self._matrix = np.zeros((MEMORY, MEMORY), dtype=np.float32)
        self._worth = np.empty(MEMORY)
        self._order = np.empty(0, dtype=np.int64)  # slots in the order in which they were filled
        self._weights: Single | None = None
        self._mean = 0.0
        self.since = np.zeros(MEMORY, dtype=np.int64)
        self.clock = 0

    def learn(self, labellings: Bits, worth: Floats) -> None:
        """Learn labellings with their objective values.

        Parameters
        ----------
        labellings : (k, m) bool array
            Labels, True = dry.
        worth : (k,) float array
            Objective values, larger is better; any monotonic scale.
        """
        for low in range(0, len(labellings), _SHARE):
            self._take_in(labellings[low : low + _SHARE], worth[low : low + _SHARE])

    def _take_in(self, labellings: Bits, worth: Floats) -> None:
        """Remember at most `_SHARE` labellings in place of the worst of the older ones."""
        count, known = len(labellings), self._order
        lacking = max(0, len(known) + count - MEMORY)
        if lacking:
            # keep the latest labellings, and the best of the older ones
            older = known[: len(known) + count - _SHARE]
            worst = np.argsort(-self._worth[older], kind="stable")[len(older) - lacking :]
            places = older[worst]
            stay = np.ones(len(known), dtype=bool)
            stay[worst] = False
            self._order = known[stay]
        else:
            places = np.empty(0, dtype=np.int64)
        places = np.concatenate([places, np.arange(len(known), len(known) + count - lacking)])
        self._order = np.concatenate([self._order, places])
        signs = self.signs(labellings)
        for image, permutation in zip(self._images, self._group, strict=True):
            image[places] = self.signs(labellings[:, permutation])
        self._worth[places] = worth
        alike = self.alike(signs, np.arange(len(self._order)))
        self._matrix[places, : len(self._order)] = alike
        self._matrix[: len(self._order), places] = alike.T
        self._weights = None
        self.clock += 1
        self.since[places] = self.clock

    def __len__(self) -> int:
        return len(self._order)

    def share(self, worth: Floats) -> Floats:
        """Return the share of remembered labellings below given objective values.

        Ties count half.

        Parameters
        ----------
        worth : (k,) float array
            Objective values.

        Returns
        -------
        (k,) float array
            Shares in [0, 1].
        """
        known = np.sort(self._worth[: len(self)])
        below = np.searchsorted(known, worth, "left") + np.searchsorted(known, worth, "right")
        return np.asarray(below / (2.0 * max(1, len(known))))

    def guess(self, labellings: Bits) -> Floats:
        """Predict for each labelling the share of remembered labellings with a lower objective value.

        Parameters
        ----------
        labellings : (k, m) bool array
            Labels, True = dry.

        Returns
        -------
        (k,) float array
            Predictions, not limited to [0, 1].
        """
        return self.weighed(self.alike(self.signs(labellings), np.arange(len(self))))

    def weighed(self, alike: Single) -> Floats:
        """Predict from the covariances with the n remembered labellings; see `guess`.

        Parameters
        ----------
        alike : (k, ≥ n) float32 array
            Covariances, from `alike`.
        """
        if not len(self):
            return np.zeros(len(alike))
        weights = self._fit() if self._weights is None else self._weights
        found = alike[:, : len(self)] @ weights
        return np.asarray(np.round(found.astype(np.float64) + self._mean, _DIGITS))

    def _fit(self) -> Single:
        """Fit the weights of the Gaussian process to the remembered labellings."""
        count = len(self)
        matrix = self._matrix[:count, :count].copy()
        matrix[np.diag_indices(count)] += NOISE * len(self._group)
        share = self.share(self._worth[:count])
        self._mean = float(share.mean())
        # the transpose of the symmetric matrix has the column order that LAPACK needs
        _, weights, failed = sposv(matrix.T, (share - self._mean).astype(np.float32), lower=True, overwrite_a=True)
        if failed:
            raise ArithmeticError("the likeness of labellings is no positive definite matrix")
        self._weights = np.asarray(weights, dtype=np.float32)
        return self._weights

    def signs(self, labellings: Bits) -> Single:
        """Return labels (k, m) of the candidate faces as ±1, (k, f)."""
        found: Single = labellings[:, self._faces].astype(np.float32)
        found *= np.float32(2.0)
        found -= np.float32(1.0)
        return found

    def alike(self, signs: Single, places: Ints) -> Single:
        """Return the covariances (k, n) of labellings with remembered ones.

        Parameters
        ----------
        signs : (k, f) float32 array
            Labellings, from `signs`.
        places : (n,) int array
            Slots of the remembered labellings.
        """
        total: Single | None = None
        faces = signs.shape[1]
        for image in self._images:
            # faces − 2 × number of differing faces: an integer, hence exact in any order of summation
            product = signs @ image[places].T
            product -= np.float32(faces)
            product *= np.float32(0.5 / (REACH * faces))
            np.exp(product, out=product)
            total = product if total is None else np.add(total, product, out=total)
        return np.empty((len(signs), len(places)), dtype=np.float32) if total is None else total
