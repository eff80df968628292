"""What matters while a study runs: labellings that can still be the best, or on the front.

The associative λ of a labelling bounds all its answers without dilation from above. Where that bound does not
exceed an answer known of a labelling that counts as well, it can be neither the best nor on the front.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.ranking import front_counts
from jld_explore.space import SearchSpace


class IncumbentFront:
    """The largest λ known for each count of the scene's front. space: whose front."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self._count, self._best = np.empty(0), np.empty(0)

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m)."""
        good = np.array([found.status is Status.COLLAPSE for found in evaluations], dtype=bool)
        value = np.array([found.load_factor for found in evaluations])[good]
        count = np.concatenate([self._count, front_counts(self.space, labellings[good])])
        best = np.concatenate([self._best, value])
        order = np.lexsort((-best, count))
        count, best = count[order], np.maximum.accumulate(best[order])
        # a larger count is worth keeping only for a larger λ
        rises = np.concatenate([[True], best[1:] > best[:-1]])[: len(best)]
        self._count, self._best = count[rises], best[rises]

    def below(self, labellings: Bits) -> Floats:
        """(k,) λ at or below which each of labellings (k, m) does not matter, scene units; −inf: it does."""
        place = np.searchsorted(self._count, front_counts(self.space, labellings), "right")
        return np.asarray(np.concatenate([[-np.inf], self._best])[place])
