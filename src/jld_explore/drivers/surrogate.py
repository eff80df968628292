"""Predict the rank of labellings before they are solved; predictions only decide the order of evaluation."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import sposv

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.space import SearchSpace

CORRELATION_LENGTH: Final = 0.1  # share of differing candidate faces at which the covariance is 1 / e

NOISE: Final = 0.01  # noise variance on the diagonal of the covariance matrix

SLOTS: Final = 192  # number of labellings remembered: half the best ones known, half the latest ones

_DIGITS: Final = 4  # decimal digits of a prediction, so that rounding errors do not decide an order

_SHARE: Final = SLOTS // 2  # number of labellings learned at a time, equal to the number of latest ones remembered

Single = NDArray[np.float32]


class Surrogate:
    """Gaussian process that predicts which share of known labellings a labelling exceeds."""

    def __init__(self, space: SearchSpace) -> None:
        # The covariance of two labellings is exp(−d / CORRELATION_LENGTH), d the share of candidate faces that differ,
        # summed over symmetric images of one. Shares in place of λ make units and outliers irrelevant.
        self._faces = np.flatnonzero(space.candidates)
        self._group = space.group
        self._images = np.zeros((len(space.group), SLOTS, len(self._faces)), dtype=np.float32)
        self._matrix = np.zeros((SLOTS, SLOTS), dtype=np.float32)
        self._values = np.empty(SLOTS)
        self._order = np.empty(0, dtype=np.int64)  # slots in the order in which they were filled
        self._weights: Single | None = None
        self._mean = 0.0
        self.filled_at = np.zeros(SLOTS, dtype=np.int64)
        self.batches_learned = 0

    def learn(self, labellings: Bits, values: Floats) -> None:
        """Remember labellings (k, m) with objective values (k,), larger is better."""
        for low in range(0, len(labellings), _SHARE):
            self._take_in(labellings[low : low + _SHARE], values[low : low + _SHARE])

    def _take_in(self, labellings: Bits, values: Floats) -> None:
        """Remember at most `_SHARE` labellings; full slots are taken from the worst of older ones."""
        count, known = len(labellings), self._order
        lacking = max(0, len(known) + count - SLOTS)
        if lacking:
            # keep the latest labellings, and the best of the older ones
            older = known[: len(known) + count - _SHARE]
            worst = np.argsort(-self._values[older], kind="stable")[len(older) - lacking :]
            slots = older[worst]
            stay = np.ones(len(known), dtype=bool)
            stay[worst] = False
            self._order = known[stay]
        else:
            slots = np.empty(0, dtype=np.int64)
        slots = np.concatenate([slots, np.arange(len(known), len(known) + count - lacking)])
        self._order = np.concatenate([self._order, slots])
        signs = self.signs(labellings)
        for image, permutation in zip(self._images, self._group, strict=True):
            image[slots] = self.signs(labellings[:, permutation])
        self._values[slots] = values
        covariance = self.covariance(signs, np.arange(len(self._order)))
        self._matrix[slots, : len(self._order)] = covariance
        self._matrix[: len(self._order), slots] = covariance.T
        self._weights = None
        self.batches_learned += 1
        self.filled_at[slots] = self.batches_learned

    def __len__(self) -> int:
        return len(self._order)

    def share_below(self, values: Floats) -> Floats:
        """Return the share of remembered labellings below each value (k,); ties count half."""
        known = np.sort(self._values[: len(self)])
        below = np.searchsorted(known, values, "left") + np.searchsorted(known, values, "right")
        return np.asarray(below / (2.0 * max(1, len(known))))

    def predict(self, labellings: Bits) -> Floats:
        """Predict the share of remembered labellings below each labelling: (k,), not limited to [0, 1]."""
        return self.predict_from(self.covariance(self.signs(labellings), np.arange(len(self))))

    def predict_from(self, covariance: Single) -> Floats:
        """Predict from covariances (k, ≥ n) with the n remembered labellings: (k,)."""
        if not len(self):
            return np.zeros(len(covariance))
        weights = self._fit() if self._weights is None else self._weights
        found = covariance[:, : len(self)] @ weights
        return np.asarray(np.round(found.astype(np.float64) + self._mean, _DIGITS))

    def _fit(self) -> Single:
        """Fit the process to the remembered labellings; return and keep its weights (n,)."""
        count = len(self)
        matrix = self._matrix[:count, :count].copy()
        matrix[np.diag_indices(count)] += NOISE * len(self._group)
        shares = self.share_below(self._values[:count])
        self._mean = float(shares.mean())
        # the transpose of the symmetric matrix has the column order that LAPACK needs
        _, weights, failed = sposv(matrix.T, (shares - self._mean).astype(np.float32), lower=True, overwrite_a=True)
        if failed:
            raise ArithmeticError("the covariance matrix of labellings is not positive definite")
        self._weights = np.asarray(weights, dtype=np.float32)
        return self._weights

    def signs(self, labellings: Bits) -> Single:
        """Convert labels (k, m) to signs (k, f) of candidate faces: 1 for dry, −1 for inner."""
        found: Single = labellings[:, self._faces].astype(np.float32)
        found *= np.float32(2.0)
        found -= np.float32(1.0)
        return found

    def covariance(self, signs: Single, slots: Ints) -> Single:
        """Compute covariances (k, n) of labellings, by signs (k, f), with those in n slots."""
        total: Single | None = None
        faces = signs.shape[1]
        for image in self._images:
            # faces − 2 × number of differing faces: an integer, hence exact in any order of summation
            product = signs @ image[slots].T
            product -= np.float32(faces)
            product *= np.float32(0.5 / (CORRELATION_LENGTH * faces))
            np.exp(product, out=product)
            total = product if total is None else np.add(total, product, out=total)
        return np.empty((len(signs), len(slots)), dtype=np.float32) if total is None else total
