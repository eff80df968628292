"""Compute pruning thresholds: the λ a labelling must exceed to be best or on the front.

The associative λ of a labelling is an upper bound on all its solutions without dilation.
A labelling is pruned if this bound does not exceed a known λ of a labelling with equal or better counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.ranking import Envelope, front_counts
from jld_explore.space import SearchSpace


class IncumbentFront:
    """Largest λ known for each combination of the scene's front counts.

    space: search space whose front defines the counts.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self._known = Envelope(len(space.search.front.axes))

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Update the front with evaluations of labellings (k, m); only those that collapse count."""
        good = np.array([found.status is Status.COLLAPSE for found in evaluations], dtype=bool)
        value = np.array([found.load_factor for found in evaluations])[good]
        self._known.learn(value, front_counts(self.space, labellings[good]))

    def thresholds(self, labellings: Bits) -> Floats:
        """Return the pruning threshold of each labelling.

        labellings: (k, m) True = dry. Returns (k,): λ, scene units, at or below which a labelling does not matter; −inf
        if any λ matters.
        """
        return self._known.best(front_counts(self.space, labellings))
