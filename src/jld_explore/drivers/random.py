"""Driver that draws random labellings, as a baseline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from jld_core.arrays import Bits
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation
from jld_explore.space import SearchSpace

# Labels of one batch; 512 labellings of 256 faces. A batch of 10 000 cells takes a fifth of a second.
_MOST_LABELS: Final = 1 << 17


class Random(Searcher):
    """Driver that draws labellings at random, each class once.

    size: largest number of labellings per batch; large spaces have smaller batches, so that the first one is soon
    there.
    """

    name = "random"
    ahead: ClassVar[int] = 4  # evaluations have no influence, so asking ahead is free

    def __init__(self, space: SearchSpace, seed: int, size: int = 256) -> None:
        super().__init__(space, seed, min(size, max(1, _MOST_LABELS // max(1, len(space.candidates)))))

    def propose(self) -> Bits:
        """Return at most `size` new random labellings (k, m), canonical and registered."""
        return self.fresh(self.draw, self.size)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Do nothing: evaluations have no influence on the draws."""
