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
from jld_explore.evaluation.ranking import Envelope, front_counts
from jld_explore.space import SearchSpace


class IncumbentFront:
    """The largest λ known for what the scene's front counts. space: whose front."""

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self._known = Envelope(len(space.search.front.axes))

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m)."""
        good = np.array([found.status is Status.COLLAPSE for found in evaluations], dtype=bool)
        value = np.array([found.load_factor for found in evaluations])[good]
        self._known.learn(value, front_counts(self.space, labellings[good]))

    def below(self, labellings: Bits) -> Floats:
        """(k,) λ at or below which each of labellings (k, m) does not matter, scene units; −inf: it does."""
        return self._known.best(front_counts(self.space, labellings))
