"""A guess at how good labellings are before any of them is solved: a Gaussian process on differing faces.

Two labellings are alike by exp(−d / REACH), where d is the share of faces they differ in, summed over the
symmetric images of one of them. What is guessed is the share of the known that a labelling is better than, so
neither units nor outliers of λ matter. The guess only decides what is evaluated sooner, never what is true of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from jld_core.arrays import Bits, Floats
from jld_explore.space import SearchSpace

REACH: Final = 0.1
"""Share of the candidate faces in which labellings differ at which their likeness has fallen to 1 / e."""

NOISE: Final = 0.01
"""Likeness added to the diagonal: how far guesses may miss what is known."""

MEMORY: Final = 256
"""Labellings learned from: the better half of them the best ones met, the others the last ones."""

_DIGITS: Final = 4
"""Digits of a guess that count, so that rounding does not decide an order."""

Single = NDArray[np.float32]


class Surrogate:
    """Learns from what it is told and guesses at the rest. space: whose candidate faces and symmetries count."""

    def __init__(self, space: SearchSpace) -> None:
        self._faces = np.flatnonzero(space.candidates)
        self._group = space.group
        self._images = np.empty((len(space.group), 0, len(self._faces)), dtype=np.float32)
        self._matrix = np.empty((0, 0), dtype=np.float32)
        self._worth = np.empty(0)
        self._weights: Single | None = None
        self._mean = 0.0

    def learn(self, labellings: Bits, worth: Floats) -> None:
        """Take in labellings (k, m) with their worth (k,), larger is better, any monotonic scale."""
        images = np.stack([self._signs(labellings[:, permutation]) for permutation in self._group])
        self._images = np.concatenate([self._images, images], axis=1)
        self._worth = np.concatenate([self._worth, worth])
        self._weights = None
        new = self._alike(images[0])
        old = new.shape[1] - len(new)
        self._matrix = np.block([[self._matrix, new[:, :old].T], [new]])
        if len(self._worth) > MEMORY:
            last = len(self._worth) - MEMORY // 2
            best = np.argsort(-self._worth[:last], kind="stable")[: MEMORY - MEMORY // 2]
            kept = np.concatenate([np.sort(best), np.arange(last, len(self._worth))])
            self._images, self._worth = self._images[:, kept], self._worth[kept]
            self._matrix = self._matrix[np.ix_(kept, kept)]

    def share(self, worth: Floats) -> Floats:
        """The share of the known that is worse than some worth, half of what equals it counted; (k,)."""
        known = np.sort(self._worth)
        below = np.searchsorted(known, worth, "left") + np.searchsorted(known, worth, "right")
        return np.asarray(below / (2.0 * max(1, len(known))))

    def guess(self, labellings: Bits) -> Floats:
        """What share of the known each of labellings (k, m) is expected to be better than, (k,), unbounded."""
        if not len(self._worth):
            return np.zeros(len(labellings))
        weights = self._fit() if self._weights is None else self._weights
        found = self._alike(self._signs(labellings)) @ weights
        return np.asarray(np.round(found.astype(np.float64) + self._mean, _DIGITS))

    def _fit(self) -> Single:
        matrix = self._matrix.copy()
        matrix[np.diag_indices(len(matrix))] += NOISE * len(self._group)
        share = self.share(self._worth)
        self._mean = float(share.mean())
        factor = cho_factor(matrix, overwrite_a=True, check_finite=False)
        weights: Single = np.asarray(cho_solve(factor, share - self._mean, check_finite=False), dtype=np.float32)
        self._weights = weights
        return weights

    def _signs(self, labellings: Bits) -> Single:
        return np.where(labellings[:, self._faces], np.float32(1.0), np.float32(-1.0))

    def _alike(self, rows: Single) -> Single:
        total = np.zeros((len(rows), len(self._worth)), dtype=np.float32)
        for image in self._images:
            product = rows @ image.T  # faces − 2 d, whole numbers, so exact in any order
            product -= np.float32(rows.shape[1])
            product *= np.float32(0.5 / (REACH * rows.shape[1]))
            total += np.exp(product, out=product)
        return total
