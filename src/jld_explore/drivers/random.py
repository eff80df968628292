"""Random valid labellings: the baseline that learns nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from jld_core.arrays import Bits
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation
from jld_explore.space import SearchSpace


class Random(Searcher):
    """Draws labellings at random, each class once."""

    name = "random"
    ahead: ClassVar[int] = 4  # it learns nothing, so nothing is lost by it

    def __init__(self, space: SearchSpace, seed: int, size: int = 256) -> None:
        super().__init__(space, seed, size)

    def propose(self) -> Bits:
        """New random labellings."""
        return self.fresh(self.draw, self.size)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Nothing to learn."""
