"""A guess at how good labellings are before any of them is solved: a Gaussian process on differing faces.

Two labellings are alike by exp(−d / REACH), where d is the share of faces they differ in, summed over the
symmetric images of one of them. What is guessed is the share of the known that a labelling is better than, so
neither units nor outliers of λ matter. The guess only decides what is evaluated sooner, never what is true of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import sposv

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.space import SearchSpace

REACH: Final = 0.1
"""Share of the candidate faces in which labellings differ at which their likeness has fallen to 1 / e."""

NOISE: Final = 0.01
"""Likeness added to the diagonal: how far guesses may miss what is known."""

MEMORY: Final = 192
"""Labellings learned from: the better half of them the best ones met, the others the last ones."""

_DIGITS: Final = 4
"""Digits of a guess that count, so that rounding does not decide an order."""

_SHARE: Final = MEMORY // 2
"""Labellings taken in at a time: as many as are remembered for being the last."""

Single = NDArray[np.float32]


class Surrogate:
    """Learns from what it is told and guesses at the rest. space: whose candidate faces and symmetries count.

    What is remembered keeps its place, of MEMORY; `since` says when each place was filled, `clock` when the last was.
    """

    def __init__(self, space: SearchSpace) -> None:
        self._faces = np.flatnonzero(space.candidates)
        self._group = space.group
        self._images = np.zeros((len(space.group), MEMORY, len(self._faces)), dtype=np.float32)
        self._matrix = np.zeros((MEMORY, MEMORY), dtype=np.float32)
        self._worth = np.empty(MEMORY)
        self._order = np.empty(0, dtype=np.int64)  # places, in the order in which they were filled
        self._weights: Single | None = None
        self._mean = 0.0
        self.since = np.zeros(MEMORY, dtype=np.int64)
        self.clock = 0

    def learn(self, labellings: Bits, worth: Floats) -> None:
        """Take in labellings (k, m) with their worth (k,), larger is better, any monotonic scale."""
        for low in range(0, len(labellings), _SHARE):
            self._take_in(labellings[low : low + _SHARE], worth[low : low + _SHARE])

    def _take_in(self, labellings: Bits, worth: Floats) -> None:
        count, known = len(labellings), self._order
        lacking = max(0, len(known) + count - MEMORY)
        if lacking:
            # the last stay, and of those before them the best
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
        """The share of the known that is worse than some worth, half of what equals it counted; (k,)."""
        known = np.sort(self._worth[: len(self)])
        below = np.searchsorted(known, worth, "left") + np.searchsorted(known, worth, "right")
        return np.asarray(below / (2.0 * max(1, len(known))))

    def guess(self, labellings: Bits) -> Floats:
        """What share of the known each of labellings (k, m) is expected to be better than, (k,), unbounded."""
        return self.weighed(self.alike(self.signs(labellings), np.arange(len(self))))

    def weighed(self, alike: Single) -> Floats:
        """The guess from the likeness (k, ≥ n) to what is remembered at the n places."""
        if not len(self):
            return np.zeros(len(alike))
        weights = self._fit() if self._weights is None else self._weights
        found = alike[:, : len(self)] @ weights
        return np.asarray(np.round(found.astype(np.float64) + self._mean, _DIGITS))

    def _fit(self) -> Single:
        count = len(self)
        matrix = self._matrix[:count, :count].copy()
        matrix[np.diag_indices(count)] += NOISE * len(self._group)
        share = self.share(self._worth[:count])
        self._mean = float(share.mean())
        # symmetric, so its transpose is the same and lies as the routine wants it
        _, weights, failed = sposv(matrix.T, (share - self._mean).astype(np.float32), lower=True, overwrite_a=True)
        if failed:
            raise ArithmeticError("the likeness of labellings is no positive definite matrix")
        self._weights = np.asarray(weights, dtype=np.float32)
        return self._weights

    def signs(self, labellings: Bits) -> Single:
        """Labels (k, m) of the candidate faces as ±1, (k, f)."""
        found: Single = labellings[:, self._faces].astype(np.float32)
        found *= np.float32(2.0)
        found -= np.float32(1.0)
        return found

    def alike(self, signs: Single, places: Ints) -> Single:
        """The likeness of rows (k, f) to what is remembered at places (n,), (k, n)."""
        total: Single | None = None
        faces = signs.shape[1]
        for image in self._images:
            product = signs @ image[places].T  # faces − 2 d, whole numbers, so exact in any order
            product -= np.float32(faces)
            product *= np.float32(0.5 / (REACH * faces))
            np.exp(product, out=product)
            total = product if total is None else np.add(total, product, out=total)
        return np.empty((len(signs), len(places)), dtype=np.float32) if total is None else total
